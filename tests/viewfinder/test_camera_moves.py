"""Moves of the camera: each turns or shifts it as a drag says, and keeps what it has to keep."""

import math

import numpy as np
import pytest

from rptcam_cl.scene.load import load_scene
from rptcam_cl.viewfinder.things import DOLLY, Viewpoint, moved, viewpoint_of


def stand(**keys: object) -> Viewpoint:
    camera = {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 5], "target": [0, 0, 0], **keys}
    return viewpoint_of(load_scene({"camera": camera, "film": {"resolution": [16, 9]}}))


def seen_at(where: Viewpoint, point: list[float]) -> tuple[float, float]:
    """Return where a camera sees a point, in fractions from the left and the top."""
    back = (where.eye - where.target) / np.linalg.norm(where.eye - where.target)
    right = np.cross(where.up, back)
    right /= np.linalg.norm(right)
    offset = np.subtract(point, where.eye)
    depth = -float(offset @ back)
    across = where.field / where.distance
    x = float(offset @ right) / depth / across
    y = float(offset @ np.cross(back, right)) / depth / (across * where.aspect)
    return 0.5 + x, 0.5 - y


def test_orbit_keeps_the_target_and_its_distance() -> None:
    before = stand()
    after = moved(before, "orbit", 0.3, 0.2, 0)
    assert np.array_equal(after.target, before.target)
    assert np.linalg.norm(after.eye) == pytest.approx(5)
    turned = moved(before, "orbit", 0.5, 0, 0)
    assert turned.eye == pytest.approx([-5, 0, 0])  # half the width: a quarter turn; what is near goes with the pointer


def test_what_is_near_follows_a_drag_that_orbits() -> None:
    near = [0.0, 0.0, 1.0]
    x, y = seen_at(moved(stand(), "orbit", 0.05, 0.05, 0), near)
    assert x > 0.5
    assert y > 0.5


@pytest.mark.parametrize("pull", [0.3, 5.0, -5.0, 10.0, -10.0])
def test_orbit_and_tilt_stop_before_the_poles(pull: float) -> None:
    for kind in ("orbit", "tilt"):
        where = stand()
        for _ in range(5):
            where = moved(where, kind, 0.1, pull, 0)
            view = where.target - where.eye
            sine = abs(view @ where.up) / np.linalg.norm(view)
            assert sine <= math.sin(math.radians(89.01)), kind
    assert np.linalg.norm(where.target - where.eye) == pytest.approx(5)


def test_pan_takes_the_plane_in_focus_with_the_pointer() -> None:
    after = moved(stand(), "pan", 0.2, -0.1, 0)
    assert seen_at(after, [0, 0, 0]) == pytest.approx((0.7, 0.4))


def test_tilt_turns_where_it_stands_and_the_picture_follows() -> None:
    before = stand()
    after = moved(before, "tilt", 0.1, 0.1, 0)
    assert np.array_equal(after.eye, before.eye)
    x, y = seen_at(after, [0, 0, 0])
    assert (x, y) == pytest.approx((0.6, 0.6), abs=0.01)


def test_dolly_goes_towards_what_is_in_focus_and_never_through_it() -> None:
    after = moved(stand(), "dolly", 0, 1, 0)
    assert after.eye == pytest.approx([0, 0, 5 * (1 - DOLLY)])
    where = stand()
    for _ in range(100):
        where = moved(where, "dolly", 0, 10, 0)
    assert np.isfinite(where.eye).all()
    assert np.linalg.norm(where.target - where.eye) > 1e-6
    back = moved(moved(stand(), "dolly", 0, 3, 0), "dolly", 0, 0, 0)
    assert back.eye[2] < 5


def test_walk_takes_the_target_along() -> None:
    before = stand()
    after = moved(before, "walk", 1, 2, 3)
    assert after.eye - before.eye == pytest.approx([0.1, 0.3, -0.2])
    assert after.target - before.target == pytest.approx([0.1, 0.3, -0.2])


def test_roll_turns_up_alone() -> None:
    before = stand()
    after = moved(before, "roll", 9, 0, 0)
    assert abs(after.up) == pytest.approx([1, 0, 0], abs=1e-12)
    assert list(after.changes(before)) == ["camera.up"]


def test_moves_there_and_back_are_no_move() -> None:
    before = stand(eye=[3, 1, 4], target=[1, 0, 0])
    for kind in ("orbit", "pan", "walk", "tilt", "roll"):
        after = moved(moved(before, kind, 0.1, 0, 0), kind, -0.1, 0, 0)
        assert after.eye == pytest.approx(before.eye), kind
        assert after.target == pytest.approx(before.target), kind


def test_camera_with_keyframes_is_moved_from_where_it_is_when_the_shutter_opens() -> None:
    frames = [{"time_s": 0, "eye": [0, 0, 5]}, {"time_s": 1, "eye": [0, 0, 6]}]
    assert stand(motion=frames).eye == pytest.approx([0, 0, 5])
