"""What an opening makes of a point of light on the film: the kernel of its diffraction near by, and far light."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import GOLDEN
from rptcam_cl.core.colour import WAVELENGTHS_NM, cie_1931, daylight_65, rgb_basis
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.rendering.cameras.film_pupil import FilmPupil

Array = NDArray[np.float64]
Square = tuple[slice, slice]
Waves = NDArray[np.complex128]
Mask = NDArray[np.bool_]

WAVES_NM = tuple(np.arange(410.0, 700.0, 20.0).tolist())
_TAPER = 0.75  # share of the reach from which the kernel fades, so that no square shows about a bright lamp


@cache
def shares_of_white(waves_nm: tuple[float, ...]) -> Array:
    """Return the share of each of some wavelengths, evenly spaced [nm], in red, green and blue of daylight, (n, 3)."""
    light = rgb_basis() * (cie_1931().sum(axis=1) * daylight_65())[:, None]
    bands = np.rint((WAVELENGTHS_NM - waves_nm[0]) / (waves_nm[1] - waves_nm[0])).astype(int)
    shares = np.zeros((len(waves_nm), 3))
    np.add.at(shares, np.clip(bands, 0, len(waves_nm) - 1), light)
    return np.asarray(shares / shares.sum(axis=0))


def fade(radius_px: Array, reach: float) -> Array:
    """Return the share of the light at radii that a kernel keeps; the rest of it is far light."""
    radius = radius_px / (reach + 1)
    return np.asarray(np.cos(np.pi / 2 * np.clip((radius - _TAPER) / (1 - _TAPER), 0.0, 1.0)) ** 2)


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


def spread(pictures: Array, kernels: Array) -> Array:
    """Return square pictures, by kernels as large about their middles, as far as the pictures reach."""
    size = pictures.shape[-1]
    reach, side = size // 2, quick(2 * size)
    whole = np.fft.rfft2(pictures, (side, side)) * np.fft.rfft2(kernels, (side, side))
    return np.asarray(np.fft.irfft2(whole, (side, side))[..., reach : reach + size, reach : reach + size])


#
# What an opening makes of a point of light, pixel by pixel: the kernel of its diffraction.
#
# The light of a wavelength at a film point x is |integral of exp(2 pi i (l x + m y) / wavelength) dl dm|^2 over the
# open directions (Fraunhofer). Red, green and blue have each the mean over the wavelengths that make them in white
# light. A kernel has no negative values and the sum 1, so that it neither rings nor adds light.

NEAR, REACH = 20.0, 64.0  # half width of a kernel with far light and without, in wavelength over twice the aperture
LEAST_REACH, _MOST_REACH = 2, 256  # the same in pixels
KNOWN = 0.453  # of the cells across an opening, from where the light is left out: it shows its image again so many away
FINE = 2.5  # points per wavelength over twice the numerical aperture; 2 resolve the light exactly
SMOOTH = 2.0  # the same in pixels, from where on these resolve the light
_BY_CELLS = 0.3  # of what cells resolve; pixels farther apart see the transfer next to 0 alone, a line as between cells
_FIT, _ROUNDS = 0.35, 10  # cycles per pixel up to which a kernel of wide pixels has the transfer, and rounds to it
MIDDLE_NM = 550.0


def unit_px(pupil: FilmPupil, pixel_mm: tuple[float, float], nm: float = MIDDLE_NM) -> float:
    """Return wavelength over twice the numerical aperture, which is wavelength times f-number [pixels]."""
    length = nm * 1e-6 / pupil.index
    return float(length / (2 * pupil.aperture) / np.sqrt(abs(pixel_mm[0] * pixel_mm[1])))


def finest_contrast(pupil: FilmPupil, pixel_mm: tuple[float, float]) -> float:
    """Return the modulation of lines of two pixels by a perfect wavefront, across columns or rows, the lower one."""
    apart = [MIDDLE_NM * 1e-6 / pupil.index / abs(2 * side) / pupil.step for side in pixel_mm]  # of two cells
    shares: list[float] = []
    for open_share, cells in zip((pupil.coverage.T, pupil.coverage), apart, strict=True):
        whole = np.pad(open_share, ((0, min(int(cells) + 1, len(open_share))), (0, 0)))
        kept = [float((open_share * whole[k : k + len(open_share)]).sum()) if k < len(open_share) else 0.0
                for k in (int(cells), int(cells) + 1)]  # fmt: skip
        shares.append((kept[0] + (cells % 1) * (kept[1] - kept[0])) / float((open_share**2).sum()))
    return min(shares)


def reach_px(unit: float, largest: int, units: float = REACH, wider: int = 0) -> int:
    """Return half the width of a kernel [pixels], at most that of the film; ``wider`` for aberrations."""
    return int(min(max(np.ceil(units * unit), LEAST_REACH) + wider, _MOST_REACH, largest))


def near_kernel(
    pupil: FilmPupil,
    pixel_mm: tuple[float, float],
    reach: int,
    amplitude: Callable[[float], Waves] | None = None,
    wide: float = 0.0,
) -> Array:
    """Return the kernels of red, green and blue, shape (3, 2 reach + 1, 2 reach + 1), rows by y and columns by x.

    Parameters
    ----------
    pupil : FilmPupil
    pixel_mm : tuple of float
        Width and height of a pixel; negative where columns or rows run against x or y.
    reach : int
        Pixels on each side of the middle one.
    amplitude : callable, optional
        Gives that of each cell of the opening at a wavelength [nm]; by default a perfect wavefront's.
    wide
        How far its rays miss the middle [pixels].
    """
    total = np.zeros((3, 2 * reach + 1, 2 * reach + 1))
    resolve = unit_px(pupil, pixel_mm, WAVES_NM[0]) >= SMOOTH
    for nm, shares in zip(WAVES_NM, shares_of_white(WAVES_NM), strict=True):
        wave = pupil.coverage if amplitude is None else amplitude(nm)
        light = of_wavelength(pupil, pixel_mm, reach, nm, wave, wide) if resolve else _up_to_lines(
            pupil, pixel_mm, reach, nm, wave)  # fmt: skip
        total += shares[:, None, None] * light
    return faded(total if resolve else _without_negative(total), reach)


def _up_to_lines(pupil: FilmPupil, pixel_mm: tuple[float, float], reach: int, nm: float, wave: Array | Waves) -> Array:
    """Return the light of a wavelength at the middles of pixels, without what is finer than they resolve.

    Pixels of a film by rays have averaged it over their width already, so a kernel is not to do so once more. Its
    transfer is the autocorrelation of the opening, up to lines of two pixels; some of it is negative.
    """
    checkpoint()
    side, count = quick(2 * len(wave)), 2 * quick(2 * reach + 1)
    auto = np.fft.ifft2(np.abs(np.fft.fft2(wave, (side, side))) ** 2)
    hats, kept = [], []
    for pixel in pixel_mm:
        cells = np.fft.fftfreq(count) * (nm * 1e-6 / (pupil.index * pixel * pupil.step))  # that two of it are apart
        low, rows, hat = np.floor(cells).astype(int), np.arange(count), np.zeros((count, side))
        for other, share in ((low, low + 1 - cells), (low + 1, cells - low)):
            np.add.at(hat, (rows, other % side), np.where(np.abs(cells) < len(wave), share, 0.0))
        hats.append(hat)
        places = np.abs(np.arange(-reach, reach + 1) * pixel * pupil.step * pupil.index / (nm * 1e-6))
        by_cells = kept_by_cells(places) * np.sinc(places) ** 2  # the second of what lies linearly between cells
        kept.append(np.where(places < _BY_CELLS, by_cells, 1.0))
    light = np.fft.ifft2(hats[1] @ auto @ hats[0].T).real / auto[0, 0].real
    return np.asarray(np.roll(light, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1] / np.outer(*kept[::-1]))


def _without_negative(kernel: Array) -> Array:
    """Return kernels (3, n, n) without negative values, of the same transfer to all but the finest lines."""
    side = quick(2 * kernel.shape[-1])
    across, down = np.fft.rfftfreq(side), np.fft.fftfreq(side)
    counts = np.exp(-((np.hypot(across, down[:, None]) / _FIT) ** 4))
    near = np.maximum(kernel, 0.0)
    for _ in range(_ROUNDS):
        lacks = np.fft.irfft2(counts * np.fft.rfft2(kernel - near, (side, side)), (side, side))
        near = np.maximum(near + lacks[:, : kernel.shape[1], : kernel.shape[2]], 0.0)
    return near


def faded(kernel: Array, reach: int) -> Array:
    """Return kernels (3, n, n) that fade, of the sum 1."""
    away = np.arange(-reach, reach + 1)
    kernel = kernel * fade(np.hypot(away[:, None], away[None, :]), reach)
    return np.asarray(kernel / kernel.sum(axis=(1, 2), keepdims=True))


def of_wavelength(
    pupil: FilmPupil,
    pixel_mm: tuple[float, float],
    reach: int,
    nm: float,
    wave: Array | Waves | None = None,
    wide: float = 0.0,
) -> Array:
    """Return the share of the light of a wavelength in each pixel, by its middle; what lies beyond is not among them.

    Parameters
    ----------
    wave : (n, n) array, optional
        The amplitude in each cell of the opening; by default a perfect wavefront's.
    wide
        How far rays miss the middle [pixels].
    """
    checkpoint()
    wave = pupil.coverage if wave is None else wave
    far = KNOWN * len(pupil.cosines_x) * unit_px(pupil, pixel_mm, nm) + wide
    places = np.arange(-reach, reach + 1.0)
    known = np.abs(places) <= far
    turn = 2j * np.pi * pupil.index / (nm * 1e-6)
    columns = np.exp(turn * pixel_mm[0] * np.outer(pupil.cosines_x - pupil.cosines_x.mean(), places[known]))
    rows = np.exp(turn * pixel_mm[1] * np.outer(places[known], pupil.cosines_y - pupil.cosines_y.mean()))
    light = np.zeros((len(places), len(places)))
    kept = kept_by_cells(places[known] * pupil.step * pupil.index / (nm * 1e-6) * np.array(pixel_mm)[:, None])
    rows, columns = rows.astype(np.complex64), columns.astype(np.complex64)  # twice as fast, within 1e-5
    light[np.ix_(known, known)] = np.abs(rows @ wave.astype(np.complex64) @ columns) ** 2 / np.outer(kept[1], kept[0])
    per_point = (pupil.step * pupil.index / (nm * 1e-6)) ** 2 * abs(pixel_mm[0] * pixel_mm[1])
    return np.asarray(light * per_point / (np.abs(wave) ** 2).sum())


def kept_by_cells(places: Array) -> Array:
    """Return the share of light, by its distance along an axis in widths of what cells resolve, that cells show there.

    A cell averages the opening over its width, and shows light of one width away, which falls as the cube, as its own.
    """
    near = np.minimum(np.abs(places), 0.5)
    return np.asarray(np.sinc(near) ** 2 + np.sinc(1 - near) ** 2 * (near / (1 - near)) ** 3)


#
# A picture blurred by a kernel that varies over it.
#
# Nodes lie on a grid over the whole film. A pixel's kernel is that of the four about it, weighted linearly, and the
# weights sum to 1. Lamps spread their light by the kernel of their own place, so that it stays as much. All else
# gathers its light by the kernel of the pixel that receives it, so that even light stays even where kernels widen fast,
# as at the end of an image circle. What leaves the picture is lost. What lies beside it is not known; it is taken to be
# as bright as the border, lamps apart.

_FEW_SUMS = 8  # for each pixel, which are sooner done than the Fourier transforms


def blur(
    planes: Array, lamps: Array, offset: tuple[int, int], nodes: tuple[Array, Array], kernels: Sequence[Array]
) -> Array:
    """Return planes (3, height, width) with their light spread.

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
        One (3, k, k) for each node, by rows; k is odd, and may differ.
    """
    reach = max(part.shape[-1] // 2 for part in kernels)
    out = blur_with_border(planes, lamps, offset, nodes, kernels, reach)
    return out[:, reach : reach + planes.shape[1], reach : reach + planes.shape[2]]


def blur_with_border(
    planes: Array,
    lamps: Array,
    offset: tuple[int, int],
    nodes: tuple[Array, Array],
    kernels: Sequence[Array],
    reach: int,
    veil: Array | None = None,
    shares: Array | None = None,
) -> Array:
    """Return the same with so many pixels round it, for the light that lamps send there.

    A ``veil`` (3, m, m), wider than the kernels, goes with them where pixels gather light. Of pixels with ``shares``
    (height, width) these kernels bring as much.
    """
    height, width = planes.shape[1:]
    even = np.pad(planes - lamps, ((0, 0), (reach, reach), (reach, reach)), mode="edge")
    out = np.zeros((3, height + 2 * reach, width + 2 * reach))
    weights = [hats(axis, start + np.arange(length)) for axis, start, length in
               zip(nodes, offset, (width, height), strict=True)]  # fmt: skip
    places = itertools.product(range(len(nodes[1])), range(len(nodes[0])))
    for (row, column), kernel in zip(places, kernels, strict=True):
        columns, rows = np.flatnonzero(weights[0][column]), np.flatnonzero(weights[1][row])
        if not len(columns) or not len(rows):
            continue
        left, right, top, bottom = columns[0], columns[-1] + 1, rows[0], rows[-1] + 1
        share, own = weights[1][row, top:bottom, None] * weights[0][column, left:right], kernel.shape[-1] // 2
        share = share if shares is None else share * shares[top:bottom, left:right]
        if not share.any():
            continue
        wide = 0 if veil is None else veil.shape[-1] // 2 - own
        gathers = kernel if veil is None else np.pad(kernel, ((0, 0), (wide, wide), (wide, wide))) + veil

        def around(by: int, top: int = top, bottom: int = bottom, left: int = left, right: int = right) -> Square:
            return slice(reach - by + top, reach + by + bottom), slice(reach - by + left, reach + by + right)

        on_film, about, known = around(0), around(own), around(own + wide)
        for plane, bright, gather, part, target in zip(
            even, lamps[:, top:bottom, left:right], gathers, kernel, out, strict=True
        ):
            checkpoint()
            target[on_film] += share * convolve(plane[known], gather, within=True)
            lit = np.argwhere(bright)
            if len(lit) * part.size < _FEW_SUMS * bright.size:
                for j, i in lit:
                    target[about][j : j + len(part), i : i + len(part)] += bright[j, i] * share[j, i] * part
            else:
                target[about] += convolve(bright * share, part)
    return out


def hats(nodes: Array, places: Array) -> Array:
    """Return the weight of each node at each place, (nodes, places); they sum to 1."""
    if len(nodes) == 1:
        return np.ones((1, len(places)))
    return np.array([np.interp(places, nodes, unit) for unit in np.eye(len(nodes))])


def convolve(plane: Array, kernel: Array, *, within: bool = False) -> Array:
    """Return the full convolution, or the part within it that knows all about itself.

    Of what is nowhere negative, nothing is negative.
    """
    height, width = plane.shape if within else (a + b - 1 for a, b in zip(plane.shape, kernel.shape, strict=True))
    shape = quick(height), quick(width)
    spread = np.fft.irfft2(np.fft.rfft2(plane, shape) * np.fft.rfft2(kernel, shape), shape)[:height, :width]
    spread = spread[kernel.shape[0] - 1 :, kernel.shape[1] - 1 :] if within else spread  # what comes round lies before
    return np.maximum(spread, 0.0) if plane.min() >= 0 and kernel.min() >= 0 else spread


#
# The far light of a film: what an opening, with dust and scratches, diffracts beyond the kernel about each pixel.
#
# An opening is a set of edges, seen along a line in each direction: how wide it is open there is a sum of ramps, and
# the Fourier transform of that line is the field in this direction (the projection-slice theorem). Light of a
# wavelength is that of another, scaled; so one table over directions and radii, summed up over both, gives all of
# them in every pixel.

ANGLES, FEW_ANGLES = 2048, 512  # directions over half a turn, with lamps and without; the other half is alike
CELLS, LINE = 4096, 2.5  # of the line that an opening is seen along, and its length in widths of the opening
RESOLVED = 512.0  # wavelengths times f-number up to which the light is computed; beyond it falls as its cube
BANDS, _SPANS = 448, 384  # radii, evenly in their logarithm, of that light and of the film's
_STARBURST_NM = tuple(np.arange(405.0, 700.0, 5.0).tolist())
AT_ONCE, _ROWS_AT_ONCE = 32, 4  # directions, and rows of a film
STRAIGHT = 120  # directions of edges round a turn, of which two neighbours count as one
NARROW = 1e-7  # least width of an edge along the line
_FIT_ROUNDS = 6
_FINE_SPANS = 1024  # radii of the light of lines
_AS_IT_IS = np.eye(2)

Table = tuple[NDArray[np.float32], Array]
"""Light of pixels (3, radii, directions + 2), and these radii [pixels]."""


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
    directions : int
        Over half a turn, that tell spikes of lamps apart.
    lines : (n, 4) array or None
        Of a lamp that shines in few wavelengths: these [nm], and their shares in red, green and blue; None for white.
    """

    edges: Array
    index: float
    pixel_mm: tuple[float, float]
    reach: float
    directions: int = ANGLES
    lines: Array | None = None

    @property
    def _waves(self) -> list[tuple[float, Array]]:
        if self.lines is not None:
            return [(float(row[0]), row[1:]) for row in self.lines]
        return list(zip(_STARBURST_NM, shares_of_white(_STARBURST_NM), strict=True))

    @property
    def _finer(self) -> int:
        """How many times as finely fringes are known, which lines show and white light does not."""
        return 1 if self.lines is None else 4

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
        low = min(0.5 * self.reach / self.unit_px(_STARBURST_NM[-1]), RESOLVED / 4)
        length = LINE * self._finer
        bands = int(RESOLVED * length) if self._finer > 1 else BANDS
        radii = np.linspace(low, RESOLVED, bands) if self._finer > 1 else np.geomspace(low, RESOLVED, bands)
        edges = (self.edges - np.tile(self._middle, 2)) / self._width
        before = np.empty(len(edges), np.intp)  # edges that end where each begins
        before[np.lexsort(edges[:, :2].T)] = np.lexsort(edges[:, 2:].T)
        shares = np.zeros((self.directions, bands))
        rho = np.arange(int((RESOLVED + 1) * length) + 1) / length
        to_share = 2 * (np.pi / self.directions) / length / (self._area / self._width**2)
        for start in range(0, self.directions, AT_ONCE):
            numbers = np.arange(start, min(start + AT_ONCE, self.directions)) + 0.5
            angles, shift = np.pi * numbers / self.directions, np.mod(numbers * GOLDEN, 1.0)
            light = _along(edges, before, angles, shift, self._finer)[:, : len(rho)]
            total = np.cumsum(light * (to_share * rho), axis=1)
            shares[start : start + AT_ONCE] = [np.interp(radii, rho + 0.5 / length, line) for line in total]
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

    def _light_between(self, within: Array, beyond: Array, rings: Sequence[tuple[Array, Array]]) -> Array:
        """Return the light between radii [pixels] (n, 3, directions), the mean of some rings (n,) and (n,).

        Of that of `within` and of what is beyond.
        """
        radii, count, waves = np.log(self.within[0]), len(rings[0][0]), self._waves
        units, shares = np.array([[self.unit_px(nm)] for nm, _ in waves]), np.array([own for _, own in waves]).T
        columns, within = np.arange(count), np.ascontiguousarray(within.T)
        inner, outer = np.zeros((3, count * len(radii))), np.zeros((3, count))
        light: Array = np.zeros((count, 3, within.shape[1]))
        for pixels, sign in itertools.chain(*(((low, -1 / len(rings)), (high, 1 / len(rings))) for low, high in rings)):
            rho = pixels / units
            outer += sign * shares @ np.maximum(1 - RESOLVED / rho, 0)
            place = np.interp(np.log(rho), radii, np.arange(len(radii)))
            below = np.minimum(place.astype(np.int64), len(radii) - 2)
            part = place - below
            if self.lines is not None:
                for own, k, more in zip(sign * shares.T[:, :, None], below, part[:, :, None], strict=True):
                    light += own * (within[k] * (1 - more) + within[k + 1] * more)[:, None]
                continue
            for plane, own in zip(inner, sign * shares[:, :, None], strict=True):
                for at, weight in ((below, own * (1 - part)), (below + 1, own * part)):
                    plane += np.bincount((columns * len(radii) + at).ravel(), weight.ravel(), plane.size)
        if self.lines is None:
            light += (inner.reshape(-1, len(radii)) @ within).reshape(3, count, -1).swapaxes(0, 1)
        return light + outer.T[:, :, None] * beyond

    @cached_property
    def shares(self) -> Array:
        """Share of red, green and blue that is far light, on the film and beside it (3,)."""
        edges = np.append(np.geomspace(0.6 * self.reach, self.reach + 1.0, 256), 1e7)
        rings = [(edges[:-1], edges[1:])]
        light = self._light_between(self.within[1].sum(axis=0)[None], self._beyond.sum()[None], rings)[:, :, 0]
        return np.asarray((1 - fade(np.sqrt(edges[1:] * edges[:-1]), self.reach)) @ light)

    @cached_property
    def _colours(self) -> tuple[Array, float]:
        """Red, green and blue of light beyond what is resolved, over its green, and from where all is so [pixels]."""
        light = sum((nm * shares for nm, shares in self._waves), np.zeros(3))
        return light / light[1], RESOLVED * self.unit_px(max(nm for nm, _ in self._waves))

    def kernel(self, width: int, height: int) -> Array:
        """Return the far light (3, 2 height - 1, 2 width - 1) of a lamp in the middle; turned as `kernel` of a pupil.

        Each pixel has the light of a box of its area along radius and circle.
        """
        x = np.arange(1.0 - width, width) * (self.pixel_mm[0] / self._pixel)
        y = np.arange(float(height)) * (self.pixel_mm[1] / self._pixel)
        table = self.table(float(np.hypot(x[-1], y[-1])))
        upper = self.at(table, x, y)
        near = np.abs(x) < self.reach + 2
        for row in np.flatnonzero(y < self.reach + 2):
            upper[:, row, near] *= 1 - fade(np.hypot(x[near], y[row]), self.reach)
        return np.concatenate([upper[:, :0:-1, ::-1], upper], axis=1)

    def table(self, farthest: float, across: float = 1.0, out: float = 0.0) -> Table:
        """Return the light of pixels by directions and radii, and these radii up to the farthest [pixels].

        Parameters
        ----------
        across
            Width along the circle that it is the mean over [pixels]: that of an edge, of a lamp out of focus.
        out
            How far such an edge is from the middle, this way and that [pixels].
        """
        edges = np.geomspace(max(0.6 * self.reach - 0.5, 0.5), farthest + 2.0, _SPANS)
        if self.lines is not None:  # as finely as fringes are known, as far as the table reaches
            fine = edges[0] + max(self.unit_px(self.lines[:, 0].min()) / 6, 0.25) * np.arange(_FINE_SPANS)
            edges = np.concatenate([fine[fine < edges[-1]], edges[edges > fine[-1]], edges[-1:]])
        rings = [
            (np.maximum(at - 0.5, edges[0]), np.maximum(at + 0.5, edges[0]))
            for at in ((edges,) if out == 0 else (edges - out, edges + out))
        ]
        return _boxes(self._light_between(self.within[1], self._beyond, rings), edges, across), edges

    def at(self, table: Table, x: Array, y: Array, own: Array = _AS_IT_IS, out: float = 0.0) -> Array:
        """Return the light of pixels (3, y, x) at places from a lamp [pixels], by a table with so much ``out``.

        ``own`` (2, 2) makes of this opening that of the lamp: the Fourier transform has its transpose.
        """
        colours, grey = self._colours
        boxes, shrunk = table[0], np.linalg.svd(own, compute_uv=False)
        near = tuple(np.flatnonzero(np.abs(side) * shrunk[1] <= grey + out + 1) for side in (y, x))
        light = np.empty((3, len(y), len(x)), np.float32)
        if len(near[0]) < len(y) or len(near[1]) < len(x):  # beyond all has one colour
            light[1] = _at_places(boxes[1:2], table[1], x, y, own)[0]
            light[0], light[2] = (np.float32(colours[k]) * light[1] for k in (0, 2))
        if len(near[0]) and len(near[1]):
            rows, columns = (slice(side[0], side[-1] + 1) for side in near)
            light[:, rows, columns] = _at_places(boxes, table[1], x[columns], y[rows], own)
        light *= np.float32(shrunk.prod())
        return np.asarray(light)

    @cached_property
    def straightest(self) -> float:
        """The length of the longest straight edge, over the opening's width; near 0 of a round one."""
        along = self.edges[:, 2:] - self.edges[:, :2]
        bins = np.floor(np.arctan2(along[:, 1], along[:, 0]) * STRAIGHT / (2 * np.pi)).astype(int) % STRAIGHT
        lengths = np.bincount(bins, np.hypot(*along.T), STRAIGHT)
        return float((lengths + np.roll(lengths, 1)).max() / self._width)


def map_of_outlines(outline: Array, own: Array) -> tuple[Array, float]:
    """Return the linear map (2, 2) of one outline (n, 2) onto another, and how far these stay apart (rms), over radii.

    By Newton's iteration across the edges; both are about their own middles, from which all is seen.
    """
    outline, own = (corners - (corners.min(axis=0) + corners.max(axis=0)) / 2 for corners in (outline, own))
    order = np.argsort(np.arctan2(own[:, 1], own[:, 0]))
    angles, radii = np.arctan2(own[order, 1], own[order, 0]), np.hypot(*own[order].T)
    factors = np.eye(3, 2)
    for _ in range(_FIT_ROUNDS):
        mapped = outline @ factors[:2] + factors[2]
        along = np.roll(mapped, -1, axis=0) - np.roll(mapped, 1, axis=0)
        across = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
        away = np.hypot(*mapped.T)
        more = np.interp(np.arctan2(mapped[:, 1], mapped[:, 0]), angles, radii, period=2 * np.pi) / away - 1
        off = more * np.sum(across * mapped, axis=1)
        terms = np.column_stack([outline, np.ones(len(outline))])
        matrix = (terms[:, :, None] * across[:, None]).reshape(len(outline), 6)
        factors = factors + np.linalg.lstsq(matrix, off, rcond=None)[0].reshape(3, 2)
    return factors[:2].T, float(np.sqrt(np.mean(off**2)) / radii.mean())


def _place_among(edges: Array) -> Callable[[NDArray[np.float32]], NDArray[np.float32]]:
    """Make a function that finds places of squared radii among edges, even in their logarithm or as those of lines."""
    last = np.float32(len(edges) - 1.001)
    first, per_step = np.float32(2 * np.log(edges[0])), np.float32(0.5 / np.log(edges[1] / edges[0]))
    is_even = np.isclose(edges[1] / edges[0], edges[-1] / edges[-2], rtol=1e-6)

    def place(square: NDArray[np.float32]) -> NDArray[np.float32]:
        if is_even:
            at = np.log(np.maximum(square, np.float32(edges[0] ** 2)))
            at -= first
            at *= per_step
        else:
            at = np.interp(np.sqrt(square), edges, np.arange(len(edges))).astype(np.float32)
        return np.asarray(np.clip(at, np.float32(0.0), last, out=at))

    return place


def _at_places(boxes: NDArray[np.float32], edges: Array, x: Array, y: Array, own: Array) -> NDArray[np.float32]:
    """Return the light of pixels (n, y, x) by boxes (n, radii, directions + 2) of some colours, as `FarLight.at`."""
    stride, place, planes = boxes.shape[2], _place_among(edges), boxes.reshape(len(boxes), -1)
    columns, rows = ((axis[:, None] * part).astype(np.float32) for axis, part in zip((x, y), own, strict=True))
    light = np.empty((len(boxes), len(y), len(x)), np.float32)
    for start in range(0, len(y), _ROWS_AT_ONCE):
        right, up = (columns[:, k] + rows[start : start + _ROWS_AT_ONCE, k : k + 1] for k in (0, 1))
        right += np.float32(1e-30)  # so that no direction is unknown
        turn = np.arctan(up / right)
        turn *= (stride - 2) / np.pi
        turn += (stride - 1) / 2
        right *= right
        up *= up
        at = place(np.add(right, up, out=right))
        i, j = np.floor(turn), np.floor(at)
        turn -= i
        at -= j
        j *= stride
        first = np.add(i, j, out=j).astype(np.int64)  # floats are exact up to 2^24
        for plane, target in zip(planes, light[:, start : start + _ROWS_AT_ONCE], strict=True):
            low, high = plane.take(first), plane[stride:].take(first)
            low += turn * (plane[1:].take(first) - low)
            high += turn * (plane[stride + 1 :].take(first) - high)
            high -= low
            high *= at
            np.add(low, high, out=target)
    return light


def _along(edges: Array, before: NDArray[np.intp], angles: Array, shift: Array, finer: int) -> Array:
    """Return |F|^2 of an opening in its widths at multiples of 1 / LINE, so many times finer, (directions, radii).

    Parameters
    ----------
    before
        Numbers of the edges that end where each begins.
    shift
        Of each line, in parts of a cell, so that what is folded back adds up without a phase.
    """
    checkpoint()
    n, along = np.stack([np.cos(angles), np.sin(angles)]), edges[:, 2:] - edges[:, :2]
    start, wide = edges[:, :2] @ n, along @ n  # (edges, directions)
    mass = along[:, ::-1] @ (n * [[1.0], [-1.0]])
    narrow = np.abs(wide) < NARROW
    slope = np.where(narrow, 0.0, mass) / np.where(narrow, 1.0, wide)
    cells, length = CELLS * finer, LINE * finer
    step = length / cells
    second = np.zeros(len(angles) * cells)
    rows = np.broadcast_to((np.arange(len(angles)) + 0.5) * cells + shift, start.shape)
    steep = mass[narrow] / NARROW
    for row, place, weight in (  # where a sum of ramps has its kinks
        (rows, start, slope - slope[before]),
        (rows[narrow], start[narrow], steep),
        (rows[narrow], start[narrow] + NARROW, -steep),
    ):
        if place.size:
            cell = (row + place / step).ravel()
            whole = cell.astype(np.int64)
            weight = weight.ravel() * step
            later = np.bincount(whole, weight * (cell - whole), len(second))
            second += np.bincount(whole, weight, len(second)) - later
            second[1:] += later[:-1]
    field = np.fft.rfft(second.reshape(len(angles), cells), axis=1)
    number = np.arange(1, cells // 2 + 1)
    folded = (number / (cells - number)) ** 3  # from beyond what cells resolve, of light that falls as the cube
    ramps = np.append(0.0, (step / (2 * np.sin(np.pi * number / cells)) ** 2) ** 2 / (1 + folded))
    light = (field.real**2 + field.imag**2) * ramps
    light[:, int((RESOLVED + 1) * length) + 1 :] = 0.0
    return np.asarray(light)


def _boxes(rings: Array, edges: Array, across: float) -> NDArray[np.float32]:
    """Return the light of pixels, of rings (radii, 3, directions) over some pixels of the circle.

    Returns
    -------
    (3, radii, directions + 2) array
        Over half a turn from straight down to straight up, and one more at each end.
    """
    count = rings.shape[2]
    first = -1 - count // 2
    half = np.minimum(0.5 * across / edges, np.pi / 4)
    pixels, half = np.maximum(2 * half * edges, 1.0), half * count / np.pi + 0.5  # of each box; and directions
    boxes = np.empty((3, len(edges), count + 2), np.float32)
    for k, ring in enumerate(rings):
        more, part = int(half[k]), half[k] % 1
        cells = ring.take(np.arange(-more, count + more + 2) + first, axis=1, mode="wrap")
        total = np.zeros((3, cells.shape[1] + 1))
        np.cumsum(cells, axis=1, out=total[:, 1:])
        light = total[:, 2 * more : 2 * more + count + 2] - total[:, 1 : count + 3]
        light += part * (cells[:, : count + 2] + cells[:, 2 * more :])
        boxes[:, k] = np.maximum(light, 0.0) * (0.5 / pixels[k])  # a half turn of the table stands for both
    return boxes


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
    return np.maximum(light, 0.0) if planes.min() >= 0 else light


def veil(planes: Array, kernel: Array, shares: Array, step: int) -> tuple[Array, float]:
    """Return the light of planes without lamps, by a kernel of squares of so many pixels, and what falls beside.

    Beside the picture it is as bright as on it; ``shares`` (3,) of all light are far light.
    """
    sides = planes.shape[1:]
    counts = [-(-side // step) for side in sides]
    (down, height), (across, width) = zip(counts, sides, strict=True)
    whole = np.pad(planes, ((0, 0), (0, down * step - height), (0, across * step - width)))
    squares = whole.reshape(-1, down, step, across * step).mean(axis=2).reshape(-1, down, across, step).mean(axis=3)
    parts = [np.clip(side / step - np.arange(count), 0.0, 1.0) for side, count in zip(sides, counts, strict=True)]
    beside = shares[:, None, None] - strew(np.broadcast_to(np.outer(*parts), squares.shape), kernel)
    light = strew(squares, kernel) + beside * planes.mean(axis=(1, 2))[:, None, None]
    nodes, places = zip(*(((np.arange(count) + 0.5) * step - 0.5, np.arange(side))
                          for count, side in zip(counts, sides, strict=True)), strict=True)  # fmt: skip
    return between(light.astype(np.float32), nodes, places), float((squares * beside).sum()) * step**2


def beside(planes: Array, kernel: Array) -> float:
    """Return the light of planes that a small kernel brings beside them, but for that which corners count twice."""
    reach, lost = kernel.shape[1] // 2, 0.0
    for axis in (1, 2):
        lines, out = planes.sum(axis=3 - axis), np.cumsum(kernel.sum(axis=3 - axis)[:, :reach], axis=1)[:, ::-1]
        near = min(reach, lines.shape[1])
        lost += float((out[:, :near] * (lines[:, :near] + lines[:, ::-1][:, :near])).sum())
    return lost


def between(light: Array, nodes: tuple[Array, Array], places: tuple[Array, Array]) -> Array:
    """Return light (n, y, x) at rows and columns between those that it is known at, and the nearest beside them."""
    for axis in (2, 1):
        known, wanted = nodes[axis - 1], places[axis - 1]
        at = np.interp(wanted, known, np.arange(len(known)))
        first = np.minimum(at.astype(np.int64), max(len(known) - 2, 0))
        part = np.expand_dims((at - first).astype(light.dtype), (0, 3 - axis))
        low = light.take(first, axis)
        light = low + (light.take(np.minimum(first + 1, len(known) - 1), axis) - low) * part
    return light
