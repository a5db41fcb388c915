"""Caustics: whether a scene has any that photons bring, and where these start and end.

Photons start at smooth glass and mirrors with light of the lamps that light sampling knows, and end at receivers:
surfaces that scatter light widely. `rendering/photon_map.py` has them traced. Light samples follow what lies behind
clear glass where there are no photons.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import records as layout
from rptcam_cl.core.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import CAUSTIC_SURFACE, EmitterKind, Kind
from rptcam_cl.rendering.plan.emitters import SOLIDS, Emitters, area_of_solid, triangle_emitters
from rptcam_cl.rendering.plan.primitives import Primitive, Primitives, Prototype
from rptcam_cl.scene import materials
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]

# Whether a scene has caustics, and where their photons start and end.

_ON = "on: photons (biased: what they bring is blurred, less with more samples)"
_SURFACE, _RECEIVER, _STRAIGHT = 1, 2, 4  # roles of primitives
_SMALL_LAMP_SR = 0.01  # a lamp that glass or a mirror sees so large is found by paths
_LEAST_SHARE = 0.1  # of the lamps' light on glass and mirrors that must come from smaller ones
_LEAST_VIEWS, _MOST_VIEWS = 4, 64  # pieces of glass and mirrors that are asked how large they see the lamps
# Least GGX alpha of a principled receiver: the highlight of a smoother one shows what it mirrors, which photons blur.
_LEAST_ALPHA = 0.04
# Shapes are divided into about so many pieces in all, by area, and each of them into so many at least and at most.
_PIECES, _PIECES_OF_A_SHAPE = 2048, (16, 512)
_CELLS = 8  # of a mesh's box along each axis, whose triangles learn together by what they face
WITHOUT_SIZE = (*layout.SIZELESS_EMITTERS, EmitterKind.DIRECTIONAL)

# Area of the canonical shapes [1].
_AREA = {
    Kind.SPHERE: 4 * np.pi,
    Kind.ELLIPSOID: 4 * np.pi,
    Kind.RECTANGLE: 1.0,
    Kind.DISK: np.pi,
    Kind.PLANE: np.pi,  # of which half of the starts lie within 1 of the origin, see kernels/caustics/surface.h
    Kind.CYLINDER: 2 * np.pi,
    Kind.CONE: np.sqrt(2) * np.pi,
}


@dataclass(frozen=True)
class Caustics:
    """Where photons start and end.

    Attributes
    ----------
    active : bool
        Whether photons are traced.
    choice : str or None
        What was decided and why; None where the scene leaves it off, or has none and does not ask.
    surfaces : array of CausticSurface
        Smooth glass and mirrors: meshes as triangles, other shapes in pieces.
    areas : (n,) array
        Of them [m²].
    regions : (n,) array
        Numbers of the regions that learn together how much light they send on.
    roles : (primitives,) array
        What each primitive is: bits of `_SURFACE`, `_RECEIVER` and, where light samples follow light that passes it
        straight to the lamps, `_STRAIGHT`.
    """

    active: bool
    choice: str | None
    surfaces: NDArray[np.void]
    areas: Array
    regions: NDArray[np.int64]
    roles: NDArray[np.int32]

    @property
    def facts(self) -> dict[str, int]:
        """Whether the kernels must know of photons."""
        passed = self.active and bool((self.roles & _STRAIGHT).any())
        return {"CAUSTICS": int(self.active), "PANES_BY_SAMPLES": int(passed)}


def pack_caustics(
    scene: Scene,
    primitives: Primitives,
    first_triangles: NDArray[np.int32],
    emitters: Emitters,
    eye: Array,
    *,
    has_media: bool,
    follows_glass: bool,
) -> Caustics:
    """Return the caustics of a scene, inactive where it has none or leaves them off.

    Parameters
    ----------
    scene
        The scene; ``render.caustics`` says what is wanted.
    primitives
        Its primitives, meshes last.
    first_triangles
        Of those that are meshes, in their order.
    emitters
        The lamps that light sampling chooses from.
    eye
        (3,), where the camera stands [m].
    has_media
        Whether fog and its like leave less of a photon's light, for which photons do not know how.
    follows_glass
        Whether light samples follow clear glass to the lamps. What thin glass lets pass straight is left to them then.

    Raises
    ------
    InputError
        With ``render.caustics: on`` where objects move.
    """
    wanted = scene.render.caustics
    if wanted == "off":
        return without_caustics(None)
    roles = primitives.of_each(lambda each: 0 if each.hidden else _role(each))
    if reason := _nothing_to_do(roles, emitters):
        return without_caustics(reason if "caustics" in scene.render.model_fields_set else None)
    if any(each.trajectory is not None for each in primitives.prototypes):
        if wanted == "on":
            raise InputError("render.caustics: objects that move have none (allowed: off or auto, or objects at rest)")
        return without_caustics("objects move")
    if has_media:
        return without_caustics("media such as fog")
    if "lights" in scene.render.layers:
        if wanted == "on":
            raise InputError(
                "render.layers: lights: photons do not know their lamp (allowed: render.caustics off or auto)"
            )
        return without_caustics("the layer lights, as photons do not know their lamp")
    surfaces, areas, places, normals = surfaces_of(primitives, first_triangles, roles == _SURFACE, eye)
    if wanted == "auto" and (reason := _left_to_paths(scene, primitives, emitters, roles, surfaces, places, eye)):
        return without_caustics(reason)
    if follows_glass and set(emitters.kinds) <= set(_FOLLOWED):
        roles |= primitives.of_each(lambda each: _STRAIGHT * isinstance(each.material, materials.ThinGlass)) * roles
    return Caustics(True, _ON, *_in_regions(surfaces, areas, places, normals), roles)


def without_caustics(reason: str | None) -> Caustics:
    """Make inactive caustics; the reason is what the metadata say, None for nothing."""
    choice = None if reason is None else f"off: {reason}"
    return Caustics(False, choice, CAUSTIC_SURFACE.zeros(1), np.ones(1), np.zeros(1, int), np.zeros(1, np.int32))


def _is_smooth(material: materials.Material) -> bool:
    if isinstance(material, materials.Dielectric):
        return material.alphas is None
    return isinstance(material, (materials.Mirror, materials.ThinGlass))


def _receives(material: materials.Material) -> bool:
    if isinstance(material, materials.Principled):
        roughness = material.roughness
        rough = not isinstance(roughness, float) or roughness**2 >= _LEAST_ALPHA
        others = material.metallic, material.transmission
        return rough and all(not isinstance(share, float) or share < 0.5 for share in others)
    if isinstance(material, materials.Plastic):
        return material.alphas is None or min(material.alphas) >= _LEAST_ALPHA
    return isinstance(material, materials.Matte | materials.Translucent)


def _role(prototype: Prototype) -> int:
    material = prototype.material
    parts: Sequence[materials.Material] = material.materials if isinstance(material, materials.Mix) else (material,)
    if any(map(_receives, parts)):
        return _RECEIVER
    smooth = any(map(_is_smooth, parts)) and prototype.kind is not Kind.PLANE and not materials.has_holes(material)
    return _SURFACE if smooth else 0


# What lies behind clear glass: light samples follow it to the lamps, where paths would find them by chance alone.

_AFAR = (EmitterKind.SUN, EmitterKind.ENVIRONMENT)
_FOLLOWED = (EmitterKind.SPHERE, EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE, *_AFAR)
_MOST_LAMPS = 64  # the most likely ones, that are looked for within glass
_THIN = 0.1  # of the next side of a box of glass: a pane
_CUBE, _TUBE, _SQUARE = ((-1, -1, -1), (1, 1, 1)), ((-1, -1, 0), (1, 1, 1)), ((-1, -1, 0), (1, 1, 0))
# Boxes about the canonical shapes.
BOXES = {Kind.SPHERE: _CUBE, Kind.ELLIPSOID: _CUBE, Kind.BOX: _CUBE, Kind.CYLINDER: _TUBE, Kind.CONE: _TUBE}
BOXES |= {Kind.RECTANGLE: ((0, 0, 0), (1, 1, 0)), Kind.DISK: _SQUARE}


def _glass_bodies(primitives: Primitives, eye: Array) -> Iterator[tuple[Array, Array, Array, NDArray[np.int64]]]:
    """Yield bodies of clear glass: world to canonical shape (n, 4, 4), ends of its box, axis across panes (else -1)."""
    glass = primitives.chosen(primitives.runs_of(_is_glass_body))
    boxes = np.array([BOXES[each.kind] if each.mesh is None else each.mesh.bounds() for each in glass.prototypes])
    for _, runs, placements in glass.places.blocks():
        low, high = boxes[glass.prototype_of[runs]].transpose(1, 0, 2)
        sides = (high - low) * np.linalg.norm(placements[:, :3, :3], axis=1)
        least, next_one, _ = np.sort(sides, axis=1).T
        inverse = np.linalg.inv(placements).astype(np.float64)
        of_meshes = np.where(glass.kinds[runs] == Kind.MESH, 1.0, 0.0)[:, None] * eye  # they stand about the scene
        inverse[:, :3, 3] += (inverse[:, :3, :3] @ of_meshes[:, :, None])[..., 0]
        yield inverse, low, high, np.where(least < _THIN * next_one, sides.argmin(axis=1), -1)


def stand_behind_glass(primitives: Primitives, emitters: Emitters, eye: Array) -> bool:
    """Return whether lamps stand within clear glass, by the box about it, or there are panes of it."""
    lamps = emitters.shining[np.isin(emitters.shining["kind"], _FOLLOWED)]
    mixes = [each.material for each in primitives.prototypes if isinstance(each.material, materials.Mix)]
    if not len(lamps) or any(is_clear(part) for mix in mixes for part in mix.materials):
        return False
    near = lamps[~np.isin(lamps["kind"], _AFAR)]
    places = near["a"][np.argsort(-near["pick"], kind="stable")[:_MOST_LAMPS], :3].astype(np.float64)
    for inverse, low, high, across in _glass_bodies(primitives, eye):
        within = places @ np.swapaxes(inverse[:, :3, :3], 1, 2) + inverse[:, None, :3, 3]
        inside = (within > low[:, None]) & (within < high[:, None])
        if inside.all(axis=2).any() or (across >= 0).any():
            return True
    return False


def _lies_behind_panes(primitives: Primitives, roles: NDArray[np.int32], lamps: NDArray[np.void], eye: Array) -> bool:
    """Return whether panes are all glass and mirrors that there are, and the eye is where none mirrors a lamp to."""
    is_sun, panes = lamps["kind"] == EmitterKind.SUN, 0
    towards = np.where(is_sun[:, None], lamps["normal"][:, :3], lamp_centres(lamps))
    for inverse, low, high, across in _glass_bodies(primitives, eye):
        each = np.arange(len(across))
        eye_side = inverse[each, across, 3] - (low + high)[each, across] / 2
        lamp_side = towards @ inverse[each, across, :3].T + np.where(is_sun[:, None], 0.0, eye_side)
        if (across < 0).any() or (eye_side * lamp_side >= 0).any():
            return False
        panes += len(across)
    return panes == np.count_nonzero(roles == _SURFACE)


def _is_glass_body(prototype: Prototype) -> bool:
    is_flat = prototype.kind in (Kind.RECTANGLE, Kind.DISK)  # of solid glass one face of something
    known = prototype.mesh is not None or prototype.kind in BOXES
    return known and (
        isinstance(prototype.material, materials.ThinGlass) or (is_clear(prototype.material) and not is_flat)
    )


def is_clear(material: materials.Material) -> bool:
    """Return whether it is smooth glass."""
    return _is_smooth(material) and not isinstance(material, materials.Mirror)


def _nothing_to_do(roles: NDArray[np.int32], emitters: Emitters) -> str | None:
    if not set(emitters.kinds) - {EmitterKind.ENVIRONMENT}:
        return "no lamp that light sampling knows"
    if not (roles == _SURFACE).any():
        return "no smooth glass and no mirror of finite size"
    if not (roles == _RECEIVER).any():
        return "no surface that scatters light widely"
    return None


def surfaces_of(
    primitives: Primitives,
    first_triangles: NDArray[np.int32],
    chosen: NDArray[np.bool_],
    eye: NDArray[np.float64],
) -> tuple[NDArray[np.void], Array, Array, Array]:
    """Return the records of chosen primitives, their areas [m²], and of triangles middles about the eye and normals."""
    records, areas, places, normals = [], [], [], []
    first_mesh = len(primitives) - len(first_triangles)
    for index in np.flatnonzero(chosen).tolist():
        primitive = primitives[index]
        if primitive.mesh is not None:
            triangles, area = triangle_emitters(primitive.mesh, primitive.placement, eye)
            place = (triangles["a"] + (triangles["u"] + triangles["v"]) / 3)[:, :3]
            own = CAUSTIC_SURFACE.zeros(len(area))
            own["kind"], own["area"] = Kind.MESH, area
            own["triangle"] = first_triangles[index - first_mesh] + np.arange(len(area))
            normal = triangles["normal"][:, :3]
        else:
            own, area = shape_surfaces(primitive)
            place = normal = np.zeros((len(own), 3))
        own["primitive"] = index
        records.append(own)
        areas.append(area)
        places.append(place)
        normals.append(normal)
    return np.concatenate(records), np.concatenate(areas), np.concatenate(places), np.concatenate(normals)


def divided(
    surfaces: NDArray[np.void], areas: Array, counts: NDArray[Any]
) -> tuple[NDArray[np.void], Array, NDArray[np.int64]]:
    """Divide shapes into about so many pieces each (n,), triangles into one.

    Returns the pieces, their areas [m²], and the numbers of the shapes that they are of.
    """
    rows = np.stack([surfaces[name] for name in ("row_x", "row_y", "row_z")], axis=1).astype(np.float64)
    length, width = np.linalg.norm(rows[:, :, :2], axis=1).T
    wide = np.where(surfaces["kind"] == Kind.RECTANGLE, length / np.maximum(width, 1e-300), 2.0)
    counts = np.where(surfaces["kind"] == Kind.MESH, 1, np.maximum(counts, 1))
    along = np.clip(np.round(np.sqrt(counts * wide)), 1, np.ceil(counts)).astype(int)
    across = np.maximum(np.round(counts / along), 1).astype(int)
    numbers = along * across
    of = np.repeat(np.arange(len(surfaces)), numbers)
    number = np.arange(len(of)) - np.repeat(np.cumsum(numbers) - numbers, numbers)
    along, across, pieces = along[of], across[of], surfaces[of]
    pieces["piece"] = np.stack([number % along / along, number // along / across, 1 / along, 1 / across], axis=1)
    pieces["area"] = np.where(pieces["kind"] == Kind.MESH, pieces["area"], pieces["area"] / numbers[of])
    return pieces, areas[of] / numbers[of], of


def _in_regions(
    surfaces: NDArray[np.void], areas: Array, places: Array, normals: Array
) -> tuple[NDArray[np.void], Array, NDArray[np.int64]]:
    """Divide shapes into pieces; return all surfaces, their areas and their regions: each piece is one."""
    few, many = _PIECES_OF_A_SHAPE if len(surfaces) < _PIECES else (1, 1)
    pieces, areas, of = divided(surfaces, areas, np.clip(_PIECES * areas / areas.sum(), few, many))
    cells = _cells_of_meshes(surfaces, places, normals)[of]
    regions = np.where(pieces["kind"] == Kind.MESH, cells, -1 - np.arange(len(of)))
    return pieces, areas, np.unique(regions, return_inverse=True)[1]


def _cells_of_meshes(surfaces: NDArray[np.void], places: Array, normals: Array) -> NDArray[np.int64]:
    """Return of triangles the numbers of the cells of their mesh's box that they lie in, by what they face."""
    first = np.flatnonzero(np.diff(surfaces["primitive"], prepend=-1))  # of each primitive
    of = np.repeat(np.arange(len(first)), np.diff(first, append=len(surfaces)))
    low, high = np.minimum.reduceat(places, first)[of], np.maximum.reduceat(places, first)[of]
    x, y, z = (_CELLS * 0.999 * (places - low) / np.maximum(high - low, 1e-12)).astype(np.int64).T
    facing = (normals > 0) @ np.array([1, 2, 4])
    return np.asarray((((of * 8 + facing) * _CELLS + z) * _CELLS + y) * _CELLS + x)


def shape_surfaces(primitive: Primitive) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """Return the records of a shape, six of a box, and their areas [m²]."""
    kind, placements = primitive.kind, [primitive.placement]
    if kind is Kind.BOX:
        kind, placements = Kind.RECTANGLE, [primitive.placement @ face for face in _FACES]
    records, rows = CAUSTIC_SURFACE.zeros(len(placements)), np.array(placements)
    row_x, row_y, row_z, _ = np.moveaxis(rows, 1, 0)
    layout.fill(records, kind=kind, triangle=-1, area=_AREA[kind], row_x=row_x, row_y=row_y, row_z=row_z)
    return records, _areas_of(kind, rows[:, :3, :3])


def _cube_faces() -> list[NDArray[np.float64]]:
    """Return the placements of the unit square on the six faces of the cube from -1 to 1."""
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.zeros((4, 4))
            face[(axis + 1) % 3, 0] = face[(axis + 2) % 3, 1] = 2.0
            face[axis, 2] = 1.0
            face[:3, 3] = -1.0
            face[axis, 3], face[3, 3] = side, 1.0
            faces.append(face)
    return faces


_FACES = _cube_faces()


def _areas_of(kind: Kind, linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the areas of a canonical shape under linear maps (n, 3, 3), by its mean growth over its normals."""
    cofactors = np.cross(linear[:, [1, 2, 0]], linear[:, [2, 0, 1]])
    growth = np.linalg.norm(_normals_of(kind) @ cofactors.swapaxes(1, 2), axis=2)
    return np.asarray(_AREA[kind] * growth.mean(axis=1))


@cache
def _normals_of(kind: Kind) -> NDArray[np.float64]:
    """Return those of a canonical shape: one of a flat shape, 256 of another."""
    if kind in (Kind.RECTANGLE, Kind.DISK, Kind.PLANE):
        return np.array([[0.0, 0.0, 1.0]])
    turn, up = np.linspace(0, 2 * np.pi, 16, endpoint=False), (np.arange(16) + 0.5) / 8 - 1
    around, z = (grid.ravel() for grid in np.meshgrid(turn, up))
    aside = {Kind.CYLINDER: np.ones_like(z), Kind.CONE: np.full_like(z, 0.5**0.5)}.get(kind, np.sqrt(1 - z * z))
    height = {Kind.CYLINDER: np.zeros_like(z), Kind.CONE: np.full_like(z, 0.5**0.5)}.get(kind, z)
    return np.stack([aside * np.cos(around), aside * np.sin(around), height], axis=1)


def _left_to_paths(
    scene: Scene,
    primitives: Primitives,
    emitters: Emitters,
    roles: NDArray[np.int32],
    surfaces: NDArray[np.void],
    places: NDArray[np.float64],
    eye: Array,
) -> str | None:
    """Return why `auto` leaves the light of glass and mirrors to paths, None where photons are worth their cost."""
    if scene.shutter.keys:
        return "keys move while the shutter is open"
    if scene.render.clamp is not None:
        return "render.clamp takes away what paths find seldom"
    records = emitters.records[: emitters.count]
    if np.isin(records["kind"], WITHOUT_SIZE).any():
        return None
    lamps = records[records["kind"] != EmitterKind.ENVIRONMENT]
    is_sun = lamps["kind"] == EmitterKind.SUN
    if np.isin(lamps["kind"], _FOLLOWED).all() and _lies_behind_panes(primitives, roles, lamps, eye):
        return f"light samples find the {'sun' if is_sun.all() else 'lamps'} through the panes"
    share = _share_of_small_lamps(primitives, lamps, surfaces, places)
    if share >= _LEAST_SHARE:
        return None
    return (
        f"paths find the lamps: those below {_SMALL_LAMP_SR} sr bring {share:.0%} of their light to glass and mirrors"
    )


def _share_of_small_lamps(
    primitives: Primitives, lamps: NDArray[np.void], surfaces: NDArray[np.void], places: NDArray[np.float64]
) -> float:
    """How much of the lamps' irradiance on glass and mirrors comes from lamps that are seen small from there."""
    suns = lamps["kind"] == EmitterKind.SUN
    lamp = np.where(suns, np.arange(len(lamps)), len(lamps) + lamps["primitive"])
    size = lamp_sizes(primitives, lamps)
    centres = lamp_centres(lamps)
    brightness = luminance(lamps["radiance"][:, :3].astype(np.float64))
    small = every = 0.0
    views = int(np.clip(10**6 // len(lamps), _LEAST_VIEWS, _MOST_VIEWS))
    for k in sorted(set(np.linspace(0, len(surfaces) - 1, views).astype(int).tolist())):
        nearest = places[k] if surfaces[k]["kind"] == Kind.MESH else _nearest(surfaces[k], centres)
        distance2 = ((nearest - centres) ** 2).sum(axis=1)
        angle = np.minimum(size / np.where(suns, 1.0, np.maximum(distance2, 1e-12)), 2 * np.pi)
        whole = np.bincount(lamp, angle)
        light = np.bincount(lamp, angle * brightness)
        small, every = small + light[whole < _SMALL_LAMP_SR].sum(), every + light.sum()
    return float(small / every) if every > 0 else 0.0


def lamp_centres(lamps: NDArray[np.void]) -> Array:
    """Return the middles of lamps, (n, 3) [m]."""
    corner = np.isin(lamps["kind"], (EmitterKind.RECTANGLE, EmitterKind.TRIANGLE))
    middle = np.where(lamps["kind"] == EmitterKind.TRIANGLE, 1 / 3, 0.5 * corner)[:, None]
    return np.asarray((lamps["a"] + middle * (lamps["u"] + lamps["v"]))[:, :3], np.float64)


def lamp_sizes(primitives: Primitives, lamps: NDArray[np.void]) -> NDArray[np.float64]:
    """Return the area that lamps show [m²]; of suns their solid angle [sr]."""
    kinds, extents = lamps["kind"], lamps["a"][:, 3].astype(np.float64)
    sizes = np.where(np.isin(kinds, (EmitterKind.SPHERE, EmitterKind.SUN)), np.pi * extents, extents)
    sizes = np.where(kinds == EmitterKind.SPHERE, sizes * extents, sizes)
    solids = np.flatnonzero(np.isin(kinds, list(SOLIDS.values())))
    lamp_of = dict(zip(lamps["primitive"][solids].tolist(), solids.tolist(), strict=True))
    for index, lamp in lamp_of.items():
        solid = primitives[index]
        sizes[lamp] = area_of_solid(solid.kind, solid.placement[:3, :3]) / 4  # what a convex body shows on average
    return sizes


def _nearest(surface: np.void, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the points of a shape near to points (n, 3): the nearest ones where it is not stretched."""
    placement = np.array([surface[name] for name in ("row_x", "row_y", "row_z")], np.float64)
    x, y, z = (np.linalg.pinv(placement[:, :3]) @ (points - placement[:, 3]).T).astype(np.float64)
    kind, radius = surface["kind"], np.maximum(np.hypot(x, y), 1e-12)
    if kind == Kind.RECTANGLE:
        inside = np.stack([np.clip(x, 0, 1), np.clip(y, 0, 1), 0 * z])
    elif kind == Kind.DISK:
        inside = np.stack([x, y, 0 * z]) / np.maximum(radius, 1)
    elif kind == Kind.CYLINDER:
        inside = np.stack([x / radius, y / radius, np.clip(z, 0, 1)])
    elif kind == Kind.CONE:
        height = np.clip(z, 0, 1)
        inside = np.stack([(1 - height) * x / radius, (1 - height) * y / radius, height])
    else:
        assert kind in (Kind.SPHERE, Kind.ELLIPSOID), kind
        inside = np.stack([x, y, z]) / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-12)
    return np.asarray((placement[:, :3] @ inside).T + placement[:, 3])
