"""How wide a lens blurs points of the scene on the film, by exact rays.

A point is named by the film point that sees it, through the middle of the pupil, and by its vergence: one over its
distance along that ray [1/mm], counted from where the ray passes nearest to the first vertex; 0 is infinitely far.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.film_frame import UNMOVED, FilmFrame
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.probe import grid
from rptcam_cl.optics.pupil_boxes import narrowing_probes, pupil_boxes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 24  # rays across a beam
NARROWING = (16, 16)  # rays that find it
SMALLEST = 1e-300  # keeps sums over no rays from dividing by zero
WIDENED = 1.6  # the beam from a point near the lens meets the front elsewhere than that from the film point


@dataclass(frozen=True)
class _Beams:
    """Beams in the scene, one per film point (n).

    Attributes
    ----------
    nearest, along : (n, 3) arrays
        The middle ray's nearest point to the first vertex, and its direction away from the lens.
    middle : (n, 3) array
        Where the middle ray leaves the lens.
    frame : (n, 2, 3) array
        Unit vectors across the beam.
    reach : (n, 2) array
        How far around the middle to look for its rays along those [mm].
    """

    nearest: Array
    along: Array
    middle: Array
    frame: Array
    reach: Array


def blur_variances(
    lens: Lens,
    film_distance_mm: float,
    film: Array,
    vergences: Array,
    wavelength_nm: float,
    frame: FilmFrame = UNMOVED,
) -> tuple[Array, Mask]:
    """Return the variances (n, vergences, 2) of the blur in x and y [mm2], and which film points (n,) are lit.

    Parameters
    ----------
    film
        (n, 2) on the film [mm].
    vergences
        (count,) of the points of the scene [1/mm].
    frame
        How the film stands; x and y of the blur run along its sides.
    """
    boxes, lit = pupil_boxes(narrowing_probes(lens, film_distance_mm, wavelength_nm, frame), film)
    beams, found = _beams(lens, film_distance_mm + frame.depth(film), film, boxes, wavelength_nm)
    spots = [_spots(lens, film_distance_mm, beams, float(vergence), wavelength_nm, frame) for vergence in vergences]
    variances = np.stack(spots, axis=1)
    lit = lit & found & np.isfinite(variances).all(axis=(1, 2))
    return np.where(lit[:, None, None], variances, 0.0), lit


def _beams(lens: Lens, distances_mm: Array, film: Array, boxes: Array, wavelength_nm: float) -> tuple[_Beams, Mask]:
    """Return the beams that film points at distances see through boxes of the rear plane, and which have any light."""
    rear = grid(boxes, *NARROWING)
    count, rays_each = rear.shape[:2]
    distances = np.broadcast_to(distances_mm[:, None, None], (count, rays_each, 1))
    away = np.concatenate([rear - film[:, None], -lens.sense * distances], axis=-1)
    origins = np.empty_like(away)
    origins[..., :2], origins[..., 2] = film[:, None], lens.length + lens.sense * distances[..., 0]
    rays = lens.trace(origins.reshape(-1, 3), away.reshape(-1, 3), wavelength_nm)
    passed = np.asarray(rays.passed).reshape(count, rays_each)
    cos4 = (distances[..., 0] ** 2 / np.sum(away * away, axis=-1)) ** 2 * passed
    weight = (cos4 / np.maximum(np.sum(cos4, axis=1), SMALLEST)[:, None])[..., None]
    starts = np.where(passed[..., None], rays.origins.reshape(away.shape), 0.0)
    middle = np.sum(weight * starts, axis=1)
    along = _unit(np.sum(weight * rays.directions.reshape(away.shape), axis=1))
    across = _unit(np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)]))
    frame = np.stack([across, np.cross(along, across)], axis=1)
    offsets = np.einsum("nri,nki->nrk", starts - middle[:, None], frame)
    reach = WIDENED * np.max(np.abs(offsets) * passed[..., None], axis=1)
    nearest = middle - np.sum(middle * along, axis=1)[:, None] * along
    return _Beams(nearest, along, middle, frame, reach), np.asarray(passed.any(axis=1))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), SMALLEST)[:, None])


def _spots(
    lens: Lens, film_distance_mm: float, beams: _Beams, vergence: float, wavelength_nm: float, frame: FilmFrame
) -> Array:
    """Return the variances (n, 2) in x and y of where the light of a point meets the film [mm2]; nan without light."""
    boxes = np.stack([-beams.reach[:, 0], beams.reach[:, 0], -beams.reach[:, 1], beams.reach[:, 1]], axis=1)
    steps = grid(boxes, *NARROWING)
    _, passed = _on_film(lens, film_distance_mm, beams, steps, vergence, wavelength_nm, frame)
    margin = (boxes[:, 1::2] - boxes[:, ::2]) / NARROWING
    low = np.where(passed[..., None], steps, np.inf).min(axis=1) - margin
    high = np.where(passed[..., None], steps, -np.inf).max(axis=1) + margin
    boxes = np.where(np.sum(passed, axis=1)[:, None] > 0, np.stack([low, high], axis=-1).reshape(-1, 4), boxes)
    film, passed = _on_film(lens, film_distance_mm, beams, grid(boxes, ACROSS, ACROSS), vergence, wavelength_nm, frame)
    count = np.sum(passed, axis=1)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.sum(np.where(passed[..., None], film, 0.0), axis=1) / count
        return np.asarray(np.sum(np.where(passed[..., None], film - mean[:, None], 0.0) ** 2, axis=1) / count)


def _on_film(
    lens: Lens,
    film_distance_mm: float,
    beams: _Beams,
    steps: Array,
    vergence: float,
    wavelength_nm: float,
    frame: FilmFrame,
) -> tuple[Array, Mask]:
    """Return where rays from a point of each beam through steps (n, rays, 2) across it meet the film, and which do."""
    front = beams.middle[:, None] + np.einsum("nrk,nki->nri", steps, beams.frame)
    if vergence == 0.0:
        origins, directions = front, np.broadcast_to(-beams.along[:, None], front.shape)
    else:
        sources = (beams.nearest + beams.along / vergence)[:, None]
        origins, directions = np.broadcast_to(sources, front.shape), front - sources
    rays = lens.trace(origins.reshape(-1, 3), directions.reshape(-1, 3), wavelength_nm, start="scene")
    across, up = lens.sense * np.array(frame.slopes)  # of the film's plane, in z of the lens
    x, y = (rays.origins[:, :2] - np.array(frame.centre)).T
    ahead = lens.film_z(film_distance_mm) + x * across + y * up - rays.origins[:, 2]
    dx, dy, dz = rays.directions.T
    film = rays.origins[:, :2] + (ahead / (dz - dx * across - dy * up))[:, None] * rays.directions[:, :2]
    film = film if frame.is_flat else frame.on_film(film)
    return film.reshape(steps.shape), rays.passed.reshape(steps.shape[:2])
