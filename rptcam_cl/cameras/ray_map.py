"""A polynomial in place of a lens: from a film point, an aim and a wavelength to the ray that comes out of it.

A lens that looks the same from every azimuth maps two vectors across its axis, the film point x and the place y in the pupil,
to vectors A x + B y, where A and B depend on nothing but x.x, x.y, y.y and the wavelength (Hamilton; Welford, Aberrations of
Optical Systems, 1986, chapter 7). Heights on surfaces and sideways parts of directions are such vectors; places and
directions along the axis are functions of the invariants alone. Each function is fitted by a polynomial of a total degree,
here called the order: vectors then are right to the power 2 order + 1 of film point and pupil, and order 1 is the third
order of Seidel. (Polynomials in the four coordinates themselves: Hanika and Dachsbacher 2014.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.optics.crossings import Crossings, crossings
from rptcam_cl.optics.pupil_shape import narrowing_probes, pupil_boxes
from rptcam_cl.records import DISPERSION_SCALE, DISPERSION_SHIFT

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Exponents = tuple[tuple[int, int, int, int], ...]

LARGEST_ORDER = 4
LARGEST_ERROR_PX = 0.25  # of a ray
LARGEST_LIGHT_ERROR = 2e-3  # of a part of the film
FILM_POINTS = 48  # along a film radius
AIMS = 192  # of each, in a box round its pupil
BEYOND = 0.04  # of that box, by which it is widened
REACH = 1.06  # of every rim: rays that are fitted
NEGLIGIBLE = 2e-4  # share of the light that may be blocked by rims that are left out
COLOURS = 7  # wavelengths that are traced
PARTS = 6  # of the film, equal in area, in which the light is compared
NUDGE = 1e-3  # of the film radius, between film points that tell the scale of the picture


@dataclass(frozen=True)
class RayMap:
    """The polynomials of a lens in use.

    Attributes
    ----------
    film_mm, pupil_mm : float
        What film points and distances of aims from the centre of the pupil are divided by.
    shift : float
        How far that centre moves on the plane of the last vertex, per millimetre of the film point.
    order, rim_order : int
        Of the rays that come out, and of the heights at rims.
    colours : bool
        Whether rays have a wavelength.
    rays : (terms, 6) array
        A and B of the point on the first surface, A and B of the direction, then both along the axis; z runs towards the
        scene, from the first vertex.
    rims : (terms, 2 n) array
        A and B of the heights on surfaces that block light.
    surfaces : tuple of int
        Which these are, from the film on.
    error_px : float
        Largest error of a ray that was not fitted [pixels].
    light_error : float
        Largest error of the light of a part of the film, for what the rims let pass.
    """

    film_mm: float
    pupil_mm: float
    shift: float
    order: int
    rim_order: int
    colours: bool
    rays: Array
    rims: Array
    surfaces: tuple[int, ...]
    error_px: float
    light_error: float


@dataclass(frozen=True)
class _Sample:
    """Rays that were traced, with the variables of the polynomials."""

    film: Array
    aims: Array
    colour: Array
    found: Crossings

    def variables(self, film_mm: float, pupil_mm: float, shift: float) -> tuple[Array, Array, Array]:
        return self.film / film_mm, (self.aims - shift * self.film) / pupil_mm, self.colour


def exponents(order: int, colours: bool) -> Exponents:
    """Return the powers of x.x, x.y, y.y and the colour of every term, as `kernels/lens/ray_map.h` has them."""
    return tuple(
        (i, j, degree - i - j, power)
        for power in range(order + 1 if colours else 1)
        for degree in range(order - power + 1)
        for i in range(degree, -1, -1)
        for j in range(degree - i, -1, -1)
    )


def terms(x: Array, y: Array, colour: Array, powers: Exponents) -> Array:
    """Return the value (n, terms) of every term for film points and places in the pupil (n, 2)."""
    xx, xy, yy = (np.sum(a * b, axis=1) for a, b in ((x, x), (x, y), (y, y)))
    return np.stack([xx**i * xy**j * yy**k * colour**p for i, j, k, p in powers], axis=1)


def ray_map(
    lens: Lens,
    film_distance_mm: float,
    half_film_mm: tuple[float, float],
    wavelengths_nm: float | tuple[float, float],
    pixels_per_mm: float,
    distances_mm: Sequence[float],
    max_error_px: float = LARGEST_ERROR_PX,
) -> RayMap:
    """Return the polynomials of the lowest order that are right to a part of a pixel.

    Parameters
    ----------
    lens
        Rotationally symmetric; a shape of its stop is not looked at.
    wavelengths_nm
        One, or both ends of a range.
    pixels_per_mm
        On the film.
    distances_mm
        From the first surface, at which rays are compared.
    max_error_px
        What a ray may err by.

    Raises
    ------
    InputError
        When the lens has no such map, or none that is good enough.
    """
    if not lens.is_rotational:
        raise InputError(f"{lens.name}: it is not the same from every azimuth")
    radius = float(np.hypot(*half_film_mm))
    nodes = _nodes(wavelengths_nm)
    fitted, others = (_sample(lens, film_distance_mm, radius, nodes, seed) for seed in (1, 2))
    passes = others.found.within(lens)
    if not passes.any():
        raise InputError(f"{lens.name}: no light comes through")
    shift = float(np.sum(others.aims[passes] * others.film[passes]) / np.sum(others.film[passes] ** 2))
    pupil_mm = float(np.hypot(*(others.aims - shift * others.film)[passes].T).max())
    scales = (radius, pupil_mm, shift)
    blocking = _blocking(lens, others.found)
    colours = len(nodes) > 1
    nudge_px = NUDGE * radius * pixels_per_mm
    best = np.inf
    for order in range(1, LARGEST_ORDER + 1):
        powers = exponents(order, colours)
        rays = _fit_rays(lens, fitted, scales, powers)
        error_px = max(_error_px(others, passes, scales, powers, rays, at) for at in distances_mm) * nudge_px
        best = min(best, error_px)
        if error_px <= min(max_error_px, LARGEST_ERROR_PX):
            break
    else:
        raise InputError(
            f"{lens.name}: polynomials of degree {2 * LARGEST_ORDER + 1} err by up to {best:.2g} pixels"
            f" (allowed: {min(max_error_px, LARGEST_ERROR_PX):.2g})"
        )
    for rim_order in range(1, LARGEST_ORDER + 1):
        powers = exponents(rim_order, colours)
        rims = _fit_rims(lens, fitted, scales, powers, blocking)
        light_error = _light_error(lens, others, passes, scales, powers, rims, blocking)
        if light_error <= LARGEST_LIGHT_ERROR:
            break
    return RayMap(*scales, order, rim_order, colours, rays, rims, blocking, float(error_px), light_error)


def _nodes(wavelengths_nm: float | tuple[float, float]) -> Array:
    """Return the wavelengths [nm] that are traced: those of a range where a polynomial in 1 / wavelength is best known."""
    if not isinstance(wavelengths_nm, tuple):
        return np.array([wavelengths_nm])
    ends = 1.0 / np.array(wavelengths_nm)
    inverse = np.cos((np.arange(COLOURS) + 0.5) * np.pi / COLOURS)
    return np.asarray(1.0 / (ends.mean() + inverse * np.ptp(ends) / 2))


def _sample(lens: Lens, film_distance_mm: float, radius: float, nodes: Array, seed: int) -> _Sample:
    """Return rays from film points along a radius, even by area, through boxes a little wider than their pupils."""
    rng = np.random.default_rng(seed)
    film = np.zeros((FILM_POINTS, 2))
    film[:, 0] = radius * np.sqrt((np.arange(FILM_POINTS) + rng.random(FILM_POINTS)) / FILM_POINTS)
    film[-1, 0] = radius
    boxes, lit = pupil_boxes(narrowing_probes(lens, film_distance_mm, float(nodes.mean())), film, radial=True)
    film, low, high = film[lit], boxes[lit, ::2], boxes[lit, 1::2]
    low, size = low - BEYOND * (high - low), (1 + 2 * BEYOND) * (high - low)
    aims = low[:, None] + rng.random((len(film), AIMS, 2)) * size[:, None]
    film = np.repeat(film, AIMS, axis=0)
    aims = aims.reshape(-1, 2)
    start = np.concatenate([film, np.full((len(film), 1), lens.length + film_distance_mm)], axis=1)
    away = np.concatenate([aims - film, np.full((len(film), 1), -film_distance_mm)], axis=1)
    groups = np.arange(len(film)) % len(nodes)
    found = Crossings(np.empty((len(lens.surfaces), len(film), 2)), np.empty((len(film), 3)), np.empty((len(film), 3)))
    for group, wavelength_nm in enumerate(nodes.tolist()):
        rows = groups == group
        part = crossings(lens, start[rows], away[rows], wavelength_nm)
        found.heights[:, rows], found.origins[rows], found.directions[rows] = (
            part.heights,
            part.origins,
            part.directions,
        )
    colour = DISPERSION_SCALE / nodes[groups] - DISPERSION_SHIFT
    return _Sample(film, aims, colour, found)


def _blocking(lens: Lens, found: Crossings) -> tuple[int, ...]:
    """Return the fewest surfaces, found one by one, whose rims block the light; from the film on."""
    rims = np.array([surface.semi_diameter for surface in lens.surfaces])[:, None]
    with np.errstate(invalid="ignore"):
        blocks = ~(np.hypot(found.heights[..., 0], found.heights[..., 1]) <= rims)
    left = blocks.any(axis=0)
    passed = int(np.count_nonzero(~left))
    chosen: list[int] = [] if lens.stop_index is None else [lens.stop_index]
    for k in chosen:
        left = left & ~blocks[k]
    while np.count_nonzero(left) > NEGLIGIBLE * passed:
        k = int(np.argmax(np.count_nonzero(blocks[:, left], axis=1)))
        chosen.append(k)
        left = left & ~blocks[k]
    return tuple(sorted(chosen, reverse=True))


def _solve(sample: _Sample, keep: Mask, scales: tuple[float, float, float], powers: Exponents, vectors: Array) -> Array:
    """Return A and B (terms, 2 k) of vectors (k, n, 2), side by side."""
    x, y, colour = (values[keep] for values in sample.variables(*scales))
    values = terms(x, y, colour, powers)
    rows = [np.concatenate([values * x[:, axis, None], values * y[:, axis, None]], axis=1) for axis in (0, 1)]
    matrix = np.concatenate(rows)
    targets = np.concatenate([vectors[:, keep, 0], vectors[:, keep, 1]], axis=1).T
    found = np.linalg.lstsq(matrix, targets, rcond=None)[0]
    return np.asarray(found.reshape(2, len(powers), -1).transpose(1, 2, 0).reshape(len(powers), -1))


def _fit_rays(lens: Lens, sample: _Sample, scales: tuple[float, float, float], powers: Exponents) -> Array:
    found = sample.found
    keep = found.within(lens, REACH)
    across = _solve(sample, keep, scales, powers, np.stack([found.origins[:, :2], found.directions[:, :2]]))
    x, y, colour = (values[keep] for values in sample.variables(*scales))
    axial = -np.stack([found.origins[keep, 2], found.directions[keep, 2]], axis=1)
    along = np.linalg.lstsq(terms(x, y, colour, powers), axial, rcond=None)[0]
    return np.concatenate([across, along], axis=1)


def _fit_rims(
    lens: Lens, sample: _Sample, scales: tuple[float, float, float], powers: Exponents, blocking: tuple[int, ...]
) -> Array:
    keep = sample.found.within(lens, REACH)
    return _solve(sample, keep, scales, powers, sample.found.heights[list(blocking)])


def heights_at(x: Array, y: Array, values: Array, factors: Array) -> Array:
    """Return vectors (k, n, 2) from terms (n, terms) and their A and B (terms, 2 k)."""
    sums = (values @ factors).T
    return np.asarray(sums[0::2, :, None] * x + sums[1::2, :, None] * y)


def rays_at(x: Array, y: Array, colour: Array, powers: Exponents, rays: Array) -> tuple[Array, Array]:
    """Return points on the first surface and unit directions (n, 3), z towards the scene."""
    values = terms(x, y, colour, powers)
    points, directions = heights_at(x, y, values, rays[:, :4])
    along = values @ rays[:, 4:]
    directions = np.concatenate([directions, along[:, 1:]], axis=1)
    return (
        np.concatenate([points, along[:, :1]], axis=1),
        directions / np.linalg.norm(directions, axis=1, keepdims=True),
    )


def _error_px(
    sample: _Sample,
    passes: Mask,
    scales: tuple[float, float, float],
    powers: Exponents,
    rays: Array,
    distance_mm: float,
) -> float:
    """Return the largest distance of a ray from its place, over the distance of that of a film point `NUDGE` outwards."""
    x, y, colour = (values[passes] for values in sample.variables(*scales))
    points, directions = rays_at(x, y, colour, powers, rays)
    there = points + distance_mm * directions
    flip = np.array([1.0, 1.0, -1.0])
    truth = (sample.found.origins[passes] + distance_mm * sample.found.directions[passes]) * flip
    moved = np.array([NUDGE, 0.0])
    beside, ahead = rays_at(x + moved, y - moved * scales[2] * scales[0] / scales[1], colour, powers, rays)
    step = np.linalg.norm(beside + distance_mm * ahead - there, axis=1)
    return float(np.max(np.linalg.norm(there - truth, axis=1) / step))


def _light_error(
    lens: Lens,
    sample: _Sample,
    passes: Mask,
    scales: tuple[float, float, float],
    powers: Exponents,
    rims: Array,
    blocking: tuple[int, ...],
) -> float:
    """Return the largest share by which the number of rays that pass differs in a part of the film."""
    x, y, colour = sample.variables(*scales)
    heights = heights_at(x, y, terms(x, y, colour, powers), rims)
    limits = np.array([lens.surfaces[k].semi_diameter for k in blocking])[:, None]
    within = (np.hypot(heights[..., 0], heights[..., 1]) <= limits).all(axis=0)
    part = np.minimum((np.sum(x * x, axis=1) * PARTS).astype(int), PARTS - 1)
    true, own = (np.bincount(part[mask], minlength=PARTS) for mask in (passes, within))
    lit = true > 0
    return float(np.max(np.abs(own[lit] / true[lit] - 1)))
