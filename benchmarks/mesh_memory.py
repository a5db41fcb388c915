"""Memory of meshes: bytes per triangle and per path in flight, and the most that five million triangles take to render.

    python -m benchmarks.mesh_memory [--json FILE]

The render is a process of its own that reads a binary PLY file, once with an empty cache of trees, so that it builds
its tree, and once more with the tree kept. ``peak`` is the most memory that the process held at once, Python, OpenCL
and the compiler included. It needs an operating system that tells (Linux, macOS).
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

from benchmarks.bvh_build import large_mesh
from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.scenes import reference_scene
from rptcam_cl.core.records import floats_per_slot
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.rendering.film import WAVE_SLOTS
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import scene_trees
from rptcam_cl.rendering.tracer import ORGANISATION
from tests.support.mesh_scene import write_ply

ROOT = Path(__file__).resolve().parents[1]
GOAL_GB = 2.0
SCENE = """film: {resolution: [640, 360]}
camera: {kind: pinhole, eye: [-1, -6, 3], target: [-1, 0, 1.4], up: [0, 0, 1], fov_degrees: 40}
render: {max_depth: 6}
materials: {floor: {kind: matte, reflectance: 0.5}}
objects:
  - {shape: rectangle, corner: [-9, -9, 0], edge_u: [18, 0, 0], edge_v: [0, 18, 0], material: floor}
  - {shape: mesh, file: knot.ply, material: {kind: matte, reflectance: [0.9, 0.75, 0.45]}}
environment: {kind: constant, radiance: 0.8}
"""


def bytes_per_triangle(session: Session) -> dict[str, float]:
    """Return what the meshes of scene C take on the device, per triangle."""
    meshes = make_plan(reference_scene("C")).meshes
    assert meshes is not None
    trees = scene_trees(meshes, session)[0]
    count = len(meshes.triangles)
    found = {
        "nodes": trees["nodes"].nbytes / count,
        "blocks": trees["blocks"].nbytes / count,
        "triangles": meshes.triangles.nbytes / count,
        "vertices": trees["vertices"].nbytes / count,
    }
    return found | {"all": sum(found.values())}


def bytes_per_path(device_type: str) -> dict[str, dict[str, float]]:
    """Return the bytes of a slot of the wave, and megabytes of the default wave, by organisation and scene."""
    found = {}
    for name, stream, emitters, meshes in (
        ("stream, behind a lens", True, True, True),
        ("passes, no lamps", False, False, False),
        ("passes, lamps", False, True, False),
        ("passes, lamps and meshes", False, True, True),
    ):
        facts = defaultdict(int, HAS_EMITTERS=int(emitters), HAS_MESH=int(meshes))
        size = 4 * floats_per_slot(facts, stream=stream)
        found[name] = {"bytes": size, "megabytes": size * WAVE_SLOTS[device_type] / 1e6}
    return found


def peak(folder: Path, device: str, spp: int) -> dict[str, float]:
    """Render the large mesh in a process of its own; return its greatest memory [GB] and its seconds."""
    command = [sys.executable, "-m", "benchmarks.peak_of", "render", str(folder / "scene.yaml"), "--spp", str(spp)]
    command += ["--device", device, "--quiet", "-o", str(folder / "picture.npy"), "--stats", str(folder / "stats.json")]
    environment = os.environ | {"RPTCAM_CACHE_DIR": str(folder / "trees")}
    done = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
    peak_bytes, wall, cpu = (float(word) for word in done.stdout.split()[-3:])
    return {"gigabytes": peak_bytes / 1e9, "wall": wall, "cpu": cpu}


def main() -> None:
    """Measure and print the tables."""
    options = arguments("Memory of meshes.").parse_args()
    session = Session(choose_device(options.device))
    facts = machine(session.info)
    each, paths = bytes_per_triangle(session), bytes_per_path(session.info.type)
    mesh = large_mesh(16 if options.quick else 1)
    runs: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.yaml").write_text(SCENE, "utf-8")
        write_ply(folder / "knot.ply", mesh[0].astype(float), mesh[1].astype(int))
        for tree in ("built", "kept"):
            runs[tree] = peak(folder, session.info.id, 1)
    print_machine(facts)
    print_table(
        "Bytes per triangle on the device, scene C",
        list(each),
        [[f"{value:.1f}" for value in each.values()]],
    )
    print_table(
        f"Bytes per path in flight; this device is given {ORGANISATION[session.info.type]}",
        ("organisation", "bytes", f"MB for {WAVE_SLOTS[session.info.type]} slots"),
        [[name, f"{path['bytes']:.0f}", f"{path['megabytes']:.1f}"] for name, path in paths.items()],
    )
    print_table(
        f"Rendering {len(mesh[1]):,} triangles, from the file to the picture",
        ("tree", "peak, GB", "goal, GB", "met", "wall, s", "CPU, s"),
        [
            [
                tree, f"{run['gigabytes']:.2f}", f"{GOAL_GB:g}", "yes" if run["gigabytes"] < GOAL_GB else "no",
                f"{run['wall']:.1f}", f"{run['cpu']:.1f}",
            ]
            for tree, run in runs.items()
        ],
    )  # fmt: skip
    write_json(options.json, facts, {"bytes_per_triangle": each, "paths": paths, "large": runs})


if __name__ == "__main__":
    main()
