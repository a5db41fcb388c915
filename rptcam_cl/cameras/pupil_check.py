"""Whether a sampling of the pupil holds the rays that pass: what lies apart from the main pupil slips through tables.

A ball behind a small window, for one, also passes a ring of rays round its main pupil: they cross the axis within the
glass, and spherical aberration brings them back to the window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.pupil_sampling import PupilCircle, PupilGrid, PupilLines, PupilSampling
from rptcam_cl.core.records import PupilKind
from rptcam_cl.optics import DIRECTIONS, FilmProbe, quarters_of, spread_points

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
    corners = probe.frame.corners(half_film_mm)[:, :2]
    if probe.lens.is_rotational and probe.frame.is_flat:
        farthest = corners[np.argmax(np.hypot(*corners.T))]
        corner = (float(np.hypot(*farthest)), 0.0) if sampling.radial else farthest
        film = np.linspace(0.0, FARTHEST, FILM_RADII)[:, None] * corner
    else:
        film = probe.frame.grid(half_film_mm, FILM_NODES).reshape(-1, 2)
    points = spread_points(probe.windows(film), RAYS)
    which = np.repeat(np.arange(len(film)), RAYS)
    film, points = film[which], points.reshape(-1, 2)
    outside = left_out(sampling, probe.frame.bounds(half_film_mm), film, points, APART)
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
    nodes, start, corners, turn = outlines_around(sampling, film)
    frames = sampling.table[: 4 * nodes].reshape(-1, 4).astype(np.float64)
    radii = sampling.table[start:][: 4 * nodes * DIRECTIONS].reshape(-1, DIRECTIONS, 4)[..., 0]
    frame = sum((share[:, None] * frames[node] for node, share in corners), np.zeros((len(film), 4)))
    x, y = points.T
    points = np.stack([x * turn[:, 0] + y * turn[:, 1], y * turn[:, 0] - x * turn[:, 1]], axis=1)
    away = (points - frame[:, :2]) / np.maximum(frame[:, 2:], 1e-300)
    place = np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) % 1.0 * DIRECTIONS
    first = np.minimum(place.astype(int), DIRECTIONS - 1)
    here, ahead = (
        sum((share * radii[node, k % DIRECTIONS] for node, share in corners), np.zeros(len(film)))
        for k in (first, first + 1)
    )
    radius = here + (place - first) * (ahead - here)
    return np.asarray((np.hypot(*away.T) > radius + margin) & (frame[:, 2] > 0))


def outlines_around(
    sampling: PupilSampling, film: Array
) -> tuple[int, int, list[tuple[NDArray[np.int64], Array]], Array]:
    """Return how many nodes a table has, where its radii start, the nodes round film points with the share that each
    has in what lies between, and the directions (n, 2) of the axes of the outlines there."""
    radius = np.hypot(*film.T)
    if isinstance(sampling.parameters, PupilLines):
        per_quarter, columns, lines = sampling.parameters
        nodes = int(lines + 1) * int(columns)
        start = 4 * (nodes + 1)
        reaches = sampling.table[start + 4 * (nodes * DIRECTIONS + 1) :].astype(np.float64)
        along = quarters_of(film) * per_quarter
        line = np.minimum(along.astype(int), int(lines) - 1)
        rows = [(line, 1.0 - (along - line)), (line + 1, along - line)]
        share_of_line = radius / sum(share * reaches[row] for row, share in rows)
        places = (1.0 - np.sqrt(np.maximum(1.0 - share_of_line, 0.0))) * (columns - 1)
        turn = np.where(radius[:, None] > 0, film / np.maximum(radius, 1e-300)[:, None], [1.0, 0.0])
    else:
        assert isinstance(sampling.parameters, PupilGrid)
        columns = sampling.parameters.across
        nodes, rows = int(columns), [(np.zeros(len(film), int), np.ones(len(film)))]
        start, places = 4 * (nodes + 1), radius * sampling.parameters.per_mm_across
        turn = np.broadcast_to([1.0, 0.0], film.shape)  # such film points are given on +x
    places = np.clip(places, 0.0, columns - 1)
    low = np.minimum(places.astype(int), int(columns) - 2)
    beside = [(low, 1.0 - (places - low)), (low + 1, places - low)]
    corners = [(row * int(columns) + column, share * other) for row, share in rows for column, other in beside]
    return nodes, start, corners, np.asarray(turn)
