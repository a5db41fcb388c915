"""What lights the front of a lens: points of lamps and suns, in the lens's frame, as far as nothing hides them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import EmitterKind
from rptcam_cl.device import Session
from rptcam_cl.optics import Lens
from rptcam_cl.plan import Plan, bright_parts
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.highlights import Front, Pencils, highlights, lamps_among
from rptcam_cl.rendering.lamp_points import lattice, points_at, points_of
from rptcam_cl.rendering.occlusion import occluded
from rptcam_cl.scene import Scene, at_opening

Array = NDArray[np.float64]

FRONT_POINTS = 8  # that look for what hides them
MOST = 512  # points that light is traced from
STEEPEST = 85.0  # degrees from the axis
FAINT = 1e-3  # of all light, below which the faintest sources beside highlights are left out
PENCIL = 2.0  # in place of 0 and 1, of a source whose light has the curvature of its own
SHORT = 0.999  # of the way to a lamp, which does not hide itself


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
    known : (n, 2) array
        Number of the spectrum of a lamp, 0 of one that has none, and how many times it is the irradiance.
    mirrored : int
        How many are mirrored highlights.
    """

    places: Array
    irradiance: Array
    left_out: tuple[str, ...]
    dropped_share: float
    known: Array
    mirrored: int = 0

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
    front = _front(lens, film_z, turn)
    found, left_out, parts = [], set(), []
    records = plan.emitters.records[: plan.emitters.count]
    for record in records:
        points = points_of(record, front.vertex)
        if int(record["kind"]) == EmitterKind.ENVIRONMENT:
            parts = [points_at(*part, record) for part in _parts(scene)]
            found += [(*part, _known(record, part[1])) for part in parts]
            left_out.add("dim parts of the surroundings" if parts else "surroundings")
        elif points is None:
            left_out.add(EmitterKind(int(record["kind"])).name.lower())
        else:
            found.append((*points, _known(record, points[1])))
    if not found:
        return Sources(np.zeros((0, 4)), np.zeros((0, 3)), tuple(sorted(left_out)), 0.0, np.zeros((0, 2)))
    at, light, target, known = (np.concatenate(column) for column in zip(*found, strict=True))
    places = np.column_stack([at[:, :3] @ turn, at[:, 3]])
    lamps = places[:, 3] > 0
    places[:, :3] = np.where(lamps[:, None], (places[:, :3] - [0.0, 0.0, -film_z * 1e-3]) * 1e3, -places[:, :3])
    seen = _ahead(np.where(lamps[:, None], -places[:, :3], places[:, :3])) & (luminance(light) > 0)
    places, light, target, at, known = places[seen], light[seen], target[seen], at[seen], known[seen]
    order = np.argsort(-luminance(light), kind="stable")[:MOST]
    dropped = 1.0 - float(luminance(light[order]).sum() / luminance(light).sum()) if len(order) else 0.0
    places, light, target, at, known = places[order], light[order], target[order], at[order], known[order]
    visible = _visible(session, plan, buffers, at, target, front)
    bright, kinds = visible > 0, tuple(sorted(left_out))
    known[:, 1] *= visible
    direct = Sources(places[bright], light[bright] * visible[bright, None], kinds, dropped, known[bright])
    pencils = highlights(plan, session, buffers, lamps_among(records, parts, front.vertex), front)
    return direct if pencils is None else _with_pencils(direct, pencils, turn)


def _known(record: np.void, irradiance: Array) -> Array:
    """Return the number of an emitter's spectrum, and how many times it its points give (n, 2)."""
    brightest = int(np.argmax(record["radiance"][:3]))
    times = irradiance[:, brightest] / max(float(record["radiance"][brightest]), 1e-300)
    return np.column_stack([np.full(len(irradiance), float(record["radiance"][3])), times])


def _front(lens: Lens, film_z: float, turn: Array) -> Front:
    """Return the front of a lens in the world about the eye."""
    vertex, radius = np.array([0.0, 0.0, -film_z * 1e-3]), lens.surfaces[0].semi_diameter * 1e-3
    u, v = lattice(FRONT_POINTS)
    angle, reach = 2 * np.pi * v, radius * np.sqrt(u)
    spots = vertex + np.stack([reach * np.cos(angle), reach * np.sin(angle), np.zeros(FRONT_POINTS)], axis=1)
    return Front(turn @ vertex, spots @ turn.T, radius)


def _parts(scene: Scene) -> list[tuple[Array, float, Array]]:
    """Return the bright parts of the surroundings one by one, as `points_at` takes them."""
    towards, irradiance = bright_parts(scene)
    return [(towards[k : k + 1], 0.0, irradiance[k : k + 1]) for k in range(len(towards))]


def _ahead(ways: Array) -> NDArray[np.bool_]:
    """Return whether light that travels so (n, 3) comes from before the lens."""
    return np.asarray(ways[:, 2] > np.cos(np.radians(STEEPEST)) * np.linalg.norm(ways, axis=1))


def _with_pencils(direct: Sources, pencils: Pencils, turn: Array) -> Sources:
    """Return sources with mirrored highlights; the faintest of all are left out."""
    ways, bends = pencils.ways @ turn, turn.T @ pencils.bends @ turn * 1e-3
    ahead = _ahead(ways) & np.all(np.isfinite(bends), axis=(1, 2))
    places, first = np.zeros((len(direct.places) + int(ahead.sum()), 12)), len(direct.places)
    places[:first, :4] = direct.places
    places[first:, :3], places[first:, 3] = ways[ahead], PENCIL
    places[first:, 4:7], places[first:, 8:11] = bends[ahead, :, 0], bends[ahead, :, 1]
    light = np.concatenate([direct.irradiance, pencils.irradiance[ahead]])
    bright = luminance(light)
    order = np.argsort(-bright, kind="stable")
    share = np.cumsum(bright[order]) / max(float(bright.sum()), 1e-300)
    order = np.sort(order[: min(int(np.searchsorted(share, 1.0 - FAINT)) + 1, MOST)])
    mirrored = int((order >= first).sum())
    if not mirrored:
        return direct
    every = float(bright[:first].sum()) / (1.0 - direct.dropped_share) + float(bright[first:].sum())
    dropped = 1.0 - float(bright[order].sum()) / every
    known = np.concatenate([direct.known, np.zeros((int(ahead.sum()), 2))])
    return Sources(places[order], light[order], direct.left_out, dropped, known[order], mirrored)


def _visible(session: Session, plan: Plan, buffers: SceneBuffers, at: Array, target: Array, front: Front) -> Array:
    """Return the share of the front of the lens (n,) that each source lights; `at` as `points_of` has it."""
    origins = np.tile(front.spots, (len(at), 1))
    places, lamps = np.repeat(at[:, :3], FRONT_POINTS, axis=0), np.repeat(at[:, 3], FRONT_POINTS) > 0
    way = np.where(lamps[:, None], places - origins, places)
    length = np.linalg.norm(way, axis=1)
    reach = np.where(lamps, SHORT * length, np.finfo(np.float32).max / 4)
    targets = np.repeat(target, FRONT_POINTS, axis=0)
    dark = occluded(session, plan, buffers, origins, way / length[:, None], reach, targets)
    return np.asarray(1.0 - dark.reshape(len(at), FRONT_POINTS).mean(axis=1))
