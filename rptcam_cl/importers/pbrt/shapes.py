"""Shapes of pbrt as objects of ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt import revolved
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.mesh import MeshData, rectangle_of
from rptcam_cl.importers.pbrt.mesh_shapes import bilinear_patches, control_mesh, facing_mesh, ply_name, triangle_mesh
from rptcam_cl.importers.pbrt.state import Entity, ShapeUse
from rptcam_cl.importers.pbrt.transforms import Matrix, is_similarity, mean_scale, tidy

Keys = dict[str, Any]

# Faces up to which a mesh stands in the scene file itself.
MOST_INLINE = 200


@dataclass(frozen=True)
class ShapeMaterial:
    """What a shape's material asks of its shape.

    Attributes
    ----------
    textured : bool
        Whether texture coordinates matter.
    oriented : bool
        Whether front and back differ: lamps of one side, glass, normal maps.
    """

    textured: bool
    oriented: bool


@dataclass(frozen=True, eq=False)
class Placed:
    """A shape to be converted.

    Attributes
    ----------
    world : (4, 4) array
        From the shape's space to the world of ours.
    shared : bool
        Whether the shape stands in several places, so that a mesh keeps its own space.
    """

    use: ShapeUse
    world: Matrix
    material: ShapeMaterial
    shared: bool

    @property
    def shape(self) -> Entity:
        """The shape itself."""
        return self.use.shape


@dataclass(frozen=True, eq=False)
class Piece:
    """An object of ours without its material; a mesh is still data.

    Attributes
    ----------
    keys : dict
        Of the object; without a shape for a mesh.
    area : float
        Mean area of the parts that pbrt takes for lamps of their own [square units of pbrt's scene]; 0 if unknown.
    """

    keys: Keys
    area: float
    mesh: MeshData | None = None


def convert_shape(context: Context, placed: Placed) -> Piece | None:
    """Return a shape as an object of ours; None, with a report, when it has no counterpart."""
    shape = placed.shape
    kinds: dict[str, Callable[[Context, Placed], Piece | None]] = {
        "sphere": _sphere, "disk": _round, "cylinder": _round, "cone": _round, "paraboloid": _round,
        "hyperboloid": _round, "trianglemesh": _mesh, "bilinearmesh": _mesh, "loopsubdiv": _mesh, "plymesh": _ply,
    }  # fmt: skip
    if shape.kind in ("curve", "nurbs", "heightfield", "heightfield2"):
        shape.parameters.used.update(shape.parameters.items)
        context.report.ignored(shape.place, f"{shape.what}: there is no such shape")
        return None
    if shape.kind not in kinds:
        raise shape.place.error(f'unknown shape "{shape.kind}" (allowed: {", ".join(kinds)}, curve)')
    return kinds[shape.kind](context, placed)


def transform_keys(matrix: Matrix) -> Keys:
    """Return the key of a transform, nothing for the identity."""
    if np.array_equal(matrix, np.eye(4)):
        return {}
    if np.array_equal(matrix[:3, :3], np.eye(3)):
        return {"transform": {"translate": tidy(matrix[:3, 3])}}
    linear = tidy(matrix[:3, :3])
    return {"transform": {"matrix": [[*axes, shift] for axes, shift in zip(linear, tidy(matrix[:3, 3]), strict=True)]}}


def _sphere(context: Context, placed: Placed) -> Piece | None:
    """Return a sphere; a textured one keeps the turn of its transform, and u and v of ours run as pbrt's do."""
    parameters = placed.shape.parameters
    profile = revolved.sphere(parameters)
    degrees = parameters.number("phimax", 360.0)
    if not profile.full or degrees < 360 or (placed.use.reverse and placed.material.oriented):
        return _revolved_mesh(context, placed, profile, degrees)
    radius = parameters.number("radius", 1.0)
    if is_similarity(placed.world) and not placed.material.textured:
        scaled = radius * mean_scale(placed.world)
        return Piece({"shape": "sphere", "center": tidy(placed.world[:3, 3]), "radius": scaled}, profile.area)
    keys = {"shape": "sphere", "center": [0, 0, 0], "radius": radius}
    return Piece(keys | transform_keys(placed.world), profile.area)


def _round(context: Context, placed: Placed) -> Piece | None:
    """Return a disk, cylinder or cone, or the mesh of what is only a part of one."""
    parameters = placed.shape.parameters
    profile = revolved.PROFILES[placed.shape.kind](parameters)
    degrees = parameters.number("phimax", 360.0)
    flips = placed.use.reverse and placed.material.oriented
    skewed = (
        placed.shape.kind == "disk" and placed.material.textured
    )  # our disk has u and v across, pbrt's run round it
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
    return Piece(keys | transform_keys(placed.world), profile.area)


def _revolved_mesh(context: Context, placed: Placed, profile: revolved.Profile, degrees: float) -> Piece | None:
    if not 0 < degrees <= 360:
        raise placed.shape.place.error(f"{placed.shape.what}: phimax must lie between 0 and 360 (got {degrees:g})")
    mesh = revolved.turned(profile, degrees)
    if not len(mesh.faces):
        _note_no_area(context, placed.shape)
        return None
    context.report.approximated(placed.shape.place, f"{placed.shape.what}: a mesh of {len(mesh.faces)} triangles")
    return _piece(placed, mesh, profile.area * degrees / 360)


def _mesh(context: Context, placed: Placed) -> Piece | None:
    makers = {"trianglemesh": triangle_mesh, "bilinearmesh": bilinear_patches, "loopsubdiv": control_mesh}
    mesh, parts = makers[placed.shape.kind](context, placed.shape)
    if not len(mesh.faces):
        _note_no_area(context, placed.shape)
        return None
    if placed.material.textured and mesh.uvs is None:
        context.report.approximated(placed.shape.place, f"{placed.shape.what}: a texture without texture coordinates")
    area = float(mesh.transformed(placed.shape.world_from_object).areas().sum()) / parts
    return _piece(placed, mesh, area)


def _note_no_area(context: Context, shape: Entity) -> None:
    context.report.ignored(shape.place, f"{shape.what}: has no faces of any area")


def _piece(placed: Placed, mesh: MeshData, area: float) -> Piece:
    mesh = mesh.facing_its_normals()
    if placed.use.reverse:
        mesh = mesh.reversed()
    if placed.shared:
        return Piece(transform_keys(placed.world), area, mesh)
    mesh = mesh.transformed(placed.world)
    rectangle = rectangle_of(mesh, textured=placed.material.textured, oriented=placed.material.oriented)
    return Piece({}, area, mesh) if rectangle is None else Piece(rectangle, area)


def _ply(context: Context, placed: Placed) -> Piece | None:
    """Return a mesh file by its name, or a copy of it where pbrt has its front on the other side; None without it."""
    name, place = ply_name(placed.use)
    if (path := context.find_or_note(name, place, "the object is left out")) is None:
        return None
    keys = transform_keys(placed.world)
    area = 0.0
    if placed.material.oriented or placed.use.lamp is not None:
        mesh, changed = facing_mesh(context, placed.use)
        area = float(mesh.transformed(placed.shape.world_from_object).areas().mean())
        if changed and placed.material.oriented:
            context.report.noted(place, f"{name}: written anew with its front where pbrt has it")
            return Piece(keys, area, mesh)
    return Piece({"shape": "mesh", "file": context.files.reference(path, place), **keys}, area)
