"""What a device does beside PoCL, in one row: its checks, its pictures, its speed.

    python -m benchmarks.devices [--device SPEC] [--reference SPEC] [--markdown] [--json FILE]

Both devices render the same samples of the scenes A, A_lens, B and C in turns, in one process. The reference is the
first PoCL on a processor that is not the device itself, or else the device itself. On processors speed goes by CPU
time, which other work on the machine hardly touches; where one of the two is a GPU, by the clock. A driver becomes
visible when OCL_ICD_VENDORS names a folder that holds its `.icd` file; PoCL from pip stays visible beside it.
"""

from __future__ import annotations

import statistics
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, table, write_json
from benchmarks.scenes import MEANING, reference_scene, wavefront_of
from benchmarks.stopwatch import Times, timed
from rptcam_cl.device.devices import DeviceInfo, choose_device, is_pocl, list_devices
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.studies.selfcheck_suite import run_suite

SCENES = ("A", "A_lens", "B", "C")
SAMPLES = 16  # per pixel
SECONDS = 2.0  # after so much time of a scene no further pair of renders begins
MOST_PAIRS = 7
COLUMNS = (
    "device",
    "driver",
    "numerics",
    *(f"picture {name}" for name in SCENES),
    *(f"speed {name}" for name in SCENES),
)


@dataclass(frozen=True)
class Beside:
    """One scene on both devices.

    Attributes
    ----------
    other_bits : float
        Share of the film's values that are not the same to the bit.
    elsewhere : float
        Share that differs by more than 1e-5: paths that rounding has sent elsewhere.
    largest : float
        Largest difference of a value, over the mean of the picture.
    of_mean : float
        Difference of the means of the pictures, over the mean.
    speed : float
        Samples per second, over those of the reference; the median of pairs.
    msamples_per_second : float
        Of the device, with the machine to itself.
    """

    other_bits: float
    elsewhere: float
    largest: float
    of_mean: float
    speed: float
    msamples_per_second: float


def reference_of(device: DeviceInfo, spec: str | None) -> DeviceInfo:
    """Return what a device is compared with."""
    if spec is not None:
        return choose_device(spec)
    others = (other for other in list_devices() if is_pocl(other.handle) and other.id != device.id)
    return next(others, device)


def film_of(wavefront: Wavefront) -> tuple[NDArray[np.float32], Times]:
    """Return a picture and what it took, from the empty film to numpy."""
    films: list[NDArray[np.float32]] = []

    def work() -> None:
        wavefront.clear()
        films.append(render_plan(wavefront, spp=SAMPLES, seconds=None, has_lens=False).pixels)

    times = timed(work)
    return films[0], times


def compare(name: str, device: Session, reference: Session, shrink: int) -> Beside:
    """Render a scene on both devices in turns."""
    scene = reference_scene(name, shrink=shrink)
    ours, theirs = wavefront_of(scene, device), wavefront_of(scene, reference)
    clock = "gpu" if "gpu" in (device.info.type, reference.info.type) else "cpu"
    ratios: list[float] = []
    seconds: list[float] = []
    while len(ratios) < MOST_PAIRS and sum(seconds) < SECONDS:
        (got, own), (expected, other) = film_of(ours), film_of(theirs)
        seconds.append(own.undisturbed(clock))
        ratios.append(other.undisturbed(clock) / seconds[-1])
    mean = float(expected.mean(dtype=np.float64))
    return Beside(
        other_bits=float((got.view(np.uint32) != expected.view(np.uint32)).mean()),
        elsewhere=1 - float(np.isclose(got, expected, rtol=1e-5, atol=1e-6).mean()),
        largest=float(np.abs(got.astype(np.float64) - expected).max()) / mean,
        of_mean=abs(float(got.mean(dtype=np.float64)) / mean - 1),
        speed=statistics.median(ratios),
        msamples_per_second=SAMPLES * got.shape[0] * got.shape[1] / min(seconds) / 1e6,
    )


def checks_of(session: Session) -> dict[str, Any]:
    """Return what ``rptcam doctor --numerics`` finds on a device."""
    found = [check for checks, _ in run_suite(session) for check in checks]
    return {
        "passed": sum(check.passed for check in found),
        "made": sum(not check.skipped for check in found),
        "skipped": [f"{check.name}: {check.note}" for check in found if check.skipped],
        "failed": [f"{check.name}: {check.measured:.3g} {check.unit} {check.note}" for check in found if check.failed],
    }


def picture_cell(beside: Beside) -> str:
    """Return in a word how a picture compares."""
    if beside.other_bits == 0:
        return "same bits"
    return f"{beside.largest:.1g} at most" + (f", {100 * beside.elsewhere:.2g} % > 1e-5" if beside.elsewhere else "")


def row(info: DeviceInfo, checks: dict[str, Any], scenes: dict[str, Beside]) -> list[str]:
    """Return the cells of the device's row."""
    skipped = f", {len(checks['skipped'])} skipped" if checks["skipped"] else ""
    return [
        info.name,
        f"{info.platform} {info.handle.driver_version.strip()}",
        f"{checks['passed']} of {checks['made']}{skipped}",
        *(picture_cell(found) for found in scenes.values()),
        *(f"{found.speed:.2g}" for found in scenes.values()),
    ]


def main() -> None:
    """Check and compare one device, and print its row."""
    parser = arguments("One row of the table of devices.")
    parser.add_argument("--reference", metavar="SPEC", help="what to compare with (default: another device, a PoCL)")
    parser.add_argument("--markdown", action="store_true", help="print the table's row alone, for docs/devices.md")
    options = parser.parse_args()
    info = choose_device(options.device)
    other = reference_of(info, options.reference)
    device, reference = Session(info), Session(other)
    scenes = {name: compare(name, device, reference, 16 if options.quick else 4) for name in SCENES}
    checks = checks_of(device)
    lines = table("", COLUMNS, [row(info, checks, scenes)]).strip().splitlines()
    facts = machine(info) | {"reference": f"{other.name} ({other.platform} {other.handle.driver_version.strip()})"}
    if options.markdown:
        print(lines[-1])
    else:
        print_machine(facts)
        print(*lines[1:], "", *(f"{name}: {MEANING[name]}" for name in SCENES), sep="\n")
        print(*(f"{kind}: {line}" for kind in ("skipped", "failed") for line in checks[kind]), sep="\n")
    results = {"numerics": checks, "scenes": {name: asdict(found) for name, found in scenes.items()}}
    write_json(options.json, facts, results)


if __name__ == "__main__":
    main()
