"""Where the picture shows a point: the place whose chief ray meets it, found in float64."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.chief_rays import CameraRays

Array = NDArray[np.float64]
Rays = Callable[[Array], tuple[Array, Array]]

ROUNDS = 12  # of Newton's iteration, which needs three to six
DIFFERENCE = 0.25  # pixels over which slopes are taken
CLOSE = 1e-7  # pixels, where the search ends
AHEAD = 0.999  # cosine above which a ray found counts as one to the point and not away from it
TRIALS = 33  # places each way from which a search without a guess begins


def seen_places(chief: CameraRays, points: Array, guess: Array | None = None) -> Array:
    """Return the places (n, 2) [pixels] at which points are seen; nan where no chief ray leads to them.

    Places beside the picture count as well: all of an ideal camera, those near the film of a lens.

    Parameters
    ----------
    points : (n, 4) array
        Homogeneous, in the frame of the camera [m]: x, y, z and 1, or a direction and 0 for what is at infinity.
    guess : (n, 2) array, optional
        Places near by.
    """
    if len(points) == 0:
        return np.zeros((0, 2))
    if chief.wraps:
        return _on_whole_sphere(chief, points)
    places = _nearest_trials(chief, points) if guess is None else np.array(guess, np.float64)
    found = np.full_like(places, np.nan)
    active = np.flatnonzero(np.isfinite(places).all(axis=1) & np.isfinite(points).all(axis=1))
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(ROUNDS):
            step = _step(chief, chief.smooth, places[active], points[active])
            places[active] -= step
            done = np.abs(step).max(axis=1) < CLOSE
            lost = ~np.isfinite(places[active]).all(axis=1)
            found[active[done]] = places[active[done]]
            active = active[~(done | lost)]
            if not len(active):
                break
        found -= _step(chief, chief.unlimited, found, points)
    return _ahead(chief, points, found)


def _step(chief: CameraRays, rays: Rays, places: Array, points: Array) -> Array:
    """Return by how much places (n, 2) are beside those that see the points, to first order [pixels]."""
    smooth, axes = _miss(chief.smooth, places, points)
    (a, c), (b, d) = (
        (_miss(chief.smooth, places + move, points, axes)[0] - smooth).T / DIFFERENCE for move in np.eye(2) * DIFFERENCE
    )
    x, y = (smooth if rays == chief.smooth else _miss(rays, places, points, axes)[0]).T
    return np.asarray(np.stack([d * x - b * y, a * y - c * x], axis=1) / (a * d - b * c)[:, None])


def _ahead(chief: CameraRays, points: Array, places: Array) -> Array:
    """Return the places without those whose ray leads away from the point."""
    with np.errstate(invalid="ignore", divide="ignore"):
        origins, directions = chief.smooth(places)
        away = _towards(points, origins)
        good = np.sum(away * directions, axis=1) > AHEAD
    return np.where(good[:, None], places, np.nan)


def _towards(points: Array, origins: Array) -> Array:
    away = points[:, :3] - points[:, 3:] * origins
    return np.asarray(away / np.linalg.norm(away, axis=1, keepdims=True))


def _miss(
    rays: Rays, places: Array, points: Array, axes: tuple[Array, Array] | None = None
) -> tuple[Array, tuple[Array, Array]]:
    """Return by how much the rays of places point beside the points, along two axes across the line of sight."""
    origins, directions = rays(places)
    away = _towards(points, origins)
    if axes is None:
        helper = np.where(np.abs(away[:, :1]) < 0.7, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
        first = np.cross(away, helper)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        axes = first, np.cross(away, first)
    beside = directions - np.sum(directions * away, axis=1, keepdims=True) * away
    return np.stack([np.sum(beside * axis, axis=1) for axis in axes], axis=1), axes


def _nearest_trials(chief: CameraRays, points: Array) -> Array:
    """Return the places of a grid over the film whose rays come nearest to the points."""
    width, height = chief.resolution
    grid = np.stack(np.meshgrid(np.linspace(0, width, TRIALS), np.linspace(0, height, TRIALS)), axis=-1).reshape(-1, 2)
    origins, directions = chief.smooth(grid)
    middle = origins[len(grid) // 2]
    towards = _towards(points, np.broadcast_to(middle, (len(points), 3)))
    return np.asarray(grid[np.argmax(np.nan_to_num(towards @ directions.T, nan=-1.0), axis=1)])


def _on_whole_sphere(chief: CameraRays, points: Array) -> Array:
    x, y, z = _towards(points, np.zeros((len(points), 3))).T
    upright = np.stack([np.arctan2(x, -z) / np.pi, np.arcsin(np.clip(y, -1, 1)) / (np.pi / 2)], axis=1)
    return chief.on_picture(upright)
