"""Where polished surfaces show lamps to points of the front of a lens, and the light that comes by them.

A point shows a lamp where its normal halves the angle between the ways to the eye and to the lamp (Hanika, Droske and
Fascione 2015), which Newton's iteration finds. How that point moves with the eye gives the curvature of the wave that
arrives, and how it moves with the lamp the solid angle under which the lamp appears, thus its light.
"""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.plan import Bend, Faces, Outline

Array = NDArray[np.float64]

ITERATIONS = 12
CONVERGED, EXACT = 1e-7, 1e-10  # what a solution is off by at most, and where steps end
STEP = 1e-5  # of differences: coordinates of a piece, or in parts of the way
MARGIN = 0.5  # of a piece's range, by which what is nearly linear over it may leave it


@dataclass(frozen=True, eq=False)
class Sights:
    """Ways from eyes by polished pieces to lamps, one each.

    Attributes
    ----------
    faces : Faces
    eyes : (n, 3) array
        In the world about the eye of the camera [m].
    lamps : (n, 4) array
        Place of a lamp and 1, or unit direction towards it and 0.
    slopes : (n, 2) array
        Of the facet that reflects, against the surface.
    """

    faces: Faces
    eyes: Array
    lamps: Array
    slopes: Array

    def __getitem__(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Sights:
        return Sights(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Reflections:
    """What was found of n sights.

    Attributes
    ----------
    which : (n,) array
        Sights that were found.
    points : (n, 3) array
        Where the light is reflected [m].
    to_eye, to_lamp : (n, 3) arrays
        Unit vectors from there.
    cosine : (n,) array
        Of the angle between them and the facet.
    weight : (n,) array
        Of a facet's light: what those that the eye sees have over those that are there.
    behind : (n,) array
        Whether the back of the surface reflects.
    bend : (n, 3, 3) array
        By which the unit direction of light at the eye changes as the eye moves across it [1/m].
    growth : (n,) array
        Solid angle of the lamp's image over the lamp's area across the light [1/m2]; over its solid angle where it is
        at infinity.
    """

    which: NDArray[np.intp]
    points: Array
    to_eye: Array
    to_lamp: Array
    cosine: Array
    weight: Array
    behind: NDArray[np.bool_]
    bend: Array
    growth: Array


def may_reflect(sights: Sights, slack: Array) -> NDArray[np.bool_]:
    """Return which pieces may show their lamps: what differs from a reflection changes its sign over them, or nearly.

    Parameters
    ----------
    slack : (n,) array
        By which the half vector may be off.
    """
    found = np.zeros(len(sights.faces), np.bool_)
    rest = np.flatnonzero(_near_enough(sights, slack))
    found[rest] = _changes_sign(sights[rest], slack[rest])
    return found


def _near_enough(sights: Sights, slack: Array) -> NDArray[np.bool_]:
    """Return which flat pieces are not too far from reflecting, by their middles; all others are kept."""
    faces = sights.faces
    middle = _middle(faces)
    first, second = _across(_unit(faces.normals[:, 0]))
    half, normal, _ = _half_vector(sights, *middle, first, second)
    points = faces.at(*middle)[0]
    size = np.linalg.norm(faces.first, axis=1) + np.linalg.norm(faces.second, axis=1)
    near = np.linalg.norm(sights.eyes - points, axis=1)
    away = 1.0 / near + sights.lamps[:, 3] / np.linalg.norm(sights.lamps[:, :3] - sights.lamps[:, 3:] * points, axis=1)
    to_eye, to_lamp = _ways(sights, points)
    spread = size * away / np.maximum(np.linalg.norm(to_eye + to_lamp, axis=1), 0.1)
    spread += np.linalg.norm(faces.normals[:, 1], axis=1) + np.linalg.norm(faces.normals[:, 2], axis=1)
    close = np.linalg.norm(half - normal, axis=1) <= 2.0 * spread + slack
    return np.asarray(close | (faces.bend != Bend.FLAT) | (size > 0.2 * near))


def _changes_sign(sights: Sights, slack: Array) -> NDArray[np.bool_]:
    """Return what `may_reflect` does, of pieces one by one."""
    plain = sights.faces.plain
    first, second = _across(sights.faces.at(*_middle(sights.faces))[1])
    count, found = len(sights.faces), []
    for x, y in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)):
        half, normal, same = _half_vector(sights, np.full(count, x), np.full(count, y), first, second)
        off = half - normal
        found.append([_dot(off, first), _dot(off, second), same])
    corners = np.moveaxis(np.array(found), 1, 2)
    low, high = corners[..., :2].min(axis=0), corners[..., :2].max(axis=0)
    room = MARGIN * (high - low) + slack[:, None]
    curved = np.all((low - room <= 0) & (high + room >= 0), axis=1) & (corners[..., 2].max(axis=0) > 0)
    a, b = _plain_seed(sights)
    size = np.linalg.norm(sights.faces.first, axis=1), np.linalg.norm(sights.faces.second, axis=1)
    distance = np.linalg.norm(sights.faces.corner - sights.eyes, axis=1)
    reach = [np.minimum(4.0 * slack * (distance + each) / each, 1e3) for each in size]
    within = (a > -reach[0]) & (b > -reach[1]) & (a < 1 + reach[0]) & (b < 1 + reach[1])
    within |= sights.faces.outline == Outline.ENDLESS
    return np.asarray(np.where(plain, within & np.isfinite(a + b), curved))


def seeds(sights: Sights) -> tuple[Array, Array]:
    """Return coordinates near those of the reflection, within the pieces but for endless ones."""
    a, b = _plain_seed(sights)
    curved = ~sights.faces.plain
    if curved.any():
        own = sights[curved]
        first, second = _across(own.faces.at(*_middle(own.faces))[1])
        zero, one = np.zeros(len(own.faces)), np.ones(len(own.faces))
        corners = [_off(own, x, y, first, second) for x, y in ((zero, zero), (one, zero), (zero, one))]
        matrix = np.stack([corners[1] - corners[0], corners[2] - corners[0]], axis=2)
        a[curved], b[curved] = _solved(matrix, -corners[0]).T
    endless = sights.faces.outline == Outline.ENDLESS
    a, b = np.where(np.isfinite(a), a, 0.5), np.where(np.isfinite(b), b, 0.5)
    within = np.clip(a, 0.0, 1.0), np.clip(b, 0.0, 1.0)
    over = np.where(sights.faces.outline == Outline.TRIANGLE, np.maximum(within[0] + within[1], 1.0), 1.0)
    return np.where(endless, a, within[0] / over), np.where(endless, b, within[1] / over)


def reflections(sights: Sights, sharpest: float) -> Reflections:
    """Return where the pieces show their lamps.

    Parameters
    ----------
    sharpest : float
        Largest curvature of a wave [1/m]: one that is about to meet its focus is taken as one that has that curvature.
    """
    a, b, first, second = _solution(sights)
    off = _off(sights, a, b, first, second)
    points, normals = sights.faces.at(a, b)
    to_eye, to_lamp = _ways(sights, points)
    side = np.sign(_dot(normals, to_eye))
    facing = (side * _dot(normals, to_lamp) > 0) & (side * _dot(sights.faces.at(a, b)[1], to_eye) > 0)
    good = facing & np.all(np.abs(off) < CONVERGED, axis=1) & sights.faces.holds(a, b)
    which = np.flatnonzero(good)
    own, a, b, first, second = sights[which], a[which], b[which], first[which], second[which]
    to_eye, to_lamp, normals = to_eye[which], to_lamp[which], (side[:, None] * normals)[which]
    bend, growth = _waves(own, a, b, first, second, to_eye, to_lamp, sharpest)
    half = _unit(to_eye + to_lamp)
    cosine = _dot(half, to_eye)
    return Reflections(
        which, points[which], to_eye, to_lamp, cosine, _facet_weight(own, normals, half, to_eye),
        side[which] < 0, bend, growth,
    )  # fmt: skip


def _solution(sights: Sights) -> tuple[Array, Array, Array, Array]:
    """Return coordinates where nothing is off, if there are such, and the directions that it is measured along."""
    a, b = seeds(sights)
    first, second = _across(sights.faces.at(a, b)[1])
    bound = np.where(sights.faces.outline == Outline.ENDLESS, np.inf, 1.0)
    rest = np.arange(len(a))
    for _ in range(ITERATIONS):
        own, ways = sights[rest], (first[rest], second[rest])
        off = _off(own, a[rest], b[rest], *ways)
        step = _solved(_slope(own, a[rest], b[rest], *ways), -off)
        step = np.clip(np.nan_to_num(step), -bound[rest, None], bound[rest, None])
        a[rest], b[rest] = a[rest] + step[:, 0], b[rest] + step[:, 1]
        rest = rest[np.any(np.abs(off) > EXACT, axis=1)]
    return a, b, first, second


def _waves(
    sights: Sights, a: Array, b: Array, first: Array, second: Array, to_eye: Array, to_lamp: Array, sharpest: float
) -> tuple[Array, Array]:
    """Return how the light's direction changes with the eye, and the image's solid angle over the lamp's area."""
    slope = _slope(sights, a, b, first, second)
    points = sights.faces.at(a, b)[0]
    along = np.stack(
        [(sights.faces.at(a + STEP, b)[0] - points) / STEP, (sights.faces.at(a, b + STEP)[0] - points) / STEP], axis=2
    )
    moves = -along @ _inverse(slope)  # of the point, by what is off
    distance = np.linalg.norm(points - sights.eyes, axis=1)
    across = np.stack(_across(to_eye), axis=2)
    of_eye = np.empty((len(a), 2, 2))
    of_lamp = np.empty((len(a), 2, 2))
    beside = np.stack(_across(to_lamp), axis=2)
    far = sights.lamps[:, 3] == 0
    reach = np.where(far, 1.0, np.linalg.norm(sights.lamps[:, :3] - points, axis=1))
    for axis in (0, 1):
        for change, eye, lamp in ((of_eye, distance, 0.0 * reach), (of_lamp, 0.0 * distance, reach)):
            shift = STEP * eye[:, None] * across[:, :, axis], STEP * lamp[:, None] * beside[:, :, axis]
            ahead, back = (
                _off(_moved(sights, sign * shift[0], sign * shift[1]), a, b, first, second) for sign in (1.0, -1.0)
            )
            change[:, :, axis] = (ahead - back) / (2.0 * STEP * (eye + lamp))[:, None]
    moved_by_eye, moved_by_lamp = moves @ of_eye, moves @ of_lamp
    turned = np.swapaxes(across, 1, 2)
    curvature = turned @ (across - moved_by_eye) / distance[:, None, None]
    curvature = 0.5 * (curvature + np.swapaxes(curvature, 1, 2))
    curvature, less = _bounded(curvature, sharpest)
    bend = across @ curvature @ turned
    mean = 0.5 * np.trace(curvature, axis1=1, axis2=2)
    bend += mean[:, None, None] * to_eye[:, :, None] * to_eye[:, None, :]
    return bend, less * np.abs(np.linalg.det(turned @ moved_by_lamp / distance[:, None, None]))


def _bounded(curvature: Array, sharpest: float) -> tuple[Array, Array]:
    """Return symmetric matrices (n, 2, 2) whose eigenvalues are no larger, and the share of light that this leaves."""
    values, vectors = np.linalg.eigh(curvature)
    within = np.clip(values, -sharpest, sharpest)
    less = np.prod(sharpest / np.maximum(np.abs(values), sharpest), axis=1)
    return np.einsum("nik,nk,njk->nij", vectors, within, vectors), less


def _moved(sights: Sights, eye: Array, lamp: Array) -> Sights:
    """Return sights with eyes and lamps elsewhere; directions stay unit vectors."""
    lamps = sights.lamps.copy()
    lamps[:, :3] += lamp
    far = lamps[:, 3] == 0
    lamps[far, :3] = _unit(lamps[far, :3])
    return Sights(sights.faces, sights.eyes + eye, lamps, sights.slopes)


def _facet_weight(sights: Sights, normals: Array, half: Array, to_eye: Array) -> Array:
    """Return what facets that the eye sees have over those that are there; 1 of a smooth surface."""
    weight = _dot(half, to_eye) / np.maximum(_dot(normals, to_eye) * _dot(normals, half), 1e-6)
    return np.asarray(np.where(sights.slopes.any(axis=1), weight, 1.0))


def _plain_seed(sights: Sights) -> tuple[Array, Array]:
    """Return the coordinates where the plane of a piece shows the lamp; nan where it does not."""
    faces = sights.faces
    normal = _unit(np.cross(faces.first, faces.second))
    height = _dot(sights.eyes - faces.corner, normal)
    lamp = sights.lamps[:, :3] - np.where(sights.lamps[:, 3:] > 0, faces.corner, 0.0)
    image = sights.lamps[:, :3] - 2.0 * _dot(lamp, normal)[:, None] * normal
    way = np.where(sights.lamps[:, 3:] > 0, image - sights.eyes, image)
    fall = -_dot(way, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(height * _dot(lamp, normal) > 0, height / fall, np.nan)
        place = sights.eyes + share[:, None] * way - faces.corner
        square = np.stack([_dot(faces.first, faces.first), _dot(faces.second, faces.second)])
        cross = _dot(faces.first, faces.second)
        u, v = _dot(place, faces.first), _dot(place, faces.second)
        area = square[0] * square[1] - cross**2
        return (u * square[1] - v * cross) / area, (v * square[0] - u * cross) / area


def _slope(sights: Sights, a: Array, b: Array, first: Array, second: Array) -> Array:
    """Return how what is off changes with the coordinates (n, 2, 2)."""
    columns = [
        (_off(sights, a + x, b + y, first, second) - _off(sights, a - x, b - y, first, second)) / (2.0 * STEP)
        for x, y in ((STEP, 0.0), (0.0, STEP))
    ]
    return np.stack(columns, axis=2)


def _off(sights: Sights, a: Array, b: Array, first: Array, second: Array) -> Array:
    """Return by how much the half vector is off the normal of the facet, along two directions (n, 2)."""
    half, normal, _ = _half_vector(sights, a, b, first, second)
    return np.stack([_dot(half - normal, first), _dot(half - normal, second)], axis=1)


def _half_vector(sights: Sights, a: Array, b: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Return half vectors, the normals of facets, and whether eye and lamp are on the same side."""
    points, normals = sights.faces.at(a, b)
    to_eye, to_lamp = _ways(sights, points)
    front = _dot(normals, to_eye)
    normals = np.where(front < 0, -1.0, 1.0)[:, None] * normals
    tilted = normals + sights.slopes[:, :1] * first + sights.slopes[:, 1:] * second
    return _unit(to_eye + to_lamp), _unit(tilted), (_dot(normals, to_lamp) > 0).astype(np.float64)


def _ways(sights: Sights, points: Array) -> tuple[Array, Array]:
    """Return unit vectors from points to eyes and to lamps."""
    lamps = sights.lamps[:, :3]
    return _unit(sights.eyes - points), np.where(sights.lamps[:, 3:] > 0, _unit(lamps - points), lamps)


def _middle(faces: Faces) -> tuple[Array, Array]:
    middle = np.where(faces.outline == Outline.TRIANGLE, 1.0 / 3.0, 0.5)
    return middle, middle


def _across(directions: Array) -> tuple[Array, Array]:
    """Return two unit vectors across each unit direction."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = _unit(np.cross(directions, least))
    return first, np.cross(directions, first)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ni,ni->n", a, b))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])


def _inverse(matrices: Array) -> Array:
    """Return the inverses of 2x2 matrices; nothing finite where there is none."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.moveaxis(np.array([[d, -b], [-c, a]]) / (a * d - b * c), -1, 0)


def _solved(matrices: Array, right: Array) -> Array:
    """Return the solutions of two equations each."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.einsum("nij,nj->ni", _inverse(matrices), right))
