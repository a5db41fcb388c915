"""How good copies of a lens are: spots and modulation over fields, with the film where it is or at its best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import Copies, Lens, diffraction_mtf, film_points
from rptcam_cl.scene import Merit
from rptcam_cl.tolerances.beams import FieldRays

Array = NDArray[np.float64]

COPIES_TOGETHER = 256  # whose film points are held at a time


@dataclass(frozen=True)
class Scores:
    """What copies are worth.

    Attributes
    ----------
    spots_um : (copies, fields) array
        Rms distance from the centroid of all wavelengths together [micrometres]; infinite where no ray comes through.
    mtf : (copies, fields) array
        Modulation at the frequency of the merit, the mean of tangential and sagittal.
    shifts_mm : (copies,) array
        How far the film was moved along the light to refocus [mm].
    """

    spots_um: Array
    mtf: Array
    shifts_mm: Array

    @property
    def spot_um(self) -> Array:
        """Rms over the fields (copies,) [micrometres]."""
        return np.asarray(np.sqrt(np.mean(self.spots_um**2, axis=1)))

    @property
    def modulation(self) -> Array:
        """Mean over the fields (copies,)."""
        return np.asarray(np.mean(self.mtf, axis=1))

    def by(self, merit: str) -> Array:
        """Return the numbers (copies,) that rank copies: ``spot``, smaller is better, or ``mtf``, larger is."""
        return self.spot_um if merit == "spot" else self.modulation


class Judge:
    """Gives copies of one lens their scores.

    Parameters
    ----------
    lens : Lens
        The design.
    rays : sequence of FieldRays
        Of each field, as many.
    merit : Merit
    film_distance_mm : float
        From the last vertex to the film before it is moved.
    """

    def __init__(self, lens: Lens, rays: Sequence[FieldRays], merit: Merit, film_distance_mm: float) -> None:
        self.merit, self.film = merit, film_distance_mm
        self.origins = np.concatenate([field.origins for field in rays])
        self.directions = np.concatenate([field.directions for field in rays])
        waves = len(merit.wavelengths_nm)
        self.weights = np.repeat(np.stack([field.weights for field in rays])[:, None] / waves, waves, axis=1)
        turns = np.radians([field.beam.azimuth_degrees for field in rays])
        self.radial = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        self.limits = self._limits(lens)

    def best_shift(self, lens: Lens) -> float:
        """Return how far the film must move along the light for the least spots of the design in all fields [mm]."""
        points, slopes = (
            _centred(self.weights, values) for values in self._film(Copies(lens, (), np.zeros((1, 0, 2))))
        )
        together, spread = (_moment(self.weights, slopes, values).sum() for values in (points, slopes))
        return -float(together / spread)

    def scores(self, copies: Copies, refocus: bool) -> Scores:
        """Return what copies are worth, each with its film at the least spots of all fields where `refocus` says so."""
        parts = [
            self._part(copies.part(low, low + COPIES_TOGETHER), refocus)
            for low in range(0, copies.count, COPIES_TOGETHER)
        ]
        return Scores(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _part(self, copies: Copies, refocus: bool) -> tuple[Array, Array, Array]:
        points, slopes = self._film(copies)
        weights = self.weights[None] * np.isfinite(points[..., 0] + slopes[..., 0])
        totals = np.sum(weights, axis=(2, 3), keepdims=True)
        dark = totals[..., 0, 0] == 0  # fields of which no ray comes through
        weights = weights / np.where(totals > 0, totals, 1.0)
        points, slopes = (_centred(weights, np.nan_to_num(values)) for values in (points, slopes))
        shifts = np.zeros(copies.count)
        if refocus:
            together, spread = (_moment(weights, slopes, values).sum(axis=1) for values in (points, slopes))
            changed = np.any(copies.values != 0, axis=(1, 2))
            shifts = np.where(
                changed & (spread > 0), -together / np.where(spread > 0, spread, 1.0), 0.0
            )  # the design itself stands at its best already
            points = points + shifts[:, None, None, None, None] * slopes
        spots = 1e3 * np.sqrt(_moment(weights, points, points))
        return np.where(dark, np.inf, spots), self._modulation(weights, points), shifts

    def _film(self, copies: Copies) -> tuple[Array, Array]:
        """Return where rays meet the film and their slopes there, each (copies, fields, wavelengths, rays, 2)."""
        shape = (copies.count, len(self.radial), -1, 2)
        found = [
            film_points(copies, self.origins, self.directions, wavelength, self.film)
            for wavelength in self.merit.wavelengths_nm
        ]
        return tuple(np.stack([pair[k].reshape(shape) for pair in found], axis=2) for k in (0, 1))  # type: ignore[return-value]

    def _modulation(self, weights: Array, points: Array) -> Array:
        """Return the mean of tangential and sagittal modulation, as `lens mtf` has them, of centred points."""
        wave = -2j * np.pi * self.merit.mtf_per_mm
        across = np.stack([-self.radial[:, 1], self.radial[:, 0]], axis=1)
        both = []
        for number, axis in enumerate((self.radial, across)):
            along = np.einsum("mfwrc,fc->mfwr", points, axis)
            both.append(np.abs(np.sum(weights * np.exp(wave * along), axis=(2, 3))) * self.limits[number])
        return np.asarray((both[0] + both[1]) / 2)

    def _limits(self, lens: Lens) -> Array:
        """Return the modulation that diffraction leaves the design (2, fields), along the field and across it."""
        plain = Copies(lens, (), np.zeros((1, 0, 2)))
        _, slopes = self._film(plain)
        cosines = slopes[0] / np.sqrt(1.0 + np.sum(slopes[0] ** 2, axis=-1, keepdims=True))
        across = np.stack([-self.radial[:, 1], self.radial[:, 0]], axis=1)
        found = np.zeros((2, len(self.radial)))
        for place, wavelength in enumerate(self.merit.wavelengths_nm):
            index = float(lens.indices(wavelength)[-1])
            for number, axis in enumerate((self.radial, across)):
                along = np.einsum("frc,fc->fr", cosines[:, place], axis)
                weights = self.weights[:, place] / self.weights[:, place].sum(axis=1, keepdims=True)
                mean = np.sum(weights * along, axis=1, keepdims=True)
                apertures = 2 * index * np.sqrt(np.sum(weights * (along - mean) ** 2, axis=1))
                found[number] += [diffraction_mtf([self.merit.mtf_per_mm], na, wavelength)[0] for na in apertures]
        return found / len(self.merit.wavelengths_nm)


def _centred(weights: Array, values: Array) -> Array:
    """Return values (copies, fields, wavelengths, rays, 2) from the mean of their field."""
    return np.asarray(values - np.sum(weights[..., None] * values, axis=(2, 3), keepdims=True))


def _moment(weights: Array, one: Array, other: Array) -> Array:
    """Return the mean product of centred vectors in each field (copies, fields)."""
    return np.asarray(np.sum(weights * np.sum(one * other, axis=-1), axis=(2, 3)))
