"""What a lens does to its picture as maps: ST maps, vignetting, and images of points over the field."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_models import (
    BY_ANGLE,
    Calibration,
    CameraView,
    check_distances,
    distance_along,
    normal_points,
)
from rptcam_cl.optics.beams import Beam, film_chief_rays, is_steep, passing_beam, passing_from, takes_steep_light
from rptcam_cl.optics.charts import new_figure, styled
from rptcam_cl.optics.irradiance import film_irradiance
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.ray_trace import Rays
from rptcam_cl.rendering.cameras import kinds, lens_records
from rptcam_cl.rendering.cameras.setting import film_frame
from rptcam_cl.scene.assets.pictures import write_exr

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#
# The way from the picture to directions and back as smooth functions, for maps with a value for every pixel.
#
# A direction is written as its angle from the axis, along its azimuth: two numbers that are smooth functions of the
# place up to and beyond 90 degrees. Polynomials fitted to chief rays say them; at other chief rays their error is
# measured.

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SAMPLES = (45, 33)  # chief rays across and down that a fit goes by
_MARGIN = 0.02  # of the picture's sides that is fitted beyond its edges
DEGREES = (10, 16, 24)  # that are tried
GOOD_PX = 2e-3  # error that is good enough
_NEWTON = 6  # rounds of the way back, which mostly needs one
_EXACT_PX = 1e-4
_CHUNK = 1 << 14
_LEAST = 60  # chief rays below which there is nothing to fit


@dataclass(frozen=True)
class ChebyshevFunction:
    """A smooth function of the plane: Chebyshev polynomials (n, n, outputs) over a box (low, high)."""

    coefficients: Array
    low: Array
    high: Array

    def __call__(self, points: Array) -> Array:
        """Return the values (n, 2) at points (n, 2)."""
        return self._evaluate(self.coefficients, points)

    def slopes(self, points: Array) -> Array:
        """Return the derivatives (n, outputs, 2) at points (n, 2)."""
        scale = 2.0 / (self.high - self.low)
        return np.stack(
            [self._evaluate(chebyshev.chebder(self.coefficients, axis=k) * scale[k], points) for k in (0, 1)], axis=-1
        )

    def _evaluate(self, coefficients: Array, points: Array) -> Array:
        unit = (points - self.low) / (self.high - self.low) * 2.0 - 1.0
        result = np.empty((len(points), coefficients.shape[2]))
        for start in range(0, len(points), _CHUNK):
            part = unit[start : start + _CHUNK]
            across = chebyshev.chebvander(part[:, 0], coefficients.shape[0] - 1)
            down = chebyshev.chebvander(part[:, 1], coefficients.shape[1] - 1)
            for k in range(coefficients.shape[2]):
                result[start : start + _CHUNK, k] = np.sum((across @ coefficients[:, :, k]) * down, axis=1)
        return result


def fitted(points: Array, values: Array, degree: int, low: Array, high: Array) -> ChebyshevFunction:
    """Return the polynomials of a total degree that fit values (n, 2) at points (n, 2) best."""
    unit = (points - low) / (high - low) * 2.0 - 1.0
    across, down = (chebyshev.chebvander(unit[:, k], degree) for k in (0, 1))
    i, j = np.array([(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]).T
    solution = np.linalg.lstsq(across[:, i] * down[:, j], values, rcond=1e-12)[0]
    coefficients = np.zeros((degree + 1, degree + 1, values.shape[1]))
    coefficients[i, j] = solution
    return ChebyshevFunction(coefficients, low, high)


@dataclass(frozen=True)
class SmoothMap:
    """Places of a picture and their directions, both ways.

    Attributes
    ----------
    to_angles, to_places : ChebyshevFunction
    size : tuple of int
        Of the picture [pixels].
    error_px : float
        Largest distance between a place and where the polynomials see its chief ray, at places between those fitted.
    widest : float
        Largest angle from the axis that was fitted [radians].
    """

    to_angles: ChebyshevFunction
    to_places: ChebyshevFunction
    size: tuple[int, int]
    error_px: float
    widest: float

    def places(self, angles: Array) -> tuple[Array, Mask]:
        """Return the places (n, 2) of angles (n, 2), and which of them lie in the picture or just beyond its edges."""
        places = np.full(angles.shape, -1.0)
        inside = np.all((angles >= self.to_places.low) & (angles <= self.to_places.high), axis=1)
        rows = np.flatnonzero(inside & (np.linalg.norm(angles, axis=1) <= self.widest * (1 + _MARGIN)))
        low, high = self.to_angles.low, self.to_angles.high
        at, wanted = np.clip(self.to_places(angles[rows]), low, high), angles[rows]
        left = np.arange(len(rows))
        for _ in range(_NEWTON):
            off = self.to_angles(at[left]) - wanted[left]
            step = np.linalg.solve(self.to_angles.slopes(at[left]), off[..., None])[..., 0]
            at[left] = np.clip(at[left] - step, low, high)
            left = left[np.abs(step).max(axis=1) >= _EXACT_PX]
            if not len(left):
                break
        good = np.ones(len(rows), bool)
        good[left] = False
        places[rows[good]] = at[good]
        known = np.zeros(len(angles), bool)
        known[rows[good]] = True
        return places, known


def smooth_map(view: CameraView) -> SmoothMap:
    """Return the smooth map of a view.

    Raises
    ------
    InputError
        When too little of the picture has light.
    """
    size = np.array(view.size, np.float64)
    low, high = -_MARGIN * size, (1 + _MARGIN) * size
    places, angles = _samples(view, low, high, _SAMPLES)
    if len(places) < _LEAST:
        raise InputError(f"{view.name}: the picture shows nothing to map (allowed: a film inside the image circle)")
    between, seen = _samples(view, low, high, (_SAMPLES[0] - 10, _SAMPLES[1] - 8))
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


def _samples(view: CameraView, low: Array, high: Array, counts: tuple[int, int]) -> tuple[Array, Array]:
    """Return places with light, denser towards the edges, and their angles."""
    x, y = (low[k] + (high[k] - low[k]) * (1 - np.cos(np.linspace(0, np.pi, counts[k]))) / 2 for k in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    directions, lit = view.directions(places)
    return places[lit], normal_points(BY_ANGLE, directions[lit])


#
# ST maps: pictures whose values say where each pixel comes from, as compositors bend pictures with them.
#
# The convention is Nuke's: red is u from the left and green is v from the *bottom* edge, as shares of the picture's
# sides at the centres of pixels, so that an identity map has u = (column + 0.5) / width. Blue is 1 where the map
# holds; where it does not, red and green are -1, which lies outside of every picture.
#
# *Undistort* has a pixel for each of the straight picture, which is larger: it has overscan for all that the lens
# shows. *Distort* is the way back; its values are shares of the straight picture.

Pixels = NDArray[np.float32]

_WIDEST = math.radians(70.0)  # from the axis, up to which a straight picture has a place for what a lens shows
MOST_PIXELS = 200_000_000  # of a straight picture
_EDGE = 257  # places along each edge that say how large the straight picture has to be
_NOWHERE = -1.0


@dataclass(frozen=True)
class StMaps:
    """Both maps and the straight picture between them.

    Attributes
    ----------
    undistort : (rows', columns', 3) array
        Where each pixel of the straight picture lies in the lens's.
    distort : (rows, columns, 3) array
        Where each pixel of the lens's picture lies in the straight one.
    focal_px, centre_px : (x, y)
        The pinhole of the straight picture [pixels from its corner].
    offset_px : (x, y)
        Corner of the lens's picture in the straight one, the principal points on each other.
    error_px : float
        How far the maps are from chief rays at most.
    """

    undistort: Pixels
    distort: Pixels
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    offset_px: tuple[int, int]
    error_px: float


def st_maps(view: CameraView) -> StMaps:
    """Return the maps of a view.

    Raises
    ------
    InputError
        When the picture has no light to speak of, or the straight picture would be huge.
    """
    smooth = smooth_map(view)
    focal, centre = _principal(view)
    low, high = _bounds(smooth, view.size, focal)
    offset = tuple(math.ceil(max(0.0, -(centre[k] + low[k]))) for k in (0, 1))
    size = tuple(offset[k] + max(view.size[k], math.ceil(centre[k] + high[k])) for k in (0, 1))
    if size[0] * size[1] > MOST_PIXELS:
        raise InputError(
            f"{view.name}: a straight picture of it would have {size[0]} x {size[1]} pixels"
            f" (allowed: {MOST_PIXELS} in all; a smaller picture or less field)"
        )
    there = np.array(centre) + offset
    undistort = _map(*_to_lens(smooth, (_centres(size) - there) / focal), size, view.size)
    distort = _map(*_to_straight(smooth, _centres(view.size), focal, there), view.size, size)
    (fx, fy), (cx, cy) = focal.tolist(), there.tolist()
    return StMaps(undistort, distort, (fx, fy), (cx, cy), (offset[0], offset[1]), smooth.error_px)


def _centres(size: tuple[int, ...]) -> Array:
    """Return the centres of all pixels (n, 2), row by row."""
    x, y = (np.arange(count) + 0.5 for count in size)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _map(places: Array, known: Mask, size: tuple[int, ...], of: tuple[int, ...]) -> Pixels:
    """Return a map of some size whose values are places, where known, as shares of a picture of another size."""
    values = np.full((len(places), 3), _NOWHERE, np.float32)
    values[known, 0] = places[known, 0] / of[0]
    values[known, 1] = 1.0 - places[known, 1] / of[1]
    values[:, 2] = known
    return values.reshape(size[1], size[0], 3)


def _to_lens(smooth: SmoothMap, tangents: Array) -> tuple[Array, Mask]:
    length = np.linalg.norm(tangents, axis=1)
    scale = np.arctan(length) / np.maximum(length, 1e-300)
    return smooth.places(tangents * scale[:, None])


def _to_straight(smooth: SmoothMap, places: Array, focal: Array, centre: Array) -> tuple[Array, Mask]:
    tangents, known = _tangents(smooth, places)
    return tangents * focal + centre, known


def _tangents(smooth: SmoothMap, places: Array) -> tuple[Array, Mask]:
    """Return tangents (n, 2) of places along their azimuths, and which of them are shown not too far from the axis."""
    angles = smooth.to_angles(places)
    length = np.linalg.norm(angles, axis=1)
    near = (length <= _WIDEST) & (length <= smooth.widest)
    scale = np.tan(np.minimum(length, _WIDEST)) / np.maximum(length, 1e-300)
    return np.asarray(angles * scale[:, None]), near


def _principal(view: CameraView) -> tuple[Array, Array]:
    """Return the focal lengths of the straight picture, those of the lens on its axis, and where the axis lies."""
    near = view.film_points(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))[:, :2]
    centre = np.linalg.solve((near[1:] - near[0]).T, -near[0])
    step = 1.0
    around = centre + np.array([[step, 0], [-step, 0], [0, step], [0, -step]])
    directions, _ = view.directions(around)
    tangents = directions[:, :2] / directions[:, 2:]
    across, down = tangents[0, 0] - tangents[1, 0], tangents[2, 1] - tangents[3, 1]
    if not (np.isfinite(across) and np.isfinite(down) and across > 0 and down > 0):
        raise InputError(f"{view.name}: no chief ray along its axis, so no straight picture of it")
    return np.array([2 * step / across, 2 * step / down]), centre


def _bounds(smooth: SmoothMap, size: tuple[int, int], focal: Array) -> tuple[Array, Array]:
    """Return the box of the straight picture about its principal point [pixels] that holds all that the lens shows."""
    shares = np.linspace(0.0, 1.0, _EDGE)
    places = np.stack(np.meshgrid(shares * size[0], shares * size[1]), axis=-1).reshape(-1, 2)
    tangents, shown = _tangents(smooth, places)
    seen = tangents[shown] * focal
    return seen.min(axis=0), seen.max(axis=0)


# What a lens does to even light over the picture: its vignetting, and its blur of points at a distance.

_RADII = 25  # from the axis to the farthest pixel, where a round lens is measured first
_ROUNDS = 6  # of halving the way between two of them, where straight lines err
_PLANE_ROUNDS = 1  # the same of nodes
_LINE_ERROR = 2e-3  # of the irradiance there that calls for halving, which takes three quarters of it
_FAINT = 0.05  # of the light on the axis: of less, that share of this counts
_LIT = 0.02  # of the light on the axis: in the dark beyond, a shaped stop is not compared with a round one
NODES = (17, 13)  # across and down, where lenses that are not round are measured, and shaped stops


def vignetting_map(view: CameraView) -> Pixels:
    """Return the irradiance of each pixel under a uniform world, over that of a pixel on the axis (rows, columns).

    By quadrature over the pupil, for the camera's wavelength.

    Raises
    ------
    InputError
        Of a film that is turned; of a lens that lets nothing through to the axis.
    """
    scene = view.scene
    if not view.is_traced:
        return _ideal_falloff(view)
    setting, frame = view.setting, film_frame(scene.camera)
    assert setting is not None
    if not frame.is_flat:
        raise InputError("--vignetting: is known on a film across the axis alone (allowed: no tilt, no swing)")
    lens = lens_records.shaped(scene, setting).lens
    back, wavelength = setting.film_distance_mm, setting.camera.wavelength_nm

    def light(of: Lens, radii: ArrayLike, degrees: float = 0.0) -> Array:
        return film_irradiance(of, back, radii, wavelength, degrees, setting.transmission)

    centre = float(light(lens, 0.0))
    if not centre > 0:
        raise InputError(f"{lens.name}: no light reaches the axis on the film")
    round_lens = lens if lens is setting.lens else lens.with_stop_shape(None)
    if not round_lens.is_rotational:
        values = _over_plane(view, lambda r, degrees: float(light(lens, r, degrees)) / centre)
        return between(values, view.size).astype(np.float32)
    film = view.film_points(_centres(view.size))[:, :2]
    known, values = _along_radius(lambda r: light(round_lens, r), float(np.hypot(*film.T).max()))
    falloff = np.interp(np.sum(film**2, axis=1), known**2, values).reshape(view.size[::-1])
    if round_lens is lens:
        return np.asarray(falloff / centre, np.float32)
    # what the shape of the stop takes is smooth up to the edge of the image circle, where the falloff is not
    last = known[values > _LIT * values[0]].max()

    def share(r: float, degrees: float) -> float:
        r = min(r, last)
        return float(light(lens, r, degrees) / np.interp(r**2, known**2, values))

    return np.asarray(falloff * between(_over_plane(view, share), view.size) / centre, np.float32)


def _over_plane(view: CameraView, value: Callable[[float, float], float]) -> Array:
    """Return values of radius and azimuth at nodes spread evenly over the picture, closer nodes where they bend."""
    known: dict[tuple[float, float], float] = {}

    def fill(nodes: Array, which: Mask) -> None:
        at = [np.linspace(0.0, side, count) for side, count in zip(view.size, nodes.shape[::-1], strict=True)]
        places = np.stack(np.meshgrid(*at), axis=-1)[which]
        points = [(round(float(x), 9), round(float(y), 9)) for x, y in view.film_points(places)[:, :2]]
        for point in points:
            if point not in known:
                known[point] = value(float(np.hypot(*point)), float(np.degrees(np.arctan2(point[1], point[0]))))
        nodes[which] = [known[point] for point in points]

    nodes = np.empty(NODES[::-1])
    fill(nodes, np.ones_like(nodes, bool))
    for _ in range(_PLANE_ROUNDS):
        bend = np.zeros_like(nodes)
        bend[1:-1] = np.abs(np.diff(nodes, 2, axis=0))
        bend[:, 1:-1] = np.maximum(bend[:, 1:-1], np.abs(np.diff(nodes, 2, axis=1)))
        bent = bend > 4 * _LINE_ERROR * np.maximum(np.abs(nodes), _FAINT)  # straight lines err by a quarter at most
        size = (2 * nodes.shape[1] - 1, 2 * nodes.shape[0] - 1)
        near = np.zeros(size[::-1], bool)
        for down, across in np.argwhere(bent):
            near[max(2 * down - 2, 0) : 2 * down + 3, max(2 * across - 2, 0) : 2 * across + 3] = True
        finer = np.empty(near.shape)
        finer[::2, ::2] = nodes
        finer[1::2, ::2] = (nodes[1:] + nodes[:-1]) / 2
        finer[:, 1::2] = (finer[:, 2::2] + finer[:, :-2:2]) / 2
        fill(finer, near)
        nodes = finer
    return nodes


def _along_radius(light: Callable[[Array], Array], farthest: float) -> tuple[Array, Array]:
    """Return radii from the axis and the light there, so close that straight lines over their squares join it."""
    radii = np.linspace(0.0, farthest, _RADII)
    values = light(radii)
    unsure = np.arange(_RADII - 1)  # stretches by the index of their inner end
    for _ in range(_ROUNDS):
        middle = (radii[unsure] + radii[unsure + 1]) / 2
        true = light(middle)
        error = np.abs(true - np.interp(middle**2, radii**2, values))
        bent = error > _LINE_ERROR * np.maximum(true, _FAINT * values[0])
        # a stretch is halved where it bends; its halves lie behind as many new radii as are before them
        at = unsure + 1
        radii, values = np.insert(radii, at, middle), np.insert(values, at, true)
        inner = unsure + np.arange(len(unsure))
        unsure = np.sort(np.concatenate([inner[bent], inner[bent] + 1]))
        if not unsure.size:
            break
    return radii, values


def _ideal_falloff(view: CameraView) -> Pixels:
    """Return 1 everywhere, or of a thick lens the fourth power of the cosine on the film."""
    shape, setting = view.size[::-1], view.setting
    if setting is None:
        return np.ones(shape, np.float32)
    film = view.film_points(_centres(view.size))[:, :2]
    pupil = setting.lens.first_order(setting.camera.wavelength_nm).exit_pupil.distance_mm
    slope = np.sum(film**2, axis=1) / (setting.film_distance_mm - pupil) ** 2  # 0 for a pupil at infinity
    return np.asarray(((1.0 + slope) ** -2).reshape(shape), np.float32)


def coc_map(view: CameraView, distances_m: Sequence[float]) -> Pixels:
    """Return the diameter of the circle of confusion in each pixel [pixels], (distances, rows, columns).

    As the layer `coc` has it, of points at distances along the ray from the front of the camera, infinite for far away.

    Raises
    ------
    InputError
        For no distances, and for one that is not above 0.
    """
    check_distances(distances_m)
    blur = kinds.camera_model(view.scene).view.blur()
    # the table counts along the film, on which a lens turns the picture over
    table = (blur.table[:, ::-1] if view.scene.camera.flip else blur.table[::-1]).astype(np.float64)
    x, y, width, height = view.window
    full = view.scene.film.resolution
    maps = []
    for distance in distances_m:
        away = 1.0 / distance - blur.focus
        a, b, c = (table[..., k] for k in range(3))
        square = between(np.maximum(a + away * (b + away * c), 0.0), full)[y : y + height, x : x + width]
        maps.append(np.sqrt(square) / abs(blur.scale + blur.shift / distance))
    return np.stack(maps).astype(np.float32)


def between(nodes: Array, size: tuple[int, int]) -> Array:
    """Return values at the centres of pixels (rows, columns), between nodes spread evenly from edge to edge."""
    at = [(np.arange(count) + 0.5) / count * (have - 1) for count, have in zip(size, nodes.shape[::-1], strict=True)]
    (left, right), (top, down) = ((np.floor(one).astype(int), one % 1.0) for one in at)
    next_left, next_top = np.minimum(left + 1, nodes.shape[1] - 1), np.minimum(top + 1, nodes.shape[0] - 1)
    upper = nodes[np.ix_(top, left)] * (1 - right) + nodes[np.ix_(top, next_left)] * right
    lower = nodes[np.ix_(next_top, left)] * (1 - right) + nodes[np.ix_(next_top, next_left)] * right
    return np.asarray(upper * (1 - down[:, None]) + lower * down[:, None])


#
# Images of points over the picture as kernels to fold pictures with: for each field, wavelength and distance.
#
# By geometrical optics: rays from a point of the scene, evenly over the entrance of the lens, and the pixels they end
# in. The middle pixel of a kernel is centred on the chief ray of the camera's wavelength, so that coma and lateral
# colour show as centroids beside it.

ACROSS = 96  # rays that span a beam each way
_MOST_PX = 129  # of a kernel's side
_FAR_MM = 1e8


@dataclass(frozen=True)
class PointImages:
    """Kernels over a picture.

    Attributes
    ----------
    kernels : (rows, columns, wavelengths, distances, n, n) array
        Share of the light of a point that each pixel receives; each kernel sums to 1, or to 0 where no light passes.
    centroids : (rows, columns, wavelengths, distances, 2) array
        Centroid of the light, right and down from the chief ray [pixels].
    kept : (rows, columns, wavelengths, distances) array
        Share of the light that falls within the kernel; less than 1 where it is cut off.
    places : (rows, columns, 2) array
        Where the chief rays meet the picture [pixels from its corner].
    wavelengths_nm, distances_m : tuple of float
    """

    kernels: NDArray[np.float32]
    centroids: Array
    kept: Array
    places: Array
    wavelengths_nm: tuple[float, ...]
    distances_m: tuple[float, ...]


def point_images(
    view: CameraView,
    grid: tuple[int, int] = (5, 3),
    wavelengths_nm: Sequence[float] = (),
    distances_m: Sequence[float] = (),
    pixels: int | None = None,
    across: int = ACROSS,
) -> PointImages:
    """Return the images of points seen at the centres of cells (columns, rows) that part the picture.

    Parameters
    ----------
    wavelengths_nm
        That of the camera when empty.
    distances_m
        From the entrance pupil, along the axis or of a sphere as the view has it; that of the view when empty.
    pixels
        Side of a kernel, odd; as large as the light needs when absent, up to `_MOST_PX`.
    across
        Rays that span a beam each way.

    Raises
    ------
    InputError
        Of a camera without a lens to trace; of a field more than 85 degrees from the axis through a first surface that
        is no sphere; of an even side; of a distance that is not above 0.
    """
    if not view.is_traced or view.setting is None:
        raise InputError("--psf-grid: needs a lens to trace (allowed: camera.kind: realistic)")
    if pixels is not None and (pixels < 1 or pixels % 2 == 0):
        raise InputError(f"--psf-pixels: must be odd, so that a pixel lies in the middle (got {pixels})")
    waves = tuple(wavelengths_nm) or (view.setting.camera.wavelength_nm,)
    distances = tuple(distances_m) or (view.distance_m,)
    check_distances(distances)
    x, y = ((np.arange(count) + 0.5) * side / count for count, side in zip(grid, view.size, strict=True))
    places = np.stack(np.meshgrid(x, y), axis=-1)
    shape = (grid[1], grid[0], len(waves), len(distances))
    landed: dict[tuple[int, ...], tuple[Array, Array]] = {}
    sources = _Sources(view, places.reshape(-1, 2))
    for index in np.ndindex(shape):
        cell = index[0] * grid[0] + index[1]
        landed[index] = sources.landed(cell, waves[index[2]], distances[index[3]], across)
    reach = max((float(np.abs(off).max()) for off, _ in landed.values() if len(off)), default=0.0)
    side = pixels or min(2 * math.ceil(reach) + 1, _MOST_PX)
    kernels = np.zeros((*shape, side, side), np.float32)
    centroids, kept = np.full((*shape, 2), np.nan), np.zeros(shape)
    for index, (off, weights) in landed.items():
        if len(off):
            centroids[index] = weights @ off
            kernels[index], kept[index] = _kernel(off, weights, side)
    return PointImages(kernels, centroids, kept, places, waves, distances)


def _kernel(off: Array, weights: Array, side: int) -> tuple[NDArray[np.float32], float]:
    """Return the light of each pixel about the chief ray, and the share that falls into any."""
    half = side / 2
    light, _, _ = np.histogram2d(off[:, 1], off[:, 0], bins=side, range=[[-half, half]] * 2, weights=weights)
    total = float(light.sum())
    return (light / total if total > 0 else light).astype(np.float32), total


class _Sources:
    """Points of the scene on the chief rays of places of a picture."""

    def __init__(self, view: CameraView, places: Array) -> None:
        assert view.setting is not None
        self.view, self.frame = view, film_frame(view.scene.camera)
        self.lens = lens_records.shaped(view.scene, view.setting).lens
        self.film_z = self.lens.film_z(view.setting.film_distance_mm)
        film = view.film_points(places)
        film[:, 2] = self.film_z + self.lens.sense * film[:, 2]
        self.film = film
        self.chief = film_chief_rays(self.lens, film, view.setting.camera.wavelength_nm)
        self.pupil = np.array([0.0, 0.0, self.film_z - view.pupil_ahead_mm])
        self.sphere = replace(view, distance_m=1.0).object_shape == "sphere"

    def landed(self, cell: int, wavelength_nm: float, distance_m: float, across: int) -> tuple[Array, Array]:
        """Return where rays land beside the chief ray, right and down [pixels], and their shares of the light."""
        nothing = np.zeros((0, 2)), np.zeros(0)
        if not self.chief.found[cell]:
            return nothing
        away, distance_mm, origin = self._point(cell, distance_m)
        point = origin + away * distance_mm if math.isfinite(distance_mm) else away
        steep = is_steep(math.degrees(math.atan2(math.hypot(*point[:2]), -point[2])))
        if steep and not takes_steep_light(self.lens):
            raise InputError(
                f"{self.lens.name}: point images more than 85 degrees from the axis need a first surface that is"
                " spherical, bulging to the scene"
            )
        try:
            if steep:
                cosines, rays = passing_from(self.lens, away, distance_mm, origin, wavelength_nm, across)
            else:
                far = -float(point[2]) if math.isfinite(distance_mm) else math.inf
                cosines, rays = self._through_plane(point, far, wavelength_nm, across)
        except InputError:  # nothing of the light comes through
            return nothing
        at = self._on_film(rays.origins, rays.directions)
        off = (at - self.frame.on_film(self.film[cell, None, :2])) * self._pixels_per_mm()
        weights = cosines**4
        return off, weights / weights.sum()

    def _point(self, cell: int, distance_m: float) -> tuple[Array, float, Array]:
        """Return where the point of a chief ray lies: the direction to it and its distance [mm] from an origin."""
        origin, away = self.chief.origins[cell], self.chief.directions[cell]
        if not distance_m * 1e3 < _FAR_MM:
            return away, math.inf, origin
        from_pupil = (origin - self.pupil)[None]
        return away, float(distance_along(from_pupil, away[None], distance_m * 1e3, sphere=self.sphere)[0]), origin

    def _through_plane(self, point: Array, far: float, wavelength_nm: float, across: int) -> tuple[Array, Rays]:
        """Return the cosines of the light's angles from the axis, and the rays, spread over the first vertex plane."""
        tangent = float(np.hypot(*point[:2])) / -float(point[2])
        azimuth = math.degrees(math.atan2(-point[1], -point[0]))
        beam = Beam(math.degrees(math.atan(tangent)), far, azimuth)
        points, rays, _ = passing_beam(self.lens, beam, wavelength_nm, across)
        _, incoming = beam.rays(points)
        return incoming[:, 2] / np.linalg.norm(incoming, axis=1), rays

    def _on_film(self, origins: Array, directions: Array) -> Array:
        """Return where rays meet the film, on it (n, 2) [mm]."""
        sense, centre = self.lens.sense, np.array(self.frame.centre)
        slopes = np.array(self.frame.slopes)
        # z = film_z + sense * slopes . (x, y - centre) on the film
        above = origins[:, 2] - self.film_z - sense * (origins[:, :2] - centre) @ slopes
        step = -above / (directions[:, 2] - sense * directions[:, :2] @ slopes)
        return self.frame.on_film(origins[:, :2] + directions[:, :2] * step[:, None])

    def _pixels_per_mm(self) -> Array:
        """Return pixels to the right and down per millimetre right and up on the film, which a lens inverts."""
        sense = -1.0 if self.view.scene.camera.flip else 1.0
        sides_mm = np.array(self.view.scene.film.size_m()) * 1e3
        return np.asarray(sense * np.array([1.0, -1.0]) * self.view.scene.film.resolution / sides_mm)


# Maps of a lens as files: float32 OpenEXR pictures and NumPy archives, with what they are in their headers.


def st_exr(view: CameraView, maps: StMaps, which: Literal["distort", "undistort"], path: Path) -> None:
    """Write one of the ST maps: channels R and G are u and v, B is 1 where they hold."""
    (fx, fy), (cx, cy) = maps.focal_px, maps.centre_px
    numbers = {
        "straight_size": maps.undistort.shape[1::-1], "picture_size": maps.distort.shape[1::-1],
        "fx": fx, "fy": fy, "cx": cx, "cy": cy, "offset": maps.offset_px, "error_px": maps.error_px,
    }  # fmt: skip
    header = {"stmap": which, "lens": view.name} | {name: json.dumps(value) for name, value in numbers.items()}
    write_exr({"RGB": maps.distort if which == "distort" else maps.undistort}, path, header)


def vignetting_exr(view: CameraView, values: Pixels, path: Path) -> None:
    """Write a vignetting map: channel Y is the light of a pixel over that on the axis."""
    write_exr({"Y": values}, path, {"lens": view.name, "map": "vignetting"})


def coc_exr(view: CameraView, values: Pixels, distances_m: Sequence[float], path: Path) -> None:
    """Write circles of confusion [pixels], a channel `coc.K` for each distance; the header has null for far away."""
    channels = {f"coc.{k}": plane for k, plane in enumerate(values)}
    away = [distance if math.isfinite(distance) else None for distance in distances_m]  # JSON has no infinity
    header = {"lens": view.name, "map": "circle of confusion [px]", "distances_m": json.dumps(away)}
    write_exr(channels, path, header)


def psf_npz(images: PointImages) -> bytes:
    """Return point images as a NumPy archive."""
    out = io.BytesIO()
    np.savez_compressed(
        out, kernels=images.kernels, centroids_px=images.centroids, kept=images.kept, places_px=images.places,
        wavelengths_nm=images.wavelengths_nm, distances_m=images.distances_m,
    )  # fmt: skip
    return out.getvalue()


# How a camera model errs over the picture, as a chart.

WIDTH = 8.0  # of the plot [inches]
_EVERY = 3  # cells between arrows


@styled()
def residual_chart(view: CameraView, calibration: Calibration) -> Figure:
    """Return the errors of a camera model over the picture: their size as a map, and arrows along them."""
    columns, rows = view.size
    figure = new_figure(
        f"{view.name}: {calibration.model} against chief rays, rms {calibration.rms_px:.2g} px,"
        f" at most {calibration.max_px:.2g} px",
        (WIDTH, 1.0 + (WIDTH - 1.4) * rows / columns),
    )
    axes = figure.add_subplot()
    length = np.linalg.norm(calibration.errors, axis=-1)
    down, across = length.shape
    x, y = np.meshgrid(np.linspace(0, columns, across), np.linspace(0, rows, down))
    left, top = x[0, 1] / 2, y[1, 0] / 2  # half of what a place at the edge stands for lies beside the picture
    around = (-left, columns + left, rows + top, -top)
    shown = axes.imshow(length, cmap="viridis", extent=around, vmin=0.0, aspect="equal")
    axes.set(xlabel="column [px]", ylabel="row [px]", xlim=(0, columns), ylim=(rows, 0))
    axes.grid(visible=False)
    part = np.s_[_EVERY // 2 :: _EVERY, _EVERY // 2 :: _EVERY]
    if calibration.max_px > 0:
        errors = calibration.errors[part] / calibration.max_px
        axes.quiver(
            x[part], y[part], errors[..., 0], -errors[..., 1], color="white", scale=18, width=0.003, pivot="middle"
        )
    figure.colorbar(shown, ax=axes, label="error [px]", shrink=0.85)
    return figure
