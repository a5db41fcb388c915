"""Depth of field: closed forms of a thin lens, and rays of one's own through real ones."""

import math

import numpy as np
import pytest

from rptcam_cl import load_lens
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam, spot
from rptcam_cl.optics.best_focus import axial_blur, best_film_distance
from tests.support.cases import slow

THIN = {
    "name": "thin",
    "surfaces": [
        {"radius": 2000, "thickness": 0.001, "glass": {"index": 2}, "diameter": 10, "stop": True},
        {"radius": -2000, "diameter": 12},
    ],
}  # 1000 mm, f/100: an ideal lens, but for 1e-7 of aberration
CIRCLE = 0.03


def test_ideal_lens_has_the_limits_of_the_formula():
    lens = load_lens(THIN)
    table = lens.depth_of_field([8.0, 20.0, math.inf], circle_mm=CIRCLE).table
    f, number = lens.first_order().focal_length_mm, lens.first_order().f_number
    for row in table:
        focus = 1e3 * row["focus_m"]
        if math.isinf(focus):
            near, far = f * f / (number * CIRCLE) + f, math.inf
        else:  # a disk of the pupil's width D is cut to c where it is narrow: D |v' - v| / v' = c
            u = max(np.roots([1, -focus, focus * f]).real)
            v = focus - u
            pupil = f / number
            ends = [pupil * v / (pupil - CIRCLE), pupil * v / (pupil + CIRCLE)]
            near, far = (1 / (1 / f - 1 / end) + v for end in ends)
        assert 1e3 * row["near_m"] == pytest.approx(near, rel=2e-4)
        assert 1e3 * row["far_m"] == pytest.approx(far, rel=2e-4)
        assert row["near_thin_m"] == pytest.approx(1e-3 * near, rel=1e-6)
        assert row["far_thin_m"] == pytest.approx(1e-3 * far, rel=1e-6)
        assert 1e3 * row["hyperfocal_m"] == pytest.approx(f * f / (number * CIRCLE) + 2 * f + number * CIRCLE, rel=2e-4)
        assert row["hyperfocal_thin_m"] == pytest.approx(row["hyperfocal_m"], rel=2e-4)
        assert row["blur_mm"] < 1e-4


@pytest.mark.parametrize(("name", "number", "focus_m"), [("dgauss-50mm", 2.8, 2.0), slow("wide-22mm", 5.6, 1.5)])
def test_points_at_the_limits_of_a_real_lens_blur_as_wide_as_the_circle(name, number, focus_m):
    lens = load_lens(name)
    row = lens.depth_of_field([focus_m], [number], circle_mm=0.0288).table[0]
    stopped = lens.with_stop_diameter(lens.stop_diameter_for(number))
    film = best_film_distance(stopped, 1e3 * focus_m)
    rng = np.random.default_rng(1)
    radius = 0.8 * stopped.first_order().entrance_pupil.diameter_mm * np.sqrt(rng.random(20_000))
    turn = 2 * np.pi * rng.random(20_000)
    for end in ("near_m", "far_m"):
        front = 1e3 * row[end] - stopped.length - film
        on_plane = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros_like(turn)], axis=1)
        rays = stopped.trace([0, 0, -front] + 0 * on_plane, on_plane - [0, 0, -front], start="scene")
        where, way = rays.origins[rays.passed], rays.directions[rays.passed]
        at = where + (stopped.length + film - where[:, 2:]) / way[:, 2:] * way
        blur = 2 * math.sqrt(2 * np.mean(np.sum(at[:, :2] ** 2, axis=1)))
        assert blur == pytest.approx(0.0288, rel=0.015)  # of 5,000 rays or more
    assert row["near_m"] == pytest.approx(row["near_thin_m"], rel=0.01)


def test_blur_of_a_round_lens_is_that_of_its_spot():
    lens = load_lens("dgauss-50mm")
    for film, front in ((39.0, 700.0), (37.0, math.inf)):
        assert axial_blur(lens, film, front) == pytest.approx(spot(lens, film, Beam(0.0, front)).rms, rel=3e-3)


def test_a_lens_that_makes_nothing_as_sharp_has_no_depth_of_field():
    row = load_lens("biconvex").depth_of_field([1.0], circle_mm=0.01).table[0]
    assert row["near_m"] is row["far_m"] is row["hyperfocal_m"] is None
    assert row["blur_mm"] > 0.01
    assert row["near_thin_m"] < 1 < row["far_thin_m"]


def test_what_cannot_be_focused_is_refused():
    with pytest.raises(InputError, match="cannot focus at 50 mm"):
        load_lens("dgauss-50mm").depth_of_field([0.05])
    with pytest.raises(InputError, match="distances_m: must be above 0"):
        load_lens("dgauss-50mm").depth_of_field([0.0])
