"""Rays per second through the 50 mm double Gauss: the device's kernel, the device from Python, numpy, other programs.

    python -m benchmarks.lens_rays [--rays 1048576] [--optics-python PATH] [--json FILE]

Rays go from the film to the rear rim, so that part of them is blocked on the way, as in a picture. The kernel is timed
as it stands in the renderer (float32), without transfers; ``Lens.trace(device=...)`` with them. Beside it stands the
device's peak of multiply-adds, measured in the same run. optiland (numpy back end) and ray-optics, where the Python
given has them, trace rays of which all pass, in processes of their own; that they find the same points is checked.
"""

from __future__ import annotations

import sys
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.peak import peak_flops
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.stopwatch import Times, cores, fastest
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.cameras.lens_records import lens_records
from rptcam_cl.rendering.traceable_lens import PACKETS, TraceableLens, load_lens

LENS = "dgauss-50mm"
FILM_DISTANCE_MM = 36.3972  # focused at 8.8 m
FILM_MM = (36.0, 20.25)
GROUP = 16
# Counted in kernels/lens for a spherical surface, comparisons and choices left out: 45 additions and multiplications,
# two divisions and two square roots.
OPERATIONS_PER_SURFACE = 49
OTHERS = {"optiland": 300, "rayoptics": 2}  # programs, and how many thousand rays they trace at a time
BEFORE_MM = 1.0  # of the first vertex, where the rays of the others start
SAME_MM = 1e-9
COLUMNS = ("tracer", "Mray/s by wall", "by CPU", "CPU ns per ray", "times less than numpy")


def film_rays(lens: TraceableLens, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins all over the film and directions to all of the rear rim, in the frame of the lens [mm]."""
    random = np.random.default_rng(1)
    origins = np.full((count, 3), lens.length + FILM_DISTANCE_MM)
    origins[:, :2] = random.uniform(-0.5, 0.5, (count, 2)) * FILM_MM
    radius = lens.surfaces[-1].semi_diameter * np.sqrt(random.uniform(0, 1, count))
    angle = random.uniform(0, 2 * np.pi, count)
    aims = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, lens.length)], axis=1)
    directions = aims - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def kernel_times(
    session: Session, lens: TraceableLens, origins: NDArray[np.float64], directions: NDArray[np.float64], runs: int
) -> Times:
    """Return the times of the kernel alone, compiled as the renderer compiles it."""
    lanes = 16 if session.lanes > 1 else 1
    count = len(origins)
    sense = np.array([1.0, 1.0, -1.0])
    rays = np.zeros((8, count), np.float32)
    rays[:3], rays[3:6] = ((origins - (0, 0, lens.length)) * sense).T, (directions * sense).T
    records = lens_records(lens, LINE_D_NM, "film", 0.0)
    facts = records.facts | {"VW": lanes, "DOUBLE": 0, "LENS_KEEP_FAILED": 0}
    program = session.program(["pass/trace_rays.cl"], facts, device_declarations())
    memory, surfaces, stop = (
        session.allocate(rays.nbytes),
        session.upload(records.surfaces),
        session.upload(records.stop),
    )
    number = np.int32(len(lens.surfaces))
    launch = session.bind(
        program, "trace_rays", surfaces=surfaces, count=number, stop=stop, rays=memory, capacity=np.uint32(count)
    )

    def refill() -> None:
        session.write(memory, rays)
        session.finish()

    def work() -> None:
        launch.enqueue(count // (PACKETS * lanes), GROUP)
        session.finish()

    refill()
    work()  # compiles
    return fastest(work, runs, refill)


def passing_rays(lens: TraceableLens, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rays from the scene that pass, (count, 3) points before the first vertex and directions."""
    random = np.random.default_rng(2)
    points = np.full((8 * count, 3), -BEFORE_MM)
    points[:, :2] = random.uniform(-1, 1, (8 * count, 2)) * lens.surfaces[0].semi_diameter
    directions = np.column_stack([random.uniform(-0.2, 0.2, (8 * count, 2)), np.ones(8 * count)])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    good = np.flatnonzero(lens.trace(points, directions, LINE_D_NM, "scene").passed)[:count]
    return points[good], directions[good]


def other_times(python: str, program: str, lens: TraceableLens, count: int, copies: int, runs: int) -> dict[str, float]:
    """Return the times of another program for ``count * copies`` rays.

    Raises
    ------
    WorkerError
        When the program is not there, or finds other points than the reference.
    """
    points, directions = passing_rays(lens, count)
    indices = lens.indices(LINE_D_NM)[1:]
    rows = [
        {"radius": s.radius if s.curvature else None, "thickness": s.thickness, "index": float(n), "stop": s.is_stop}
        for s, n in zip(lens.surfaces, indices, strict=True)
    ]
    worker = Worker(python, "benchmarks.optics_worker", program)
    try:
        worker.ask(do="load", rows=rows)
        rays: dict[str, Any] = {"points": points.tolist(), "directions": directions.tolist(), "copies": copies}
        answers = [worker.ask(do="trace", **rays) for _ in range(runs + 1)][1:]  # the first one compiles
    finally:
        worker.close()
    there = lens.trace(points, directions, LINE_D_NM, "scene").origins[:, :2]
    if np.abs(np.array(answers[0]["at"]) - there).max() > SAME_MM:
        raise WorkerError("finds other points than the reference")
    return {clock: min(answer[clock] for answer in answers) for clock in ("wall", "cpu")}


def measure_others(python: str, quick: bool) -> dict[str, dict[str, float]]:
    """Return millions of rays per second of the programs that can be run; why the others cannot is printed."""
    lens, found = load_lens(LENS), {}
    for program, thousands in OTHERS.items():
        count, copies, runs = (10, 1, 1) if quick else (1000, thousands, 3)
        try:
            times = other_times(python, program, lens, count, copies, runs)
        except WorkerError as error:
            print(f"{program} is left out: {error}", file=sys.stderr)
            continue
        rays = count * copies
        rate = {clock: rays / seconds / 1e6 for clock, seconds in times.items()}
        found[program] = {"wall": rate["wall"], "cpu": cores() * rate["cpu"], "ns": times["cpu"] / rays * 1e9}
    return found


def measure(session: Session, count: int, runs: int) -> dict[str, dict[str, float]]:
    """Return millions of rays per second of every tracer."""
    lens = load_lens(LENS)
    origins, directions = film_rays(lens, count)
    few = max(count // 16, GROUP)  # numpy is slow enough

    def called(precision: Literal["single", "double"]) -> Times:
        def work() -> None:
            lens.trace(origins, directions, device=session, precision=precision)

        work()  # compiles
        return fastest(work, runs)

    found = {
        "numpy, float64": (few, fastest(lambda: lens.trace(origins[:few], directions[:few]), runs)),
        "trace(device), float32": (count, called("single")),
        "kernel, float32": (count, kernel_times(session, lens, origins, directions, 5 * runs)),
    }
    if session.info.fp64:
        found["trace(device), float64"] = (count, called("double"))
    return {
        name: {"wall": rays / times.wall / 1e6, "cpu": cores() * rays / times.cpu / 1e6, "ns": times.cpu / rays * 1e9}
        for name, (rays, times) in found.items()
    }


def main() -> None:
    """Measure every tracer and the peak, and print the table."""
    parser = arguments("Rays per second through the double Gauss.")
    parser.add_argument("--rays", type=int, default=1 << 20, help="rays per run (default 1048576)")
    parser.add_argument(
        "--optics-python", default=sys.executable, metavar="PATH", help="the Python that has optiland and ray-optics"
    )
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    count = 4096 if options.quick else -(-options.rays // 4096) * 4096
    found = measure(session, count, 1 if options.quick else 3)
    found |= measure_others(options.optics_python, options.quick)
    peak = peak_flops(session, 0.01 if options.quick else 0.5)
    print_machine(facts)
    base = found["numpy, float64"]["ns"]
    lines = [
        [name, f"{x['wall']:.2f}", f"{x['cpu']:.2f}", f"{x['ns']:.1f}", f"{base / x['ns']:.1f}"]
        for name, x in found.items()
    ]
    print_table(f"{LENS}, {count} rays, {cores()} cores", COLUMNS, lines)
    operations = OPERATIONS_PER_SURFACE * len(load_lens(LENS).surfaces)
    rate = found["kernel, float32"]["cpu" if session.info.type == "cpu" else "wall"] * 1e6
    share = rate * operations / peak
    print(f"Peak of multiply-adds (two operations each): {peak / 1e9:.0f} GFLOP/s.")
    print(f"The kernel, at about {operations} operations a ray, reaches {100 * share:.0f} % of it.")
    write_json(options.json, facts, {"tracers": found, "peak_flops": peak, "operations_per_ray": operations})


if __name__ == "__main__":
    main()
