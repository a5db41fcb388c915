"""The tests of motion themselves: each deliberate fault in a copy of the kernels must make one of them fail."""

import numpy as np
import pytest

from rptcam_cl.rendering.plan import geometry as movement
from tests.device.probes import open_session
from tests.rendering.motion import test_camera_motion as camera
from tests.rendering.motion import test_moments as moments
from tests.rendering.motion import test_object_motion as objects
from tests.rendering.motion import test_streaks as streaks
from tests.rendering.motion import test_swept_boxes as boxes
from tests.support.mutants import Mutant, assert_found, each_mutant

pytestmark = pytest.mark.slow


def moment(group="coated", t=1.7):
    moments.test_exposure_at_one_time_is_the_still_picture(open_session(), group, t)


def rolling(direction="bottom_up"):
    streaks.test_rolling_shutter_slants_a_bar_by_its_way_from_row_to_row(open_session(), direction)


def spread():
    camera.test_samples_of_a_pixel_are_spread_over_the_exposure(open_session())


def by_camera():
    camera.test_part_of_the_way_is_the_mean_of_that_part(open_session())


MUTANTS = [
    Mutant("shadows at the opening", "shadow.ray.time = path.ray.time;", "shadow.ray.time = ZERO;", moment),
    Mutant("shading normals left behind", "s.n = vector_in_world(placing, s.n);", "", moment),
    Mutant("tangents left behind", "s.tangent = vector_in_world(placing, s.tangent);", "", moment),
    Mutant("turns before the segment forgotten", "p.w = p.w * w - dot3(p.v, before);", "p.w = p.w;", moment),
    Mutant("holes of the opening", "surface_point(i, along(here.o, here.d, lanes ? t : ZERO)",
           "surface_point(i, along(ray.o, ray.d, lanes ? t : ZERO)", lambda: moment("open")),
    Mutant("turned the other way", "0.5f * share * OF_SEGMENT_HERE(travel.w)",
           "-0.5f * share * OF_SEGMENT_HERE(travel.w)", moment),
    Mutant("half a turn for each", "F half_turns = 0.5f * share", "F half_turns = 0.25f * share", moment),
    Mutant("rows for columns", "shutter.z * TO_F(lane.x) + shutter.w * TO_F(lane.y)",
           "shutter.w * TO_F(lane.x) + shutter.z * TO_F(lane.y)", rolling),
    Mutant("the first segment alone", "next < end; next += 6", "next < 8; next += 6", by_camera),
    Mutant("times as one likes", "path_numbers(draw.lane.pixel, draw.lane.sample, seed).b",
           "unit_float(hash4(draw.lane.pixel, draw.lane.sample, (U)(99u), seed).b)", spread),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_is_found(mutant):
    assert_found(mutant)


def test_box_that_leaves_out_the_bend_of_a_turn_is_found(monkeypatch):
    places = movement.ObjectMovements.places

    def straight(self, primitive):
        found = places(self, primitive)
        return movement.Places(found.matrices, found.pivots, np.zeros_like(found.bends))

    monkeypatch.setattr(movement.ObjectMovements, "places", straight)
    with pytest.raises(AssertionError):
        boxes.test_box_holds_the_body_at_every_moment("a screw")


def test_tree_that_knows_things_at_rest_alone_is_found(monkeypatch):
    box = movement.Places.box
    monkeypatch.setattr(movement.Places, "box", lambda self, low, high, rest: box(self, low, high, rest) and rest)
    with pytest.MonkeyPatch.context() as patch, pytest.raises(AssertionError):
        objects.test_tree_over_primitives_changes_no_bit(open_session(), patch)
