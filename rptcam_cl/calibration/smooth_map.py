"""The way from the picture to directions and back as smooth functions, for maps with a value for every pixel.

A direction is written as its angle from the axis, along its azimuth: two numbers that are smooth functions of the place
up to and beyond 90 degrees. Polynomials fitted to chief rays say them; at other chief rays their error is measured.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from rptcam_cl.calibration.models import BY_ANGLE, normal_points
from rptcam_cl.calibration.view import View
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAMPLES = (45, 33)  # chief rays across and down that a fit goes by
MARGIN = 0.02  # of the picture's sides that is fitted beyond its edges
DEGREES = (10, 16, 24)  # that are tried
GOOD_PX = 2e-3  # error that is good enough
NEWTON = 6  # rounds of the way back, which mostly needs one
EXACT_PX = 1e-4
CHUNK = 1 << 14
LEAST = 60  # chief rays below which there is nothing to fit


@dataclass(frozen=True)
class Polynomial:
    """A smooth function of the plane: Chebyshev polynomials (n, n, outputs) over a box (low, high)."""

    coefficients: Array
    low: Array
    high: Array

    def _unit(self, points: Array) -> Array:
        return np.asarray((points - self.low) / (self.high - self.low) * 2.0 - 1.0)

    def __call__(self, points: Array) -> Array:
        """Return the values (n, 2) at points (n, 2)."""
        return self._evaluated(self.coefficients, points)

    def slopes(self, points: Array) -> Array:
        """Return the derivatives (n, outputs, 2) at points (n, 2)."""
        scale = 2.0 / (self.high - self.low)
        return np.stack(
            [self._evaluated(chebyshev.chebder(self.coefficients, axis=k) * scale[k], points) for k in (0, 1)], axis=-1
        )

    def _evaluated(self, coefficients: Array, points: Array) -> Array:
        unit = self._unit(points)
        result = np.empty((len(points), coefficients.shape[2]))
        for start in range(0, len(points), CHUNK):
            part = unit[start : start + CHUNK]
            across = chebyshev.chebvander(part[:, 0], coefficients.shape[0] - 1)
            down = chebyshev.chebvander(part[:, 1], coefficients.shape[1] - 1)
            for k in range(coefficients.shape[2]):
                result[start : start + CHUNK, k] = np.sum((across @ coefficients[:, :, k]) * down, axis=1)
        return result


def fitted(points: Array, values: Array, degree: int, low: Array, high: Array) -> Polynomial:
    """Return the polynomials of a total degree that fit values (n, 2) at points (n, 2) best."""
    unit = (points - low) / (high - low) * 2.0 - 1.0
    across, down = (chebyshev.chebvander(unit[:, k], degree) for k in (0, 1))
    i, j = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]).T
    solution = np.linalg.lstsq(across[:, i] * down[:, j], values, rcond=1e-12)[0]
    coefficients = np.zeros((degree + 1, degree + 1, values.shape[1]))
    coefficients[i, j] = solution
    return Polynomial(coefficients, low, high)


@dataclass(frozen=True)
class SmoothMap:
    """Places of a picture and their directions, both ways.

    Attributes
    ----------
    to_angles, to_places : Polynomial
    size : tuple of int
        Of the picture [pixels].
    error_px : float
        Largest distance between a place and where the polynomials see its chief ray, at places between those fitted.
    widest : float
        Largest angle from the axis that was fitted [radians].
    """

    to_angles: Polynomial
    to_places: Polynomial
    size: tuple[int, int]
    error_px: float
    widest: float

    def angles(self, places: Array) -> Array:
        """Return the angles (n, 2) of places (n, 2) of the picture [radians]."""
        return self.to_angles(places)

    def places(self, angles: Array) -> tuple[Array, Mask]:
        """Return the places (n, 2) of angles (n, 2), and which of them lie in the picture or just beyond its edges."""
        found = np.full(angles.shape, -1.0)
        inside = np.all((angles >= self.to_places.low) & (angles <= self.to_places.high), axis=1)
        rows = np.flatnonzero(inside & (np.linalg.norm(angles, axis=1) <= self.widest * (1 + MARGIN)))
        low, high = self.to_angles.low, self.to_angles.high
        at, wanted = np.clip(self.to_places(angles[rows]), low, high), angles[rows]
        left = np.arange(len(rows))
        for _ in range(NEWTON):
            off = self.to_angles(at[left]) - wanted[left]
            step = np.linalg.solve(self.to_angles.slopes(at[left]), off[..., None])[..., 0]
            at[left] = np.clip(at[left] - step, low, high)
            left = left[np.abs(step).max(axis=1) >= EXACT_PX]
            if not len(left):
                break
        good = np.ones(len(rows), bool)
        good[left] = False
        found[rows[good]] = at[good]
        known = np.zeros(len(angles), bool)
        known[rows[good]] = True
        return found, known


def smooth_map(view: View) -> SmoothMap:
    """Return the smooth map of a view.

    Raises
    ------
    InputError
        When too little of the picture has light.
    """
    size = np.array(view.size, np.float64)
    low, high = -MARGIN * size, (1 + MARGIN) * size
    places, angles = _samples(view, low, high, SAMPLES)
    if len(places) < LEAST:
        raise InputError(f"{view.name}: the picture shows nothing to map (allowed: a film inside the image circle)")
    between, seen = _samples(view, low, high, (SAMPLES[0] - 10, SAMPLES[1] - 8))
    inside = np.all((between >= 0) & (between <= size), axis=1)
    best: SmoothMap | None = None
    for degree in DEGREES:
        if (degree + 1) * (degree + 2) > 2 * len(places):
            break
        to_angles = fitted(places, angles, degree, low, high)
        off = to_angles(between[inside]) - seen[inside]
        off_px = np.linalg.solve(to_angles.slopes(between[inside]), off[..., None])[..., 0]
        error = float(np.linalg.norm(off_px, axis=1).max())
        if best is None or error < best.error_px:
            box = angles.min(axis=0), angles.max(axis=0)
            widest = float(np.linalg.norm(angles, axis=1).max())
            best = SmoothMap(to_angles, fitted(angles, places, degree, *box), view.size, error, widest)
        if error < GOOD_PX:
            break
    assert best is not None
    return best


def _samples(view: View, low: Array, high: Array, counts: tuple[int, int]) -> tuple[Array, Array]:
    """Return places with light, denser towards the edges, and their angles."""
    x, y = (low[k] + (high[k] - low[k]) * (1 - np.cos(np.linspace(0, np.pi, counts[k]))) / 2 for k in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    directions, lit = view.directions(places)
    return places[lit], normal_points(BY_ANGLE, directions[lit])
