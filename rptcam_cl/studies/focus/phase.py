"""Phase detection: the move to the focus, predicted from the two halves of the pupil; with contrast, hybrid focus."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.cameras.film_pupil import STEP, HalfView, Split, halved, places_round
from rptcam_cl.studies.focus.contrast import focus_by_contrast, greatest_contrast, no_contrast, state_within_reach
from rptcam_cl.studies.focus.drives import Drive
from rptcam_cl.studies.focus.probe import (
    BEST,
    MEASURES,
    TERMS,
    Estimate,
    FocusReport,
    NoContrast,
    OutOfReach,
    Policy,
    Probe,
    ProbeRecord,
    Zone,
    ZoneImage,
    block_sums,
    choose_zone,
    circle_of_confusion,
    rich_part,
    without_trend,
)
from rptcam_cl.studies.focus.renderer import (
    CONTENT,
    DEAR,
    HOPELESS,
    MOST_OF_SEARCH,
    ProbeRenderer,
    Task,
    clearer_light,
    probability_within,
)

#
# The distance of a target from two pictures of it through the halves of a pupil.
#
# A place f of the picture gathers the light of points of a plane of the scene, one for each ray of its pupil. Let O
# be the plane's own picture, in which f lies where the mean ray of the whole pupil meets the plane, and f + x where
# another ray does. A half then shows I(f) = sum w O(f + x) over its rays: O, displaced by the mean of x and blurred
# by its spread. Its Fourier transform is that of O times H(k) = sum w exp(i k x).
#
# A trial distance says what each half has done to the target's unknown picture: H1 and H2. With noise alone between
# them, F1 = O H1 + noise and F2 = O H2 + noise, so that F1 H2 - F2 H1 is noise whatever O may be. Its square over its
# variance, summed over the frequencies, is least at the true distance (maximum likelihood, O being profiled out). For
# mere displacements it is the correlation of the two pictures; the rays of the lens add what that leaves out: that
# halves blur, each in its own lopsided way, by defocus and by aberrations.

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

HIGHEST = 0.75  # of the Nyquist frequency: beyond it pixels alias
BEYOND = 3.0  # displacement beyond the ends of the reach that trials go [pixels]
_TRIAL_STEP = 0.5  # displacement between trial distances [pixels]
ROUNDS = 2  # of the refinement
POINTS = 7  # in each
SMOOTH = 2  # frequencies to each side
SMALLEST = 1e-30  # keeps 0 / 0 away where both halves blur everything, and where even light has no noise
_LEAST_GAIN = 150.0  # of the misfit at the best distance against the others, in units of noise
_NEAR_GAIN = 30.0  # the same among distances near one that rays tell
_RIVAL = 0.35  # share of that gain that another distance must lack for the best to be the only one
_UNLIKELY = 4.0  # times the least misfit: then it is no rival, however good
APART = 1.5  # displacement from which on it is another one [pixels]
_LEAST_ALONG = 0.1  # of those changes
_LAG = 4  # pixels, over which they are taken
_LEAST_SIGNIFICANCE = 5.0  # of the contrast, in standard errors
LEAST_CONTRAST = 0.002  # standard deviation over mean
BINS = (1, 2, 4)  # pixels each way whose means show them


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

    @property
    def refusal(self) -> str | None:
        """Why the distance cannot be relied on; None where it can."""
        return self.refusal_among(_LEAST_GAIN)

    def refusal_among(self, least_gain: float) -> str | None:
        """Return the same with another gain that is enough: among few distances a smaller one."""
        if self.significance < _LEAST_SIGNIFICANCE or self.contrast < LEAST_CONTRAST:
            return "flat"
        if self.gain < least_gain or self.along < _LEAST_ALONG:
            return "vague"
        return "ambiguous" if self.rival > _RIVAL else None

    def is_promising(self, more: float) -> bool:
        """Whether so many times the samples may show what these do not: significance and gain grow with them."""
        return more > 1 and self.significance * more > _LEAST_SIGNIFICANCE and self.contrast > LEAST_CONTRAST / 2


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
        return np.asarray(np.fft.rfft2(without_trend(pictures) * self._window))

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
        one, other = (self._response(offsets[shares > 0], shares[shares > 0]) for shares in self.view.shares)
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
        right, down = np.moveaxis(_spline(offsets - nearest), 2, 0)  # (3, n) each
        columns, rows = (nearest.T[:, None] + _BESIDE) % np.array([width, height])[:, None, None]
        at, shares = rows[:, None] * width + columns, weights * down[:, None] * right
        picture = np.bincount(at.ravel(), shares.ravel(), minlength=height * width)
        return np.asarray(np.conj(np.fft.rfft2(picture.reshape(height, width))))

    def along(self) -> float:
        """Return the share of the zone's changes over a few pixels, less those of noise, that lie along the split."""
        whole, noise = self.halves.in_zone.sum(axis=0), float(self.halves.noise.sum())
        steps = whole[:, _LAG:] - whole[:, :-_LAG], whole[_LAG:] - whole[:-_LAG]
        across, down = (max(float(np.mean(step**2)) - 2 * noise, 0.0) if step.size else 0.0 for step in steps)
        return (across, down)[self.view.axis] / (across + down) if across + down > 0 else 0.5

    def contrast(self) -> tuple[float, float]:
        """Return the contrast of the zone in both pictures together, and its significance."""
        whole = self.halves.in_zone.sum(axis=0)
        noise, mean = float(self.halves.noise.sum()), float(whole.mean())
        if not mean > 0 or noise <= 0:
            return 0.0, 0.0
        for side in BINS:  # noise is finer than details
            rows, columns = (count // side for count in whole.shape)
            means = whole[: rows * side, : columns * side].reshape(rows, side, columns, side).mean(axis=(1, 3))
            variance = float(np.sum(without_trend(means[None]) ** 2)) / (means.size - TERMS) * side**2
            significance = (variance / noise - 1) * math.sqrt(means.size / 2)
            if significance >= _LEAST_SIGNIFICANCE or means.size <= 8 * TERMS:
                break
        contrast = math.sqrt(max(variance - noise, 0.0)) / side / mean
        return contrast, significance

    def best(self, low: float, high: float) -> Match | None:
        """Return the best vergence between about two; None where there is nothing to go by."""
        if not (self._power > 0).all() or not self._weights.any():
            return None
        slope = abs(self.view.displacement(high) - self.view.displacement(low)) / (high - low)
        low, high = low - BEYOND / slope, min(high + BEYOND / slope, self.view.nearest)
        trials = np.linspace(low, high, max(int((high - low) * slope / _TRIAL_STEP) + 2, POINTS))
        misfits = np.array([self.misfit(trial) for trial in trials])
        vergence, error, least = self._refine(trials[int(np.argmin(misfits))], trials[1] - trials[0])
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
        )

    @property
    def _degrees(self) -> float:
        """How many independent numbers the zone holds."""
        twice = np.where(np.arange(self._weights.shape[1]) > 0, 2.0, 1.0)  # rfft2 keeps one of each conjugate pair
        height, width = self.halves.zone
        return max(float(np.sum(twice * self._weights)) * height * width / math.prod(self._shape), 1.0)

    def _refine(self, start: float, step: float) -> tuple[float, float, float]:
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
        return max(float(np.linalg.norm(block_sums(slopes))), self._jackknife(vergence, step)) / bend

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


_BESIDE = np.array([[-1], [0], [1]])


def _spline(x: Array) -> Array:
    """Return the quadratic B-spline at -1, 0 and 1 from x, which lies within half of 0."""
    return np.stack([0.5 * (0.5 - x) ** 2, 0.75 - x * x, 0.5 * (0.5 + x) ** 2])


def _rival(misfits: Array, shown: Array, displacement: float, level: float, least: float) -> float:
    """Return how good the next best distance is against the best one."""
    inner = misfits[1:-1]
    dips = 1 + np.flatnonzero((inner <= misfits[:-2]) & (inner <= misfits[2:]))
    others = dips[np.abs(shown[dips] - displacement) > APART]
    if not len(others) or level <= least or misfits[others].min() > _UNLIKELY * least:
        return 0.0
    return float(max((level - misfits[others].min()) / (level - least), 0.0))


def _taper(count: int, before: int, behind: int) -> Array:
    """A window that is 1 in the zone and falls off by half a cosine over the margins."""
    place = np.arange(count) + 0.5
    share = np.minimum(place / max(before, 0.5), (count - place) / max(behind, 0.5))
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(share, 0.0, 1.0)))


#
# Phase detection: the move to the focus, predicted from the two halves of the pupil.
#
# A probe through both halves shows how far away the target is (`phase_match`), and the lens knows the state that
# makes it sharpest. The first probe goes through a stop so small that the displacement over the whole reach of the
# lens stays within the zone; the next ones go through the opening of the picture, where displacements are large and
# the distance is precise.

_MARGIN_STEP = 4  # margins are multiples of so many pixels, so that probes can share their buffers


@dataclass(frozen=True)
class HalfProbe:
    """A probe at a zone through the two halves of the pupil.

    Attributes
    ----------
    state, stop : float
        As in `ProbeRenderer.measure`.
    view : HalfView
        What the halves do to the picture of a plane at any distance.
    halves : Halves
        The pictures.
    samples : int
        Camera rays of all pixels; half of them begin a path.
    seconds : float
    match : Match or None
        What a search made of it; None where that has nothing to go by.
    """

    state: float
    stop: float
    view: HalfView
    halves: Halves
    samples: int
    seconds: float
    match: Match | None = None


def half_view(renderer: ProbeRenderer, state: float, zone: Zone, split: Split, stop: float = 1.0) -> HalfView:
    """Return the halves of the pupil that the middle of a zone sees in a focus state."""
    across, down = zone.centre
    width, height = renderer.choose_zones([zone]).resolution
    middle = min(max(across * width, STEP), width - STEP), min(max(down * height, STEP), height - STEP)
    return HalfView(renderer.rays(state, places_round(middle), stop), split)


DETAILS = (0.125, 0.25)  # cycles per pixel of a probe, of what contrast sees


def clearest_beside(renderer: ProbeRenderer, state: float, zone: Zone, split: Split = "x") -> float:
    """Return how far from the least spot details may be clearest [depths of focus]."""
    view, sharp = half_view(renderer, state, zone, split), renderer.drive.sharp_vergence(state)
    return max(abs(view.clearest(cycles) - view.sharpest()) / sharp for cycles in DETAILS)


def measure_halves(
    renderer: ProbeRenderer, state: float, zones: Sequence[Zone], samples: int, seed: int, split: Split = "x"
) -> list[tuple[ZoneImage, ZoneImage]]:
    """Render zones through the left and the right half of the pupil, or the lower and the upper one.

    The parameters are those of `ProbeRenderer.measure`. Halves are of equal light in the middle of each zone, and of
    independent noise.
    """
    return [
        _render_halves(renderer, half_view(renderer, state, zone, split), state, zone, samples, seed, 1.0)
        for zone in zones
    ]


def half_probe(
    renderer: ProbeRenderer,
    view: HalfView,
    state: float,
    zone: Zone,
    samples: int,
    seed: int,
    stop: float = 1.0,
    margin: tuple[int, int] = (0, 0),
) -> dict[Light, HalfProbe]:
    """Return a probe through halves, with a limit on bright samples and, where some are, in all of the light.

    Parameters
    ----------
    samples
        Per pixel of both halves together.
    margin
        Pixels across and down to show beyond the zone, at least.
    """
    begun = time.perf_counter()
    across, down = (-(-pixels // _MARGIN_STEP) * _MARGIN_STEP for pixels in margin)
    margins = renderer.choose_zones([zone], (across, down)).margins(zone)
    images = _render_halves(renderer, view, state, zone, samples, seed, stop)
    taken = 2 * images[0].samples * images[0].parts[0, ..., 0].size
    seconds, probes = time.perf_counter() - begun, {}
    for light in _LIGHTS if any(image.whole is not None for image in images) else _LIGHTS[:1]:
        parts = np.stack([image.in_light(light).luminance for image in images])
        mean = parts.mean(axis=(1, 2, 3), keepdims=True)
        halves = Halves(parts / np.where(mean > 0, mean, 1.0), margins)
        probes[light] = HalfProbe(state, stop, view, halves, taken, seconds)
    return probes


def _render_halves(
    renderer: ProbeRenderer, view: HalfView, state: float, zone: Zone, samples: int, seed: int, stop: float
) -> tuple[ZoneImage, ZoneImage]:
    """Render a zone through the half before the line and through that beyond it.

    With the same random numbers the noise of the halves would be each other's negative. Two seeds avoid that.
    """
    camera = renderer.camera(state, stop)
    before, beyond = (
        renderer.render(halved(camera, view.line, beyond=half), samples, 2 * seed + half)[0] for half in (False, True)
    )
    return before, beyond


_CAPTURE = 0.3  # of the zone's side: largest displacement that a probe is to find
_LEAST_STOP = 0.04  # share of the opening
SAMPLES, MOST_SAMPLES = 64, 256  # per pixel
NEAR_SAMPLES = 16  # the same of the first probe near a place
_SPLITS: tuple[Split, ...] = ("x", "y")
Light = Literal["limited", "whole"]
_LIGHTS: tuple[Light, ...] = ("limited", "whole")
_DEVIATIONS = 6.0  # standard errors to either side that the next probe is prepared for
LEAST_REACH = 5.0  # displacement at full aperture that it is prepared for in any case [pixels]
NEAR = 1.0  # depths of focus: a probe so near to the focus that it found is the last one
SEEN = 3.0  # depths of focus: a probe so near shows where the details of a zone lie
PRECISE, ENOUGH = 0.07, 0.125  # depths of focus: standard error aimed at, and taken
_BESIDE_NOISE = 0.1  # depths of focus that matches err by where other distances show beside the zone, at any noise
MOST_PROBES = 12
_SEPARATION = 8 / (3 * math.pi) / 2  # of the middles of the halves of a disk, over its diameter
BLUR = 1.2  # radius of a blurred point over the displacement of its halves
REASONS = {
    "flat": f"its details do not come to {_LEAST_SIGNIFICANCE:g} standard errors of the noise"
    f" or {LEAST_CONTRAST:.1%} of its light",
    "vague": "it looks the same in and out of focus",
    "ambiguous": "it repeats itself, and fits at more than one distance",
    "dark": "it is dark",
}


def _sureness(probe: HalfProbe) -> float:
    """Return how certain the distance is that a probe shows, as one over its standard error."""
    return 0.0 if probe.match is None else 1.0 / max(probe.match.error, SMALLEST)


@dataclass
class PhaseSearch:
    """A phase detection under way.

    Attributes
    ----------
    renderer : ProbeRenderer
    zone : Zone
    seed : int
    on_probe : callable or None
        Called with every probe.
    probes : list
        Every probe so far and what was made of it; None where it shows nothing.
    others : list
        The same of zones that did not decide.
    on_state : callable or None
        Called with every state that the target is taken to be sharp in.
    """

    renderer: ProbeRenderer
    zone: Zone
    seed: int = 0
    on_probe: Callable[[Probe], None] | None = None
    on_state: Callable[[float], None] | None = None
    probes: list[HalfProbe] = field(default_factory=list)
    others: list[HalfProbe] = field(default_factory=list)
    _state: tuple[Match, float] | None = None  # of the last match
    _samples: int = SAMPLES  # per pixel, of the last probe
    light: Light = "limited"
    _near: tuple[float, float] = (-math.inf, math.inf)  # vergences [1/m] of a search near a place

    @property
    def drive(self) -> Drive:
        """What moves when the camera focuses."""
        return self.renderer.drive

    @property
    def probe(self) -> HalfProbe:
        """The last probe."""
        return self.probes[-1]

    @property
    def match(self) -> Match:
        """What was made of it."""
        match = self.probe.match
        assert match is not None
        return match

    @property
    def spent(self) -> int:
        """Samples of all probes so far."""
        return sum(probe.samples for probe in (*self.others, *self.probes))

    @property
    def most(self) -> int:
        """Samples per pixel of a probe, at most."""
        x0, x1, y0, y1 = self.renderer.view.shown(self.zone)
        affordable = (MOST_OF_SEARCH - self.spent) // (2 * (x1 - x0) * (y1 - y0))
        return min(MOST_SAMPLES, max(affordable, NEAR_SAMPLES))

    @property
    def enough(self) -> float:
        """Standard error of the state that is enough [depths of focus]."""
        return CONTENT if self.spent >= 2 * DEAR else ENOUGH

    def begin_near(self, start: float, width: float) -> None:
        """Probe from a state for a distance that is sharp within so many depths of focus of it.

        Raises
        ------
        NoContrast
            When there is none.
        """
        own = half_view(self.renderer, start, self.zone, "x").sharpest()
        away = width * self.drive.sharp_vergence(start)
        self._near = own - away, own + away
        refusal: str | None = "flat"
        splits = _SPLITS
        for samples in (NEAR_SAMPLES, 4 * NEAR_SAMPLES, MOST_SAMPLES):
            for split in splits:
                match = self._probe(start, split, min(samples, self.most), (own - away, own + away))
                refusal = "flat" if match is None else match.refusal_among(_NEAR_GAIN)
                if match is not None and refusal is None and abs(match.vergence - own) <= away:
                    return
                if match is None or not match.is_promising(MOST_SAMPLES / samples):
                    splits = tuple(each for each in splits if each != split)
                if refusal == "flat":  # whichever way the pupil is split
                    break
            if not splits or (refusal == "flat" and len(splits) < len(_SPLITS)):
                break
        raise no_contrast(REASONS[refusal or "vague"], is_flat=refusal == "flat")

    def begin(self, start: float) -> None:
        """Probe from a state for a distance anywhere within the reach.

        Raises
        ------
        NoContrast
            When there is none.
        """
        reach = self._reach()
        match = self._probe(start, "x", SAMPLES, reach)
        if match is not None and match.refusal in ("vague", "ambiguous"):  # it may change along the other axis
            match = self._probe(start, "y", SAMPLES, reach)
        refusal = "flat" if match is None else match.refusal
        if refusal is not None:
            raise no_contrast(REASONS[refusal if self.probe.halves.pictures.any() else "dark"])

    def finish(self) -> float:
        """Return the state that makes the target sharpest, after as many probes as that takes.

        Raises
        ------
        NoContrast
            When the target is lost on the way.
        """
        samples = NEAR_SAMPLES
        while len(self.probes) < MOST_PROBES:
            state = self.state
            if self.moved <= NEAR:
                # by a second probe, from the state that the first has found, or by rays that led there
                is_confirmed = len(self.probes) > 1 or (
                    math.isfinite(self._near[0]) and _uncertainty_of(self) <= PRECISE
                )
                all_left = self.error * self.probe.stop * math.sqrt(self._samples / self.most)
                if (self.error <= self.enough and is_confirmed) or self.most <= max(samples, self._samples):
                    return state
                if is_confirmed and all_left > HOPELESS:
                    return state
                samples *= 2 if self.probe.stop == 1.0 else 1
            samples = self.step(state, samples)
        raise NoContrast(f"no focus found in the zone after {MOST_PROBES} probes; the focus stays as it was")

    def step(self, state: float, samples: int) -> int:
        """Probe from a state near the focus, and return with how many samples per pixel."""
        match, probe = self.match, self.probe
        is_dear = self.spent >= 2 * DEAR
        needed = self._samples * (self.error * probe.stop / (0.7 * CONTENT if is_dear else PRECISE)) ** 2
        if max(samples, needed) > self._samples:
            self.narrow_zone()
        if not is_dear:  # both halves take that many rays; half of them go on
            x0, x1, y0, y1 = self.renderer.view.shown(self.zone)
            needed = min(needed, max(DEAR // ((x1 - x0) * (y1 - y0)), NEAR_SAMPLES))
        samples = int(min(max(samples, needed), self.most))
        reach = max(_DEVIATIONS * match.error, LEAST_REACH * probe.stop * match.error / match.displacement_error)
        least, most = self._near if self._near[0] <= match.vergence <= self._near[1] else (-math.inf, math.inf)
        within = max(match.vergence - reach, least), min(match.vergence + reach, most)
        refined = self._probe(state, probe.view.split, samples, within)
        refusal = "flat" if refined is None else refined.refusal_among(_NEAR_GAIN)
        if refusal in ("flat", "vague"):  # the first probe has distinguished rivals
            raise no_contrast(REASONS[refusal])
        return samples

    def narrow_zone(self) -> None:
        """Go on with the part of the zone that the last probe, near the focus, shows most detail in."""
        if self.moved > SEEN:
            return
        (left, right, above, below), parts = self.probe.halves.margin, self.probe.halves.parts.sum(axis=0)
        _, height, width = parts.shape
        zone = parts[:, above : height - below, left : width - right]
        if (part := rich_part(zone, max(left, right), (self.probe.view.axis,))) is not None:
            self.zone = self.renderer.part_of(self.zone, part)

    def _reach(self) -> tuple[float, float]:
        """Return the vergences [1/m] that are sharp at the ends of the focus."""
        try:
            ends = [half_view(self.renderer, state, self.zone, "x").sharpest() for state in self.drive.limits]
        except InputError as problem:
            raise NoContrast(f"no contrast in the zone: {problem}") from None
        return min(ends), max(ends)

    def _probe(self, state: float, split: Split, samples: int, reach: tuple[float, float]) -> Match | None:
        """Probe from a state for a distance within a reach, through as small a stop as that needs."""
        view = half_view(self.renderer, state, self.zone, split)
        low, high = max(reach[0], -view.nearest), min(reach[1], view.nearest)
        largest = max(abs(view.displacement(low)), abs(view.displacement(high)))
        room = _CAPTURE * self._side(view.axis)
        stop = min(max(room / largest, _LEAST_STOP), 1.0)
        if stop < 1.0:
            view = half_view(self.renderer, state, self.zone, split, stop)
        blur = math.ceil(BLUR * min(largest * stop, room)) + 2

        def matched(probe: HalfProbe) -> HalfProbe:
            has_light = probe.halves.pictures.any()
            return replace(probe, match=PhaseMatch(probe.halves, view).best(low, high) if has_light else None)

        seen = half_probe(self.renderer, view, state, self.zone, samples, self.seed, stop, (blur, blur))
        if self.probes or len(seen) < len(_LIGHTS):
            probe = matched(seen.get(self.light, seen["limited"]))
        else:
            both = {light: matched(each) for light, each in seen.items()}
            self.light = clearer_light(*(_sureness(both[light]) for light in _LIGHTS))
            probe = both[self.light]
        match = probe.match
        self.probes.append(probe)
        self._samples = samples
        if self.on_probe is not None:
            value, error = self._displacement_of(probe)
            place = self.drive.nearer * self.drive.coordinate(state)
            measures = [Estimate(value, error, np.zeros(0))]
            self.on_probe(Probe(place, stop, None, 1.0, measures, probe.samples, probe.seconds))
        return match

    def _side(self, axis: int) -> float:
        """Return the side of the zone [pixels]."""
        share = (self.zone.right - self.zone.left, self.zone.bottom - self.zone.top)[axis]
        return share * self.renderer.view.resolution[axis]

    @property
    def state(self) -> float:
        """The state that makes the target sharpest, by the last probe."""
        match = self.match
        if self._state is None or self._state[0] is not match:  # exact rays take their time
            distance = 1 / match.vergence if match.vergence > 0 else math.inf
            try:
                state = state_within_reach(self.drive, distance, self.zone)
            except OutOfReach as problem:
                state = problem.state
            self._state = match, state
            if self.on_state is not None and match.refusal is None:
                self.on_state(state)
        return self._state[1]

    @property
    def moved(self) -> float:
        """How far that state lies from that of the last probe [depths of focus]."""
        drive = self.drive
        return abs(drive.coordinate(self.state) - drive.coordinate(self.probe.state)) / drive.depth_of_focus

    @property
    def error(self) -> float:
        """Standard error of that state [depths of focus]."""
        axis = self.probe.view.axis
        pixel_mm = self.renderer.view.scene.film.size_m()[axis] * 1e3 / self.renderer.view.resolution[axis]
        per_pixel = pixel_mm / (2 * _SEPARATION * circle_of_confusion(self.renderer.scene))
        return self.match.displacement_error * per_pixel / self.probe.stop

    def _displacement_of(self, probe: HalfProbe) -> tuple[float, float]:
        """Return the displacement that a probe shows, and its standard error; the zone's side where it shows none."""
        if probe.match is None:
            return 0.0, self._side(probe.view.axis)
        return probe.match.displacement, probe.match.displacement_error

    def records(self) -> list[ProbeRecord]:
        """Return every probe: its value is the displacement of the halves [pixels]."""
        return [
            ProbeRecord(
                probe.state, self.drive.film_distance(probe.state), *self._displacement_of(probe), probe.stop,
                probe.samples, probe.seconds, "displacement",
            )
            for probe in (*self.others, *self.probes)
        ]  # fmt: skip

    def notes(self) -> dict[str, Any]:
        """Describe the last probe for the report."""
        match = self.match
        return {
            "displacement_pixels": match.displacement,
            "split": {"x": "left and right", "y": "below and above"}[self.probe.view.split],
            "contrast": match.contrast,
            "target_distance_m": 1 / match.vergence if match.vergence > 0 else None,
        }


def focus_by_phase(task: Task) -> FocusReport:
    """Return the focus found by phase detection.

    Raises
    ------
    NoContrast
        When no zone gives a distance.
    """
    search = _phase_search(task)
    return _end_by_phase(task, "phase", search, search.zone, [], "phase")


def _end_by_phase(
    task: Task, method: str, search: PhaseSearch, zone: Zone, more: list[ProbeRecord], why: str
) -> FocusReport:
    """Return the focus that a search finds with as many probes as it takes; ``more`` were made beside them."""
    state, error = search.finish(), math.hypot(search.error, _BESIDE_NOISE)
    sure, error_mm = probability_within(0.25, error), error * task.drive.depth_of_focus
    report = task.report(method, state, zone, error_mm, sure, search.records() + more)
    report.notes.update(search.notes() | {"finished_by": why})
    return report


def _phase_search(task: Task) -> PhaseSearch:
    """Return the search of the chosen zone, after its first probe.

    Raises
    ------
    NoContrast
        When no zone gives a distance.
    """
    start = task.renderer.state if task.near is None else task.near
    searches: dict[int, PhaseSearch] = {}
    refusal: NoContrast | None = None
    for k, zone in enumerate(task.zones):
        search = PhaseSearch(task.renderer, zone, task.seed, task.on_probe, task.on_state)
        try:
            if task.near is None:
                search.begin(start)
            else:
                search.begin_near(start, task.reach)
        except NoContrast as problem:
            refusal = problem if refusal is None or refusal.is_flat else refusal
        else:
            searches[k] = search
    if not searches:
        assert refusal is not None
        raise refusal
    index = choose_zone(task.policy, task.zones, {k: search.match.vergence for k, search in searches.items()})
    search_of_zone = searches[index]
    search_of_zone.others = [
        probe for search in searches.values() if search is not search_of_zone for probe in search.probes
    ]
    return search_of_zone


# Hybrid focus: phase detection points to the focus, and contrast finds it there.


def _uncertainty_of(search: PhaseSearch) -> float:
    """Return how uncertain the state of a search is [depths of focus], its distance from the last probe included.

    Far from the focus the blur of the target's surroundings shifts the match by a few percent of the way.
    """
    return math.hypot(search.error, 0.03 * search.moved)


NEAR_ENOUGH = 1.0  # depths of focus: uncertainty from which contrast finds the way
REACH = 2.5  # depths of focus to either side that contrast searches
_AGREEMENT = 3.0  # standard errors that it searches in any case
_HYBRID_STEPS = 3
_PARTED = 0.25  # depths of focus from the least spot to where details are clearest: then contrast is not asked
_DISAGREE = 0.5  # depths of focus between the two from which aberrations are to blame


def focus_by_hybrid(task: Task) -> FocusReport:
    """Return the focus: a probe or two through half pupils, then the greatest contrast near where they point.

    Where the halves show no distance, contrast searches the whole reach. Where contrast shows nothing, or is greatest
    elsewhere because of aberrations, which phase detection knows from its rays, phase detection finishes.

    Raises
    ------
    NoContrast
        When neither finds a focus.
    """
    search = None
    try:
        search = _phase_search(task)
        zone = search.zone
        for _ in range(_HYBRID_STEPS):  # until contrast finds the way
            if _uncertainty_of(search) <= NEAR_ENOUGH:
                break
            search.step(search.state, SAMPLES)
        if clearest_beside(task.renderer, search.probe.state, search.zone, search.probe.view.split) > _PARTED:
            return _end_by_phase(task, "hybrid", search, zone, [], "phase, as details are clearest elsewhere")
        search.narrow_zone()
    except NoContrast as problem:
        if problem.is_flat and search is None:  # one that shows detail first may lose it for want of samples
            raise
        report = replace(focus_by_contrast(task), method="hybrid")
        report.notes["finished_by"] = "contrast alone"
        return report
    probes = replace(task, zones=(search.zone,)).probes(MEASURES[BEST])
    probes.budget = max(MOST_OF_SEARCH - search.spent, MOST_OF_SEARCH // 2)
    sharp = task.drive.depth_of_focus
    reach = max(REACH, _AGREEMENT * _uncertainty_of(search)) * sharp
    pointed = probes.place_of(search.state)
    try:
        peak, _ = greatest_contrast(probes, Policy.CENTRE, (pointed, reach))
    except NoContrast:
        return _end_by_phase(task, "hybrid", search, zone, probes.records(0), "phase")
    if abs(peak.place - pointed) > _DISAGREE * sharp:
        search.step(probes.state_of(peak.place), NEAR_SAMPLES)
        away = abs(peak.place - probes.place_of(search.state)) / sharp
        if away > max(_DISAGREE, _AGREEMENT * search.error):
            return _end_by_phase(
                task, "hybrid", search, zone, probes.records(0), "phase, as contrast is greatest elsewhere"
            )
    if peak.uncertainty > max(search.error, ENOUGH) * sharp:  # few details, or coarse ones: the halves know better
        return _end_by_phase(task, "hybrid", search, zone, probes.records(0), "phase, as contrast is less certain")
    sure = probability_within(sharp / 4, peak.uncertainty)
    records = search.records() + probes.records(0)
    report = task.report("hybrid", probes.state_of(peak.place), zone, peak.uncertainty, sure, records)
    report.notes["finished_by"] = "contrast"
    return report
