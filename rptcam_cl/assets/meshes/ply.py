"""PLY files, text or binary: positions, normals, texture coordinates and faces."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.contents import Draft, open_mesh
from rptcam_cl.assets.meshes.faces import Polygons, as_triangles, check_corners, weld
from rptcam_cl.assets.meshes.mesh import MeshSurface
from rptcam_cl.assets.meshes.ply_header import Element, Header, read_header
from rptcam_cl.assets.meshes.ply_rows import Rows, TextRows, read_binary
from rptcam_cl.core.errors import InputError

INDEX_NAMES = ("vertex_indices", "vertex_index")
UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
CORNER_UVS = "texcoord"

Columns = NDArray[Any]


def read_ply(path: Path) -> Draft:
    """Return the surface of a PLY file.

    Raises
    ------
    InputError
        When it is not PLY, holds less than it claims or nothing that can be shown.
    """
    with open_mesh(path) as file:
        header = read_header(file, path)
        _check_size(header, path.stat().st_size - file.tell(), path)
        rows = {element.name: element for element in header.elements}
        if "vertex" not in rows or "face" not in rows:
            missing = "faces" if "vertex" in rows else "vertices"
            raise InputError(f"{path}: has no {missing} (allowed: elements vertex and face)")
        read = _reader(file, header, path)
        found = {element.name: read(element) for element in header.elements}
    notes = [
        f"{path}: colours of each {name} are left out" for name in ("vertex", "face") if "red" in found[name].values
    ]
    return Draft([_surface(found["vertex"], found["face"], path)], notes=notes)


def _check_size(header: Header, size: int, path: Path) -> None:
    """Refuse a header that claims more than the file can hold, before anything is allocated."""
    least = sum(element.count * element.smallest_row(not header.order) for element in header.elements)
    if least - (not header.order) > size:
        claims = ", ".join(f"{element.count} of {element.name}" for element in header.elements)
        raise InputError(
            f"{path}: is cut short: {claims} take at least {least} bytes (got {max(size, 0)} after the header)"
        )


def _reader(file: BinaryIO, header: Header, path: Path) -> Callable[[Element], Rows]:
    """Return what reads the rows of the next element."""
    if header.order:
        return lambda element: read_binary(file, element, path)
    return TextRows(file, path, header.lines).read


def _surface(vertex: Rows, face: Rows, path: Path) -> MeshSurface:
    positions = _columns(vertex, ("x", "y", "z"))
    if positions is None:
        raise InputError(f"{path}: its vertices have no position (allowed: properties x, y, z)")
    index = next((name for name in INDEX_NAMES if name in face.lists), None)
    if index is None:
        raise InputError(f"{path}: its faces have no list of vertices (allowed: a property list vertex_indices)")
    normals = _columns(vertex, ("nx", "ny", "nz"))
    uvs = next((found for names in UV_NAMES if (found := _columns(vertex, names)) is not None), None)
    polygons = [Polygons(numbers, corners) for numbers, corners in face.lists[index]]
    if not sum(len(corners) for _, corners in polygons):
        raise InputError(f"{path}: has no faces")
    for group in polygons:
        check_corners(group, len(positions), f"{path}: face")
    if uvs is None and CORNER_UVS in face.lists and (corner_uvs := _corner_uvs(polygons, face)) is not None:
        vertices, uvs, polygons = weld(polygons, corner_uvs)
        positions = positions[vertices]
        normals = None if normals is None else normals[vertices]
    return MeshSurface(positions, as_triangles(positions, polygons, f"{path}: face"), normals, uvs)


def _columns(rows: Rows, names: tuple[str, ...]) -> Columns | None:
    """Return values (n, len(names)) in float32, or float64 when the file has that."""
    if not all(name in rows.values for name in names):
        return None
    wide = any(rows.values[name].dtype.itemsize > 4 for name in names)
    result = np.empty((len(rows.values[names[0]]), len(names)), np.float64 if wide else np.float32)
    for place, name in enumerate(names):
        result[:, place] = rows.values[name]
    return result


def _corner_uvs(polygons: list[Polygons], face: Rows) -> list[Columns] | None:
    """Return texture coordinates of the corners (m, k, 2) of each group of polygons, None when they do not fit."""
    groups = {len(uvs[0]) // 2: (numbers, uvs) for numbers, uvs in face.lists[CORNER_UVS] if len(uvs)}
    found = []
    for numbers, corners in polygons:
        if not len(corners):
            found.append(np.empty((0, corners.shape[1], 2), np.float32))
            continue
        same, uvs = groups.get(corners.shape[1], (None, None))
        if uvs is None or same is None or not np.array_equal(same, numbers):
            return None
        found.append(uvs.reshape(len(uvs), -1, 2))
    return found
