"""Shapes of pbrt as objects of ours."""

from __future__ import annotations

import json
import math
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange import conversion
from rptcam_cl.exchange.conversion import Array, Faces, Matrix, Place
from rptcam_cl.exchange.pbrt.camera import CameraFrame
from rptcam_cl.exchange.pbrt.materials import bumps_of_mesh, convert_material, medium_keys, opacity_keys
from rptcam_cl.exchange.pbrt.source import Parameters
from rptcam_cl.exchange.pbrt.textures import lamp_radiance, number_shade
from rptcam_cl.exchange.pbrt.world import ODD, Context, Entity, Instance, ShapeUse
from rptcam_cl.scene.meshes import read_mesh_file
from rptcam_cl.scene.shapes import bezier_pieces

# Meshes of a pbrt scene: triangles, bilinear patches, control meshes, and PLY files of their own.

# Of the corners of triangles and patches in meshes without texture coordinates.
_UVS_OF_FACE, _UVS_OF_PATCH = ((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 0), (0, 1), (1, 1))
# Cells along each side of a bilinear patch that is not flat.
_PATCH_CELLS = 8


def _triangle_mesh(context: Context, shape: Entity) -> tuple[conversion.MeshData, int]:
    """Return a triangle mesh, and its number of triangles; those without area are left out."""
    parameters = shape.parameters
    vertices = _points(shape)
    corners = _indices(shape, len(vertices), 3)
    normals = parameters.rows("N", 3, "normal", "normal3", "float")
    uvs = _uvs(parameters)
    parameters.skip("faceIndices")
    for name, values in (("N", normals), ("uv", uvs)):
        if values is not None and len(values) != len(vertices):
            context.ignored(shape, f"{name}, which has {len(values)} entries where P has {len(vertices)}")
    normals, uvs = (values if values is None or len(values) == len(vertices) else None for values in (normals, uvs))
    return _clean(context, shape, conversion.MeshData(vertices, corners, normals, uvs)), len(corners)


_MOST_SUBDIVIDED = 4_000_000  # triangles


def _subdivided_mesh(context: Context, shape: Entity) -> tuple[conversion.MeshData, int]:
    """Return a subdivision surface, of vertices on the surface that the steps lead to."""
    levels = shape.parameters.integer("levels" if shape.parameters.has("levels") else "nlevels", 3)
    shape.parameters.skip("scheme")
    vertices = _points(shape)
    mesh = _clean(context, shape, conversion.MeshData(vertices, _indices(shape, len(vertices), 3)))
    steps = max(levels, 0)
    while steps and len(mesh.faces) * 4**steps > _MOST_SUBDIVIDED:
        steps -= 1
    if steps != levels:
        context.approximated(shape, f"subdivided {steps} times, not {levels}")
    if not len(mesh.faces):
        return mesh, 0
    mesh = conversion.limit_of_loop(mesh, steps)
    normals = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(normals, mesh.faces[:, k], mesh.crosses())
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(mesh, normals=normals / np.where(lengths > 0, lengths, 1)), len(mesh.faces)


def _bilinear_patches(context: Context, shape: Entity) -> tuple[conversion.MeshData, int]:
    """Return bilinear patches as triangles, and the number of patches; flat parallelograms are exact."""
    vertices = _points(shape)
    quads = _indices(shape, len(vertices), 4)
    parameters = shape.parameters
    uvs, normals = _uvs(parameters), parameters.rows("N", 3, "normal", "normal3", "float")
    parameters.skip("faceIndices")
    if uvs is None:
        own = conversion.MeshData(vertices, quads, normals).with_corners_apart(_UVS_OF_PATCH)
        vertices, quads, normals, uvs = own.vertices, own.faces, own.normals, np.asarray(own.uvs)
    if all(_are_parallelograms(values, quads) for values in (vertices, uvs)):
        p00, p10, p01, p11 = quads.T
        faces = np.concatenate([np.stack([p00, p10, p11], axis=1), np.stack([p00, p11, p01], axis=1)])
        return _clean(context, shape, conversion.MeshData(vertices, faces, normals, uvs)), len(quads)
    context.approximated(shape, f"each patch as {_PATCH_CELLS} x {_PATCH_CELLS} cells of two triangles")
    return _clean(context, shape, _tessellate(vertices, quads, normals, uvs)), len(quads)


def _tessellate(vertices: Array, quads: Faces, normals: Array | None, uvs: Array) -> conversion.MeshData:
    """Return patches cut into cells, each patch with vertices of its own."""
    cells = _PATCH_CELLS
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
    return conversion.MeshData(spread(vertices), faces, None if normals is None else spread(normals), spread(uvs))


def _are_parallelograms(vertices: Array, quads: Faces) -> bool:
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


def _indices(shape: Entity, count: int, corners: int) -> Faces:
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


def _clean(context: Context, shape: Entity, mesh: conversion.MeshData) -> conversion.MeshData:
    """Return a mesh without faces that have no area."""
    areas = mesh.areas()
    kept = areas > 0
    if (count := int((~kept).sum())) and kept.any():
        context.ignored(shape, f"{count} triangles without area")
    return conversion.MeshData(mesh.vertices, mesh.faces[kept], mesh.normals, mesh.uvs)


LARGEST_FILE = 4 << 30


def _read_mesh(path: Path, place: Place) -> conversion.MeshData:
    try:
        if path.suffix.lower() != ".gz":
            contents = read_mesh_file(path, lambda other: other, painted=False)
        else:
            with tempfile.TemporaryDirectory() as folder:
                unpacked = Path(folder) / path.stem
                unpacked.write_bytes(conversion.read_limited(path, path.name, LARGEST_FILE))
                contents = read_mesh_file(unpacked, lambda other: other, painted=False)
    except InputError as problem:
        raise place.error(str(problem)) from None
    (part,) = contents.parts
    mesh = part.mesh
    return conversion.MeshData(
        mesh.positions.astype(np.float64) + mesh.origin,
        mesh.faces.astype(np.int64),
        None if mesh.normals is None else mesh.normals.astype(np.float64),
        None if mesh.uvs is None else mesh.uvs.astype(np.float64),
    )


# Surfaces of revolution as meshes: parts of spheres, disks and cylinders, and the shapes that only pbrt-v3 has.

_AROUND, _ALONG = 128, 64  # quadrilaterals of a full turn and of a curved profile


@dataclass(frozen=True, eq=False)
class RevolvedCurve:
    """The curve that turns about the z axis.

    Attributes
    ----------
    points, tangents : (n, 3) arrays
        From v = 0 to v = 1.
    full : bool
        Whether a turn of 360 degrees makes the whole shape, which our own one then is.
    area : float
        Of the surface of a full turn.
    v : (n,) array or None
        Of the points; None for even steps.
    """

    points: Array
    tangents: Array
    full: bool
    area: float
    v: Array | None = None


def sphere(parameters: Parameters) -> RevolvedCurve:
    """Return the profile of a sphere between zmin and zmax."""
    radius = _positive(parameters, "radius", 1.0)
    low = np.clip(parameters.number("zmin", -radius) / radius, -1, 1)
    high = np.clip(parameters.number("zmax", radius) / radius, -1, 1)
    low, high = min(low, high), max(low, high)
    angle = np.linspace(math.acos(low), math.acos(high), _ALONG + 1)
    zero = np.zeros_like(angle)
    points = radius * np.stack([np.sin(angle), zero, np.cos(angle)], axis=1)
    tangents = np.stack([-np.cos(angle), zero, np.sin(angle)], axis=1)
    return RevolvedCurve(points, tangents, low == -1 and high == 1, 2 * math.pi * radius**2 * (high - low))


def _disk(parameters: Parameters) -> RevolvedCurve:
    """Return the profile of a disk, from the rim to the hole."""
    height, radius = parameters.number("height", 0.0), _positive(parameters, "radius", 1.0)
    inner = min(parameters.number("innerradius", 0.0), radius)
    area = math.pi * (radius**2 - inner**2)
    return _segment((radius, 0, height), (inner, 0, height), inner == 0, area)


def cylinder(parameters: Parameters) -> RevolvedCurve:
    """Return the profile of a cylinder without caps."""
    radius = _positive(parameters, "radius", 1.0)
    low, high = parameters.number("zmin", -1.0), parameters.number("zmax", 1.0)
    low, high = min(low, high), max(low, high)
    return _segment((radius, 0, low), (radius, 0, high), True, 2 * math.pi * radius * (high - low))


def _cone(parameters: Parameters) -> RevolvedCurve:
    """Return the profile of a cone without a cap."""
    radius, height = _positive(parameters, "radius", 1.0), _positive(parameters, "height", 1.0)
    return _segment((radius, 0, 0), (0, 0, height), True, math.pi * radius * math.hypot(radius, height))


def _paraboloid(parameters: Parameters) -> RevolvedCurve:
    """Return the profile z = zmax (r / radius)^2 between zmin and zmax."""
    radius, top = _positive(parameters, "radius", 1.0), _positive(parameters, "zmax", 1.0)
    bottom = max(parameters.number("zmin", 0.0), 0.0)
    heights = top * np.linspace(math.sqrt(bottom / top), 1, _ALONG + 1) ** 2  # denser where it curves most
    radii = radius * np.sqrt(heights / top)
    points = np.stack([radii, np.zeros_like(radii), heights], axis=1)
    tangents = np.stack([np.ones_like(radii), np.zeros_like(radii), 2 * top * radii / radius**2], axis=1)
    return RevolvedCurve(points, tangents, False, 0.0, v=(heights - bottom) / (top - bottom or 1.0))


def hyperboloid(parameters: Parameters) -> RevolvedCurve:
    """Return the segment from p1 to p2."""
    return _segment(parameters.vector("p1", (0, 0, 0)), parameters.vector("p2", (1, 1, 1)), False, 0.0, steps=_ALONG)


_PROFILES = {
    "sphere": sphere, "disk": _disk, "cylinder": cylinder, "cone": _cone, "paraboloid": _paraboloid,
    "hyperboloid": hyperboloid,
}  # fmt: skip


def _positive(parameters: Parameters, name: str, default: float) -> float:
    """Return a number above 0."""
    value = parameters.number(name, default)
    if not value > 0:
        raise parameters.error(name, f"must be above 0 (got {value:g})")
    return value


def sweep(profile: RevolvedCurve, degrees: float) -> conversion.MeshData:
    """Return the mesh that a profile sweeps from +x over +y; its front is that of pbrt: along du x dv.

    u and v of the mesh run from 0 to 1 along the turn and along the profile. Of a profile without extent there are no
    faces.
    """
    around, along = max(3, round(_AROUND * degrees / 360)), len(profile.points)
    angles = np.radians(np.linspace(0, degrees, around + 1))
    cos, sin, zero, one = np.cos(angles), np.sin(angles), np.zeros_like(angles), np.ones_like(angles)
    turns = np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]])
    vertices = np.einsum("ijk,nj->kni", turns, profile.points).reshape(-1, 3)
    normals = np.einsum("ijk,nj->kni", turns, _profile_normals(profile)).reshape(-1, 3)
    steps = np.linspace(0, 1, along) if profile.v is None else profile.v
    u, v = np.meshgrid(np.linspace(0, 1, around + 1), steps, indexing="ij")
    k, n = np.meshgrid(np.arange(around), np.arange(along - 1), indexing="ij")
    corner = (k * along + n).reshape(-1)
    right, up, far = corner + along, corner + 1, corner + along + 1
    faces = np.concatenate([np.stack([corner, right, far], axis=1), np.stack([corner, far, up], axis=1)])
    mesh = conversion.MeshData(vertices, faces, normals, np.stack([u, v], axis=-1).reshape(-1, 2))
    areas = mesh.areas()
    return conversion.MeshData(vertices, faces[areas > 1e-12 * areas.max()], normals, mesh.uvs)


def _profile_normals(profile: RevolvedCurve) -> Array:
    x, y, _ = profile.points.T
    radii = np.hypot(x, y)
    safe = np.where(radii > 0, radii, 1)
    azimuth = np.stack([np.where(radii > 0, -y / safe, 0), np.where(radii > 0, x / safe, 1), np.zeros_like(x)], axis=1)
    normals = np.cross(azimuth, profile.tangents)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(lengths > 0, lengths, 1))


def _segment(start: object, end: object, full: bool, area: float, steps: int = 1) -> RevolvedCurve:
    first, last = np.asarray(start, np.float64), np.asarray(end, np.float64)
    points = first + np.linspace(0, 1, steps + 1)[:, None] * (last - first)
    return RevolvedCurve(points, np.broadcast_to(last - first, points.shape), full, area)


Keys = dict[str, Any]

# Faces up to which a mesh stands in the scene file itself.
_MOST_INLINE = 200


@dataclass(frozen=True, eq=False)
class Placed:
    """A shape to be converted.

    Attributes
    ----------
    world : (4, 4) array
        From the shape's space to the world of ours.
    textured : bool
        Whether texture coordinates matter.
    oriented : bool
        Whether front and back of its material differ: lamps of one side, glass, normal maps.
    shared : bool
        Whether the shape stands in several places, so that a mesh keeps its own space.
    """

    use: ShapeUse
    world: Matrix
    textured: bool
    oriented: bool
    shared: bool

    @property
    def shape(self) -> Entity:
        """The shape itself."""
        return self.use.shape


_Piece = tuple[Keys, float, conversion.MeshData | None]
"""An object of ours without its material: its keys, without a shape for a mesh, which is still data; the mean area of
the parts that pbrt takes for lamps of their own [square units of pbrt's scene], 0 if unknown; the mesh, if any."""


def _convert_shape(context: Context, placed: Placed) -> _Piece | None:
    """Return a shape as an object of ours; None, with a report, when it has no counterpart."""
    shape = placed.shape
    kinds: dict[str, Callable[[Context, Placed], _Piece | None]] = {
        "sphere": _sphere, "disk": _round, "cylinder": _round, "cone": _round, "paraboloid": _round,
        "hyperboloid": _round, "curve": _curve, "trianglemesh": _mesh, "bilinearmesh": _mesh, "loopsubdiv": _mesh,
        "plymesh": _ply,
    }  # fmt: skip
    if shape.kind not in kinds:
        shape.parameters.skip_all()
        context.ignored(shape, f"there is no such shape (known: {', '.join(kinds)})")
        return None
    return kinds[shape.kind](context, placed)


def _transform_keys(matrix: Matrix) -> Keys:
    """Return the key of a transform, nothing for the identity."""
    if np.array_equal(matrix, np.eye(4)):
        return {}
    if np.array_equal(matrix[:3, :3], np.eye(3)):
        return {"transform": {"translate": conversion.tidy(matrix[:3, 3])}}
    linear = conversion.tidy(matrix[:3, :3])
    return {
        "transform": {
            "matrix": [[*axes, shift] for axes, shift in zip(linear, conversion.tidy(matrix[:3, 3]), strict=True)]
        }
    }


def _sphere(context: Context, placed: Placed) -> _Piece | None:
    """Return a sphere; a textured one keeps the turn of its transform, and u and v of ours run as pbrt's do."""
    parameters = placed.shape.parameters
    profile = sphere(parameters)
    degrees = parameters.number("phimax", 360.0)
    if not profile.full or degrees < 360 or (placed.use.reverse and placed.oriented):
        return _revolved_mesh(context, placed, profile, degrees)
    radius = parameters.number("radius", 1.0)
    if conversion.is_similarity(placed.world) and not placed.textured:
        scaled = radius * conversion.mean_scale(placed.world)
        return {"shape": "sphere", "center": conversion.tidy(placed.world[:3, 3]), "radius": scaled}, profile.area, None
    keys = {"shape": "sphere", "center": [0, 0, 0], "radius": radius}
    return keys | _transform_keys(placed.world), profile.area, None


def _round(context: Context, placed: Placed) -> _Piece | None:
    """Return a disk, cylinder or cone, or the mesh of what is only a part of one."""
    parameters = placed.shape.parameters
    profile = _PROFILES[placed.shape.kind](parameters)
    degrees = parameters.number("phimax", 360.0)
    flips = placed.use.reverse and placed.oriented
    skewed = placed.shape.kind == "disk" and placed.textured  # our disk has u and v across, pbrt's run round it
    first, last = profile.points[0], profile.points[-1]
    partial = not profile.full or degrees < 360 or np.array_equal(first, last)
    if partial or skewed or (flips and placed.shape.kind != "disk"):
        return _revolved_mesh(context, placed, profile, degrees)
    radius = float(first[0])
    if placed.shape.kind == "disk":
        front = [0, 0, -1 if flips else 1]
        keys: Keys = {"shape": "disk", "center": [0, 0, float(first[2])], "normal": front, "radius": radius}
    else:
        end = "apex" if placed.shape.kind == "cone" else "top"
        keys = {"shape": placed.shape.kind, "base": [0, 0, float(first[2])], end: [0, 0, float(last[2])],
                "radius": radius, "capped": False}  # fmt: skip
    return keys | _transform_keys(placed.world), profile.area, None


def _revolved_mesh(context: Context, placed: Placed, profile: RevolvedCurve, degrees: float) -> _Piece | None:
    if not 0 < degrees <= 360:
        raise placed.shape.error(f"phimax must lie between 0 and 360 (got {degrees:g})")
    mesh = sweep(profile, degrees)
    if not len(mesh.faces):
        _note_no_area(context, placed.shape)
        return None
    context.approximated(placed.shape, f"a mesh of {len(mesh.faces)} triangles")
    return _piece(placed, mesh, profile.area * degrees / 360)


def _mesh(context: Context, placed: Placed) -> _Piece | None:
    makers = {"trianglemesh": _triangle_mesh, "bilinearmesh": _bilinear_patches, "loopsubdiv": _subdivided_mesh}
    mesh, parts = makers[placed.shape.kind](context, placed.shape)
    if not len(mesh.faces):
        _note_no_area(context, placed.shape)
        return None
    if placed.textured and mesh.uvs is None:
        mesh = mesh.with_corners_apart(_UVS_OF_FACE)
    area = float(mesh.transformed(placed.shape.world_from_object).areas().sum()) / parts
    return _piece(placed, mesh, area)


def _curve(context: Context, placed: Placed) -> _Piece | None:
    """Return a curve as one strand of Bézier points in the world, or in its own space where it is shared."""
    shape, parameters = placed.shape, placed.shape.parameters
    degree, basis = parameters.integer("degree", 3), parameters.text("basis", "bezier")
    parameters.skip("splitdepth", "N")
    points = _points(shape)
    if degree not in (2, 3) or basis not in ("bezier", "bspline"):
        raise shape.error(f"curves have the degree 2 or 3 and the basis bezier or bspline (got {degree}, {basis})")
    if len(points) <= degree or (basis == "bezier" and (len(points) - 1) % degree):
        raise shape.error(f"curve: {len(points)} points P make no curves of degree {degree}")
    step = degree if basis == "bezier" else 1
    windows = np.stack([points[k : len(points) - degree + k : step] for k in range(degree + 1)], axis=1)
    if degree == 2:
        if basis == "bspline":
            windows = np.stack([windows[:, :2].mean(axis=1), windows[:, 1], windows[:, 1:].mean(axis=1)], axis=1)
        raised = np.array([[1, 0, 0], [1 / 3, 2 / 3, 0], [0, 2 / 3, 1 / 3], [0, 0, 1]])
        pieces = raised @ windows
    else:
        pieces = bezier_pieces(points[None], "bezier" if basis == "bezier" else "bspline")[0]
    width = parameters.number("width", 1.0)
    ends = parameters.number("width0", width), parameters.number("width1", width)
    rows = np.concatenate([pieces[0, :1], pieces[:, 1:].reshape(-1, 3)])
    widths = np.interp(np.linspace(0, 1, len(rows)), (0, 1), ends)
    form = parameters.text("type", "flat")
    if form == "ribbon":
        context.approximated(shape, "a ribbon that turns to whoever sees it")
    keys: Keys = {"shape": "curves", "basis": "bezier", "form": "tube" if form == "cylinder" else "flat"}
    if placed.shared:
        keys |= _transform_keys(placed.world)
    else:
        rows = rows @ placed.world[:3, :3].T + placed.world[:3, 3]
        widths = widths * conversion.mean_scale(placed.world)
    return keys | {"points": np.column_stack([rows, widths]).tolist()}, 0.0, None


def _note_no_area(context: Context, shape: Entity) -> None:
    context.ignored(shape, "has no faces of any area")


def _piece(placed: Placed, mesh: conversion.MeshData, area: float) -> _Piece:
    mesh = mesh.facing_its_normals()
    if placed.use.reverse:
        mesh = mesh.reversed()
    if placed.shared:
        return _transform_keys(placed.world), area, mesh
    mesh = mesh.transformed(placed.world)
    rectangle = conversion.rectangle_of(mesh, textured=placed.textured, oriented=placed.oriented)
    return ({}, area, mesh) if rectangle is None else (rectangle, area, None)


def _ply(context: Context, placed: Placed) -> _Piece | None:
    """Return a mesh file by its name, or a copy of it where pbrt has its front on the other side; None without it."""
    name, place = placed.shape.file_name()
    if (path := context.find_or_note(name, place, "the object is left out")) is None:
        return None
    keys = _transform_keys(placed.world)
    area = 0.0
    if placed.oriented or placed.textured or placed.use.lamp is not None:
        mesh = _read_mesh(path, place)
        bare = placed.textured and mesh.uvs is None
        mesh = mesh.with_corners_apart(_UVS_OF_FACE) if bare else mesh
        facing = mesh.facing_its_normals()
        changed = placed.use.reverse or not np.array_equal(facing.faces, mesh.faces)
        facing = facing.reversed() if placed.use.reverse else facing
        area = float(facing.transformed(placed.shape.world_from_object).areas().mean())
        if bare or (changed and placed.oriented):
            what = "texture coordinates" if bare else "front"
            context.report.noted(place, f"{name}: written anew with its {what} where pbrt has it")
            return keys, area, facing
    return {"shape": "mesh", "file": context.files.reference(path, place), **keys}, area, None


# The objects of a scene of ours: shapes with their materials, each material and shared mesh once.

MOST_VALUES = 45_000  # from which single objects are put together, so that the scene file stays one to be read


def _count_values(value: Any) -> int:
    """Return the number of values that a part of a scene takes in a file: lists, mappings, keys and scalars."""
    if isinstance(value, Mapping):
        return 1 + sum(1 + _count_values(item) for item in value.values())
    if isinstance(value, list | tuple):
        return 1 + sum(map(_count_values, value))
    return _count_values(value.tolist()) if isinstance(value, np.ndarray) else 1


def _join_meshes(parts: list[conversion.MeshData]) -> conversion.MeshData:
    """Return meshes as one; normals and texture coordinates have all of them or none."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    normals = [part.normals for part in parts if part.normals is not None]
    uvs = [part.uvs for part in parts if part.uvs is not None]
    return conversion.MeshData(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate(normals) if normals else None,
        np.concatenate(uvs) if uvs else None,
    )


Places = tuple[Matrix, Matrix, Matrix | None]
_ONE_SIDED = ("emissive", "dielectric", "principled")


@dataclass
class Objects:
    """Takes the shapes of a pbrt scene one by one."""

    context: Context
    frame: CameraFrame
    items: list[Keys] = field(default_factory=list)
    materials: dict[str, Keys] = field(default_factory=dict)
    meshes: dict[str, Keys] = field(default_factory=dict)
    _names: dict[str, str] = field(default_factory=dict)
    _converted: dict[int, tuple[Entity | None, Keys | None]] = field(default_factory=dict)
    _shared: dict[int, tuple[ShapeUse, str]] = field(default_factory=dict)
    _counts: Counter[str] = field(default_factory=Counter)
    _loose: dict[int, tuple[ShapeUse, conversion.MeshData]] = field(default_factory=dict)

    def keys(self) -> Keys:
        """Return the sections of the scene."""
        sizes = {index: _count_values(mesh.keys()) if len(mesh.faces) <= _MOST_INLINE else 2
                 for index, (_, mesh) in self._loose.items()}  # fmt: skip
        if _count_values(self.items) + sum(sizes.values()) > MOST_VALUES:
            self._merge()
            self._merge_spheres()
        for index, (use, mesh) in self._loose.items():
            self.items[index] = {"shape": "mesh", **self._mesh_keys(use, mesh), **self.items[index]}
        self._merge_curves()
        self.items = [item for item in self.items if item]
        sections = {"materials": self.materials, "meshes": self.meshes, "objects": self.items}
        return {name: section for name, section in sections.items() if section}

    def add_all(self) -> None:
        """Add every shape at every place."""
        scene = self.context.scene
        placed = [item for item in scene.shapes if isinstance(item, Instance)]
        counts = Counter(item.name for item in placed)
        tabled: dict[str, list[Instance]] = {}
        for item in scene.shapes:
            if isinstance(item, ShapeUse):
                self._add(item, self._places(item.shape))
                continue
            shapes = scene.objects.get(item.name, [])
            if item.at_end is None and counts[item.name] >= conversion.TABLED:
                tabled.setdefault(item.name, []).append(item)
                continue
            for use in shapes:
                self._add(use, self._places(use.shape, item), item, shared=counts[item.name] > 1)
        for name, instances in tabled.items():
            if scene.objects.get(name):
                self._add_table(instances, scene.objects[name])
        for name, shapes in scene.objects.items():
            if shapes and name not in counts:
                self.context.report.noted(shapes[0].shape.place, f'object "{name}" is never placed')

    def _places(self, shape: Entity, instance: Instance | None = None) -> Places:
        """Return where a shape is in the world of ours, and from where to where a frame moves that takes it along."""
        if instance is None:
            ways = shape.world_from_object, shape.world_from_object, shape.at_end
        else:
            start = instance.world_from_instance
            ways = start @ shape.world_from_object, start, instance.at_end
            if shape.at_end is not None:
                self.context.approximated(shape, "it does not move within an object that stands in several places")
        world, start = (np.asarray(self.frame.world @ each) for each in ways[:2])
        return world, start, None if ways[2] is None else np.asarray(self.frame.world @ ways[2])

    def _motion(self, use: ShapeUse, places: Places, keys: Keys) -> Keys:
        """Return keys of a shape that moves: nothing, with a report, where it does more than turn and shift.

        pbrt turns a frame about its origin, and shifts that; so do these.
        """
        _, start, end = places
        if end is None:
            return {}
        frames = conversion.motion_between(start, end, self.context.scene.times)
        if frames is None:
            self.context.approximated(use.shape, "it stays as it is at the start, as it does more than turn and shift")
            return {}
        self.context.moves = True
        before = keys.get("transform", [])
        steps = before if isinstance(before, list) else [before]
        return {"transform": [*steps, {"translate": conversion.tidy(-start[:3, 3])}], "motion": frames}

    def _add_table(self, instances: list[Instance], shapes: list[ShapeUse]) -> None:
        """Add the shapes of an object that stands in many places, with a table of these."""
        worlds = [np.asarray(self.frame.world @ item.world_from_instance) for item in instances]
        kept = [index for index, world in enumerate(worlds) if conversion.is_usable(world)]
        for index in set(range(len(worlds))).difference(kept):
            self.context.report.ignored(instances[index].place, f'ObjectInstance "{instances[index].name}": {ODD}')
        if not kept:
            return
        matrices = np.array([worlds[index][:3] for index in kept])
        table = self._table(instances[0].name, matrices=matrices)
        for use in shapes:
            here = use.shape.world_from_object
            self._add(use, (here, here, None), instances[kept[0]], shared=True, table=table)

    def _table(self, name: str, **arrays: Array) -> str:
        """The name of a new file beside the scene that holds places."""
        return self.context.files.add("places", f"{name}.npz", lambda path: np.savez(path, **arrays))  # type: ignore[arg-type]

    def _add(
        self,
        use: ShapeUse,
        places: Places,
        instance: Instance | None = None,
        *,
        shared: bool = False,
        table: str = "",
    ) -> None:
        world = places[0]
        if not conversion.is_bearable(world):
            self._leave_out(use, instance)
            return
        lamp = use.lamp if instance is None else None
        if use.lamp is not None and instance is not None:
            self.context.ignored(use.lamp, "lamps in objects do not shine, as in pbrt")
        material, opacity, inside = self._material(use), self._opacity(use), self._medium(use)
        if lamp is not None:
            textured, oriented = False, not lamp.parameters.boolean("twosided", False)
        else:
            material = self._surface(use, material, opacity, inside)
            if material is None:
                use.shape.parameters.skip_all()
                return
            textured, oriented = _is_textured(material), _has_front(material)
        piece = _convert_shape(self.context, Placed(use, world, textured, oriented, shared))
        if piece is None:
            return
        keys, area, mesh = piece
        if "transform" in keys and not conversion.is_transform_of_ours(world):
            self._leave_out(use, instance)
            return
        if lamp is not None:
            material = self._lamp(lamp, area, use, opacity)
        assert material is not None
        name = self._name(material, self._wanted_name(use, lamp))
        if mesh is not None and shared:
            keys = {"shape": "mesh", "mesh": self._share_mesh(use, mesh), **keys}
        elif mesh is not None:
            self._loose[len(self.items)] = use, mesh
        instances = {"instances": {"file": table}} if table else {}
        self.items.append({**keys, **self._motion(use, places, keys), **instances, "material": name})

    def _medium(self, use: ShapeUse) -> Keys | None:
        medium = self.context.scene.media.get(use.inside)
        return None if medium is None else medium_keys(self.context, medium)

    def _surface(self, use: ShapeUse, material: Keys | None, opacity: Keys, inside: Keys | None) -> Keys | None:
        """Return the material that a shape is shown in; None, with a report, where nothing of it is seen."""
        if inside is not None:
            material = self._with_interior(use, material, inside)
        if material is None:
            self.context.ignored(use.shape, "the boundary of a medium, without a surface")
            return None
        if opacity.get("opacity") == 0:
            self.context.ignored(use.shape, "wholly transparent")
            return None
        material = self._fitting(use, {**material, **opacity})
        if "bump" in json.dumps(material) and self._has_vertex_normals(use.shape):
            material = bumps_of_mesh(material, self.context.scene.version)
        return material

    def _with_interior(self, use: ShapeUse, material: Keys | None, inside: Keys) -> Keys:
        """Return a material that is filled with a medium: of glass, or nothing but its boundary."""
        if material is None:
            return {"kind": "boundary", "interior": inside}
        if material["kind"] == "dielectric":
            return {**material, "interior": inside}
        self.context.ignored(use.shape, f"the medium inside of {material['kind']}")
        return material

    def _fitting(self, use: ShapeUse, material: Keys) -> Keys:
        """Return a material that its shape may have: hair is for curves alone, which are neither glass nor mirrors."""
        is_curve, kind = use.shape.kind == "curve", material["kind"]
        parts = {kind, *(part["kind"] for part in material.get("materials", ()))}
        if is_curve and "opacity" in material:
            self.context.ignored(use.shape, "holes of curves")
            material = {key: value for key, value in material.items() if not key.startswith("opacity")}
        if (is_curve and parts & {"dielectric", "thin_glass", "mirror"}) or (not is_curve and "hair" in parts):
            self.context.approximated(use.shape, f"matte in place of {kind}")
            colour = material.get("reflectance", [0.5] * 3)
            return {"kind": "matte", "reflectance": colour}
        return material

    def _leave_out(self, use: ShapeUse, instance: Instance | None) -> None:
        """Report a shape whose transform flattens space, or leads out of it."""
        what = use.shape.what if instance is None else f'{use.shape.what} of "{instance.name}"'
        self.context.report.ignored((instance or use.shape).place, f"{what}: {ODD}")
        use.shape.parameters.skip_all()

    def _material(self, use: ShapeUse) -> Keys | None:
        entity = self.context.scene.material_of(use.material)
        if id(entity) not in self._converted:
            self._converted[id(entity)] = entity, convert_material(self.context, entity)
        return self._converted[id(entity)][1]

    def _has_vertex_normals(self, shape: Entity) -> bool:
        """Return whether a shape is a mesh with normals or tangents of its vertices, or one that pbrt gives some."""
        if shape.kind != "plymesh":
            return shape.kind == "loopsubdiv" or shape.parameters.has("N") or shape.parameters.has("S")
        name, place = shape.file_name()
        path = self.context.find_or_note(name, place, "the object is left out")
        return path is not None and _read_mesh(path, place).normals is not None

    def _opacity(self, use: ShapeUse) -> Keys:
        """Return the holes of a shape, which pbrt gives as ``alpha``."""
        parameters = use.shape.parameters
        parameters.skip("shadowalpha")
        if not parameters.has("alpha"):
            return {}
        return opacity_keys(self.context, use.shape, "alpha", number_shade(self.context, use.shape, "alpha", 1.0))

    def _lamp(self, lamp: Entity, area: float, use: ShapeUse, opacity: Keys) -> Keys:
        radiance, two_sided = lamp_radiance(self.context, lamp, area)
        if opacity:
            self.context.ignored(use.shape, "alpha of a lamp, which stays visible")
        reflecting = self._material(use)
        if reflecting is not None and reflecting.get("reflectance") != [0.0, 0.0, 0.0]:
            self.context.approximated(lamp, "the lamp reflects nothing")
        keys: Keys = {"kind": "emissive", "radiance": radiance.tolist()}
        return keys | ({"two_sided": True} if two_sided else {})

    def _share_mesh(self, use: ShapeUse, mesh: conversion.MeshData) -> str:
        """The name of a mesh that stands in several places; the mesh is added to the scene at its first."""
        if id(use) not in self._shared:
            name = self._unique("mesh")
            self._shared[id(use)] = use, name
            self.meshes[name] = self._mesh_keys(use, mesh)
        return self._shared[id(use)][1]

    def _merge_spheres(self) -> None:
        """Make one object of the spheres of each material, with a table of their places."""
        groups: dict[str, list[int]] = {}
        for index, item in enumerate(self.items):
            if item.keys() == {"shape", "center", "radius", "material"}:
                groups.setdefault(item["material"], []).append(index)
        for material, members in groups.items():
            if len(members) < conversion.TABLED:
                continue
            places = {key: np.array([self.items[index][key] for index in members]) for key in ("center", "radius")}
            table = self._table(f"{material}-spheres", positions=places["center"], scales=places["radius"])
            for index in members:
                self.items[index] = {}
            one = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "instances": {"file": table}}
            self.items[members[0]] = {**one, "material": material}

    def _merge_curves(self) -> None:
        """Put the strands of each material together, many points into a file beside the scene."""
        groups: dict[str, list[int]] = {}
        for index, item in enumerate(self.items):
            if item.get("shape") == "curves":
                same = {key: value for key, value in item.items() if key != "points"}
                groups.setdefault(json.dumps(same), []).append(index)
        for members in groups.values():
            strands = [self.items[index]["points"] for index in members]
            points, counts = [row for strand in strands for row in strand], [len(strand) for strand in strands]
            for index in members[1:]:
                self.items[index] = {}
            first = self.items[members[0]]
            if len(points) > _MOST_INLINE:
                name = f"{first['material']}.npz"
                arrays: dict[str, Any] = {"points": np.array(points), "counts": np.array(counts)}
                del first["points"]
                first["file"] = self.context.files.add("curves", name, partial(np.savez, **arrays))
            else:
                first |= {"points": points, "counts": counts}

    def _merge(self) -> None:
        """Put the meshes of each material together that stand in one place only."""
        groups: dict[tuple[object, ...], list[int]] = {}
        for index, (_, mesh) in self._loose.items():
            if "transform" not in self.items[index]:
                form = self.items[index]["material"], mesh.normals is not None, mesh.uvs is not None
                groups.setdefault(form, []).append(index)
        for (material, *_), (first, *others) in groups.items():
            if not others:
                continue
            use, _ = self._loose[first]
            self._loose[first] = use, _join_meshes([self._loose[index][1] for index in (first, *others)])
            for index in others:
                del self._loose[index]
                self.items[index] = {}
            self.context.report.noted(
                use.shape.place,
                f"{1 + len(others)} meshes of {material} became one, as there are very many",
            )

    def _mesh_keys(self, use: ShapeUse, mesh: conversion.MeshData) -> Keys:
        """Return a small mesh written out, a large one as a file beside the scene."""
        if len(mesh.faces) <= _MOST_INLINE:
            return mesh.keys()
        name = f"{use.shape.kind}-{use.shape.place.line_number}.ply"
        return {"file": self.context.files.add("meshes", name, mesh.write_ply)}

    def _wanted_name(self, use: ShapeUse, lamp: Entity | None) -> str:
        if lamp is not None:
            return "lamp"
        entity = self.context.scene.material_of(use.material)
        if entity is None:
            return "default"
        named = entity.what.startswith("MakeNamedMaterial")
        return (entity.what.split(" ", 1)[1].strip('"') if named else entity.kind)[:100] or entity.kind

    def _name(self, material: Keys, wanted: str) -> str:
        """Return the name of a material; equal ones have one."""
        content = json.dumps(material, sort_keys=True)
        if content not in self._names:
            name = self._unique(wanted)
            self._names[content] = name
            self.materials[name] = material
        return self._names[content]

    def _unique(self, wanted: str) -> str:
        taken = self.materials.keys() | self.meshes.keys()
        while True:
            self._counts[wanted] += 1
            count = self._counts[wanted]
            name = wanted if count == 1 and wanted != "mesh" else f"{wanted}-{count}"
            if name not in taken:
                return name


def _has_front(material: Keys) -> bool:
    """Return whether the front of a material is not as its back: of bumps the back has dents."""
    parts = material.get("materials", ())
    uneven = "normal_map" in material or "bump" in material
    return material["kind"] in _ONE_SIDED or uneven or any(map(_has_front, parts))


def _is_textured(value: Any) -> bool:
    """Return whether some part of a material goes by u and v: a texture, or roughness along them."""
    if isinstance(value, dict):
        is_texture = (value.get("kind") in ("image", "checker", "dots") or "file" in value) and "mapping" not in value
        is_brushed = isinstance(value.get("alpha"), list) or value.get("anisotropy", 0) != 0
        return is_texture or is_brushed or any(_is_textured(item) for item in value.values())
    return isinstance(value, list) and any(_is_textured(item) for item in value)
