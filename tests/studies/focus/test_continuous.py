"""Continuous autofocus: subjects that move by formulas, seen through a thin lens in float64, followed by the servo."""

import math

import numpy as np
import pytest

from rptcam_cl.scene.exposure import ContinuousFocus
from rptcam_cl.studies.focus.servo import (
    DriveLimits,
    FrameFocus,
    Servo,
    doubts_of,
    moved,
    push,
    servo_plot,
    slopes,
    summary_of,
)

FPS, FOCAL_M = 24, 0.05
SHARP_MM = 2 * 2 * math.hypot(36, 24) / 1500  # 2 N c at f/2
USUAL = DriveLimits((47.0, 100.0), 30.0, 600.0)


def image_mm(distance_m):
    """Where a thin lens has its picture of what is so far away."""
    return 1e3 / (1 / FOCAL_M - 1 / np.asarray(distance_m))


def follow(distance_m, seconds, noise=0.0, seed=0, limits=USUAL, settings=None, unseen=()):
    """Return times, errors [depths of focus], places [mm] and whether the drive was too slow for each frame."""
    times = np.arange(round(seconds * FPS)) / FPS
    subject = image_mm([distance_m(t) for t in times])
    seen = subject + SHARP_MM * noise * np.random.default_rng(seed).normal(size=len(times))
    servo = Servo(seen[0], limits, lambda place: 1 / FOCAL_M - 1e3 / place, settings or ContinuousFocus())
    limited, places = [False], [seen[0]]
    servo.measure(seen[0], noise * SHARP_MM)
    for number in range(1, len(times)):
        servo.next_frame(1 / FPS, SHARP_MM)
        limited.append(servo.is_limited)
        places.append(servo.place)
        servo.measure(None if number in unseen else seen[number], noise * SHARP_MM)
    return times, (np.array(places) - subject) / SHARP_MM, np.array(places), limited


def share(errors):
    return np.mean(np.abs(errors) <= 0.5)


@pytest.mark.parametrize(("speed", "start"), [(1.4, 6.0), (5.0, 15.0), (14.0, 40.0)])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_subjects_that_come_are_sharp_in_19_of_20_frames(speed, start, noise):
    _, errors, _, _ = follow(lambda t: start - speed * t, (start - 1.3) / speed, noise)
    assert share(errors) >= 0.95


@pytest.mark.slow
def test_subjects_that_speed_up_brake_and_turn_are_sharp_in_19_of_20_frames():
    motions = (
        (lambda t: 20 - 3 * t * t, 2.4),  # 6 m/s^2
        (lambda t: 3 + 2.5 * (2 - min(t, 2)) ** 2, 3),  # 5 m/s^2, then at rest
        (lambda t: 3 + math.cos(2 * t), 6),  # to and fro, up to 4 m/s^2 at 2 m
        (lambda t: 2.5 + 0.6 * math.cos(4 * t), 6),  # up to 10 m/s^2 at 1.9 m
    )
    for motion, seconds in motions:
        _, errors, _, _ = follow(motion, seconds, 0.05)
        assert share(errors) >= 0.95


def test_a_late_measurement_alone_would_not_do():
    # what was measured two frames ago, at 5 m/s and 2 m: 5 * 2 / 24 m, of which 0.5 depths of focus are 0.09 m
    times = np.arange(64) / FPS
    late = image_mm(15 - 5 * times[2:]) - image_mm(15 - 5 * times[:-2])
    assert np.mean(late / SHARP_MM <= 0.5) < 0.85


def test_focus_on_a_subject_at_rest_does_not_pump():
    spans, moves = [], []
    for seed in (1, 2, 3):
        _, errors, places, _ = follow(lambda t: 2.0, 6, 0.05, seed)
        spans.append(np.ptp(places[FPS:]) / SHARP_MM)
        moves.append(np.mean(np.abs(np.diff(places[FPS:])) > 1e-3 * SHARP_MM))
        assert share(errors) == 1
    assert np.mean(spans) <= 0.25  # the noise of four measurements in a row moves the prediction by as much
    assert max(spans) <= 0.4
    assert np.mean(moves) <= 0.05  # it stands, most of the time


def test_what_crosses_the_picture_is_let_pass_and_a_change_is_followed_after_the_lock():
    _, _, places, _ = follow(lambda t: 2.0 if 1 <= t < 1.2 else 4.0, 3)
    assert np.ptp(places) == 0
    times, errors, places, _ = follow(lambda t: 2.0 if t >= 1 else 4.0, 3)
    assert np.ptp(places[times < 1.25]) == 0
    assert np.abs(errors[times > 1.55]).max() <= 0.5  # lock, delay, and 0.66 mm at 30 mm/s
    assert places.max() - image_mm(2.0) <= 0.25 * SHARP_MM  # without overshoot


def test_prediction_goes_on_for_the_lock_where_nothing_is_found_and_then_the_focus_stays():
    times, errors, places, _ = follow(lambda t: 12 - 4 * t, 2, unseen=range(24, 99))
    assert np.abs(errors[24:30]).max() < 0.5
    assert np.ptp(places[times > 23 / FPS + 0.05 + 0.25 + 0.1]) == pytest.approx(0, abs=1e-3 * SHARP_MM)


def test_beyond_the_speed_of_the_drive_the_frames_say_so():
    slow = DriveLimits((47.0, 100.0), 1.0, 20.0)
    times, errors, places, limited = follow(lambda t: 12 - 5 * t, 2.2, limits=slow)
    # the image goes faster than 1 mm/s from where f^2 v / s^2 = 1 mm/s on: from 3.5 m
    late = times > (12 - 3.5) / 5 + 0.2
    assert np.abs(errors[late]).max() > 2
    assert all(np.array(limited)[late])
    assert not any(limited[1:20])
    assert np.abs(np.diff(places)).max() <= 1.0 / FPS * (1 + 1e-9)
    rows = [FrameFocus(k, k / FPS, 2.0, 2.0, 2.1, float(e), 0.0, k > 40) for k, e in enumerate(errors)]
    assert "faster than the focus drive in" in doubts_of(rows)[0]
    assert "within 0.5 depth of focus in" in summary_of(rows)
    servo_plot([*rows, FrameFocus(99, 4.1, None, None, None, None, 0.0, False)], "title")


@pytest.mark.parametrize(("away", "speed"), [(5.0, 0.0), (0.3, 0.0), (0.01, 0.0), (1.0, -30.0)])
def test_drive_keeps_its_limits_and_comes_to_rest_in_its_time(away, speed):
    place, step_s, path = 50.0, 1e-3, []
    for _ in range(1500):
        place, new = push(place, speed, 50.0 + away, 0.0, step_s, USUAL)
        assert abs(new) <= 30.0 * (1 + 1e-12)
        assert abs(new - speed) <= 600 * step_s * (1 + 1e-9)
        speed = new
        path.append(place)
    wanted = 50.0 + away
    assert max(path) - wanted <= 0.02 * away
    assert path[-1] == pytest.approx(wanted, abs=1e-6)
    if speed == 0 and away == 5.0:  # a trapezium of speeds: 5 mm / 30 mm/s and 30 / 600 s
        arrived = np.argmax(np.array(path) > wanted - 0.01) * step_s
        assert arrived == pytest.approx(5 / 30 + 30 / 600, abs=0.02)


@pytest.mark.parametrize("acceleration", [0.0, -3.0])
def test_motion_is_that_of_even_acceleration_and_its_errors_go_by_the_slopes(acceleration):
    state = np.array([1 / 6, 4 / 36, acceleration])  # 6 m away, 4 m/s nearer
    vergence, rate, _ = moved(state, 0.5)
    assert 1 / vergence == pytest.approx(4.0 + acceleration / 8, rel=1e-12)
    assert rate == pytest.approx((4 - acceleration / 2) * vergence**2, rel=1e-12)
    for start in (state, np.array([-0.01, 0.02, acceleration])):  # beyond infinity, too
        found = [(moved(start + step, 0.5) - moved(start - step, 0.5)) / 2e-6 for step in 1e-6 * np.eye(3)]
        assert slopes(start, 0.5) == pytest.approx(np.stack(found, axis=1), rel=1e-5, abs=1e-8)
    assert np.isfinite(moved(np.array([1e-3, -1.0, 9.0]), 5.0)).all()  # nonsense ends in numbers
