"""What one surface of each kind costs a ray on the device, beside a sphere.

    python -m benchmarks.surface_costs [--rays 262144] [--json FILE]

Each lens is a row of sixteen surfaces of one kind, air and glass in turns, whose shapes are near to each other, so that
every ray crosses all of them. The kernel is the renderer's, float32, timed in turns in one run, without transfers; what
a row costs beside its surfaces (loads, stores, launch) is found with a row of one sphere and taken off.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.stopwatch import fastest
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.optics.glass import AIR, ConstantIndex
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.shapes import Biconic, Toroid
from rptcam_cl.optics.surface import Surface
from rptcam_cl.rendering.cameras.lens_records import LensRecords, lens_records
from rptcam_cl.rendering.traceable_lens import PACKETS

COUNT = 16
GROUP = 16
ROUNDS = 7
RADIUS_MM = 60.0
GLASS = ConstantIndex(1.6)
GOAL = 3.0  # spheres' worth
WITH_GOAL = ("conic", "cylinder", "even asphere, 4 terms", "even asphere, strong")
KINDS = {
    "sphere": Surface(),
    "conic": Surface(conic=-1.5),
    "cylinder": Surface(cylinder="y"),
    "even asphere, 4 terms": Surface(conic=-1.0, aspheric=((4, 1e-6), (6, -2e-8), (8, 3e-11), (10, -1e-13))),
    "even asphere, strong": Surface(aspheric=((4, 2e-5), (6, -1e-7), (8, 3e-10), (10, -1e-12))),
    "odd asphere": Surface(aspheric=((3, 1e-5), (5, -1e-7))),
    "biconic": Surface(conic=-0.5, form=Biconic(1 / 90.0)),
    "toroid": Surface(form=Toroid(1 / 90.0)),
}
COLUMNS = ("surface", "CPU ns per ray and surface", "spheres' worth", "goal", "met")


def row(kind: Surface, count: int) -> Lens:
    """Return surfaces of one kind one after the other, bent to and fro so that rays stay near the axis."""
    surfaces = []
    for k in range(count):
        bent = replace(kind, curvature=1 / RADIUS_MM, thickness=1.0, semi_diameter=15.0)
        surfaces.append(replace(bent, glass=GLASS if k % 2 == 0 else AIR))
    return Lens("row", tuple(surfaces))


def records_of(lens: Lens) -> LensRecords:
    """Return the records of a row for rays that start before its first vertex."""
    return lens_records(lens, LINE_D_NM, "scene", 0.0)


def rays(count: int) -> NDArray[np.float32]:
    """Return the rows that the kernel reads: points 5 mm before the first vertex and directions."""
    random = np.random.default_rng(1)
    beam = np.zeros((8, count), np.float32)
    beam[:2] = random.uniform(-6, 6, (2, count))
    beam[2] = -5.0
    beam[3:5] = random.uniform(-0.05, 0.05, (2, count))
    beam[5] = 1.0
    beam[3:6] /= np.linalg.norm(beam[3:6], axis=0)
    return beam


class Row:
    """A row of surfaces on the device, ready to be traced."""

    def __init__(self, session: Session, records: LensRecords, beam: NDArray[np.float32]) -> None:
        self.session, self.beam = session, beam
        lanes = 16 if session.lanes > 1 else 1
        facts = records.facts | {"VW": lanes, "DOUBLE": 0, "LENS_KEEP_FAILED": 0}
        program = session.program(["pass/trace_rays.cl"], facts, device_declarations())
        self.memory = session.allocate(beam.nbytes)
        self.items = beam.shape[1] // (PACKETS * lanes)
        self.launch = session.bind(
            program,
            "trace_rays",
            surfaces=session.upload(records.surfaces),
            count=np.int32(len(records.surfaces)),
            stop=session.upload(records.stop),
            rays=self.memory,
            capacity=np.uint32(beam.shape[1]),
        )
        self.refill()
        self.work()
        out = session.read(self.memory, np.float32, beam.size).reshape(beam.shape)
        if out[6].any():
            raise SystemExit("rays are blocked: the row is no measure")

    def refill(self) -> None:
        """Put the rays back where they start."""
        self.session.write(self.memory, self.beam)
        self.session.finish()

    def work(self) -> None:
        """Trace all rays."""
        self.launch.enqueue(self.items, GROUP)
        self.session.finish()

    def seconds(self) -> float:
        """Return the time of one trace [s], on a processor of all its cores together."""
        times = fastest(self.work, 1, self.refill)
        return times.cpu if self.session.info.type == "cpu" else times.wall


def measure(session: Session, count: int, rounds: int) -> dict[str, float]:
    """Return the time of one surface for one ray [s] of every kind, the least of several rounds."""
    beam = rays(count)
    rows = {name: Row(session, records_of(row(kind, COUNT)), beam) for name, kind in KINDS.items()}
    single = Row(session, records_of(row(Surface(), 1)), beam)
    best, one = dict.fromkeys(rows, np.inf), np.inf
    for _ in range(rounds):
        one = min(one, single.seconds())
        for name, each in rows.items():
            best[name] = min(best[name], each.seconds())
    sphere = (best["sphere"] - one) / (COUNT - 1)
    return {name: (seconds - one + sphere) / COUNT / count for name, seconds in best.items()}


def main() -> None:
    """Measure every kind and print the table."""
    parser = arguments("Cost of a surface of each kind on the device.")
    parser.add_argument("--rays", type=int, default=1 << 18, help="rays per run (default 262144)")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    count, rounds = (4096, 1) if options.quick else (-(-options.rays // 4096) * 4096, ROUNDS)
    found = measure(session, count, rounds)
    worth = {name: seconds / found["sphere"] for name, seconds in found.items()}
    lines = [
        [name, f"{1e9 * seconds:.2f}", f"{worth[name]:.2f}", *_goal(name, worth[name])]
        for name, seconds in found.items()
    ]
    print_machine(facts)
    print_table(f"Rows of {COUNT} surfaces, {count} rays", COLUMNS, lines)
    write_json(options.json, facts, {"seconds_per_ray_and_surface": found, "spheres": worth})


def _goal(name: str, worth: float) -> tuple[str, str]:
    return (f"{GOAL:g}", "yes" if worth <= GOAL else "no") if name in WITH_GOAL else ("-", "-")


if __name__ == "__main__":
    main()
