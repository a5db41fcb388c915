"""Diffraction of a rendered film: whether it shows, and the film with it.

The rays have brought the geometrical image, defocus and aberrations included. The film receives its convolution with
what the opening, as that part of the film sees it, makes of a point by a perfect wavefront; small lamps are imaged by
waves alone. docs/diffraction.md says why, and how far that is from the full wave image.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import EmitterKind, Hidden
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.rendering.cameras.chief_rays import seen_places
from rptcam_cl.rendering.cameras.film_pupil import FilmPupil, FilmPupils
from rptcam_cl.rendering.cameras.ideal import dirt_edges, edges_of
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.setting import film_frame
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.lamps import lattice, patches_of
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.point_spread import (
    ANGLES,
    FEW_ANGLES,
    FINE,
    MIDDLE_NM,
    NEAR,
    REACH,
    WAVES_NM,
    FarLight,
    PointWave,
    fade,
    near_kernel,
    point_opening,
    point_wave,
    quick,
    ray_picture,
    reach_px,
    received,
    shares_of_white,
    strew,
    unit_px,
    wave_picture,
)
from rptcam_cl.scene.load import at_opening
from rptcam_cl.scene.scene import Scene

#
# A picture blurred by a kernel that varies over it: each pixel spreads its light by the kernels of the nearest nodes.
#
# Nodes lie on a grid over the whole film. A pixel's kernel is that of the four about it, weighted linearly, and the
# weights sum to 1. What leaves the picture is lost. What lies beside it is not known; it is taken to be as bright as
# the border, lamps apart.

Array = NDArray[np.float64]


def blur(
    planes: Array, lamps: Array, offset: tuple[int, int], nodes: tuple[Array, Array], kernels: Sequence[Array | None]
) -> Array:
    """Return planes (3, height, width) after each pixel has spread its light.

    Parameters
    ----------
    planes
        In float64, with any dynamic range.
    lamps
        What of them does not go on beside the picture.
    offset
        Column and row of the first pixel on the whole film.
    nodes
        Columns and rows of the nodes on the whole film, rising.
    kernels
        One (3, k, k) for each node, by rows; k is odd, and may differ. None spreads nothing.
    """
    reach = max((part.shape[-1] // 2 for part in kernels if part is not None), default=0)
    margin = ((0, 0), (reach, reach), (reach, reach))
    source = np.pad(planes - lamps, margin, mode="edge") + np.pad(lamps, margin)
    out = np.zeros((3, source.shape[1] + 2 * reach, source.shape[2] + 2 * reach))
    weights = [_hats(axis, start - reach + np.arange(length)) for axis, start, length in
               zip(nodes, offset, source.shape[:0:-1], strict=True)]  # fmt: skip
    for (row, column), kernel in zip(_places(nodes), kernels, strict=True):
        columns, rows = np.flatnonzero(weights[0][column]), np.flatnonzero(weights[1][row])
        if kernel is None or not len(columns) or not len(rows):
            continue
        left, right, top, bottom = columns[0], columns[-1] + 1, rows[0], rows[-1] + 1
        share, own = weights[1][row, top:bottom, None] * weights[0][column, left:right], kernel.shape[-1] // 2
        for plane, part, target in zip(source, kernel, out, strict=True):
            checkpoint()
            spread = _convolve(plane[top:bottom, left:right] * share, part)
            target[reach - own + top : reach + own + bottom, reach - own + left : reach + own + right] += spread
    return out[:, 2 * reach : 2 * reach + planes.shape[1], 2 * reach : 2 * reach + planes.shape[2]]


def _places(nodes: tuple[Array, Array]) -> Iterator[tuple[int, int]]:
    for row in range(len(nodes[1])):
        for column in range(len(nodes[0])):
            yield row, column


def _hats(nodes: Array, places: Array) -> Array:
    """Return the weight of each node at each place, (nodes, places); they sum to 1."""
    if len(nodes) == 1:
        return np.ones((1, len(places)))
    return np.array([np.interp(places, nodes, unit) for unit in np.eye(len(nodes))])


def _convolve(plane: Array, kernel: Array) -> Array:
    """Return the full convolution; of what is nowhere negative, nothing is negative."""
    shape = tuple(quick(a + b - 1) for a, b in zip(plane.shape, kernel.shape, strict=True))
    product = np.fft.rfft2(plane, shape) * np.fft.rfft2(kernel, shape)
    height, width = (a + b - 1 for a, b in zip(plane.shape, kernel.shape, strict=True))
    spread = np.fft.irfft2(product, shape)[:height, :width]
    return np.maximum(spread, 0.0) if plane.min() >= 0 and kernel.min() >= 0 else spread


#
# Lamps in a picture as waves image them: rings and spikes of light out of focus, in place of what rays bring.
#
# What a lamp's film shows by rays is measured in the film itself, so that whatever hides or dims a lamp counts; the
# picture by waves of as much light takes its place.

MOST_LAMPS = 64
_LAMP_POINTS = 16  # of each patch of a lamp
_WIDEST_PX = 64.0  # sharp image of a lamp that is treated as one
_LARGEST_PX = 256  # half width of a picture of a lamp
BEYOND = 1.8  # radii of the rays that it reaches, and as far as the kernel of a sharp point
MOST_ACROSS = 512  # points across a picture by waves: of finer ones, pixels show what rays do
_RAYS_FINER = 4  # points across a pixel for the picture by rays
_FEW_WAVES_PX = 0.25  # wavelength times f-number, below which a third of the wavelengths say what a pixel shows
_SHOWS = 0.01  # of its light by which waves must differ from rays
UNLIKE = 0.3  # of the light of a lamp by which its film may differ from its rays, in parts of its picture
PARTS = 3  # of its picture each way


@dataclass(frozen=True)
class LampImage:
    """The picture of a lamp of light 1, about pixels of the whole film.

    Attributes
    ----------
    column, row : int
        Of its first pixel.
    waves, rays : (3, height, width) arrays
        Of red, green and blue; by waves, near the lamp and without its far light.
    place : (x, y)
        Of its middle [pixels].
    radius : float
        Of its farthest ray [pixels].
    """

    column: int
    row: int
    waves: NDArray[np.float32]
    rays: NDArray[np.float32]
    place: tuple[float, float]
    radius: float

    @property
    def reach(self) -> int:
        """From its middle to where it ends [pixels]."""
        return int(self.waves.shape[2] // 2)


@dataclass(frozen=True)
class _LampFilm:
    """The film on which lamps are imaged.

    Attributes
    ----------
    pupils : FilmPupils
    seen : sequence of (point, FilmPupil)
        Points of the film [mm], and the openings that they see.
    pixel_mm : tuple of float
        Width and height of a pixel; negative where columns or rows run against x or y.
    splits : bool
        Whether rays of the film have a wavelength each, that the lens refracts by.
    nm : float
        Of the others.
    units : float
        Wavelengths over twice the numerical aperture that the kernel of a sharp point reaches.
    """

    pupils: FilmPupils
    seen: Sequence[tuple[Array, FilmPupil]]
    pixel_mm: tuple[float, float]
    splits: bool
    nm: float
    units: float


def _lamp_images(
    scene: Scene, plan: Plan, pupils: FilmPupils, seen: Sequence[tuple[Array, FilmPupil]], units: float
) -> list[LampImage]:
    """Return the pictures of lamps on the film that waves change, near them as far as a kernel reaches."""
    scene, lamps = at_opening(scene), list(_lamps(plan))
    if not lamps:
        return []
    camera, lens, (width, height) = camera_of(scene), scene.camera.lens_camera, _pixel_mm(scene)
    film_z = 0.0 if (setting := camera.setting) is None else setting.lens.film_z(setting.film_distance_mm)
    sense, splits = -1.0 if scene.camera.flip else 1.0, bool(plan.facts.get("LENS_SPLITS"))
    nm = MIDDLE_NM if lens is None else lens.wavelength_nm
    film = _LampFilm(pupils, seen, (sense * width, -sense * height), splits, nm, units)
    points, turn = np.concatenate(lamps), scene.camera.world_from_camera()[:3, :3]
    there = np.column_stack([points[:, :3] @ turn, points[:, 3]])
    counts, chief = [len(lamp) for lamp in lamps], camera.chief_rays()
    every = np.split(there, np.cumsum(counts)[:-1])
    middles = seen_places(chief, np.array([own.mean(axis=0) for own in every]))
    all_places = seen_places(chief, there, np.repeat(middles, counts, axis=0))
    images = []
    for own, places in zip(every, np.split(all_places, np.cumsum(counts)[:-1]), strict=True):
        checkpoint()
        middle = places.mean(axis=0)
        if not np.isfinite(places).all() or np.ptp(places, axis=0).max() > _WIDEST_PX:
            continue
        if ((middle > -0.5) & (middle < np.array(scene.film.resolution) + 0.5)).all():
            point = _film_point(scene, middle[0] - 0.5, middle[1] - 0.5)
            images.append(_image(film, places, point, _source(own.mean(axis=0), film_z)))
    return [image for image in images if image is not None]


def _source(point: Array, film_z: float) -> Array:
    """Return a point of the scene, homogeneous and in the frame of the camera [m], in that of the lens [mm]."""
    length = float(np.linalg.norm(point[:3]))
    there = point[:3] * min(FARTHEST_M / length, 1.0 if point[3] else np.inf)
    return np.asarray(1e3 * there + [0.0, 0.0, film_z])


def _lamps(plan: Plan) -> Iterator[Array]:
    """Yield points (n, 4) of each lamp that the camera may see, about the eye, homogeneous [m]; brightest first."""
    records = plan.emitters.shining
    bright = np.argsort([-float(max(record["radiance"][:3])) for record in records], kind="stable")
    left = MOST_LAMPS
    for record in (records[k] for k in bright):
        kind = EmitterKind(int(record["kind"]))
        if record["hidden"] & Hidden.FROM_CAMERA or kind in (
            EmitterKind.POINT, EmitterKind.SPOT, EmitterKind.ENVIRONMENT, EmitterKind.DIRECTIONAL, EmitterKind.TRIANGLE,
        ):  # fmt: skip
            continue
        known = patches_of(record, np.zeros(3))
        if known is None or left == 0:
            continue
        left -= 1
        (at, light, _), patches = known
        s, t = lattice(_LAMP_POINTS)
        points = np.concatenate(
            [patches.at(np.full(len(at), x), np.full(len(at), y)) for x, y in zip(s, t, strict=True)]
        )
        if light.any():
            yield np.column_stack([points, np.tile(at[:, 3], _LAMP_POINTS)])


def _image(film: _LampFilm, places: Array, point: Array, source: Array) -> LampImage | None:
    """Return the picture of a lamp by the places of its points; None where waves do not change it, or are not known."""
    middle, pixel = places.mean(axis=0), float(np.sqrt(abs(film.pixel_mm[0] * film.pixel_mm[1])))
    try:
        near = min(film.seen, key=lambda known: float(np.linalg.norm(known[0] - point)))
        opening = point_opening(film.pupils, near, point, source, film.nm)
        unit = 550e-6 / opening.index / (2 * opening.aperture) / pixel
        radius = opening.radius_mm / pixel
        wide = max(BEYOND * radius + film.units * unit, 2.0) + np.ptp(places, axis=0).max() / 2
        reach = min(int(np.ceil(wide)), _LARGEST_PX)
        if (2 * reach + 1) * _finer(unit, 550.0) > MOST_ACROSS:
            return None
        wave = opening.wave(min(reach / unit, 160.0))
        waves_nm = WAVES_NM if unit > _FEW_WAVES_PX else WAVES_NM[1::3]
        split = [point_wave(film.pupils, wave.pupil, point, source, nm) for nm in (waves_nm if film.splits else ())]
    except InputError:
        return None
    first = np.floor(middle).astype(int) - reach
    sharp = _sharp(places - first, 2 * reach + 1)
    waves, rays = (np.zeros((3, 2 * reach + 1, 2 * reach + 1)) for _ in range(2))
    offsets = np.arange(2 * reach + 1) + 0.5 - (middle - first)[:, None]
    for k, (nm, share) in enumerate(zip(waves_nm, shares_of_white(waves_nm)[:, :, None, None], strict=True)):
        checkpoint()
        own = split[k] if film.splits else wave
        waves += share * _wave_pixels(own, nm, film.pixel_mm, offsets, unit)
        if film.splits:
            rays += share * _ray_pixels(own, film.pixel_mm, offsets)
    if not film.splits:
        rays += _ray_pixels(wave, film.pixel_mm, offsets)
    away = np.hypot(offsets[0][None, :], offsets[1][:, None])
    waves, rays = _spread(waves, sharp, middle - first) * fade(away, reach), _spread(rays, sharp, middle - first)
    if not np.abs(waves - rays).sum() > _SHOWS * rays.sum():
        return None
    x, y = middle.tolist()
    return LampImage(int(first[0]), int(first[1]), waves.astype(np.float32), rays.astype(np.float32), (x, y), radius)


def _sharp(places: Array, size: int) -> Array:
    """Return the shares of points in the four pixels about each, of a square of pixels."""
    square = np.zeros((size, size))
    x, y = (places - 0.5).T
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    for column, by_column in ((i, 1 - x + i), (i + 1, x - i)):
        for row, by_row in ((j, 1 - y + j), (j + 1, y - j)):
            good = (column >= 0) & (column < size) & (row >= 0) & (row < size)
            np.add.at(square, (row[good], column[good]), (by_column * by_row)[good] / len(places))
    return square


def _spread(picture: Array, sharp: Array, middle: Array) -> Array:
    """Return the picture of a point in the middle (3, n, n) for all points of a lamp."""
    size = len(sharp)
    alone = np.zeros_like(sharp)
    for column, row, share in _about((middle[0], middle[1])):
        alone[row, column] += share
    if np.abs(sharp - alone).sum() < 0.02:
        return picture
    side = quick(2 * size)
    rows, columns = np.indices((size, size))
    mean = [int(np.rint((sharp * axis).sum())) for axis in (rows, columns)]
    whole = np.fft.rfft2(picture, (side, side)) * np.fft.rfft2(sharp, (side, side))
    full = np.fft.irfft2(whole, (side, side))
    return np.asarray(full[:, mean[0] : mean[0] + size, mean[1] : mean[1] + size])


def _finer(unit: float, nm: float) -> int:
    """Return into how many points a pixel is divided, by the wavelength over twice the aperture at 550 nm [pixels]."""
    return max(int(np.ceil(FINE / unit * 550.0 / nm)), 1)


def _wave_pixels(wave: PointWave, nm: float, pixel_mm: tuple[float, float], offsets: Array, unit: float) -> Array:
    """Return the light of each pixel, of 1 altogether."""
    finer = _finer(unit, nm)
    within = (np.arange(finer) + 0.5) / finer - 0.5
    x, y = ((part[:, None] + within).ravel() * side for part, side in zip(offsets, pixel_mm, strict=True))
    light = wave_picture(wave, nm, x, y) * abs(pixel_mm[0] * pixel_mm[1]) / finer**2
    size = offsets.shape[1]
    return np.asarray(light.reshape(size, finer, size, finer).sum(axis=(1, 3)))


def _ray_pixels(wave: PointWave, pixel_mm: tuple[float, float], offsets: Array) -> Array:
    within = (np.arange(_RAYS_FINER) + 0.5) / _RAYS_FINER - 0.5
    x, y = ((part[:, None] + within).ravel() * side for part, side in zip(offsets, pixel_mm, strict=True))
    size = offsets.shape[1]
    return np.asarray(ray_picture(wave, x, y).reshape(size, _RAYS_FINER, size, _RAYS_FINER).sum(axis=(1, 3)))


#
# How bright each lamp is on a film.


def brightness(planes: Array, offset: tuple[int, int], lamps: Sequence[LampImage]) -> Array:
    """Return the light of lamps (n, 3) on planes (3, height, width) of a film; 0 of those that it shows otherwise.

    By least squares of the rays' pictures, about the mean of each picture's square, so that even light about a lamp
    does not count. A lamp that something hides in part is not like its rays.
    """
    places = [_on_film(planes.shape[1:], offset, lamp) for lamp in lamps]
    good = [k for k, (film, _) in enumerate(places) if all(side.stop > side.start for side in film)]
    while good:
        light = _fitted(planes, [(lamps[k], *places[k]) for k in good])
        left = planes - _together(planes.shape, [(lamps[k], *places[k]) for k in good], light)
        fine = [_is_like(left, *places[k], lamps[k], own) for k, own in zip(good, light, strict=True)]
        if all(fine):
            found = np.zeros((len(lamps), 3))
            found[good] = light
            return found
        good = [k for k, is_fine in zip(good, fine, strict=True) if is_fine]
    return np.zeros((len(lamps), 3))


Window = tuple[slice, slice]


def _on_film(shape: tuple[int, ...], offset: tuple[int, int], lamp: LampImage) -> tuple[Window, Window]:
    """Return which rows and columns of a film a lamp's picture covers, and which of its own these are."""
    film, own = [], []
    for first, size, length in zip(
        (lamp.row - offset[1], lamp.column - offset[0]), lamp.rays.shape[1:], shape, strict=True
    ):
        low, high = max(first, 0), min(first + size, length)
        film.append(slice(low, max(high, low)))
        own.append(slice(low - first, max(high, low) - first))
    return (film[0], film[1]), (own[0], own[1])


Placed = tuple[LampImage, Window, Window]


def _fitted(planes: Array, placed: Sequence[Placed]) -> Array:
    light = np.zeros((len(placed), 3))
    for channel in range(3):
        own = [lamp.rays[channel][part].astype(np.float64) for lamp, _, part in placed]
        tests = [rays - rays.mean() for rays in own]
        matrix, right = np.zeros((len(placed), len(placed))), np.zeros(len(placed))
        for k, (_, film, _) in enumerate(placed):
            right[k] = float(np.sum(tests[k] * planes[channel][film]))
            for m, (_, other, _) in enumerate(placed):
                low = [max(a.start, b.start) for a, b in zip(film, other, strict=True)]
                high = [min(a.stop, b.stop) for a, b in zip(film, other, strict=True)]
                if all(a < b for a, b in zip(low, high, strict=True)):
                    first = tuple(slice(a - c.start, b - c.start) for a, b, c in zip(low, high, film, strict=True))
                    second = tuple(slice(a - c.start, b - c.start) for a, b, c in zip(low, high, other, strict=True))
                    matrix[k, m] = float(np.sum(tests[k][first] * own[m][second]))
        light[:, channel] = np.linalg.lstsq(matrix, right, rcond=1e-9)[0]
    return np.maximum(light, 0.0)


def _is_like(left: Array, film: Window, part: Window, lamp: LampImage, light: Array) -> bool:
    """Return whether what is left of a film without a lamp is even, in parts of the lamp's picture."""
    whole = float(light.sum())
    if not whole > 0:
        return False
    rest, rays = left[:, film[0], film[1]].sum(axis=0), lamp.rays[:, part[0], part[1]].sum(axis=0)
    dark = rays <= 1e-3 * rays.max()
    rest = rest - (rest[dark].mean() if dark.any() else 0.0)
    lit = np.argwhere(~dark)
    low, high = lit.min(axis=0), lit.max(axis=0) + 1
    rows, columns = (np.linspace(low[k], high[k], PARTS + 1).astype(int) for k in (0, 1))
    off = sum(
        abs(float(rest[a:b, c:d].sum())) for a, b in itertools.pairwise(rows) for c, d in itertools.pairwise(columns)
    )
    return off < UNLIKE * whole * float(rays.sum()) / 3


def _together(shape: tuple[int, ...], placed: Sequence[Placed], light: Array) -> Array:
    """Return the film of lamps by their rays."""
    planes = np.zeros(shape)
    for (lamp, film, part), own in zip(placed, light, strict=True):
        planes[:, film[0], film[1]] += own[:, None, None] * lamp.rays[:, part[0], part[1]]
    return planes


def without_lamps(planes: Array, offset: tuple[int, int], lamps: Sequence[LampImage], light: Array) -> Array:
    """Return planes (3, height, width) of a film without lamps of some light (n, 3), as their rays show them.

    What is left there is noise of the lamp and what stands about it; it is kept between none and the brightest pixel
    beside the lamp.
    """
    placed = [
        (lamp, *_on_film(planes.shape[1:], offset, lamp)) for lamp, own in zip(lamps, light, strict=True) if own.any()
    ]
    left = planes - _together(planes.shape, placed, light[light.any(axis=1)])
    lit = np.zeros(planes.shape[1:], np.bool_)
    for lamp, film, part in placed:
        lit[film] |= _lit(lamp, part)
    for lamp, film, part in placed:
        inside, dark = _lit(lamp, part), ~lit[film]
        for plane in left:
            window = plane[film]
            window[inside] = np.clip(window[inside], 0.0, window[dark].max() if dark.any() else np.inf)
    return left


def _lit(lamp: LampImage, part: Window) -> NDArray[np.bool_]:
    return np.asarray(lamp.rays[:, part[0], part[1]].sum(axis=0) > 1e-6 * lamp.rays.max())


def _by_waves(shape: tuple[int, ...], offset: tuple[int, int], lamps: Sequence[LampImage], light: Array) -> Array:
    """Return planes of the same by waves, without their far light."""
    planes = np.zeros(shape)
    for lamp, own in zip(lamps, light, strict=True):
        film, part = _on_film(shape[1:], offset, lamp)
        planes[:, film[0], film[1]] += own[:, None, None] * lamp.waves[:, part[0], part[1]]
    return planes


#
# The film with what its openings make of it.

_FINEST_PX = 0.03  # wavelength times f-number, below which no ring of a lamp shows
FARTHEST_M = 1e5  # of a lamp, beyond which focus is as at infinity
AIRY = 1.2196698912665045  # radius of the first dark ring, in wavelength times f-number
SHOWS_PX = 0.5  # Airy radius from which `auto` takes it: as much as `camera.accuracy: auto` lets light stray
LAMP = 16.0  # times the mean of the film, from which a pixel counts as a lamp
_WIDE_PX = 2.0  # length of a lamp's straight edges, from which its far light is as wide as they are
NODES = (5, 3)  # along the longer and the shorter side of the film
_NODE_PX = 16  # least distance between nodes


def lamps_of(planes: Array) -> Array:
    """Return planes (3, height, width) of the pixels alone that outshine the mean of their film."""
    brightness = planes.max(axis=0)
    return np.asarray(planes * (brightness > LAMP * brightness.mean()))


@dataclass(frozen=True)
class FilmSpread:
    """What the openings that the film sees make of its light.

    Attributes
    ----------
    resolution : tuple of int
        Columns and rows of the whole film.
    pixel_mm : tuple of float
        Width and height of a pixel.
    pupils : tuple of FilmPupil
        The opening that each node sees, by rows of nodes.
    edges : (n, 4) array or None
        Of the opening that the film's middle sees, with its dirt, as `FarLight` has them; None where they are unknown.
    lamps : tuple of LampImage
        Those whose pictures by waves take the place of those by rays.
    directions : int
        Of far light.
    """

    resolution: tuple[int, int]
    pixel_mm: tuple[float, float]
    pupils: tuple[FilmPupil, ...]
    edges: Array | None = None
    lamps: tuple[LampImage, ...] = ()
    directions: int = ANGLES

    @cached_property
    def reach(self) -> int:
        """Of the kernels [pixels]."""
        unit = max(unit_px(pupil, self.pixel_mm) for pupil in self.pupils)
        return reach_px(unit, max(self.resolution), REACH if self.edges is None else NEAR)

    @cached_property
    def kernels(self) -> tuple[tuple[Array, Array], list[Array]]:
        """Columns and rows of the nodes on the whole film, and the kernel of each, with the light that is not far."""
        own = [near_kernel(pupil, self.pixel_mm, self.reach)[:, :, ::-1] for pupil in self.pupils]  # x runs to the left
        if self.edges is not None:
            own = [part * (1 - self.far[0])[:, None, None] for part in own]
        return _nodes(self.resolution), own

    @cached_property
    def _far_light(self) -> FarLight:
        assert self.edges is not None
        index = self.pupils[len(self.pupils) // 2].index
        return FarLight(self.edges, index, self.pixel_mm, self.reach, self.directions)

    @cached_property
    def _of_plain_films(self) -> FilmSpread:
        """The same for films without lamps, which show no spikes."""
        return replace(self, directions=FEW_ANGLES)

    @cached_property
    def far(self) -> tuple[Array, Array]:
        """Share of the far light of red, green and blue, and its kernel over twice the whole film."""
        return self._far_light.shares, self._far_light.kernel(*self.resolution)[:, :, ::-1]

    def over(self, pixels: NDArray[np.float32], layout: FilmLayout) -> NDArray[np.float32]:
        """Return a film (height, width, 3) of linear RGB with its light spread."""
        planes, offset = np.moveaxis(pixels.astype(np.float64), -1, 0), (layout.x, layout.y)
        bright, by_lamps = lamps_of(planes), brightness(planes, offset, self.lamps)
        if self.edges is not None and self.directions > FEW_ANGLES and not (bright.any() or by_lamps.any()):
            return self._of_plain_films.over(pixels, layout)
        if by_lamps.any():
            planes = without_lamps(planes, offset, self.lamps, by_lamps)
            bright = np.where(bright > 0, planes, 0.0)
        nodes, kernels = self.kernels
        spread = blur(planes, bright, offset, nodes, kernels)
        if self.edges is not None:
            shares, light = self.far
            spread += strew(planes + self._at_lamps(planes.shape, offset, by_lamps), light)
            beside = shares[:, None, None] - received(light, planes.shape[1:])
            spread += beside * (planes - bright).mean(axis=(1, 2))[:, None, None]  # as bright beside the film as on it
        if by_lamps.any():
            spread += _by_waves(planes.shape, offset, self._near_lamps, by_lamps)
            for number in self._wide:
                spread += by_lamps[number][:, None, None] * self._star(number, layout)
            spread = np.maximum(spread, 0.0) if pixels.min(initial=0.0) >= 0 else spread
        return np.ascontiguousarray(np.moveaxis(spread, 0, -1), dtype=np.float32)

    @cached_property
    def _near_lamps(self) -> list[LampImage]:
        """The pictures of lamps, of what their far light lacks beside them."""
        if self.edges is None:
            return [replace(lamp, waves=lamp.waves / lamp.waves.sum(axis=(1, 2))[:, None, None]) for lamp in self.lamps]
        near = []
        for number, lamp in enumerate(self.lamps):
            if number in self._wide:
                near.append(lamp)
                continue
            inner: Array = np.zeros(lamp.waves.shape)
            rows, columns = np.arange(lamp.waves.shape[1]), np.arange(lamp.waves.shape[2])
            x, y = columns + lamp.column + 0.5 - lamp.place[0], rows + lamp.row + 0.5 - lamp.place[1]
            light = self.far[1]
            middle = light.shape[1] // 2, light.shape[2] // 2
            for column, row, share in _about(lamp.place):
                i, j = rows + lamp.row - row + middle[0], columns + lamp.column - column + middle[1]
                good = np.ix_((i >= 0) & (i < light.shape[1]), (j >= 0) & (j < light.shape[2]))
                inner[:, good[0], good[1]] += share * light[:, i[good[0]], j[good[1]]]
            inner *= fade(np.hypot(x[None, :], y[:, None]), lamp.reach)
            near.append(replace(lamp, waves=(lamp.waves - inner).astype(np.float32)))
        return near

    @cached_property
    def _wide(self) -> dict[int, float]:
        """Of lamps whose straight edges show out of focus, the length of the longest [pixels]."""
        if self.edges is None:
            return {}
        edges = {k: self._far_light.straightest * 2 * lamp.radius for k, lamp in enumerate(self.lamps)}
        return {k: edge for k, edge in edges.items() if edge > _WIDE_PX}

    def _star(self, number: int, layout: FilmLayout) -> Array:
        """Return the far light (3, height, width) of a wide lamp of light 1: that of each edge is as wide as it is."""
        lamp, edge = self.lamps[number], self._wide[number]
        columns = np.arange(layout.x + 0.5, layout.x + layout.width)
        rows = np.arange(layout.y + 0.5, layout.y + layout.height)
        some_columns, some_rows = (_sampled(axis, int(edge / 16)) for axis in (columns, rows))
        out = float(np.sqrt(max(lamp.radius**2 - edge**2 / 4, 0.0)))
        table = self._far_light.table(float(np.hypot(*self.resolution)), edge, out)
        few = self._far_light.at(table, lamp.place[0] - some_columns, some_rows - lamp.place[1])  # x runs to the left
        light = np.asarray(_hats(some_rows, rows).T @ few @ _hats(some_columns, columns))
        away = np.hypot(columns - lamp.place[0], rows[:, None] - lamp.place[1])
        return np.asarray(light * (1 - fade(away, lamp.reach)))

    def _at_lamps(self, shape: tuple[int, ...], offset: tuple[int, int], light: Array) -> Array:
        """Return planes with the light of lamps (n, 3) in the pixels about the middle of each."""
        planes = np.zeros(shape)
        for number, (lamp, own) in enumerate(zip(self.lamps, light, strict=True)):
            for column, row, share in () if number in self._wide else _about(lamp.place):
                column, row = column - offset[0], row - offset[1]
                if 0 <= column < shape[2] and 0 <= row < shape[1]:
                    planes[:, row, column] += share * own
        return planes

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that `spread_of` reads; shares of coverage are sixteenths, which float32 holds."""
        arrays: dict[str, NDArray[Any]] = {
            "diffraction_pixel_mm": np.array(self.pixel_mm),
            "diffraction_coverage": np.array([pupil.coverage for pupil in self.pupils], np.float32),
            "diffraction_cosines": np.array([[pupil.cosines_x, pupil.cosines_y] for pupil in self.pupils]),
            "diffraction_index": np.array([pupil.index for pupil in self.pupils]),
            "diffraction_edges": np.zeros((0, 4)) if self.edges is None else self.edges,
        }
        for number, lamp in enumerate(self.lamps):
            arrays[f"diffraction_lamp_{number}"] = np.stack([lamp.waves, lamp.rays])
            arrays[f"diffraction_place_{number}"] = np.array([lamp.column, lamp.row, *lamp.place, lamp.radius])
        return arrays


def spread_of(arrays: Mapping[str, NDArray[Any]], resolution: tuple[int, int]) -> FilmSpread | None:
    """Read the arrays of `FilmSpread.arrays`; None where there are none.

    Raises
    ------
    ValueError, KeyError
        They do not fit together.
    """
    if "diffraction_index" not in arrays:
        return None
    nodes = [len(axis) for axis in _nodes(resolution)]
    width, height = arrays["diffraction_pixel_mm"].tolist()
    coverage, cosines = arrays["diffraction_coverage"], arrays["diffraction_cosines"]
    count, cells = nodes[0] * nodes[1], cosines.shape[-1]
    if not min(width, height) > 0 or coverage.shape != (count, cells, cells) or cosines.shape != (count, 2, cells):
        raise ValueError("diffraction")
    pupils = tuple(
        FilmPupil(cover.astype(np.float64), x, y, float(index))
        for cover, (x, y), index in zip(coverage, cosines, arrays["diffraction_index"], strict=True)
    )
    edges = arrays["diffraction_edges"]
    if edges.ndim != 2 or edges.shape[1] != 4 or not np.isfinite(edges).all():
        raise ValueError("diffraction")
    lamps, number = [], 0
    while f"diffraction_lamp_{number}" in arrays:
        (waves, rays), place = arrays[f"diffraction_lamp_{number}"], arrays[f"diffraction_place_{number}"].tolist()
        lamps.append(LampImage(int(place[0]), int(place[1]), waves, rays, (place[2], place[3]), place[4]))
        number += 1
    edges_or_none = edges if len(edges) else None
    return FilmSpread(resolution, (width, height), pupils, edges_or_none, tuple(lamps))


@dataclass(frozen=True)
class Diffraction:
    """What diffraction does to the film of a scene.

    Attributes
    ----------
    scene : Scene
        In focus, with the camera as requested, whatever cheaper one renders it.
    is_on : bool
    airy_radius_px : float or None
        In the middle of the film at 550 nm; None for a camera without an opening.
    pupils : callable or None
        Gives the opening that a point of the film sees.
    plan : Plan or None
        That of the render, whose lamps have pictures of their own; none have without it.
    """

    scene: Scene
    is_on: bool
    airy_radius_px: float | None
    pupils: FilmPupils | None
    plan: Plan | None = None

    @cached_property
    def spread(self) -> FilmSpread:
        """What the openings do, of nodes on the whole film.

        A node that no light reaches takes the opening of the film's middle, as it has nothing to spread.
        """
        film = self.scene.film
        columns, rows = _nodes(film.resolution)
        points = [_film_point(self.scene, column, row) for row in rows for column in columns]
        seen = tuple(self._pupil_at(point) for point in points)
        plain = FilmSpread(film.resolution, _pixel_mm(self.scene), seen)
        near = replace(plain, edges=self._edges)
        near = near if near.reach < max(film.resolution) else plain
        unit = unit_px(seen[len(seen) // 2], near.pixel_mm)
        if self.plan is None or self.pupils is None or unit < _FINEST_PX:
            return near
        known = list(zip(points, seen, strict=True))
        lamps = _lamp_images(self.scene, self.plan, self.pupils, known, REACH if near.edges is None else NEAR)
        return replace(near, lamps=tuple(lamps))

    @cached_property
    def _edges(self) -> Array | None:
        """Edges of the opening that the middle of the film sees, and of the dirt in it."""
        assert self.pupils is not None
        outline, dirt = self.pupils.outline(np.zeros(2)), self.scene.camera.stop.dirt
        if outline is None:
            return None
        own = edges_of(outline)
        return own if dirt is None else np.concatenate([own, dirt_edges(dirt, outline, self.pupils.radius_mm)])

    def _pupil_at(self, point: Array) -> FilmPupil:
        assert self.pupils is not None
        checkpoint()
        try:
            return self.pupils(point)
        except InputError:
            return self.pupils(np.zeros(2))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of a saved render by which `merge` applies it without the scene; none where it is off."""
        return self.spread.arrays() if self.is_on else {}

    @property
    def metadata(self) -> dict[str, Any]:
        """What the picture's metadata should say."""
        radius = self.airy_radius_px
        if radius is None:
            says = "off: no opening forms an image in the middle of the film"
        elif self.is_on:
            says = f"on: the Airy radius is {radius:.2g} px"
        else:
            says = f"off: the Airy radius is {radius:.2g} px, and shows from {SHOWS_PX:g} px"
        return {"on": self.is_on, "airy_radius_px": radius, "says": says}


def _sampled(axis: Array, every: int) -> Array:
    """Return places of an axis at most so many steps apart, its ends among them."""
    return np.linspace(axis[0], axis[-1], -(-(len(axis) - 1) // max(every, 1)) + 1) if len(axis) > 1 else axis


def _about(place: tuple[float, float]) -> Iterator[tuple[int, int, float]]:
    """Yield the four pixels about a place, column and row, and the share that each has of it."""
    column, row = (int(np.floor(part - 0.5)) for part in place)
    x, y = place[0] - 0.5 - column, place[1] - 0.5 - row
    for i, by_column in ((column, 1 - x), (column + 1, x)):
        for j, by_row in ((row, 1 - y), (row + 1, y)):
            yield i, j, by_column * by_row


def diffraction_of(scene: Scene) -> Diffraction | None:
    """Find the diffraction of the film of a scene in focus; None where it is off.

    Raises
    ------
    InputError
        When the camera has no opening that diffracts, or no light reaches the film's middle.
    """
    choice = scene.camera.diffraction
    if choice == "off":
        return None
    if not film_frame(scene.camera).is_flat:  # `on` is refused there
        return Diffraction(scene, False, None, None)
    try:
        pupils = camera_of(scene).film_pupils()
        radius = AIRY * unit_px(pupils(np.zeros(2)), _pixel_mm(scene))
    except InputError:
        if choice == "on":
            raise
        return Diffraction(scene, False, None, None)
    return Diffraction(scene, choice == "on" or radius >= SHOWS_PX, radius, pupils)


def diffract(diffraction: Diffraction | None, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a film (height, width, 3) of linear RGB with its diffraction; the very same where that is off."""
    if diffraction is None or not diffraction.is_on:
        return pixels
    return diffraction.spread.over(pixels, FilmLayout.of(diffraction.scene.film))


def _nodes(resolution: tuple[int, int]) -> tuple[Array, Array]:
    """Return columns and rows of the nodes on a film [pixels]."""
    order = NODES if resolution[0] >= resolution[1] else NODES[::-1]
    columns, rows = (_pixels_along(side, most) for side, most in zip(resolution, order, strict=True))
    return columns, rows


def _pixels_along(pixels: int, most: int) -> Array:
    """Return places of nodes along a side of the film, from its first pixel to its last [pixels]."""
    count = min(most, 1 + pixels // _NODE_PX)
    return np.array([(pixels - 1) / 2]) if count < 2 else np.linspace(0.0, pixels - 1.0, count)


def _pixel_mm(scene: Scene) -> tuple[float, float]:
    width, height = scene.film.size_m()
    columns, rows = scene.film.resolution
    return 1e3 * width / columns, 1e3 * height / rows


def _film_point(scene: Scene, column: float, row: float) -> Array:
    """Return where on the film the middle of a pixel lies [mm], in the frame of the lens."""
    (columns, rows), (width, height) = scene.film.resolution, scene.film.size_m()
    sense = -1e3 if scene.camera.flip else 1e3
    film = sense * np.array([((column + 0.5) / columns - 0.5) * width, (0.5 - (row + 0.5) / rows) * height])
    return film_frame(scene.camera).points(film)[:2]
