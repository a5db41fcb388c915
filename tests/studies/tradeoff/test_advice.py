"""Advice, words and the parts that need no device."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.rendering.film import TILE, FilmLayout
from rptcam_cl.rendering.tolerance_run import Interval
from rptcam_cl.studies import tradeoff
from rptcam_cl.studies.tradeoff import advise_for_error, advise_for_time, place
from rptcam_cl.studies.tradeoff_errors import TARGETS, MeasuredVariant
from rptcam_cl.studies.tradeoff_runs import spread_tiles


def measurement(name, rate, bias=0.0, knob="camera"):
    exact, sample, fall = (Interval(value, value, value) for value in (0.0, SAMPLE_S, -1.0))
    noise = tuple(Interval(*3 * [rate / SAMPLE_S / count]) for count in (8, 128))
    return MeasuredVariant(
        name=name, knob=knob, same_as=(), settings=(), tier="", unbiased=False, start_s=0.0, sample_s=sample,
        wall_sample_s=sample, samples=(8, 128), noise=noise, before=fall, slope=fall, beyond=fall,
        rate=Interval(rate, rate, rate), bias=Interval(bias, bias, bias), energy=exact,
        seconds_to=dict.fromkeys(TARGETS, exact), better_until=exact, bias_of_tiles=np.zeros(1),
        noise_of_tiles=np.zeros(1), gain=Interval(4e-3 / rate, 4e-3 / rate, 4e-3 / rate),
    )  # fmt: skip


SAMPLE_S = 0.01
FULL = measurement("full", 4e-3, knob="")
QUICK = measurement("quick", 1e-3, bias=1e-4)  # crosses the full one after 30 s, with an error of 1.15 %


def test_quick_configuration_is_for_short_times_only():
    assert advise_for_time([FULL, QUICK], 10.0).chosen == "quick"
    assert advise_for_time([FULL, QUICK], 100.0).chosen == "full"


def test_error_that_bias_forbids_takes_the_full_configuration():
    assert advise_for_error([FULL, QUICK], 0.02).chosen == "quick"
    advice = advise_for_error([FULL, QUICK], 0.009)
    assert advice.chosen == "full"
    assert advice.seconds == pytest.approx(4e-3 / 0.009**2, rel=1e-3)


def test_gain_within_a_twentieth_is_not_worth_an_approximation():
    close = measurement("close", 3.9e-3)
    assert advise_for_time([FULL, close], 10.0).chosen == "full"
    assert advise_for_error([FULL, close], 0.02).chosen == "full"


def test_bias_that_is_not_known_well_is_counted_in_full_and_said():
    vague = replace(QUICK, bias=Interval(0.0, 0.0, 1.0))
    advice = advise_for_error([FULL, vague], 0.02)
    assert (advice.chosen, advice.perhaps) == ("full", "quick")
    assert advise_for_error([FULL, QUICK], 0.02).perhaps is None


def test_gain_that_may_be_none_is_no_reason_to_leave_the_full_configuration():
    unsure = replace(QUICK, gain=Interval(4.0, 0.9, 9.0))
    assert advise_for_time([FULL, unsure], 10.0).chosen == "full"
    advice = advise_for_error([FULL, unsure], 0.02)
    assert (advice.chosen, advice.perhaps) == ("full", "quick")


def test_chance_between_ways_that_differ_by_noise_alone_is_no_advice():
    assert advise_for_error([FULL, replace(QUICK, unbiased=True)], 0.02).chosen == "quick"
    assert advise_for_error([FULL, replace(QUICK, unbiased=True, knob="sampler")], 0.02).chosen == "full"
    first, last = QUICK.noise
    rare = replace(QUICK, noise=(first, replace(last, high=4 * last.low)))
    assert rare.has_rare_paths and replace(QUICK, slope=Interval(-0.8, -0.9, -0.7)).has_rare_paths
    assert not QUICK.has_rare_paths
    assert advise_for_error([FULL, rare], 0.02).chosen == "quick"
    assert advise_for_error([FULL, replace(rare, unbiased=True)], 0.02).chosen == "full"


def test_time_that_is_too_short_for_a_sample_has_no_advice():
    slow = replace(FULL, sample_s=Interval(2.0, 2.0, 2.0))
    assert advise_for_time([slow, replace(QUICK, sample_s=Interval(0.5, 0.5, 0.5))], 1.0).chosen == "quick"
    assert advise_for_time([slow], 1.0).chosen is None
    assert advise_for_error([slow], 0.9).seconds == 2.0  # not a share of a sample


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0231, "23 ms"), (4.21, "4.2 s"), (59.6, "60 s"), (600, "10 min"), (7200 * 2, "4 h"), (math.inf, "never")],
)
def test_times_read_well(value, text):
    assert tradeoff.seconds(value) == text


def test_bias_that_may_be_nothing_is_told_by_what_it_is_at_most():
    assert tradeoff.bias(Interval(1e-5, -1e-5, 4e-4)) == "below 2 %"
    assert tradeoff.bias(Interval(4e-4, 1e-4, 9e-4)) == "2 % (1 to 3)"
    assert tradeoff.bias(Interval(0.0, 0.0, 0.0)) == "none"
    assert tradeoff.bias(Interval(4e-4, 3.99e-4, 4.01e-4)) == "2 %"


def test_intervals_share_their_unit_and_say_when_they_know_nothing():
    assert tradeoff.ends(Interval(0.037, 0.034, 0.038)) == "37 ms (34 to 38)"
    assert tradeoff.ends(Interval(1.1, 0.9, 1.3)) == "1.1 s (900 ms to 1.3 s)"
    assert tradeoff.crossing(Interval(0.0, 0.0, math.inf)) == "too close to call"
    assert tradeoff.crossing(Interval(518 * 86400.0, 1.5, math.inf)) == "too close to call"
    assert tradeoff.crossing(Interval(2.0, 0.0, 9.0)) == "too close to call (before 9 s)"
    assert tradeoff.crossing(Interval(2.0, 1.0, 9.0)) == "2 s (1 to 9)"
    assert tradeoff.crossing(Interval(27.0, 1.0, 9.0)) == "too close to call (before 9 s)"
    assert tradeoff.crossing(Interval(math.inf, 1e6, math.inf)) == "always"
    assert tradeoff.crossing(Interval(0.0, 0.0, 0.0)) == "never"
    assert tradeoff.noise(65.49) == "above 100 %"
    assert [tradeoff.odds(share) for share in (0.9, 0.25, 0.999, 0.5)] == [
        "odds 9 to 1", "odds 1 to 3", "odds of 99 to 1 or more", "odds 1 to 1",
    ]  # fmt: skip
    assert tradeoff.crossing(Interval(1.0, 0.0, 2.0)) == "too close to call (before 2 s)"


def test_numbers_are_written_as_people_read_them():
    days = [tradeoff.seconds(value * 86400.0) for value in (1.99, 2.0, 30.0, math.inf)]
    assert days == ["48 h", "2 days", "30 days", "never"]
    assert [tradeoff.odds(share) for share in (0.99, 0.01, 0.005)] == [
        "odds of 99 to 1 or more", "odds of 1 to 99 or less", "odds of 1 to 99 or less",
    ]  # fmt: skip
    assert [tradeoff.until(value) for value in (-1.0, 0.0, 2.0, math.inf)] == ["never", "never", "2 s", "always"]
    assert [tradeoff.noise(share) for share in (0.018, 1.0, 1.01)] == ["1.8 %", "100 %", "above 100 %"]


def test_place_is_the_ninth_that_differs_most():
    values = np.zeros((6, 9))
    values[0, 8] = 1.0
    assert place(values.ravel(), (6, 9)) == "top right"
    assert place(np.eye(1, 54, 22).ravel(), (6, 9)) == "centre"


@pytest.mark.parametrize(("width", "height", "most"), [(320, 180, 100), (100, 60, 500), (37, 9, 3), (8, 8, 64)])
def test_tiles_are_spread_over_the_film_and_stand_for_it(width, height, most):
    layout = FilmLayout(width, height, 0, 0, width, height)
    found = spread_tiles(layout, most, np.random.default_rng(0))
    assert len(found.tiles) == len(np.unique(found.tiles)) == found.shape[0] * found.shape[1] <= most
    assert len(found.tiles) > min(layout.tiles, most) * 0.6
    assert found.weights.sum() == pytest.approx(1.0)
    assert layout.inside[found.pixels].all()
    assert (found.pixels // TILE**2 == found.tiles[found.cell]).all()
    # cells of equal size have a tile each, as many across and down as the film is wide and high
    down, across = -(-height // TILE), layout.tiles_across
    rows, columns = found.shape
    assert rows == min(max(most // columns, 1), down) and columns <= across
    places = np.array(np.divmod(found.tiles.reshape(rows, columns), across))
    for seen, axis, count, of in ((places[0], 0, rows, down), (places[1].T, 0, columns, across)):
        edges = np.arange(count + 1) * of // count
        assert (seen >= edges[:-1, None]).all() and (seen < edges[1:, None]).all(), axis
    if len(found.tiles) == layout.tiles:
        assert len(found.pixels) == width * height
        assert np.ptp(found.weights) == 0
