"""Continuous autofocus: the policy that goes from frame to frame, on made-up measurements."""

import itertools

import numpy as np
import pytest

from rptcam_cl.scene.exposure import ContinuousFocus
from rptcam_cl.studies.focus.controller import Following, follow

FRAME_S = 1 / 24


def places(measured, manner=None, depth=0.1, frame_s=FRAME_S):
    """Return where the focus stands in each frame."""
    manner = manner or ContinuousFocus()
    steps = itertools.accumulate(
        measured[1:], lambda state, new: follow(state, new, depth, manner, frame_s), initial=Following(measured[0])
    )
    return np.array([state.place for state in steps])


def test_noise_within_the_band_moves_nothing():
    noise = np.random.default_rng(1).uniform(-0.09, 0.09, 240)
    noise[0] = 0
    assert np.ptp(places(5 + noise)) == 0
    assert np.ptp(places(5 + 3 * noise)) > 0  # beyond it, it does


def test_what_crosses_the_picture_is_let_pass_and_a_change_is_followed_after_the_lock():
    crossing = np.full(48, 1.0)
    crossing[10:15] = 3.0  # a fifth of a second
    assert np.ptp(places(crossing)) == 0
    crossing[10:] = 3.0
    found = places(crossing)
    lock = round(0.25 * 24)
    assert found[10 + lock - 1] == 1.0
    assert found[10 + lock] > 1.0
    assert found[-1] == 3.0


def test_focus_goes_no_faster_than_its_speed_and_never_overshoots():
    jump = np.r_[0.0, np.full(60, 2.0)]
    found = places(jump, ContinuousFocus(lock_s=0, speed=24))
    steps = np.diff(found)
    assert steps.max() == pytest.approx(24 * 0.1 * FRAME_S)
    assert (steps >= 0).all()
    assert found[-1] == 2.0


def test_a_subject_that_moves_is_followed_without_steps():
    walk = np.concatenate([np.full(12, 0.0), np.linspace(0, 4, 96), np.full(24, 4.0)])
    found = places(walk)
    under_way = slice(12 + 30, 12 + 96)
    np.testing.assert_array_equal(found[under_way], walk[under_way])
    assert found[-1] == 4.0


def test_nothing_measured_leaves_the_focus_where_it_is():
    assert (places([1.0, None, None, 1.05, None]) == 1.0).all()
    assert places([1.0, *[3.0] * 6, None, 3.0])[-1] == places([1.0, *[3.0] * 6])[-1]


def test_band_is_in_depths_of_focus():
    measured = np.r_[0.0, np.full(48, 0.5)]
    assert np.ptp(places(measured, depth=0.6)) == 0
    assert places(measured, depth=0.4)[-1] == 0.5
