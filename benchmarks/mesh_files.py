"""CPU time and memory of reading PLY and STL files, ours beside trimesh, and what both do with damaged files.

    python -m benchmarks.mesh_files [--json FILE] [--quick]

Each reading is a process of its own. Damaged files are those of the tests of our readers. What trimesh finds in them
goes through our checks of vertices, corners and normals too: a file is `refused` in one line that names it, ends in
an exception of another kind, or is `read` when triangles come out of it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.scene.assets.mesh import Draft, MeshSurface, Polygons, as_triangles, make_contents
from rptcam_cl.scene.meshes import read_mesh_file
from rptcam_cl.studies.selfcheck_suite import torus_knot

ROOT = Path(__file__).resolve().parents[1]
SIZES = {"small": (128, 32), "300k": (2432, 62), "5M": (9728, 257)}  # 8,192, 301,568 and 5,000,192 triangles
LIBRARIES = ("rptcam", "trimesh")
CHUNK = 1 << 16


def write_files(folder: Path, size: str) -> None:
    """Write one mesh in every format to a folder, as ``NAME.ply``; text files in folders of their own."""
    points, faces = (rows.astype(kind) for rows, kind in zip(torus_knot(*SIZES[size]), ("<f4", "<i4"), strict=True))
    head = (
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    with (folder / "binary" / f"{size}.ply").open("wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\n{head}".encode() + points.tobytes() + rows.tobytes())
    with (folder / "text" / f"{size}.ply").open("w") as text:
        text.write(f"ply\nformat ascii 1.0\n{head}")
        _write_lines(text, "%.7g %.7g %.7g\n", points)
        _write_lines(text, "3 %d %d %d\n", faces)
    facets = np.zeros(len(faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = points[faces]
    with (folder / "binary" / f"{size}.stl").open("wb") as file:
        file.write(bytes(80) + np.uint32(len(faces)).tobytes() + facets.tobytes())
    with (folder / "text" / f"{size}.stl").open("w") as text:
        text.write("solid knot\n")
        form = "facet normal 0 0 0\nouter loop\n" + 3 * "vertex %.7g %.7g %.7g\n" + "endloop\nendfacet\n"
        _write_lines(text, form, facets["corners"].reshape(-1, 9))
        text.write("endsolid knot\n")


def _write_lines(text: Any, form: str, rows: Any) -> None:
    for start in range(0, len(rows), CHUNK):
        part = rows[start : start + CHUNK]
        text.write(form * len(part) % tuple(part.ravel().tolist()))


def reading(library: str, path: Path) -> dict[str, float] | str:
    """Return CPU time [s] and peak memory [GB] of reading a file, or how it failed."""
    command = [sys.executable, "-m", "benchmarks.mesh_reader", library, str(path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        return done.stderr.strip().rpartition("\n")[2].partition(":")[0] or f"signal {-done.returncode}"
    cpu, peak, _ = (float(word) for word in done.stdout.split())
    return {"cpu": cpu, "gigabytes": peak / 1e9}


def _cells(found: dict[str, float] | str) -> list[str]:
    return [f"{found['cpu']:.2f}", f"{found['gigabytes']:.2f}"] if isinstance(found, dict) else [found, ""]


def damaged(folder: Path) -> dict[str, Counter[str]]:
    """Return what becomes of each damaged file of the tests, by format and library."""
    from tests.scene.assets import test_bad_ply, test_bad_stl

    found: dict[str, Counter[str]] = {}
    for form, rows in (("PLY", test_bad_ply.FILES), ("STL", test_bad_stl.FILES)):
        for _, name, content, _ in rows:
            path = folder / name
            if path.suffix[1:].upper() != form:
                continue
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
            for library in LIBRARIES:
                found.setdefault(f"{form}, {library}", Counter())[_outcome(library, path)] += 1
    return found


def _outcome(library: str, path: Path) -> str:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if library == "rptcam":
                read_mesh_file(path, Path)
            else:
                mesh = trimesh.load_mesh(path, process=False)
                corners = Polygons(np.arange(len(mesh.faces)), np.asarray(mesh.faces))
                triangles = as_triangles(np.asarray(mesh.vertices), [corners], f"{path}: face")
                make_contents(Draft([MeshSurface(np.asarray(mesh.vertices), triangles)]), str(path))
    except InputError:
        return "refused"
    except Exception as problem:
        return "refused" if str(path) in str(problem) else "other"
    return "read"


def main() -> None:
    """Measure and print the tables."""
    options = arguments("Reading mesh files.").parse_args()
    facts = machine(choose_device(options.device))
    print_machine(facts)
    sizes = ["small"] if options.quick else list(SIZES)
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in ("binary", "text"):
            (folder / kind).mkdir()
        for size in sizes:
            write_files(folder, size)
        for size in sizes[1:] or sizes:
            for form, kind in (("PLY", "binary"), ("PLY", "text"), ("STL", "binary"), ("STL", "text")):
                path = folder / kind / f"{size}.{form.lower()}"
                results[f"{kind} {form}, {size}"] = {library: reading(library, path) for library in LIBRARIES}
        outcomes = damaged(folder)
    print_table(
        f"Reading mesh files, trimesh {trimesh.__version__}",
        ("file", "ours: CPU, s", "peak, GB", "trimesh: CPU, s", "peak, GB"),
        [
            [name, *(cell for library in LIBRARIES for cell in _cells(found[library]))]
            for name, found in results.items()
        ],
    )
    columns = ("refused", "other", "read")
    print_table(
        "Damaged files",
        ("reader", "one line", "other exception", "read as if whole"),
        [[name, *(str(counts[column]) for column in columns)] for name, counts in outcomes.items()],
    )
    write_json(options.json, facts, {"reading": results, "damaged": outcomes})


if __name__ == "__main__":
    main()
