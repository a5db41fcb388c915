"""The distance of a target from two pictures of it through the halves of a pupil.

A place f of the picture gathers the light of points of a plane of the scene, one for each ray of its pupil. Let O be
the plane's own picture, in which f lies where the mean ray of the whole pupil meets the plane, and f + x where another
ray does. A half then shows I(f) = sum w O(f + x) over its rays: O, displaced by the mean of x and blurred by its
spread. Its Fourier transform is that of O times H(k) = sum w exp(i k x).

A trial distance says what each half has done to the target's unknown picture: H1 and H2. With noise alone between them,
F1 = O H1 + noise and F2 = O H2 + noise, so that F1 H2 - F2 H1 is noise whatever O may be. Its square over its variance,
summed over the frequencies, is least at the true distance (maximum likelihood, O being profiled out). For mere
displacements it is the correlation of the two pictures; the rays of the lens add what that leaves out: that halves
blur, each in its own lopsided way, by defocus and by aberrations.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.focusing.half_view import HalfView

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

HIGHEST = 0.75  # of the Nyquist frequency: beyond it pixels alias
BEYOND = 3.0  # displacement beyond the ends of the reach that trials go [pixels]
TRIAL_STEP = 0.5  # displacement between trial distances [pixels]
ROUNDS = 2  # of the refinement
POINTS = 7  # in each
SMOOTH = 2  # frequencies to each side
TERMS = 6  # of a quadratic
BLOCKS = 6  # of the zone each way, whose noise is nearly independent
SMALLEST = 1e-30  # keeps 0 / 0 away where both halves blur everything, and where even light has no noise
LEAST_GAIN = 150.0  # of the misfit at the best distance against the others, in units of noise
RIVAL = 0.35  # share of that gain that another distance must lack for the best to be the only one
UNLIKELY = 4.0  # times the least misfit: then it is no rival, however good
APART = 1.5  # displacement from which on it is another one [pixels]
LEAST_ALONG = 0.1  # of those changes
LAG = 4  # pixels, over which they are taken
LEAST_SIGNIFICANCE = 5.0  # of the contrast, in standard errors
LEAST_CONTRAST = 0.002  # standard deviation over mean


@dataclass(frozen=True)
class Match:
    """What two half pictures say about the distance of their target.

    Attributes
    ----------
    vergence : float
        1 / distance from the eye [1/m].
    error : float
        Its standard error from noise and misfit.
    displacement, displacement_error : float
        Between the two pictures, as that distance has it [pixels].
    gain : float
        How much better the distance fits than others do, in units of noise.
    rival : float
        Share of that which the next best distance has; 1 where it is as good.
    contrast : float
        Standard deviation of the target's picture over its mean, without noise.
    significance : float
        Of that contrast, in standard errors.
    along : float
        Share of the target's changes that lie along the split; those across it say nothing.
    trials : (n, 2) array
        Trial displacements [pixels] and their misfits.
    """

    vergence: float
    error: float
    displacement: float
    displacement_error: float
    gain: float
    rival: float
    contrast: float
    significance: float
    along: float
    trials: Array

    @property
    def refusal(self) -> str | None:
        """Why the distance cannot be relied on; None where it can."""
        if self.significance < LEAST_SIGNIFICANCE or self.contrast < LEAST_CONTRAST:
            return "flat"
        if self.gain < LEAST_GAIN or self.along < LEAST_ALONG:
            return "vague"
        return "ambiguous" if self.rival > RIVAL else None


@dataclass(frozen=True)
class Halves:
    """Two pictures of a zone and its surroundings.

    Attributes
    ----------
    parts : (2, count, height, width) array
        Luminance through the half before the line and the half beyond it, taken `count` times with independent noise.
    margin : (left, right, above, below)
        Pixels on each side that do not belong to the zone.
    """

    parts: Array
    margin: tuple[int, int, int, int]

    @cached_property
    def pictures(self) -> Array:
        """The means of the parts (2, height, width)."""
        return np.asarray(self.parts.mean(axis=1))

    @cached_property
    def noise(self) -> Array:
        """Mean variance of a pixel of each picture (2,)."""
        return np.asarray(self.parts.var(axis=1, ddof=1).mean(axis=(1, 2)) / self.parts.shape[1])

    @property
    def zone(self) -> tuple[int, int]:
        """Height and width of the zone [pixels]."""
        height, width = self.pictures.shape[1:]
        left, right, above, below = self.margin
        return height - above - below, width - left - right

    @property
    def in_zone(self) -> Array:
        """The pictures in the zone (2, height, width)."""
        left, _, above, _ = self.margin
        height, width = self.zone
        return self.pictures[:, above : above + height, left : left + width]


class PhaseMatch:
    """The misfit of two half pictures as a function of the vergence."""

    def __init__(self, halves: Halves, view: HalfView) -> None:
        self.halves, self.view = halves, view
        height, width = self._shape = halves.pictures.shape[1:]
        left, right, above, below = halves.margin
        self._window = window = np.outer(_taper(height, above, below), _taper(width, left, right))
        self._spectra = self._spectra_of(halves.pictures)
        self._power = halves.noise * np.sum(window**2)
        down, across = np.abs(np.fft.fftfreq(height))[:, None], np.fft.rfftfreq(width)[None]
        resolved = (down <= HIGHEST / 2) & (across <= HIGHEST / 2)
        self._weights = np.where(resolved, self._signal_shares(), 0.0)

    def _spectra_of(self, pictures: Array) -> Complex:
        return np.asarray(np.fft.rfft2(_level(pictures) * self._window))

    def _signal_shares(self) -> Array:
        """Return the share of each frequency's power that is signal, smoothed over its neighbours.

        The weight of a frequency in the likelihood of a target with a random picture of that power: where there is
        noise alone, it would otherwise add its own scatter to the misfit, and nothing else.
        """
        power = np.mean(_square(self._spectra) / np.maximum(self._power, SMALLEST)[:, None, None], axis=0)
        near = np.pad(np.fft.fftshift(power, axes=0), SMOOTH, mode="reflect")
        size = 2 * SMOOTH + 1
        windows = np.lib.stride_tricks.sliding_window_view(near, (size, size))
        smooth = np.fft.ifftshift(windows.mean(axis=(2, 3)), axes=0)
        return np.asarray(np.clip(1.0 - 1.0 / np.maximum(smooth, 1.0), 0.0, 1.0))

    def misfits(self, vergence: float) -> Array:
        """Return the misfit of every pixel of the zone; noise alone gives 1 to each independent number."""
        return np.asarray(self._misfits_of(self._spectra[None], vergence)[0])

    def _misfits_of(self, spectra: Complex, vergence: float) -> Array:
        """Return the misfits (n, height, width) of spectra (n, 2, …) of both pictures."""
        offsets = self.view.offsets(vergence)
        one, other = (self._response(offsets, shares) for shares in self.view.shares)
        expected = self._power[0] * _square(other) + self._power[1] * _square(one)
        difference = spectra[:, 0] * other - spectra[:, 1] * one
        # Whitened: as a picture, so that what the edges of the pictures have spoilt stays outside the zone.
        white = np.fft.irfft2(difference * np.sqrt(self._weights / np.maximum(expected, SMALLEST)), self._shape)
        left, _, above, _ = self.halves.margin
        height, width = self.halves.zone
        return np.asarray(white[:, above : above + height, left : left + width] ** 2 * white[0].size)

    def misfit(self, vergence: float) -> float:
        """Return the sum of `misfits`."""
        return float(self.misfits(vergence).sum())

    def _response(self, offsets: Array, weights: Array) -> Complex:
        """Return H of a half whose rays are spread over the pixels round each by a quadratic B-spline.

        That multiplies H by a positive function, the same for both halves, which cancels in the misfit.
        """
        height, width = self._shape
        nearest = np.rint(offsets).astype(np.int64)
        taps = _spline(offsets - nearest)
        picture = np.zeros(height * width)
        for right in (-1, 0, 1):
            for down in (-1, 0, 1):
                at = (nearest[:, 1] + down) % height * width + (nearest[:, 0] + right) % width
                share = weights * taps[right + 1][:, 0] * taps[down + 1][:, 1]
                picture += np.bincount(at, share, minlength=len(picture))
        return np.asarray(np.conj(np.fft.rfft2(picture.reshape(height, width))))

    def along(self) -> float:
        """Return the share of the zone's changes over a few pixels, less those of noise, that lie along the split."""
        whole, noise = self.halves.in_zone.sum(axis=0), float(self.halves.noise.sum())
        steps = whole[:, LAG:] - whole[:, :-LAG], whole[LAG:] - whole[:-LAG]
        across, down = (max(float(np.mean(step**2)) - 2 * noise, 0.0) if step.size else 0.0 for step in steps)
        return (across, down)[self.view.axis] / (across + down) if across + down > 0 else 0.5

    def contrast(self) -> tuple[float, float]:
        """Return the contrast of the zone in both pictures together, and its significance."""
        whole = self.halves.in_zone.sum(axis=0)
        noise, mean = float(self.halves.noise.sum()), float(whole.mean())
        if not mean > 0 or noise <= 0:
            return 0.0, 0.0
        variance = float(np.sum(_level(whole[None]) ** 2)) / (whole.size - TERMS)
        significance = (variance / noise - 1) * math.sqrt(whole.size / 2)
        return math.sqrt(max(variance - noise, 0.0)) / mean, significance

    def best(self, low: float, high: float) -> Match | None:
        """Return the best vergence between about two; None where there is nothing to go by."""
        if not (self._power > 0).all() or not self._weights.any():
            return None
        slope = abs(self.view.displacement(high) - self.view.displacement(low)) / (high - low)
        low, high = low - BEYOND / slope, min(high + BEYOND / slope, self.view.nearest)
        trials = np.linspace(low, high, max(int((high - low) * slope / TRIAL_STEP) + 2, POINTS))
        misfits = np.array([self.misfit(trial) for trial in trials])
        vergence, error, least = self._refined(trials[int(np.argmin(misfits))], trials[1] - trials[0])
        shown = np.array([self.view.displacement(trial) for trial in trials])
        displacement = self.view.displacement(vergence)
        level = float(np.median(misfits))
        contrast, significance = self.contrast()
        return Match(
            vergence=vergence,
            error=error,
            displacement=displacement,
            displacement_error=error * slope,
            gain=max(level - least, 0.0) / max(least / self._degrees, 1.0),
            rival=_rival(misfits, shown, displacement, level, least),
            contrast=contrast,
            significance=significance,
            along=self.along(),
            trials=np.stack([shown, misfits / self._degrees], axis=1),
        )

    @property
    def _degrees(self) -> float:
        """How many independent numbers the zone holds."""
        twice = np.where(np.arange(self._weights.shape[1]) > 0, 2.0, 1.0)  # rfft2 keeps one of each conjugate pair
        height, width = self.halves.zone
        return max(float(np.sum(twice * self._weights)) * height * width / math.prod(self._shape), 1.0)

    def _refined(self, start: float, step: float) -> tuple[float, float, float]:
        """Return the vergence of the least misfit, its standard error, and that misfit."""
        wide = 2 * step
        for _ in range(ROUNDS):
            points = start + np.linspace(-1, 1, POINTS) * wide
            misfits = np.array([self.misfit(point) for point in points])
            least = points[np.argmin(misfits)]
            a, b, _ = np.polyfit((points - start) / wide, misfits, 2)
            vertex = start - b / (2 * a) * wide if a > 0 else least
            start = vertex if abs(vertex - least) <= 2 * wide / (POINTS - 1) else least
            wide /= 2
        return float(start), self._error(start, wide), float(misfits.min())

    def _error(self, vergence: float, step: float) -> float:
        """Return the standard error of the vergence of least misfit.

        The greater of two, as both fall short where they see little: how its slope scatters over the zone, which holds
        what does not fit, but is blind where one block has all the detail; and how it moves without one of the parts.
        """
        below, at, above = (self.misfits(vergence + side * step) for side in (-1, 0, 1))
        slopes, bend = (above - below) / (2 * step), float((above - 2 * at + below).sum()) / step**2
        if not bend > 0:
            return np.inf
        rows = np.array_split(slopes, BLOCKS)
        blocks = [block.sum() for row in rows for block in np.array_split(row, BLOCKS, axis=1)]
        return max(float(np.linalg.norm(blocks)), self._jackknife(vergence, step)) / bend

    def _jackknife(self, vergence: float, step: float) -> float:
        """Return the standard error of the slope of the misfit, from leaving out one part of one half after another."""
        parts = self.halves.parts
        count = parts.shape[1]
        without = (count * self.halves.pictures[:, None] - parts) / (count - 1)
        spectra = np.tile(self._spectra, (2, count, 1, 1, 1))
        for half in (0, 1):
            spectra[half, :, half] = self._spectra_of(without[half])
        spectra = spectra.reshape(2 * count, *self._spectra.shape)
        below, above = (self._misfits_of(spectra, vergence + side * step).sum(axis=(1, 2)) for side in (-1, 1))
        slopes = ((above - below) / (2 * step)).reshape(2, count)
        return math.sqrt((count - 1) * float(slopes.var(axis=1).sum()))


def _square(values: Complex) -> Array:
    return np.asarray(values.real**2 + values.imag**2)


def _spline(x: Array) -> list[Array]:
    """Return the quadratic B-spline at -1, 0 and 1 from x, which lies within half of 0."""
    return [0.5 * (0.5 - x) ** 2, 0.75 - x * x, 0.5 * (0.5 + x) ** 2]


def _rival(misfits: Array, shown: Array, displacement: float, level: float, least: float) -> float:
    """Return how good the next best distance is against the best one."""
    inner = misfits[1:-1]
    dips = 1 + np.flatnonzero((inner <= misfits[:-2]) & (inner <= misfits[2:]))
    others = dips[np.abs(shown[dips] - displacement) > APART]
    if not len(others) or level <= least or misfits[others].min() > UNLIKELY * least:
        return 0.0
    return float(max((level - misfits[others].min()) / (level - least), 0.0))


def _taper(count: int, before: int, behind: int) -> Array:
    """A window that is 1 in the zone and falls off by half a cosine over the margins."""
    place = np.arange(count) + 0.5
    share = np.minimum(place / max(before, 0.5), (count - place) / max(behind, 0.5))
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(share, 0.0, 1.0)))


def _level(pictures: Array) -> Array:
    """Return pictures (n, height, width) less their quadratic trends: light that falls off would pass for texture."""
    count, height, width = pictures.shape
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).reshape(-1, TERMS)
    basis, flat = np.linalg.qr(terms)[0], pictures.reshape(count, -1)
    return np.asarray((flat - (flat @ basis) @ basis.T).reshape(pictures.shape))
