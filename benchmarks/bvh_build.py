"""Seconds that building trees takes, by stage, how good they are and what they weigh; beside Embree on the same meshes.

    python -m benchmarks.bvh_build [--json FILE]

The meshes are the two of reference scene C together and a knot of five million triangles. Embree builds through embreex
(`pip install embreex`); its row counts the commit alone, without the copy of the triangles before it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.stopwatch import Times, fastest, timed
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.scene_buffers import WIDTH
from rptcam_cl.rendering.tree_build import binary_tree, build_bvh, max_binary_depth, reinsert, sort_into_leaves, widen
from rptcam_cl.studies.selfcheck_suite import bumpy_ball, torus_knot
from tests.rendering.trees.trees import quality

Triangles = tuple[NDArray[np.float32], NDArray[np.int32]]
STAGES = ("sort into leaves", "binary tree", "move nodes", "wide nodes")


def both_meshes(divisor: int) -> Triangles:
    """Return points and faces of the meshes of scene C; with a divisor, of coarser ones."""
    (p, f), (q, g) = torus_knot(2048 // divisor, 54 // divisor), bumpy_ball(6 if divisor == 1 else 2)
    return np.concatenate([p, q]).astype(np.float32), np.concatenate([f, g + len(p)]).astype(np.int32)


def large_mesh(divisor: int) -> Triangles:
    """Return points and faces of a finer knot."""
    points, faces = torus_knot(9728 // divisor, 257 // divisor)
    return points.astype(np.float32), faces.astype(np.int32)


def boxes(mesh: Triangles) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the corners of the triangles' boxes."""
    a, b, c = (mesh[0][mesh[1][:, corner]] for corner in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def stage_times(
    lower: NDArray[np.float32], upper: NDArray[np.float32], width: int, session: Session
) -> dict[str, Times]:
    """Return the times of the stages of one build."""
    depth = max_binary_depth(width)
    kept: list[Any] = []

    def stage(work: Callable[[], Any]) -> Times:
        return timed(lambda: kept.append(work()))

    return {
        STAGES[0]: stage(lambda: sort_into_leaves(lower, upper, width, depth, session)),
        STAGES[1]: stage(lambda: binary_tree(kept[0][2], kept[0][1])),
        STAGES[2]: stage(lambda: reinsert(kept[1], depth, session)),
        STAGES[3]: stage(lambda: widen(kept[2], kept[0][0], width)),
    }


def extra_megabytes(work: Callable[[], Any]) -> float | None:
    """Return by how much the memory of the process grew at most during a call [MB], or None where nobody tells."""
    pages = Path("/proc/self/statm")
    if not pages.exists():
        return None

    def held() -> float:
        return int(pages.read_text("ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    before = most = held()
    with ThreadPoolExecutor(1) as pool:
        call = pool.submit(work)
        while not call.done():
            most = max(most, held())
            time.sleep(0.001)
        call.result()
    return most - before


def embree_times(mesh: Triangles, runs: int) -> Times | None:
    """Return the times of Embree's build, or None without embreex."""
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        return None
    ray = np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32)
    kept: list[Any] = []

    def fill() -> None:
        kept[:] = [EmbreeScene()]
        kept.append(TriangleMesh(kept[0], *mesh))

    return fastest(lambda: kept[0].run(*ray), runs, fill)  # the first ray commits the scene


def measure(mesh: Triangles, width: int, session: Session, runs: int) -> dict[str, Any]:
    """Return times, quality and memory of a mesh's tree."""
    lower, upper = boxes(mesh)
    build_bvh(lower[:100], upper[:100], width=width, leaf_size=width, session=session)  # compiles
    tree = build_bvh(lower, upper, width=width, leaf_size=width, session=session)
    extra = extra_megabytes(lambda: build_bvh(lower, upper, width=width, leaf_size=width, session=session))
    seen = [stage_times(lower, upper, width, session) for _ in range(runs)]
    times = {
        name: Times(min(each[name].wall for each in seen), min(each[name].cpu for each in seen)) for name in STAGES
    }
    times["all"] = Times(sum(each.wall for each in times.values()), sum(each.cpu for each in times.values()))
    embree = embree_times(mesh, runs)
    if embree is not None:
        times["Embree"] = embree
    count = len(lower)
    return {
        "triangles": count,
        "seconds": {name: asdict(each) for name, each in times.items()},
        "quality": asdict(quality(tree)),
        "bytes_per_triangle": tree.nbytes / count,
        "megabytes_to_build": extra,
    }


def print_results(found: list[dict[str, Any]]) -> None:
    """Print times, and the figures of the trees."""
    names = [f"{each['triangles']:,} triangles" for each in found]
    columns = ["stage", *(f"{name}, {clock}" for name in names for clock in ("wall [s]", "CPU [s]"))]
    rows = [
        [stage, *(f"{each['seconds'][stage][clock]:.3f}" for each in found for clock in ("wall", "cpu"))]
        for stage in found[0]["seconds"]
    ]
    print_table("Building a tree", columns, rows)
    figures = {name: [each["quality"][name] for each in found] for name in found[0]["quality"]}
    figures |= {name: [each[name] for each in found] for name in ("bytes_per_triangle", "megabytes_to_build")}
    print_table(
        "The trees",
        ["", *names],
        [
            [name.replace("_", " "), *("?" if value is None else f"{value:,.4g}" for value in values)]
            for name, values in figures.items()
        ],
    )


def main() -> None:
    """Build the trees of both meshes and print the tables."""
    options = arguments("Seconds that building trees takes.").parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    divisor, runs = (16, 1) if options.quick else (1, 3)
    width = WIDTH[session.info.type]
    found = [measure(make(divisor), width, session, runs) for make in (both_meshes, large_mesh)]
    print_machine(facts)
    print_results(found)
    write_json(options.json, facts, found)


if __name__ == "__main__":
    main()
