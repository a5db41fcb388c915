"""Chief rays of film points: the one ray of each that goes through the centre of the stop.

From a film point the rays behind the stop are aimed by Newton's method at the plane of the last vertex until they meet
the centre of the stop; the rest of the lens then says where in the scene they come from. So fields beyond 90 degrees
need no case of their own, and neither do lenses that are not round or films that are moved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.first_order import limiting_surface
from rptcam_cl.optics.ray_trace import passing, trace

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.prescription import Prescription
    from rptcam_cl.optics.surface import Surface

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ROUNDS = 12  # of Newton's method, which needs three to five
STEP = 1e-6  # of the derivatives, over the aperture's size
HIT = 1e-10  # distance from the centre of the stop that counts as none, over the same
RETRIES = 4  # from neighbours, where the first guess led nowhere


@dataclass(frozen=True)
class ChiefRays:
    """Chief rays on the scene's side, in the frame of the lens.

    Attributes
    ----------
    origins, directions : (n, 3) arrays
        Point on the first surface [mm], and unit vector away from the lens.
    found : (n,) array
        Which exist, were no rim in their way; the others are of no use.
    clear : (n,) array
        Which of them come through every rim. Beside those, light may still pass away from the middle of the stop.
    aims : (n, 2) array
        Where they meet the plane of the last vertex [mm].
    """

    origins: Array
    directions: Array
    found: Mask
    clear: Mask
    aims: Array

    def axis_points(self) -> Array:
        """Return z (n,) where the rays, drawn on into the lens, come nearest to the axis [mm]; not-a-number along it.

        This is where the entrance pupil lies that a point in their direction sees.
        """
        across = np.sum(self.directions[:, :2] ** 2, axis=1)
        with np.errstate(all="ignore"):
            step = -np.sum(self.origins[:, :2] * self.directions[:, :2], axis=1) / across
            return np.where(across > 1e-14, self.origins[:, 2] + step * self.directions[:, 2], np.nan)


def film_chief_rays(lens: Lens, film_points: Array, wavelength_nm: float = LINE_D_NM) -> ChiefRays:
    """Return the chief rays of film points (n, 3), in the frame of the lens [mm].

    Obstructions in the middle of a lens do not count. Exact to 1e-10 of the stop's radius.

    Raises
    ------
    InputError
        When the lens has no surface that limits the light.
    """
    points = np.atleast_2d(np.asarray(film_points, dtype=np.float64))
    stop = limiting_surface(lens, wavelength_nm)
    rear = _rear(lens, stop)
    size = float(lens.surfaces[stop].semi_diameter)
    pupil = lens.first_order(wavelength_nm).exit_pupil.distance_mm
    depth = lens.sense * (points[:, 2] - lens.length)
    share = -pupil / (depth - pupil) if np.isfinite(pupil) else np.ones(len(points))
    aims, found = _aimed(rear, lens, points, points[:, :2] * share[:, None], wavelength_nm, size)
    for _ in range(RETRIES):
        lost = np.flatnonzero(~found)
        if not found.any() or not len(lost):
            break
        known = np.flatnonzero(found)
        away = np.sum((points[lost, None, :2] - points[None, known, :2]) ** 2, axis=2)
        near = known[np.argmin(away, axis=1)]
        start = aims[near] + (points[lost, :2] - points[near, :2]) * share[lost, None]
        aims[lost], found[lost] = _aimed(rear, lens, points[lost], start, wavelength_nm, size)
    rays = aimed_rays(lens, points, aims, wavelength_nm)
    return replace(rays, found=found & rays.found, clear=found & rays.clear)


def aimed_rays(lens: Lens, film_points: Array, aims: Array, wavelength_nm: float = LINE_D_NM) -> ChiefRays:
    """Return the rays of film points (n, 3) through points (n, 2) of the plane of the last vertex, known before.

    A ray whose aim is not-a-number is not found.
    """
    known = np.asarray(np.isfinite(aims).all(axis=1))
    away = _towards(lens, film_points, np.where(known[:, None], aims, 0.0))
    rays = trace(_with(lens, _open), film_points, away, wavelength_nm)
    found = known & rays.passed
    clear = found & passing(_with(lens, _filled), film_points, away, wavelength_nm)
    return ChiefRays(rays.origins, rays.directions, found, clear, aims)


def unobstructed(lens: Lens) -> Lens:
    """Return the lens without holes, obstructions in its middle and the shape of its stop: its chief rays need none."""
    return replace(lens, surfaces=tuple(map(_filled, lens.surfaces))) if lens.is_obstructed else lens


def _filled(surface: Surface) -> Surface:
    """Return a surface without a hole or an obstruction in its middle, a stop being round."""
    return replace(surface, inner_semi_diameter=0.0, stop_shape=None)


def _open(surface: Surface) -> Surface:
    """Return a surface that stops no ray."""
    return replace(_filled(surface), semi_diameter=np.inf, region=None)


def _with(lens: Lens, change: Callable[[Surface], Surface]) -> Prescription:
    """Return the lens with its surfaces changed."""
    return replace(lens, surfaces=tuple(map(change, lens.surfaces)))


def _rear(lens: Lens, stop: int) -> Prescription:
    """Return the lens from its stop on, without rims; z = 0 at the stop."""
    before = lens.surfaces[stop - 1].glass if stop else lens.object_medium
    surfaces = tuple(_open(surface) for surface in lens.surfaces[stop:])
    return replace(
        lens, surfaces=surfaces, object_medium=before, stop_index=None, configurations=(), focusing=None,
        first_sense=float(lens.senses[stop]),
    )  # fmt: skip


def _towards(lens: Lens, points: Array, aims: Array) -> Array:
    """Return directions (n, 3) from film points to points (n, 2) of the plane of the last vertex."""
    return np.column_stack([aims - points[:, :2], lens.length - points[:, 2]])


def _aimed(
    rear: Prescription, lens: Lens, points: Array, start: Array, wavelength_nm: float, size: float
) -> tuple[Array, Mask]:
    """Return points of the plane of the last vertex (n, 2) whose rays meet the centre of the stop, and which do."""
    shift = np.array([0.0, 0.0, lens.length - rear.length])
    pose = rear.surfaces[0].pose
    h = STEP * size

    def miss(rows: NDArray[np.intp], aims: Array) -> Array:
        rays = trace(rear, points[rows] - shift, _towards(lens, points[rows], aims), wavelength_nm)
        at = rays.origins if pose is None else pose.inward(rays.origins.T, rays.directions.T)[0].T
        return np.where(rays.passed[:, None], at[:, :2], np.nan)

    aims, found = start.copy(), np.zeros(len(points), dtype=bool)
    rows = np.arange(len(points))
    for _ in range(ROUNDS):
        at = miss(rows, aims[rows])
        hit = np.abs(at).max(axis=1) <= HIT * size
        found[rows[hit]] = True
        rows, at = rows[~hit], at[~hit]
        if not len(rows):
            break
        beside = np.concatenate([aims[rows] + [h, 0.0], aims[rows] + [0.0, h]])
        right, up = ((there - at) / h for there in np.split(miss(np.tile(rows, 2), beside), 2))
        with np.errstate(all="ignore"):
            scale = right[:, 0] * up[:, 1] - right[:, 1] * up[:, 0]
            step = np.column_stack(
                [at[:, 0] * up[:, 1] - at[:, 1] * up[:, 0], right[:, 0] * at[:, 1] - right[:, 1] * at[:, 0]]
            )
            new = aims[rows] - step / scale[:, None]
        usable = np.isfinite(new).all(axis=1)
        rows = rows[usable]
        aims[rows] = new[usable]
        if not len(rows):
            break
    return aims, found
