"""Dust and scratches in the plane of the stop, as holes in its outline.

Specks are numbered from the middle outwards, so that a wider stop shows those of a smaller one and more.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene import Dirt

Array = NDArray[np.float64]

SPECK_CORNERS = 9
RAGGED = 0.3  # how far corners of a speck lie beside its circle, in its radius
MOST = 1000  # specks, and scratches; of more the largest count
ALONG = 65  # places along a scratch that are looked at
ROOM = 0.999  # share of the outline's radius that dirt lies within


def edges_of(polygon: Array) -> Array:
    """Return the edges (n, 4), from x, y to x, y, of a polygon (n, 2)."""
    return np.concatenate([polygon, np.roll(polygon, -1, axis=0)], axis=1)


def dirt_edges(dirt: Dirt, outline: Array, radius_mm: float) -> Array:
    """Return the edges (n, 4) of dirt within an outline, clockwise, as holes have them.

    Parameters
    ----------
    dirt : Dirt
    outline : (n, 2) array
        Anticlockwise about its middle, from which every corner is seen; of any unit.
    radius_mm : float
        What its farthest corner is from the middle, in the plane of the stop.
    """
    middle = _middle(outline)
    about = outline - middle
    reach = np.hypot(*about.T)
    scale = float(reach.max()) / radius_mm
    order = np.argsort(np.arctan2(about[:, 1], about[:, 0]))
    rim = (np.arctan2(about[order, 1], about[order, 0]), reach[order] / scale * ROOM)
    specks = [polygon for polygon in _specks(dirt, radius_mm) if _inside(polygon, rim).all()]
    scratches = [polygon for line in _scratches(dirt, radius_mm) if (polygon := _clipped(line, dirt, rim)) is not None]
    edges = [edges_of(middle + scale * polygon[::-1]) for polygon in (*specks, *scratches)]
    return np.concatenate([np.zeros((0, 4)), *edges])


def _middle(polygon: Array) -> Array:
    """Return the centroid of the area of a polygon."""
    following = np.roll(polygon, -1, axis=0)
    cross = polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]
    return np.asarray(cross @ (polygon + following) / (3 * cross.sum()))


def _inside(points: Array, rim: tuple[Array, Array]) -> NDArray[np.bool_]:
    angles = np.arctan2(points[:, 1], points[:, 0])
    return np.asarray(np.hypot(*points.T) < np.interp(angles, *rim, period=2 * np.pi))


def _spread(density: float, radius_mm: float, seed: int, numbers: int) -> tuple[Array, Array]:
    """Return places (n, 2) about the middle [mm], and random numbers (n, numbers) beside each."""
    count = int(np.ceil(density * np.pi * radius_mm**2))
    drawn = np.random.default_rng(seed).random((count, 2 + numbers))
    distance = np.sqrt((np.arange(count) + drawn[:, 0]) / (np.pi * max(density, 1e-300)))
    angle = 2 * np.pi * drawn[:, 1]
    return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1), drawn[:, 2:]


def _sizes(drawn: Array) -> Array:
    """Return factors of median 1 that are nearly log-normal, of three random numbers each."""
    return np.asarray(np.exp(drawn[:, :3].sum(axis=1) - 1.5))


def _specks(dirt: Dirt, radius_mm: float) -> list[Array]:
    """Return the corners of ragged specks about the middle [mm]."""
    at, drawn = _spread(dirt.dust_per_mm2, radius_mm, dirt.seed, 3 + SPECK_CORNERS)
    radii = 0.5e-3 * dirt.dust_um * _sizes(drawn)
    angles = 2 * np.pi * np.arange(SPECK_CORNERS) / SPECK_CORNERS
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    chosen = np.sort(np.argsort(-radii, kind="stable")[:MOST])
    return [at[k] + (radii[k] * (1 + RAGGED * (2 * drawn[k, 3:] - 1)))[:, None] * ring for k in chosen]


def _scratches(dirt: Dirt, radius_mm: float) -> list[tuple[Array, Array]]:
    """Return both ends of scratches about the middle [mm]."""
    at, drawn = _spread(dirt.scratches_per_mm2, radius_mm, dirt.seed + 1, 4)
    halves = 0.5 * dirt.scratch_mm * _sizes(drawn)
    angles = np.pi * drawn[:, 3]
    away = halves[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return [(at[k] - away[k], at[k] + away[k]) for k in np.sort(np.argsort(-halves, kind="stable")[:MOST])]


def _clipped(line: tuple[Array, Array], dirt: Dirt, rim: tuple[Array, Array]) -> Array | None:
    """Return the corners of the part of a scratch within the rim; None where it is not longer than wide."""
    first, last = line
    wide = 0.5e-3 * dirt.scratch_um
    across = np.array([first[1] - last[1], last[0] - first[0]])
    across *= wide / np.hypot(*across)
    places = first + np.linspace(0, 1, ALONG)[:, None] * (last - first)
    good = _inside(places - across, rim) & _inside(places + across, rim)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    if not len(ends):
        return None
    longest = int(np.argmax(ends[1::2] - ends[::2]))
    a, b = places[ends[2 * longest]], places[ends[2 * longest + 1] - 1]
    if np.hypot(*(b - a)) <= 2 * wide:
        return None
    return np.stack([a - across, b - across, b + across, a + across])
