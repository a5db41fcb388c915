"""Caustics: where photons start and end, and whether a scene has any.

Photons start at smooth glass and mirrors with light of the lamps that light sampling knows, and end at receivers:
surfaces that scatter light widely. `kernels/pass/photons.cl` traces them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.curves import curves
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kinds import EmitterKind
from rptcam_cl.core.records import CAUSTIC_SURFACE, Kind
from rptcam_cl.plan.emitters import Emitters, triangle_emitters
from rptcam_cl.plan.primitives import Primitive
from rptcam_cl.plan.solid_lamps import SOLIDS, area_of_solid
from rptcam_cl.scene import Dielectric, Material, Matte, Mirror, Mix, Plastic, Principled, Scene, ThinGlass, has_holes

PHOTONS = "on: photons (biased: what they bring is blurred, less with more samples)"
SURFACE, RECEIVER = 1, 2  # roles of primitives
SMALL_LAMP_SR = 0.01  # a lamp that glass or a mirror sees so large is found by paths
LEAST_SHARE = 0.1  # of the lamps' light on glass and mirrors that must come from smaller ones
LEAST_VIEWS, MOST_VIEWS = 4, 64  # pieces of glass and mirrors that are asked how large they see the lamps
# Least GGX alpha of a principled receiver: the highlight of a smoother one shows what it mirrors, which photons blur.
LEAST_ALPHA = 0.04
WITHOUT_SIZE = (EmitterKind.POINT, EmitterKind.SPOT, EmitterKind.PROFILE, EmitterKind.DIRECTIONAL)

# Area of the canonical shapes [1].
_AREA = {
    Kind.SPHERE: 4 * np.pi,
    Kind.ELLIPSOID: 4 * np.pi,
    Kind.RECTANGLE: 1.0,
    Kind.DISK: np.pi,
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
        Smooth glass and mirrors; boxes as their faces, meshes as triangles.
    curve : (n,) array
        Picks among them by area.
    roles : (primitives,) array
        What each primitive is: bits of `SURFACE` and `RECEIVER`.
    """

    active: bool
    choice: str | None
    surfaces: NDArray[np.void]
    curve: NDArray[np.float32]
    roles: NDArray[np.int32]

    @property
    def facts(self) -> dict[str, int]:
        """Whether the kernels must know of photons."""
        return {"CAUSTICS": int(self.active)}


def pack_caustics(
    scene: Scene, primitives: Sequence[Primitive], first_triangles: Sequence[int], emitters: Emitters
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

    Raises
    ------
    InputError
        With ``render.caustics: on`` where objects move.
    """
    wanted = scene.render.caustics
    if wanted == "off":
        return _without(None)
    roles = np.array([_role(primitive) for primitive in primitives] or [0], np.int32)
    if reason := _nothing_to_do(roles, emitters):
        return _without(reason if "caustics" in scene.render.model_fields_set else None)
    if any(primitive.trajectory is not None for primitive in primitives):
        if wanted == "on":
            raise InputError("render.caustics: objects that move have none (allowed: off or auto, or objects at rest)")
        return _without("objects move")
    eye = np.array(scene.camera.eye) * scene.metres_per_unit
    surfaces, areas, places = _surfaces(primitives, first_triangles, roles, eye)
    if wanted == "auto" and (reason := _left_to_paths(scene, primitives, emitters, surfaces, places)):
        return _without(reason)
    curve, _ = curves(areas[None])
    return Caustics(True, PHOTONS, surfaces, curve.ravel(), roles)


def _without(reason: str | None) -> Caustics:
    choice = None if reason is None else f"off: {reason}"
    return Caustics(False, choice, CAUSTIC_SURFACE.zeros(1), np.zeros(4, np.float32), np.zeros(1, np.int32))


def _parts(material: Material) -> Sequence[Material]:
    return material.materials if isinstance(material, Mix) else (material,)


def _is_smooth(material: Material) -> bool:
    if isinstance(material, Dielectric):
        return material.alphas is None
    return isinstance(material, (Mirror, ThinGlass))


def _receives(material: Material) -> bool:
    if isinstance(material, Principled):
        roughness = material.roughness
        rough = not isinstance(roughness, float) or roughness**2 >= LEAST_ALPHA
        others = material.metallic, material.transmission
        return rough and all(not isinstance(share, float) or share < 0.5 for share in others)
    if isinstance(material, Plastic):
        return material.alphas is None or min(material.alphas) >= LEAST_ALPHA
    return isinstance(material, Matte)


def _role(primitive: Primitive) -> int:
    parts = _parts(primitive.material)
    if any(map(_receives, parts)):
        return RECEIVER
    smooth = any(map(_is_smooth, parts)) and primitive.kind is not Kind.PLANE and not has_holes(primitive.material)
    return SURFACE if smooth else 0


def _nothing_to_do(roles: NDArray[np.int32], emitters: Emitters) -> str | None:
    if not set(emitters.kinds) - {EmitterKind.ENVIRONMENT}:
        return "no lamp that light sampling knows"
    if not (roles == SURFACE).any():
        return "no smooth glass and no mirror of finite size"
    if not (roles == RECEIVER).any():
        return "no surface that scatters light widely"
    return None


def _surfaces(
    primitives: Sequence[Primitive], first_triangles: Sequence[int], roles: NDArray[np.int32], eye: NDArray[np.float64]
) -> tuple[NDArray[np.void], NDArray[np.float64], NDArray[np.float64]]:
    """Return the records of smooth glass and mirrors, their areas [m²], and of triangles the middles about the eye."""
    records, areas, places = [], [], []
    first_mesh = len(primitives) - len(first_triangles)
    for index, primitive in enumerate(primitives):
        if roles[index] != SURFACE:
            continue
        if primitive.mesh is not None:
            triangles, area = triangle_emitters(primitive.mesh, primitive.placement, eye)
            place = (triangles["a"] + (triangles["u"] + triangles["v"]) / 3)[:, :3]
            found = CAUSTIC_SURFACE.zeros(len(area))
            found["kind"], found["area"] = Kind.MESH, area
            found["triangle"] = first_triangles[index - first_mesh] + np.arange(len(area))
        else:
            found, area = _shape_surfaces(primitive)
            place = np.zeros((len(found), 3))
        found["primitive"] = index
        records.append(found)
        areas.append(area)
        places.append(place)
    return np.concatenate(records), np.concatenate(areas), np.concatenate(places)


def _shape_surfaces(primitive: Primitive) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    kind, placements = primitive.kind, [primitive.placement]
    if kind is Kind.BOX:
        kind, placements = Kind.RECTANGLE, [primitive.placement @ face for face in _FACES]
    found = CAUSTIC_SURFACE.zeros(len(placements))
    found["kind"], found["triangle"], found["area"] = kind, -1, _AREA[kind]
    for record, placement in zip(found, placements, strict=True):
        for axis, name in enumerate(("row_x", "row_y", "row_z")):
            record[name] = placement[axis]
    return found, np.array([_area_of(kind, placement[:3, :3]) for placement in placements])


def _faces() -> list[NDArray[np.float64]]:
    """Return the placements of the unit square on the six faces of the cube from -1 to 1."""
    found = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            face = np.zeros((4, 4))
            face[(axis + 1) % 3, 0] = face[(axis + 2) % 3, 1] = 2.0
            face[axis, 2] = 1.0
            face[:3, 3] = -1.0
            face[axis, 3], face[3, 3] = side, 1.0
            found.append(face)
    return found


_FACES = _faces()


def _area_of(kind: Kind, linear: NDArray[np.float64]) -> float:
    """Return the area of a canonical shape under a linear map, by its mean growth over 256 normals."""
    turn, up = np.linspace(0, 2 * np.pi, 16, endpoint=False), (np.arange(16) + 0.5) / 8 - 1
    around, z = (grid.ravel() for grid in np.meshgrid(turn, up))
    aside = {Kind.CYLINDER: np.ones_like(z), Kind.CONE: np.full_like(z, 0.5**0.5)}.get(kind, np.sqrt(1 - z * z))
    height = {Kind.CYLINDER: np.zeros_like(z), Kind.CONE: np.full_like(z, 0.5**0.5)}.get(kind, z)
    normals = np.stack([aside * np.cos(around), aside * np.sin(around), height], axis=1)
    if kind in (Kind.RECTANGLE, Kind.DISK):
        normals = np.array([[0.0, 0.0, 1.0]])
    x, y, z_row = linear
    cofactors = np.array([np.cross(y, z_row), np.cross(z_row, x), np.cross(x, y)])
    return float(_AREA[kind] * np.linalg.norm(normals @ cofactors.T, axis=1).mean())


def _left_to_paths(
    scene: Scene,
    primitives: Sequence[Primitive],
    emitters: Emitters,
    surfaces: NDArray[np.void],
    places: NDArray[np.float64],
) -> str | None:
    """Return why `auto` leaves the light of glass and mirrors to paths, None where photons are worth their cost."""
    if scene.shutter.keys:
        return "keys move while the shutter is open"
    if scene.render.clamp is not None:
        return "render.clamp takes away what paths find seldom"
    records = emitters.records[: emitters.count]
    if np.isin(records["kind"], WITHOUT_SIZE).any():
        return None
    share = _share_of_small_lamps(primitives, records[records["kind"] != EmitterKind.ENVIRONMENT], surfaces, places)
    if share >= LEAST_SHARE:
        return None
    return f"paths find the lamps: those below {SMALL_LAMP_SR} sr bring {share:.0%} of their light to glass and mirrors"


def _share_of_small_lamps(
    primitives: Sequence[Primitive], lamps: NDArray[np.void], surfaces: NDArray[np.void], places: NDArray[np.float64]
) -> float:
    """Return how much of the lamps' irradiance on glass and mirrors comes from lamps that are seen small from there."""
    suns = lamps["kind"] == EmitterKind.SUN
    _, lamp = np.unique(np.where(suns, -1 - np.arange(len(lamps)), lamps["primitive"]), return_inverse=True)
    size = _sizes(primitives, lamps)
    corner = np.isin(lamps["kind"], (EmitterKind.RECTANGLE, EmitterKind.TRIANGLE))
    middle = np.where(lamps["kind"] == EmitterKind.TRIANGLE, 1 / 3, 0.5 * corner)[:, None]
    centres = (lamps["a"] + middle * (lamps["u"] + lamps["v"]))[:, :3].astype(np.float64)
    brightness = luminance(lamps["radiance"][:, :3].astype(np.float64))
    small = every = 0.0
    views = int(np.clip(10**6 // len(lamps), LEAST_VIEWS, MOST_VIEWS))
    for k in np.unique(np.linspace(0, len(surfaces) - 1, views).astype(int)):
        nearest = places[k] if surfaces[k]["kind"] == Kind.MESH else _nearest(surfaces[k], centres)
        distance2 = ((nearest - centres) ** 2).sum(axis=1)
        angle = np.minimum(size / np.where(suns, 1.0, np.maximum(distance2, 1e-12)), 2 * np.pi)
        whole = np.bincount(lamp, angle)
        light = np.bincount(lamp, angle * brightness)
        small, every = small + light[whole < SMALL_LAMP_SR].sum(), every + light.sum()
    return float(small / every) if every > 0 else 0.0


def _sizes(primitives: Sequence[Primitive], lamps: NDArray[np.void]) -> NDArray[np.float64]:
    """Return the area that lamps show [m²]; of suns their solid angle [sr]."""
    kinds, extents = lamps["kind"], lamps["a"][:, 3].astype(np.float64)
    sizes = np.where(np.isin(kinds, (EmitterKind.SPHERE, EmitterKind.SUN)), np.pi * extents, extents)
    sizes = np.where(kinds == EmitterKind.SPHERE, sizes * extents, sizes)
    for k in np.flatnonzero(np.isin(kinds, list(SOLIDS.values()))):
        solid = primitives[int(lamps["primitive"][k])]
        sizes[k] = area_of_solid(solid.kind, solid.placement[:3, :3]) / 4  # what a convex body shows on average
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
