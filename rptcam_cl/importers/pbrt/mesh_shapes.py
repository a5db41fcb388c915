"""Meshes of a pbrt scene: triangles, bilinear patches, control meshes, and PLY files of their own."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes import read_mesh_file
from rptcam_cl.core.errors import InputError
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.mesh import MeshData
from rptcam_cl.importers.pbrt.parameters import Parameters
from rptcam_cl.importers.pbrt.source import Place, read_limited
from rptcam_cl.importers.pbrt.state import Entity, ShapeUse

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
    if np.any(values != np.round(values)) or (len(values) and (values.min() < 0 or values.max() >= count)):
        raise item.place.error(f"{shape.what}: indices must be whole numbers from 0 to {count - 1}")
    return values.astype(np.int64).reshape(-1, corners)


def _clean(context: Context, shape: Entity, mesh: MeshData) -> MeshData:
    """Return a mesh without faces that have no area."""
    areas = mesh.areas()
    kept = areas > 0
    if (count := int((~kept).sum())) and kept.any():
        context.report.ignored(shape.place, f"{shape.what}: {count} triangles without area")
    return MeshData(mesh.vertices, mesh.faces[kept], mesh.normals, mesh.uvs)


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
