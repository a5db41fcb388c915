"""Random cases of the benchmark: every method ends in focus, and refuses blank targets.

python -m pytest -m slow tests/studies/focus/test_random_cases.py
"""

import pytest

from benchmarks.focus_success import BLANK_EVERY, outcome, random_case, wilson
from rptcam_cl.device.session import open_session
from tests.support.cases import slow

CASES = 10
TARGETS = [number for number in range(29) if number % BLANK_EVERY != BLANK_EVERY - 1][:26]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["contrast", "laplacian", "phase", "hybrid"])
def test_random_cases_end_in_focus_or_in_a_refusal(method):
    session = open_session(None)
    found = [outcome(random_case(number), method, session) for number in range(CASES)]
    assert sum(row["blank"] for row in found) == CASES // BLANK_EVERY
    assert [row["case"] for row in found if not row["good"]] == []


@pytest.mark.parametrize("number", [4, *(slow(n) for n in (8, 11))])
def test_laplacian_finds_what_is_faint_far_or_coarse(number):
    assert outcome(random_case(number), "laplacian", open_session(None))["miss"] < 0.25


@pytest.mark.slow
@pytest.mark.parametrize("method", ["laplacian", "contrast"])
def test_most_of_26_targets_are_found(method):
    session = open_session(None)
    found = [outcome(random_case(number), method, session) for number in TARGETS]
    assert sum(row["good"] for row in found) >= 22
    assert [row["reason"] for row in found if row["reason"]] == []


@pytest.mark.slow
@pytest.mark.parametrize("number", [40, 178])
def test_hybrid_goes_by_the_halves_where_aberrations_move_the_contrast(number):
    """Behind a wide open single lens details are clearest half a depth of focus and more from the least spot.

    Contrast goes to the details, or says that it did not come to them.
    """
    session = open_session(None)
    contrast, hybrid = (outcome(random_case(number), method, session) for method in ("contrast", "hybrid"))
    assert contrast["from_spot"] > 0.5
    assert contrast["miss"] < 0.25 or "nothing that the zone shows is sharp" in contrast["failure"]
    assert hybrid["miss"] < 0.25


def test_wilson_interval_is_that_of_the_textbook():
    # Brown, Cai, DasGupta 2001: the interval is never empty, nor leaves [0, 1], at the ends.
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(10, 10) == pytest.approx((0.7225, 1.0), abs=1e-4)
    assert wilson(50, 100) == pytest.approx((0.4038, 0.5962), abs=1e-4)
