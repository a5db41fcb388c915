"""Where the light of a point of the scene goes: through places of the pupil to points of the film, in float64.

Both in the coordinates of the camera's kernel: the pupil as `kernels/lens/pupil.h` or a unit disk, the film in
millimetres or tangents.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.pupil import content_of
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import Lens, StopMask, StopShape, passed_rays

Array = NDArray[np.float64]

WIDER = 1.6  # than the paraxial entrance pupil is where the true one is looked for
COARSE = 14  # rays across it
NEAR = (2, 2)  # low and high, across and down


@dataclass(frozen=True)
class Reached:
    """Rays of n points, m each.

    Attributes
    ----------
    film, pupil : (n, m, 2) arrays
        Where they meet the film and the pupil.
    entry : (n, m, 2) array
        Where they enter the camera [m], in its frame, in the plane of `LampReach.entry_z_m`.
    passed : (n, m) array
        Which the lens lets through.
    """

    film: Array
    pupil: Array
    entry: Array
    passed: NDArray[np.bool_]

    def of(self, points: Sequence[int] | NDArray[np.intp]) -> Reached:
        """Return those of some of the points."""
        rows = np.asarray(points)
        return Reached(self.film[rows], self.pupil[rows], self.entry[rows], self.passed[rows])


@dataclass(frozen=True)
class LampReach:
    """How a camera sees points of the scene.

    Attributes
    ----------
    rays : callable
        Takes points (n, 3) in the camera's frame [m], how many rays across the pupil, a wavelength [nm] or None for
        that of the camera, and what ``near`` returns of them; returns what they reach.
    film_scale : (float, float)
        Film coordinates of the right and the upper edge of the upright picture.
    entry_z_m : float
        Where rays enter the camera, on its axis.
    made_of : tuple
        All that rays follow from; it can be pickled.
    area : float
        Of the pupil, where all film points have the same; 0 elsewhere.
    near : callable
        Takes points and a wavelength; returns the corners of boxes of the pupil (n, *NEAR) that they are seen through.
    """

    rays: Callable[[Array, int, float | None, Array], Reached]
    film_scale: tuple[float, float]
    made_of: tuple[object, ...]
    entry_z_m: float = 0.0
    area: float = 0.0
    near: Callable[[Array, float | None], Array] = lambda points, _: np.zeros((len(points), *NEAR))


@lru_cache(maxsize=8)
def _square(across: int) -> Array:
    steps = (np.arange(across) + 0.5) * 2 / across - 1
    found = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    found.flags.writeable = False
    return found


def _disk(across: int) -> Array:
    points = _square(across)
    return np.asarray(points[np.hypot(*points.T) <= 1.0])


def thin_lens_reach(
    radius_m: float, focus_m: float, half_tangents: tuple[float, float], shape: StopShape | StopMask | None
) -> LampReach:
    """Return the reach of a thin lens; the film is its tangents, the pupil its opening in radii."""

    def rays(points: Array, across: int, _: float | None, __: Array) -> Reached:
        disk = _disk(across)
        disk = disk if shape is None else disk[shape.holds(*disk.T)]
        depth = np.where(points[:, 2] < 0, -points[:, 2], np.nan)[:, None, None]
        on_lens = disk * radius_m
        film = on_lens / focus_m + (points[:, None, :2] - on_lens) / depth
        pupil, entry = np.broadcast_to(disk, film.shape), np.broadcast_to(on_lens, film.shape)
        return Reached(film, pupil, entry, np.asarray(np.isfinite(film).all(axis=-1)))

    made_of = ("thin", radius_m, focus_m, shape)
    return LampReach(rays, half_tangents, made_of, area=np.pi if shape is None else shape.area)


def thick_lens_reach(
    height: tuple[float, float], slope: tuple[float, float], first_vertex_m: float, half_film_mm: tuple[float, float]
) -> LampReach:
    """Return the reach of a thick lens; heights and slopes per millimetre of the film and per radius of the pupil."""

    def rays(points: Array, across: int, _: float | None, __: Array) -> Reached:
        disk = _disk(across)
        ahead = (first_vertex_m - points[:, 2]) * 1e3
        ahead = np.where(ahead > 0, ahead, np.nan)[:, None, None]
        by_pupil = (height[1] + ahead * slope[1]) * disk
        film = (points[:, None, :2] * 1e3 - by_pupil) / (height[0] + ahead * slope[0])
        entry = (height[0] * film + height[1] * disk) * 1e-3
        return Reached(film, np.broadcast_to(disk, film.shape), entry, np.asarray(np.isfinite(film).all(axis=-1)))

    made_of = ("thick", height, slope, first_vertex_m)
    return LampReach(rays, (-half_film_mm[0], -half_film_mm[1]), made_of, first_vertex_m, np.pi)


def lens_reach(
    lens: Lens, film_distance_mm: float, wavelength_nm: float, half_film_mm: tuple[float, float]
) -> LampReach | None:
    """Return the reach of a lens by exact rays; None where its entrance pupil lies at infinity."""
    pupil = lens.first_order(wavelength_nm).entrance_pupil
    if not (np.isfinite(pupil.distance_mm) and np.isfinite(pupil.diameter_mm)):
        return None
    film_z = lens.film_z(film_distance_mm)
    last_z = film_z - lens.sense * film_distance_mm

    def through(start: Array, aims: Array, nm: float) -> Reached:
        away = np.concatenate([aims, np.full((*aims.shape[:2], 1), pupil.distance_mm)], axis=-1) - start[:, None]
        away *= np.sign(away[..., 2:])
        shape, away = away.shape[:2], away.reshape(-1, 3)
        origins = np.broadcast_to(start[:, None], (*shape, 3)).reshape(-1, 3)
        rows, p, d = passed_rays(lens, origins, away, nm, "scene")
        with np.errstate(all="ignore"):
            film, last = (p[:2] + d[:2] * ((z - p[2]) / d[2]) for z in (film_z, last_z))
        ahead = origins[rows, 2] < 0
        met = np.isfinite(film).all(axis=0) & np.isfinite(last).all(axis=0) & ahead
        passed, kept = np.zeros(len(away), np.bool_), rows[met]
        passed[kept] = True
        o, a = origins[kept], away[kept]
        found = np.zeros((3, len(away), 2))
        found[:, kept] = film.T[met], last.T[met], (o[:, :2] - a[:, :2] * (o[:, 2:] / a[:, 2:])) * 1e-3
        on_film, on_last, entry = found.reshape(3, *shape, 2)
        return Reached(on_film, on_last, entry, passed.reshape(shape))

    def starts(points: Array) -> Array:
        return np.asarray(points * 1e3 + (0.0, 0.0, film_z))

    def near(points: Array, nm: float | None) -> Array:
        coarse = _square(COARSE) * (WIDER * pupil.diameter_mm / 2)
        wide = np.broadcast_to(coarse, (len(points), *coarse.shape))
        found = through(starts(points), wide, wavelength_nm if nm is None else nm).passed[..., None]
        if not found.any():
            return np.zeros((len(points), *NEAR))
        none = ~found.any(axis=1)
        low = np.where(none, 0.0, np.where(found, wide, np.inf).min(axis=1))
        high = np.where(none, 0.0, np.where(found, wide, -np.inf).max(axis=1))
        return np.stack([low, high], axis=1)

    def rays(points: Array, across: int, nm: float | None, seen: Array) -> Reached:
        low, high = seen[:, :1], seen[:, 1:]
        middle, half = (low + high) / 2, (high - low) / 2
        cell = WIDER * pupil.diameter_mm / COARSE
        aims = middle + _square(across) * (half + cell / 2)
        return through(starts(points), aims, wavelength_nm if nm is None else nm)

    made_of = (content_of(lens), film_distance_mm, wavelength_nm)
    return LampReach(rays, (-half_film_mm[0], -half_film_mm[1]), made_of, -film_z * 1e-3, near=near)
