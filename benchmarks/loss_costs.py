"""What losses in a lens cost a ray on the device: reflection, coatings, absorption; for one wavelength or one per ray.

    python -m benchmarks.loss_costs [--rays 262144] [--json FILE]

The lens is the double Gauss 50 mm f/2 of eleven surfaces, its glasses given the absorption of N-SK16. Rays from the
film pass all of it. The kernel is the renderer's, float32, timed in turns in one run, without transfers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.surface_costs import Row
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.optics.glass import AIR, GLASSES, MAGNESIUM_FLUORIDE, AbbeCauchy, MeasuredReflectance
from rptcam_cl.optics.lens import Lens, film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import COATED, IDEAL, UNCOATED, LensTransmission, with_coating
from rptcam_cl.rendering.cameras.lens_records import LensRecords, lens_records

ROUNDS = 15
WITHIN = 0.9  # of the exit pupil
MEASURED = MeasuredReflectance((380.0, 450.0, 550.0, 650.0, 780.0), (0.02, 0.004, 0.003, 0.005, 0.02))
SURFACES_ALONE = LensTransmission(absorption=False)
COLUMNS = ("losses", "one wavelength: CPU ns per ray", "more than without", "wavelength per ray: CPU ns", "more")


def lenses() -> dict[str, tuple[Lens, LensTransmission]]:
    """Return the lens and what counts, by what the table calls it."""
    plain = load_lens("dgauss-50mm")
    glass = [
        surface.glass if surface.glass == AIR else AbbeCauchy(float(surface.glass.index(LINE_D_NM)), 50.0,
                                                              absorption=GLASSES["N-SK16"].absorption)
        for surface in plain.surfaces
    ]  # fmt: skip
    surfaces = tuple(replace(surface, glass=each) for surface, each in zip(plain.surfaces, glass, strict=True))
    lens = replace(plain, surfaces=surfaces)
    layers, measured = with_coating(lens, MAGNESIUM_FLUORIDE), with_coating(lens, MEASURED)
    return {
        "none": (lens, IDEAL),
        "absorption": (lens, LensTransmission(fresnel=False, coatings=False)),
        "bare surfaces": (lens, LensTransmission(coatings=False, absorption=False)),
        "measured coatings": (measured, SURFACES_ALONE),
        "single layers": (layers, SURFACES_ALONE),
        "bare surfaces, absorption": (lens, UNCOATED),
        "single layers, absorption": (layers, COATED),
    }


def rays(lens: Lens, count: int) -> NDArray[np.float32]:
    """Return the rows that the kernel reads: rays from points about the middle of the film, with wavelengths."""
    random = np.random.default_rng(1)
    back = film_distance(lens, np.inf)
    pupil = lens.first_order().exit_pupil
    angle, radius = random.uniform(0, 2 * np.pi, count), np.sqrt(random.uniform(0, 1, count))
    radius *= WITHIN * pupil.diameter_mm / 2
    beam = np.zeros((9, count), np.float32)
    beam[:2] = random.uniform(-2, 2, (2, count))
    beam[2] = -back
    aims = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    beam[3:6] = aims[0] - beam[0], aims[1] - beam[1], np.full(count, back - pupil.distance_mm)
    beam[3:6] /= np.linalg.norm(beam[3:6], axis=0)
    beam[6] = random.uniform(400, 700, count)
    return beam


def records_of(lens: Lens, transmission: LensTransmission, *, dispersive: bool) -> LensRecords:
    """Return the records of a lens for rays from the film."""
    return lens_records(lens, LINE_D_NM, "film", 0.0, dispersive=dispersive, transmission=transmission)


def measure(session: Session, count: int, rounds: int) -> dict[str, tuple[float, float]]:
    """Return the least times of one ray [s]: with one wavelength for all, and with one per ray."""
    beam = rays(load_lens("dgauss-50mm"), count)
    rows = {
        (name, dispersive): Row(session, records_of(*each, dispersive=dispersive), beam)
        for name, each in lenses().items()
        for dispersive in (False, True)
    }
    best = dict.fromkeys(rows, np.inf)
    for _ in range(rounds):
        for key, each in rows.items():
            best[key] = min(best[key], each.seconds())
    return {name: (best[name, False] / count, best[name, True] / count) for name in lenses()}


def main() -> None:
    """Measure and print the table."""
    parser = arguments("Cost of losses in a lens on the device.")
    parser.add_argument("--rays", type=int, default=1 << 18, help="rays per run (default 262144)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    count, rounds = (4096, 1) if options.quick else (-(-options.rays // 4096) * 4096, ROUNDS)
    found = measure(session, count, rounds)
    lines = [
        [name, *(cell for time, none in zip(times, found["none"], strict=True)
                 for cell in (f"{1e9 * time:.1f}", f"{time / none - 1:+.0%}"))]
        for name, times in found.items()
    ]  # fmt: skip
    print_machine(facts)
    print_table(f"Double Gauss, {count} rays", COLUMNS, lines)
    write_json(options.json, facts, {"seconds_per_ray": found})


if __name__ == "__main__":
    main()
