"""How a lens bends each wavelength: ratios of indices as polynomials for the device, and whether a picture shows it."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.records import DISPERSION_NM, DISPERSION_SCALE, DISPERSION_SHIFT, DISPERSION_TERMS
from rptcam_cl.optics import IDEAL, Lens, LensTransmission, known_nm, passed_rays
from rptcam_cl.scene import Film

Array = NDArray[np.float64]

NODES = 48
ENOUGH = 1e-8  # error of an index ratio that float32 does not see
ENOUGH_IN_DOUBLE = 1e-13
EXTREMES_NM = (440.0, 640.0)  # between which nine tenths of what the eye sees in daylight lies
FIELDS = (0.0, 0.7, 1.0)  # film points along the half diagonal that are probed
PUPIL = 5  # rays along a side of the square of rays of each of them
FAR_MM = 1e9  # object plane where none is sharp


def disperses(lens: Lens) -> bool:
    """Return whether any surface bends one wavelength more than another."""
    low, high = usable_nm(lens)
    indices = lens.indices(np.linspace(low, high, 9))
    ratios = indices[1:] / indices[:-1]
    return bool(np.any(np.ptp(ratios, axis=1) > 0))


def usable_nm(lens: Lens, transmission: LensTransmission = IDEAL) -> tuple[float, float]:
    """Return the wavelengths of `DISPERSION_NM` that every glass of a lens, and what it loses, is known for [nm]."""
    ranges = (lens.known_nm, known_nm(lens, transmission), DISPERSION_NM)
    return max(low for low, _ in ranges), min(high for _, high in ranges)


def fitted(ratio_at: ArrayLike, wavelengths_nm: Array, terms: int) -> tuple[Array, float]:
    """Return ``terms`` coefficients of a polynomial in x = scale / wavelength - shift, and its largest error."""
    x = DISPERSION_SCALE / wavelengths_nm - DISPERSION_SHIFT
    values = np.asarray(ratio_at, dtype=np.float64)
    curve = Polynomial.fit(x, values, terms - 1).convert()
    coefficients = np.zeros(terms)
    coefficients[: len(curve.coef)] = curve.coef
    return coefficients, float(np.abs(Polynomial(coefficients)(x) - values).max())


def fit_nodes(low_nm: float, high_nm: float) -> Array:
    """Return wavelengths [nm] at which a polynomial that is fitted comes close everywhere between (Chebyshev)."""
    inverse = np.cos((np.arange(NODES) + 0.5) * np.pi / NODES)
    ends = np.array([1 / high_nm, 1 / low_nm])
    return np.asarray(1 / (ends.mean() + inverse * np.ptp(ends) / 2))


def fewest_terms(ratios: Array, wavelengths_nm: Array, enough: float = ENOUGH) -> list[Array]:
    """Return the coefficients of polynomials through values (n, wavelengths): as few as give all to an error."""
    found: list[tuple[Array, float]] = []
    for terms in range(1, DISPERSION_TERMS + 1):
        found = [fitted(ratio, wavelengths_nm, terms) for ratio in ratios]
        if all(error <= enough for _, error in found):
            break
    return [coefficients for coefficients, _ in found]


def fill_dispersion(records: NDArray[np.void], lens: Lens, backwards: bool) -> int:
    """Fill the polynomials of every surface, in order of travel; return how many coefficients they take."""
    wavelengths = fit_nodes(*usable_nm(lens))
    indices = lens.indices(wavelengths)
    ratios = (indices[1:] / indices[:-1])[::-1] if backwards else indices[:-1] / indices[1:]
    double = records["eta"].dtype == np.float64
    found = fewest_terms(ratios, wavelengths, ENOUGH_IN_DOUBLE if double else ENOUGH)
    for record, ratio, coefficients in zip(records, ratios, found, strict=True):
        record["dispersion"][: len(coefficients)] = coefficients
        if record["refracts"] >= 0:
            record["refracts"] = bool(np.any(ratio != 1.0))
    return len(found[0])


def colour_error_px(
    lens: Lens, film_distance_mm: float, focus_distance_mm: float | None, film: Film, wavelength_nm: float
) -> float:
    """Return how far from its place at the camera's wavelength light of another falls on the film, at most [pixels].

    Rays from film points on the axis, at 0.7 and 1 of the half diagonal go through a square of points of the exit pupil
    at the wavelength of the camera and at those of `EXTREMES_NM`; where they meet the object plane tells how far their
    image points lie apart. Lateral and axial colour both count.
    """
    low, high = usable_nm(lens)
    half_mm = np.array(film.size_m()) / 2 * 1e3
    pitch_mm = 2 * half_mm[0] / film.resolution[0]
    sharp = focus_distance_mm is not None and focus_distance_mm < FAR_MM
    plane_mm = lens.film_z(film_distance_mm) - (focus_distance_mm if sharp and focus_distance_mm else FAR_MM)
    probe = _Probe(lens, film_distance_mm, plane_mm, wavelength_nm)
    nudge, points = np.full(2, 1e-3 * pitch_mm), np.array(FIELDS)[:, None] * half_mm
    here, beside = np.split(probe.meets(np.concatenate([points, points - nudge]), wavelength_nm), 2)
    ends = [probe.meets(points, min(max(end, low), high)) for end in EXTREMES_NM]
    worst = 0.0
    for field, meets in enumerate(here):
        scale = _largest(beside[field] - meets) / float(np.linalg.norm(nudge))
        for end in ends:
            worst = max(worst, _largest(end[field] - meets) / (scale * pitch_mm) if scale > 0 else 0.0)
    return worst


def _largest(places: Array) -> float:
    """Return the largest length of vectors (n, 2), of those that are numbers; 0 where none is."""
    lengths = np.hypot(places[:, 0], places[:, 1])
    return float(lengths[np.isfinite(lengths)].max(initial=0.0))


class _Probe:
    """Rays from film points through a square of points of the paraxial exit pupil to a plane of the scene."""

    def __init__(self, lens: Lens, film_distance_mm: float, plane_mm: float, wavelength_nm: float) -> None:
        self.lens, self.film_mm, self.plane_mm = lens, lens.film_z(film_distance_mm), plane_mm
        pupil = lens.first_order(wavelength_nm).exit_pupil
        distance, radius = pupil.distance_mm, pupil.diameter_mm / 2
        if not (np.isfinite(distance) and np.isfinite(radius)):
            distance, radius = 0.0, lens.surfaces[-1].semi_diameter
        side = np.linspace(-0.6, 0.6, PUPIL) * radius
        x, y = (values.ravel() for values in np.meshgrid(side, side))
        self.aims = np.stack([x, y, np.full(len(x), lens.film_z(distance))], axis=1)

    def meets(self, points: Array, wavelength_nm: float) -> Array:
        """Return where rays from film points (k, 2) meet the plane, (k, n, 2); not a number where they are blocked."""
        origins = np.concatenate([points, np.full((len(points), 1), self.film_mm)], axis=1)[:, None]
        directions = self.aims - origins
        directions *= -self.lens.sense * np.sign(directions[..., 2:])  # also through a pupil behind the film
        origins = np.broadcast_to(origins, directions.shape).reshape(-1, 3)
        places = np.full((len(origins), 2), np.nan)
        passed, p, d = passed_rays(self.lens, origins, directions.reshape(-1, 3), wavelength_nm)
        with np.errstate(all="ignore"):
            places[passed] = (p[:2] + (self.plane_mm - p[2]) / d[2] * d[:2]).T
        return places.reshape(len(points), -1, 2)
