"""What light sampling can choose: lamps of every shape, emissive meshes, lights, and a picture around the scene.

Emissive planes, insides of solids, what moves and what has holes shine as well, but only BSDF sampling finds them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import records as layout
from rptcam_cl.core.colour import LUMINANCE, luminance
from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import EMITTER, EmitterKind, EnvironmentKind, Hidden, Kind, fill
from rptcam_cl.rendering.cameras.lamp_aim import SeenLamp
from rptcam_cl.rendering.plan import primitives as solids
from rptcam_cl.rendering.plan.environment import SUN_RADIUS_DEGREES, Surroundings
from rptcam_cl.rendering.plan.primitives import Primitive, Primitives
from rptcam_cl.rendering.plan.textures import Colours, KnownSpectra, TextureTable
from rptcam_cl.scene import lights as models
from rptcam_cl.scene.assets.mesh import Mesh
from rptcam_cl.scene.materials import Emissive, Material, Mix, Principled, has_holes
from rptcam_cl.scene.quantities import LARGEST_RADIANCE, Colour, cross
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.textures import Texture

# Lights without a surface as emitters: record and power of each.

_PROFILE_CELLS = (360, 720)  # directions of a luminaire, along and about its axis: half a degree


def light_emitter(
    light: models.Light, scene: Scene, textures: TextureTable, spectra: KnownSpectra, reach: float
) -> tuple[np.void, float]:
    """Return record and power [W, luminance] of a light; ``reach`` is the radius of the scene [m]."""
    record = _without_surface()
    colour: Colour
    match light:
        case models.PointLight():
            colour = light.intensity
            fill(record, kind=EmitterKind.POINT, radiance=colour)
            power = 4 * np.pi * luminance(colour)
        case models.SpotLight():
            colour, power = light.intensity, _spot(record, light)
        case models.ProfileLight():
            colour, power = light.color, _profile(record, light, scene, textures)
        case models.DirectionalLight():
            colour = light.irradiance
            fill(record, kind=EmitterKind.DIRECTIONAL, radiance=colour)
            power = np.pi * reach**2 * luminance(colour)
        case models.SunLight():
            colour = light.irradiance
            power = _fill_sun(record, colour, light.diameter_degrees / 2) * np.pi * reach**2
            record["hidden"] = hidden_from_camera(light, scene)
    # The spectrum is scaled as the record has its colour.
    largest = int(np.argmax(colour))
    gain = float(record["radiance"][largest]) / colour[largest] if colour[largest] > 0 else 0.0
    record["radiance"][3] = spectra.number(colour, light=True, gain=gain)
    if isinstance(light, models.DirectionalLight | models.SunLight):
        record["normal"][:3] = -_unit(light.direction)
    else:
        record["a"][:3] = (solids.world_from_scene(scene) @ (*light.position, 1.0))[:3]
    return record, power


def hidden_from_camera(part: models.SunLight | models.Environment, scene: Scene) -> int:
    """Return the record's flag of what is far away: `Hidden.FROM_CAMERA` or 0."""
    return 0 if part.visible.camera and not scene.film.transparent else int(Hidden.FROM_CAMERA)


def _without_surface() -> np.void:
    record: np.void = EMITTER.one(primitive=-1, triangle=-1, texture=-1)[0]
    return record


def _fill_sun(record: np.void, irradiance: ArrayLike, radius_degrees: float) -> float:
    """Fill in a disk at infinity that gives an irradiance where it is faced; return that as luminance [W/m²]."""
    sin2 = np.sin(np.deg2rad(radius_degrees)) ** 2
    fill(record, kind=EmitterKind.SUN, a=(0.0, 0.0, 0.0, sin2), radiance=np.asarray(irradiance) / (np.pi * sin2))
    return float(luminance(irradiance))


def _unit(direction: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)


def _spot(record: np.void, light: models.SpotLight) -> float:
    """Fill in a cone; return its power: a step that is smooth in the cosine is half full on average."""
    outer, inner = (2 * np.sin(np.deg2rad(angle) / 2) ** 2 for angle in (light.outer_degrees, light.inner))
    fill(record, kind=EmitterKind.SPOT, radiance=light.intensity, normal=_unit(light.direction))
    record["u"][3], record["v"][3] = outer, 1 / (outer - inner)
    return float(np.pi * (outer + inner) * luminance(light.intensity))


def _profile(record: np.void, light: models.ProfileLight, scene: Scene, textures: TextureTable) -> float:
    """Fill in a measured luminaire; return its power."""
    try:
        luminaire = models.read_luminaire(scene.content_of(light))
    except InputError as problem:
        raise InputError(f"{light.place}{problem}") from None
    intensity, mean = _directions(luminaire)
    texels = np.repeat(intensity.astype(np.float32)[::-1, :, None], 3, axis=2)
    colours = Colours.of(texels, layout.TexelFormat.HALF, f"luminaire {scene.digest_of(light)}")
    colour = np.array(light.color) * (light.gain / max(float(luminance(light.color)), 1e-30))
    turn = solids.turn_to(-_unit(light.direction))
    angle = np.deg2rad(light.rotation_degrees)
    fill(
        record,
        kind=EmitterKind.PROFILE,
        texture=textures.add_sphere(colours),
        radiance=colour,
        u=np.cos(angle) * turn[:, 0] + np.sin(angle) * turn[:, 1],
        v=np.cos(angle) * turn[:, 1] - np.sin(angle) * turn[:, 0],
        normal=_unit(light.direction),
    )
    return float(4 * np.pi * mean * LUMINANCE @ colour)


def _directions(luminaire: models.Luminaire) -> tuple[NDArray[np.float64], float]:
    """Return the intensity [W/sr] at the middles of cells of vertical and horizontal angle, and its mean."""
    rows, columns = _PROFILE_CELLS
    vertical = (np.arange(rows) + 0.5) * 180 / rows
    horizontal = (np.arange(columns) + 0.5) * 360 / columns
    intensity = luminaire.intensity(vertical, horizontal)
    weights = np.sin(np.deg2rad(vertical))
    return intensity, float(weights @ intensity.mean(axis=1) / weights.sum())


# Lamps with a volume as emitters: boxes, ellipsoids, cylinders and cones under any affine map.

Array = NDArray[np.float64]

SOLIDS = {
    Kind.BOX: EmitterKind.BOX,
    Kind.ELLIPSOID: EmitterKind.ELLIPSOID,
    Kind.CYLINDER: EmitterKind.CYLINDER,
    Kind.CONE: EmitterKind.CONE,
}
# Of a quadrature about an axis: smooth and periodic, it is exact to rounding but for very thin shapes.
_QUADRATURE_STEPS = 64


def area_of_solid(kind: Kind, linear: Array) -> float:
    """Return the area [m²] of a canonical shape under a linear map (3, 3); of cylinder and cone without their ends."""
    if kind is Kind.BOX:
        return 8 * float(sum(np.linalg.norm(np.cross(linear[:, i - 1], linear[:, i])) for i in range(3)))
    angle = 2 * np.pi * np.arange(_QUADRATURE_STEPS) / _QUADRATURE_STEPS
    round_about = np.stack([np.cos(angle), np.sin(angle), np.zeros(_QUADRATURE_STEPS)], axis=1)
    along = np.stack([-np.sin(angle), np.cos(angle), np.zeros(_QUADRATURE_STEPS)], axis=1) @ linear.T
    if kind is Kind.ELLIPSOID:
        cosine, weight = np.polynomial.legendre.leggauss(_QUADRATURE_STEPS)
        sine = np.sqrt(1 - cosine**2)
        normals = sine[:, None, None] * round_about + cosine[:, None, None] * np.array([0.0, 0.0, 1.0])
        stretched = normals @ (np.linalg.inv(linear) * np.linalg.det(linear))
        return float(2 * np.pi * (weight @ np.linalg.norm(stretched, axis=2).mean(axis=1)))
    side = np.array([0.0, 0.0, 1.0]) - (round_about if kind is Kind.CONE else 0.0)
    area = 2 * np.pi * float(np.linalg.norm(np.cross(along, side @ linear.T), axis=1).mean())
    return area / 2 if kind is Kind.CONE else area


# The tree by which light sampling finds its lamps where there are many: ``kernels/light/light_tree.h``.

# Variance of picks by power from which on a tree is used. Of the scenes measured above it none lost at equal time, and
# they gained up to 12 times; most of those below it lost, as a vertex takes longer by a tree (benchmarks/journal.md).
BREAK_EVEN = 0.5
NODE_FLOATS = 8
MOST_LAMPS, MOST_POINTS = 4096, 64  # that tell whether a tree gains


@dataclass(frozen=True, eq=False)
class Lamps(Rows):
    """What the tree knows of each lamp.

    Attributes
    ----------
    middle : (n, 3) array
        Mean position of its light [m].
    extent2 : (n,) array
        Mean squared distance from there [m²].
    axis : (n, 3) array
        Mean direction in which it shines; shorter than 1 where it shines all round.
    power : (n,) array
        In any unit.
    """

    middle: Array
    extent2: Array
    axis: Array
    power: Array


@dataclass(frozen=True, eq=False)
class LightTree:
    """The nodes with the lamps of the leaves behind them, the leaf of each lamp, and levels above the leaves."""

    nodes: NDArray[np.float32]
    leaf_of: NDArray[np.int32]
    levels: int


def lamps_of(records: NDArray[np.void], power: Array) -> Lamps:
    """Describe emitter records that are not at infinity for the tree."""
    kind = records["kind"]
    a, u, v, z = (records[name][:, :3].astype(np.float64) for name in ("a", "u", "v", "normal"))
    uu, vv, zz, uv = ((x * y).sum(axis=1) for x, y in ((u, u), (v, v), (z, z), (u, v)))
    nothing, radius2 = np.zeros_like(a), records["a"][:, 3].astype(np.float64) ** 2
    facing = z * np.where(records["two_sided"] != 0, 0.0, 1.0)[:, None]
    by_kind = {  # offset of the middle from `a`, mean squared distance from there, axis: 0 of a point
        EmitterKind.RECTANGLE: ((u + v) / 2, (uu + vv) / 12, facing),
        EmitterKind.DISK: (nothing, (uu + vv) / 4, facing),
        EmitterKind.TRIANGLE: ((u + v) / 3, (uu + vv - uv) / 18, facing),
        EmitterKind.SPHERE: (nothing, radius2, nothing),
        EmitterKind.SPOT: (nothing, 0 * uu, z),
        EmitterKind.PROFILE: (nothing, 0 * uu, z / 2),
        EmitterKind.BOX: (nothing, (uu + vv + zz) * 5 / 9, nothing),
        EmitterKind.ELLIPSOID: (nothing, (uu + vv + zz) / 3, nothing),
        EmitterKind.CYLINDER: (z / 2, (uu + vv) / 2 + zz / 12, nothing),
        EmitterKind.CONE: (z / 3, (uu + vv) / 4 + zz / 18, nothing),
    }
    middle, extent2, axis = a.copy(), np.zeros(len(a)), np.zeros_like(a)
    for one, (offset, spread, mean) in by_kind.items():
        mine = kind == one
        middle[mine] += offset[mine]
        extent2[mine], axis[mine] = spread[mine], mean[mine]
    return Lamps(middle, extent2, axis, power / power.sum())


def variance_by_power(lamps: Lamps, points: Array) -> float:
    """Return the mean relative variance of light at points (m, 3) from lamps picked by power; 0 where that is right.

    Shadows and the surfaces' own directions are left out.
    """
    lamps = lamps[:: -(-len(lamps) // MOST_LAMPS)]
    lamps = lamps[lamps.power > 0]
    moments = []
    for point in points[:: -(-len(points) // MOST_POINTS) or 1]:
        to = lamps.middle - point
        inverse = 1 / np.maximum((to**2).sum(axis=1) + lamps.extent2, np.finfo(np.float32).tiny)
        axis, spread = lamps.axis, lamps.extent2 * inverse / 2
        cosine = -(axis * to).sum(axis=1) * np.sqrt(inverse)
        soft = np.sqrt(np.maximum(cosine**2 + spread + (1 - (axis**2).sum(axis=1)) / 4, 0))
        light = np.maximum((cosine + soft) / 2, 0.01) * inverse
        power = lamps.power
        moments.append((power * light**2).sum() * power.sum() / (power * light).sum() ** 2 - 1)
    return float(np.mean(moments)) if moments else 0.0


def light_tree(lamps: Lamps) -> LightTree:
    """Return a balanced tree: each node parts its lamps, along their longest extent, into halves by number, and those
    again."""
    count = len(lamps.power)
    levels = -(-max(count - 1, 0).bit_length() // 2) * 2
    nodes = np.zeros((2 << levels, NODE_FLOATS), np.float32)
    order, starts = np.arange(count), np.array([0, count])  # of the lamps of each node of a level
    for level in range(levels + 1):
        nodes[1 << level : 2 << level] = _nodes(lamps, order, starts)
        if level < levels:
            order = _sort(lamps.middle, order, starts)
            halves = starts[:-1] + (np.diff(starts) + 1) // 2
            starts = np.append(np.stack([starts[:-1], halves], axis=1).ravel(), count)
    leaf = np.repeat(np.arange(1 << levels), np.diff(starts))
    leaf_of, lamp_of = np.zeros(count, np.int32), np.zeros(1 << levels, np.int32)
    leaf_of[order], lamp_of[leaf] = leaf, order
    return LightTree(np.concatenate([nodes.ravel(), lamp_of.view(np.float32)]), leaf_of, levels // 2)


def _sort(middle: Array, order: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the order in which the lamps of each node stand along the axis on which they lie farthest apart."""
    there = middle[order]
    lamps = np.diff(starts)[np.diff(starts) > 0]
    firsts = np.cumsum(lamps) - lamps
    extent = np.maximum.reduceat(there, firsts) - np.minimum.reduceat(there, firsts)
    node = np.repeat(np.arange(len(lamps)), lamps)
    return order[np.lexsort((there[np.arange(len(order)), extent.argmax(axis=1)[node]], node))]


def _nodes(lamps: Lamps, order: NDArray[np.int64], starts: NDArray[np.int64]) -> Array:
    """Return the nodes of a level: means weighted by power. A node without lamps, below one with a single one, is 0."""
    rows = np.zeros((len(starts) - 1, NODE_FLOATS))
    used = np.flatnonzero(np.diff(starts))
    weight = lamps.power[order]
    about = np.average(lamps.middle, axis=0, weights=lamps.power)  # so that squares do not cancel far from the eye
    middle = lamps.middle[order] - about
    squares = (middle**2).sum(axis=1) + lamps.extent2[order]
    columns = np.column_stack([middle, squares, lamps.axis[order], np.ones(len(order))]) * weight[:, None]
    rows[used] = np.add.reduceat(columns, starts[:-1][used])
    rows[used, :7] /= np.maximum(rows[used, 7:], np.finfo(np.float64).tiny)  # triangles without area have no power
    rows[used, 3] = np.maximum(rows[used, 3] - (rows[used, :3] ** 2).sum(axis=1), 0.0)
    rows[used, :3] += about
    return rows


# Points on the surfaces of a scene that its lamps may light, for the choice of how light sampling picks a lamp.

_MESH_POINTS = 16  # vertices of a mesh
# Of the canonical shapes of the flat kinds; of others the middle.
PLACES = {
    Kind.RECTANGLE: [[0.5, 0.5, 0.0], [0.2, 0.2, 0.0], [0.8, 0.2, 0.0], [0.2, 0.8, 0.0], [0.8, 0.8, 0.0]],
    Kind.DISK: [[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [-0.6, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, -0.6, 0.0]],
    Kind.CYLINDER: [[0.0, 0.0, 0.5]],
    Kind.CONE: [[0.0, 0.0, 0.5]],
}


def _lit_points(primitives: Primitives, lamps_of_primitive: Mapping[int, int], lamps: Lamps, eye: Array) -> Array:
    """Return points (n, 3) [m about the eye] of what is no key of the lamps; of a plane the foot of each lamp."""
    parts = [
        part
        for index, primitive in enumerate(primitives)
        if index not in lamps_of_primitive
        for part in _points(primitive, lamps, eye)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _points(primitive: Primitive, lamps: Lamps, eye: Array) -> Iterator[Array]:
    linear, origin = primitive.placement[:3, :3], primitive.placement[:3, 3]
    if primitive.mesh is not None:
        mesh = primitive.mesh
        some = mesh.positions[:: -(-len(mesh.positions) // _MESH_POINTS)]
        yield (some + mesh.origin) @ linear.T + (origin - eye)
    elif primitive.kind is Kind.PLANE:
        normal = np.linalg.inv(linear)[2]
        normal /= np.linalg.norm(normal)
        yield lamps.middle - ((lamps.middle - origin) @ normal)[:, None] * normal
    else:
        yield np.array(PLACES.get(primitive.kind, [[0.0, 0.0, 0.0]])) @ linear.T + origin


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
    unit = normal / np.maximum(double_area, np.finfo(np.float64).tiny)[:, None]
    fill(records, kind=EmitterKind.TRIANGLE, a=np.column_stack([a, double_area / 2]), u=u, v=v, normal=unit)
    if mesh.uvs is not None:
        corner, first, second = (mesh.uvs[mesh.faces[:, index]] for index in range(3))
        fill(records, uv=corner, uv_x=first - corner, uv_y=second - corner)
    return records, double_area / 2


# Groups of lamps, whose light the layer `lights` keeps apart.

_MOST_GROUPS = 16  # a film each, and sums of each in every path


@dataclass(frozen=True, eq=False)
class LightGroups:
    """Names of the groups of lamps whose light is kept apart, none by default, and which group shines where.

    Attributes
    ----------
    names : tuple
        By number.
    of_primitive, of_light : array
        Numbers of the groups of primitives, and of lights without a surface.
    sky : int
        Number of the group of the surroundings.
    """

    names: tuple[str, ...] = ()
    of_primitive: NDArray[np.int32] = field(default_factory=lambda: np.zeros(1, np.int32))
    of_light: tuple[int, ...] = ()
    sky: int = 0


def light_groups(scene: Scene, primitives: Primitives, *, has_glow: bool) -> LightGroups:
    """Return the groups of the lamps of a scene, where `lights` is one of its layers.

    A lamp without `group` is one of its own, named as its object is. Media that shine come last, as the kernels expect
    them.

    Raises
    ------
    InputError
        There are more than `_MOST_GROUPS`.
    """
    if "lights" not in scene.render.layers:
        return LightGroups()
    lights = [light.group or f"light_{place}" for place, light in enumerate(scene.lights)]
    sky = [] if scene.environment is None else [scene.environment.group or "environment"]
    objects: dict[int, str] = {}
    shining = primitives.objects[primitives.runs_of(lambda each: is_shining(each.material))]
    for index in sorted(set(shining.tolist())):
        item = scene.objects[index]
        objects[index] = item.group or re.sub(r"[^A-Za-z0-9_-]", "_", item.name or f"object_{index}")
    names = tuple(dict.fromkeys((*objects.values(), *lights, *sky, *(("media",) if has_glow else ()))))
    if has_glow:
        names = (*(name for name in names if name != "media"), "media")
    if len(names) > _MOST_GROUPS:
        raise InputError(
            f"render.layers: lights keeps the light of each lamp apart, of which there are {len(names)} (allowed:"
            f" at most {_MOST_GROUPS} groups; give lamps that belong together the same `group`)"
        )
    number = {name: place for place, name in enumerate(names or ("none",))}
    of_objects = np.array([number[objects[index]] if index in objects else 0 for index in range(len(scene.objects))])
    of_primitive = primitives.spread(of_objects.astype(np.int32)[primitives.objects])
    of_light = tuple(number[name] for name in lights)
    return LightGroups(tuple(number), of_primitive, of_light, number[sky[0]] if sky else 0)


_BLACK = (0.0, 0.0, 0.0)


def is_shining(material: Material) -> bool:
    """Return whether a material has light of its own, or a part of a mix."""
    if isinstance(material, Mix):
        return any(map(is_shining, material.materials))
    return isinstance(material, Emissive) or (isinstance(material, Principled) and material.emission != _BLACK)


Found = tuple[NDArray[np.void], NDArray[np.float64]]


@dataclass(frozen=True)
class Emitters:
    """Records, the sampled emitter of each primitive, the kinds there are, the curve that picks by power, the tree
    that picks instead where there are many lamps, whether lamps may be so far away that rays end before them, the
    group of each lamp, lamps that the camera may see out of focus, about the eye [m], and where there are any, about
    the irradiance of the eye, by all light with nothing in the way [W/m², luminance]."""

    records: NDArray[np.void]
    of_primitive: dict[int, int]
    kinds: frozenset[EmitterKind]
    count: int
    curve: NDArray[np.float32]
    tree: LightTree | None = None
    tiny: bool = False
    groups: NDArray[np.int32] = field(default_factory=lambda: np.zeros(1, np.int32))
    seen: tuple[SeenLamp, ...] = ()
    irradiance: float = 0.0

    @property
    def shining(self) -> NDArray[np.void]:
        """Records of lamps, without the one that stands where there is none."""
        return self.records[: self.count if self.kinds else 0]

    @property
    def facts(self) -> dict[str, int]:
        """Which kinds of emitter the kernels must know."""
        painted = (self.records["texture"] >= 0) & (self.records["primitive"] >= 0)
        return {
            "HAS_EMITTERS": int(self.count > 0),
            "ONE_EMITTER": int(self.count == 1),
            "LIGHT_TREE": int(self.tree is not None),
            "TINY_LAMPS": int(self.tiny),
            "HIDDEN_SUNS": int(np.any((self.records["kind"] == EmitterKind.SUN) & (self.records["hidden"] > 0))),
            "EMITTER_TEXTURES": int(painted[: self.count].any()),
            **{fact: int(bool(self.kinds & kinds)) for fact, kinds in layout.EMITTER_FACTS.items()},
        }


def _flat(primitive: Primitive, record: np.void) -> float:
    """Fill in a rectangle or a disk; return its area."""
    disk = primitive.kind is Kind.DISK
    x, y, _, origin = primitive.placement[:3].T
    area = float(np.linalg.norm(cross(x, y))) * (np.pi if disk else 1.0)
    normal = np.linalg.inv(primitive.placement)[2, :3]
    kind = EmitterKind.DISK if disk else EmitterKind.RECTANGLE
    fill(record, kind=kind, a=(*origin, area), u=x, v=y, normal=normal / np.linalg.norm(normal))
    fill(record, uv_x=(1, 0), uv_y=(0, 1))
    return area


def _sphere(primitive: Primitive, record: np.void) -> float:
    """Fill in a sphere; return its area."""
    center, radius = solids.sphere_of(primitive.placement)
    axes = primitive.placement[:3, :3] / radius
    handedness = np.sign(np.linalg.det(axes))
    fill(record, kind=EmitterKind.SPHERE, a=(*center, radius), u=axes[:, 0], v=axes[:, 2], uv=(0, 0, handedness))
    return 4 * np.pi * radius**2


def _solid(primitive: Primitive, record: np.void) -> float:
    """Fill in what ``kernels/light/solids.h`` reads of a solid; return its area."""
    kind, linear = primitive.kind, primitive.placement[:3, :3]
    (u, v, normal), (uv, uv_x, uv_y) = linear.T, np.linalg.inv(linear)
    a = (*primitive.placement[:3, 3], np.cbrt(abs(np.linalg.det(linear))))
    fill(record, kind=SOLIDS[kind], a=a, u=u, v=v, normal=normal, uv=uv, uv_x=uv_x, uv_y=uv_y)
    return area_of_solid(kind, linear)


_BRIGHTEST_AFAR = 1e30  # over the lamps near by, of which nothing is to be seen then; sums of it are float32 still
_SAMPLED = {Kind.RECTANGLE: _flat, Kind.DISK: _flat, Kind.SPHERE: _sphere, **dict.fromkeys(SOLIDS, _solid)}


@dataclass(frozen=True)
class _Glow:
    """What a material emits: radiance, mean over a texture; the texture's index or -1; whether the back shines; the
    number of its spectrum; whether the material has holes."""

    radiance: NDArray[np.float64]
    texture: int
    two_sided: bool
    number: int
    has_holes: bool

    @property
    def strength(self) -> float:
        """Radiance times sides [W/(m² sr), luminance]."""
        return float(luminance(self.radiance)) * (2 if self.two_sided else 1)

    @property
    def members(self) -> dict[str, Any]:
        """What an emitter's record has of it."""
        radiance = (*self.radiance, self.number)
        return {"radiance": radiance, "texture": self.texture, "two_sided": self.two_sided}


def _glow_of(material: Material, textures: TextureTable, spectra: KnownSpectra) -> _Glow:
    """Find the light that a material emits; its texture and its spectrum are entered."""
    emitted: Texture | Colour = _BLACK
    two_sided = False
    if isinstance(material, Emissive | Principled):
        emitted = material.radiance if isinstance(material, Emissive) else material.emission
        two_sided = material.two_sided
    colour, texture = textures.slot(emitted, limit=LARGEST_RADIANCE)
    number = spectra.number(emitted, light=True)
    radiance = np.array(colour) if texture < 0 else textures.mean(texture)
    return _Glow(radiance, texture, two_sided, number, has_holes(material))


def _glowing(
    primitives: Primitives, textures: TextureTable, spectra: KnownSpectra
) -> list[tuple[int, Primitive, _Glow]]:
    """Find the primitives that shine and stand still: their numbers, and what they emit."""
    materials = {id(each.material): each.material for each in primitives.prototypes}
    glows = {key: _glow_of(material, textures, spectra) for key, material in materials.items()}
    still = primitives.among(lambda each: glows[id(each.material)].strength > 0 and each.trajectory is None)
    return [(index, primitive, glows[id(primitive.material)]) for index, primitive in still]


def _scene_reach(primitives: Primitives, eye: NDArray[np.float64]) -> float:
    """Return a radius about the eye that holds all bounded primitives [m]."""
    reach = 0.0
    for kind, (runs, _) in primitives.by_kind().items():
        for *_, some in primitives.places.blocks(runs) if kind is not Kind.PLANE else ():
            rows, size = some[:, :3].copy(), np.linalg.norm(some[:, :3], axis=1)
            if kind in (Kind.RECTANGLE, Kind.DISK):  # the normal of a flat one, a unit of the scene, is no length of it
                rows[:, :, 2] *= np.minimum(size[:, [0, 1, 3]].max(axis=1) / size[:, 2], 1.0)[:, None]
            reach = max(reach, float(np.linalg.norm(rows, ord=2, axis=(1, 2)).max()))
    placed = primitives.of_meshes()
    meshes, mesh_of = placed.meshes()
    boxes = np.array([mesh.bounds() for mesh in meshes])
    for _, numbers, placements in placed.places.blocks():
        low, high = boxes[mesh_of[numbers]].transpose(1, 0, 2)[:, :, None]
        corners = solids.corners_of_box(low, high, placements)
        reach = max(reach, float(np.linalg.norm(corners - eye, axis=-1).max()))
    return reach or 1.0


def _has_tiny(records: NDArray[np.void], primitives: Primitives, eye: NDArray[np.float64]) -> bool:
    """Return whether one of several lamps may be seen at an angle below which kernels end rays before it."""
    pieces = records[records["primitive"] >= 0]
    if len(pieces) < 2:
        return False
    extents = pieces["a"][:, 3].astype(np.float64)
    sizes = np.where(pieces["kind"] >= EmitterKind.BOX, extents, np.sqrt(extents))
    ends = (pieces["kind"] != EmitterKind.SPHERE) & (pieces["two_sided"] == 0)
    return bool((sizes[ends] < layout.TINY_ANGLE * 2 * _scene_reach(primitives, eye)).any())


def pack_emitters(
    scene: Scene,
    primitives: Primitives,
    first_triangles: NDArray[np.int32],
    textures: TextureTable,
    spectra: KnownSpectra,
    surroundings: Surroundings,
    groups: LightGroups,
    held: Mapping[str, int] | None = None,
) -> Emitters:
    """Return the emitters that light sampling chooses from: by a tree where there are many lamps, else by their power.

    Suns come last. Writes into the record of the surroundings where they stand, and the environment.

    Parameters
    ----------
    primitives
        Those of the scene, sorted by kind.
    first_triangles
        Of those that are meshes, in their order.
    textures
        Has the textures of lamps; takes the pictures of measured luminaires.
    spectra
        Takes the spectra of lamps.
    surroundings
        The environment.
    groups
        Of lamps.
    held
        Facts of kernels that are to do for them: these say whether there is a tree, and a lamp without light stands
        where there is none.
    """
    eye = scene.metres_per_unit * np.array(scene.camera.eye)
    glowing = _glowing(primitives, textures, spectra)
    first_mesh = len(primitives) - len(first_triangles)
    chosen, of_primitive = _surface_emitters(glowing, first_triangles, first_mesh, eye)
    far = surroundings.kind is EnvironmentKind.IMAGE or surroundings.sun is not None or len(scene.lights) > 0
    reach = _scene_reach(primitives, eye) if far else 1.0
    lights = _light_emitters(scene, textures, spectra, surroundings, reach, groups)
    chosen += [(np.array([record], EMITTER.dtype), np.array([power])) for record, power, _ in lights]
    is_dark = held is not None and held["HAS_EMITTERS"] > 0 and not chosen
    if is_dark:
        chosen = [(np.array([_without_surface()], EMITTER.dtype), np.ones(1))]
    records, powers, group = _join_lamps(chosen, [each for _, _, each in lights], groups)
    count, curve, tree = len(powers), np.zeros((1, 2), np.float32), None
    if count:
        curve, chance = layout.curves(powers[None])
        records["pick"] = chance[0]
        if (lamps := _lamps_of_tree(records, powers, primitives, of_primitive, eye, held)) is not None:
            # `of_primitive` stays: surfaces stand first
            order = np.argsort(np.isin(records["kind"], list(layout.FAR_EMITTERS)), kind="stable")
            records, powers, group = records[order], powers[order], group[order]
            tree = _with_tree(records, powers, lamps, reach, surroundings)
        suns = int((records["kind"] == EmitterKind.SUN).sum())
        surroundings.record["first_sun"], surroundings.record["suns"] = len(records) - suns, suns
        surroundings.record["emitter"] = int((records["kind"] == EmitterKind.ENVIRONMENT).argmax())
    kinds = frozenset(EmitterKind(kind) for kind in set(records["kind"][:count].tolist()) if not is_dark)
    tiny, seen = _has_tiny(records, primitives, eye), _seen_lamps(glowing, eye)
    irradiance = _even_irradiance(surroundings) + _irradiance(records, powers, reach) if seen else 0.0
    return Emitters(records, of_primitive, kinds, count, curve.ravel(), tree, tiny, group, seen, irradiance)


def _irradiance(records: NDArray[np.void], powers: Array, reach: float) -> float:
    """Return about the irradiance of the eye by emitters, whatever it faces [W/m², luminance]."""
    far = np.isin(records["kind"], list(layout.FAR_EMITTERS))
    near = lamps_of(records[~far], powers[~far])
    away2 = (near.middle**2).sum(axis=1) + near.extent2
    by_near = powers[~far] / (4 * np.pi * np.maximum(away2, np.finfo(np.float64).tiny))
    return float(by_near.sum() + powers[far].sum() / (np.pi * reach**2))


def _even_irradiance(surroundings: Surroundings) -> float:
    """Return about that by surroundings that light sampling knows nothing of."""
    ends = [surroundings.record[0][end][:3].astype(np.float64) for end in ("bottom", "top")]
    if surroundings.kind is EnvironmentKind.CONSTANT:
        return float(np.pi * luminance(ends[0]))
    return float(np.pi * luminance((ends[0] + ends[1]) / 2)) if surroundings.kind is EnvironmentKind.GRADIENT else 0.0


def _join_lamps(
    chosen: list[Found], of_lights: list[int], groups: LightGroups
) -> tuple[NDArray[np.void], Array, NDArray[np.int32]]:
    """Return the records, powers and groups of all lamps; lights without a surface, whose groups are given, come last.

    Of records and groups there is at least one, as OpenCL has no empty buffers.
    """
    count = sum(len(records) for records, _ in chosen)
    records, group = EMITTER.zeros(count), np.zeros(max(count, 1), np.int32)
    if not chosen:
        return records, np.zeros(0), group
    records[:] = np.concatenate([part for part, _ in chosen])
    if groups.names:
        group[:] = groups.of_primitive[np.maximum(records["primitive"], 0)]
        group[count - len(of_lights) :] = of_lights
    return records, np.concatenate([power for _, power in chosen]), group


def _lamps_of_tree(
    records: NDArray[np.void],
    powers: Array,
    primitives: Primitives,
    of_primitive: Mapping[int, int],
    eye: Array,
    held: Mapping[str, int] | None,
) -> Lamps | None:
    """Return the lamps that a tree is to be made of; None where they are picked by their power."""
    near = ~np.isin(records["kind"], list(layout.FAR_EMITTERS))
    if not near.sum() > (held is None):
        return None
    lamps = lamps_of(records[near], powers[near])
    if held is None:
        gains = variance_by_power(lamps, _lit_points(primitives, of_primitive, lamps, eye)) > BREAK_EVEN
    else:
        gains = held["LIGHT_TREE"] > 0
    return lamps if gains else None


def _light_emitters(
    scene: Scene,
    textures: TextureTable,
    spectra: KnownSpectra,
    surroundings: Surroundings,
    reach: float,
    groups: LightGroups,
) -> list[tuple[np.void, float, int]]:
    """Return record, power [W, luminance] and group of lights, of a picture around the scene and its sun; suns last."""
    lights = [
        (*light_emitter(light, scene, textures, spectra, reach), group)
        for light, group in zip(scene.lights, groups.of_light or (0,) * len(scene.lights), strict=True)
    ]
    hidden = scene.environment is not None and hidden_from_camera(scene.environment, scene)
    if surroundings.kind is EnvironmentKind.IMAGE:
        record = _without_surface()
        fill(record, kind=EmitterKind.ENVIRONMENT, hidden=hidden)
        lights.append((record, surroundings.flux * np.pi * reach**2, groups.sky))
    if surroundings.sun is not None:
        towards, irradiance = surroundings.sun
        record = _without_surface()
        fill(record, normal=towards, hidden=hidden)
        lights.append((record, _fill_sun(record, irradiance, SUN_RADIUS_DEGREES) * np.pi * reach**2, groups.sky))
    return sorted((each for each in lights if each[1] > 0), key=lambda each: each[0]["kind"] == EmitterKind.SUN)


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


def _surface_emitters(
    glowing: list[tuple[int, Primitive, _Glow]], first_triangles: NDArray[np.int32], first_mesh: int, eye: Array
) -> tuple[list[Found], dict[int, int]]:
    """Return records and powers of what shines, primitive by primitive, and the first emitter of each of them.

    A sample would have to ask whether it lies in a hole, or follow what moves; paths find what shines there.
    """
    chosen: list[Found] = []
    of_primitive: dict[int, int] = {}
    count = 0
    for index, primitive, glow in glowing:
        if glow.has_holes or not (primitive.mesh is not None or primitive.kind in _SAMPLED):
            continue
        if primitive.mesh is None:
            records = EMITTER.one(primitive=index, triangle=-1, **glow.members)
            areas = np.array([_SAMPLED[primitive.kind](primitive, records[0])])
        else:
            records, areas = triangle_emitters(primitive.mesh, primitive.placement, eye)
            triangles = first_triangles[index - first_mesh] + np.arange(len(records))
            fill(records, primitive=index, triangle=triangles, **glow.members)
        records["hidden"] = primitive.hidden
        of_primitive[index] = count
        count += len(records)
        chosen.append((records, np.pi * areas * glow.strength))
    return chosen, of_primitive


def met_apart(primitives: Primitives, emitters: Emitters) -> dict[str, int]:
    """Return the facts of scenes where paths and shadow rays meet different things.

    Light samples that pass what paths meet count alone where shadow rays can tell (LIGHT_PASSES). They cannot of
    triangles and of holes, and do not know what paths alone pass: light sampling then has to find all light of lamps.

    Raises
    ------
    InputError
        For a lamp that only paths find and that is hidden from them.
    """
    either = Hidden.FROM_SHADOW | Hidden.FROM_REFLECTION
    alone = passes = False
    for index, primitive in primitives.among(lambda each: each.hidden & either != 0):
        kinds = primitive.hidden & either
        is_sampled, material = index in emitters.of_primitive, primitive.material
        if is_shining(material) and kinds & Hidden.FROM_REFLECTION and not is_sampled:
            raise InputError(
                f"objects.{primitive.object}.visible.reflection: this lamp would light nothing: what moves, has holes"
                " or is a plane is found by its reflection alone (allowed: true)"
            )
        is_simple = primitive.kind is not Kind.MESH and not has_holes(material)
        if kinds == either:
            passes |= is_sampled
        elif kinds == Hidden.FROM_SHADOW and is_simple:
            passes |= not is_sampled or emitters.count > 1  # of a single lamp no light passes it
        else:
            alone = True
    return {"LAMPS_BY_SAMPLES": int(alone), "LIGHT_PASSES": int(passes and not alone)}


# Lamps that the camera may see out of focus, as it sees them.

_OUTLINE_STEPS = 32  # of an outline
ANGLES = np.linspace(0.0, np.pi / 2, 16, endpoint=False)  # at which the least rectangle about a lamp is looked for


def _seen_lamps(glowing: list[tuple[int, Primitive, _Glow]], eye: Array) -> tuple[SeenLamp, ...]:
    """Return lamps as seen from the eye, in the world about it [m].

    Planes, lamps around the eye and those that turn their back to it are left out.
    """
    lamps = []
    for _, primitive, glow in glowing:
        if primitive.kind is Kind.PLANE or primitive.hidden & Hidden.FROM_CAMERA:
            continue
        outline = _outline(primitive, eye, two_sided=glow.two_sided)
        if outline is None or np.linalg.norm(outline[0]) <= 1.5 * np.linalg.norm(outline[1], axis=1).max():
            continue
        lamps.append(SeenLamp(*outline, float(luminance(glow.radiance))))
    return tuple(lamps)


def _outline(primitive: Primitive, eye: Array, *, two_sided: bool) -> tuple[Array, Array, bool] | None:
    """Return middle, half axes and whether it is round, of what the eye sees of a primitive."""
    linear, origin = primitive.placement[:3, :3], primitive.placement[:3, 3]
    if primitive.kind in (Kind.DISK, Kind.RECTANGLE):
        normal = np.linalg.inv(linear)[2]
        if not two_sided and normal @ origin >= 0:
            return None
        if primitive.kind is Kind.DISK:
            return origin, linear[:, :2].T, True
        axes = linear[:, :2].T / 2
        return origin + axes.sum(axis=0), axes, False
    if primitive.kind is Kind.SPHERE:
        centre, radius = solids.sphere_of(primitive.placement)
        across, distance = _across(centre), float(np.linalg.norm(centre))
        share = 1 - (radius / distance) ** 2 if distance > radius else 0.0  # within it, nothing is left
        return centre, across * (radius / np.sqrt(max(share, 0.1))), True
    if primitive.kind is Kind.ELLIPSOID:
        across = _across(origin)
        sizes, directions = np.linalg.eigh(across @ linear @ linear.T @ across.T)
        return origin, np.sqrt(np.maximum(sizes, 0.0))[:, None] * (directions.T @ across), True
    return (*_least_rectangle(_hull(primitive, eye)), False)


def _across(towards: Array) -> Array:
    """Return two unit vectors (2, 3) across a direction; any two where there is none."""
    length = float(np.linalg.norm(towards))
    z = towards / length if length > 0 else np.array([0.0, 0.0, 1.0])
    x = cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.stack([x, cross(z, x)])


def _hull(primitive: Primitive, eye: Array) -> Array:
    """Return points (n, 3) whose hull holds a primitive, about the eye."""
    if primitive.mesh is not None:
        return solids.corners_of_box(*primitive.mesh.bounds(), primitive.placement) - eye
    angle = 2 * np.pi * np.arange(_OUTLINE_STEPS) / _OUTLINE_STEPS
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(_OUTLINE_STEPS)], axis=1)
    match primitive.kind:
        case Kind.CYLINDER:
            points = np.concatenate([ring, ring + np.array([0.0, 0.0, 1.0])])
        case Kind.CONE:
            points = np.concatenate([ring, [[0.0, 0.0, 1.0]]])
        case _:
            points = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T
    return np.asarray(points @ primitive.placement[:3, :3].T + primitive.placement[:3, 3])


def _least_rectangle(points: Array) -> tuple[Array, Array]:
    """Return middle and half edges of the least rectangle across the view that holds points."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    across = _across(middle)
    flat = (points - middle) @ across.T
    turns = np.stack([np.cos(ANGLES), np.sin(ANGLES), -np.sin(ANGLES), np.cos(ANGLES)], axis=1).reshape(-1, 2, 2)
    turned = np.einsum("kij,nj->kni", turns, flat)
    low, high = turned.min(axis=1), turned.max(axis=1)
    best = int(np.argmin(np.prod(high - low, axis=1)))
    edges = turns[best] @ across
    return middle + (low[best] + high[best]) / 2 @ edges, (high[best] - low[best])[:, None] / 2 * edges
