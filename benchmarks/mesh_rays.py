"""Rays per second at the meshes of scene C: the device's tree walks, Embree and Mitsuba 3, in turns in one run.

    python -m benchmarks.mesh_rays [--rounds 7] [--mitsuba-python PATH] [--json FILE]

All trace the same rays against the same triangles: camera rays, diffuse bounces of what they hit, the same shuffled,
and shadow rays to the lamp. Ours are the walks that render, a pack of rays per work item, from launch to finish. Embree
runs through embreex (`pip install embreex`), ray by ray in one thread, its packing of the rays included. Mitsuba's
`ray_intersect` (for shadow rays `ray_test`) runs in the variant `llvm_ad_rgb`, from arrays to distances and triangles.
What is missing is left out. Rates by CPU time are rays per CPU second times the number of cores.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.mesh_ray_sets import Rays, ray_sets
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import reference_scene
from benchmarks.stopwatch import cores, timed
from benchmarks.worker import Worker, WorkerError
from rptcam_cl.core.records import device_declarations
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers, scene_trees
from tests.support.mesh_scene import write_ply

KERNEL = Path(__file__).with_name("ray_queries.cl")
SIZE = (1024, 576)  # camera rays
LEAST_AGREEMENT = 0.9995  # share of rays; the rest graze an edge
CLOSE = 1e-4  # relative difference of distances that are the same
Answer = NDArray[np.float64]
Clocks = dict[str, float]


class Ours:
    """The walks of the kernels."""

    name = "ours"

    def __init__(self, session: Session) -> None:
        plan = make_plan(reference_scene("C"))
        assert plan.meshes is not None
        self._session, self._buffers = session, SceneBuffers(session, plan)
        facts = plan.facts | self._buffers.tree_facts | {"VW": session.lanes}
        self._program = session.program([str(KERNEL)], facts, device_declarations())
        self._bound: dict[str, tuple[Any, Any]] = {}  # launches and what they write to
        self.trees = scene_trees(plan.meshes, session)[0]
        self.triangles = plan.meshes.triangles

    def time(self, rays: Rays) -> Clocks:
        """Return the seconds that a set takes."""
        if rays.name not in self._bound:
            out = self._session.allocate(8 * rays.count)
            held = self._session.upload(rays.rows)
            launch = self._session.bind(
                self._program, "ray_queries", **self._buffers.scene, rays=held, hits=out,
                shadow=np.int32(rays.shadow), count=np.uint32(rays.count),
            )  # fmt: skip
            self._bound[rays.name] = launch, out
        launch, _ = self._bound[rays.name]

        def work() -> None:
            launch.enqueue(rays.count // self._session.lanes, self._session.group)
            self._session.finish()

        return vars(timed(work))

    def answer(self, rays: Rays) -> Answer:
        """Return rows of distances and triangles, or of whether rays are blocked."""
        self.time(rays)
        found = self._session.read(self._bound[rays.name][1], np.float32, 2 * rays.count).reshape(2, -1)
        return found[:1].astype(np.float64) if rays.shadow else np.stack([found[0], found[1].view(np.int32)])

    def nearest(self, rays: Rays) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return distance and triangle of what rays meet first."""
        t, triangle = self.answer(rays)
        return t.astype(np.float32), triangle.astype(np.int32)


class Embree:
    """Embree through embreex."""

    name = "Embree (embreex)"

    def __init__(self, vertices: NDArray[np.float32], triangles: NDArray[np.int32]) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, vertices, triangles)

    def _run(self, rays: Rays, **how: Any) -> Any:
        origins, directions = (np.ascontiguousarray(rays.rows[part].T) for part in (slice(3), slice(3, 6)))
        if rays.shadow:
            how |= {"query": "OCCLUDED", "dists": rays.rows[6]}
        return self._scene.run(origins, directions, **how)

    def time(self, rays: Rays) -> Clocks:
        """Return the seconds that a set takes."""
        return vars(timed(lambda: self._run(rays)))

    def answer(self, rays: Rays) -> Answer:
        """Return rows of distances and triangles, or of whether rays are blocked."""
        if rays.shadow:
            return (self._run(rays)[None] >= 0).astype(np.float64)  # the mesh where blocked, else -1
        found = self._run(rays, output=1)
        return np.stack([found["tfar"], found["primID"].astype(np.int64)]).astype(np.float64)


class Mitsuba:
    """Mitsuba in a process of its own."""

    name = "Mitsuba"

    def __init__(self, python: str, vertices: NDArray[np.float32], triangles: NDArray[np.int32], folder: Path) -> None:
        self.worker = Worker(python, "benchmarks.mitsuba_rays")
        write_ply(folder / "meshes.ply", vertices.astype(np.float64), triangles.astype(np.int64))
        self.worker.ask(do="load", mesh=str(folder / "meshes.ply"))
        self._folder = folder

    def _ask(self, rays: Rays, **more: Any) -> dict[str, Any]:
        path = self._folder / f"{rays.name}.npy"
        if not path.exists():
            np.save(path, rays.rows)
        return self.worker.ask(do="trace", rays=str(path), shadow=rays.shadow, **more)

    def time(self, rays: Rays) -> Clocks:
        """Return the seconds that a set takes."""
        return self._ask(rays)

    def answer(self, rays: Rays) -> Answer:
        """Return rows of distances and triangles, or of whether rays are blocked."""
        path = self._folder / "answer.npy"
        self._ask(rays, save=str(path))
        return np.asarray(np.load(path), np.float64)


def agreement(ours: Answer, other: Answer) -> float:
    """Return the share of rays whose answers agree: blocked alike, or met at the same distance, or nothing met."""
    if len(ours) == 1:
        return float((ours == other).mean())
    met, other_met = ours[1] >= 0, other[1] >= 0
    with np.errstate(invalid="ignore"):
        near = np.abs(ours[0] - other[0]) <= CLOSE * ours[0]
    return float(np.where(met & other_met, near, met == other_met).mean())


def measure(tracers: list[Any], sets: list[Rays], rounds: int) -> list[dict[str, Any]]:
    """Return rates of all sets and tracers, taken in turns, and how far the answers agree with those of the first."""
    found = []
    for rays in sets:
        answers = [tracer.answer(rays) for tracer in tracers]
        seen: dict[str, list[Clocks]] = {tracer.name: [] for tracer in tracers}
        for _ in range(rounds):
            for tracer in tracers:
                seen[tracer.name].append(tracer.time(rays))
        found.append({
            "rays": rays.name,
            "count": rays.count,
            "hit": float((answers[0][-1] > 0).mean() if rays.shadow else (answers[0][1] >= 0).mean()),
            "agreement": {
                tracer.name: agreement(answers[0], answer) for tracer, answer in zip(tracers, answers, strict=True)
            },
            "mrays_per_second": {
                name: {
                    "wall": [rays.count / time["wall"] / 1e6 for time in times],
                    "cpu": [cores() * rays.count / time["cpu"] / 1e6 for time in times],
                }
                for name, times in seen.items()
            },
        })  # fmt: skip
    return found


def table_rows(found: list[dict[str, Any]], clocks: tuple[str, ...]) -> list[list[str]]:
    """Return a row per set and clock: best rates, and the median of the paired ratios."""
    rows = []
    for each in found:
        rates = each["mrays_per_second"]
        for clock in clocks:
            row = [each["rays"], f"{100 * each['hit']:.0f} %", clock]
            row += [f"{max(rate[clock]):.2f}" for rate in rates.values()]
            for other in list(rates)[1:]:
                pairs = zip(rates["ours"][clock], rates[other][clock], strict=True)
                row.append(f"{statistics.median(a / b for a, b in pairs):.2f}")
            rows.append([*row, f"{100 * min(each['agreement'].values()):.3f} %"])
    return rows


def other_tracers(options: argparse.Namespace, ours: Ours, folder: Path) -> list[Any]:
    """Return the tracers that are installed, and say which are not."""
    mesh = np.ascontiguousarray(ours.trees["vertices"][:, :3]), np.ascontiguousarray(ours.triangles[:, :3])
    makers: dict[str, Callable[[], Any]] = {
        "Embree": lambda: Embree(*mesh),
        "Mitsuba": lambda: Mitsuba(options.mitsuba_python, *mesh, folder),
    }
    found = []
    for name, make in makers.items():
        try:
            found.append(make())
        except (ImportError, WorkerError) as error:
            print(f"mesh_rays: without {name}: {error}", file=sys.stderr)
    return found


def main() -> int:
    """Run the comparison; the exit code is 1 when answers disagree."""
    parser = arguments("Rays per second at meshes.")
    parser.add_argument("--rounds", type=int, default=7, help="runs of each tracer per set (default 7)")
    parser.add_argument("--mitsuba-python", default=sys.executable, help="interpreter that can import mitsuba")
    options = parser.parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    ours = Ours(session)
    size, rounds = ((64, 36), 2) if options.quick else (SIZE, options.rounds)
    sets = ray_sets(reference_scene("C"), size, ours.trees["vertices"], ours.triangles, ours.nearest)
    with tempfile.TemporaryDirectory() as folder:
        others = other_tracers(options, ours, Path(folder))
        found = measure([ours, *others], sets, rounds)
        for other in others:
            if isinstance(other, Mitsuba):
                other.worker.close()
    names = [other.name for other in others]
    print_machine(facts | {"load_average_after": machine(session.info)["load_average"]})
    columns = ("rays", "hit", "clock", "ours", *names, *(f"ours over {name}" for name in names), "answers agree")
    clocks = ("wall", "cpu") if session.info.type == "cpu" else ("wall",)
    title = f"Millions of rays per second, best of {rounds}, at {len(ours.triangles):,} triangles; {cores()} cores"
    print_table(title, columns, table_rows(found, clocks))
    write_json(options.json, facts, found)
    return 1 if min(min(each["agreement"].values()) for each in found) < LEAST_AGREEMENT else 0


if __name__ == "__main__":
    raise SystemExit(main())
