"""Diffraction of a rendered film: whether it shows, and the film with it.

The rays have brought the geometrical image, defocus and aberrations included. The film receives its convolution with
what the opening, as that part of the film sees it, makes of a point by a perfect wavefront: docs/diffraction.md says
why, and how far that is from the full wave image.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import WAVELENGTHS_NM, cie_1931, daylight_65, rgb_basis
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.rendering.cameras.film_pupil import FilmPupil, FilmPupils
from rptcam_cl.rendering.cameras.ideal import dirt_edges, edges_of
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.setting import film_frame
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.several import GOLDEN
from rptcam_cl.scene.scene import Scene

#
# A picture blurred by a kernel that varies over it: each pixel spreads its light by the kernels of the nearest nodes.
#
# Nodes lie on a grid over the whole film. A pixel's kernel is that of the four about it, weighted linearly, and the
# weights sum to 1: no light is lost or made. What leaves the picture comes back as if from a mirror at its border,
# where a real film receives as much from the scene beside it.

Array = NDArray[np.float64]


def blur(planes: Array, offset: tuple[int, int], nodes: tuple[Array, Array], kernels: Sequence[Array]) -> Array:
    """Return planes (3, height, width) after each pixel has spread its light.

    Parameters
    ----------
    planes
        In float64, with any dynamic range.
    offset
        Column and row of the first pixel on the whole film.
    nodes
        Columns and rows of the nodes on the whole film, rising.
    kernels
        One (3, k, k) for each node, by rows; k is odd.
    """
    height, width = planes.shape[1:]
    reach = kernels[0].shape[-1] // 2
    wide = np.zeros((3, height + 2 * reach, width + 2 * reach))
    weights = [_hats(axis, start + np.arange(length)) for axis, start, length in
               zip(nodes, offset, (width, height), strict=True)]  # fmt: skip
    for (row, column), kernel in zip(_places(nodes), kernels, strict=True):
        columns, rows = np.flatnonzero(weights[0][column]), np.flatnonzero(weights[1][row])
        if not len(columns) or not len(rows):
            continue
        left, right, top, bottom = columns[0], columns[-1] + 1, rows[0], rows[-1] + 1
        share = weights[1][row, top:bottom, None] * weights[0][column, left:right]
        for plane, part, target in zip(planes, kernel, wide, strict=True):
            checkpoint()
            spread = _convolve(plane[top:bottom, left:right] * share, part)
            target[top : bottom + 2 * reach, left : right + 2 * reach] += spread
    return _fold(_fold(wide, height, reach, 1), width, reach, 2)


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
    """Return the full convolution; where nothing is negative before, nothing is after."""
    shape = tuple(quick(a + b - 1) for a, b in zip(plane.shape, kernel.shape, strict=True))
    product = np.fft.rfft2(plane, shape) * np.fft.rfft2(kernel, shape)
    height, width = (a + b - 1 for a, b in zip(plane.shape, kernel.shape, strict=True))
    spread = np.fft.irfft2(product, shape)[:height, :width]
    return np.maximum(spread, 0.0) if plane.min() >= 0 else spread


def quick(length: int) -> int:
    """Return the next length whose only prime factors are 2, 3 and 5, which transforms are fast for."""
    while True:
        rest = length
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return length
        length += 1


def _fold(wide: Array, length: int, reach: int, axis: int) -> Array:
    """Return an axis of planes without its margins, whose light comes back mirrored."""
    places = np.arange(-reach, length + reach) % (2 * length)
    places = np.where(places < length, places, 2 * length - 1 - places)
    moved = np.moveaxis(wide, axis, 0)
    inner = np.zeros((length, *moved.shape[1:]))
    for place, line in zip(places, moved, strict=True):
        inner[place] += line
    return np.moveaxis(inner, 0, axis)


#
# What an opening makes of a point of light, pixel by pixel: the kernel of its diffraction.
#
# The light of a wavelength at a film point x is |integral of exp(2 pi i (l x + m y) / wavelength) dl dm|^2 over the
# open directions (Fraunhofer). Red, green and blue have each the mean over the wavelengths that make them in white
# light. A kernel has no negative values and the sum 1, so that it neither rings nor adds light.

REACH = 64.0  # half width of a kernel, in wavelength over twice the numerical aperture: 99.7 % of an Airy pattern
LEAST_REACH, MOST_REACH = 2, 256  # the same in pixels
KNOWN = 1.5 * REACH  # from where the light is left out: an opening of 144 cells shows its image again 141 away
TAPER = 0.75  # share of the reach from which the kernel fades, so that no square shows about a bright lamp
FINE = 2.5  # points per wavelength over twice the numerical aperture; 2 resolve the light exactly
SHARP, SMOOTH = 1.4, 2.0  # the same in pixels: below the first a pixel averages the light, above the second it samples
WAVES_NM = np.arange(410.0, 700.0, 20.0)
MIDDLE_NM = 550.0


@cache
def shares_of_white(waves_nm: tuple[float, ...]) -> Array:
    """Return the share of each of some wavelengths, evenly spaced [nm], in red, green and blue of daylight, (n, 3)."""
    light = rgb_basis() * (cie_1931().sum(axis=1) * daylight_65())[:, None]
    bands = np.rint((WAVELENGTHS_NM - waves_nm[0]) / (waves_nm[1] - waves_nm[0])).astype(int)
    shares = np.zeros((len(waves_nm), 3))
    np.add.at(shares, np.clip(bands, 0, len(waves_nm) - 1), light)
    return np.asarray(shares / shares.sum(axis=0))


def white_shares() -> Array:
    """Return the share of each of `WAVES_NM` in red, green and blue of daylight, shape (wavelengths, 3)."""
    return shares_of_white(tuple(WAVES_NM.tolist()))


def unit_px(pupil: FilmPupil, pixel_mm: tuple[float, float], nm: float = MIDDLE_NM) -> float:
    """Return wavelength over twice the numerical aperture, which is wavelength times f-number [pixels]."""
    length = nm * 1e-6 / pupil.index
    return float(length / (2 * pupil.aperture) / np.sqrt(pixel_mm[0] * pixel_mm[1]))


def reach_px(unit: float, largest: int) -> int:
    """Return half the width of a kernel [pixels], at most that of the film."""
    return int(min(max(np.ceil(REACH * unit), LEAST_REACH), MOST_REACH, largest))


def fade(radius_px: Array, reach: int) -> Array:
    """Return the share of the light at radii that a kernel keeps; the rest of it is far light."""
    radius = radius_px / (reach + 1)
    return np.asarray(np.cos(np.pi / 2 * np.clip((radius - TAPER) / (1 - TAPER), 0.0, 1.0)) ** 2)


def kernel(pupil: FilmPupil, pixel_mm: tuple[float, float], reach: int) -> Array:
    """Return the kernels of red, green and blue, shape (3, 2 reach + 1, 2 reach + 1), rows by y and columns by x.

    Parameters
    ----------
    pupil : FilmPupil
    pixel_mm : tuple of float
        Width and height of a pixel.
    reach : int
        Pixels on each side of the middle one.
    """
    total = np.zeros((3, 2 * reach + 1, 2 * reach + 1))
    for nm, shares in zip(WAVES_NM, white_shares(), strict=True):
        total += shares[:, None, None] * of_wavelength(pupil, pixel_mm, reach, nm)
    away = np.arange(-reach, reach + 1)
    total *= fade(np.hypot(away[:, None], away[None, :]), reach)
    return np.asarray(total / total.sum(axis=(1, 2), keepdims=True))


def of_wavelength(pupil: FilmPupil, pixel_mm: tuple[float, float], reach: int, nm: float) -> Array:
    """Return the light of a wavelength in each pixel, its sum 1."""
    checkpoint()
    unit, size = unit_px(pupil, pixel_mm, nm), 2 * reach + 1
    if KNOWN * unit < 0.5:  # all of it in the middle one
        return np.pad(np.ones((1, 1)), reach)
    width = float(np.sqrt(np.clip((SMOOTH - unit) / (SMOOTH - SHARP), 0.0, 1.0)))  # of the square that is averaged
    finer = max(int(np.ceil(FINE / unit * width)), 1)
    within = ((np.arange(finer) + 0.5) / finer - 0.5) * width
    places = (np.arange(-reach, reach + 1)[:, None] + within).ravel()
    known = np.abs(places) <= KNOWN * unit
    turn = 2j * np.pi * pupil.index / (nm * 1e-6)
    columns = np.exp(turn * pixel_mm[0] * np.outer(pupil.cosines_x - pupil.cosines_x.mean(), places[known]))
    rows = np.exp(turn * pixel_mm[1] * np.outer(places[known], pupil.cosines_y - pupil.cosines_y.mean()))
    light = np.zeros((len(places), len(places)))
    light[np.ix_(known, known)] = np.abs(rows @ pupil.coverage @ columns) ** 2
    binned = light.reshape(size, finer, size, finer).sum(axis=(1, 3))
    return np.asarray(binned / binned.sum())


#
# The far light of a lamp: what its opening, with dust and scratches, diffracts beyond the kernel about each pixel.
#
# An opening is a set of edges, seen along a line in each direction: how wide it is open there is a sum of ramps, and
# the Fourier transform of that line is the field in this direction (the projection-slice theorem). Light of a
# wavelength is that of another, scaled; so one table over directions and radii, summed up over both, gives all of
# them in every pixel.

ANGLES = 4096  # directions over half a turn; the other half is alike
CELLS, LINE = 8192, 2.5  # of the line that an opening is seen along, and its length in widths of the opening
RESOLVED = 1024.0  # wavelengths times f-number up to which the light is computed; beyond it falls as its cube
BANDS, SPANS = 448, 384  # radii, evenly in their logarithm, of that light and of the film's
STARBURST_NM = tuple(np.arange(405.0, 700.0, 5.0).tolist())
AT_ONCE = 128  # directions
LAMP = 16.0  # times the mean of the film, from which a pixel sends far light
NARROW = 1e-7  # least width of an edge along the line


@dataclass(frozen=True)
class FarLight:
    """What an opening makes of a lamp far from it on the film.

    Attributes
    ----------
    edges : (n, 4) array
        Of the opening in direction cosines, from x, y to x, y: its outline anticlockwise, holes clockwise.
    index : float
        Of the medium in front of the film.
    pixel_mm : tuple of float
        Width and height of a pixel.
    reach : int
        Of the kernel about each pixel, which fades as this begins [pixels].
    """

    edges: Array
    index: float
    pixel_mm: tuple[float, float]
    reach: int

    @property
    def _pixel(self) -> float:
        return float(np.sqrt(self.pixel_mm[0] * self.pixel_mm[1]))

    @cached_property
    def _area(self) -> float:
        x, y, to_x, to_y = self.edges.T
        return float((x * to_y - y * to_x).sum() / 2)

    @cached_property
    def _width(self) -> float:
        """Diameter of the round opening of the same area, in direction cosines."""
        return 2 * float(np.sqrt(self._area / np.pi))

    def unit_px(self, nm: float) -> float:
        """Return wavelength times f-number [pixels]."""
        return nm * 1e-6 / self.index / self._width / self._pixel

    @cached_property
    def within(self) -> tuple[Array, Array]:
        """Radii, in wavelengths times f-number, and the share of light within each for each direction, from the first.

        The second has the shape (directions, radii), over half a turn that stands for both.
        """
        low = 0.5 * self.reach / self.unit_px(STARBURST_NM[-1])
        radii = np.geomspace(min(low, RESOLVED / 4), RESOLVED, BANDS)
        edges = (self.edges - np.tile(self._middle, 2)) / self._width
        shares = np.zeros((ANGLES, BANDS))
        rho = np.arange(CELLS // 2 + 1) / LINE
        to_share = 2 * (np.pi / ANGLES) / LINE / (self._area / self._width**2)
        for start in range(0, ANGLES, AT_ONCE):
            angles = np.pi * (np.arange(start, min(start + AT_ONCE, ANGLES)) + 0.5) / ANGLES
            light = _along(edges, angles) * to_share * rho
            total = np.cumsum(light, axis=1)
            shares[start : start + AT_ONCE] = [np.interp(radii, rho + 0.5 / LINE, line) for line in total]
        return radii, shares - shares[:, :1]

    @property
    def _middle(self) -> Array:
        corners = self.edges[:, :2]
        return np.asarray((corners.max(axis=0) + corners.min(axis=0)) / 2)

    @cached_property
    def _beyond(self) -> Array:
        """Light of each direction beyond what is resolved, by that of the outer half of it (directions,)."""
        radii, within = self.within
        half = int(np.searchsorted(radii, RESOLVED / 2))
        return np.asarray((within[:, -1] - within[:, half]) / (RESOLVED / radii[half] - 1))

    def _weights(self, pixels: Array) -> tuple[Array, Array]:
        """Weights of light within `within`, and of that beyond, within radii [pixels], (BANDS, 3, n) and (3, n)."""
        radii, columns = self.within[0], np.arange(len(pixels))
        inner, outer = np.zeros((BANDS, 3, len(pixels))), np.zeros((3, len(pixels)))
        for nm, shares in zip(STARBURST_NM, shares_of_white(STARBURST_NM), strict=True):
            rho = pixels / self.unit_px(nm)
            place = np.interp(np.log(rho), np.log(radii), np.arange(BANDS))
            below = np.minimum(place.astype(np.int64), BANDS - 2)
            part = place - below
            inner[below, :, columns] += (1 - part)[:, None] * shares
            inner[below + 1, :, columns] += part[:, None] * shares
            outer += shares[:, None] * np.maximum(1 - RESOLVED / rho, 0)
        return inner, outer

    @cached_property
    def shares(self) -> Array:
        """Share of red, green and blue that is far light, on the film and beside it (3,)."""
        edges = np.geomspace(0.6 * self.reach, 1e7, 2048)
        inner, outer = self._weights(edges)
        light = np.tensordot(self.within[1].sum(axis=0), inner, 1) + self._beyond.sum() * outer
        middle = np.sqrt(edges[1:] * edges[:-1])
        return np.asarray(np.diff(light, axis=1) @ (1 - fade(middle, self.reach)))

    def kernel(self, width: int, height: int) -> Array:
        """Return the far light (3, 2 height - 1, 2 width - 1) of a lamp in the middle; turned as `kernel` of a pupil.

        Each pixel has the light of a box of its area along radius and circle.
        """
        sides = self.pixel_mm[0] / self._pixel, self.pixel_mm[1] / self._pixel
        x, y = np.arange(-(width - 1), width) * sides[0], np.arange(height) * sides[1]
        first = max(0.6 * self.reach - 0.5, 0.5)
        edges = np.geomspace(first, np.hypot(x[-1], y[-1]) + 2.0, SPANS)
        inner, outer = self._weights(edges)
        light = np.tensordot(self.within[1], inner, 1) + self._beyond[:, None, None] * outer
        table = _sum_up(np.moveaxis(light, 1, 0))
        upper = np.zeros((3, height, 2 * width - 1))
        for row in range(height):
            radius, angle = np.hypot(x, y[row]), np.arctan2(y[row], x)
            lit = radius > 0.75 * self.reach
            if lit.any():
                boxes = _boxes(table, edges, radius[lit], angle[lit])
                upper[:, row, lit] = boxes * (1 - fade(radius[lit], self.reach))
        return np.concatenate([upper[:, :0:-1, ::-1], upper], axis=1)


def _along(edges: Array, angles: Array) -> Array:
    """Return |F|^2 of an opening in its widths at multiples of 1 / LINE, (directions, CELLS / 2 + 1)."""
    checkpoint()
    n = np.stack([np.cos(angles), np.sin(angles)])
    start, end = edges[:, :2] @ n, edges[:, 2:] @ n  # (edges, directions)
    mass = n[0] * (edges[:, 3:4] - edges[:, 1:2]) - n[1] * (edges[:, 2:3] - edges[:, 0:1])
    low, wide = np.minimum(start, end), np.maximum(np.abs(end - start), NARROW)
    step = LINE / CELLS
    rows = np.broadcast_to(np.arange(len(angles)) * CELLS, low.shape)
    shift = np.mod(angles * ANGLES / np.pi * GOLDEN, 1.0)  # so that what is folded back adds up without a phase
    second = np.zeros(len(angles) * CELLS)
    for place, sign in ((low, 1.0), (low + wide, -1.0)):  # a ramp in the sum is two kinks
        cell = (place + LINE / 2) / step + shift
        whole = np.floor(cell).astype(np.int64)
        part, weight = cell - whole, sign * mass / wide * step
        second += np.bincount((rows + whole).ravel(), (weight * (1 - part)).ravel(), len(second))
        second += np.bincount((rows + whole + 1).ravel(), (weight * part).ravel(), len(second))
    ramp = np.cumsum(np.cumsum(second.reshape(len(angles), CELLS), axis=1), axis=1)
    field = np.fft.rfft(ramp, axis=1) * step
    rho = np.arange(CELLS // 2 + 1) / LINE
    folded = (rho / (CELLS / LINE - rho)) ** 3  # from beyond what cells resolve, of light that falls as the cube
    light = (field.real**2 + field.imag**2) / (1 + folded)
    light[:, rho > RESOLVED + 1] = 0.0
    return np.asarray(light)


def _sum_up(light: Array) -> Array:
    """Return light (3, directions, radii) summed up over directions from none, and half as many more on each side."""
    table = np.cumsum(np.pad(light, ((0, 0), (1, 0), (0, 0))), axis=1)
    whole = table[:, -1:]
    return np.concatenate([table[:, ANGLES // 2 : -1] - whole, table, table[:, 1 : ANGLES // 2 + 1] + whole], axis=1)


def _boxes(table: Array, edges: Array, radius: Array, angle: Array) -> Array:
    """Return the light (3, n) of boxes of one pixel about places, of a table summed over directions."""
    log = np.log(edges[1] / edges[0])
    light = np.zeros((3, len(radius)))
    half = np.minimum(0.5 / radius, np.pi / 4)
    for outer in (-0.5, 0.5):
        at = np.clip(np.log(np.maximum(radius + outer, edges[0]) / edges[0]) / log, 0, len(edges) - 1.001)
        for side in (-1, 1):
            to = (angle + side * half) * ANGLES / np.pi + ANGLES // 2
            i, j = to.astype(np.int64), at.astype(np.int64)
            u, v = to - i, at - j
            value = (table[:, i, j] * (1 - u) + table[:, i + 1, j] * u) * (1 - v)
            value += (table[:, i, j + 1] * (1 - u) + table[:, i + 1, j + 1] * u) * v
            light += value * (side * (1 if outer > 0 else -1))
    return np.maximum(light, 0.0) / 2  # a half turn of the table stands for both


def lamps_of(planes: Array) -> Array:
    """Return planes (3, height, width) of the pixels alone that outshine the mean of their film."""
    brightness = planes.max(axis=0)
    return np.asarray(planes * (brightness > LAMP * brightness.mean()))


def strew(planes: Array, kernel: Array) -> Array:
    """Return the light of planes (3, height, width) on them, by a kernel of twice the whole film or more.

    What falls beside them is lost.
    """
    height, width = planes.shape[1:]
    top, left = kernel.shape[1] // 2 - height + 1, kernel.shape[2] // 2 - width + 1
    light = np.empty_like(planes)
    shape = tuple(quick(2 * side - 1) for side in (height, width))
    for plane, part, target in zip(planes, kernel, light, strict=True):
        own = part[top : top + 2 * height - 1, left : left + 2 * width - 1]
        product = np.fft.rfft2(plane, shape) * np.fft.rfft2(own, shape)
        target[:] = np.fft.irfft2(product, shape)[height - 1 : 2 * height - 1, width - 1 : 2 * width - 1]
    return np.maximum(light, 0.0)


AIRY = 1.2196698912665045  # radius of the first dark ring, in wavelength times f-number
SHOWS_PX = 0.5  # Airy radius from which `auto` takes it: as much as `camera.accuracy: auto` lets light stray
NODES = (5, 3)  # along the longer and the shorter side of the film
NODE_PX = 16  # least distance between nodes


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
    """

    resolution: tuple[int, int]
    pixel_mm: tuple[float, float]
    pupils: tuple[FilmPupil, ...]
    edges: Array | None = None

    @cached_property
    def reach(self) -> int:
        """Of the kernels [pixels]."""
        return reach_px(max(unit_px(pupil, self.pixel_mm) for pupil in self.pupils), max(self.resolution))

    @cached_property
    def kernels(self) -> tuple[tuple[Array, Array], list[Array]]:
        """Columns and rows of the nodes on the whole film, and the kernel of each."""
        own = [kernel(pupil, self.pixel_mm, self.reach)[:, :, ::-1] for pupil in self.pupils]  # x runs to the left
        return _nodes(self.resolution), own

    @cached_property
    def far(self) -> tuple[Array, Array]:
        """Share of the far light of red, green and blue, and its kernel over twice the whole film."""
        assert self.edges is not None
        light = FarLight(self.edges, self.pupils[len(self.pupils) // 2].index, self.pixel_mm, self.reach)
        return light.shares, light.kernel(*self.resolution)[:, :, ::-1]

    def over(self, pixels: NDArray[np.float32], layout: FilmLayout) -> NDArray[np.float32]:
        """Return a film (height, width, 3) of linear RGB with its light spread."""
        planes = np.moveaxis(pixels.astype(np.float64), -1, 0)
        lamps = lamps_of(planes)
        if self.edges is None or not lamps.any():
            spread = blur(planes, (layout.x, layout.y), *self.kernels)
        else:
            shares, light = self.far
            spread = blur(planes - lamps * shares[:, None, None], (layout.x, layout.y), *self.kernels)
            spread += strew(lamps, light)
        return np.ascontiguousarray(np.moveaxis(spread, 0, -1), dtype=np.float32)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays that `spread_of` reads; shares of coverage are sixteenths, which float32 holds."""
        return {
            "diffraction_pixel_mm": np.array(self.pixel_mm),
            "diffraction_coverage": np.array([pupil.coverage for pupil in self.pupils], np.float32),
            "diffraction_cosines": np.array([[pupil.cosines_x, pupil.cosines_y] for pupil in self.pupils]),
            "diffraction_index": np.array([pupil.index for pupil in self.pupils]),
            "diffraction_edges": np.zeros((0, 4)) if self.edges is None else self.edges,
        }


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
    return FilmSpread(resolution, (width, height), pupils, edges if len(edges) else None)


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
    """

    scene: Scene
    is_on: bool
    airy_radius_px: float | None
    pupils: FilmPupils | None

    @cached_property
    def spread(self) -> FilmSpread:
        """What the openings do, of nodes on the whole film.

        A node that no light reaches takes the opening of the film's middle, as it has nothing to spread.
        """
        film = self.scene.film
        columns, rows = _nodes(film.resolution)
        seen = tuple(self._pupil_at(_film_point(self.scene, column, row)) for row in rows for column in columns)
        near = FilmSpread(film.resolution, _pixel_mm(self.scene), seen)
        return near if near.reach >= max(film.resolution) else replace(near, edges=self._edges)

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
    count = min(most, 1 + pixels // NODE_PX)
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
