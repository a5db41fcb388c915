"""What light sampling can choose: lamps of every shape, emissive meshes, lights, and a picture around the scene.

Emissive planes, insides of solids, what moves and what has holes shine as well, but only BSDF sampling finds them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.curves import curves
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import EmitterKind, EnvironmentKind
from rptcam_cl.core.records import EMITTER, Kind
from rptcam_cl.core.vectors import cross
from rptcam_cl.plan.environment import Surroundings
from rptcam_cl.plan.light_tree import BREAK_EVEN, FROM_AFAR, Lamps, LightTree, lamps_of, light_tree, variance_by_power
from rptcam_cl.plan.lights import light_emitter, sun_emitter
from rptcam_cl.plan.lit_points import lit_points
from rptcam_cl.plan.meshes import Mesh, corners_of_box
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.plan.primitives import Primitive, sphere_of
from rptcam_cl.plan.solid_lamps import SOLIDS, area_of_solid, fill_solid
from rptcam_cl.plan.textures import TextureTable
from rptcam_cl.scene import LARGEST_RADIANCE, Colour, Emissive, Material, Principled, Scene, Texture, has_holes


def triangle_emitters(
    mesh: Mesh, placement: NDArray[np.float64], eye: NDArray[np.float64]
) -> tuple[NDArray[np.void], NDArray[np.float64]]:
    """Return emitter records of a mesh's triangles, without radiance and indices, and their areas [m²].

    Parameters
    ----------
    mesh
        The triangles.
    placement
        (4, 4), the scene in metres from the mesh's frame.
    eye
        What becomes the origin [m].
    """
    linear = placement[:3, :3]
    points = (mesh.positions + mesh.origin) @ linear.T + (placement[:3, 3] - eye)
    a, b, c = (points[mesh.faces[:, corner]] for corner in range(3))
    u, v = b - a, c - a
    normal = np.cross(u, v) * np.sign(np.linalg.det(linear))
    if mesh.normals is not None:  # they say which side is out
        shown = mesh.normals[mesh.faces].sum(axis=1) @ np.linalg.inv(linear)
        normal *= np.where((normal * shown).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    double_area = np.linalg.norm(normal, axis=1)
    records = EMITTER.zeros(len(mesh.faces))
    records["kind"] = EmitterKind.TRIANGLE
    records["a"][:, :3], records["a"][:, 3] = a, double_area / 2
    records["u"][:, :3], records["v"][:, :3] = u, v
    if mesh.uvs is not None:
        corner, first, second = (mesh.uvs[mesh.faces[:, index]] for index in range(3))
        records["uv"][:, :2], records["uv_x"][:, :2], records["uv_y"][:, :2] = corner, first - corner, second - corner
    records["normal"][:, :3] = normal / np.maximum(double_area, np.finfo(np.float64).tiny)[:, None]
    return records, double_area / 2


Found = tuple[NDArray[np.void], NDArray[np.float64]]


@dataclass(frozen=True)
class Emitters:
    """Records, the sampled emitter of each primitive, the kinds there are, the curve that picks by power, the tree
    that picks instead where there are many lamps, and whether lamps may be so far away that rays end before them."""

    records: NDArray[np.void]
    of_primitive: dict[int, int]
    kinds: frozenset[EmitterKind]
    count: int
    curve: NDArray[np.float32]
    tree: LightTree | None = None
    tiny: bool = False

    @property
    def facts(self) -> dict[str, int]:
        """Which kinds of emitter the kernels must know."""
        painted = self.records["texture"] >= 0
        flats = {EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE}
        return {
            "HAS_EMITTERS": int(self.count > 0),
            "ONE_EMITTER": int(self.count == 1),
            "LIGHT_TREE": int(self.tree is not None),
            "TINY_LAMPS": int(self.tiny),
            "EMITTER_FLATS": int(bool(self.kinds & flats)),
            "EMITTER_TRIANGLES": int(EmitterKind.TRIANGLE in self.kinds),
            "EMITTER_DISKS": int(EmitterKind.DISK in self.kinds),
            "EMITTER_SPHERES": int(EmitterKind.SPHERE in self.kinds),
            "EMITTER_SOLIDS": int(bool(self.kinds & set(SOLIDS.values()))),
            "EMITTER_BOXES": int(EmitterKind.BOX in self.kinds),
            "EMITTER_ELLIPSOIDS": int(EmitterKind.ELLIPSOID in self.kinds),
            "EMITTER_CYLINDERS": int(EmitterKind.CYLINDER in self.kinds),
            "EMITTER_CONES": int(EmitterKind.CONE in self.kinds),
            "EMITTER_POINTS": int(EmitterKind.POINT in self.kinds),
            "EMITTER_SPOTS": int(EmitterKind.SPOT in self.kinds),
            "EMITTER_PROFILES": int(EmitterKind.PROFILE in self.kinds),
            "EMITTER_DIRECTIONS": int(EmitterKind.DIRECTIONAL in self.kinds),
            "EMITTER_TEXTURES": int((painted & (self.records["primitive"] >= 0))[: self.count].any()),
            "EMITTER_SUNS": int(EmitterKind.SUN in self.kinds),
            "ENVIRONMENT_SAMPLED": int(EmitterKind.ENVIRONMENT in self.kinds),
        }


def _flat(primitive: Primitive, record: np.void) -> float:
    """Fill in a rectangle or a disk; return its area."""
    disk = primitive.kind is Kind.DISK
    x, y, _, origin = primitive.placement[:3].T
    area = float(np.linalg.norm(cross(x, y))) * (np.pi if disk else 1.0)
    normal = np.linalg.inv(primitive.placement)[2, :3]
    record["kind"] = EmitterKind.DISK if disk else EmitterKind.RECTANGLE
    record["a"] = (*origin, area)
    record["u"][:3], record["v"][:3], record["normal"][:3] = x, y, normal / np.linalg.norm(normal)
    record["uv_x"][:2], record["uv_y"][:2] = (1, 0), (0, 1)
    return area


def _sphere(primitive: Primitive, record: np.void) -> float:
    """Fill in a sphere; return its area."""
    center, radius = sphere_of(primitive.placement)
    record["kind"] = EmitterKind.SPHERE
    record["a"] = (*center, radius)
    axes = primitive.placement[:3, :3] / radius
    record["u"][:3], record["v"][:3], record["uv"][2] = axes[:, 0], axes[:, 2], np.sign(np.linalg.det(axes))
    return 4 * np.pi * radius**2


def _solid(primitive: Primitive, record: np.void) -> float:
    """Fill in a solid; return its area."""
    fill_solid(record, primitive.kind, primitive.placement)
    return area_of_solid(primitive.kind, primitive.placement[:3, :3])


_BRIGHTEST_AFAR = 1e30  # over the lamps near by, of which nothing is to be seen then; sums of it are float32 still
_TINY_ANGLE = 1e-4  # as in kernels/light/emitters.h
_SAMPLED = {Kind.RECTANGLE: _flat, Kind.DISK: _flat, Kind.SPHERE: _sphere, **dict.fromkeys(SOLIDS, _solid)}


@dataclass(frozen=True)
class Glow:
    """What a material emits: radiance, mean over a texture; the texture's index or -1; whether the back shines; the
    number of its spectrum."""

    radiance: NDArray[np.float64]
    texture: int
    two_sided: bool
    number: int

    @property
    def strength(self) -> float:
        """Radiance times sides [W/(m² sr), luminance]."""
        return float(luminance(self.radiance)) * (2 if self.two_sided else 1)

    def fill(self, records: NDArray[np.void] | np.void) -> None:
        """Write it into records."""
        records["radiance"][..., :3] = self.radiance
        records["radiance"][..., 3] = self.number
        records["texture"], records["two_sided"] = self.texture, self.two_sided


def glow_of(material: Material, textures: TextureTable, spectra: KnownSpectra) -> Glow:
    """Return what a material emits; its texture and its spectrum are entered."""
    emitted: Texture | Colour = (0.0, 0.0, 0.0)
    two_sided = False
    if isinstance(material, Emissive):
        emitted, two_sided = material.radiance, material.two_sided
    elif isinstance(material, Principled):
        emitted = material.emission
    colour, texture = textures.slot(emitted, limit=LARGEST_RADIANCE)
    number = spectra.number(emitted, light=True)
    return Glow(np.array(colour) if texture < 0 else textures.mean(texture), texture, two_sided, number)


def _surface_emitter(index: int, primitive: Primitive, glow: Glow) -> Found | None:
    """Return record and power [W, luminance] of an emissive primitive, or None when it is not sampled."""
    if primitive.kind not in _SAMPLED or glow.strength <= 0:
        return None
    record: np.void = EMITTER.zeros(1)[0]
    area = _SAMPLED[primitive.kind](primitive, record)
    glow.fill(record)
    record["primitive"], record["triangle"] = index, -1
    return np.array([record], EMITTER.dtype), np.array([np.pi * area * glow.strength])


def _mesh_emitters(
    index: int, primitive: Primitive, first_triangle: int, eye: NDArray[np.float64], glow: Glow
) -> Found | None:
    """Return records and powers [W, luminance] of the triangles of an emissive mesh, or None when it does not shine."""
    if primitive.mesh is None or glow.strength <= 0:
        return None
    records, areas = triangle_emitters(primitive.mesh, primitive.placement, eye)
    glow.fill(records)
    records["primitive"] = index
    records["triangle"] = first_triangle + np.arange(len(records))
    return records, np.pi * areas * glow.strength


def _scene_reach(primitives: list[Primitive], eye: NDArray[np.float64]) -> float:
    """Return a radius about the eye that holds all bounded primitives [m]."""
    placements = [each.placement[:3] for each in primitives if each.mesh is None and each.kind is not Kind.PLANE]
    reach = float(np.linalg.norm(placements, ord=2, axis=(1, 2)).max()) if placements else 0.0
    for primitive in primitives:
        if primitive.mesh is not None:
            corners = corners_of_box(*primitive.mesh.bounds(), primitive.placement)
            reach = max(reach, float(np.linalg.norm(corners - eye, axis=1).max()))
    return reach or 1.0


def _has_tiny(records: NDArray[np.void], primitives: list[Primitive], eye: NDArray[np.float64]) -> bool:
    """Return whether one of several lamps may be seen at an angle below which kernels end rays before it."""
    pieces = records[records["primitive"] >= 0]
    if len(pieces) < 2:
        return False
    extents = pieces["a"][:, 3].astype(np.float64)
    sizes = np.where(pieces["kind"] >= EmitterKind.BOX, extents, np.sqrt(extents))
    ends = (pieces["kind"] != EmitterKind.SPHERE) & (pieces["two_sided"] == 0)
    return bool((sizes[ends] < _TINY_ANGLE * 2 * _scene_reach(primitives, eye)).any())


def pack_emitters(
    scene: Scene,
    primitives: list[Primitive],
    first_triangles: Sequence[int],
    textures: TextureTable,
    spectra: KnownSpectra,
    surroundings: Surroundings,
) -> Emitters:
    """Return the emitters that light sampling chooses from: by a tree where there are many lamps, else by their power.

    Suns come last. Writes into the record of the surroundings where they stand, and the environment.

    Parameters
    ----------
    scene
        The scene.
    primitives
        Its primitives, sorted by kind.
    first_triangles
        Of those that are meshes, in their order.
    textures
        Has the textures of lamps; takes the pictures of measured luminaires.
    spectra
        Takes the spectra of lamps.
    surroundings
        The environment.
    """
    eye = scene.metres_per_unit * np.array(scene.camera.eye)
    chosen, of_primitive = _surface_emitters(primitives, first_triangles, eye, textures, spectra)
    far = surroundings.kind is EnvironmentKind.IMAGE or surroundings.sun is not None or len(scene.lights) > 0
    reach = _scene_reach(primitives, eye) if far else 1.0
    lights = [light_emitter(light, scene, textures, spectra, reach) for light in scene.lights]
    if surroundings.kind is EnvironmentKind.IMAGE:
        lights.append(_environment(surroundings.flux * np.pi * reach**2))
    if surroundings.sun is not None:
        lights.append(sun_emitter(surroundings.sun, reach))
    lights = sorted((found for found in lights if found[1] > 0), key=lambda found: found[0]["kind"] == EmitterKind.SUN)
    chosen += [(np.array([record], EMITTER.dtype), np.array([power])) for record, power in lights]
    count = sum(len(records) for records, _ in chosen)
    records, curve, tree = EMITTER.zeros(count), np.zeros((1, 2), np.float32), None
    if chosen:
        records[:] = np.concatenate([part for part, _ in chosen])
        powers = np.concatenate([power for _, power in chosen])
        curve, chance = curves(powers[None])
        records["pick"] = chance[0]
        near = ~np.isin(records["kind"], list(FROM_AFAR))
        lamps = lamps_of(records[near], powers[near]) if near.sum() > 1 else None
        if lamps and variance_by_power(lamps, lit_points(primitives, of_primitive, lamps, eye)) > BREAK_EVEN:
            order = np.argsort(~near, kind="stable")  # of_primitive stays: surfaces stand first
            records, powers = records[order], powers[order]
            tree = _with_tree(records, powers, lamps, reach, surroundings)
        _note_infinity(records["kind"], surroundings)
    kinds = frozenset(EmitterKind(kind) for kind in set(records["kind"][:count].tolist()))
    tiny = _has_tiny(records, primitives, eye)
    return Emitters(records, of_primitive, kinds, count, curve.ravel(), tree, tiny)


def _with_tree(
    records: NDArray[np.void], powers: NDArray[np.float64], lamps: Lamps, reach: float, surroundings: Surroundings
) -> LightTree:
    """Return the tree over the lamps, which stand first; write leaves and the light from infinity into the records."""
    tree, count = light_tree(lamps), len(lamps.power)
    records["leaf"][:count] = tree.leaf_of
    # The tree estimates power / distance², pi times an irradiance; an even sky gives that a quarter of its flux.
    even = np.where(records["kind"][count:] == EmitterKind.ENVIRONMENT, 4.0, 1.0)
    afar = powers[count:] / (reach**2 * even * powers[:count].sum())
    records["pick"][count:] = np.minimum(afar, _BRIGHTEST_AFAR)
    surroundings.record["lamps"], surroundings.record["light_levels"] = count, tree.levels
    return tree


def _note_infinity(kinds: NDArray[np.int32], surroundings: Surroundings) -> None:
    """Write which emitters are suns and which stands for a picture."""
    suns = int((kinds == EmitterKind.SUN).sum())
    surroundings.record["first_sun"], surroundings.record["suns"] = len(kinds) - suns, suns
    surroundings.record["emitter"] = int((kinds == EmitterKind.ENVIRONMENT).argmax())


def _surface_emitters(
    primitives: list[Primitive],
    first_triangles: Sequence[int],
    eye: NDArray[np.float64],
    textures: TextureTable,
    spectra: KnownSpectra,
) -> tuple[list[Found], dict[int, int]]:
    """Return records and powers of what shines, primitive by primitive, and the first emitter of each of them."""
    chosen: list[Found] = []
    of_primitive: dict[int, int] = {}
    count = 0
    first_mesh = len(primitives) - len(first_triangles)
    for index, primitive in enumerate(primitives):
        glow = glow_of(primitive.material, textures, spectra)
        if has_holes(primitive.material):  # a sample would have to ask whether it lies in one; paths find what shines
            continue
        if primitive.trajectory is not None:  # a sample would have to follow it; paths find what shines
            continue
        if primitive.mesh is None:
            found = _surface_emitter(index, primitive, glow)
        else:
            found = _mesh_emitters(index, primitive, first_triangles[index - first_mesh], eye, glow)
        if found is not None:
            of_primitive[index] = count
            count += len(found[0])
            chosen.append(found)
    return chosen, of_primitive


def _environment(power: float) -> tuple[np.void, float]:
    record: np.void = EMITTER.zeros(1)[0]
    record["kind"], record["primitive"], record["triangle"] = EmitterKind.ENVIRONMENT, -1, -1
    record["texture"] = -1
    return record, power
