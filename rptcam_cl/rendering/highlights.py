"""Mirrored highlights: lamps and suns that the front of a lens sees in polished surfaces, as pencils of light.

First, points of the front look for reflections of lamps in the pieces of all polished surfaces. What they find, and
nothing hides, is gathered by direction into pencils, which go through the lens as the light of lamps does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import EmitterKind
from rptcam_cl.device import Session
from rptcam_cl.plan import SPREADING_ALPHA, Faces, Lobe, Plan, joined, lobes_of, polished_count, polished_faces
from rptcam_cl.rendering.buffers import SceneBuffers
from rptcam_cl.rendering.lamp_points import FLAT, POINTS, Points, lattice, points_of
from rptcam_cl.rendering.occlusion import occluded
from rptcam_cl.rendering.reflections import Sights, may_reflect, reflections, seeds

Array = NDArray[np.float64]

LAMPS = 64  # the brightest, that are looked for
MOST_PAIRS = 1 << 23  # of lamps and pieces
SIGHTS, TOGETHER = 1 << 16, 256  # sights followed at a time; pieces whose sights are made at a time
NEIGHBOURS = 0.02  # of the way to a lamp, within which pieces see the same points of it
MANY = 64  # pieces, from which each point of a lamp is looked for from one point of the front
SHORT = 1e-3  # of a way at its ends, which do not hide it
CELLS = 600.0  # per radian, within which reflections of a lamp in a primitive make one pencil
SPREAD = 12.0  # widest slope of a facet that is followed, over alpha


@dataclass(frozen=True)
class Front:
    """The front of a lens: its first vertex and points around it, in the world about the eye [m]."""

    vertex: Array
    spots: Array
    radius: float


@dataclass(frozen=True)
class Pencils:
    """Light that arrives at the front.

    Attributes
    ----------
    ways : (n, 3) array
        Unit direction of the light at the first vertex.
    bends : (n, 3, 3) array
        By which it changes as one moves across it [1/m].
    irradiance : (n, 3) array
        Across the light at the vertex, on the mean over the front [W/m2].
    """

    ways: Array
    bends: Array
    irradiance: Array


@dataclass(frozen=True)
class Lamp:
    """A lamp.

    Attributes
    ----------
    points : callable
        Its points, as they show to a place of the world about the eye.
    strength : float
        Luminance of the irradiance that it may give the front.
    """

    points: Callable[[Array], Points]
    strength: float


@dataclass(frozen=True, eq=False)
class _Trial:
    """Sights with the light of each lamp's point and where it comes from."""

    sights: Sights
    light: Array
    targets: Array
    lobe: NDArray[np.intp]
    lamp: NDArray[np.intp]


def lamps_among(records: NDArray[np.void], parts: Sequence[Points], front: Array) -> list[Lamp]:
    """Return the brightest lamps of emitter records and of parts of the surroundings; an emissive mesh is one lamp."""
    found = [Lamp(partial(_as_they_are, part), float(luminance(part[1]).sum())) for part in parts]
    for (kind, _), group in groupby(records, key=_owner):
        own = np.array(list(group), records.dtype)
        if kind is EmitterKind.TRIANGLE:
            found.append(_some_of_mesh(own, front))
        else:
            known = [record for record in own if points_of(record, front) is not None]
            found += [Lamp(partial(_together, [record], 1.0), _strength(record, front)) for record in known]
    return sorted(found, key=lambda lamp: -lamp.strength)[:LAMPS]


def highlights(
    plan: Plan, session: Session, buffers: SceneBuffers, lamps: Sequence[Lamp], front: Front
) -> Pencils | None:
    """Return the light of lamps that polished surfaces reflect to the front; None where there is none."""
    if not lamps:
        return None
    lobes = {index: list(lobes_of(plan.materials, index)) for index in range(len(plan.materials))}
    numbered = [lobe for own in lobes.values() for lobe in own]
    if not numbered:
        return None
    found, lamps = [], lamps[: max(MOST_PAIRS // max(polished_count(plan), 1), 1)]
    for faces in polished_faces(plan):
        for trial in _trials(faces, lobes, numbered, lamps, front):
            found += _reflected(trial, numbered, front, plan, session, buffers)
    return _gathered(found) if found else None


def _owner(record: np.void) -> tuple[EmitterKind, int]:
    return EmitterKind(int(record["kind"])), int(record["primitive"])


def _strength(record: np.void, front: Array) -> float:
    """Return the luminance of the irradiance that a lamp gives a surface that faces it, where the front is."""
    kind, bright, a = EmitterKind(int(record["kind"])), float(luminance(record["radiance"][:3])), record["a"]
    if kind is EmitterKind.DIRECTIONAL:
        return bright
    if kind is EmitterKind.SUN:
        return float(bright * np.pi * a[3])
    area = a[3] if kind in FLAT else np.pi * a[3] ** 2 if kind is EmitterKind.SPHERE else 1.0
    away = front - a[:3]
    return float(bright * area / max(float(away @ away), 1e-12))


def _some_of_mesh(records: NDArray[np.void], front: Array) -> Lamp:
    """Return an emissive mesh as some of its triangles, with the power of all."""
    power = np.asarray(luminance(records["radiance"][:, :3]) * records["a"][:, 3])
    chosen = np.arange(len(records))
    if len(records) > POINTS:
        steps = (np.arange(POINTS) + 0.5) / POINTS * power.sum()
        chosen = np.unique(np.minimum(np.searchsorted(np.cumsum(power), steps), len(records) - 1))
    scale = float(power.sum() / max(float(power[chosen].sum()), 1e-300))
    own = list(records[chosen])
    return Lamp(partial(_together, own, scale), scale * sum(_strength(record, front) for record in own))


def _as_they_are(part: Points, _: Array) -> Points:
    """Return points at infinity."""
    return part


def _together(records: Sequence[np.void], scale: float, place: Array) -> Points:
    """Return the points of some emitters, with more light than theirs."""
    parts = [part for record in records if (part := points_of(record, place)) is not None]
    at, light, target = (np.concatenate(column) for column in zip(*parts, strict=True))
    return at, scale * light, target


def _trials(
    faces: Faces, lobes: dict[int, list[Lobe]], numbered: list[Lobe], lamps: Sequence[Lamp], front: Front
) -> Iterator[_Trial]:
    """Yield what may reflect lamps in pieces, some at a time."""
    widest = np.array([max((SPREAD * lobe.alpha for lobe in own), default=0.0) for own in lobes.values()])
    first = np.cumsum([0, *map(len, lobes.values())])
    parts: list[_Trial] = []
    for number, lamp in enumerate(lamps):
        for some, places in _candidates(faces, widest[faces.material], lamp, front):
            for material in np.unique(faces.material[some]):
                own = some[faces.material[some] == material]
                for lobe in range(int(first[material]), int(first[material + 1])):
                    parts += _paired(faces[own], numbered[lobe].alpha, lobe, places, number, front)
            if sum(len(part.light) for part in parts) > SIGHTS:
                yield _joined(parts)
                parts = []
    if parts:
        yield _joined(parts)


def _candidates(
    faces: Faces, widest: Array, lamp: Lamp, front: Front
) -> Iterator[tuple[NDArray[np.intp], tuple[Points, bool]]]:
    """Yield pieces that may show a lamp to the front, with the lamp as it shows to them, and whether they are many."""
    count = len(faces)
    places = lamp.points(front.vertex)[0]
    centre = np.append(places[:, :3].mean(axis=0), places[0, 3])
    size = 1.25 * float(np.linalg.norm(places[:, :3] - centre[:3], axis=1).max())
    sights = Sights(faces, np.tile(front.vertex, (count, 1)), np.tile(centre, (count, 1)), np.zeros((count, 2)))
    corners = faces.at(np.zeros(count), np.zeros(count))[0]
    to_eye, to_lamp = front.vertex - corners, centre[:3] - centre[3] * corners
    near, far = np.linalg.norm(to_eye, axis=1), np.linalg.norm(to_lamp, axis=1)
    sum_of_units = np.linalg.norm(to_eye / near[:, None] + to_lamp / far[:, None], axis=1)
    slack = (front.radius / near + size / far) / np.maximum(sum_of_units, 0.1) + widest
    found = np.flatnonzero(may_reflect(sights, slack))
    if not len(found):
        return
    seen_from = sights[found].faces.at(*seeds(sights[found]))[0]
    way = np.linalg.norm(centre[:3] - seen_from, axis=1).min() if centre[3] else np.inf
    cells = np.floor(seen_from / max(NEIGHBOURS * float(way), 1e-9)) if centre[3] else np.zeros((len(found), 1))
    _, place = np.unique(cells, axis=0, return_inverse=True)
    for cell in range(int(place.max()) + 1):
        own = np.flatnonzero(place.reshape(-1) == cell)
        middle = seen_from[own].mean(axis=0)
        at, light, target = lamp.points(middle)
        square = np.where(at[:, 3:] > 0, np.sum((at[:, :3] - middle) ** 2, axis=1)[:, None], 1.0)
        for low in range(0, len(own), TOGETHER):
            yield found[own[low : low + TOGETHER]], ((at, light * square, target), len(found) > MANY)


def _paired(
    faces: Faces, alpha: float, lobe: int, lamp: tuple[Points, bool], number: int, front: Front
) -> list[_Trial]:
    """Return the sights of pieces: each point of a lamp, with a slope of the facets, from each point of the front."""
    (places, light, targets), many = lamp
    slopes = np.zeros((1, 2))
    if alpha >= SPREADING_ALPHA:
        u, v = lattice(POINTS)
        steep, angle = alpha * np.sqrt(u / (1.0 - u)), 2.0 * np.pi * v
        slopes = np.stack([steep * np.cos(angle), steep * np.sin(angle)], axis=1)
    # Each point with each slope, or with one where there are as many; of many pieces from one point of the front.
    point, slope = (grid.ravel() for grid in np.indices((len(places), len(slopes))))
    if len(places) == len(slopes) > 1:
        point, slope = np.arange(POINTS), 7 * np.arange(POINTS) % POINTS
    spot = np.tile(np.arange(len(front.spots)), len(point))
    point, slope = np.repeat(point, len(front.spots)), np.repeat(slope, len(front.spots))
    if many and len(places) * len(slopes) > 1:
        chosen = spot == (point + slope) % len(front.spots)
        point, slope, spot = point[chosen], slope[chosen], spot[chosen]
    share = len(places) / len(point)
    lit = luminance(light)[point] > 0
    point, slope, spot = point[lit], slope[lit], spot[lit]
    face, pair = (grid.ravel() for grid in np.indices((len(faces), len(point))))
    sights = Sights(faces[face], front.spots[spot[pair]], places[point[pair]], slopes[slope[pair]])
    may = may_reflect(sights, np.zeros(len(face)))
    if not may.any():
        return []
    count, point = int(may.sum()), point[pair][may]
    lobes, lamps = np.full(count, lobe), np.full(count, number)
    return [_Trial(sights[may], share * light[point], targets[point], lobes, lamps)]


def _joined(trials: list[_Trial]) -> _Trial:
    faces = joined([trial.sights.faces for trial in trials])
    rest = (np.concatenate([getattr(trial.sights, name) for trial in trials]) for name in ("eyes", "lamps", "slopes"))
    own = ("light", "targets", "lobe", "lamp")
    return _Trial(Sights(faces, *rest), *(np.concatenate([getattr(trial, name) for trial in trials]) for name in own))


Found = tuple[Array, Array, Array, NDArray[np.intp]]


def _reflected(
    trial: _Trial, lobes: list[Lobe], front: Front, plan: Plan, session: Session, buffers: SceneBuffers
) -> list[Found]:
    """Return ways and bends at the vertex, irradiance, and lamp and primitive, of reflections that nothing hides."""
    found = reflections(trial.sights, 1.0 / front.radius)
    if not len(found.which):
        return []
    own = trial.sights[found.which]
    light = trial.light[found.which] * (found.weight * found.growth)[:, None]
    for number in np.unique(trial.lobe[found.which]):
        mine = trial.lobe[found.which] == number
        light[mine] *= lobes[number].reflectance(found.cosine[mine], found.behind[mine])
    # Look whether anything stands on the way to the front, or to the lamp.
    near = np.linalg.norm(own.eyes - found.points, axis=1)
    far = np.where(own.lamps[:, 3] > 0, np.linalg.norm(own.lamps[:, :3] - found.points, axis=1), np.inf)
    start = SHORT * np.minimum(near, far)
    dark = occluded(session, plan, buffers, own.eyes, -found.to_eye, (1.0 - SHORT) * near)
    reach = np.minimum((1.0 - SHORT) * far - start, float(np.finfo(np.float32).max) / 4)
    origins = found.points + start[:, None] * found.to_lamp
    dark |= occluded(session, plan, buffers, origins, found.to_lamp, reach, trial.targets[found.which])
    # Take the wave from the point of the front to the first vertex.
    ways = found.to_eye + np.einsum("nij,nj->ni", found.bend, front.vertex - own.eyes)
    length = np.linalg.norm(ways, axis=1)
    owner = np.stack([trial.lamp[found.which], own.faces.primitive], axis=1)
    every = ways / length[:, None], found.bend / length[:, None, None], light / length[:, None] ** 2, owner
    return [(every[0][~dark], every[1][~dark], every[2][~dark], every[3][~dark])]


def _gathered(found: list[Found]) -> Pencils | None:
    """Return pencils: reflections of a lamp in a primitive by cells of direction, in the order of the cells."""
    ways, bends, light, owner = (np.concatenate(column) for column in zip(*found, strict=True))
    weight = luminance(light)
    lit = weight > 0
    if not lit.any():
        return None
    ways, bends, light, owner, weight = ways[lit], bends[lit], light[lit], owner[lit], weight[lit]
    cells = np.concatenate([owner, np.floor(ways * CELLS).astype(np.intp)], axis=1)
    _, place = np.unique(cells, axis=0, return_inverse=True)
    place = place.reshape(-1)
    irradiance: Array = np.stack([np.bincount(place, part) for part in light.T], axis=1)
    total = np.bincount(place, weight)
    ways = np.stack([np.bincount(place, weight * part) for part in ways.T], axis=1)
    bends = np.stack([np.bincount(place, weight * part) for part in bends.reshape(-1, 9).T], axis=1)
    length = np.linalg.norm(ways, axis=1)
    return Pencils(ways / length[:, None], (bends / total[:, None]).reshape(-1, 3, 3), irradiance)
