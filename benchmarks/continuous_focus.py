"""Continuous autofocus: share of the frames in focus by how subjects move, and by the noise of the measurement.

    python -m benchmarks.continuous_focus [--focal-length-mm 50] [--f-number 2] [--fps 24] [--delay-s 0.05]
        [--speed-mm-s 30] [--quick]

Subjects move by formulas before a thin lens. The servo is given where each is sharp, with noise, and never the distance
itself; errors are counted against the thin-lens formula in float64. *in focus*: within half of a depth of focus, 2 N c.
*late* is a lens that stands where the last known measurement was, by a drive without inertia.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_table, write_json
from rptcam_cl.device.devices import choose_device
from rptcam_cl.scene.exposure import ContinuousFocus
from rptcam_cl.studies.focus.servo import FOCAL_LENGTHS_PER_S, RISE_S, DriveLimits, Servo

NOISES = (0.0, 0.05, 0.1, 0.2)  # depths of focus
SEEDS = 8
SHARP = 0.5
MOTIONS: dict[str, tuple[Callable[[float], float], float]] = {  # distance [m] at a time, and how long [s]
    "at rest at 2 m": (lambda t: 2.0, 6.0),
    "1.4 m/s, from 6 to 1.2 m": (lambda t: 6 - 1.4 * t, 4.8 / 1.4),
    "5 m/s, from 20 to 1.2 m": (lambda t: 20 - 5 * t, 18.8 / 5),
    "14 m/s, from 60 to 1.2 m": (lambda t: 60 - 14 * t, 58.8 / 14),
    "14 m/s, from 3 to 60 m": (lambda t: 3 + 14 * t, 57 / 14),
    "speeds up by 6 m/s², 20 to 2 m": (lambda t: 20 - 3 * t * t, 2.4),
    "brakes by 5 m/s², 13 to 3 m, rests": (lambda t: 3 + 2.5 * (2 - min(t, 2.0)) ** 2, 4.0),
    "to and fro, 2 to 4 m, 4 m/s²": (lambda t: 3 + math.cos(2 * t), 6.3),
    "to and fro, 1.9 to 3.1 m, 10 m/s²": (lambda t: 2.5 + 0.6 * math.cos(4 * t), 6.3),
    "turns at once, 1.4 m/s, at 2 m": (lambda t: 2 + 1.4 * abs(t - 2), 4.0),
    "from 4 m to 2 m at once": (lambda t: 4.0 if t < 1 else 2.0, 3.0),
    "8 m/s, from 12 to 0.6 m": (lambda t: 12 - 8 * t, 11.4 / 8),
    "30 m/s, from 60 to 1.2 m": (lambda t: 60 - 30 * t, 58.8 / 30),
}


def errors_of(
    distance_m: Callable[[float], float],
    seconds: float,
    noise: float,
    seed: int,
    lens: tuple[float, float],
    fps: float,
    settings: ContinuousFocus,
    speed: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return errors of the servo and of a late lens [depths of focus], and the share of frames at greatest speed."""
    focal_mm, f_number = lens
    sharp_mm = 2 * f_number * math.hypot(36, 24) / 1500
    times = np.arange(max(round(seconds * fps), 4)) / fps
    subject = np.array([1 / (1 / focal_mm - 1e-3 / distance_m(float(t))) for t in times])
    seen = subject + sharp_mm * noise * np.random.default_rng(seed).normal(size=len(times))
    limits = DriveLimits((0.94 * focal_mm, 2 * focal_mm), speed, speed / RISE_S)
    servo = Servo(seen[0], limits, lambda place: 1e3 * (1 / focal_mm - 1 / place), settings)
    servo.measure(seen[0], noise * sharp_mm)
    places, limited = [seen[0]], 0
    for place in seen[1:]:
        servo.next_frame(1 / fps, sharp_mm)
        servo.measure(place, noise * sharp_mm)
        places.append(servo.place)
        limited += servo.is_limited
    behind = math.ceil(settings.delay_s * fps - 1e-9)
    late = seen[np.maximum(np.arange(len(seen)) - behind, 0)]
    return (np.array(places) - subject) / sharp_mm, (late - subject) / sharp_mm, limited / len(times)


def main() -> None:
    """Print the table."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--focal-length-mm", type=float, default=50.0)
    parser.add_argument("--f-number", type=float, default=2.0)
    parser.add_argument("--fps", type=float, default=24.0)
    parser.add_argument("--delay-s", type=float, default=0.05)
    parser.add_argument("--speed-mm-s", type=float, help="of the drive (default: 0.6 focal lengths a second)")
    options = parser.parse_args()
    settings, lens = ContinuousFocus(delay_s=options.delay_s), (options.focal_length_mm, options.f_number)
    speed = options.speed_mm_s or FOCAL_LENGTHS_PER_S * options.focal_length_mm
    rows, results = [], {}
    for name, (motion, seconds) in list(MOTIONS.items())[: 2 if options.quick else None]:
        cells, own = [], {}
        for noise in NOISES:
            runs = [
                errors_of(motion, seconds, noise, seed, lens, options.fps, settings, speed)
                for seed in range(1 if options.quick or noise == 0 else SEEDS)
            ]
            errors, late = (np.abs(np.concatenate([run[part] for run in runs])) for part in (0, 1))
            if noise == 0:
                cells.append(f"{np.mean(late <= SHARP):.0%}")
            cells.append(f"{np.mean(errors <= SHARP):.0%} ({np.sqrt(np.mean(errors**2)):.2f})")
            own[noise] = {"share": float(np.mean(errors <= SHARP)), "rms": float(np.sqrt(np.mean(errors**2))),
                          "late": float(np.mean(late <= SHARP)), "at_greatest_speed": runs[0][2]}  # fmt: skip
        rows.append([name, *cells, f"{own[0.0]['at_greatest_speed']:.0%}"])
        results[name] = own
    columns = ["subject", "late", *(f"noise {noise:g}" for noise in NOISES), "drive too slow"]
    title = (
        f"frames in focus, and root mean square error [depths of focus]; {lens[0]:g} mm at f/{lens[1]:g},"
        f" {options.fps:g} frames a second, known after {options.delay_s:g} s, a drive of {speed:g} mm/s"
    )
    print_table(title, columns, rows)
    write_json(options.json, machine(choose_device(options.device)), results)


if __name__ == "__main__":
    main()
