"""The film distance of the least real-ray spot at the working aperture, on the axis or at a field point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.optics.focus import MEASURED_FROM, film_distance
from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.optics.spot import Beam, spot

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]

ZONES = 48


def best_film_distance(
    lens: Lens,
    object_distance_mm: float,
    measured_from: str = "film",
    wavelengths_nm: Sequence[float] = (WAVELENGTH_D,),
    field_degrees: float = 0.0,
) -> float:
    """Return the distance from the last vertex to the film with the least rms spot [mm].

    Parameters
    ----------
    lens : Lens
        At its working aperture: see `Lens.with_stop_diameter`.
    object_distance_mm, measured_from
        As in `focus.film_distance`.
    wavelengths_nm : sequence of float
        Several are pooled with equal weights.
    field_degrees : float
        Off the axis the spot is that of the whole oblique beam, at the first wavelength.
    """
    if measured_from not in MEASURED_FROM:
        raise InputError(f'measured_from must be "film" or "front" (got {measured_from!r})')
    paraxial = film_distance(lens, object_distance_mm, measured_from, wavelengths_nm[0])
    if measured_from == "front" or np.isinf(object_distance_mm):
        return _best(lens, object_distance_mm, wavelengths_nm, field_degrees, paraxial)
    back = paraxial
    for _ in range(60):
        front = object_distance_mm - lens.length - back
        new = _best(lens, front, wavelengths_nm, field_degrees, back)
        if abs(new - back) <= 1e-11 * abs(back):
            return new
        back = new
    return back


def _best(lens: Lens, front_mm: float, wavelengths_nm: Sequence[float], field_degrees: float, start: float) -> float:
    if field_degrees or not lens.is_rotational:
        return start + spot(lens, start, Beam(field_degrees, front_mm), wavelengths_nm[0]).best_shift
    top, bottom = 0.0, 0.0
    for wavelength in wavelengths_nm:
        heights, slopes, weights = _zones(lens, front_mm, wavelength)
        top += float(np.sum(weights * heights * slopes))
        bottom += float(np.sum(weights * slopes * slopes))
    return -top / bottom


def _zones(lens: Lens, front_mm: float, wavelength_nm: float) -> tuple[Array, Array, Array]:
    """Return height at the last vertex, slope and weight of meridional rays spread evenly over the entrance pupil."""
    pupil = lens.first_order(wavelength_nm).entrance_pupil
    widest = _widest(lens, front_mm, pupil.distance_mm, 2.0 * pupil.diameter_mm, wavelength_nm)
    nodes, weights = np.polynomial.legendre.leggauss(ZONES)
    radii = widest * np.sqrt((nodes + 1) / 2)
    rays = lens.trace(*_meridional(front_mm, pupil.distance_mm, radii), wavelength_nm, start="scene")
    slopes = rays.directions[:, 1] / rays.directions[:, 2]
    heights = rays.origins[:, 1] + (lens.length - rays.origins[:, 2]) * slopes
    return heights, slopes, weights / 2


def _widest(lens: Lens, front_mm: float, plane: float, limit: float, wavelength_nm: float) -> float:
    """Return the largest height in a plane below which every ray from the axial object point passes [mm]."""
    low, high = 0.0, limit
    for _ in range(8):
        trial = np.linspace(low, high, 129)
        passed = lens.trace(*_meridional(front_mm, plane, trial), wavelength_nm, start="scene").passed
        if passed.all():
            return high
        first = int(np.argmin(passed))
        if first == 0:
            raise InputError(f"{lens.name}: the ray on the axis does not come through")
        low, high = trial[first - 1], trial[first]
    return low


def _meridional(front_mm: float, plane: float, heights: Array) -> tuple[Array, Array]:
    """Return rays from the axial object point through heights in a plane z [mm]."""
    zero = np.zeros_like(heights)
    through = np.stack([zero, heights, zero + plane], axis=1)
    if np.isinf(front_mm):
        return through, np.stack([zero, zero, zero + 1.0], axis=1)
    source = np.array([0.0, 0.0, -front_mm])
    return np.broadcast_to(source, through.shape), through - source
