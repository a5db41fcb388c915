"""What lights the front of a lens: points of lamps and suns, in the lens's frame, as far as nothing hides them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.kinds import EmitterKind
from rptcam_cl.device import Session
from rptcam_cl.optics import Lens
from rptcam_cl.plan import Plan, bright_parts
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.occlusion import occluded
from rptcam_cl.scene import Scene, at_opening

Array = NDArray[np.float64]

POINTS = 16  # of a lamp or sun of a size
FRONT_POINTS = 8  # that look for what hides them
MOST = 512  # points that light is traced from
STEEPEST = 85.0  # degrees from the axis
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
FAR = (EmitterKind.SUN, EmitterKind.DIRECTIONAL)
FLAT = (EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE)
SHORT = 0.999  # of the way to a lamp, which does not hide itself


@dataclass(frozen=True)
class Sources:
    """Points that light a lens.

    Attributes
    ----------
    places : (n, 4) array
        Direction in which light of a source at infinity travels, or where a lamp is [mm], in the frame of the lens;
        the last number is 1 of a lamp.
    irradiance : (n, 3) array
        Across the light before the front of the lens [W/m2].
    left_out : tuple of str
        Kinds of lamps whose ghosts are not known.
    dropped_share : float
        Of all that light, what fainter sources than the brightest have.
    """

    places: Array
    irradiance: Array
    left_out: tuple[str, ...]
    dropped_share: float

    @property
    def tilt(self) -> float:
        """Largest tangent of the angle between the light and the axis."""
        sideways = np.hypot(self.places[:, 0], self.places[:, 1])
        return float(np.max(sideways / np.abs(self.places[:, 2]), initial=0.0))


def ghost_sources(
    scene: Scene, plan: Plan, buffers: SceneBuffers, session: Session, lens: Lens, film_z: float
) -> Sources:
    """Return the sources of a scene that light the front of a lens from less than 85 degrees and are not hidden.

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
    points, left_out = [], set()
    for record in plan.emitters.records[: plan.emitters.count]:
        found = _points(record, turn @ [0.0, 0.0, -film_z * 1e-3])
        if int(record["kind"]) == EmitterKind.ENVIRONMENT:
            towards, irradiance = bright_parts(scene)
            points += [_found(towards, 0.0, irradiance, record)] if len(towards) else []
            left_out.add("dim parts of the surroundings" if len(towards) else "surroundings")
        elif found is None:
            left_out.add(EmitterKind(int(record["kind"])).name.lower())
        else:
            points.append(found)
    at, light, target = (np.concatenate([part[i] for part in points]) if points else np.zeros((0, 5)) for i in range(3))
    if not len(at):
        return Sources(np.zeros((0, 4)), np.zeros((0, 3)), tuple(sorted(left_out)), 0.0)
    front = np.array([0.0, 0.0, -film_z * 1e-3])  # of the lens in the camera's frame [m]
    places = np.column_stack([at[:, :3] @ turn, at[:, 3]])
    lamps = places[:, 3] > 0
    places[:, :3] = np.where(lamps[:, None], (places[:, :3] - front) * 1e3, -places[:, :3])
    ahead = np.where(lamps, -places[:, 2], places[:, 2])
    seen = ahead > np.cos(np.radians(STEEPEST)) * np.linalg.norm(places[:, :3], axis=1)
    seen &= luminance(light) > 0
    places, light, target, at = places[seen], light[seen], target[seen], at[seen]
    order = np.argsort(-luminance(light), kind="stable")[:MOST]
    dropped = 1.0 - float(luminance(light[order]).sum() / max(luminance(light).sum(), 1e-300))
    places, light, target, at = places[order], light[order], target[order], at[order]
    visible = _visible(session, plan, buffers, at, target, turn, front, lens.surfaces[0].semi_diameter * 1e-3)
    bright = visible > 0
    return Sources(places[bright], light[bright] * visible[bright, None], tuple(sorted(left_out)), dropped)


def _points(record: np.void, front: Array) -> tuple[Array, Array, Array] | None:
    """Return places [m about the eye] with 1, or directions towards with 0; irradiance at the front; and targets."""
    kind, radiance = EmitterKind(int(record["kind"])), record["radiance"][:3].astype(np.float64)
    a = record["a"].astype(np.float64)
    if kind in FAR:
        towards, weight = _directions(record, kind), radiance
        if kind is EmitterKind.SUN:
            weight = radiance * np.pi * a[3]
        return _found(towards, 0.0, np.tile(weight / len(towards), (len(towards), 1)), record)
    if kind in (EmitterKind.POINT, EmitterKind.SPOT):
        to = front - a[:3]
        share = _spot_share(record, to / np.linalg.norm(to)) if kind is EmitterKind.SPOT else 1.0
        return _found(a[None, :3], 1.0, share * radiance[None] / (to @ to), record)
    if kind in FLAT or kind is EmitterKind.SPHERE:
        places, projected = _on_sphere(a, front) if kind is EmitterKind.SPHERE else _on_flat(record, kind, front)
        square = np.sum((front - places) ** 2, axis=1)
        return _found(places, 1.0, radiance * (projected / square)[:, None], record)
    return None


def _found(places: Array, lamp: float, irradiance: Array, record: np.void) -> tuple[Array, Array, Array]:
    count = len(places)
    target = np.tile([float(record["primitive"]), float(record["triangle"])], (count, 1))
    return np.column_stack([places, np.full(count, lamp)]), irradiance, target


def _lattice(count: int) -> tuple[Array, Array]:
    numbers = np.arange(count) + 0.5
    return numbers / count, np.mod(numbers * GOLDEN, 1.0)


def _directions(record: np.void, kind: EmitterKind) -> Array:
    """Return unit directions (n, 3) towards points spread evenly over a sun."""
    towards = record["normal"][:3].astype(np.float64)
    if kind is EmitterKind.DIRECTIONAL:
        return np.asarray(towards[None])
    u, v = _lattice(POINTS)
    first, second = _across(towards)
    sine2 = u * float(record["a"][3])
    sine, angle = np.sqrt(sine2)[:, None], 2 * np.pi * v[:, None]
    aside = np.cos(angle) * first + np.sin(angle) * second
    found: Array = np.sqrt(1 - sine2)[:, None] * towards + sine * aside
    return found


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


def _on_sphere(a: Array, front: Array) -> tuple[Array, Array]:
    """Return points of the half of a sphere towards the front, and the area that each shows [m2]."""
    towards = (front - a[:3]) / np.linalg.norm(front - a[:3])
    first, second = _across(towards)
    u, v = _lattice(POINTS)
    radius, angle = a[3] * np.sqrt(u)[:, None], 2 * np.pi * v[:, None]
    height = a[3] * np.sqrt(1 - u)[:, None]
    places = a[:3] + height * towards + radius * (np.cos(angle) * first + np.sin(angle) * second)
    return places, np.full(POINTS, np.pi * a[3] ** 2 / POINTS)


def _on_flat(record: np.void, kind: EmitterKind, front: Array) -> tuple[Array, Array]:
    """Return points of a flat lamp, and the area that each shows to the front [m2]; dark from behind."""
    corner, x, y, normal = (record[name][:3].astype(np.float64) for name in ("a", "u", "v", "normal"))
    count = 1 if kind is EmitterKind.TRIANGLE else POINTS
    u, v = _lattice(count)
    if kind is EmitterKind.DISK:
        u, v = np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v)
    if kind is EmitterKind.TRIANGLE:
        u, v = np.full(1, 1 / 3), np.full(1, 1 / 3)
    places = corner + u[:, None] * x + v[:, None] * y
    to = front - places
    cosine = to @ normal / np.linalg.norm(to, axis=1)
    cosine = np.abs(cosine) if record["two_sided"] else np.maximum(cosine, 0.0)
    return places, cosine * float(record["a"][3]) / count


def _visible(
    session: Session,
    plan: Plan,
    buffers: SceneBuffers,
    at: Array,
    target: Array,
    turn: Array,
    front: Array,
    radius: float,
) -> Array:
    """Return the share of the front of the lens (n,) that each source lights; `at` as `_points` has it."""
    u, v = _lattice(FRONT_POINTS)
    angle, reach = 2 * np.pi * v, radius * np.sqrt(u)
    spots = front + np.stack([reach * np.cos(angle), reach * np.sin(angle), np.zeros(FRONT_POINTS)], axis=1)
    origins = np.tile(spots @ turn.T, (len(at), 1))
    places, lamps = np.repeat(at[:, :3], FRONT_POINTS, axis=0), np.repeat(at[:, 3], FRONT_POINTS) > 0
    way = np.where(lamps[:, None], places - origins, places)
    length = np.linalg.norm(way, axis=1)
    reach = np.where(lamps, SHORT * length, np.finfo(np.float32).max / 4)
    targets = np.repeat(target, FRONT_POINTS, axis=0)
    dark = occluded(session, plan, buffers, origins, way / length[:, None], reach, targets)
    return np.asarray(1.0 - dark.reshape(len(at), FRONT_POINTS).mean(axis=1))
