"""The two meshes of the reference scene C, made by formula: a torus knot and a bumpy ball, 303,104 triangles in all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.studies.selfcheck_suite import bumpy_ball, torus_knot


def write_ply(path: Path, points: NDArray[np.float64], faces: NDArray[np.int64]) -> None:
    """Write a binary PLY file."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = np.zeros(len(faces), np.dtype([("count", "u1"), ("corner", "<i4", 3)]))
    rows["count"], rows["corner"] = 3, faces
    path.write_bytes(header.encode() + np.ascontiguousarray(points, "<f4").tobytes() + rows.tobytes())


def write_meshes(folder: Path) -> Path:
    """Write knot.ply and ball.ply, where they are not there yet; return the folder."""
    for name, make in (("knot.ply", torus_knot), ("ball.ply", bumpy_ball)):
        if not (folder / name).exists():
            write_ply(folder / name, *make())
    return folder
