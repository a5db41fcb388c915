"""Focus that follows an object: exactly at its middle, where camera and object are when the shutter opens."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.changes import at_opening, exposure_steps, set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.viewfinder.lens_panel import perspective

MATERIAL = {"kind": "matte", "reflectance": 0.5}
BALL = {
    "name": "ball", "shape": "sphere", "center": [0, 1, -1], "radius": 0.2, "material": MATERIAL,
    "transform": {"translate": [0, 0, -1]},
    "motion": [{"time_s": 0, "translate": [0, 0, 0]}, {"time_s": 2, "translate": [0, 0, -4]}],
}  # fmt: skip
REAL = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 1, 0], "target": [0, 1, -1]}
THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "eye": [0, 1, 0], "target": [0, 1, -1]}


def scene(camera, objects=(BALL,), **parts):
    camera = camera | {"focus": {"object": "ball"}}
    return load_scene({
        "film": {"resolution": [24, 16]}, "camera": camera, "objects": list(objects),
        "environment": {"kind": "constant", "radiance": 1}, "sequence": {"frames_per_second": 2},
    } | parts)  # fmt: skip


def frame(given, number):
    return set_keys(given, given.sequence.changes(given.shutter.open_s, number))


def test_plane_of_focus_goes_with_the_object_from_frame_to_frame():
    real, thin = scene(REAL), scene(THIN)
    for number, distance in ((1, 2.0), (2, 3.0), (3, 4.0), (5, 6.0), (9, 6.0)):
        assert lens_setting(frame(real, number)).focus_distance_mm == pytest.approx(1e3 * distance, rel=1e-12)
        metadata = make_plan(frame(thin, number)).camera.metadata
        assert metadata["focus_distance_m"] == pytest.approx(distance, rel=1e-12)
        assert perspective(frame(thin, number)).focus_mm == pytest.approx(1e3 * distance, rel=1e-12)


def test_camera_that_moves_sees_it_nearer_and_units_count():
    moving = REAL | {"motion": [{"time_s": 0}, {"time_s": 2, "eye": [0, 1, 1], "target": [0, 1, 0]}]}
    given = frame(scene(moving, metres_per_unit=0.5), 3)
    assert camera_model(given).metadata["focus_distance_m"] == pytest.approx(0.5 * 4.5, rel=1e-9)


def test_it_is_the_middle_of_what_is_turned_and_scaled():
    box = {
        "name": "ball", "shape": "box", "min": [0, 0, -3], "max": [1, 2, -1], "material": MATERIAL,
        "transform": [{"scale": 2}, {"rotate": {"axis": [0, 1, 0], "degrees": 90}}, {"translate": [5, 0, -6]}],
    }  # fmt: skip
    # the middle (0.5, 1, -2), doubled (1, 2, -4), turned (-4, 2, -1), shifted (1, 2, -7)
    assert lens_setting(scene(REAL, [box])).focus_distance_mm == pytest.approx(7e3, rel=1e-12)
    corners = {"vertices": [[0, 0, -3], [1, 0, -3], [0, 1, -5]], "faces": [[0, 1, 2]]}
    mesh = {"name": "ball", "shape": "mesh", **corners, "material": MATERIAL}
    assert lens_setting(scene(REAL, [mesh])).focus_distance_mm == pytest.approx(4e3, rel=1e-12)


def test_focus_follows_while_the_shutter_is_open():
    keys = {"camera.f_number": [{"time_s": 0, "value": 4}]}
    given = scene(REAL, shutter={"time_s": 1, "keys": keys, "steps": 4})
    found = [lens_setting(step).focus_distance_mm for step in exposure_steps(given)]
    assert found == pytest.approx([2000, 2500, 3000, 3500])


def test_method_stays_and_another_focus_replaces_it():
    spot = at_opening(set_keys(scene(REAL), {"camera.focus.method": "spot"}))
    assert (spot.camera.focus.method, np.asarray(spot.camera.focus.point).tolist()) == ("spot", [0, 1, -2])
    assert set_keys(scene(REAL), {"camera.focus.distance_m": 3}).camera.focus.object is None
    assert set_keys(scene(THIN), {"camera.focus_distance_m": 3}).camera.focus is None


def test_picture_is_of_the_object_that_has_the_name():
    two = [BALL, BALL | {"name": "other"}]
    swapped = [BALL | {"name": "other"}, BALL]
    assert scene(REAL, two).content_hash() != scene(REAL, swapped).content_hash()


@pytest.mark.parametrize("camera", [REAL, THIN])
@pytest.mark.parametrize(
    ("objects", "message"),
    [
        ([], "camera.focus.object: is no name of an object (got 'ball'"),
        ([BALL | {"name": "bell"}], "is no name of an object; did you mean bell?"),
        ([{"name": "ball", "shape": "plane", "point": [0, 0, 0], "normal": [0, 1, 0], "material": MATERIAL}],
         "is no name of an object"),
    ],
)  # fmt: skip
def test_object_that_is_not_there_is_refused(camera, objects, message):
    with pytest.raises(InputError) as caught:
        scene(camera, objects)
    assert message in str(caught.value)


@pytest.mark.parametrize("camera", [REAL, THIN])
def test_object_behind_the_camera_is_refused(camera):
    behind = scene(camera | {"eye": [0, 1, -9], "target": [0, 1, -10]})
    with pytest.raises(InputError, match=r"camera\.focus\.object: ball does not lie in front of the camera at 0 s"):
        make_plan(behind)
