"""Keyframes and shutters as a scene file says them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.load import load_scene
from tests.rendering.motion.pictures import BALL, PINHOLE, scene_with

LENS = {
    "kind": "realistic",
    "lens": "dgauss-50mm",
    "focus": {"point": [0, 1, 0]},
    "eye": [0, 1, 5],
    "target": [0, 1, 0],
}


def with_camera(*frames, kind=PINHOLE, **shutter):
    return scene_with(camera=kind | {"motion": list(frames)}, shutter=shutter)


def with_shutter(**shutter):
    return scene_with(shutter=shutter)


REFUSED = [
    (
        with_camera({"time_s": 1}, {"time_s": 1}),
        r"camera.motion\[1\].time_s: does not come after the keyframe before it",
    ),
    (with_camera({"eye": [0, 0, 0]}), r"camera.motion\[0\].time_s: is required but missing"),
    (with_camera({"time_s": 0, "eyes": [0, 0, 0]}), r"camera.motion\[0\].eyes: unknown key; did you mean eye\?"),
    (
        with_camera({"time_s": 0}, {"time_s": 1, "up": [0, -1, 0]}),
        r"camera.motion\[0\]: leads to a moment without a view",
    ),
    (
        with_camera({"time_s": 0, "eye": [0, 1, 0]}),
        r"camera.motion\[0\]: leads to a moment without a viewing direction",
    ),
    (with_camera({"time_s": 0, "up": [0, 0, 1]}), r"camera.motion\[0\]: .*parallel to up"),
    (with_camera({"time_s": 0}, {"time_s": 1, "target": [0, 1, 9]}), r"camera.motion\[0\]: leads to a moment"),
    (
        with_camera({"time_s": 0, "eye": [0, 1, -5], "target": [0, 1, -9]}, kind=LENS),
        r"camera.focus.point: does not lie in front of the film when the shutter opens",
    ),
    (with_shutter(kind="rolling"), r"shutter.kind: needs readout_s"),
    (with_shutter(readout_s=0.1), r"shutter.readout_s: belongs to a rolling shutter"),
    (with_shutter(direction="bottom_up"), r"shutter.direction: belongs to a rolling shutter"),
    (with_shutter(kind="rolling", readout_s=-1), r"shutter.readout_s: is out of range"),
    (with_shutter(kind="rolling", readout_s=1, direction="down"), r"shutter.direction: is not a known choice"),
    (with_shutter(open_s="soon"), r"shutter.open_s: is neither a number nor a fraction"),
]


TURN = [[0, -1, 0, 3], [1, 0, 0, 4], [0, 0, 1, 5]]  # by 90 degrees about z


def with_ball(*frames):
    return scene_with(objects=[BALL | {"motion": list(frames)}])


REFUSED += [
    (
        with_ball({"time_s": 0, "matrix": TURN, "translate": [0, 0, 0]}),
        r"objects\[0\].motion\[0\].matrix: says what rotate",
    ),
    (with_ball({"time_s": 0, "matrix": (2 * np.array(TURN)).tolist()}), r"motion\[0\].matrix: does more than turn"),
    (with_ball({"time_s": 0, "matrix": [[-1, 0, 0, 0], *TURN[1:]]}), r"motion\[0\].matrix: does more than turn"),
    (with_ball({"time_s": 0, "matrix": [[-1, 0, 0, 0], [0, 1, 0, 0], TURN[2]]}), r"matrix: does more than turn"),
    (with_ball({"time_s": 0, "matrix": TURN[:2]}), r"motion\[0\].matrix: must be 3 or 4 rows"),
]


@pytest.mark.parametrize(("scene", "message"), REFUSED)
def test_what_cannot_be_is_refused(scene, message):
    with pytest.raises(InputError, match=message):
        load_scene(scene)


def test_keyframes_by_matrix_are_those_by_turn_and_shift():
    """SciPy's turns about a random axis, at the keyframes and on the way between them."""
    first, second = Rotation.from_rotvec([0.3, -0.2, 0.5]), Rotation.from_rotvec([-0.4, 0.9, 0.1])
    rows = [np.column_stack([turn.as_matrix(), [k, 2, -k]]) for k, turn in enumerate((first, second))]
    made = with_ball(*({"time_s": k, "matrix": matrix.astype(np.float32).tolist()} for k, matrix in enumerate(rows)))
    way = load_scene(made).objects[0].trajectory
    between = Slerp([0, 1], Rotation.concatenate([first, second]))
    for time in (0, 0.25, 0.9, 1):
        expected = np.column_stack([between(time).as_matrix(), [time, 2, -time]])
        np.testing.assert_allclose(way.at(time)[:3], expected, atol=1e-6)
    still = load_scene(with_ball({"time_s": 0, "matrix": np.eye(4)[:3].tolist()})).objects[0]
    np.testing.assert_array_equal(still.placed_at(7), np.eye(4))


def test_view_that_vanishes_for_one_moment_is_found_wherever_it_is():
    """The target passes through the eye at an odd share of the way."""
    for share in (1e-3, 0.1234567, 0.5, 0.99):
        far = 5 / share
        frames = [{"time_s": 0}, {"time_s": 1, "target": [0, 1, far]}]
        with pytest.raises(InputError, match="without a viewing direction"):
            load_scene(with_camera(*frames, kind=PINHOLE | {"target": [0, 1, 0]}))
        frames[1]["target"] = [far / 10, 1, far]  # passes beside it
        load_scene(with_camera(*frames))


def test_camera_at_opening_keeps_its_way():
    frames = [{"time_s": 0}, {"time_s": 2, "eye": [2, 1, 5]}, {"time_s": 3, "up": [1, 1, 0]}]
    scene = load_scene(with_camera(*frames, open_s=1, time_s=1))
    opened = at_opening(scene)
    assert opened.camera.eye == (1, 1, 5)
    for time in (0, 1, 2.5, 4):
        np.testing.assert_array_equal(opened.camera.pose_at(time), scene.camera.pose_at(time))
    assert at_opening(opened).model_dump() == opened.model_dump()


def test_fractions_are_read_for_moments_as_well():
    scene = load_scene(with_camera({"time_s": "-1/8"}, {"time_s": "1/50"}, time_s="1/25", open_s="1/100"))
    assert [frame.time_s for frame in scene.camera.motion] == [-0.125, 0.02]
    assert scene.shutter.span_s == (0.01, 0.05)
    with pytest.raises(InputError, match=r"shutter.open_s: is neither a number nor a fraction"):
        load_scene(with_shutter(open_s="--1/25"))
