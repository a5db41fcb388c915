"""Lamps and suns of a scene as points of light: what hides them, rays that aim at them, and what lights a lens."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import GOLDEN
from rptcam_cl.core.colour import WAVELENGTHS_NM, luminance
from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.records import EmitterKind, Hidden, PatchMap, SpectrumKind, device_declarations
from rptcam_cl.core.remember import content_name, identity_of_code
from rptcam_cl.device.session import Session
from rptcam_cl.optics.lens import Lens
from rptcam_cl.rendering import point_waves
from rptcam_cl.rendering.cameras.lamp_aim import Sights
from rptcam_cl.rendering.cameras.lens_records import ghosts_have_colours, usable_nm
from rptcam_cl.rendering.cameras.setting import LensSetting
from rptcam_cl.rendering.plan.environment import bright_parts
from rptcam_cl.rendering.plan.plan import Plan, aim, may_aim, observer
from rptcam_cl.rendering.plan.textures import Textures
from rptcam_cl.rendering.point_spread import shares_of_white
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]
Points = tuple[Array, Array, Array]
Window = tuple[slice, slice]

POINTS = 16  # of a lamp or sun of a size
FAR = (EmitterKind.SUN, EmitterKind.DIRECTIONAL)
FLAT = (EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE)


def points_of(record: np.void, front: Array) -> Points | None:
    """Return places [m about the eye] with 1, or directions towards with 0; irradiance at the front; and targets."""
    known = patches_of(record, front)
    return None if known is None else known[0]


def patches_of(record: np.void, front: Array) -> tuple[Points, Patches] | None:
    """Return the points of an emitter as they show to the front, and the patch of it that each stands for.

    None of kinds whose light is not known so.
    """
    kind, radiance = EmitterKind(int(record["kind"])), record["radiance"][:3].astype(np.float64)
    a = record["a"].astype(np.float64)
    if kind in FAR:
        towards, patches = _on_sun(record, kind)
        weight = radiance if kind is EmitterKind.DIRECTIONAL else radiance * np.pi * a[3]
        return points_at(towards, 0.0, np.tile(weight / len(towards), (len(towards), 1)), record), patches
    if kind in (EmitterKind.POINT, EmitterKind.SPOT):
        to = front - a[:3]
        share = _spot_share(record, to / np.linalg.norm(to)) if kind is EmitterKind.SPOT else 1.0
        return points_at(a[None, :3], 1.0, share * radiance[None] / (to @ to), record), points_alone(a[None, :3])
    if kind in FLAT or kind is EmitterKind.SPHERE:
        places, projected, patches = (
            _on_sphere(a, front) if kind is EmitterKind.SPHERE else _on_flat(record, kind, front)
        )
        square = np.sum((front - places) ** 2, axis=1)
        return points_at(places, 1.0, radiance * (projected / square)[:, None], record), patches
    return None


def points_at(places: Array, lamp: float, irradiance: Array, record: np.void) -> Points:
    """Return points of an emitter as `points_of` does; `lamp` is 1 for places, 0 for directions."""
    count = len(places)
    target = np.tile([float(record["primitive"]), float(record["triangle"])], (count, 1))
    return np.column_stack([places, np.full(count, lamp)]), irradiance, target


# Patches of emitters: cells of the unit square, and the map of it onto the emitter.


@dataclass(frozen=True, eq=False)
class Patches(Rows):
    """Parts of emitters, one behind each of n points.

    Attributes
    ----------
    base, first, second : (n, 3) arrays
        Corner or middle, and edges or radii, of places [m], or of directions towards a sun.
    map : (n,) array
        `PatchMap` of the unit square.
    bulge : (n,) array
        Square of the sine of a sun's radius, by which its disk bends to the sphere of directions.
    cell : (n, 4) array
        Of the unit square: where it begins, and its sides.
    normal : (n, 3) array
        Of a flat lamp, over the cosine under which its point is seen from the front; 0 of what has none.
    """

    base: Array
    first: Array
    second: Array
    map: NDArray[np.intp]
    bulge: Array
    cell: Array
    normal: Array

    def at(self, s: Array, t: Array) -> Array:
        """Return a point (n, 3) of each patch, at coordinates (n,) of its cell."""
        u, v = self.cell[:, 0] + s * self.cell[:, 2], self.cell[:, 1] + t * self.cell[:, 3]
        over = (self.map == PatchMap.TRIANGLE) & (u + v > 1)
        x, y = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
        disk = self.map == PatchMap.DISK
        x = np.where(disk, np.sqrt(u) * np.cos(2 * np.pi * v), x)
        y = np.where(disk, np.sqrt(u) * np.sin(2 * np.pi * v), y)
        base = self.base * np.sqrt(1.0 - u * self.bulge)[:, None]
        return np.asarray(base + x[:, None] * self.first + y[:, None] * self.second)

    def rows(self) -> Array:
        """Return them (n, 20) as the kernel takes them."""
        has_normal = self.normal.any(axis=1)
        ends = self.map, self.bulge, np.zeros(len(self.map)), has_normal
        base, first, second, normal = (
            np.column_stack(pair) for pair in zip((self.base, self.first, self.second, self.normal), ends, strict=True)
        )
        return np.concatenate([base, first, second, self.cell, normal], axis=1)


def _patches(base: Array, first: Array, second: Array, kind: PatchMap, cells: Array, bulge: float = 0.0) -> Patches:
    count = len(cells)
    base, first, second = (np.tile(row, (count, 1)) for row in (base, first, second))
    return Patches(base, first, second, np.full(count, kind), np.full(count, bulge), cells, np.zeros((count, 3)))


def points_alone(places: Array) -> Patches:
    """Return patches that are no more than points (n, 3 or more)."""
    nothing = np.zeros(3)
    return replace(_patches(nothing, nothing, nothing, PatchMap.SQUARE, np.zeros((len(places), 4))), base=places[:, :3])


def square_patch(middle: Array, first: Array, second: Array) -> Patches:
    """Return one parallelogram of places or directions about a middle."""
    corner = middle - 0.5 * (first + second)
    return _patches(corner, first, second, PatchMap.SQUARE, np.array([[0.0, 0.0, 1.0, 1.0]]))


def _disk_cells() -> Array:
    """Return cells of a disk of equal areas: one in the middle, five and ten around it."""
    rings = ((0, 1), (1, 5), (6, 10))
    return np.array([(low / POINTS, k / n, n / POINTS, 1 / n) for low, n in rings for k in range(n)])


def _square_cells(aspect: float) -> Array:
    """Return cells of a square that are about as long as wide on a rectangle so many times as long as wide."""
    columns = 2 ** int(np.clip(np.rint(0.5 * np.log2(POINTS * aspect)), 0, np.log2(POINTS)))
    rows = POINTS // columns
    x, y = (grid.ravel() for grid in np.indices((columns, rows)))
    ones = np.ones(POINTS)
    return np.column_stack([x / columns, y / rows, ones / columns, ones / rows])


def _middles(patches: Patches) -> Array:
    middle = np.where((patches.map == PatchMap.TRIANGLE)[:, None], 1 / 3, 0.5) * np.ones((1, 2))
    whole = (patches.map == PatchMap.DISK) & (patches.cell[:, 3] == 1.0)  # about the middle of a disk, which is its own
    return patches.at(np.where(whole, 0.0, middle[:, 0]), middle[:, 1])


def lattice(count: int) -> tuple[Array, Array]:
    """Return points (n,) that are spread evenly over the unit square."""
    numbers = np.arange(count) + 0.5
    return numbers / count, np.mod(numbers * GOLDEN, 1.0)


def _on_sun(record: np.void, kind: EmitterKind) -> tuple[Array, Patches]:
    """Return unit directions (n, 3) towards points spread evenly over a sun, and its patches."""
    towards = record["normal"][:3].astype(np.float64)
    if kind is EmitterKind.DIRECTIONAL:
        return np.asarray(towards[None]), points_alone(towards[None])
    sine2 = float(record["a"][3])
    first, second = _across(towards)
    patches = _patches(towards, np.sqrt(sine2) * first, np.sqrt(sine2) * second, PatchMap.DISK, _disk_cells(), sine2)
    return _middles(patches), patches


def _across(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors across a unit direction."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    return np.asarray(first), np.cross(direction, first)


def _spot_share(record: np.void, away: Array) -> float:
    """Return the share of a spot's intensity in a unit direction away from it: a smooth step in the cosine."""
    off = away - record["normal"][:3]
    x = float(np.clip((float(record["u"][3]) - 0.5 * off @ off) * float(record["v"][3]), 0.0, 1.0))
    return x * x * (3.0 - 2.0 * x)


def _on_sphere(a: Array, front: Array) -> tuple[Array, Array, Patches]:
    """Return points of the disk as which a sphere shows to the front, the area that each shows [m2], and its patches.

    All have the same light there: the square of their distances is that of the centre.
    """
    distance = float(np.linalg.norm(front - a[:3]))
    first, second = _across((front - a[:3]) / distance)
    patches = _patches(a[:3], a[3] * first, a[3] * second, PatchMap.DISK, _disk_cells())
    places = _middles(patches)
    return places, np.pi * a[3] ** 2 / POINTS * np.sum((front - places) ** 2, axis=1) / distance**2, patches


def _on_flat(record: np.void, kind: EmitterKind, front: Array) -> tuple[Array, Array, Patches]:
    """Return points of a flat lamp, the area that each shows to the front [m2], and patches; dark from behind."""
    corner, x, y, normal = (record[name][:3].astype(np.float64) for name in ("a", "u", "v", "normal"))
    if kind is EmitterKind.TRIANGLE:
        patches = _patches(corner, x, y, PatchMap.TRIANGLE, np.array([[0.0, 0.0, 1.0, 1.0]]))
    elif kind is EmitterKind.DISK:
        patches = _patches(corner, x, y, PatchMap.DISK, _disk_cells())
    else:
        patches = _patches(corner, x, y, PatchMap.SQUARE, _square_cells(float(np.linalg.norm(x) / np.linalg.norm(y))))
    places = _middles(patches)
    to = front - places
    cosine = to @ normal / np.linalg.norm(to, axis=1)
    facing = cosine if not record["two_sided"] else np.abs(cosine)
    patches = replace(patches, normal=normal / np.where(cosine == 0, np.inf, cosine)[:, None])
    return places, np.maximum(facing, 0.0) * float(record["a"][3]) / len(places), patches


# Ways through the scene that the device finds blocked or open.

NOTHING = -1  # a target, or a triangle of one, that no primitive is
GROUP = 4  # work items
SHORT = 0.999  # of the way to a lamp, which does not hide itself


def occluded(
    session: Session,
    plan: Plan,
    buffers: SceneBuffers,
    origins: NDArray[Any],
    directions: NDArray[Any],
    reach: NDArray[Any],
    targets: NDArray[Any] | None = None,
) -> NDArray[np.bool_]:
    """Return whether something of the scene stands on each of n ways; glass does, too.

    Parameters
    ----------
    buffers
        The scene on the device.
    origins, directions : (n, 3) arrays
        In the plan's frame of the scene [m]; directions are unit vectors.
    reach : (n,) array
        Lengths of the ways [m].
    targets : (n, 2) array, optional
        Primitive, and triangle of it, that do not count.
    """
    if not len(origins):
        return np.zeros(0, np.bool_)
    rays, group = len(origins), GROUP * session.lanes
    count = -(-rays // group) * group
    packed = np.zeros((9, count), np.float32)
    packed[5], packed[7:] = 1.0, NOTHING
    packed[:3, :rays], packed[3:6, :rays], packed[6, :rays] = origins.T, directions.T, reach
    if targets is not None:
        packed[7:, :rays] = targets.T
    facts = plan.facts | buffers.tree_facts | {"VW": session.lanes}
    program = session.program(["pass/occluded.cl"], facts, device_declarations())
    blocked = session.allocate(4 * count)
    launch = session.bind(
        program, "occluded", **buffers.scene, rays=session.upload(packed), blocked=blocked, count=np.uint32(count)
    )
    launch.enqueue(count // session.lanes, GROUP)
    return session.read(blocked, np.int32, count)[:rays] > 0


def visible(
    session: Session,
    plan: Plan,
    buffers: SceneBuffers,
    patches: Patches,
    lamps: NDArray[np.bool_],
    target: Array,
    spots: Array,
) -> Array:
    """Return the share of places of a lens (n,) that each patch lights, a point of it each place.

    Parameters
    ----------
    lamps : (n,) array
        Which patches are places; those of others are directions.
    target : (n, 2) array
        Primitive, and triangle of it, of each.
    spots : (m, 3) array
        Places of the lens, about the eye [m].
    """
    count, (s, t) = len(patches), lattice(len(spots))
    origins = np.tile(spots, (count, 1))
    places = np.stack([patches.at(*pair) for pair in zip(s, t, strict=True)], axis=1).reshape(-1, 3)
    lamps = np.repeat(lamps, len(spots))
    way = np.where(lamps[:, None], places - origins, places)
    length = np.linalg.norm(way, axis=1)
    reach = np.where(lamps, SHORT * length, np.finfo(np.float32).max / 4)
    targets = np.repeat(target, len(spots), axis=0)
    dark = occluded(session, plan, buffers, origins, way / length[:, None], reach, targets)
    return np.asarray(1.0 - dark.reshape(count, len(spots)).mean(axis=1))


# The plan whose camera rays aim at lamps out of focus; the device tries through which pixels a lamp shows.


def aimed_plan(
    plan: Plan,
    session: Session,
    layers: Iterable[str] = (),
    buffers: SceneBuffers | None = None,
    conjugates: point_waves.Conjugates | None = None,
) -> tuple[Plan, SceneBuffers | None]:
    """Return the plan with camera rays that aim at lamps out of focus, and the scene on the device where it was needed.

    Without such a lamp it is the plan that was given. Tables of a scene that is not on the device yet are kept on disk:
    it is rendered once, and perhaps again by another process. A scene that is there has other tables the next moment,
    or the same lamps in other colours.

    Parameters
    ----------
    layers
        That the picture is to have.
    buffers
        The scene on the device, where it is there already.
    conjugates
        That rays go towards where waves bring what the lens is off; None for the rays of the lens.
    """
    given, is_alone = plan, buffers is None
    if conjugates is not None and point_waves.may_be_stigmatic(plan):
        buffers = buffers or SceneBuffers(session, plan)
        plan = point_waves.stigmatic(plan, point_waves.for_what_is_in_focus(conjugates, session, plan, buffers))
    if not may_aim(plan, layers):
        return plan, buffers if plan is given or buffers is None else SceneBuffers(session, plan, buffers)
    held = [buffers]

    def shows(sights: Sights) -> NDArray[np.bool_]:
        scene = held[0] = held[0] or SceneBuffers(session, plan)
        return _open(sights, session, plan, scene)

    new = aim(plan, shows, _name_of_sights(plan, session), on_disk=is_alone)
    scene = held[0]
    return new, scene if new is given or scene is None else SceneBuffers(session, new, scene)


def _name_of_sights(plan: Plan, session: Session) -> str | None:
    """Return a name for all that lines of sight through a scene depend on; None where textures cut holes."""
    if plan.facts["HAS_OPACITY"]:
        return None
    info = session.info
    driver = info.name, info.driver, session.kind, session.lanes
    code = identity_of_code(("rendering",), ("common", "geometry", "pass"))
    places: list[object] = [plan.primitives, plan.kind_end, plan.hidden]
    shapes = [*places, plan.movements.segments, plan.movements.of_primitive]
    meshes: list[object] = []
    if plan.meshes is not None:
        shapes += [plan.meshes.instances(), plan.meshes.group_of_instance]
        meshes = [(group.key, group.shift) for group in plan.meshes.groups]
    return content_name(code, driver, sorted(plan.facts.items()), shapes, meshes)


def _open(sights: Sights, session: Session, plan: Plan, buffers: SceneBuffers) -> NDArray[np.bool_]:
    away = sights.targets - sights.origins
    distance = np.linalg.norm(away, axis=1)
    reach = np.maximum(distance - sights.short, 0.0)
    return ~occluded(session, plan, buffers, sights.origins, away / distance[:, None], reach)


# What lights the front of a lens: points of lamps and suns, in the lens's frame, as far as nothing hides them.

_FRONT_POINTS = 8  # that look for what hides them
MOST_SOURCES = 512  # points that light is traced from
STEEPEST = 85.0  # degrees from the axis
_SMALL = 3e-3  # radius of a lamp over its distance, up to which all of it shines through the same parts of the front


@dataclass(frozen=True)
class Front:
    """The front of a lens: its first vertex and points around it, in the world about the eye [m]."""

    vertex: Array
    spots: Array
    radius: float


@dataclass(frozen=True)
class Sources:
    """Points that light a lens.

    Attributes
    ----------
    places : (n, 4) or (n, 12) array
        Direction in which light of a source at infinity travels, or where a lamp is [mm], in the frame of the lens;
        the last number is 1 of a lamp, 2 of a mirrored highlight. Where there are such, also how its direction changes
        along x and y of the first vertex's plane [1/mm].
    irradiance : (n, 3) array
        Across the light before the front of the lens [W/m2].
    left_out : tuple of str
        Kinds of lamps whose ghosts are not known.
    dropped_share : float
        Of all that light, what fainter sources than the brightest have.
    known : (n, 3) array
        Number of the spectrum of a lamp, 0 of one that has none; how many times it is the irradiance; and the number
        of the lamp, where light is not even of each part of it.
    patches : Patches
        Of the emitter around each point, in the frame of the lens, from which rays come.
    mirrored : int
        How many are mirrored highlights.
    """

    places: Array
    irradiance: Array
    left_out: tuple[str, ...]
    dropped_share: float
    known: Array
    patches: Patches
    mirrored: int = 0

    @property
    def tilt(self) -> float:
        """Largest tangent of the angle between the light and the axis."""
        sideways = np.hypot(self.places[:, 0], self.places[:, 1])
        return float(np.max(sideways / np.abs(self.places[:, 2]), initial=0.0))


@dataclass(frozen=True, eq=False)
class _Parts(Rows):
    """Parts of emitters.

    Attributes
    ----------
    at, light, target : (n, 4), (n, 3) and (n, 2) arrays
        As `points_of` gives them, in the world about the eye.
    known : (n, 3) array
        As that of `Sources`.
    patches : Patches
        In the world about the eye.
    """

    at: Array
    light: Array
    target: Array
    known: Array
    patches: Patches

    @property
    def lamps(self) -> NDArray[np.bool_]:
        """Which are places, not directions."""
        return np.asarray(self.at[:, 3] > 0)


def sources_of(
    scene: Scene, plan: Plan, buffers: SceneBuffers, session: Session, lens: Lens, film_z: float
) -> tuple[Sources, list[Points]]:
    """Return the sources of a scene that light the front of a lens from less than 85 degrees and are not hidden.

    With points of the bright parts of its surroundings, hidden or not; mirrors show them too.

    Parameters
    ----------
    scene : Scene
    plan : Plan
        Its plan, whose emitters count.
    buffers : SceneBuffers
    session : Session
    lens : Lens
    film_z : float
        Of the film in the frame of the lens [mm].
    """
    turn = at_opening(scene).camera.world_from_camera()[:3, :3]
    front = front_of(lens, film_z, turn)
    parts, far, left_out = _parts_of_emitters(scene, plan, front)
    parts, dropped = _brightest(parts, turn, film_z)
    seen = visible(session, plan, buffers, parts.patches, parts.lamps, parts.target, front.spots)
    parts, places = _unhidden(parts, _places_in_lens(parts, turn, film_z), seen)
    own = _in_lens(parts.patches, parts.lamps, turn, film_z)
    return Sources(places, parts.light, left_out, dropped, parts.known, own), far


def _parts_of_emitters(scene: Scene, plan: Plan, front: Front) -> tuple[_Parts, list[Points], tuple[str, ...]]:
    """Return the parts of all emitters, those of the surroundings among them, and kinds whose ghosts are unknown."""
    nothing = np.zeros((0, 4))
    parts = [_Parts(nothing, nothing[:, :3], nothing[:, :2], nothing[:, :3], points_alone(nothing))]
    far, left_out, records = list[Points](), set[str](), plan.emitters.shining
    for record in records:
        lamp, shown = patches_of(record, front.vertex), float(not record["hidden"] & Hidden.FROM_CAMERA)

        def add(points: Points, patches: Patches, parted: bool, *, shown: float = shown, own: np.void = record) -> None:
            at, light, target = points
            parts.append(_Parts(at, shown * light, target, _known(own, light, parted), patches))

        if int(record["kind"]) == EmitterKind.ENVIRONMENT:
            towards, irradiance, sides = bright_parts(scene)
            far = [points_at(towards[k : k + 1], 0.0, irradiance[k : k + 1], record) for k in range(len(towards))]
            for points, middle, own in zip(far, towards, sides, strict=True):
                add(points, square_patch(middle, *own), True)
            left_out.add("dim parts of the surroundings" if far else "surroundings")
        elif lamp is None:
            left_out.add(EmitterKind(int(record["kind"])).name.lower())
        else:
            triangles = int((records["primitive"] == record["primitive"]).sum())
            painted = _painted(record, lamp[1], plan.textures, front.vertex, _PARTS // triangles)
            add(*(painted or _as_one(*lamp, front.vertex)), painted is not None)
    whole = _Parts.joined(parts)
    whole.known[:, 2] = np.cumsum(whole.known[:, 2])
    return whole, far, tuple(sorted(left_out))


def _places_in_lens(parts: _Parts, turn: Array, film_z: float) -> Array:
    """Return where parts are [mm], or how their light travels, in the frame of the lens (n, 4)."""
    places, lamps = np.column_stack([parts.at[:, :3] @ turn, parts.at[:, 3]]), parts.lamps[:, None]
    places[:, :3] = np.where(lamps, (places[:, :3] - [0.0, 0.0, -film_z * 1e-3]) * 1e3, -places[:, :3])
    return places


def _brightest(parts: _Parts, turn: Array, film_z: float) -> tuple[_Parts, float]:
    """Return the brightest parts before the lens, and what share of the light there others have."""
    ways = np.where(parts.lamps[:, None], -1.0, 1.0) * _places_in_lens(parts, turn, film_z)[:, :3]
    seen = comes_from_ahead(ways) & (luminance(parts.light) > 0)
    bright = luminance(parts.light[seen])
    order = np.flatnonzero(seen)[np.argsort(-bright, kind="stable")[:MOST_SOURCES]]
    dropped = 1.0 - float(luminance(parts.light[order]).sum() / bright.sum()) if len(order) else 0.0
    return parts[order], dropped


def _unhidden(parts: _Parts, places: Array, seen: Array) -> tuple[_Parts, Array]:
    """Return parts of which a share is seen, with its light, and their places; a sun of which all is seen is one."""
    parts.known[:, 1] *= seen
    bright = seen > 0
    for sun in np.unique(parts.known[~parts.lamps, 2]):
        rows = np.flatnonzero(parts.known[:, 2] == sun)
        if len(rows) == POINTS and seen[rows].min() == 1:  # all of it lights as one
            first = rows[0]
            places[first], parts.light[first] = places[rows].mean(axis=0), parts.light[rows].sum(axis=0)
            parts.known[first, 1], parts.patches.cell[first] = parts.known[rows, 1].sum(), [0.0, 0.0, 1.0, 1.0]
            bright[rows[1:]] = False
    return replace(parts, light=parts.light * seen[:, None])[bright], places[bright]


def _as_one(
    points: tuple[Array, Array, Array], patches: Patches, vertex: Array
) -> tuple[tuple[Array, Array, Array], Patches]:
    """Return points and patches of an emitter; of a lamp that shows small from the front one, of all of it."""
    at, light, target = points
    if len(at) == 1 or not at[0, 3] or not _shows_small(patches, vertex):
        return points, patches
    whole = replace(patches[:1], cell=np.array([[0.0, 0.0, 1.0, 1.0]]), normal=patches.normal.mean(axis=0)[None])
    return (at.mean(axis=0)[None], light.sum(axis=0)[None], target[:1]), whole


def _shows_small(patches: Patches, vertex: Array) -> bool:
    """Return whether all of a lamp shines through the same parts of the front."""
    size = max(float(np.linalg.norm(side, axis=1).max()) for side in (patches.first, patches.second))
    half = np.full(len(patches), 0.5)
    return bool(size <= _SMALL * np.linalg.norm(patches.at(half, half) - vertex, axis=1).min())


def _known(record: np.void, irradiance: Array, parted: bool) -> Array:
    """Return the number of an emitter's spectrum, how many times it its points give, and which begin a lamp (n, 3)."""
    brightest = int(np.argmax(record["radiance"][:3]))
    times = irradiance[:, brightest] / max(float(record["radiance"][brightest]), 1e-300)
    begins = np.full(len(irradiance), float(parted))
    begins[0] = 1.0
    return np.column_stack([np.full(len(irradiance), float(record["radiance"][3])), times, begins])


# Lamps with a picture: parts of them within which the picture is nearly even.

_PARTS, _ACROSS = 64, 256  # of a lamp; points along its unit square that tell its picture
_EVEN = 1e-4  # of the squares of a picture's light about its mean: what parts may leave


def _painted(
    record: np.void, patches: Patches, textures: Textures, vertex: Array, most: int
) -> tuple[Points, Patches] | None:
    """Return points and patches of an emitter with a picture; None of others, and of patterns that are none."""
    texture = int(record["texture"])
    if texture < 0 or record["kind"] not in (*FLAT, EmitterKind.SPHERE):
        return None
    whole = replace(patches[:1], cell=np.array([[0.0, 0.0, 1.0, 1.0]]))
    across = np.clip(int(_ACROSS * np.sqrt(max(most, 1) / _PARTS)), 8, _ACROSS)
    t, s = (np.indices((across, across)).reshape(2, -1) + 0.5) / across
    places, sphere = whole[np.zeros(across**2, int)].at(s, t), record["kind"] == EmitterKind.SPHERE
    a, u, v, uv, uv_x, uv_y = (record[name][:3].astype(float) for name in ("a", "u", "v", "uv", "uv_x", "uv_y"))
    if sphere:  # u and v are its x and z axes, uv[2] its handedness
        to = places - a
        ahead = (vertex - a) / np.linalg.norm(vertex - a)
        to += ahead * np.sqrt(np.maximum(record["a"][3] ** 2 - np.sum(to**2, axis=1), 0))[:, None]
        east, north, up = to @ u, to @ np.cross(v, u) * uv[2], to @ v
        at = np.mod(np.arctan2(north, east) / (2 * np.pi), 1.0), np.arctan2(up, np.hypot(east, north)) / np.pi + 0.5
    else:
        x, y = ((places - a) @ np.linalg.pinv(np.array([u, v]))).T
        at = uv[0] + x * uv_x[0] + y * uv_y[0], uv[1] + x * uv_x[1] + y * uv_y[1]
    picture = textures.image_at(texture, *at)
    if picture is None:
        return None
    side = 1 if most < POINTS or _shows_small(patches, vertex) else math.isqrt(POINTS)
    cells, colours = _even_cells(picture.reshape(across, across, 3), side, max(most, 1))
    parts = replace(whole[np.zeros(len(cells), int)], cell=cells)
    middles, share = parts.at(np.full(len(cells), 0.5), np.full(len(cells), 0.5)), cells[:, 2:].prod(axis=1)
    away = vertex - (a if sphere else middles)
    square = np.sum(away**2, axis=-1)
    facing, normal = np.ones(len(cells)), record["normal"][:3].astype(float)
    if not sphere:
        cosine = away @ normal / np.sqrt(square)
        facing = np.maximum(np.abs(cosine) if record["two_sided"] else cosine, 0.0)
        parts = replace(parts, normal=normal / np.where(cosine == 0, np.inf, cosine)[:, None])
    area = (np.pi * record["a"][3] ** 2 if sphere else float(record["a"][3])) * share
    return points_at(middles, 1.0, colours * (area * facing / square)[:, None], record), parts


def _even_cells(picture: Array, side: int, most: int) -> tuple[Array, Array]:
    """Part a square picture (n, n, 3) of t and s into as even cells (m, 4) as may be; with their colours (m, 3).

    ``side`` is the number of cells along it to begin with.
    """
    size = len(picture)
    sums, squares = np.zeros((2, size + 1, size + 1, 3))
    sums[1:, 1:], squares[1:, 1:] = (each.cumsum(axis=0).cumsum(axis=1) for each in (picture, picture**2))

    def within(table: Array, y0: Any, x0: Any, y1: Any, x1: Any) -> Array:
        return np.asarray(table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0])

    def uneven(y0: Any, x0: Any, y1: Any, x1: Any) -> Array:
        area = np.asarray((y1 - y0) * (x1 - x0))[..., None]
        off = within(squares, y0, x0, y1, x1) - within(sums, y0, x0, y1, x1) ** 2 / area
        return np.asarray(np.maximum(off, 0.0).sum(axis=-1))

    ends = [size * k // side for k in range(side + 1)]
    cells = [(y0, x0, y1, x1) for y0, y1 in itertools.pairwise(ends) for x0, x1 in itertools.pairwise(ends)]
    left = [float(uneven(*cell)) for cell in cells]
    while len(cells) < most and sum(left) > _EVEN * float(squares[-1, -1].sum()):
        worst = int(np.argmax(left))
        y0, x0, y1, x1 = cells[worst]
        y, x = np.arange(y0 + 1, y1), np.arange(x0 + 1, x1)
        by_row = uneven(y0, x0, y, x1) + uneven(y, x0, y1, x1) + 1e-9 * np.abs(2 * y - y0 - y1)
        by_column = uneven(y0, x0, y1, x) + uneven(y0, x, y1, x1) + 1e-9 * np.abs(2 * x - x0 - x1)
        if np.min(by_row, initial=np.inf) < np.min(by_column, initial=np.inf):
            at = int(y[np.argmin(by_row)])
            halves = (y0, x0, at, x1), (at, x0, y1, x1)
        elif len(x):
            at = int(x[np.argmin(by_column)])
            halves = (y0, x0, y1, at), (y0, at, y1, x1)
        else:
            left[worst] = 0.0  # a point
            continue
        cells[worst : worst + 1], left[worst : worst + 1] = halves, [float(uneven(*half)) for half in halves]
    y0, x0, y1, x1 = np.array(cells).T
    colours = within(sums, y0, x0, y1, x1) / ((y1 - y0) * (x1 - x0))[:, None]
    return np.column_stack([x0, y0, x1 - x0, y1 - y0]) / size, colours


def front_of(lens: Lens, film_z: float, turn: Array) -> Front:
    """Return the front of a lens in the world about the eye."""
    vertex, radius = np.array([0.0, 0.0, -film_z * 1e-3]), lens.surfaces[0].semi_diameter * 1e-3
    u, v = lattice(_FRONT_POINTS)
    angle, reach = 2 * np.pi * v, radius * np.sqrt(u)
    spots = vertex + np.stack([reach * np.cos(angle), reach * np.sin(angle), np.zeros(_FRONT_POINTS)], axis=1)
    return Front(turn @ vertex, spots @ turn.T, radius)


def _in_lens(patches: Patches, lamps: NDArray[np.bool_], turn: Array, film_z: float) -> Patches:
    """Turn patches to the frame of the lens: places [mm], or ways in which light travels."""
    scale = np.where(lamps, 1e3, -1.0)[:, None]
    shift = np.where(lamps, film_z, 0.0)[:, None] * [0.0, 0.0, 1.0]
    first, second, base = (scale * (each @ turn) for each in (patches.first, patches.second, patches.base))
    return replace(patches, base=base + shift, first=first, second=second, normal=patches.normal @ turn)


def comes_from_ahead(ways: Array) -> NDArray[np.bool_]:
    """Return whether light that travels so (n, 3) comes from before the lens."""
    return np.asarray(ways[:, 2] > np.cos(np.radians(STEEPEST)) * np.linalg.norm(ways, axis=1))


# Wavelengths at which light of ghosts is traced, and what each source gives the film's colours at them.

WAVES_NM = (425.0, 475.0, 525.0, 575.0, 625.0, 675.0)  # where colours differ


class Band(NamedTuple):
    """A wavelength that stands for those up to half a width away [nm], and the light of sources in them [W/m2]."""

    nm: float
    light: Array
    half_nm: float


def bands(scene: Scene, plan: Plan, setting: LensSetting, sources: Sources, *, tinted: bool = False) -> list[Band]:
    """Return wavelengths for light given as red, green and blue, and for each spectrum of a lamp its own.

    A film of red, green and blue knows no spectra. Beyond what the lens is known for its last wavelength stands in.
    Where neither the lens nor anything else (`tinted`) tells colours apart there is one.
    """
    tinted, numbers = tinted or ghosts_have_colours(setting), sources.known[:, 0].astype(int)
    if plan.spectrum.kind == SpectrumKind.RGB:
        numbers = np.zeros_like(numbers)
    waves = WAVES_NM if tinted else (setting.camera.wavelength_nm,)
    shares = shares_of_white(WAVES_NM) if tinted else np.ones((1, 3))
    limits = usable_nm(setting.lens, setting.transmission) if tinted else (0.0, np.inf)

    def known(nm: float) -> float:
        return float(np.clip(nm, *limits))

    plain, every = numbers == 0, []
    if plain.any() or not len(plain):
        light = np.where(plain[:, None], sources.irradiance, 0.0)
        half = (WAVES_NM[1] - WAVES_NM[0]) / 2
        every = [Band(known(nm), light * share, half) for nm, share in zip(waves, shares, strict=True)]
    matching = observer(scene)[1]
    for number in np.unique(numbers[~plain]):
        times = np.where(numbers == number, sources.known[:, 1], 0.0)[:, None]
        for nm, seen, half in _bands_of_spectrum(plan.colours[0].samples[number - 1][:, None] * matching, waves):
            every.append(Band(known(nm), times * seen, half))
    return every


def _bands_of_spectrum(seen: Array, waves: tuple[float, ...]) -> Iterator[Band]:
    """Yield the middle [nm] of light (401, 3) in each band about some waves, and its sum (3,); none of dark ones."""
    places = np.argmin(np.abs(WAVELENGTHS_NM[:, None] - np.array(waves)), axis=1)
    for place, wave in enumerate(waves):
        own = seen[places == place]
        strength = np.abs(own).sum(axis=1)
        if strength.any():
            middle = float(WAVELENGTHS_NM[places == place] @ strength / strength.sum())
            square = float((WAVELENGTHS_NM[places == place] - middle) ** 2 @ strength / strength.sum())
            yield Band(middle if len(waves) > 1 else wave, own.sum(axis=0), math.sqrt(3.0 * square))
