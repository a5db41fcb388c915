"""The image of a point of the scene as waves, and as rays, bring it to the film."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.cameras.film_pupil import Arrivals, FilmPupil, FilmPupils

# The field of a point is the Fourier integral of its pupil function over direction cosines, as in `optics/waves.py`;
# paths and places of the same rays are traced for a few directions, and are polynomials of the others.

Array = NDArray[np.float64]
Waves = NDArray[np.complex128]
Mask = NDArray[np.bool_]

NODES = 31  # directions each way that are traced
POWERS = 13  # of polynomials through them
WIDER = 1.2  # of their square than the opening
FEWEST = 200  # of them that must be found
DISK = 1.15  # radius of a disk of them that counts, in half widths of the square
FAITHFUL_WAVES = 0.03  # rms by which polynomials may miss traced paths


@dataclass(frozen=True)
class PointWave:
    """Light of a point of the scene about a point of the film.

    Attributes
    ----------
    pupil : FilmPupil
        The opening, on a square grid of direction cosines.
    path_mm : (n, n) array
        Optical path to the foot of the perpendicular from the point of the film, but for a constant.
    density : (n, n) array
        Flux per unit of direction cosines, to a common factor.
    places : (n, n, 2) array
        Where the rays meet the film, from that point [mm].
    """

    pupil: FilmPupil
    path_mm: Array
    density: Array
    places: Array

    @cached_property
    def flux(self) -> Array:
        """Flux of each cell (n, n), 1 together."""
        flux = self.density * self.pupil.coverage
        return np.asarray(flux / flux.sum())

    def amplitude(self, nm: float) -> Waves:
        """Return the complex amplitude of each cell (n, n); its square sums to about 1."""
        turns = (self.path_mm - self.path_mm[self.flux > 0].mean()) / (nm * 1e-6)
        scale = np.sqrt(self.density / (self.density * self.pupil.coverage).sum())
        return np.asarray(scale * self.pupil.coverage * np.exp(2j * np.pi * turns))

    @property
    def radius_mm(self) -> float:
        """Distance of the farthest ray that the film receives."""
        return float(np.hypot(*self.places[self.pupil.coverage > 0].T).max())


Rays = Callable[[Array, Array], tuple[Array, Array, Array, Array]]
"""Gives paths [mm], density, places from the film point [mm] and cosines of rays, for x of columns and y of rows."""


def point_wave(pupils: FilmPupils, pupil: FilmPupil, point: Array, source: Array, nm: float) -> PointWave:
    """Return the light of a source [mm], in the frame of the lens, about a point of the film (x, y) [mm].

    Parameters
    ----------
    pupil
        The opening as it is seen there; `opening_of` that of light out of focus.

    Raises
    ------
    InputError
        When its rays are not known well enough.
    """
    axes = [pupil.cosines_x, pupil.cosines_y]
    return PointWave(pupil, *rays_of(pupils, axes, point, source, nm)(*axes)[:3])


def rays_of(pupils: FilmPupils, axes: list[Array], point: Array, source: Array, nm: float) -> Rays:
    """Return the rays of a source, as polynomials of the directions in which the point sees them cross the pupil.

    On a sphere about the point, through the middle of the exit pupil, where the opening ends the light.

    Parameters
    ----------
    axes
        Columns and rows of a square of directions, which they are known about.

    Raises
    ------
    InputError
        As `point_wave`.
    """
    few = [_chebyshev(axis) for axis in axes]
    cosines = np.stack(np.meshgrid(*few), axis=-1)
    rays = pupils.arrive(point, source, nm, cosines)
    seen, path = _on_sphere(rays, point, cosines.reshape(-1, 2), pupils)
    values = np.column_stack([path, rays.density, rays.places - point, cosines.reshape(-1, 2)])
    middles, halves = np.array([axis.mean() for axis in axes]), np.array([np.ptp(axis) / 2 for axis in axes])
    with np.errstate(invalid="ignore"):
        known = np.isfinite(values).all(axis=1) & (np.hypot(*((seen - middles) / halves).T) < DISK)
    if known.sum() < FEWEST:
        raise InputError(f"camera.diffraction: too few rays of a point reach {_named(point)}")
    middle = values[known].mean(axis=0)
    i, j = np.nonzero(np.add.outer(np.arange(POWERS + 1), np.arange(POWERS + 1)) <= POWERS)

    def terms(places: Array, axis: int) -> Array:
        return np.polynomial.chebyshev.chebvander((places - middles[axis]) / (DISK * halves[axis]), POWERS)

    matrix = terms(seen[known, 0], 0)[:, j] * terms(seen[known, 1], 1)[:, i]
    factors, *_ = np.linalg.lstsq(matrix, values[known] - middle, rcond=1e-13)
    missed = np.sqrt(np.mean((matrix @ factors[:, 0] - (values[known, 0] - middle[0])) ** 2)) / (nm * 1e-6)
    if missed > FAITHFUL_WAVES:
        raise InputError(f"camera.diffraction: the wavefront of a point is too uneven at {_named(point)}")
    table = np.zeros((6, POWERS + 1, POWERS + 1))
    table[:, i, j] = factors.T

    def at(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        path, density, *rest = (terms(y, 1) @ part @ terms(x, 0).T for part in table)
        right, up, along_x, along_y = (part + off for part, off in zip(rest, middle[2:], strict=True))
        (xy, xx), (yy, yx) = (np.gradient(part, y, x) for part in (along_x, along_y))
        density = np.maximum(density + middle[1], 0.0) * np.abs(xx * yy - xy * yx)
        return path, density, np.stack([right, up], axis=-1), np.stack([along_x, along_y], axis=-1)

    return at


def _named(point: Array) -> str:
    return f"({point[0]:g}, {point[1]:g}) mm on the film"


def _on_sphere(rays: Arrivals, point: Array, cosines: Array, pupils: FilmPupils) -> tuple[Array, Array]:
    """Return the directions (n, 2) in which a point sees rays cross the sphere about it, and paths up to there [mm]."""
    radius = pupils.pupil_mm
    if not np.isfinite(radius):
        return cosines, rays.path_mm
    off = point - rays.places
    foot = np.sum(off * cosines, axis=1)
    root = np.sign(radius) * np.sqrt(np.maximum(radius**2 - np.sum(off * off, axis=1) + foot**2, 0.0))
    return (off - (foot - root)[:, None] * cosines) / radius, rays.path_mm + pupils.index * (radius - root)


def _chebyshev(axis: Array) -> Array:
    half = WIDER * np.ptp(axis) / 2
    return np.asarray(axis.mean() + half * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES))


#
# The opening for light out of focus, and pictures of a point in pixels.

COARSE = 96  # cells across the opening, of which those by its edge are divided
FINER = 4  # points across a cell that the edge runs through
STEEP = 0.3  # waves that the path may change between two cells
CLEAR = 3.0  # cells across the opening for each wavelength over its aperture that a picture reaches
MOST_ACROSS = 6 * COARSE
ROOM = 1.1  # of a square about the opening as the film sees it, that holds the opening as a point sees it


def opening_of(pupils: FilmPupils, seen: FilmPupil, point: Array, source: Array, nm: float, units: float) -> FilmPupil:
    """Return the opening by the directions in which light of a source [mm] reaches the film about a point.

    Parameters
    ----------
    seen
        What the point of the film itself sees.
    units
        How far its picture reaches, in wavelengths over twice the numerical aperture.

    Raises
    ------
    InputError
        When its rays are not known, or change too fast over the opening.
    """
    middle = np.array([seen.cosines_x.mean(), seen.cosines_y.mean()])
    half = float(ROOM * np.ptp(seen.cosines_x) / 2)
    opens = pupils.directions(point)[0]
    for _ in range(2):
        axes = [middle[k] + half * ((np.arange(COARSE) + 0.5) / COARSE * 2 - 1) for k in (0, 1)]
        rays = rays_of(pupils, axes, point, source, nm)
        path, _, places, ways = rays(*axes)
        grid = np.stack(np.meshgrid(*axes), axis=-1)
        inside = opens(ways.reshape(-1, 2), (places + point).reshape(-1, 2)).reshape(COARSE, COARSE)
        if not inside.any():
            raise InputError("camera.diffraction: no light of a lamp reaches the film")
        step = axes[0][1] - axes[0][0]
        low, high = grid[inside].min(axis=0) - step, grid[inside].max(axis=0) + step
        middle, half = (low + high) / 2, float((high - low).max()) / 2
    steps = [np.abs(np.diff(np.where(inside, path, np.nan), axis=axis)).ravel() for axis in (0, 1)]
    steepest = float(np.nanmax(np.concatenate(steps))) / (nm * 1e-6)
    parts = int(np.ceil(max(steepest / STEEP, CLEAR * units / COARSE, 1.0)))
    if parts * COARSE > MOST_ACROSS:
        raise InputError("camera.diffraction: the wavefront of a lamp is too steep")

    def rays_at(x: Array, y: Array) -> Array:
        _, _, places, ways = rays(x, y)
        return np.concatenate([ways, places + point], axis=-1)

    def passes(them: Array) -> Mask:
        return opens(them[:, :2], them[:, 2:])

    return FilmPupil(*_divided(inside, parts, axes, rays_at, passes), seen.index)


def _divided(
    inside: Mask, parts: int, axes: list[Array], rays: Callable[[Array, Array], Array], passes: Callable[[Array], Mask]
) -> tuple[Array, Array, Array]:
    """Return coverage and axes of cells, so many of each coarse one; only those near the edge are looked at."""
    count = np.arange(COARSE)
    within = (np.arange((COARSE - 1) * parts) + 0.5) / parts  # of the middles of coarse cells
    x, y = (np.interp(within, count, axis) for axis in axes)
    own, at = rays(x, y), np.rint(within).astype(int)
    known, unsure = inside[np.ix_(at, at)], _mixed(inside)[np.ix_(at, at)]
    known[unsure] = passes(own[unsure])
    coverage, edge, fine = known.astype(np.float64), _mixed(known), float(x[1] - x[0])
    moves = ((np.arange(FINER) + 0.5) / FINER - 0.5) * fine
    by_y, by_x = (np.asarray(part)[edge] for part in np.gradient(own, fine, axis=(0, 1)))
    coverage[edge] = np.mean([passes(own[edge] + by_x * u + by_y * v) for u in moves for v in moves], axis=0)
    return coverage, x, y


def _mixed(inside: Mask) -> Mask:
    """Return which cells touch one that differs."""
    wide = np.pad(inside, 1)
    height, width = inside.shape
    near = [wide[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.asarray(np.logical_or.reduce(near) & ~np.logical_and.reduce(near))


def wave_picture(wave: PointWave, nm: float, x_mm: Array, y_mm: Array) -> Array:
    """Return the light per mm2 at points of a grid, x of the columns and y of the rows [mm], of 1 altogether."""
    turn, pupil = 2j * np.pi * wave.pupil.index / (nm * 1e-6), wave.pupil
    step = pupil.step * pupil.index / (nm * 1e-6)
    rows, columns = np.exp(turn * np.outer(y_mm, pupil.cosines_y)), np.exp(turn * np.outer(pupil.cosines_x, x_mm))
    kept = [kept_by_cells(places * step) for places in (x_mm, y_mm)]
    means = wave.amplitude(nm) * np.sinc(wave.places * step).prod(axis=-1)  # of cells, whose rays lead to one place
    return np.asarray(np.abs(rows @ means @ columns) ** 2 * step**2 / np.outer(kept[1], kept[0]))


def kept_by_cells(places: Array) -> Array:
    """Return the share of light, by its distance along an axis in widths of what cells resolve, that cells show there.

    A cell averages the opening over its width, and shows light of one width away, which falls as the cube, as its own.
    """
    near = np.minimum(np.abs(places), 0.5)
    return np.asarray(np.sinc(near) ** 2 + np.sinc(1 - near) ** 2 * (near / (1 - near)) ** 3)


def ray_picture(wave: PointWave, x_mm: Array, y_mm: Array) -> Array:
    """Return the share of light about each point of an even grid, by its rays, (rows, columns)."""
    lit = wave.flux > 0
    shares, index = np.zeros((len(y_mm) + 2) * (len(x_mm) + 2)), []
    for axis, points in enumerate((x_mm, y_mm)):
        place = np.clip((wave.places[lit][:, axis] - points[0]) / (points[1] - points[0]), -1.0, len(points) - 0.001)
        first = np.floor(place).astype(np.int64)
        index.append((first + 1, place - first))
    (i, u), (j, v) = index
    for row, by_row in ((j, 1 - v), (j + 1, v)):
        for column, by_column in ((i, 1 - u), (i + 1, u)):
            shares += np.bincount(row * (len(x_mm) + 2) + column, wave.flux[lit] * by_row * by_column, len(shares))
    return shares.reshape(len(y_mm) + 2, len(x_mm) + 2)[1:-1, 1:-1]
