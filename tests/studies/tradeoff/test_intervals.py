"""Intervals hold what they are of as often as they say, on pictures whose noise and bias are known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from rptcam_cl.studies.tradeoff_errors import (
    EDGE,
    LongPictures,
    _gain,
    draws,
    every_seed_once,
    interval,
    measurements,
    median_over_seeds,
    over_pairs,
    pair_errors,
    student_quantile,
)
from tests.studies.tradeoff.synthetic import MANY, NOISE, PER_TILE, SAMPLES, SECONDS, SEEDS, measured, spread
from tests.support.cases import slow

EVERY = 16  # tiles
TRIALS = 60
FEWEST = 0.9  # of TRIALS: if intervals hold 95 % of what they are of, one set in a hundred has fewer
NAMES = ("bias", "noise", "rate", "energy", "time", "better until")


def holds(found, truth):
    return found.low <= truth <= found.high


def coverage(trials, scale, rendered=EVERY, every=EVERY, seed=0):
    """Share of intervals that hold the truth, by what they are of."""
    rng = np.random.default_rng(seed)
    found = dict.fromkeys(NAMES, 0)
    for _ in range(trials):
        bias = scale * (rng.standard_normal(every) + 0.5).repeat(PER_TILE)
        floor = float(np.mean(bias**2)) / (1 + EDGE**2)
        _, other = measured(rng, bias, rendered, every)
        noise = NOISE / (1 + EDGE**2)
        left = 0.02**2 - floor
        truths = (
            floor,
            noise / SAMPLES[-1],
            noise * SECONDS,
            float(bias.mean()),
            noise * SECONDS / left if left > 0 else np.inf,
            noise * SECONDS / floor if floor > 0 else np.inf,  # the reference takes twice the time
        )
        own = (other.bias, other.noise[0], other.rate, other.energy, other.seconds_to[0.02], other.better_until)
        for name, interval_of, truth in zip(NAMES, own, truths, strict=True):
            found[name] += holds(interval_of, truth)
    return {name: count / trials for name, count in found.items()}


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.015])
def test_intervals_hold_the_truth_as_often_as_they_say(scale):
    found = coverage(TRIALS, scale)
    assert min(found.values()) >= FEWEST, found


@pytest.mark.slow
def test_intervals_know_that_some_tiles_stand_for_all():
    found = coverage(TRIALS, 0.2, rendered=16, every=64)
    assert min(found["bias"], found["energy"]) >= FEWEST - 0.03, found  # of 16 tiles the spread is known badly


def test_light_that_no_two_pictures_miss_in_the_same_pixel_is_missing_all_the_same():
    rng = np.random.default_rng(6)
    tiles, samples, times = spread(EVERY, EVERY), (2, 8), (np.ones(SEEDS), np.ones(SEEDS))
    full = [np.ones((SEEDS, EVERY * PER_TILE, 3), np.float32) for _ in samples]
    short = [picture.copy() for picture in full]
    for each, pixel in enumerate(rng.permutation(EVERY * PER_TILE)[: 9 * SEEDS]):
        for pixels in short:
            pixels[each % SEEDS, pixel] = 0.0
    named = [
        {"name": name, "knob": name, "same_as": (), "settings": (), "tier": "", "unbiased": False, "start_s": 0.0}
        for name in ("", "short")
    ]
    few = tiles.cell < 4
    long = LongPictures(128, np.arange(4), [pixels[0][:2, few] for pixels in (full, short)])
    pictures = pair_errors([full, short], samples, tiles, long)
    assert not pictures[1].bias.any()  # what pairs tell, each by itself
    found = measurements(named, pictures, [times, times], (*samples, 128), draws(SEEDS, rng, 500))[1]
    missing = 9 / (EVERY * PER_TILE)
    assert found.energy.value == pytest.approx(-missing, rel=1e-6)
    assert found.bias.value == pytest.approx(missing**2, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("fall", [slow(1.0), 1.5])
def test_fall_of_noise_is_found(fall):
    rng, trials = np.random.default_rng(8), 20
    found = [measured(rng, np.zeros(EVERY * PER_TILE), EVERY, EVERY, 200, fall)[1] for _ in range(trials)]
    truth = NOISE / (1 + EDGE**2)
    for holding in (
        [holds(other.noise[0], truth / SAMPLES[-1] ** fall) for other in found],
        [holds(other.noise[1], truth / MANY**fall) for other in found],
        [holds(other.slope, -fall) for other in found],
    ):
        assert np.mean(holding) >= FEWEST - 0.05  # of four tiles the spread is known badly
    assert np.mean([other.slope.value for other in found]) == pytest.approx(-fall, abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.0, 0.015, 0.2])
def test_intervals_hold_the_truth_in_many_trials(scale):
    found = coverage(2000, scale, seed=1)
    assert all(share >= 0.93 for share in found.values()), found


def test_percentiles_that_are_not_widened_are_too_narrow():
    """A control: of eight seeds the plain bootstrap holds the mean nine times in ten at most."""
    rng = np.random.default_rng(3)
    plain = wide = 0
    for _ in range(400):
        values = rng.standard_normal(SEEDS)
        counts = draws(SEEDS, rng, 500)
        means = counts @ values / SEEDS
        low, high = np.quantile(means, [0.025, 0.975])
        plain += low <= 0 <= high
        wide += holds(interval(values.mean(), means, SEEDS), 0.0)
    assert plain / 400 < 0.92
    assert wide / 400 > 0.925


def test_pairs_of_a_seed_with_itself_would_count_noise_as_bias():
    """A control: the square of the difference of means is far above nothing where there is nothing but noise."""
    rng = np.random.default_rng(4)
    apart = rng.standard_normal((SEEDS, 500))
    products = apart @ apart.T / 500
    assert abs(over_pairs(products, every_seed_once(SEEDS))[0]) < 0.02
    assert products.mean() > 0.1


def test_means_over_pairs_are_those_of_the_definition():
    rng = np.random.default_rng(5)
    half = rng.standard_normal((4, 4))
    matrix = half + half.T
    drawn = [0, 0, 2, 3]
    expected = np.mean([matrix[a, b] for i, a in enumerate(drawn) for j, b in enumerate(drawn) if i != j and a != b])
    pairs = [(a, b) for i, a in enumerate(drawn) for j, b in enumerate(drawn) if i != j]
    same = sum(a == b for a, b in pairs)
    assert over_pairs(matrix, np.array([[2, 0, 1, 1]]))[0] == pytest.approx(expected)
    assert same == 2


@pytest.mark.parametrize("counts", [[1, 1, 1, 1], [2, 0, 1, 1], [0, 3, 1, 0], [4, 0, 0, 0]])
def test_median_is_that_of_the_values_drawn(counts):
    values = np.array([3.0, 1.0, 2.0, 8.0])
    assert median_over_seeds(values, np.array([counts]))[0] == np.median(np.repeat(values, counts))


@pytest.mark.parametrize("freedom", [2, 7, 30])
def test_quantile_is_that_of_students_distribution(freedom):
    assert student_quantile(0.975, freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-3)


def test_ends_of_an_interval_may_be_infinite():
    found = interval(1.0, np.array([1.0] * 50 + [math.inf] * 50), SEEDS)
    assert (found.low, found.high) == (1.0, math.inf)


def test_gain_is_the_ratio_of_noises_and_of_times_where_neither_has_any():
    own = SimpleNamespace(rate=np.array([2.0, 0.0, 0.0, 4.0]), sample_s=np.array([1.0, 1.0, 4.0, 1.0]))
    reference = SimpleNamespace(rate=np.array([6.0, 5.0, 0.0, 0.0]), sample_s=np.array([1.0, 3.0, 2.0, 1.0]))
    assert _gain(own, reference).tolist() == [3.0, np.inf, 0.5, 0.0]
