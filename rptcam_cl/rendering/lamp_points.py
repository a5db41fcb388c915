"""Lamps and suns as points of light, as they show to a place of the scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.kinds import EmitterKind
from rptcam_cl.rendering.shares import GOLDEN

Array = NDArray[np.float64]
Points = tuple[Array, Array, Array]

POINTS = 16  # of a lamp or sun of a size
FAR = (EmitterKind.SUN, EmitterKind.DIRECTIONAL)
FLAT = (EmitterKind.RECTANGLE, EmitterKind.DISK, EmitterKind.TRIANGLE)


def points_of(record: np.void, front: Array) -> Points | None:
    """Return places [m about the eye] with 1, or directions towards with 0; irradiance at the front; and targets."""
    kind, radiance = EmitterKind(int(record["kind"])), record["radiance"][:3].astype(np.float64)
    a = record["a"].astype(np.float64)
    if kind in FAR:
        towards, weight = _directions(record, kind), radiance
        if kind is EmitterKind.SUN:
            weight = radiance * np.pi * a[3]
        return points_at(towards, 0.0, np.tile(weight / len(towards), (len(towards), 1)), record)
    if kind in (EmitterKind.POINT, EmitterKind.SPOT):
        to = front - a[:3]
        share = _spot_share(record, to / np.linalg.norm(to)) if kind is EmitterKind.SPOT else 1.0
        return points_at(a[None, :3], 1.0, share * radiance[None] / (to @ to), record)
    if kind in FLAT or kind is EmitterKind.SPHERE:
        places, projected = _on_sphere(a, front) if kind is EmitterKind.SPHERE else _on_flat(record, kind, front)
        square = np.sum((front - places) ** 2, axis=1)
        return points_at(places, 1.0, radiance * (projected / square)[:, None], record)
    return None


def points_at(places: Array, lamp: float, irradiance: Array, record: np.void) -> Points:
    """Return points of an emitter as `points_of` does; `lamp` is 1 for places, 0 for directions."""
    count = len(places)
    target = np.tile([float(record["primitive"]), float(record["triangle"])], (count, 1))
    return np.column_stack([places, np.full(count, lamp)]), irradiance, target


def lattice(count: int) -> tuple[Array, Array]:
    """Return points (n,) that are spread evenly over the unit square."""
    numbers = np.arange(count) + 0.5
    return numbers / count, np.mod(numbers * GOLDEN, 1.0)


def _directions(record: np.void, kind: EmitterKind) -> Array:
    """Return unit directions (n, 3) towards points spread evenly over a sun."""
    towards = record["normal"][:3].astype(np.float64)
    if kind is EmitterKind.DIRECTIONAL:
        return np.asarray(towards[None])
    u, v = lattice(POINTS)
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
    """Return points of the disk as which a sphere shows to the front, and the area that each shows [m2].

    All have the same light there: the square of their distances is that of the centre.
    """
    distance = float(np.linalg.norm(front - a[:3]))
    first, second = _across((front - a[:3]) / distance)
    u, v = lattice(POINTS)
    radius, angle = a[3] * np.sqrt(u)[:, None], 2 * np.pi * v[:, None]
    places = a[:3] + radius * (np.cos(angle) * first + np.sin(angle) * second)
    return places, np.pi * a[3] ** 2 / POINTS * np.sum((front - places) ** 2, axis=1) / distance**2


def _on_flat(record: np.void, kind: EmitterKind, front: Array) -> tuple[Array, Array]:
    """Return points of a flat lamp, and the area that each shows to the front [m2]; dark from behind."""
    corner, x, y, normal = (record[name][:3].astype(np.float64) for name in ("a", "u", "v", "normal"))
    count = 1 if kind is EmitterKind.TRIANGLE else POINTS
    u, v = lattice(count)
    if kind is EmitterKind.DISK:
        u, v = np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v)
    if kind is EmitterKind.TRIANGLE:
        u, v = np.full(1, 1 / 3), np.full(1, 1 / 3)
    places = corner + u[:, None] * x + v[:, None] * y
    to = front - places
    cosine = to @ normal / np.linalg.norm(to, axis=1)
    cosine = np.abs(cosine) if record["two_sided"] else np.maximum(cosine, 0.0)
    return places, cosine * float(record["a"][3]) / count
