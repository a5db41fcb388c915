"""The far light of a lamp: what its opening, with dust and scratches, diffracts beyond the kernel about each pixel.

An opening is a set of edges, seen along a line in each direction: how wide it is open there is a sum of ramps, and the
Fourier transform of that line is the field in this direction (the projection-slice theorem). Light of a wavelength is
that of another, scaled; so one table over directions and radii, summed up over both, gives all of them in every pixel.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.diffraction_kernel import fade, shares_of_white
from rptcam_cl.rendering.patch_blur import quick
from rptcam_cl.rendering.shares import GOLDEN

Array = NDArray[np.float64]

ANGLES = 4096  # directions over half a turn; the other half is alike
CELLS, LINE = 8192, 2.5  # of the line that an opening is seen along, and its length in widths of the opening
RESOLVED = 1024.0  # wavelengths times f-number up to which the light is computed; beyond it falls as its cube
BANDS, SPANS = 448, 384  # radii, evenly in their logarithm, of that light and of the film's
WAVES_NM = tuple(np.arange(405.0, 700.0, 5.0).tolist())
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
        low = 0.5 * self.reach / self.unit_px(WAVES_NM[-1])
        radii = np.geomspace(min(low, RESOLVED / 4), RESOLVED, BANDS)
        edges = (self.edges - np.tile(self._middle, 2)) / self._width
        found = np.zeros((ANGLES, BANDS))
        rho = np.arange(CELLS // 2 + 1) / LINE
        to_share = 2 * (np.pi / ANGLES) / LINE / (self._area / self._width**2)
        for start in range(0, ANGLES, AT_ONCE):
            angles = np.pi * (np.arange(start, min(start + AT_ONCE, ANGLES)) + 0.5) / ANGLES
            light = _along(edges, angles) * to_share * rho
            total = np.cumsum(light, axis=1)
            found[start : start + AT_ONCE] = [np.interp(radii, rho + 0.5 / LINE, line) for line in total]
        return radii, found - found[:, :1]

    @property
    def _middle(self) -> Array:
        corners = self.edges[:, :2]
        return np.asarray((corners.max(axis=0) + corners.min(axis=0)) / 2)

    @cached_property
    def _beyond(self) -> Array:
        """Light of each direction beyond what is resolved, by that of the outer half of it (directions,)."""
        radii, found = self.within
        half = int(np.searchsorted(radii, RESOLVED / 2))
        return np.asarray((found[:, -1] - found[:, half]) / (RESOLVED / radii[half] - 1))

    def _weights(self, pixels: Array) -> tuple[Array, Array]:
        """Return what light within `within` and beyond counts within radii [pixels], (BANDS, 3, n) and (3, n)."""
        radii, columns = self.within[0], np.arange(len(pixels))
        inner, outer = np.zeros((BANDS, 3, len(pixels))), np.zeros((3, len(pixels)))
        for nm, shares in zip(WAVES_NM, shares_of_white(WAVES_NM), strict=True):
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
        table = _summed(np.moveaxis(light, 1, 0))
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


def _summed(light: Array) -> Array:
    """Return light (3, directions, radii) summed up over directions from none, and half as many more on each side."""
    table = np.cumsum(np.pad(light, ((0, 0), (1, 0), (0, 0))), axis=1)
    whole = table[:, -1:]
    return np.concatenate([table[:, ANGLES // 2 : -1] - whole, table, table[:, 1 : ANGLES // 2 + 1] + whole], axis=1)


def _boxes(table: Array, edges: Array, radius: Array, angle: Array) -> Array:
    """Return the light (3, n) of boxes of one pixel about places, of a table summed over directions."""
    log = np.log(edges[1] / edges[0])
    found = np.zeros((3, len(radius)))
    half = np.minimum(0.5 / radius, np.pi / 4)
    for outer in (-0.5, 0.5):
        at = np.clip(np.log(np.maximum(radius + outer, edges[0]) / edges[0]) / log, 0, len(edges) - 1.001)
        for side in (-1, 1):
            to = (angle + side * half) * ANGLES / np.pi + ANGLES // 2
            i, j = to.astype(np.int64), at.astype(np.int64)
            u, v = to - i, at - j
            value = (table[:, i, j] * (1 - u) + table[:, i + 1, j] * u) * (1 - v)
            value += (table[:, i, j + 1] * (1 - u) + table[:, i + 1, j + 1] * u) * v
            found += value * (side * (1 if outer > 0 else -1))
    return np.maximum(found, 0.0) / 2  # a half turn of the table stands for both


def lamps_of(planes: Array) -> Array:
    """Return planes (3, height, width) of the pixels alone that outshine the mean of their film."""
    brightness = planes.max(axis=0)
    return np.asarray(planes * (brightness > LAMP * brightness.mean()))


def strewn(planes: Array, kernel: Array) -> Array:
    """Return the light of planes (3, height, width) on them, by a kernel of twice the whole film or more.

    What falls beside them is lost.
    """
    height, width = planes.shape[1:]
    top, left = kernel.shape[1] // 2 - height + 1, kernel.shape[2] // 2 - width + 1
    found = np.empty_like(planes)
    shape = tuple(quick(2 * side - 1) for side in (height, width))
    for plane, part, target in zip(planes, kernel, found, strict=True):
        own = part[top : top + 2 * height - 1, left : left + 2 * width - 1]
        product = np.fft.rfft2(plane, shape) * np.fft.rfft2(own, shape)
        target[:] = np.fft.irfft2(product, shape)[height - 1 : 2 * height - 1, width - 1 : 2 * width - 1]
    return np.maximum(found, 0.0)
