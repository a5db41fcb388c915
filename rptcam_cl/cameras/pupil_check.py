"""Whether a sampling of the pupil holds the rays that pass: what lies apart from the main pupil slips through tables.

A ball behind a small window, for one, also passes a ring of rays round its main pupil: they cross the axis within the
glass, and spherical aberration brings them back to the window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.pupil_sampling import PupilCircle, PupilGrid, PupilSampling
from rptcam_cl.core.records import PupilKind
from rptcam_cl.optics import DIRECTIONS, FilmProbe, spread_points

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RAYS = 6000  # over the rear window, from each film point that is tried
FILM_RADII = 9  # film points, of a rotationally symmetric lens
FARTHEST = 0.97  # of the way to the corner: at the corner itself pupils close, and tables blur their slivers
FILM_NODES = 4  # the same along each side of the film, of other lenses
APART = 0.03  # sizes of the pupil by which a ray lies outside of it, and not at an edge that tables blur
FEW = 2  # such rays, that prove a part of its own


def loses_light(sampling: PupilSampling, probe: FilmProbe, half_film_mm: tuple[float, float]) -> bool:
    """Return whether rays pass that lie well outside of what a sampling draws from."""
    if probe.lens.is_rotational:
        corner = (float(np.hypot(*half_film_mm)), 0.0) if sampling.radial else half_film_mm
        film = np.linspace(0.0, FARTHEST, FILM_RADII)[:, None] * corner
    else:
        x, y = (np.linspace(-half, half, FILM_NODES) for half in half_film_mm)
        film = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = spread_points(probe.windows(film), RAYS)
    which = np.repeat(np.arange(len(film)), RAYS)
    film, points = film[which], points.reshape(-1, 2)
    outside = left_out(sampling, half_film_mm, film, points, APART)
    return bool(probe.passes(film[outside], points[outside]).sum() >= FEW)


def left_out(
    sampling: PupilSampling, half_film_mm: tuple[float, float], film: Array, points: Array, margin: float = 0.0
) -> Mask:
    """Return which points (n, 2) of the plane of the last vertex a sampling never draws from film points (n, 2).

    Parameters
    ----------
    sampling
        For outlines along a film radius, only film points on +x are given.
    margin
        Shares of the pupil's size by which a point must lie outside.
    """
    if isinstance(sampling.parameters, PupilCircle):
        shift, radius = sampling.parameters
        return np.asarray(np.hypot(*(points - shift * film).T) > (1.0 + margin) * radius)
    if sampling.kind == PupilKind.BOXES:
        return _out_of_boxes(sampling, half_film_mm, film, points, margin)
    return _out_of_outlines(sampling, film, points, margin)


def _out_of_boxes(
    sampling: PupilSampling, half_film_mm: tuple[float, float], film: Array, points: Array, margin: float
) -> Mask:
    assert isinstance(sampling.parameters, PupilGrid)
    count = np.array([sampling.parameters.across, sampling.parameters.down])
    cell = np.clip((film / half_film_mm + 1) / 2 * count, 0, count - 1).astype(int)
    table = sampling.table.reshape(int(count[1]), int(count[0]), 4).astype(np.float64)
    low, size = np.split(table[cell[:, 1], cell[:, 0]], 2, axis=1)
    out = (points < low - margin * size) | (points > low + (1.0 + margin) * size)
    return np.asarray(np.any(out, axis=1) & (size[:, 0] > 0))


def _out_of_outlines(sampling: PupilSampling, film: Array, points: Array, margin: float) -> Mask:
    assert isinstance(sampling.parameters, PupilGrid)
    columns, rows = int(sampling.parameters.across), int(sampling.parameters.down)
    nodes = columns * rows
    frames = sampling.table[: 4 * nodes].reshape(rows, columns, 4).astype(np.float64)
    radii = sampling.table[4 * (nodes + 1) :][: 4 * nodes * DIRECTIONS].reshape(rows, columns, DIRECTIONS, 4)[..., 0]
    corners = _corners(sampling, film)
    frame = sum((share[:, None] * frames[row, column] for row, column, share in corners), np.zeros((len(film), 4)))
    away = (points - frame[:, :2]) / np.maximum(frame[:, 2:], 1e-300)
    turn = np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) % 1.0 * DIRECTIONS
    first = np.minimum(turn.astype(int), DIRECTIONS - 1)
    here, ahead = (
        sum((share * radii[row, column, k % DIRECTIONS] for row, column, share in corners), np.zeros(len(film)))
        for k in (first, first + 1)
    )
    radius = here + (turn - first) * (ahead - here)
    return np.asarray((np.hypot(*away.T) > radius + margin) & (frame[:, 2] > 0))


def _corners(sampling: PupilSampling, film: Array) -> list[tuple[NDArray[np.int64], NDArray[np.int64], Array]]:
    """Return the nodes round film points, by row and column, and the share that each has in what lies between."""
    assert isinstance(sampling.parameters, PupilGrid)
    per_mm, down, columns, rows = sampling.parameters
    places = film * (per_mm, down) + (0.0 if sampling.radial else (np.array([columns, rows]) - 1) / 2)
    places = np.clip(places, 0.0, np.array([columns, rows]) - 1)
    low = np.minimum(places.astype(int), np.maximum(np.array([int(columns), int(rows)]) - 2, 0))
    share = places - low
    found = []
    for i in (0, 1):
        for j in (0, 1) if rows > 1 else (0,):
            weight = np.abs(1 - i - share[:, 0]) * np.abs(1 - j - share[:, 1])
            found.append((low[:, 1] + j, low[:, 0] + i, weight))
    return found
