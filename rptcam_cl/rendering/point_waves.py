"""What waves of a point of the scene make of it on the film: its field, its image, and kernels with aberrations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.device.session import Session
from rptcam_cl.optics.waves import largest_step
from rptcam_cl.rendering import point_spread
from rptcam_cl.rendering.cameras.chief_rays import CameraRays
from rptcam_cl.rendering.cameras.film_pupil import Arrivals, FilmPupil, FilmPupils, by_an_edge
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.model import CameraModel, LampReach, Reached
from rptcam_cl.rendering.cameras.setting import film_frame
from rptcam_cl.rendering.layers import SharpPass, follow_rays
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.point_spread import WAVES_NM, Array, Mask
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.scene import Scene

#
# The image of a point of the scene as waves, and as rays, bring it to the film.
#
# The field of a point is the Fourier integral of its pupil function over direction cosines, as in `optics/waves.py`;
# paths and places of the same rays are traced for a few directions, and are polynomials of the others.

NODES = 31  # directions each way that are traced
POWERS = 13  # of polynomials through them
WIDER = 1.2  # of their square than the opening
_FOUND = 0.2  # of them that must be found
DISK = 1.15  # radius of a disk of them that counts, in half widths of the square
_FAITHFUL_WAVES = 0.03  # rms by which polynomials may miss traced paths


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

    @property
    def radius_mm(self) -> float:
        """Distance from the point of the film of the farthest ray."""
        return float(np.hypot(*self.places[self.flux > 0].T).max())

    @property
    def middle_mm(self) -> Array:
        """Mean place of the rays, from the point of the film (2,)."""
        return np.asarray(np.tensordot(self.flux, self.places, 2))

    @property
    def spot_mm(self) -> float:
        """Root mean square distance of the rays from there."""
        return float(np.sqrt(np.sum(self.flux * np.sum((self.places - self.middle_mm) ** 2, axis=-1))))

    def rms(self, nm: float) -> float:
        """Return the root mean square of the wavefront [waves], without what moves the image."""
        lit = self.flux > 0
        ways = np.stack(np.meshgrid(self.pupil.cosines_x, self.pupil.cosines_y), axis=-1)[lit]
        terms, weight = np.column_stack([np.ones(len(ways)), ways - ways.mean(axis=0)]), np.sqrt(self.flux[lit])
        path = self.path_mm[lit] / (nm * 1e-6)
        moved, *_ = np.linalg.lstsq(terms * weight[:, None], path * weight, rcond=None)
        return float(np.sqrt(np.sum(self.flux[lit] * (path - terms @ moved) ** 2)))

    def strehl(self, nm: float) -> float:
        """Return the light at the point over what a perfect wavefront of the same opening brings there."""
        wave = self.amplitude(nm)
        return float((np.abs(wave.sum()) / np.abs(wave).sum()) ** 2)

    def modulation(self, nm: float, cells: NDArray[np.int_], axis: int) -> Array:
        """Return the modulation of lines across x or y, by how far apart two points of the opening are [cells]."""
        wave = self.amplitude(nm) if axis else self.amplitude(nm).T
        kept = [np.abs((wave[k:] * wave[: len(wave) - k].conj()).sum()) for k in cells]
        return np.array(kept) / float((np.abs(wave) ** 2).sum())

    def amplitude(self, nm: float) -> point_spread.Waves:
        """Return the complex amplitude of each cell (n, n); its square sums to about 1."""
        turns = (self.path_mm - self.path_mm[self.flux > 0].mean()) / (nm * 1e-6)
        scale = np.sqrt(self.density / (self.density * self.pupil.coverage).sum())
        return np.asarray(scale * self.pupil.coverage * np.exp(2j * np.pi * turns))


Rays = Callable[[Array, Array], tuple[Array, Array, Array, Array]]
"""Gives paths [mm], density, places from the film point [mm] and cosines of rays, for x of columns and y of rows."""


def point_wave(
    pupils: FilmPupils,
    pupil: FilmPupil,
    point: Array,
    source: Array,
    nm: float,
    fit: tuple[int, int] = (NODES, POWERS),
) -> PointWave:
    """Return the light of a source [mm], in the frame of the lens, about a point of the film (x, y) [mm].

    Parameters
    ----------
    pupil
        The opening as it is seen there; that of `PointOpening` for light out of focus.
    fit
        As for `rays_of`.

    Raises
    ------
    InputError
        When its rays are not known well enough.
    """
    axes = [pupil.cosines_x, pupil.cosines_y]
    return PointWave(pupil, *rays_of(pupils, axes, point, source, nm, fit)(*axes)[:3])


def rays_of(
    pupils: FilmPupils,
    axes: list[Array],
    point: Array,
    source: Array,
    nm: float,
    fit: tuple[int, int] = (NODES, POWERS),
) -> Rays:
    """Return rays of a source, as polynomials of the directions in which the point sees them cross the pupil.

    On a sphere about the point, through the middle of the exit pupil, where the opening ends the light.

    Parameters
    ----------
    axes
        Columns and rows of a square of directions, which they are known about.
    fit
        Directions each way that are traced, and powers of the polynomials through them.

    Raises
    ------
    InputError
        As `point_wave`.
    """
    nodes, powers = fit
    few = [_chebyshev(axis, nodes) for axis in axes]
    cosines = np.stack(np.meshgrid(*few), axis=-1)
    rays = pupils.arrive(point, source, nm, cosines)
    seen, path = _on_sphere(rays, point, cosines.reshape(-1, 2), pupils)
    values = np.column_stack([path, rays.density, rays.places - point, cosines.reshape(-1, 2)])
    middles, halves = np.array([axis.mean() for axis in axes]), np.array([np.ptp(axis) / 2 for axis in axes])
    with np.errstate(invalid="ignore"):
        known = np.isfinite(values).all(axis=1) & (np.hypot(*((seen - middles) / halves).T) < DISK)
    if known.sum() < _FOUND * nodes**2:
        raise InputError(f"camera.diffraction: too few rays of a point reach {_place_text(point)}")
    middle = values[known].mean(axis=0)
    i, j = np.nonzero(np.add.outer(np.arange(powers + 1), np.arange(powers + 1)) <= powers)

    def terms(places: Array, axis: int) -> Array:
        return np.polynomial.chebyshev.chebvander((places - middles[axis]) / (DISK * halves[axis]), powers)

    matrix = terms(seen[known, 0], 0)[:, j] * terms(seen[known, 1], 1)[:, i]
    factors, *_ = np.linalg.lstsq(matrix, values[known] - middle, rcond=1e-13)
    missed = np.sqrt(np.mean((matrix @ factors[:, 0] - (values[known, 0] - middle[0])) ** 2)) / (nm * 1e-6)
    if missed > _FAITHFUL_WAVES:
        raise InputError(f"camera.diffraction: the wavefront of a point is too uneven at {_place_text(point)}")
    table = np.zeros((6, powers + 1, powers + 1))
    table[:, i, j] = factors.T

    def at(x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        path, density, *rest = (terms(y, 1) @ part @ terms(x, 0).T for part in table)
        right, up, along_x, along_y = (part + off for part, off in zip(rest, middle[2:], strict=True))
        (xy, xx), (yy, yx) = (np.gradient(part, y, x) for part in (along_x, along_y))
        density = np.maximum(density + middle[1], 0.0) * np.abs(xx * yy - xy * yx)
        return path, density, np.stack([right, up], axis=-1), np.stack([along_x, along_y], axis=-1)

    return at


def _place_text(point: Array) -> str:
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


def _chebyshev(axis: Array, nodes: int) -> Array:
    half = WIDER * np.ptp(axis) / 2
    return np.asarray(axis.mean() + half * np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes))


#
# The opening for light out of focus, and pictures of a point in pixels.

COARSE = 96  # cells across the opening, of which those by its edge are divided
FINER = 4  # points across a cell that the edge runs through
STEEP = 0.3  # waves that the path may change between two cells
CLEAR = 3.0  # cells across the opening for each wavelength over its aperture that a picture reaches
MOST_ACROSS = 6 * COARSE
FEW_ACROSS, _FEW_NODES, _FEW_POWERS = 48, 19, 7  # the same, and of rays, in the search for it
ROOM = 1.4  # of a square about the opening that a point near by sees, that holds it


@dataclass(frozen=True)
class PointOpening:
    """The opening by the directions in which light of a point of the scene reaches the film about a point, coarsely.

    Attributes
    ----------
    inside : (n, n) array
        Which directions are open.
    axes : list of two (n,) arrays
        Direction cosines of the columns and the rows.
    rays : callable
        Gives the rays of these directions and others.
    radius_mm : float
        Distance of the farthest ray that the film receives.
    passes : callable
        Finds which directions are open to places (n, 2) about the point [mm].
    index, nm : float
        Of the medium before the film; wavelength of the rays.
    """

    inside: Mask
    axes: list[Array]
    rays: Rays
    radius_mm: float
    passes: Callable[[Array, Array], Mask]
    index: float
    nm: float

    @property
    def aperture(self) -> float:
        """Numerical aperture of the round opening of the same area, in the medium before the film."""
        return float(np.sqrt(self.inside.sum() / np.pi) * (self.axes[0][1] - self.axes[0][0]))

    @property
    def box(self) -> tuple[Array, float]:
        """Middle and half width of the square about what is open, with room of a cell."""
        grid, step = np.stack(np.meshgrid(*self.axes), axis=-1)[self.inside], self.axes[0][1] - self.axes[0][0]
        low, high = grid.min(axis=0) - step, grid.max(axis=0) + step
        return (low + high) / 2, float((high - low).max()) / 2

    def wave(self, units: float) -> PointWave:
        """Return the light of the point, for a picture that reaches so many wavelengths over twice the aperture.

        Raises
        ------
        InputError
            When its path changes too fast over the opening.
        """
        steepest = largest_step(np.where(self.inside, self.rays(*self.axes)[0], np.nan)) / (self.nm * 1e-6)
        parts = int(np.ceil(max(steepest / STEEP, CLEAR * units / COARSE, 1.0)))
        if parts * COARSE > MOST_ACROSS:
            raise InputError("camera.diffraction: the wavefront of a lamp is too steep")

        def rays_at(x: Array, y: Array) -> Array:
            _, _, places, ways = self.rays(x, y)
            return np.concatenate([ways, places], axis=-1)

        cells = _divide_cells(
            self.inside, parts, self.axes, rays_at, lambda rays: self.passes(rays[:, :2], rays[:, 2:])
        )
        pupil = FilmPupil(*cells, self.index)
        return PointWave(pupil, *self.rays(pupil.cosines_x, pupil.cosines_y)[:3])


def rough_opening(
    pupils: FilmPupils, seen: tuple[Array, FilmPupil], point: Array, source: Array, nm: float
) -> PointOpening:
    """Find the opening for light of a source [mm], in the frame of the lens, about a point of the film (x, y) [mm].

    With few cells and rays: `finer_opening` has more.

    Parameters
    ----------
    seen
        A point of the film near by, and the opening that it sees, which tell where to look.

    Raises
    ------
    InputError
        When no light arrives, or its rays are not known.
    """
    few, opens = (FEW_ACROSS, _FEW_NODES, _FEW_POWERS), pupils.directions(point)[0]

    def passes(ways: Array, places: Array) -> Mask:
        return opens(ways, places + point)

    try:
        return _search(pupils, passes, _box_by(pupils, *seen, point), point, source, nm, few)
    except InputError:  # it is not where it is looked for
        own = _box_by(pupils, point, pupils(point, FEW_ACROSS), point)
        return _search(pupils, passes, own, point, source, nm, few)


def finer_opening(pupils: FilmPupils, rough: PointOpening, point: Array, source: Array) -> PointOpening:
    """Find the same with many cells and rays by that of `rough_opening`; raises as this does."""
    return _search(pupils, rough.passes, rough.box, point, source, rough.nm, (COARSE, NODES, POWERS))


def _box_by(pupils: FilmPupils, known: Array, seen: FilmPupil, point: Array) -> tuple[Array, float]:
    """Return middle and half width of a square of directions that holds the opening, by that of another point."""
    middle, half = np.array([seen.cosines_x.mean(), seen.cosines_y.mean()]), float(np.ptp(seen.cosines_x)) / 2

    def from_pupil(place: Array) -> Array:
        return np.asarray(place / np.sqrt(place @ place + pupils.pupil_mm**2) * np.sign(pupils.pupil_mm))

    far = not np.isfinite(pupils.pupil_mm)
    return middle if far else middle + from_pupil(point) - from_pupil(known), ROOM * half


def _search(
    pupils: FilmPupils,
    passes: Callable[[Array, Array], Mask],
    box: tuple[Array, float],
    point: Array,
    source: Array,
    nm: float,
    size: tuple[int, int, int],
) -> PointOpening:
    """Search for an opening in a square of directions; cells across, nodes and powers of the rays."""
    (middle, half), (across, nodes, powers) = box, size
    axes = [middle[k] + half * ((np.arange(across) + 0.5) / across * 2 - 1) for k in (0, 1)]
    rays = rays_of(pupils, axes, point, source, nm, (nodes, powers))
    _, _, places, ways = rays(*axes)
    inside = passes(ways.reshape(-1, 2), places.reshape(-1, 2)).reshape(across, across)
    if not inside.any():
        raise InputError("camera.diffraction: no light of a lamp reaches the film")
    cut = inside[[0, -1]].any() or inside[:, [0, -1]].any()
    if cut and across == FEW_ACROSS:
        raise InputError("camera.diffraction: the opening for a lamp is larger than it is known")
    radius = float(np.hypot(*places[inside].T).max())
    return PointOpening(inside, axes, rays, radius, passes, pupils.index, nm)


def _divide_cells(
    inside: Mask, parts: int, axes: list[Array], rays: Callable[[Array, Array], Array], passes: Callable[[Array], Mask]
) -> tuple[Array, Array, Array]:
    """Return coverage and axes of cells, so many of each coarse one; only those near the edge are looked at."""
    count = np.arange(COARSE)
    within = (np.arange((COARSE - 1) * parts) + 0.5) / parts  # of the middles of coarse cells
    x, y = (np.interp(within, count, axis) for axis in axes)
    own, at = rays(x, y), np.rint(within).astype(int)
    known, unsure = inside[np.ix_(at, at)], by_an_edge(inside)[np.ix_(at, at)]
    known[unsure] = passes(own[unsure])
    coverage, edge, fine = known.astype(np.float64), by_an_edge(known), float(x[1] - x[0])
    moves = ((np.arange(FINER) + 0.5) / FINER - 0.5) * fine
    by_y, by_x = (np.asarray(part)[edge] for part in np.gradient(own, fine, axis=(0, 1)))
    coverage[edge] = np.mean([passes(own[edge] + by_x * u + by_y * v) for u in moves for v in moves], axis=0)
    return coverage, x, y


def wave_picture(wave: PointWave, nm: float, x_mm: Array, y_mm: Array) -> Array:
    """Return the light per mm2 at points of a grid, x of the columns and y of the rows [mm], of 1 altogether."""
    turn, pupil = 2j * np.pi * wave.pupil.index / (nm * 1e-6), wave.pupil
    step = pupil.step * pupil.index / (nm * 1e-6)
    rows, columns = np.exp(turn * np.outer(y_mm, pupil.cosines_y)), np.exp(turn * np.outer(pupil.cosines_x, x_mm))
    kept = [point_spread.kept_by_cells(places * step) for places in (x_mm, y_mm)]
    means = wave.amplitude(nm) * np.sinc(wave.places * step).prod(axis=-1)  # of cells, whose rays lead to one place
    rows, means, columns = (part.astype(np.complex64) for part in (rows, means, columns))  # twice as fast, within 1e-5
    return np.asarray(np.abs(rows @ means @ columns) ** 2 * step**2 / np.outer(kept[1], kept[0]))


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


#
# The kernel of a lens with its aberrations, as the wavefront of a point in focus has them.

_STEEPEST, _STILL_STEEP = 0.35, 0.5  # waves that its path should, and may, change between two cells


def kernel_of_waves(wave: Callable[[float], PointWave], pixel_mm: tuple[float, float], reach: int) -> Array:
    """Return the kernels of red, green and blue (3, 2 reach + 1, 2 reach + 1), of a point about the middle pixel.

    Aberrations too steep for waves count as their rays, spread by a perfect wavefront: as many waves do.

    Parameters
    ----------
    wave
        Gives the light of the point at a wavelength [nm].
    pixel_mm : tuple of float
        Width and height of a pixel; negative where columns or rows run against x or y.
    reach : int
        Pixels on each side of the middle one.
    """
    first = wave(WAVES_NM[0])
    is_steep = _steepest(first) > _STILL_STEEP * WAVES_NM[0] * 1e-6
    wide = max(wave(nm).radius_mm for nm in WAVES_NM[:: len(WAVES_NM) // 2]) / min(map(abs, pixel_mm))
    if not is_steep:
        return point_spread.near_kernel(first.pupil, pixel_mm, reach, lambda nm: wave(nm).amplitude(nm), wide)
    perfect, offsets = point_spread.near_kernel(first.pupil, pixel_mm, reach), np.arange(-reach, reach + 1.0)
    total = np.zeros(perfect.shape)
    for nm, shares in zip(WAVES_NM, point_spread.shares_of_white(WAVES_NM), strict=True):
        rays = ray_picture(wave(nm), offsets * pixel_mm[0], offsets * pixel_mm[1])
        total += shares[:, None, None] * rays
    return point_spread.faded(np.maximum(point_spread.spread(total, perfect), 0.0), reach)


#
# A lens without aberrations in place of a lens: what a film is made of whose kernels of diffraction hold them.
#
# Rays of a film point leave the lens towards the one point of the scene that is sharp there, its conjugate, from where
# and with what weight the lens lets them out. So they bring the blur of what is out of focus, and no aberration. Waves
# of the conjugates bring that, and diffraction with it. docs/diffraction.md has the errors.

_KNOWN_NM = (440.0, 670.0)  # whose paths are traced beside the camera's; others lie between
FIT = 31, 13  # directions each way that rays are traced of, and powers of polynomials between them
_ROOMIER = 1.05  # of a square of directions, for the openings of mirrored places as well
ACROSS = 129  # nodes of the table of conjugates each way: within 0.01 pixels of 2000, for 5 % of distortion
FARTHEST_M = 1e5  # of a point of the scene, beyond which focus is as at infinity
_LINES = np.array([1 / 8, 1 / 4, 1 / 2, 1])  # of the finest lines that are looked at: of four pixels, or of
_FINEST_LINES = 1 / 4  # of those that an opening passes
AS_GOOD = 0.01  # modulation that a wavefront's rays, spread by a perfect one, may be off before waves bring it
NEAR_CELLS, MOST_CELLS = 72, 432  # across an opening, as many as its wavefront takes
# Beside the image circle a sliver of the pupil may show a point of the scene far from where its chief ray leads, which
# would crowd even light between two nodes, or too few rays say how its wavefront goes on.
_MOST_MOVED = 0.004  # of the way to the next node, up to which waves may move the image
_WIDEST_SPOT = 40.0  # wavelengths over twice the aperture: rays of no wavefront that waves bring are farther apart


@dataclass(frozen=True)
class Conjugates:
    """The points of the scene that are sharp on the film, each on the chief ray of a place.

    Attributes
    ----------
    scene : Scene
    chief : CameraRays
    pupils : FilmPupils
    columns, rows : (a,) and (b,) arrays
        Places of nodes [pixels].
    vergence : float
        One over the distance ahead of the film of the plane of focus [1/m]; 0 at infinity.
    waves : list
        Light of the conjugate of each node by rows; None where no light comes from.
    shares : (n, n) array
        How much of the aberrations rays leave out for waves to bring, by rows from edge to edge of the film.
    nm : float
        The camera's wavelength.
    film_z : float
        Of the film in the frame of the lens [mm].
    is_even : bool
        Whether the lens without its rims looks the same in a mirror along x, and in one along y.
    """

    scene: Scene
    chief: CameraRays
    pupils: FilmPupils
    columns: Array
    rows: Array
    vergence: float
    waves: list[PointWave | None]
    shares: Array
    nm: float
    film_z: float
    is_even: bool

    def at(self, places: Array) -> Array:
        """Return the conjugates (n, 4) of places (n, 2) [pixels], homogeneous, in the frame of the camera [m].

        As seen from where the chief ray leaves the lens, each is as long as the share that waves bring.
        """
        origins, directions = self.chief.smooth(places)
        v, far = self.vergence, directions / -directions[:, 2:]
        ahead = 1.0 + v * origins[:, 2:]
        points = np.hstack([v * origins + far * ahead, np.full((len(places), 1), v)])
        return np.asarray(points * (self.share(places)[:, None] / (np.linalg.norm(far, axis=1)[:, None] * ahead)))

    def share(self, places: Array) -> Array:
        """Return how much of the aberrations of places rays leave out (n,), linear between nodes."""
        return _linear(self.shares, *self.chief.upright(places).T)

    def share_of_pixels(self, columns: Array, rows: Array) -> Array:
        """Return the same of a grid (rows, columns)."""
        x, y = (self.chief.upright(np.column_stack([at, at]))[:, k] for k, at in enumerate((columns, rows)))
        return _linear(self.shares, x, y[:, None])

    def source(self, place: Array) -> Array:
        """Return the conjugate of a place (2,) in the frame of the lens [mm], within `FARTHEST_M`."""
        (origin,), (direction,) = self.chief.smooth(place[None])
        ahead = self.vergence * origin - direction * ((1.0 + self.vergence * origin[2]) / direction[2])
        return source_of(np.append(ahead, self.vergence), self.film_z)

    def wave_at(self, place: Array, point: Array, pupil: FilmPupil, nm: float) -> PointWave:
        """Return the light of the conjugate of a place (2,) [pixels], at a point of the film (x, y) [mm].

        A lens that is even is traced for a quarter of the film. Raises as `point_wave`.
        """
        axes = [pupil.cosines_x, pupil.cosines_y]
        if not self.is_even:
            return point_wave(self.pupils, pupil, point, self.source(place), nm, FIT)
        turn = np.where(point < 0, -1.0, 1.0)
        own = [sign * axis for sign, axis in zip(turn, axes, strict=True)]
        key = (*np.round(point * turn, 6).tolist(), nm)
        if key not in self._rays:
            source = self.source(place) * np.append(turn, 1.0)
            roomier = [axis.mean() + _ROOMIER * (axis - axis.mean()) for axis in own]
            self._rays[key] = rays_of(self.pupils, roomier, point * turn, source, nm, FIT)
        path, density, places, _ = self._rays[key](*own)
        return PointWave(pupil, path, density, places * turn)

    @cached_property
    def _rays(self) -> dict[tuple[float, ...], Rays]:
        """Rays of conjugates that are known, by the point of the film and the wavelength."""
        return {}

    def waves_at(
        self, place: Array, point: Array, pupil: FilmPupil, *, splits: bool
    ) -> Callable[[float], PointWave] | None:
        """Return the same as a function of the wavelength [nm]; None where it is not known.

        Parameters
        ----------
        splits
            Whether the lens refracts each wavelength in its own way; otherwise all go as the camera's.
        """
        known: dict[float, PointWave] = {}
        for nm in (self.nm, *(_KNOWN_NM if splits else ())):
            with suppress(InputError):  # the glass is not known there, or the rays are not: others say what it is
                known[nm] = self.wave_at(place, point, pupil, nm)
        return _by_inverse_square(known) if self.nm in known else None

    def cells(self, place: Array) -> int:
        """Return how many cells an opening about a place (2,) takes, by the steepest wavefront about it."""
        columns, rows = (np.clip(np.searchsorted(axis, at) + np.array([-1, 0]), 0, len(axis) - 1)
                         for axis, at in zip((self.columns, self.rows), place, strict=True))  # fmt: skip
        near = [self.waves[row * len(self.columns) + column] for row in rows for column in columns]
        return max((cells_for(wave, self.nm) for wave in near if wave is not None), default=NEAR_CELLS)

    def between(self, pixel_mm: tuple[float, float]) -> float:
        """Return the most that the modulation of the mean of two nodes is off that of the place between them.

        Of lines across columns and rows, of eight pixels or more: a quarter of what a node is off its two neighbours.
        """
        values = np.full((len(self.waves), 2, len(_LINES) - 1), np.nan)
        for own, wave in zip(values, self.waves, strict=True):
            if wave is not None and worth_waves(wave, self.nm, pixel_mm) > AS_GOOD:
                for axis, cells in enumerate(_cells_of_lines(wave, self.nm, pixel_mm)):
                    own[axis] = wave.modulation(self.nm, cells[:-1], axis)
        grid = values.reshape(len(self.rows), len(self.columns), -1)
        off = [np.abs(np.diff(grid, 2, axis=axis)).ravel() / 8 for axis in (0, 1)]
        return float(np.nanmax(np.concatenate([*off, np.zeros(1)])))

    def table(self) -> NDArray[np.float32]:
        """The conjugates of `ACROSS` x `ACROSS` places from edge to edge, as `kernels/lens/stigmatic.h` reads them."""
        return self.at(self.places).astype(np.float32)

    @property
    def places(self) -> Array:
        """Of the table (n, 2) [pixels]."""
        steps = np.linspace(-1.0, 1.0, ACROSS)
        return self.chief.on_picture(np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2))


def _cells_of_lines(wave: PointWave, nm: float, pixel_mm: tuple[float, float]) -> list[NDArray[np.int_]]:
    """Return how many cells of the opening lines are apart that are looked at, across columns and across rows."""
    per_cell = wave.pupil.step * wave.pupil.index / (nm * 1e-6)
    finest = _FINEST_LINES * 2 * wave.pupil.aperture / wave.pupil.step
    return [np.maximum(np.rint(_LINES * min(0.25 / abs(side) / per_cell, finest)), 1).astype(int) for side in pixel_mm]


def worth_waves(wave: PointWave, nm: float, pixel_mm: tuple[float, float]) -> float:
    """Return how far the modulation of a wavefront's rays, spread by a perfect wavefront, is off that of its waves."""
    perfect, per_cell = replace(wave, path_mm=0.0 * wave.path_mm), wave.pupil.step * wave.pupil.index / (nm * 1e-6)
    off = 0.0
    for axis, cells in enumerate(_cells_of_lines(wave, nm, pixel_mm)):
        turns = np.exp(2j * np.pi * per_cell * np.multiply.outer(cells, wave.places[..., axis]))
        rays = np.abs(np.tensordot(turns, wave.flux, 2)) * perfect.modulation(nm, cells, axis)
        off = max(off, float(np.abs(rays - wave.modulation(nm, cells, axis)).max()))
    return off


def cells_for(wave: PointWave, nm: float) -> int:
    """Return how many cells across the opening the path of a wavefront takes, in multiples of those that are enough."""
    at_least = len(wave.pupil.cosines_x) * _steepest(wave) / (_STEEPEST * nm * 1e-6)
    return NEAR_CELLS * max(int(np.ceil(at_least / NEAR_CELLS)), 1)


def _steepest(wave: PointWave) -> float:
    """Return how much the path of a wavefront changes from one cell to the next at most [mm]."""
    return largest_step(np.where(wave.flux > 0, wave.path_mm, np.nan))


def source_of(point: Array, film_z: float) -> Array:
    """Return a point of the scene, homogeneous and in the frame of the camera [m], in that of the lens [mm]."""
    length = float(np.linalg.norm(point[:3]))
    there = point[:3] * min(FARTHEST_M / length, 1.0 / point[3] if point[3] > 0 else np.inf)
    return np.asarray(1e3 * there + [0.0, 0.0, film_z])


def _by_inverse_square(known: Mapping[float, PointWave]) -> Callable[[float], PointWave]:
    """Make a function of the wavelength: paths and places, as polynomials in its inverse square."""
    x, waves = np.array(list(known)) ** -2.0, list(known.values())

    def at(nm: float) -> PointWave:
        factors = [np.prod([(nm**-2.0 - b) / (a - b) for b in x if b != a]) for a in x]
        path = np.tensordot(factors, [wave.path_mm for wave in waves], 1)
        return replace(waves[0], path_mm=path, places=np.tensordot(factors, [wave.places for wave in waves], 1))

    return at


def conjugates_of(
    scene: Scene,
    pupils: FilmPupils,
    nodes: tuple[Array, Array],
    points: Array,
    seen: Sequence[FilmPupil | None],
    pixel_mm: tuple[float, float],
) -> Conjugates | None:
    """Find the conjugates of a film; None where the lens of its camera has no aberrations, or these are not known.

    Nor where rays, spread by a perfect wavefront, are as good everywhere: they know what is out of focus.

    Parameters
    ----------
    nodes
        Columns and rows of places that waves are known at [pixels].
    points : (n, 2) array
        The nodes on the film [mm], by rows.
    seen
        The opening that each sees; None where no light comes from.
    pixel_mm
        Width and height of a pixel.
    """
    setting = camera_of(scene).setting
    if setting is None or film_frame(scene.camera).is_moved or scene.shutter.keys:
        return None
    lens, chief, nm = setting.lens, camera_of(scene).chief_rays(), setting.camera.wavelength_nm
    vergence = 0.0 if not setting.focus_distance_mm else max(1e3 / setting.focus_distance_mm, 0.0)
    film_z, is_even = lens.film_z(setting.film_distance_mm), all(surface.is_even for surface in lens.surfaces)
    waves: list[PointWave | None] = [None for _ in points]
    none = np.zeros((2, 2))
    found = Conjugates(scene, chief, pupils, *nodes, vergence, waves, none, nm, film_z, is_even)
    shares: Array = np.zeros(len(points))
    apart = np.linalg.norm(points - points[:, None], axis=-1)
    next_mm = float(apart[apart > 0].min(initial=np.inf))
    places = np.stack(np.meshgrid(*nodes), axis=-1).reshape(-1, 2)
    for number, (place, pupil) in enumerate(zip(places, seen, strict=True)):
        checkpoint()
        if pupil is None:
            continue
        try:
            wave = found.wave_at(place, points[number], pupil, nm)
        except InputError:
            continue
        is_wide = wave.spot_mm > _WIDEST_SPOT * nm * 1e-6 / (2 * pupil.index * pupil.aperture)
        if is_wide or cells_for(wave, nm) > MOST_CELLS:
            continue
        waves[number] = wave
        moved = np.clip(2 - float(np.linalg.norm(wave.middle_mm)) / next_mm / _MOST_MOVED, 0.0, 1.0)
        shares[number] = moved * (worth_waves(wave, nm, pixel_mm) > AS_GOOD)
    if not shares.any():
        return None
    by_rows = shares.reshape(len(nodes[1]), len(nodes[0]))
    return replace(found, shares=_between_nodes(by_rows, nodes, found.places))


def _linear(values: Array, x: Array, y: Array) -> Array:
    """Return values of nodes (rows, columns) that are spread from -1 to 1, linear between them."""
    (i, u), (j, v) = (_among(at, count) for at, count in zip((x, y), values.shape[::-1], strict=True))
    low, high = (values[row, i] + u * (values[row, i + 1] - values[row, i]) for row in (j, j + 1))
    return np.asarray(low + v * (high - low))


def _among(places: Array, count: int) -> tuple[NDArray[np.int_], Array]:
    """Return which of so many nodes comes before places, -1 to 1, and the share of the way to the next."""
    at = np.clip((places + 1) / 2, 0.0, 1.0) * (count - 1)
    first = np.minimum(at.astype(int), count - 2)
    return first, at - first


def _between_nodes(values: Array, nodes: tuple[Array, Array], places: Array) -> Array:
    """Return values of nodes (rows, columns) at the places of a table, linear between them."""
    along = np.array([np.interp(places[:ACROSS, 0], nodes[0], row) for row in values])
    return np.array([np.interp(places[::ACROSS, 1], nodes[1], column) for column in along.T]).T


#
# Which places show what is in focus: there waves bring the aberrations of a lens, elsewhere its rays do.
#
# A kernel of waves holds the aberrations for the plane of focus alone. What lies before or behind it is sharper or
# softer than that, as curvature of field and spherical aberration have it, and rays know this.

_SHARP_WAVES, _BLURRED_WAVES = 0.25, 0.5  # out of focus, at the pupil's rim: up to which waves, and from which rays
_STEPS = 16  # of a share, so that rounding on another device changes none


def for_what_is_in_focus(conjugates: Conjugates, session: Session, plan: Plan, buffers: SceneBuffers) -> Conjugates:
    """Return conjugates for places alone that show something in focus, or lie beside such a place."""
    shares = conjugates.shares * _is_sharp(defocus(conjugates, session, plan, buffers))
    return replace(conjugates, shares=shares)


def defocus(conjugates: Conjugates, session: Session, plan: Plan, buffers: SceneBuffers) -> Array:
    """Return how far out of focus is what the places of the table show (n, n) [waves at the rim of the pupil].

    By the first surface that is not polished, as panes and mirrors show it.
    """
    origins, directions = conjugates.chief.smooth(conjugates.places)
    turn = at_opening(conjugates.scene).camera.world_from_camera()[:3, :3].T
    sharp, times = SharpPass(session, plan, buffers), np.zeros(len(origins))
    ends = follow_rays(sharp, plan, origins @ turn, directions @ turn, times)
    z, view = origins[:, 2] + ends.lengths * directions[:, 2], plan.camera.view
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.where(np.isfinite(ends.lengths), 1.0 / np.maximum(view.pupil_z_m - z, 1e-9), 0.0)
    focused = conjugates.vergence / (1.0 + conjugates.vergence * view.pupil_z_m)
    return (0.5 * view.pupil_radius_m**2 / (conjugates.nm * 1e-9) * (seen - focused)).reshape(ACROSS, ACROSS)


def _is_sharp(waves: Array) -> Array:
    """Return the share of each place, by the sharpest of those about it."""
    share = np.clip((_BLURRED_WAVES - np.abs(waves)) / (_BLURRED_WAVES - _SHARP_WAVES), 0.0, 1.0)
    wide = np.pad(np.nan_to_num(share), 1, mode="edge")
    near = [wide[i : i + ACROSS, j : j + ACROSS] for i in range(3) for j in range(3)]
    return np.asarray(np.rint(np.max(near, axis=0) * _STEPS) / _STEPS)


def may_be_stigmatic(plan: Plan) -> bool:
    """Return whether rays of a plan can go towards conjugates."""
    return plan.camera.setting is not None and plan.camera.reach is not None and not plan.steps


def stigmatic(plan: Plan, conjugates: Conjugates | None) -> Plan:
    """Return the plan with rays that go towards the conjugates of their film points; the same where none do."""
    camera = plan.camera
    if conjugates is None or not may_be_stigmatic(plan) or not conjugates.shares.any():
        return plan
    assert camera.reach is not None
    table, record = conjugates.table(), camera.record.copy()
    record["conjugates"] = len(camera.tables)
    new = replace(
        camera,
        record=record,
        facts=camera.facts | {"STIGMATIC": ACROSS},
        tables=np.concatenate([camera.tables, table.ravel()]),
        reach=_reach(camera, camera.reach, conjugates, table),
        shares=conjugates.shares,
    )
    return replace(plan, camera=new)


def conjugates_in(plan: Plan, conjugates: Conjugates | None) -> Conjugates | None:
    """Return conjugates with the shares that a plan of `stigmatic` has; None where its rays go to none."""
    shares = plan.camera.shares
    return None if conjugates is None or shares is None else replace(conjugates, shares=shares)


def _reach(camera: CameraModel, reach: LampReach, conjugates: Conjugates, table: NDArray[np.float32]) -> LampReach:
    """Return how a camera sees points of the scene by the rays to conjugates, to first order in the aberrations."""
    scale = np.array(reach.film_scale)
    mm = float(np.abs(scale).max()) * 1e-4  # over which slopes are taken

    def there(film: Array, entry: Array, z: Array) -> Array:
        """Where the rays of film points (n, 2) [mm] meet planes at z (n,) (n, 2) [m]."""
        point = conjugates.at(conjugates.chief.on_picture(film / scale))
        away = point[:, :3] - point[:, 3:] * entry
        with np.errstate(divide="ignore", invalid="ignore"):  # rays that go to no conjugate
            return np.asarray(entry[:, :2] + away[:, :2] * ((z - entry[:, 2]) / away[:, 2])[:, None])

    def rays(points: Array, across: int, nm: float | None, near: Array) -> Reached:
        seen = reach.rays(points, across, nm, near)
        film, shape = seen.film.copy(), seen.film.shape[:2]
        lit = seen.passed
        if not lit.any():
            return seen
        own = np.broadcast_to(points[:, None], (*shape, 3))[lit]
        entry = np.column_stack([seen.entry[lit], np.full(int(lit.sum()), reach.entry_z_m)])
        here = there(film[lit], entry, own[:, 2])
        (a, c), (b, d) = ((there(film[lit] + move, entry, own[:, 2]) - here).T / mm for move in np.eye(2) * mm)
        x, y = (own[:, :2] - here).T
        share = conjugates.share(conjugates.chief.on_picture(film[lit] / scale))
        off = np.stack([d * x - b * y, a * y - c * x], axis=1) * (share / (a * d - b * c))[:, None]
        film[lit] += np.where(np.isfinite(off), off, 0.0)  # far beside the film no conjugates are known
        return replace(seen, film=film)

    return replace(reach, rays=rays, made_of=(*reach.made_of, "stigmatic", table))
