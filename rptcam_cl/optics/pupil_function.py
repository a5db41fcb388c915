"""The pupil function of a lens: amplitude and path differences of the light of one point, over its directions.

Behind the lens a ray has the direction cosines (l, m) in x and y, true ones, also off the axis. On a regular grid of
them, found by Newton's iteration on traced rays, lie the flux of the rays and the optical path that each is short
of the chief ray, up to the foot of the perpendicular from the chief ray's point C on the film (the angle
characteristic). The field on the film is then a plain Fourier integral, in a wide cone and off the axis too
(Born and Wolf, Principles of Optics, chapters 4.7 and 8.8).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.ray_trace import Rays
from rptcam_cl.optics.spot import Beam, chief_ray, passing_beam
from rptcam_cl.optics.stop_shape import StopMask
from rptcam_cl.optics.wide_beam import is_steep

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 160  # cells across the pupil
MOST_ACROSS = 640
FEWEST_ACROSS = 16
STEP = 0.25  # waves that the path may change between two cells, before more are taken
FIT_ACROSS = 48  # rays across the beam that the inverse of the ray map is fitted to
POWERS = 10  # of that fit
ROOM = 1.06  # width of the grid in widths of the pupil
NEWTON = 8
EXACT = 1e-12  # direction cosines to which a ray meets its place on the grid
FINER = 8  # rays across a cell that the edge of the pupil runs through
MM_PER_NM = 1e-6
NEVER_0 = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class PupilFunction:
    """Light of one point and wavelength behind the lens, on a square grid of direction cosines.

    Attributes
    ----------
    wavelength_nm : float
        In vacuum.
    index : float
        Of the medium in front of the film.
    chief : (2,) array
        C, where the chief ray meets the film: x, y [mm].
    cosines_x, cosines_y : (n,) arrays
        l of the columns and m of the rows, evenly spaced, each step the same.
    coverage : (n, n) array
        Share of each cell that lies in the pupil.
    density : (n, n) array
        Flux per unit of l times m, to a common factor.
    waves : (n, n) array
        How far the path is shorter than the chief ray's, up to the foot of the perpendicular from C [wavelengths].
    waves_on_sphere : (n, n) array
        The same up to the sphere about C through the axial point of the exit pupil.
    """

    wavelength_nm: float
    index: float
    chief: Array
    cosines_x: Array
    cosines_y: Array
    coverage: Array
    density: Array
    waves: Array
    waves_on_sphere: Array

    @property
    def step(self) -> float:
        """Side of a cell in direction cosines."""
        return float(self.cosines_x[1] - self.cosines_x[0])

    @property
    def length_mm(self) -> float:
        """Wavelength in front of the film [mm]."""
        return self.wavelength_nm * MM_PER_NM / self.index

    @property
    def flux(self) -> Array:
        """Flux of each cell (n, n)."""
        return self.density * self.coverage

    @cached_property
    def field(self) -> NDArray[np.complex128]:
        """The complex amplitude of each cell (n, n)."""
        return np.asarray(np.sqrt(self.density) * self.coverage * np.exp(-2j * np.pi * self.waves))

    def without_aberrations(self) -> PupilFunction:
        """Return the same pupil with a perfect wavefront."""
        zero = np.zeros_like(self.waves)
        return replace(self, waves=zero, waves_on_sphere=zero)


def pupil_function(
    lens: Lens,
    film_distance_mm: float,
    beam: Beam | None = None,
    wavelength_nm: float = 587.5618,
    across: int | None = None,
    sphere_z: float | None = None,
) -> PupilFunction:
    """Return the pupil function of a beam in the y-z plane.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    beam : Beam, optional
        From the axis at infinity when absent.
    wavelength_nm : float
    across : int, optional
        Cells across the pupil; as many as the wavefront needs when absent.
    sphere_z : float, optional
        Axial point of the reference sphere [mm]; the paraxial exit pupil when absent.

    Raises
    ------
    InputError
        When nothing of the beam passes, from the side or behind, when parts of the lens are beside others, and when
        two rays of the beam leave the lens in one direction.
    """
    beam = beam or Beam()
    _check(lens, beam)
    if across is not None and across < FEWEST_ACROSS:
        raise InputError(f"a wavefront needs at least {FEWEST_ACROSS} rays across the beam (got {across})")
    exit_rays = _ExitRays(lens, beam, wavelength_nm, lens.film_z(film_distance_mm), sphere_z)
    box = exit_rays.box
    if across is not None:
        return exit_rays.on_grid(box, across)
    found = exit_rays.on_grid(box, ACROSS)
    steepest = _steepest(found)
    if steepest <= STEP:
        return found
    return exit_rays.on_grid(box, min(int(np.ceil(ACROSS * steepest / STEP)), MOST_ACROSS))


def _check(lens: Lens, beam: Beam) -> None:
    if is_steep(beam.field_degrees) or beam.azimuth_degrees != 90.0:
        raise InputError(
            f"{lens.name}: the wavefront is known for fields up to 85 degrees (got {beam.field_degrees:g})"
        )
    if any(surface.region is not None and not surface.region.blocks for surface in lens.surfaces):
        raise InputError(f"{lens.name}: a half lens has no single wavefront, so its diffraction is not known")


def _steepest(pupil: PupilFunction) -> float:
    """Return the largest difference of path between neighbouring cells of the pupil [waves]."""
    waves = np.where(pupil.coverage > 0, pupil.waves, np.nan)
    steps = np.concatenate([np.abs(np.diff(waves, axis=axis)).ravel() for axis in (0, 1)])
    return float(np.max(steps, where=np.isfinite(steps), initial=0.0))


def _exit_pupil_z(lens: Lens) -> float:
    """Return where the paraxial exit pupil of the d line stands on the axis [mm]."""
    return lens.length + lens.sense * lens.first_order().exit_pupil.distance_mm


def _without_rims(lens: Lens) -> Lens:
    """Return the lens that blocks no ray; whether rays pass is another question than where they go."""
    wide = (
        replace(surface, semi_diameter=np.inf, inner_semi_diameter=0.0, region=None, stop_shape=None)
        for surface in lens.surfaces
    )
    return replace(lens, surfaces=tuple(wide))


class _ExitRays:
    """The rays of a beam by their directions behind the lens."""

    def __init__(self, lens: Lens, beam: Beam, wavelength_nm: float, film_z: float, sphere_z: float | None) -> None:
        self.lens, self.beam, self.wavelength_nm, self.film_z = lens, beam, wavelength_nm, film_z
        self.open = _without_rims(lens)
        indices = lens.indices(wavelength_nm)
        self.first_index, self.index = float(indices[0]), float(indices[-1])
        pupil_z = _exit_pupil_z(lens) if sphere_z is None else sphere_z
        points, rays, _ = passing_beam(lens, beam, wavelength_nm, FIT_ACROSS)
        if len(points) < 12:
            raise InputError(f"{lens.name}: too little of a beam at {beam.field_degrees:g} degrees comes through")
        cosines = rays.directions[:, :2]
        low, high = cosines.min(axis=0), cosines.max(axis=0)
        self.box = np.stack([(low + high) / 2, np.full(2, float((high - low).max()) * ROOM / 2)])
        self.inverse = _Polynomial(self.box, cosines, points)
        height, _ = chief_ray(lens, beam.field_degrees, wavelength_nm, beam.object_distance_mm)
        chief = self._traced(np.array([[0.0, height]]))
        if not chief.passed[0]:
            raise InputError(f"{lens.name}: the chief ray at {beam.field_degrees:g} degrees does not reach the film")
        step = (film_z - chief.origins[0, 2]) / chief.directions[0, 2]
        self.chief = chief.origins[0] + step * chief.directions[0]
        self.chief_path = float(self._path(np.array([[0.0, height]]), chief)[0])
        self.sphere_radius = float(np.linalg.norm(self.chief - [0.0, 0.0, pupil_z]))
        self.sphere_sense = float(np.sign((film_z - pupil_z) * lens.sense)) or 1.0

    def _traced(self, points: Array) -> Rays:
        return self.open.trace(*self.beam.rays(points), self.wavelength_nm, start="scene")

    def _path(self, points: Array, rays: Rays) -> Array:
        """Return the optical path from the source, or its wavefront, to the foot of the perpendicular from C [mm]."""
        behind = np.einsum("ij,ij->i", self.chief - rays.origins, rays.directions)
        path = rays.optical_path + self.index * behind
        if np.isfinite(self.beam.object_distance_mm):
            return np.asarray(path)  # from the source on
        return np.asarray(path + self.first_index * np.einsum("ij,ij->i", *self.beam.rays(points)))

    def on_grid(self, box: Array, across: int) -> PupilFunction:
        """Return the pupil function on a grid over a box (middle, half width) of direction cosines."""
        cells = int(np.ceil(across * ROOM))
        offsets = ((np.arange(cells) + 0.5) / cells * 2 - 1) * box[1, 0]
        cosines_x, cosines_y = box[0, 0] + offsets, box[0, 1] + offsets
        step = float(offsets[1] - offsets[0])
        targets = np.stack(np.meshgrid(cosines_x, cosines_y), axis=-1)
        points, rays, met = self._met(targets.reshape(-1, 2))
        plane, sphere = (np.where(met, part, 0.0).reshape(cells, cells) for part in self._waves(points, rays))
        points = np.where(met[:, None], points, np.nan).reshape(cells, cells, 2)
        density = self._density(points, step)
        coverage = np.where(np.isfinite(density), self._coverage(points, targets, step), 0.0)
        return PupilFunction(
            self.wavelength_nm, self.index, self.chief[:2].copy(), cosines_x, cosines_y, coverage,
            np.where(coverage > 0, density, 0.0), plane, sphere,
        )  # fmt: skip

    def _waves(self, points: Array, rays: Rays) -> tuple[Array, Array]:
        """Return by how much paths are shorter than the chief ray's: to the foot from C, and to the sphere."""
        length = self.wavelength_nm * MM_PER_NM
        plane = (self.chief_path - self._path(points, rays)) / length
        to_chief = self.chief - rays.origins
        foot = np.einsum("ij,ij->i", to_chief, rays.directions)
        miss = np.sum(to_chief * to_chief, axis=1) - foot * foot
        root = np.sqrt(np.maximum(self.sphere_radius**2 - miss, 0.0))
        depth = -np.minimum(miss, self.sphere_radius**2) / np.maximum(root + self.sphere_radius, NEVER_0)
        return plane, plane + self.index * self.sphere_sense * depth / length

    def _met(self, targets: Array) -> tuple[Array, Rays, Mask]:
        """Return the points of the first vertex plane whose rays leave in given directions, the rays, and which do."""
        guess = self.inverse(targets)
        points = guess.copy()
        for _ in range(NEWTON):
            rays = self._traced(points)
            good = rays.passed
            off = np.where(good[:, None], targets - rays.directions[:, :2], 0.0)
            if np.abs(off).max(initial=0.0) < EXACT:
                break
            points = points + guess - self.inverse(targets - off)
        near = np.abs(off).max(axis=1) < 1e-9
        return points, rays, good & near

    def _density(self, points: Array, step: float) -> Array:
        """Return the flux per unit of direction cosines: of even light on a plane, or even intensity of a source."""
        (xm, xl), (ym, yl) = (np.gradient(points[..., axis], step) for axis in (0, 1))
        area = np.abs(xl * ym - xm * yl)
        distance = self.beam.object_distance_mm
        if np.isinf(distance):
            return np.asarray(area)
        source = -np.array([0.0, np.tan(np.radians(self.beam.field_degrees)), 1.0]) * distance
        reach = np.sum((points - source[:2]) ** 2, axis=-1) + distance**2
        return np.asarray(area * distance**3 / reach**1.5)

    def _coverage(self, points: Array, targets: Array, step: float) -> Array:
        """Return the share of each cell that passes every rim; of cells on an edge by rays within them."""
        shape = points.shape[:2]
        finite = np.isfinite(points).all(axis=-1)
        passes = np.zeros(shape, dtype=bool)
        passes[finite] = self._passes(points[finite])
        edge: Mask = finite & _by_an_edge(passes)
        if any(isinstance(surface.stop_shape, StopMask) for surface in self.lens.surfaces):
            edge = np.asarray(finite)  # the holes of a mask may be smaller than a cell
        coverage = passes.astype(np.float64)
        within = (np.arange(FINER) + 0.5) / FINER - 0.5
        moves = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2) * step
        guess = self.inverse(targets[edge])
        correction = points[edge] - guess
        total = np.zeros(int(edge.sum()))
        for move in moves:
            total += self._passes(self.inverse(targets[edge] + move) + correction)
        coverage[edge] = total / len(moves)
        return coverage

    def _passes(self, points: Array) -> Mask:
        return self.lens.trace(*self.beam.rays(points), self.wavelength_nm, start="scene").passed


def _by_an_edge(passes: Mask) -> Mask:
    """Return which cells touch one that differs."""
    wide = np.pad(passes, 1, mode="edge")
    shape = passes.shape
    near = [wide[i : i + shape[0], j : j + shape[1]] for i in range(3) for j in range(3)]
    return np.asarray(np.logical_or.reduce(near) & ~np.logical_and.reduce(near))


class _Polynomial:
    """Points of the first vertex plane as a polynomial of direction cosines, by least squares over a beam."""

    def __init__(self, box: Array, cosines: Array, points: Array) -> None:
        self.middle, self.half = box
        powers = min(POWERS, int(np.sqrt(len(points))) - 2)
        self.powers = [(i, j) for i in range(powers + 1) for j in range(powers + 1 - i)]
        self.factors = np.linalg.lstsq(self._terms(cosines), points, rcond=1e-13)[0]

    def _terms(self, cosines: Array) -> Array:
        x, y = ((cosines - self.middle) / self.half).T
        most = max(i for i, _ in self.powers)
        in_x = np.polynomial.chebyshev.chebvander(x, most)
        in_y = np.polynomial.chebyshev.chebvander(y, most)
        return np.stack([in_x[:, i] * in_y[:, j] for i, j in self.powers], axis=1)

    def __call__(self, cosines: Array) -> Array:
        return np.asarray(self._terms(cosines) @ self.factors)
