"""Meshes of pbrt that lie in PLY files of their own."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files import read_mesh_file
from rptcam_cl.pbrt.context import Context
from rptcam_cl.pbrt.mesh import MeshData
from rptcam_cl.pbrt.source import Place, read_limited
from rptcam_cl.pbrt.state import ShapeUse

LARGEST_FILE = 4 << 30


def ply_name(use: ShapeUse) -> tuple[str, Place]:
    """Return the file that a shape names, and where it does."""
    parameters = use.shape.parameters
    name = parameters.text("filename", "")
    if not name:
        raise use.shape.place.error(f'{use.shape.what} needs a parameter "string filename"')
    return name, parameters.items["filename"].place


def facing_mesh(context: Context, use: ShapeUse) -> tuple[MeshData, bool]:
    """Return the mesh of a file with its front where pbrt has it, and whether that changed the mesh."""
    name, place = ply_name(use)
    mesh = _read(context.find(name, place), place)
    facing = mesh.facing_its_normals()
    changed = not np.array_equal(facing.faces, mesh.faces)
    return (facing.reversed(), True) if use.reverse else (facing, changed)


def _read(path: Path, place: Place) -> MeshData:
    try:
        if path.suffix.lower() != ".gz":
            contents = read_mesh_file(path, lambda other: other)
        else:
            with tempfile.TemporaryDirectory() as folder:
                unpacked = Path(folder) / path.stem
                unpacked.write_bytes(read_limited(path, path.name, LARGEST_FILE))
                contents = read_mesh_file(unpacked, lambda other: other)
    except InputError as problem:
        raise place.error(str(problem)) from None
    (part,) = contents.parts
    mesh = part.mesh
    return MeshData(
        mesh.positions.astype(np.float64) + mesh.origin,
        mesh.faces.astype(np.int64),
        None if mesh.normals is None else mesh.normals.astype(np.float64),
        None if mesh.uvs is None else mesh.uvs.astype(np.float64),
    )
