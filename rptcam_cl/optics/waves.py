"""Wave optics of one point: the pupil function, and its image, Strehl ratio, transfer and encircled energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam, chief_ray, is_steep, passing_beam, without_rims
from rptcam_cl.optics.lens import Lens, at_conjugates
from rptcam_cl.optics.ray_trace import Rays, at_plane, trace_crossings
from rptcam_cl.optics.shapes import MM_PER_NM
from rptcam_cl.optics.surface import StopMask, Surface

#
# The pupil function of a lens: amplitude and path differences of the light of one point, over its directions.
#
# Behind the lens a ray has the direction cosines (l, m) in x and y, true ones, also off the axis. On a regular grid
# of them, found by Newton's iteration on traced rays, lie the flux of the rays and the optical path that each is
# short of the chief ray, up to the foot of the perpendicular from the chief ray's point C on the film (the angle
# characteristic). The field on the film is then a plain Fourier integral, in a wide cone and off the axis too (Born
# and Wolf, Principles of Optics, chapters 4.7 and 8.8).

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ACROSS = 160  # cells across the pupil
MOST_ACROSS = 640
_FEWEST_ACROSS = 16
STEP = 0.25  # waves that the path may change between two cells, before more are taken
_FIT_ACROSS = 48  # rays across the beam that the inverse of the ray map is fitted to
POWERS = 10  # of that fit
ROOM = 1.06  # width of the grid in widths of the pupil
NEWTON = 8
EXACT = 1e-10  # direction cosines to which a ray meets its place on the grid: 1e-7 waves where it is 1 mm off
FINER = 8  # rays across a cell that the edge of the pupil runs through
NODES = (48, 96)  # traced each way, of which the cells are interpolated
_STENCIL = 10  # nodes each way that a cell takes
SAMPLE = 200  # cells that are traced, too
_SAME_WAVES = 1e-6  # by which these may differ
_NEVER_0 = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True)
class PupilFunction:
    """Light of one field and wavelength behind the lens, on a square grid of direction cosines.

    Attributes
    ----------
    field_degrees : float
        Angle from the axis of the beam.
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

    field_degrees: float
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

    def thirds(self) -> list[PupilFunction]:
        """Return the same pupil by every third row and column of cells, three times: they show how exact figures are.

        By every other one, half of a symmetric pupil would be the mirror image of the other half and agree with it.
        """
        names = ("cosines_x", "cosines_y", "coverage", "density", "waves", "waves_on_sphere")
        every = {name: getattr(self, name) for name in names}
        return [replace(self, **{name: own[(slice(first, None, 3),) * own.ndim] for name, own in every.items()})
                for first in range(3)]  # fmt: skip

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
    check_wavefront(lens, beam)
    if across is not None and across < _FEWEST_ACROSS:
        raise InputError(f"a wavefront needs at least {_FEWEST_ACROSS} rays across the beam (got {across})")
    exit_rays = ExitRays(lens, beam, wavelength_nm, lens.film_z(film_distance_mm), sphere_z)
    if across is not None:
        return exit_rays.on_grid(across)
    pupil = exit_rays.on_grid(ACROSS)
    steepest = largest_step(np.where(pupil.coverage > 0, pupil.waves, np.nan))
    if steepest <= STEP:
        return pupil
    return exit_rays.on_grid(min(int(np.ceil(ACROSS * steepest / STEP)), MOST_ACROSS))


def check_wavefront(lens: Lens, beam: Beam) -> None:
    """Raise an error where the wavefront of a beam is not known."""
    if is_steep(beam.field_degrees) or beam.azimuth_degrees != 90.0:
        raise InputError(
            f"{lens.name}: the wavefront is known for fields up to 85 degrees (got {beam.field_degrees:g})"
        )
    if lens.is_split:
        raise InputError(f"{lens.name}: a half lens has no single wavefront, so its diffraction is not known")


def largest_step(path: Array) -> float:
    """Return the largest difference between neighbouring cells (rows, columns) that have a number; 0 without any."""
    steps = np.concatenate([np.abs(np.diff(path, axis=axis)).ravel() for axis in (0, 1)])
    return float(np.max(steps, where=np.isfinite(steps), initial=0.0))


class ExitRays:
    """The rays of a beam by their directions behind the lens."""

    def __init__(
        self, lens: Lens, beam: Beam, wavelength_nm: float, film_z: float, sphere_z: float | None = None
    ) -> None:
        self.lens, self.beam, self.wavelength_nm, self.film_z = lens, beam, wavelength_nm, film_z
        self.open = at_conjugates(without_rims(lens), beam.object_distance_mm, wavelength_nm)
        self._nodes: dict[int, _Nodes] = {}
        self._too_few: set[int] = set()  # nodes between which rays differ from those that are interpolated
        self._lit: Mask = np.ones((1, 1), dtype=bool)  # where light may pass, by the cells of the last grid
        indices = lens.indices(wavelength_nm)
        self.first_index, self.index = float(indices[0]), float(indices[-1])
        pupil_z = lens.film_z(lens.first_order().exit_pupil.distance_mm) if sphere_z is None else sphere_z
        points, rays, _ = passing_beam(lens, beam, wavelength_nm, _FIT_ACROSS)
        if len(points) < 12:
            raise InputError(f"{lens.name}: too little of a beam at {beam.field_degrees:g} degrees comes through")
        cosines = rays.directions[:, :2]
        low, high = cosines.min(axis=0), cosines.max(axis=0)
        self.box = np.stack([(low + high) / 2, np.full(2, float((high - low).max()) * ROOM / 2)])
        self.is_even = lens.is_rotational and not any(surface.stop_shape for surface in lens.surfaces)
        self.box[0, 0] *= not self.is_even  # what is left of the sum of both sides
        self.inverse = _fit(self.box, cosines, points)
        height, _ = chief_ray(lens, beam.field_degrees, wavelength_nm, beam.object_distance_mm)
        chief = self._trace(np.array([[0.0, height]]))
        if not chief.passed[0]:
            raise InputError(f"{lens.name}: the chief ray at {beam.field_degrees:g} degrees does not reach the film")
        self.chief = at_plane(chief.origins, chief.directions, film_z)[0]
        self.chief_path = float(self._path(np.array([[0.0, height]]), chief)[0])
        self.sphere_radius = float(np.linalg.norm(self.chief - [0.0, 0.0, pupil_z]))
        self.sphere_sense = float(np.sign((film_z - pupil_z) * lens.sense)) or 1.0

    def _trace(self, points: Array) -> Rays:
        return self.open.trace(*self.beam.rays(points), self.wavelength_nm, start="scene")

    def _crossings(self, points: Array) -> tuple[Array, Mask]:
        """Return where rays cross each surface (surfaces, n, 2), in its frame, and which cross all."""
        origins, directions = self.beam.rays(points)
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        p, d = self.open.from_scene_axes(origins.T, unit.T)
        order = range(len(self.open.surfaces))
        places, _, onward = trace_crossings(self.open, order, p, d, self.wavelength_nm, towards_film=True)
        return places, np.asarray(np.isfinite(onward[:, 2]))

    def _path(self, points: Array, rays: Rays) -> Array:
        """Return the optical path from the source, or its wavefront, to the foot of the perpendicular from C [mm]."""
        behind = np.einsum("ij,ij->i", self.chief - rays.origins, rays.directions)
        path = rays.optical_path + self.index * behind
        if np.isfinite(self.beam.object_distance_mm):
            return np.asarray(path)  # from the source on
        return np.asarray(path + self.first_index * np.einsum("ij,ij->i", *self.beam.rays(points)))

    def on_grid(self, across: int) -> PupilFunction:
        """Return the pupil function on a grid of direction cosines.

        Rays are traced for the nodes of a coarser grid, and for cells between nodes where some ray is lost; the others
        are interpolated, as long as a sample of them agrees with traced ones. Of an even pupil only the right half, and
        a column beside it, which its border needs.
        """
        cells = int(np.ceil(across * ROOM))
        offsets = ((np.arange(cells) + 0.5) / cells * 2 - 1) * self.box[1, 0]
        cosines_x, cosines_y = self.box[0, 0] + offsets, self.box[0, 1] + offsets
        step = float(offsets[1] - offsets[0])
        left = cells // 2 - 1 if self.is_even else 0  # the first column
        targets = np.stack(np.meshgrid(cosines_x[left:], cosines_y), axis=-1)
        for nodes in (*(count for count in NODES[self.is_even :] if count < cells), 0):
            if nodes in self._too_few:
                continue
            parts = points, plane, sphere, coverage = self._on_cells(targets, nodes)
            if nodes == 0 or self._agrees(targets, plane, coverage > 0):
                break
            self._too_few.add(nodes)
        self._trace_cells(parts, targets, step)
        if self.is_even:
            plane, sphere, coverage = (_both_halves(part[:, 1:], cells) for part in (plane, sphere, coverage))
            points = _both_halves(points[:, 1:], cells, np.array([-1.0, 1.0]))
        self._lit = _near(_near(coverage > 0))
        density = self._density(points, step)
        coverage = np.where(np.isfinite(density), coverage, 0.0)
        return PupilFunction(
            self.beam.field_degrees, self.wavelength_nm, self.index, self.chief[:2].copy(), cosines_x, cosines_y,
            coverage, np.where(coverage > 0, density, 0.0), plane, sphere,
        )  # fmt: skip

    def _on_cells(self, targets: Array, nodes: int) -> tuple[Array, Array, Array, Array]:
        """Return points, path differences (plane, sphere) and coverage of cells from nodes; NaN, 0 where not known."""
        shape = targets.shape[:2]
        if not nodes:
            return np.full((*shape, 2), np.nan), np.zeros(shape), np.zeros(shape), np.zeros(shape)
        at = np.linspace(-1.0, 1.0, nodes) * self.box[1, 0]
        across, down = _between(at, targets[0, :, 0] - self.box[0, 0]), _between(at, targets[:, 0, 1] - self.box[0, 1])
        if nodes not in self._nodes:
            columns = self.box[0, 0] + (at[nodes // 2 :] if self.is_even else at)
            of_nodes = np.stack(np.meshgrid(columns, self.box[0, 1] + at), axis=-1).reshape(-1, 2)
            points, rays, met = self._find_rays(of_nodes)
            places, crossed = self._crossings(points)
            known = points, self.waves(points, rays), places, met & crossed
            self._nodes[nodes] = _mirrored_nodes(known, nodes) if self.is_even else known
        points, waves, places, met = self._nodes[nodes]

        def spread_out(values: Array) -> Array:
            return np.asarray(down @ np.where(met, values, 0.0).reshape(nodes, nodes) @ across.T)

        lost = (down != 0) @ (~met).reshape(nodes, nodes).astype(float) @ (across != 0).T > 0
        plane, sphere = (np.where(lost, 0.0, spread_out(part)) for part in waves)
        all_points = np.stack([spread_out(points[:, axis]) for axis in (0, 1)], axis=-1)
        all_points[lost] = np.nan
        limits = [
            (surface, spread_out(x), spread_out(y))
            for surface, (x, y) in zip(self.lens.surfaces, np.moveaxis(places, 2, 1), strict=True)
            if surface.inner_semi_diameter or surface.stop_shape or not surface.clears(x[met], y[met]).all()
        ]
        return all_points, plane, sphere, np.where(lost, 0.0, _coverage_by_places(limits, plane.shape))

    def _trace_cells(self, parts: tuple[Array, Array, Array, Array], targets: Array, step: float) -> None:
        """Trace the cells whose points are not known, where light may pass."""
        points, plane, sphere, coverage = parts
        last = (np.arange(len(points)) * len(self._lit)) // len(points)
        unknown = ~np.isfinite(points[..., 0]) & self._lit[np.ix_(last, last[-points.shape[1] :])]
        lit = coverage > 0
        lit[unknown] = self._passes(self.inverse(targets[unknown]))
        rest = _near(_near(lit)) & unknown
        if rest.any():
            found, rays, good = self._find_rays(targets[rest])
            plane[rest], sphere[rest] = (np.where(good, part, 0.0) for part in self.waves(found, rays))
            points[rest] = np.where(good[:, None], found, np.nan)
            coverage[rest] = self._coverage(points, targets, step, rest)[rest]

    def _agrees(self, targets: Array, plane: Array, lit: Mask) -> bool:
        """Return whether interpolated path differences of a sample of lit cells are those of traced rays."""
        rows, columns = np.nonzero(lit)
        some = np.unique(np.linspace(0, len(rows) - 1, min(SAMPLE, len(rows))).astype(int))
        chosen = rows[some], columns[some]
        found, rays, good = self._find_rays(targets[chosen])
        return bool(good.all() and np.abs(self.waves(found, rays)[0] - plane[chosen]).max(initial=0.0) <= _SAME_WAVES)

    def waves(self, points: Array, rays: Rays) -> tuple[Array, Array]:
        """Return by how much paths are shorter than the chief ray's: to the foot from C, and to the sphere."""
        length = self.wavelength_nm * MM_PER_NM
        plane = (self.chief_path - self._path(points, rays)) / length
        to_chief = self.chief - rays.origins
        foot = np.einsum("ij,ij->i", to_chief, rays.directions)
        miss = np.sum(to_chief * to_chief, axis=1) - foot * foot
        root = np.sqrt(np.maximum(self.sphere_radius**2 - miss, 0.0))
        depth = -np.minimum(miss, self.sphere_radius**2) / np.maximum(root + self.sphere_radius, _NEVER_0)
        return plane, plane + self.index * self.sphere_sense * depth / length

    def _find_rays(self, targets: Array) -> tuple[Array, Rays, Mask]:
        """Return the points of the first vertex plane whose rays leave in given directions, the rays, and which do."""
        guess = self.inverse(targets)
        points, off_target = guess.copy(), np.arange(len(guess))
        rays = self._trace(points)
        for _ in range(NEWTON):
            off = targets[off_target] - rays.directions[off_target, :2]
            is_off = rays.passed[off_target] & (np.abs(off).max(axis=1) >= EXACT)
            off_target, off = off_target[is_off], off[is_off]
            if not len(off_target):
                break
            points[off_target] += guess[off_target] - self.inverse(targets[off_target] - off)
            rays.put(off_target, self._trace(points[off_target]))
        near = np.abs(targets - rays.directions[:, :2]).max(axis=1) < 1e-9
        return points, rays, rays.passed & near

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

    def _coverage(self, points: Array, targets: Array, step: float, of: Mask) -> Array:
        """Return the share of cells that passes every rim by rays within those on an edge; elsewhere 0."""
        shape = points.shape[:2]
        finite = np.isfinite(points).all(axis=-1) & _near(of)
        passes = np.zeros(shape, dtype=bool)
        passes[finite] = self._passes(points[finite])
        edge: Mask = finite & by_an_edge(passes)
        if any(isinstance(surface.stop_shape, StopMask) for surface in self.lens.surfaces):
            edge = np.asarray(finite)  # the holes of a mask may be smaller than a cell
        coverage = passes.astype(np.float64)
        within = (np.arange(FINER) + 0.5) / FINER - 0.5
        moves = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2) * step
        correction = points[edge] - self.inverse(targets[edge])
        moved = self.inverse((targets[edge][:, None] + moves).reshape(-1, 2)).reshape(-1, len(moves), 2)
        coverage[edge] = self._passes((moved + correction[:, None]).reshape(-1, 2)).reshape(-1, len(moves)).mean(axis=1)
        return coverage

    def _passes(self, points: Array) -> Mask:
        return self.lens.trace(*self.beam.rays(points), self.wavelength_nm, start="scene").passed


def _coverage_by_places(limits: Sequence[tuple[Surface, Array, Array]], shape: tuple[int, ...]) -> Array:
    """Return the share of each cell that passes every rim, by where its ray crosses each surface: x and y of the cells.

    Cells on an edge count by FINER times FINER places within, to second order of the places about them.
    """
    passing = [surface.clears(x, y) for surface, x, y in limits]
    passes = np.logical_and.reduce(passing) if limits else np.ones(shape, dtype=bool)
    has_mask = any(isinstance(surface.stop_shape, StopMask) for surface, _, _ in limits)
    edge = np.ones(shape, dtype=bool) if has_mask else by_an_edge(passes)  # holes may be smaller than a cell
    parts = np.ones((int(edge.sum()), FINER**2), dtype=bool)
    within = (np.arange(FINER) + 0.5) / FINER - 0.5
    moves = np.stack(np.meshgrid(within, within), axis=-1).reshape(-1, 2)
    for (surface, x, y), own in zip(limits, passing, strict=True):
        cells = edge if has_mask else edge & _near(~own)
        parts[cells[edge]] &= surface.clears(_about(x, cells, moves), _about(y, cells, moves))
    coverage = passes.astype(np.float64)
    coverage[edge] = parts.mean(axis=1)
    return coverage


def _both_halves(right: Array, cells: int, sign: Array | float = 1.0) -> Array:
    """Return all columns of what is even, or odd with the sign -1, from the right half of so many."""
    return np.concatenate([sign * right[:, cells % 2 :][:, ::-1], right], axis=1)


_Nodes = tuple[Array, tuple[Array, Array], Array, Mask]


def _mirrored_nodes(right: _Nodes, nodes: int) -> _Nodes:
    """Return points, path differences, places on surfaces and which are known of all nodes, from their right half."""

    def both(values: Array, sign: Array | float = 1.0) -> Array:
        return _both_halves(values.reshape(nodes, -1, *values.shape[1:]), nodes, sign).reshape(-1, *values.shape[1:])

    points, (plane, sphere), places, met = right
    odd, known = np.array([-1.0, 1.0]), both(met.astype(np.float64)) > 0
    return both(points, odd), (both(plane), both(sphere)), np.stack([both(each, odd) for each in places]), known


def by_an_edge(passes: Mask) -> Mask:
    """Return which cells touch one that differs."""
    return _near(passes) & _near(~passes)


def _near(cells: Mask) -> Mask:
    """Return which cells are among some, or touch them."""
    wide, shape = np.pad(cells, 1, mode="edge"), cells.shape
    lines = wide[:-2] | wide[1:-1] | wide[2:]
    return np.asarray(lines[:, : shape[1]] | lines[:, 1 : shape[1] + 1] | lines[:, 2:])


def _about(values: Array, cells: Mask, moves: Array) -> Array:
    """Return values (cells, moves) at moves in parts of a cell, to second order of those of the neighbours."""
    wide = np.pad(values, 1, mode="reflect", reflect_type="odd")
    rows, columns = (index + 1 for index in np.nonzero(cells))
    here = wide[rows, columns]
    left, right, below, above = (wide[rows + i, columns + j] for i, j in ((0, -1), (0, 1), (-1, 0), (1, 0)))
    across = sum(s * wide[rows + i, columns + j] for s, i, j in ((1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1))) / 4
    u, v = moves.T
    parts = (here, (right - left) / 2, (above - below) / 2, left + right - 2 * here, above + below - 2 * here, across)
    return np.asarray(np.stack(parts, axis=1) @ np.stack([np.ones_like(u), u, v, u * u / 2, v * v / 2, u * v]))


def _between(nodes: Array, places: Array) -> Array:
    """Return the weights (places, nodes) of values at even nodes for values between, by Lagrange's polynomials."""
    count = min(_STENCIL, len(nodes))
    step = nodes[1] - nodes[0]
    first = np.clip(np.rint((places - nodes[0]) / step - (count - 1) / 2).astype(int), 0, len(nodes) - count)
    weights = np.zeros((len(places), len(nodes)))
    at = (places - nodes[0]) / step - first
    for k in range(count):
        others = np.array([j for j in range(count) if j != k])
        weights[np.arange(len(places)), first + k] = np.prod((at[:, None] - others) / (k - others), axis=1)
    return weights


def _fit(box: Array, cosines: Array, points: Array) -> Callable[[Array], Array]:
    """Return points of the first vertex plane as a polynomial of direction cosines, by least squares over a beam."""
    middle, half = box
    most = min(POWERS, int(np.sqrt(len(points))) - 2)
    i, j = np.nonzero(np.add.outer(np.arange(most + 1), np.arange(most + 1)) <= most)

    def terms(cosines: Array) -> tuple[Array, Array]:
        x, y = ((cosines - middle) / half).T
        return np.polynomial.chebyshev.chebvander(x, most), np.polynomial.chebyshev.chebvander(y, most)

    in_x, in_y = terms(cosines)
    factors = np.zeros((most + 1, 2, most + 1))
    factors[i, :, j] = np.linalg.lstsq(in_x[:, i] * in_y[:, j], points, rcond=1e-13)[0]

    def inverse(cosines: Array) -> Array:
        in_x, in_y = terms(cosines)
        return np.asarray(np.einsum("nik,nk->ni", np.tensordot(in_x, factors, 1), in_y))

    return inverse


#
# The wave-optical image of a point, of its pupil function: Strehl ratio, spread, transfer and encircled energy.
#
# The field on the film is U(x, y) = integral of a exp(2 pi i (l x + m y) / wavelength) dl dm, (x, y) from the chief
# ray's point; it is summed for the very points wanted, by two matrices, so no point lies between two of a transform.

Waves = NDArray[np.complex128]

AIRY = 1.2196698912665045  # radius of the first dark ring of a round pupil, in wavelength times f-number
_PADDED = 2  # the transform's room in widths of the pupil: none of its correlation wraps round
_BESSEL_STEPS = 2048
FAR = 25.0  # argument from which Hankel's expansion of J1 is exact enough
WINDOW = 21  # points across the search of the peak


@dataclass(frozen=True)
class Strehl:
    """Strehl ratios: light at a point over that of the same pupil with a perfect wavefront."""

    at_chief_ray: float
    at_peak: float


def rms_waves(pupil: PupilFunction, waves: Array, without_tilt: bool = False) -> float:
    """Return the rms of a wavefront over the flux about its mean, or about its best plane in l and m [waves]."""
    weight = pupil.flux.ravel()
    weight = weight / weight.sum()
    axes = np.meshgrid(pupil.cosines_x, pupil.cosines_y)
    off = waves.ravel() - weight @ waves.ravel()
    if without_tilt:
        tilt = np.stack([axis.ravel() - weight @ axis.ravel() for axis in axes])
        off = off - np.linalg.solve((tilt * weight) @ tilt.T, (tilt * weight) @ off) @ tilt
    return float(np.sqrt(weight @ off**2))


def peak_to_valley(pupil: PupilFunction, waves: Array) -> float:
    """Return the largest less the smallest path difference inside the pupil [waves]."""
    return float(np.ptp(waves[pupil.coverage >= 0.5]))


def spread(pupil: PupilFunction, x: ArrayLike, y: ArrayLike) -> Array:
    """Return the share of all light per mm2 at the points of a grid: x of the columns, y of the rows [mm] from C."""
    field = _field(pupil, np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    area = pupil.step**2
    return np.asarray(np.abs(field) ** 2 * area**2 / (pupil.flux.sum() * area * pupil.length_mm**2))


def _field(pupil: PupilFunction, x: Array, y: Array) -> Waves:
    turn = 2j * np.pi / pupil.length_mm
    rows, columns = np.exp(turn * np.outer(y, pupil.cosines_y)), np.exp(turn * np.outer(pupil.cosines_x, x))
    return np.asarray(rows @ pupil.field @ columns)


def centroid(pupil: PupilFunction) -> tuple[float, float]:
    """Return the middle of the light on the film, x, y from C [mm]: the mean gradient of the wavefront."""
    both = [_slopes(pupil, axis) for axis in (1, 0)]
    return both[0], both[1]


def _slopes(pupil: PupilFunction, axis: int) -> float:
    slope = np.gradient(pupil.waves, pupil.step, axis=axis)
    inner = np.minimum(np.roll(pupil.coverage, 1, axis), np.roll(pupil.coverage, -1, axis)) > 0
    weight = np.where(inner, pupil.flux, 0.0)
    return float(np.sum(weight * slope) / weight.sum()) * pupil.length_mm


def strehl(pupil: PupilFunction) -> Strehl:
    """Return the Strehl ratios at the chief ray's point and at the brightest point of the film."""
    perfect = float((np.sqrt(pupil.density) * pupil.coverage).sum()) ** 2
    size = _transform_size(pupil)
    light = np.abs(np.fft.fft2(pupil.field.astype(np.complex64), (size, size)))  # single: it says where alone
    row, column = np.unravel_index(int(np.argmax(light)), light.shape)
    width = pupil.length_mm / (size * pupil.step)
    x, y = (-np.fft.fftfreq(size)[k] * size * width for k in (column, row))
    half = width
    for _ in range(4):
        xs, ys = x + np.linspace(-half, half, WINDOW), y + np.linspace(-half, half, WINDOW)
        near = np.abs(_field(pupil, xs, ys)) ** 2
        row, column = np.unravel_index(int(np.argmax(near)), near.shape)
        x, y, half = float(xs[column]), float(ys[row]), half / 8
    at_chief_ray = float(np.abs(pupil.field.sum()) ** 2)
    at_peak = max(float(near.max()), at_chief_ray)  # which may be the same point, summed in another order
    return Strehl(at_chief_ray / perfect, at_peak / perfect)


def transfer(
    pupil: PupilFunction, frequencies_per_mm: ArrayLike, about: tuple[float, float] = (0.0, 0.0)
) -> tuple[Waves, Waves]:
    """Return the transfer (tangential, sagittal): the integral of a(l + wavelength f) a*(l) over that at f = 0.

    Its length is the modulation that the film receives; its phase counts from a point, x, y from C [mm]. Tangential
    frequencies run along y, sagittal ones along x.
    """
    frequencies = np.asarray(frequencies_per_mm, dtype=np.float64)
    shifts = frequencies * pupil.length_mm / pupil.step
    turns = (np.exp(2j * np.pi * frequencies * about[axis]) for axis in (1, 0))
    tangential, sagittal = (_correlate(pupil, shifts, axis) * turn for axis, turn in zip((0, 1), turns, strict=True))
    return tangential, sagittal


def _correlate(pupil: PupilFunction, shifts: Array, axis: int) -> Waves:
    """Return the correlation of the pupil with itself moved along an axis by parts of cells, over its flux.

    By the spread of a line on the film, which is its transform; each point counts on that side of the middle of the
    light where it lies nearer.
    """
    count = _transform_size(pupil)
    line = (np.abs(np.fft.fft(pupil.field, count, axis=axis)) ** 2).sum(axis=1 - axis)
    line /= count * pupil.flux.sum()
    places = np.fft.fftfreq(count) * count
    middle = float(np.angle(line @ np.exp(2j * np.pi * places / count))) * count / (2 * np.pi)
    places = (places - middle + count / 2) % count - count / 2 + middle
    values = np.exp(2j * np.pi / count * np.outer(shifts, places)) @ line
    values += (1.0 - line.sum()) * np.maximum(1.0 - shifts, 0.0)  # unmoved, cells on the edge count by their flux
    return np.where(shifts < len(pupil.coverage), values, 0.0)


def _transform_size(pupil: PupilFunction) -> int:
    """Return how many cells a transform has, a number that it is quick for."""
    return -(-_PADDED * len(pupil.coverage) // 64) * 64


def encircled_function(pupil: PupilFunction, about: tuple[float, float]) -> Callable[[Array], Array]:
    """Return the function that gives the share of the light inside circles of radii [mm] about a point.

    The integral over a circle of the transform of the light: 2 pi r J1(2 pi f r) / (2 pi f), over all frequencies f;
    those of one length, in whole cells, count together.
    """
    size = 1 << int(np.ceil(np.log2(_PADDED * len(pupil.coverage))))
    correlation = np.fft.ifft2(np.abs(np.fft.fft2(pupil.field, (size, size))) ** 2)
    cells = np.rint(np.fft.fftfreq(size) * size).astype(np.int64)
    unit = pupil.step / pupil.length_mm
    across, along = (np.exp(-2j * np.pi * unit * cells * part) for part in about)
    real = np.real(np.conj(correlation) * along[:, None] * across[None, :])
    squares = cells[None, :] ** 2 + cells[:, None] ** 2
    sums = np.bincount(squares.ravel(), weights=real.ravel())
    filled = np.flatnonzero(sums)
    f = unit * np.sqrt(filled[filled > 0])
    middle, others = sums[0], sums[filled[filled > 0]] / f
    scale = unit**2 / pupil.flux.sum()

    def shares(radii: Array) -> Array:
        return np.array([scale * (middle * np.pi * r * r + r * (others @ _bessel_1(2 * np.pi * r * f))) for r in radii])

    return shares


@cache
def _near_bessel_1() -> tuple[Array, Array]:
    """J1 up to ``FAR``, from its integral by the trapezoidal rule."""
    steps = int(FAR) + 64
    t = (np.arange(steps) + 0.5) * np.pi / steps
    known = np.linspace(0.0, FAR, _BESSEL_STEPS)
    return known, np.cos(t - known[:, None] * np.sin(t)).mean(axis=1)


def _bessel_1(x: Array) -> Array:
    """J1, far out by Hankel's expansion (Watson, 7.21)."""
    known, values = _near_bessel_1()
    far = np.maximum(x, FAR)
    turn = far - 0.75 * np.pi
    even = 1 + 15 / (128 * far**2) - 4725 / (32768 * far**4)
    odd = 3 / (8 * far) - 105 / (1024 * far**3)
    hankel = np.sqrt(2 / (np.pi * far)) * (even * np.cos(turn) - odd * np.sin(turn))
    return np.asarray(np.where(x < FAR, np.interp(x, known, values), hankel))


def radius_of_share(shares_within: Callable[[Array], Array], share: float, most_mm: float) -> float:
    """Return the radius [mm] of the circle that holds a share of the light.

    Parameters
    ----------
    shares_within : callable
        Gives the shares of the light inside circles of given radii [mm].
    share : float
    most_mm : float
        Radius of the largest circle that is looked at.
    """
    low, high, below, above = 0.0, most_mm, 0.0, 1.0
    for _ in range(3):
        radii = np.linspace(low, high, 18)[1:]
        shares = shares_within(radii)
        if not (shares >= share).any():
            return high
        k = int(np.argmax(shares >= share))
        low, below = (radii[k - 1], shares[k - 1]) if k else (low, below)
        high, above = float(radii[k]), float(shares[k])
    return float(low + (high - low) * (share - below) / max(above - below, _NEVER_0))


def diffraction_mtf(frequencies_per_mm: ArrayLike, aperture: float, wavelength_nm: float) -> Array:
    """Return the modulation of a perfect lens with a round pupil; 0 from 2 aperture / wavelength on.

    Parameters
    ----------
    aperture : float
        Numerical aperture on the film, along the direction of the modulation: 1 / (2 f-number).
    """
    if not aperture > 0:
        return np.where(np.asarray(frequencies_per_mm, dtype=np.float64) == 0, 1.0, 0.0)
    share = np.asarray(frequencies_per_mm, dtype=np.float64) * wavelength_nm * 1e-6 / (2.0 * aperture)
    inside = np.minimum(np.abs(share), 1.0)
    return np.asarray(2 / np.pi * (np.arccos(inside) - inside * np.sqrt(1 - inside * inside)))


# The image of a point and the transfer of a lens by wave optics, over all wavelengths of a field.

PSF_SHARES = (0.5, 0.8, 0.95)


@dataclass(frozen=True)
class PointImage:
    """The image of a point.

    Attributes
    ----------
    shares : (n, n) array
        Share of the light in each pixel, row 0 at the top (largest y). What falls outside is missing from the sum.
    width_um : float
        Side of the image on the film, about the centroid [micrometres].
    facts : mapping
        Centroid, rms, and radii about the centroid that enclose shares of the light [micrometres], and by how much rms
        and radii change with half as many rays across.
    """

    shares: Array
    width_um: float
    facts: dict[str, float]


WIDEST = 48.0  # radius of the first circle that is searched, in Airy radii
SHOWN = 1.2  # half width of the image over the radius that holds 80 % of the light
THIRDS_OVER_ALL = 2.0  # what a third of the cells changes over the error of all: 8 where that goes by their square
ROUNDING = 1e-12  # of a modulation
FINEST = 16.0  # points per wavelength times f-number that pixels are averaged over at least; 4 leave 2 % at the peak
MOST_POINTS = 1200  # along each side of the image


def wave_transfer(group: Sequence[PupilFunction], frequencies_per_mm: ArrayLike) -> list[Array]:
    """Return tangential and sagittal modulation of one field, and what its perfect pupil would leave of each."""
    limits = [transfer(wave.without_aberrations(), frequencies_per_mm) for wave in group]
    perfect = [np.tensordot(_weights(group), [np.abs(limit[axis]) for limit in limits], 1) for axis in (0, 1)]
    return [*_modulation(group, frequencies_per_mm), *perfect]


def _modulation(group: Sequence[PupilFunction], frequencies_per_mm: ArrayLike) -> list[Array]:
    """Return tangential and sagittal modulation of one field."""
    weights, parts = _weights(group), []
    for wave in group:
        off = group[0].chief - wave.chief
        parts.append(transfer(wave, frequencies_per_mm, (float(off[0]), float(off[1]))))
    return [np.abs(np.tensordot(weights, [part[axis] for part in parts], 1)) for axis in (0, 1)]


def transfer_errors(group: Sequence[PupilFunction], frequencies_per_mm: ArrayLike, all_cells: Sequence[Array]) -> Array:
    """Return by how much a third of the cells changes the modulation of one field, over `THIRDS_OVER_ALL`.

    Of the frequency where it is most, as one alone can stay by chance; nothing is sampled of that of 0.
    """
    parts = [_modulation(part, frequencies_per_mm) for part in zip(*(wave.thirds() for wave in group), strict=True)]
    most = float(np.abs(np.array(parts) - np.array(all_cells[:2])).max()) / THIRDS_OVER_ALL
    return np.where(np.asarray(frequencies_per_mm) == 0, ROUNDING, most)


def wave_point_image(group: Sequence[PupilFunction], pixels: int, width_um: float | None = None) -> PointImage:
    """Return the image of one field by waves, its wavelengths together, about the middle of its light; as `psf`."""
    weights = _weights(group)
    middles = np.array([wave.chief + centroid(wave) for wave in group])
    middle = weights @ middles
    offsets = [middle - wave.chief for wave in group]
    facts = _facts(group, weights, offsets)
    facts |= {"centroid_x_mm": float(middle[0]), "centroid_y_mm": float(middle[1])}
    parts = [_facts(part, weights, offsets) for part in zip(*(wave.thirds() for wave in group), strict=True)]
    errors = {name: max(abs(part[name] - facts[name]) for part in parts) / THIRDS_OVER_ALL for name in parts[0]}
    facts["strehl_error"] = max(errors["strehl"], errors["strehl_at_peak"])
    facts["radius_error_um"] = max(errors[f"radius_of_{100 * share:.0f}_percent_um"] for share in PSF_SHARES)
    half = (width_um or 2 * SHOWN * facts["radius_of_80_percent_um"]) / 2e3
    shares = np.zeros((pixels, pixels))
    for wave, weight, offset in zip(group, weights, offsets, strict=True):
        shares += weight * _pixel_shares(wave, offset, half, pixels)
    return PointImage(shares, 2e3 * half, facts)


def _weights(group: Sequence[PupilFunction]) -> Array:
    """Return the share of each wavelength: that of the light of its beam."""
    light = np.array([wave.flux.sum() * wave.step**2 for wave in group])
    return np.asarray(light / light.sum())


def _facts(group: Sequence[PupilFunction], weights: Array, offsets: Sequence[Array]) -> dict[str, float]:
    """Return the Strehl ratios and the radii about the middle of the light that hold shares of it [micrometres]."""
    ratios = [strehl(wave) for wave in group]
    facts = {
        "strehl": float(weights @ [ratio.at_chief_ray for ratio in ratios]),
        "strehl_at_peak": float(weights @ [ratio.at_peak for ratio in ratios]),
    }

    circles = [
        encircled_function(wave, (float(off[0]), float(off[1]))) for wave, off in zip(group, offsets, strict=True)
    ]

    def within(radii: Array) -> Array:
        return np.asarray(weights @ [shares(radii) for shares in circles])

    airy = [_airy_radius(wave) for wave in group]
    held = [float(shares(np.array([radius]))[0]) for shares, radius in zip(circles, airy, strict=True)]
    facts |= {"airy_radius_um": 1e3 * float(weights @ airy), "share_within_airy_radius": float(weights @ held)}
    widest = WIDEST * max(airy)
    room = min(wave.length_mm / wave.step for wave in group) / 2  # beyond it the light repeats
    while widest < room and within(np.array([widest]))[0] < max(PSF_SHARES):
        widest = min(2 * widest, room)
    for share in PSF_SHARES:
        facts[f"radius_of_{100 * share:.0f}_percent_um"] = 1e3 * radius_of_share(within, share, widest)
    return facts


def _airy_radius(pupil: PupilFunction) -> float:
    """Return the first dark ring of a round pupil of the same area in direction cosines [mm]."""
    diameter = 2 * float(np.sqrt(pupil.coverage.sum() * pupil.step**2 / np.pi))
    return AIRY * pupil.length_mm / diameter


def _pixel_shares(pupil: PupilFunction, offset: Array, half_mm: float, pixels: int) -> Array:
    """Return the share of light in each pixel, row 0 at the top, about a point off C; by the mean over its points."""
    pixel = 2 * half_mm / pixels
    finer = int(np.ceil(pixel * FINEST * AIRY / _airy_radius(pupil)))
    finer = max(1, min(finer, MOST_POINTS // pixels))
    count = pixels * finer
    places = ((np.arange(count) + 0.5) / count * 2 - 1) * half_mm
    light = spread(pupil, offset[0] + places, offset[1] - places)
    return np.asarray(light.reshape(pixels, finer, pixels, finer).sum(axis=(1, 3)) * (pixel / finer) ** 2)
