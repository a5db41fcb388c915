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

from rptcam_cl.cameras import PupilLine, PupilRays, Split, pupil_line
from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]

STEP = 12.0  # pixels to the places round the middle of a zone that tell the plane's scale


def places_round(middle: tuple[float, float]) -> Array:
    """Return the places (5, 2) [pixels] whose rays a view needs: its middle, right, left, below, above."""
    return np.array(middle) + STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])


@dataclass(frozen=True)
class HalfView:
    """Two halves of the pupil, seen from the middle of a zone in one focus state.

    Attributes
    ----------
    rays : PupilRays
        Of the places of `places_round`.
    line : PupilLine
        Between the halves.
    split : "x" or "y"
    """

    rays: PupilRays
    line: PupilLine
    split: Split

    @classmethod
    def of(cls, rays: PupilRays, split: Split) -> HalfView:
        """Return the view of the halves of equal light."""
        return cls(rays, pupil_line(rays, split), split)

    @property
    def axis(self) -> int:
        """Along which the halves lie apart: 0 across, 1 down."""
        return 0 if self.split == "x" else 1

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array, Array]:
        """Constant and slope, over the vergence, of where rays meet a plane (n, 2) and of its scale (2, 2)."""
        at, along = self.rays.seen(0.0), self.rays.seen(1.0)
        means = [np.einsum("mn,mnk->mk", self.rays.weights, places) for places in (at, along - at)]
        scales = [np.stack([mean[1] - mean[2], mean[3] - mean[4]], axis=1) / (2 * STEP) for mean in means]
        open_ = self.rays.weights[0] > 0
        return (at[0] - means[0][0])[open_], (along[0] - at[0] - means[1][0])[open_], *scales

    @cached_property
    def shares(self) -> Array:
        """The weights (2, n) of the rays of the half before the line and of that beyond it; each sums to 1."""
        beyond = self.line.beyond(self.rays)[0]
        weights = (self.rays.weights[0] * np.stack([1 - beyond, beyond]))[:, self.rays.weights[0] > 0]
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def offsets(self, vergence: float) -> Array:
        """Return x (n, 2) of the rays that pass [pixels], for the plane at 1 / vergence [m] from the eye."""
        at, along, scale, scale_along = self._lines
        return np.asarray((at + vergence * along) @ np.linalg.inv(scale + vergence * scale_along).T)

    def displacement(self, vergence: float) -> float:
        """Return how far the picture beyond the line lies from that before it, along the split [pixels]."""
        before, beyond = self.shares @ self.offsets(vergence)
        return float((before - beyond)[self.axis])

    @property
    def nearest(self) -> float:
        """The vergence of planes that lie safely in front of the lens [1/m]."""
        ahead = -float(self.rays.origins[..., 2].min())
        return 0.8 / ahead if ahead > 0 else np.inf

    def sharpest(self) -> float:
        """Return the vergence at which the rays of the whole pupil spread least over a plane [1/m]."""
        at, along = self._lines[:2]
        weights = self.rays.weights[0][self.rays.weights[0] > 0][:, None]
        return -float(np.sum(weights * at * along) / np.sum(weights * along * along))

    def sharpest_along(self) -> tuple[float, float]:
        """Return the vergences at which the rays spread least across and least down [1/m]: apart by astigmatism."""
        at, along = self._lines[:2]
        weights = self.rays.weights[0][self.rays.weights[0] > 0][:, None]
        across, down = -np.sum(weights * at * along, axis=0) / np.sum(weights * along * along, axis=0)
        return float(across), float(down)


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
    pictures : (2, height, width) array
        Luminance through the half before the line and the half beyond it.
    noise : (2,) array
        Mean variance of a pixel.
    margin : (left, right, above, below)
        Pixels on each side that do not belong to the zone.
    """

    pictures: Array
    noise: Array
    margin: tuple[int, int, int, int]

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
        window = np.outer(_taper(height, above, below), _taper(width, left, right))
        self._spectra = np.fft.rfft2(_level(halves.pictures) * window)
        self._power = halves.noise * np.sum(window**2)
        down, across = np.abs(np.fft.fftfreq(height))[:, None], np.fft.rfftfreq(width)[None]
        resolved = (down <= HIGHEST / 2) & (across <= HIGHEST / 2)
        self._weights = np.where(resolved, self._signal_shares(), 0.0)

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
        offsets = self.view.offsets(vergence)
        one, other = (self._response(offsets, shares) for shares in self.view.shares)
        expected = self._power[0] * _square(other) + self._power[1] * _square(one)
        difference = self._spectra[0] * other - self._spectra[1] * one
        # Whitened: as a picture, so that what the edges of the pictures have spoilt stays outside the zone.
        white = np.fft.irfft2(difference * np.sqrt(self._weights / np.maximum(expected, SMALLEST)), self._shape)
        left, _, above, _ = self.halves.margin
        height, width = self.halves.zone
        return np.asarray(white[above : above + height, left : left + width] ** 2 * white.size)

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
        """Return the standard error of the vergence of least misfit, from how its slope scatters over the zone."""
        below, at, above = (self.misfits(vergence + side * step) for side in (-1, 0, 1))
        slopes, bend = (above - below) / (2 * step), float((above - 2 * at + below).sum()) / step**2
        parts = [part.sum() for rows in np.array_split(slopes, BLOCKS) for part in np.array_split(rows, BLOCKS, axis=1)]
        return float(np.linalg.norm(parts)) / bend if bend > 0 else np.inf


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
