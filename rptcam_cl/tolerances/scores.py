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

POINTS_TOGETHER = 2**20  # on the films of some copies, which are held at a time


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
        Of each field.
    merit : Merit
    film_distance_mm : float
        From the last vertex to the film before it is moved.
    """

    def __init__(self, lens: Lens, rays: Sequence[FieldRays], merit: Merit, film_distance_mm: float) -> None:
        self.merit, self.film = merit, film_distance_mm
        self.origins = np.concatenate([field.origins for field in rays])
        self.directions = np.concatenate([field.directions for field in rays])
        self.finer = [field.finer for field in rays]
        self.counts = np.array([len(field.weights) for field in rays])
        self.starts = np.cumsum(self.counts) - self.counts
        waves = len(merit.wavelengths_nm)
        self.weights = np.tile(np.concatenate([field.weights for field in rays]) / waves, (waves, 1))
        turns = np.radians([field.beam.azimuth_degrees for field in rays])
        self.radial = np.repeat(np.stack([np.cos(turns), np.sin(turns)], axis=1), self.counts, axis=0)
        self.limits = self._limits(lens)

    def best_shift(self, lens: Lens) -> float:
        """Return how far the film must move along the light for the least spots of the design in all fields [mm]."""
        points, slopes = (
            self._centred(self.weights[None], values) for values in self._film(Copies(lens, (), np.zeros((1, 0, 2))))
        )
        together, spread = (self._moment(self.weights, slopes, values).sum() for values in (points, slopes))
        return -float(together / spread)

    def scores(self, copies: Copies, refocus: bool, shifts_mm: Array | None = None) -> Scores:
        """Return what copies are worth, each with its film at the least spots of all fields where `refocus` says so.

        With `shifts_mm` (copies,) the film of each is moved by so much.
        """
        together = max(POINTS_TOGETHER // self.weights.size, 1)
        parts = [
            self._part(copies.part(low, low + together), refocus, None if shifts_mm is None else shifts_mm[low:])
            for low in range(0, copies.count, together)
        ]
        return Scores(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _part(self, copies: Copies, refocus: bool, shifts: Array | None) -> tuple[Array, Array, Array]:
        points, slopes = self._film(copies)
        weights = self.weights[None] * np.isfinite(points[..., 0] + slopes[..., 0])
        totals = self._sums(weights)
        dark = totals == 0  # fields of which no ray comes through
        weights = weights / self._each(np.where(dark, 1.0, totals))
        points, slopes = (self._centred(weights, np.nan_to_num(values)) for values in (points, slopes))
        if shifts is None:
            shifts = np.zeros(copies.count)
            if refocus:
                together, spread = (self._moment(weights, slopes, one).sum(axis=1) for one in (points, slopes))
                changed = np.any(copies.values != 0, axis=(1, 2))
                shifts = np.where(
                    changed & (spread > 0), -together / np.where(spread > 0, spread, 1.0), 0.0
                )  # the design itself stands at its best already
        shifts = shifts[: copies.count]
        points = points + shifts[:, None, None, None] * slopes
        spots = 1e3 * np.sqrt(self._moment(weights, points, points))
        return np.where(dark, np.inf, spots), self._modulation(weights, points), shifts

    def _film(self, copies: Copies) -> tuple[Array, Array]:
        """Return where rays meet the film and their slopes there, each (copies, wavelengths, rays, 2)."""
        found = [
            film_points(copies, self.origins, self.directions, wavelength, self.film)
            for wavelength in self.merit.wavelengths_nm
        ]
        return tuple(np.stack([pair[k] for pair in found], axis=1) for k in (0, 1))  # type: ignore[return-value]

    def _sums(self, values: Array) -> Array:
        """Return the sums (copies, fields, …) of values (copies, wavelengths, rays, …)."""
        return np.asarray(np.add.reduceat(values.sum(axis=1), self.starts, axis=1))

    def _each(self, values: Array) -> Array:
        """Return values (copies, fields, …) for each ray (copies, 1, rays, …)."""
        return np.repeat(values, self.counts, axis=1)[:, None]

    def _centred(self, weights: Array, values: Array) -> Array:
        """Return values (copies, wavelengths, rays, 2) from the mean of their field."""
        return values - self._each(self._sums(weights[..., None] * values))

    def _moment(self, weights: Array, one: Array, other: Array) -> Array:
        """Return the mean product of centred vectors in each field (copies, fields)."""
        return self._sums(weights * (one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1]))

    def _axes(self) -> tuple[Array, Array]:
        """Return the directions along the field of each ray and across it, each (rays, 2)."""
        return self.radial, np.stack([-self.radial[:, 1], self.radial[:, 0]], axis=1)

    def _modulation(self, weights: Array, points: Array) -> Array:
        """Return the mean of tangential and sagittal modulation, as `lens mtf` has them, of centred points.

        Where a field has finer places, what the points are there counts, of copies that let all rays through.
        """
        found = np.zeros((len(points), len(self.counts)))
        for limits, axis in zip(self.limits, self._axes(), strict=True):
            along = 2 * np.pi * self.merit.mtf_per_mm * (points[..., 0] * axis[:, 0] + points[..., 1] * axis[:, 1])
            cosines, sines = (self._sums(weights * function(along)) for function in (np.cos, np.sin))
            modulation = np.hypot(cosines, sines)
            for k, finer in enumerate(self.finer):
                rays = slice(self.starts[k], self.starts[k] + self.counts[k])
                if finer is not None:
                    full = np.all((weights[..., rays] > 0) == (self.weights[:, rays] > 0), axis=(1, 2))
                    there = along[full][..., rays] @ finer[0].T
                    both = ((function(there) @ finer[1]).mean(axis=1) for function in (np.cos, np.sin))
                    modulation[full, k] = np.hypot(*both)
            found += modulation * limits / 2
        return found

    def _limits(self, lens: Lens) -> Array:
        """Return the modulation that diffraction leaves the design (2, fields), along the field and across it."""
        _, slopes = self._film(Copies(lens, (), np.zeros((1, 0, 2))))
        cosines = slopes / np.sqrt(1.0 + np.sum(slopes**2, axis=-1, keepdims=True))
        found = np.zeros((2, len(self.counts)))
        for place, wavelength in enumerate(self.merit.wavelengths_nm):
            index = float(lens.indices(wavelength)[-1])
            weights = self.weights[None, [place]] * len(self.merit.wavelengths_nm)
            for number, axis in enumerate(self._axes()):
                along = np.sum(cosines[:, [place]] * axis, axis=-1)
                off = along - self._each(self._sums(weights * along))
                apertures = 2 * index * np.sqrt(self._sums(weights * off**2)[0])
                found[number] += [diffraction_mtf([self.merit.mtf_per_mm], na, wavelength)[0] for na in apertures]
        return found / len(self.merit.wavelengths_nm)
