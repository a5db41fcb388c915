"""The toolkit itself: it stays silent where there is nothing, and speaks where there is something."""

import numpy as np
import pytest
from scipy import stats

from tests.support.statistics import (
    InconclusiveError,
    Sampled,
    assert_equivalent,
    assert_same_tiles,
    chi_squared,
    moment_scores,
    overall,
    sampled,
    sidak,
    slope,
    tiles,
    welch,
)

SIZE = (64, 64, 1)


@pytest.fixture
def rng():
    return np.random.default_rng(20240229)


def skewed(rng, count, samples, cv, factor=1.0):
    """Pictures of mean 1 (times ``factor``), each pixel the mean of ``samples`` gamma values of variation ``cv``."""
    shape = samples / cv**2
    return rng.gamma(shape, 1 / shape, (count, *SIZE)) * factor


def false_alarms_allowed(trials, alpha):
    """Most false alarms that 99.9 % of correct tests raise."""
    return int(stats.binom.ppf(0.999, trials, alpha))


def test_equivalence_accepts_a_small_interval_inside_the_tolerance():
    assert_equivalent(1.001, 0.0001, 1.0, 0.005)


@pytest.mark.parametrize("mean", [1.006, 0.994, 1.0049])
def test_equivalence_refuses_a_mean_near_or_beyond_the_tolerance(mean):
    with pytest.raises(AssertionError):
        assert_equivalent(mean, 0.0001, 1.0, 0.005)


def test_equivalence_refuses_a_noisy_measurement_of_the_right_mean():
    with pytest.raises(InconclusiveError):
        assert_equivalent(1.0, 0.001, 1.0, 0.005)


def test_equivalence_refuses_what_is_not_a_number():
    with pytest.raises(AssertionError):
        assert_equivalent(np.nan, 0.0, 1.0, 0.005)


def test_equivalence_has_the_power_it_claims(rng):
    found = 0
    for _ in range(1000):
        mean = rng.normal(1.01, 0.0005)
        try:
            assert_equivalent(mean, 0.0005, 1.0, 0.005)
        except AssertionError:
            found += 1
    assert found >= 990


def test_tiles_average_pixels_and_their_variances(rng):
    values = rng.random((20, 17, 3))
    whole = tiles(Sampled(values, np.full_like(values, 4.0), 3))
    assert whole.mean.shape == (2, 2, 3)
    np.testing.assert_allclose(whole.mean[1, 0], values[8:16, :8].mean((0, 1)))
    np.testing.assert_allclose(whole.variance, 4.0 / 64)
    assert whole.freedom == 3 * 64


def test_sidak_keeps_the_probability_of_any_false_alarm():
    assert 1 - (1 - sidak(0.01, 100)) ** 100 == pytest.approx(0.01)


def test_welch_p_values_are_uniform_when_means_agree(rng):
    p = [welch(sampled(rng.normal(0, 1, (5, 1))), sampled(rng.normal(0, 3, (9, 1))))[0] for _ in range(1000)]
    for alpha in (0.01, 0.1):
        # Welch's approximate degrees of freedom are exact to about a tenth here
        assert sum(x < alpha for x in p) <= false_alarms_allowed(1000, 1.1 * alpha)


def test_welch_compares_exact_values():
    exact = Sampled(np.array([1.0, 1.0]), np.zeros(2), 1)
    other = Sampled(np.array([1.0, 1.1]), np.zeros(2), 1)
    assert welch(exact, other).tolist() == [1.0, 0.0]


def picture_alarms(rng, trials, factor, cv=1.0):
    found = 0
    for _ in range(trials):
        try:
            assert_same_tiles(sampled(skewed(rng, 4, 64, cv)), sampled(skewed(rng, 4, 64, cv, factor)), alpha=0.01)
        except AssertionError:
            found += 1
    return found


def test_equal_pictures_raise_no_more_alarms_than_they_may(rng):
    # two corrected tests of 0.01 each
    assert picture_alarms(rng, 200, 1.0) <= false_alarms_allowed(200, 0.02)


def test_one_per_cent_of_everything_is_found(rng):
    assert picture_alarms(rng, 50, 1.01) == 50


def test_ten_per_cent_of_one_tile_is_found(rng):
    factor = np.ones(SIZE)
    factor[8:16, 16:24] = 1.1
    assert picture_alarms(rng, 50, factor) == 50


def test_overall_error_is_that_of_the_mean(rng):
    means = [overall(sampled(skewed(rng, 4, 64, 1.0))).mean[0] for _ in range(300)]
    claimed = overall(sampled(skewed(rng, 4, 64, 1.0))).variance[0] ** 0.5
    assert np.std(means) == pytest.approx(claimed, rel=0.15)  # 300 trials know it to 4 %


def test_chi_squared_accepts_its_own_distribution(rng):
    expected = np.linspace(0.5, 60, 50)
    p = [chi_squared(rng.poisson(expected), expected) for _ in range(1000)]
    # free totals add one degree of freedom to 40, hence the wider level
    assert sum(x < 0.01 for x in p) <= false_alarms_allowed(1000, 0.015)


def test_chi_squared_finds_one_cell_that_is_wrong(rng):
    expected = np.full(100, 1000.0)
    actual = expected.copy()
    actual[7] *= 1.4
    assert all(chi_squared(rng.poisson(actual), expected) < 1e-4 for _ in range(100))


def test_chi_squared_refuses_a_count_where_nothing_can_fall():
    assert chi_squared([1, *[20] * 20], [0, *[20] * 20]) == 0


def test_chi_squared_refuses_too_few_cells():
    with pytest.raises(InconclusiveError):
        chi_squared([20] * 5, [20] * 5)


def test_moments_find_a_tilt_that_chi_squared_hardly_sees(rng):
    u = rng.random(1_000_000)
    tilted = u + 0.01 * u * (1 - u)
    assert np.abs(moment_scores(np.stack([u, u**2], 1), [1 / 2, 1 / 3])).max() < 4
    assert np.abs(moment_scores(np.stack([tilted, tilted**2], 1), [1 / 2, 1 / 3])).max() > 4


def test_slope_of_independent_errors_is_minus_one_half():
    counts = np.array([16, 64, 256])
    assert slope(counts, 3 / np.sqrt(counts)) == pytest.approx(-0.5)
