"""Circles on the plane of the last vertex that hold every ray which passes, one per interval of film radius.

Rays drawn inside the circle instead of over the whole rear element waste fewer samples and change nothing else,
provided that no passing ray is left out. So the circles are conservative: found from traced grids whose boundary is
then refined, and widened by a margin for what lies between the traced rays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.optics.probe import PATCH_AZIMUTHS, FilmProbe, cells, grid, narrowed

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

COARSE = (32, 16)
FINE = (64, 32)
DENSE = (128, 64)
THIN = 0.35  # passing share below which the grid may miss the tips of a crescent, so the next intervals' count too
BETWEEN = 6  # parts of an interval in which the pupil closes
BISECTIONS = 6


@dataclass(frozen=True)
class PupilCircles:
    """Exit pupil bounds of a rotationally symmetric lens at one film position.

    Attributes
    ----------
    film_distance_mm, film_radius_mm : float
    circles : (intervals, 3) array
        For film radii between i and i + 1 times film_radius / intervals: offset of the centre from the axis, along the
        direction of the film point [mm]; radius [mm], 0 where nothing passes; share of the circle's area that passes.
    """

    film_distance_mm: float
    film_radius_mm: float
    circles: Array

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self.circles, dtype=dtype)

    @property
    def image_circle_radius_mm(self) -> float:
        """Film radius of the outermost interval that still receives light [mm]."""
        lit = np.flatnonzero(self.circles[:, 1] > 0)
        return float((lit[-1] + 1) / len(self.circles) * self.film_radius_mm) if len(lit) else 0.0


def exit_pupil_circles(
    lens: Lens,
    film_distance_mm: float,
    film_radius_mm: float,
    intervals: int = 64,
    wavelength_nm: float = WAVELENGTH_D,
) -> PupilCircles:
    """Return the circles that hold the pupil for every interval of film radius.

    Parameters
    ----------
    lens : Lens
        Without rotational symmetry the circles hold the whole last surface as seen from the film.
    film_distance_mm : float
        Last vertex to film.
    film_radius_mm : float
        Half the diagonal of the film.
    intervals : int
    wavelength_nm : float

    Raises
    ------
    InputError
        When no light reaches the film at all.
    """
    if lens.stop is not None and lens.stop.stop_shape is not None:
        lens = lens.with_stop_shape(None)  # the circles hold the round stop, hence every shape in it
    probe = FilmProbe(lens, film_distance_mm, wavelength_nm)
    if not film_radius_mm > 0:
        raise InputError(f"{lens.name}: the film radius must be above 0 mm (got {film_radius_mm:g})")
    edges = np.linspace(0.0, film_radius_mm, intervals + 1)
    if not lens.is_rotational:
        return PupilCircles(float(film_distance_mm), float(film_radius_mm), _rear_circles(probe, edges))
    outlines = _outlines(probe, edges)
    lit = np.array([outline is not None for outline in outlines])
    if not lit.any():
        raise InputError(f"{lens.name}: no light reaches the film {film_distance_mm:g} mm behind the lens")
    circles = np.zeros((intervals, 3))
    for i in range(intervals):
        parts = outlines[i : i + 2]
        if lit[i] != lit[i + 1]:
            parts = _outlines(probe, np.linspace(edges[i], edges[i + 1], BETWEEN + 1))
        circles[i] = _circle(parts)
        if 0 < circles[i, 2] < THIN:
            circles[i] = _circle([*parts, *outlines[max(i - 1, 0) : i + 3]])
    return PupilCircles(float(film_distance_mm), float(film_radius_mm), circles)


def _rear_circles(probe: FilmProbe, edges: Array) -> Array:
    """Return circles (m, 3) that hold every ray to the last surface from film points at any azimuth.

    Seen from the film, points of the surface lie at s q + (1 - s) p, q being their distance vector from the axis, p the
    film point and s = D / (D - z).
    """
    scale = probe.distance / (probe.distance - probe.patch[:, 2])
    reach = float(np.max(np.hypot(probe.patch[:, 0], probe.patch[:, 1]) * scale)) / np.cos(np.pi / PATCH_AZIMUTHS)
    low, high = np.outer(edges, 1.0 - scale).min(axis=1), np.outer(edges, 1.0 - scale).max(axis=1)
    low, high = np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])
    circles = np.stack([(low + high) / 2, reach + (high - low) / 2, np.zeros(len(low))], axis=1)
    for i, (offset, radius, _) in enumerate(circles):
        film = np.array([[edges[i : i + 2].mean(), 0.0]])
        points = grid(np.array([[offset - radius, offset + radius, -radius, radius]]), 24, 24)
        circles[i, 2] = probe.passes(film[:, None], points).mean() * 4 / np.pi
    return circles


@dataclass
class _Outline:
    """Points (k, 2) on the edge of the pupil, their spacing, and the area of the pupil."""

    points: Array
    spacing: float
    area: float


def _outlines(probe: FilmProbe, radii: Array) -> list[_Outline | None]:
    """Return the outline of the pupil from film points on the +x axis. Only half of it is traced, v > 0."""
    film = np.stack([radii, np.zeros_like(radii)], axis=1)
    boxes, found = _half_boxes(probe, film)
    if not found.any():
        return [None] * len(radii)
    points = grid(boxes, *FINE)
    hits = np.zeros(points.shape[:-1], dtype=bool)
    hits[found] = probe.passes(film[found][:, None], points[found])
    size = cells(boxes, *FINE)
    spacing = np.hypot(size[:, 0], size[:, 1])
    which, where = np.nonzero(hits & ~_surrounded(hits))
    rim = _pushed_out(probe, film[which], points[which, where], spacing[which], boxes[which])
    return [
        _Outline(rim[which == k], float(spacing[k]), float(2 * hits[k].sum() * size[k].prod()))
        if hits[k].any()
        else None
        for k in range(len(radii))
    ]


def _half_boxes(probe: FilmProbe, film: Array) -> tuple[Array, Mask]:
    """Return boxes round the half v > 0 of each pupil. Dark film points beside lit ones are searched for slivers."""
    windows = probe.windows(film)
    windows[:, 2] = 0.0
    boxes, found = narrowed(probe, film, windows, COARSE)
    if not found.any():
        boxes[:1], found[:1] = narrowed(probe, film[:1], windows[:1], DENSE)
    if not found.any():
        boxes, found = narrowed(probe, film, windows, DENSE)
    tried = found.copy()
    while len(next_ones := np.flatnonzero(_beside(found) & ~tried)):
        for k in next_ones:
            near = k - 1 if k > 0 and found[k - 1] else k + 1
            around = _widened(boxes[near], film[k, 0] - film[near, 0])
            for region, shape in ((around, COARSE), (windows[k], DENSE), (around, DENSE)):
                one = slice(k, k + 1)
                boxes[one], found[one] = narrowed(probe, film[one], region[None], shape)
                if found[k]:
                    break
        tried[next_ones] = True
    boxes[:, 2] = 0.0
    return boxes, found


def _beside(found: Mask) -> Mask:
    """Return which film points have a lit one before or after them."""
    beside = np.zeros_like(found)
    beside[1:] |= found[:-1]
    beside[:-1] |= found[1:]
    return beside


def _widened(box: Array, shift: float) -> Array:
    """Return a half box made twice as large, and larger still by the step between film points."""
    u = (box[1] - box[0]) / 2 + abs(shift)
    return np.array([box[0] - u, box[1] + u, 0.0, 1.5 * box[3] + abs(shift)])


def _surrounded(hits: Mask) -> Mask:
    """Return which cells have passing neighbours on all four sides; the pupil goes on mirrored below v = 0."""
    table = hits.reshape(len(hits), *FINE)
    padded = np.zeros((len(hits), FINE[0] + 2, FINE[1] + 2), dtype=bool)
    padded[:, 1:-1, 1:-1] = table
    padded[:, 1:-1, 0] = table[:, :, 0]
    around = padded[:, :-2, 1:-1] & padded[:, 2:, 1:-1] & padded[:, 1:-1, :-2] & padded[:, 1:-1, 2:]
    return around.reshape(hits.shape)


def _pushed_out(probe: FilmProbe, film: Array, points: Array, reach: Array, boxes: Array) -> Array:
    """Return passing points moved away from the middle of their box as far as they still pass, at most by `reach`."""
    centre = np.stack([(boxes[:, 0] + boxes[:, 1]) / 2, np.zeros(len(boxes))], axis=1)
    away = points - centre
    away /= np.maximum(np.hypot(away[:, 0], away[:, 1]), 1e-300)[:, None]
    low, high = np.zeros(len(points)), reach.copy()
    far = probe.passes(film, points + away * high[:, None])
    low[far] = high[far]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        passing = probe.passes(film, points + away * middle[:, None])
        low, high = np.where(passing, middle, low), np.where(passing, high, middle)
    return points + away * high[:, None]


def _circle(outlines: list[_Outline | None]) -> tuple[float, float, float]:
    """Return offset, radius and passing share of the least circle centred on the u axis that holds every outline."""
    parts = [outline for outline in outlines if outline is not None]
    if not parts:
        return 0.0, 0.0, 0.0
    u, v = np.concatenate([part.points for part in parts]).T
    low, high = float(u.min()), float(u.max())
    for _ in range(40):
        first, second = low + (high - low) / 3, high - (high - low) / 3
        if np.max((u - first) ** 2 + v * v) < np.max((u - second) ** 2 + v * v):
            high = second
        else:
            low = first
    centre = (low + high) / 2
    # Outlines are sampled every `spacing`; a corner between two samples reaches at most half of it farther.
    radius = float(np.sqrt(np.max((u - centre) ** 2 + v * v))) + 0.6 * max(part.spacing for part in parts)
    area = float(np.mean([part.area for part in parts]))
    return centre, radius, min(1.0, area / (np.pi * radius * radius))
