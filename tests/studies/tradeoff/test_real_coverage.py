"""Intervals of the comparison hold the truth as often as they say, on renders: a small scene measured many times.

The truth is what all measurements together say: means and variances of thousands of pictures.
"""

from unittest.mock import patch

import numpy as np
import pytest

from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies import tradeoff_errors, tradeoff_runs
from rptcam_cl.studies.tradeoff_errors import EDGE
from rptcam_cl.studies.tradeoff_runs import _measure, ladder, prepare, render_by_turns, run, spread_tiles
from tests.device.probes import open_session
from tests.studies.tradeoff.test_command import SCENE

pytestmark = pytest.mark.slow

REPETITIONS = 150
FIRST = 4  # samples per pixel of the first picture of a seed
NAMES = ("full", "thick lens", "depth 4", "independent samples")
TARGETS = (0.1, 0.06)  # errors within the numbers of samples that are rendered
BETWEEN = (16, 24, 32, 48, 64, 96, 128, 192, 256)  # samples at which the noise is found, for times
SEEDS_BETWEEN = 100
WANTED = 0.93
SURE = 2 * np.sqrt(0.95 * 0.05 / REPETITIONS)  # two standard errors of a share: what is below by more is surely too few


class Pooled:
    """Sums of pictures (configurations, seeds, p, 3), for means and variances of every pixel."""

    def __init__(self):
        self.count, self.sums, self.squares = 0, 0.0, 0.0

    def take(self, pictures):
        pictures = np.asarray(pictures, np.float64)
        self.count += pictures.shape[1]
        self.sums, self.squares = self.sums + pictures.sum(axis=1), self.squares + np.square(pictures).sum(axis=1)

    @property
    def mean(self):
        return self.sums / self.count

    @property
    def variance(self):
        return (self.squares / self.count - self.mean**2) * self.count / (self.count - 1)


class Truth:
    """What all measurements together say."""

    def __init__(self):
        self.short, self.long, self.whole, self.apart = Pooled(), Pooled(), Pooled(), Pooled()

    def take(self, pictures):
        means = np.array([0.2 * own[0].astype(float) + 0.8 * own[1] for own in pictures.pixels])
        self.short.take([own[1] for own in pictures.pixels])
        self.long.take(pictures.long.pixels)
        self.whole.take(means)
        self.apart.take(means - means[0])
        self.tiles = pictures.tiles

    def relative(self, squares):
        """Return squares (configurations, p, 3) as the comparison weighs them, over the picture."""
        mean, tiles = self.whole.mean[0], self.tiles
        lit = np.bincount(tiles.cell, tiles.weights * np.mean(mean**2, axis=1)) / np.bincount(tiles.cell, tiles.weights)
        edge = EDGE * float(tiles.weights @ mean.mean(axis=1))
        return (squares.mean(axis=-1) / (lit + edge**2)[tiles.cell]) @ tiles.weights

    def noise(self):
        """After the numbers of samples of the short pictures and the long ones."""
        return self.relative(self.short.variance), self.relative(self.long.variance)

    def bias(self):
        found = self.relative(self.apart.mean**2 - self.apart.variance / self.apart.count)
        return np.where(np.arange(len(NAMES)) == NAMES.index("independent samples"), 0.0, found)

    def energy(self):
        brightness = self.whole.mean.mean(axis=2) @ self.tiles.weights
        return brightness / brightness[0] - 1


def noise_between(ready, truth):
    """Return the noise after each of `BETWEEN` samples, (configurations, numbers)."""
    found = []
    for samples in BETWEEN:
        pooled = Pooled()
        for seed in range(SEEDS_BETWEEN):
            pooled.take([[run(each, truth.tiles, samples, 10**6 + seed)[0]] for each in ready])
        found.append(truth.relative(pooled.variance))
    return np.array(found).T


def fewest_samples(noise, wanted):
    """Return the fewest samples after which noise, on straight lines between `BETWEEN`, is what is wanted."""
    samples = np.geomspace(BETWEEN[0], BETWEEN[-1], 2000)
    enough = np.interp(np.log(samples), np.log(BETWEEN), np.log(noise)) <= np.log(wanted)
    return samples[enough.argmax()] if enough.any() else np.inf


def repeated(repetitions, size=(32, 24)):
    """Measurements of the small scene under different seeds, the truth of all, and noise for times."""
    scene = change_scene(load_scene(SCENE), film={"resolution": size}, spectrum={"mode": "rgb"})
    steps = {step.name: step for step in ladder(scene)[0]}
    ready, _ = prepare([steps[name] for name in NAMES], open_session(), lambda name, done: None)
    layout = ready[0].wavefront.layout
    extent = spread_tiles(layout, layout.tiles, np.random.default_rng(0)), FIRST
    truth, found = Truth(), []
    with patch.object(tradeoff_runs, "_extent", lambda *_: extent), patch.object(tradeoff_errors, "TARGETS", TARGETS):
        for repetition in range(repetitions):
            pictures = render_by_turns(ready, np.inf, 100 * repetition, lambda words, share: None)
            found.append(_measure(ready, pictures))
            truth.take(pictures)
    return found, truth, noise_between(ready, truth)


@pytest.fixture(scope="module")
def measured():
    return repeated(REPETITIONS)


def held(intervals, truths, scale=1.0):
    """Share of the intervals, scaled about their estimates, that hold the truth."""
    hits = []
    for interval, truth in zip(intervals, truths, strict=True):
        low, high = (interval.value + scale * (end - interval.value) for end in (interval.low, interval.high))
        hits.append(low <= truth <= high)
    return float(np.mean(hits))


def shares(measured, what, scale=1.0):
    """The same of all configurations."""
    found, truth, between = measured
    told = {}
    for index, name in enumerate(NAMES):
        own = [measurements[index] for measurements in found]
        if what in ("noise of short pictures", "noise of long ones"):
            k = int("long" in what)
            told[name] = held([each.noise[k] for each in own], [truth.noise()[k][index]] * len(own), scale)
        elif what == "times":  # given that of a sample, which is as the machine is at the moment
            for target in TARGETS:
                samples = fewest_samples(between[index], target**2 - truth.bias()[index])
                times = [samples * each.sample_s.value for each in own]
                told[f"{name} to {target:g}"] = held([each.seconds_to[target] for each in own], times, scale)
        elif index:  # of what is relative to the first
            value = getattr(truth, what)()[index]
            told[name] = held([getattr(each, what) for each in own], [value] * len(own), scale)
    return told


@pytest.mark.parametrize("what", ["noise of short pictures", "noise of long ones", "bias", "energy", "times"])
def test_intervals_hold_what_many_measurements_say(measured, what):
    told = shares(measured, what)
    assert min(told.values()) >= WANTED - SURE, told


@pytest.mark.parametrize("what", ["bias", "energy"])
def test_intervals_half_as_wide_would_be_found(measured, what):
    """The control."""
    told = shares(measured, what, 0.5)
    assert min(told.values()) < WANTED - SURE, told
