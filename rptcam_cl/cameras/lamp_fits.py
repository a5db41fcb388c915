"""How the film sees one lamp through the pupil: polynomials in the film point, fitted to exact rays from the lamp."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras.lamp_reach import NEAR, LampReach, Reached
from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]

SCANT_ACROSS = 4  # rays across the pupil for whether a lamp is worth more
ACROSS, FEW_ACROSS = 16, 12  # rays across the pupil for the middle of a lamp, and for its edges and other colours
DEGREE = 5  # of the polynomials
CELLS = 12  # across the pupil, each with a ray or more where it is open
AT_ONCE = 32  # lamps whose rays are traced together
FEWEST = 40  # rays that a lamp needs
LARGEST_ERROR = (
    0.15  # of a polynomial, in radii of the pupil: beyond it, a film point sees a lamp through several places
)


@dataclass(frozen=True)
class SeenLamp:
    """A lamp as the camera sees it.

    Attributes
    ----------
    centre : (3,) array
        In the camera's frame [m].
    axes : (2, 3) array
        From there to the edge, in two directions.
    is_round : bool
        Whether it is an ellipse with these half axes; otherwise the parallelogram of half edges.
    radiance : float
        Luminance of what it emits [W/(m² sr)].
    """

    centre: Array
    axes: Array
    is_round: bool
    radiance: float


class Polynomial:
    """The polynomial in a point (n, 2) that is fitted to values (n, k)."""

    def __init__(self, points: Array, values: Array, degree: int = DEGREE) -> None:
        self._degree = degree
        self._middle = points.mean(axis=0)
        self._scale = np.maximum(np.abs(points - self._middle).max(axis=0), np.finfo(np.float64).tiny)
        x, y = self._powers(0, points[:, 0]), self._powers(1, points[:, 1])
        i, j = np.array([(i, k - i) for k in range(degree + 1) for i in range(k + 1)]).T
        terms = x[:, i] * y[:, j]
        coefficients = np.linalg.lstsq(terms, values, rcond=1e-10)[0]
        self._coefficients = np.zeros((degree + 1, degree + 1, values.shape[1]))
        self._coefficients[i, j] = coefficients
        off = terms @ coefficients - values
        self.error = float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1))))

    def _powers(self, axis: int, places: Array) -> Array:
        """Return the powers (n, degree + 1) of places along an axis."""
        found = np.ones((len(places), self._degree + 1))
        found[:, 1:] = ((places - self._middle[axis]) / self._scale[axis])[:, None]
        return np.asarray(np.multiply.accumulate(found, axis=1))

    def on_grid(self, x: Array, y: Array) -> Array:
        """Return its values (y, x, k) at all points of a grid."""
        along = np.tensordot(self._powers(0, x), self._coefficients, 1)
        return np.asarray(np.tensordot(self._powers(1, y), along, ([1], [1])))


@dataclass(frozen=True)
class LampFit:
    """Polynomials in the film point.

    Attributes
    ----------
    middle : Polynomial
        Place in the pupil, and where the ray enters the camera [m], of rays to the lamp's middle.
    edges : pairs of Polynomial
        Place in the pupil of rays to the ends of both axes.
    colours : pair of Polynomial or None
        That of rays to its middle of two wavelengths.
    film, pupil : (n, 2) arrays
        What rays of the middle reach.
    """

    middle: Polynomial
    edges: tuple[tuple[Polynomial, Polynomial], tuple[Polynomial, Polynomial]]
    colours: tuple[Polynomial, Polynomial] | None
    film: Array
    pupil: Array

    @property
    def pupil_middle(self) -> Array:
        """Middle of the part of the pupil that the lens opens to the lamp."""
        return np.asarray((self.pupil.min(axis=0) + self.pupil.max(axis=0)) / 2)

    @property
    def pupil_radius(self) -> float:
        """Of the circle about it."""
        return float(np.linalg.norm(self.pupil - self.pupil_middle, axis=1).max())

    @property
    def pupil_area(self) -> float:
        """About that of this part."""
        away = self.pupil.T - self.pupil.mean(axis=0)[:, None]
        return float(4 * np.pi * np.sqrt(np.linalg.det(np.dot(away, away.T) * (1 / (away.shape[1] - 1)))))

    def near(self, places: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which places of the pupil (..., 2) have rays that pass in their neighbourhood, and all over it."""
        low, high = self.pupil.min(axis=0), self.pupil.max(axis=0)

        def cells(points: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
            cell = np.clip((points - low) * (CELLS / (high - low)) + 2, 0, CELLS + 3).astype(np.intp)
            return cell[..., 0], cell[..., 1]

        lit = np.zeros((CELLS + 6, CELLS + 6), dtype=bool)
        row, column = cells(self.pupil * (1 - 1e-9) + (low + high) / 2 * 1e-9)
        lit[row + 1, column + 1] = True
        around = np.array([lit[i : CELLS + 4 + i, j : CELLS + 4 + j] for i, j in np.ndindex(3, 3)])
        at = cells(places)
        return np.any(around, axis=0)[at], np.all(around, axis=0)[at]


def fits_of_small(
    lamps: Sequence[SeenLamp], reach: LampReach, colours_nm: tuple[float, float] | None, largest: float
) -> dict[int, LampFit]:
    """Return how lamps are seen, by their numbers.

    Left out are those that fill a larger part of the pupil, those of which too little light comes through, and those
    that a film point sees twice.
    """
    if not lamps:
        return {}
    points = np.array([[lamp.centre, *(lamp.centre + lamp.axes)] for lamp in lamps])
    near = _near(points, reach)
    small = np.flatnonzero(_parts_of_pupil(points, near, reach) < largest)
    fits = {}
    for low in range(0, len(small), AT_ONCE):
        some = small[low : low + AT_ONCE]
        middles = reach.rays(points[some, 0], ACROSS, None, near[some, 0])
        enough = np.flatnonzero(middles.passed.sum(axis=1) >= FEWEST)
        if not len(enough):
            continue
        some, middles = some[enough], middles.of(enough)
        ends, near_ends = _ends([lamps[number] for number in some.tolist()], near[some, 1:], reach)
        of_ends = reach.rays(ends, FEW_ACROSS, None, near_ends)
        centres = points[some, 0]
        colours = [reach.rays(centres, FEW_ACROSS, nm, reach.near(centres, nm)) for nm in colours_nm or ()]
        for k, number in enumerate(some.tolist()):
            fit = _fit(middles.of([k]), of_ends.of(range(4 * k, 4 * k + 4)), [each.of([k]) for each in colours])
            if fit is not None:
                fits[number] = fit
    return fits


def _near(points: Array, reach: LampReach) -> Array:
    """Return where the middles and the first ends of lamps (n, 3, 3) are seen; of the ends where a middle is."""
    near = np.zeros((*points.shape[:2], *NEAR))
    near[:, 0] = reach.near(points[:, 0], None)
    seen = np.flatnonzero(reach.rays(points[:, 0], SCANT_ACROSS, None, near[:, 0]).passed.any(axis=1))
    near[seen, 1:] = reach.near(points[seen, 1:].reshape(-1, 3), None).reshape(-1, 2, *NEAR)
    return near


def _parts_of_pupil(points: Array, near: Array, reach: LampReach) -> Array:
    """Return about which part of the pupil each lamp fills (n,), by a few rays; 0 where none come through.

    A lamp's image and its disk of defocus share the film, so that the part is the ratio of their areas.

    Parameters
    ----------
    points : (n, 3, 3) array
        Its middle and the ends of its axes.
    near
        Where they are seen through the lens, as `LampReach.near` has it.
    """
    found = reach.rays(points.reshape(-1, 3), SCANT_ACROSS, None, near.reshape(-1, *NEAR))
    if not found.passed.any():
        return np.zeros(len(points))
    film, passed = found.film.reshape(*points.shape[:2], -1, 2), found.passed.reshape(*points.shape[:2], -1)
    count = np.maximum(passed.sum(axis=-1), 1)[..., None]
    middle = np.where(passed[..., None], film, 0.0).sum(axis=2) / count
    square = np.sum(np.where(passed, np.sum((film - middle[:, :, None]) ** 2, axis=-1), 0.0), axis=-1) / count[..., 0]
    axes = middle[:, 1:] - middle[:, :1]
    with np.errstate(all="ignore"):
        part = np.abs(np.linalg.det(axes)) / square[:, 0]
    return np.where(passed.any(axis=-1).all(axis=-1) & np.isfinite(part), part, 0.0)


def _ends(lamps: Sequence[SeenLamp], near: Array, reach: LampReach) -> tuple[Array, Array]:
    """Return the ends of the axes of lamps (4 n, 3), and where these are seen; of the first two that is known."""
    ends = np.array([lamp.centre + np.concatenate([lamp.axes, -lamp.axes]) for lamp in lamps])
    others = reach.near(ends[:, 2:].reshape(-1, 3), None).reshape(near.shape)
    return ends.reshape(-1, 3), np.concatenate([near, others], axis=1).reshape(-1, *NEAR)


def _fit(rays: Reached, ends: Reached, colours: Sequence[Reached]) -> LampFit | None:
    if min(each.passed.sum(axis=1).min() for each in (ends, *colours)) < FEWEST:
        return None
    passed = rays.passed[0]
    film, pupil = rays.film[0][passed], rays.pupil[0][passed]
    middle = Polynomial(film, np.concatenate([pupil, rays.entry[0][passed]], axis=1))
    edges = [_fitted(*each) for each in zip(ends.film, ends.pupil, ends.passed, strict=True)]
    by_colour = tuple(_fitted(r.film[0], r.pupil[0], r.passed[0]) for r in colours) or None
    fit = LampFit(middle, ((edges[0], edges[2]), (edges[1], edges[3])), by_colour, film, pupil)  # type: ignore[arg-type]
    return None if middle.error > LARGEST_ERROR * fit.pupil_radius else fit


def _fitted(film: Array, pupil: Array, passed: NDArray[np.bool_]) -> Polynomial:
    return Polynomial(film[passed], pupil[passed])
