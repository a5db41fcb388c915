"""Lamps and suns of a scene as points of light, what hides them, and camera rays that aim at them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import GOLDEN
from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.records import EmitterKind, PatchMap, device_declarations
from rptcam_cl.core.remember import content_name, identity_of_code
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import point_waves
from rptcam_cl.rendering.cameras.lamp_aim import Sights
from rptcam_cl.rendering.plan.plan import Plan, aim, may_aim
from rptcam_cl.rendering.scene_buffers import SceneBuffers

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
