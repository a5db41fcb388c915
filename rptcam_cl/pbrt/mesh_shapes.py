"""Meshes that stand in a pbrt file itself: triangles, bilinear patches, control meshes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.pbrt.context import Context
from rptcam_cl.pbrt.mesh import MeshData
from rptcam_cl.pbrt.parameters import Parameters
from rptcam_cl.pbrt.state import Entity

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Cells along each side of a bilinear patch that is not flat.
PATCH_CELLS = 8


def triangle_mesh(context: Context, shape: Entity) -> tuple[MeshData, int]:
    """Return a triangle mesh, and its number of triangles; those without area are left out."""
    parameters = shape.parameters
    vertices = _points(shape)
    corners = _indices(shape, len(vertices), 3)
    normals = parameters.rows("N", 3, "normal", "normal3", "float")
    uvs = _uvs(parameters)
    parameters.skip("faceIndices")
    for name, values in (("N", normals), ("uv", uvs)):
        if values is not None and len(values) != len(vertices):
            raise shape.place.error(f"{shape.what}: {name} has {len(values)} entries, P has {len(vertices)}")
    return _clean(context, shape, MeshData(vertices, corners, normals, uvs)), len(corners)


def control_mesh(context: Context, shape: Entity) -> tuple[MeshData, int]:
    """Return the control mesh of a subdivision surface, with normals that smooth it."""
    levels = shape.parameters.integer("levels", 3) if shape.parameters.has("levels") else (
        shape.parameters.integer("nlevels", 3))  # fmt: skip
    shape.parameters.skip("scheme")
    vertices = _points(shape)
    mesh = _clean(context, shape, MeshData(vertices, _indices(shape, len(vertices), 3)))
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, mesh.faces[:, k], mesh.crosses())
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    context.report.approximated(
        shape.place, f"{shape.what}: its control mesh with smooth normals, not subdivided {levels} times"
    )
    return MeshData(vertices, mesh.faces, normals / np.where(lengths > 0, lengths, 1)), len(mesh.faces)


def bilinear_patches(context: Context, shape: Entity) -> tuple[MeshData, int]:
    """Return bilinear patches as triangles, and the number of patches; flat parallelograms are exact."""
    vertices = _points(shape)
    quads = _indices(shape, len(vertices), 4)
    parameters = shape.parameters
    uvs, normals = _uvs(parameters), parameters.rows("N", 3, "normal", "normal3", "float")
    parameters.skip("faceIndices")
    if len(quads) == 1 and uvs is None:
        uvs = np.zeros((len(vertices), 2))
        uvs[quads[0]] = [[0, 0], [1, 0], [0, 1], [1, 1]]
    if _are_parallelograms(vertices, quads):
        p00, p10, p01, p11 = quads.T
        faces = np.concatenate([np.stack([p00, p10, p11], axis=1), np.stack([p00, p11, p01], axis=1)])
        return _clean(context, shape, MeshData(vertices, faces, normals, uvs)), len(quads)
    context.report.approximated(
        shape.place, f"{shape.what}: each patch as {PATCH_CELLS} x {PATCH_CELLS} cells of two triangles"
    )
    return _clean(context, shape, _tessellated(vertices, quads, normals, uvs)), len(quads)


def _tessellated(vertices: Array, quads: Indices, normals: Array | None, uvs: Array | None) -> MeshData:
    """Return patches cut into cells, each patch with vertices of its own."""
    cells = PATCH_CELLS
    t = np.linspace(0, 1, cells + 1)
    v, u = (axis.reshape(-1) for axis in np.meshgrid(t, t, indexing="ij"))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])  # of p00, p10, p01, p11

    def spread(values: Array) -> Array:
        return np.asarray(np.einsum("kn,pkc->pnc", weights, values[quads]).reshape(-1, values.shape[1]))

    k, n = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    corner = (k * (cells + 1) + n).reshape(-1)
    right, up, far = corner + 1, corner + cells + 1, corner + cells + 2
    one = np.concatenate([np.stack([corner, right, far], axis=1), np.stack([corner, far, up], axis=1)])
    faces = (one[None] + (np.arange(len(quads)) * len(u))[:, None, None]).reshape(-1, 3)
    new_uvs = np.tile(np.stack([u, v], axis=1), (len(quads), 1)) if uvs is None else spread(uvs)
    return MeshData(spread(vertices), faces, None if normals is None else spread(normals), new_uvs)


def _are_parallelograms(vertices: Array, quads: Indices) -> bool:
    p00, p10, p01, p11 = (vertices[quads[:, k]] for k in range(4))
    size = np.abs(p11 - p00).max() + np.abs(p10 - p01).max()
    return bool(np.abs(p00 + p11 - p10 - p01).max() <= 1e-6 * size)


def _points(shape: Entity) -> Array:
    points = shape.parameters.rows("P", 3, "point", "point3")
    if points is None or not len(points):
        raise shape.place.error(f'{shape.what} needs vertices, "point3 P" [x y z …]')
    return points


def _uvs(parameters: Parameters) -> Array | None:
    for name in ("uv", "st"):
        if parameters.has(name):
            return parameters.rows(name, 2, "point2", "vector2", "float")
    return None


def _indices(shape: Entity, count: int, corners: int) -> Indices:
    """Return the corners of the faces, (n, corners); those of a single face may be left out."""
    parameters = shape.parameters
    values = parameters.numbers("indices", "integer")
    if values is None:
        if count != corners:
            raise shape.place.error(f'{shape.what} needs "integer indices" for more than {corners} vertices')
        return np.arange(corners)[None]
    item = parameters.items["indices"]
    if len(values) % corners:
        raise item.place.error(f"{shape.what}: indices hold {len(values)} numbers, not a multiple of {corners}")
    whole = values.astype(np.int64)
    if np.any(whole != values) or (len(values) and (whole.min() < 0 or whole.max() >= count)):
        raise item.place.error(f"{shape.what}: indices must be whole numbers from 0 to {count - 1}")
    return whole.reshape(-1, corners)


def _clean(context: Context, shape: Entity, mesh: MeshData) -> MeshData:
    """Return a mesh without faces that have no area."""
    areas = mesh.areas()
    kept = areas > 0
    if (count := int((~kept).sum())) and kept.any():
        context.report.ignored(shape.place, f"{shape.what}: {count} triangles without area")
    return MeshData(mesh.vertices, mesh.faces[kept], mesh.normals, mesh.uvs)
