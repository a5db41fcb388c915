"""The distance of a target from two pictures of it through the halves of a pupil.

A trial distance says what each half has done to the target's unknown picture: H1 and H2. With noise alone between them,
F1 = O H1 + noise and F2 = O H2 + noise, so that F1 H2 - F2 H1 is noise whatever O may be. Its square over its variance,
summed over the frequencies, is least at the true distance (maximum likelihood, O being profiled out). For mere
displacements it is the correlation of the two pictures; the rays of the lens add what that leaves out: that halves
blur, each in its own lopsided way, by defocus and by aberrations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.autofocus.half_view import HalfView

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Shifts = NDArray[np.int64]

HIGHEST = 0.75  # of the Nyquist frequency: beyond it pixels alias
BEYOND = 3.0  # displacement beyond the ends of the reach that trials go [pixels]
TRIAL_STEP = 0.5  # displacement between trial distances [pixels]
ROUNDS = 2  # of the refinement
POINTS = 7  # in each
SMOOTH = 2  # frequencies to each side
TAPER = 0.5  # share of the window in which it falls off
LEAST_GAIN = 45.0  # of the misfit at the best distance against the others, in units of noise
SCATTER = 1.3  # of repeated looks over what one alone tells: the weights come from the same noisy pictures
RIVAL = 0.35  # share of that gain that another distance must lack for the best to be the only one
UNLIKELY = 4.0  # times the least misfit: then it is no rival, however good
APART = 1.5  # displacement from which on it is another one [pixels]
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
    trials: Array

    @property
    def refusal(self) -> str | None:
        """Why the distance cannot be relied on; None where it can."""
        if self.significance < 5.0 or self.contrast < LEAST_CONTRAST:
            return "flat"
        if self.gain < LEAST_GAIN:
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

    def in_zone(self, half: int, right: int = 0, down: int = 0) -> Array | None:
        """Return a half's picture in the zone moved by whole pixels; None where that is beyond the picture."""
        height, width = self.zone
        top, left = self.margin[2] + down, self.margin[0] + right
        if min(top, left) < 0 or top + height > self.pictures.shape[1] or left + width > self.pictures.shape[2]:
            return None
        return self.pictures[half, top : top + height, left : left + width]


class PhaseMatch:
    """The misfit of two half pictures as a function of the vergence."""

    def __init__(self, halves: Halves, view: HalfView) -> None:
        self.halves, self.view = halves, view
        height, width = halves.zone
        self._basis = _trend(height, width)
        self._window = np.outer(_taper(height), _taper(width))
        k = [2 * np.pi * np.fft.fftfreq(height), 2 * np.pi * np.fft.rfftfreq(width)]
        self._rows, self._columns = (np.abs(along) <= HIGHEST * np.pi for along in k)
        self._k_down, self._k_across = k[0][self._rows], k[1][self._columns]
        # rfft2 keeps one of each conjugate pair, but both where the frequency across is 0.
        self._counts = np.where(self._k_across == 0, 0.5, 1.0)[None]
        self._power = halves.noise * np.sum(self._window**2)
        # A window makes neighbouring frequencies alike, so that they tell less than as many independent ones.
        self._alike = self._window.size * np.sum(self._window**4) / np.sum(self._window**2) ** 2
        self._spectra: dict[tuple[int, int, int], Complex] = {}
        self._weights = self._counts * self._signal_shares()

    def shifts(self, vergence: float) -> Shifts:
        """Return by how many whole pixels, right and down, each half displaces its picture."""
        return -np.rint(self.view.shares @ self.view.offsets(vergence)).astype(np.int64)

    def misfit(self, vergence: float, shifts: Shifts | None = None) -> float:
        """Return the sum of `misfits`, by default with the zone following the displacement; nan beyond the pictures."""
        found = self.misfits(vergence, self.shifts(vergence) if shifts is None else shifts)
        return float("nan") if found is None else float(found.sum())

    def misfits(self, vergence: float, shifts: Shifts) -> Array | None:
        """Return the misfit of every frequency, with the zone followed by whole pixels; None beyond the pictures.

        Values for the same `shifts` compare what is in the same pixels. The others differ by the noise of their edges.
        """
        one, other = (self._spectrum(half, *shifts[half].tolist()) for half in (0, 1))
        if one is None or other is None:
            return None
        offsets = self.view.offsets(vergence)
        h = [self._response(offsets + shifts[half], self.view.shares[half]) for half in (0, 1)]
        expected = self._power[0] * _square(h[1]) + self._power[1] * _square(h[0])
        return np.asarray(self._weights * _square(one * h[1] - other * h[0]) / expected)

    def _response(self, offsets: Array, weights: Array) -> Complex:
        """Return H of a half whose rays are spread over the pixels round each by a quadratic B-spline.

        That multiplies H by a positive function, the same for both halves, which cancels in the misfit.
        """
        height, width = self.halves.zone
        nearest = np.rint(offsets).astype(np.int64)
        taps = _spline(offsets - nearest)
        picture = np.zeros(height * width)
        for right in (-1, 0, 1):
            for down in (-1, 0, 1):
                at = (nearest[:, 1] + down) % height * width + (nearest[:, 0] + right) % width
                share = weights * taps[right + 1][:, 0] * taps[down + 1][:, 1]
                picture += np.bincount(at, share, minlength=len(picture))
        spectrum = np.conj(np.fft.rfft2(picture.reshape(height, width)))
        return np.asarray(spectrum[np.ix_(self._rows, self._columns)])

    def _signal_shares(self) -> Array:
        """Return the share of each frequency's power that is signal, smoothed over its neighbours.

        The weight of a frequency in the likelihood of a target with a random picture of that power: where there is
        noise alone, it would otherwise add its own scatter to the misfit, and nothing else.
        """
        spectra = [self._spectrum(half, 0, 0) for half in (0, 1)]
        power = np.mean(
            [np.abs(f) ** 2 / p for f, p in zip(spectra, self._power, strict=True) if f is not None], axis=0
        )
        near = np.pad(np.fft.fftshift(power, axes=0), SMOOTH, mode="reflect")
        size = 2 * SMOOTH + 1
        windows = np.lib.stride_tricks.sliding_window_view(near, (size, size))
        smooth = np.fft.ifftshift(windows.mean(axis=(2, 3)), axes=0)
        return np.asarray(np.clip(1.0 - 1.0 / np.maximum(smooth, 1e-30), 0.0, 1.0))

    def _spectrum(self, half: int, right: int, down: int) -> Complex | None:
        """Return the spectrum of a half's picture in the zone moved by whole pixels; None beyond its edge."""
        key = (half, right, down)
        if key not in self._spectra:
            picture = self.halves.in_zone(*key)
            if picture is None:
                return None
            level = self._level(picture) * self._window
            self._spectra[key] = np.fft.rfft2(level)[np.ix_(self._rows, self._columns)]
        return self._spectra[key]

    def _level(self, picture: Array) -> Array:
        """Return a picture less its quadratic trend: light that falls off over the zone would pass for texture."""
        flat = picture.ravel()
        return np.asarray((flat - self._basis @ (self._basis.T @ flat)).reshape(picture.shape))

    def contrast(self) -> tuple[float, float]:
        """Return the contrast of the zone in both pictures together, and its significance."""
        one, other = (self.halves.in_zone(half) for half in (0, 1))
        assert one is not None and other is not None
        whole = one + other
        noise = float(self.halves.noise.sum())
        variance = float(np.sum(self._level(whole) ** 2)) / (whole.size - self._basis.shape[1])
        mean = float(whole.mean())
        if not mean > 0 or noise <= 0:
            return 0.0, 0.0
        return np.sqrt(max(variance - noise, 0.0)) / mean, (variance / noise - 1) / np.sqrt(2 / whole.size)

    def best(self, low: float, high: float) -> Match | None:
        """Return the best vergence between about two, the pictures permitting; None when they show nothing."""
        if not (self._power > 0).all():
            return None
        slope = abs(self.view.displacement(high) - self.view.displacement(low)) / (high - low)
        low, high = low - BEYOND / slope, min(high + BEYOND / slope, self.view.nearest)
        count = int((high - low) * slope / TRIAL_STEP) + 2
        trials = np.linspace(low, high, count)
        misfits = np.array([self.misfit(trial) for trial in trials])
        if np.isfinite(misfits).sum() < POINTS:
            return None
        at = int(np.nanargmin(misfits))
        vergence, error, least = self._refined(trials[at], (high - low) / (count - 1))
        shown = np.array([self.view.displacement(trial) for trial in trials])
        displacement = self.view.displacement(vergence)
        scale = max(least / self._degrees, 1.0) * self._alike
        level = float(np.nanmedian(misfits))
        gain = max(level - least, 0.0) / scale
        contrast, significance = self.contrast()
        return Match(
            vergence=vergence,
            error=error,
            displacement=displacement,
            displacement_error=error * slope,
            gain=gain,
            rival=_rival(misfits, shown, displacement, level, least),
            contrast=contrast,
            significance=significance,
            trials=np.stack([shown, misfits], axis=1),
        )

    @property
    def _degrees(self) -> float:
        return float(self._weights.sum())

    def _refined(self, start: float, step: float) -> tuple[float, float, float]:
        """Return the vergence of the least misfit, its standard error, and that misfit."""
        shifts, wide = self.shifts(start), 2 * step
        for _ in range(ROUNDS):
            points = start + np.linspace(-1, 1, POINTS) * wide
            misfits = np.array([self.misfit(point, shifts) for point in points])
            least = points[np.argmin(misfits)]
            a, b, _ = np.polyfit((points - start) / wide, misfits, 2)
            vertex = start - b / (2 * a) * wide if a > 0 else least
            start = vertex if abs(vertex - least) <= 2 * wide / (POINTS - 1) else least
            wide /= 2
        return float(start), self._error(start, wide, shifts), float(misfits.min())

    def _error(self, vergence: float, step: float, shifts: Shifts) -> float:
        """Return the standard error of the vergence of least misfit, from the scatter of its slope over frequencies."""
        below, at, above = (self.misfits(vergence + side * step, shifts) for side in (-1, 0, 1))
        if below is None or at is None or above is None:
            return np.inf
        slopes, bend = (above - below) / (2 * step), float((above - 2 * at + below).sum()) / step**2
        return SCATTER * float(np.sqrt(self._alike * np.sum(slopes**2))) / bend if bend > 0 else np.inf


def _spline(x: Array) -> list[Array]:
    """Return the quadratic B-spline at -1, 0 and 1 from x, which lies within half of 0."""
    return [0.5 * (0.5 - x) ** 2, 0.75 - x * x, 0.5 * (0.5 + x) ** 2]


def _square(values: Complex) -> Array:
    return np.asarray(values.real**2 + values.imag**2)


def _rival(misfits: Array, shown: Array, displacement: float, level: float, least: float) -> float:
    """Return how good the next best distance is against the best one."""
    inner = misfits[1:-1]
    dips = 1 + np.flatnonzero((inner <= misfits[:-2]) & (inner <= misfits[2:]))
    others = dips[np.abs(shown[dips] - displacement) > APART]
    if not len(others) or level <= least or misfits[others].min() > UNLIKELY * least:
        return 0.0
    return float(max((level - misfits[others].min()) / (level - least), 0.0))


def _taper(count: int) -> Array:
    """A window that is flat in its middle and falls off by half a cosine."""
    away = np.minimum(np.arange(count) + 0.5, count - np.arange(count) - 0.5) / count
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.minimum(away / (TAPER / 2), 1.0)))


def _trend(height: int, width: int) -> Array:
    """Return an orthonormal basis (pixels, 6) of the quadratics over a window."""
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).reshape(-1, 6)
    return np.asarray(np.linalg.qr(terms)[0])
