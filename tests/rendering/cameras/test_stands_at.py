"""A camera that stands by its entrance pupil: the centre of its perspective is the eye, whatever the lens does."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_models import view
from rptcam_cl.rendering.cameras.setting import entrance_pupil, lens_setting, on_film, pupil_in_world
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.studies.tier_models import equivalent

EYE, TARGET = np.array([1.0, 2.0, 3.0]), np.array([1.4, 1.5, -1.0])
POINT = (EYE + 1.2 * (TARGET - EYE) / np.linalg.norm(TARGET - EYE) + [0.0, 0.05, 0.0]).tolist()
SPHERE = {
    "name": "ball", "shape": "sphere", "center": POINT, "radius": 0.1,
    "material": {"kind": "matte", "reflectance": [0.6, 0.5, 0.2]},
}  # fmt: skip
LENSES = {
    "whole lens": {"lens": "dgauss-50mm", "focus": {"distance_m": 1.3}},
    "to a point": {"lens": "dgauss-50mm", "focus": {"point": POINT}},
    "to an object": {"lens": "dgauss-50mm", "focus": {"object": "ball"}},
    "least spot": {"lens": "dgauss-50mm", "focus": {"point": POINT, "method": "spot"}},
    "group": {"lens": "zoom-70-200mm", "focus": {"point": POINT}},
    "natural size": {"lens": "macro-55mm", "focus": {"point": (EYE + 0.1045 * (TARGET - EYE) / 4.051).tolist()}},
    "film placed": {"lens": "telephoto-250mm", "focus": {"film_distance_mm": 90.0}},
    "thick": {"kind": "thick_lens", "lens": "dgauss-50mm", "focus": {"point": POINT}},
    "from the front": {"lens": "retrofocus-28mm", "focus": {"front_distance_m": 0.8}},
}


def scene(camera, **keys):
    pose = {"kind": "realistic", "eye": EYE.tolist(), "target": TARGET.tolist(), "stands_at": "entrance_pupil"}
    return load_scene({
        "film": {"resolution": [37, 25], "size_mm": [37, 25]}, "camera": pose | camera, "objects": [SPHERE],
        "environment": {"kind": "constant", "radiance": [1, 1, 1]},
    } | keys)  # fmt: skip


@pytest.mark.parametrize("name", LENSES)
def test_entrance_pupil_is_at_the_eye(name):
    given = scene(LENSES[name])
    placed = on_film(given)
    pupil = entrance_pupil(placed, lens_setting(placed), drifts=False)
    assert pupil_in_world(placed, pupil.described())["world_m"] == pytest.approx(EYE, abs=1e-9)
    assert pupil.ahead_mm > 1
    assert view(given).pose()[:3, 3] == pytest.approx(EYE, abs=1e-9)
    assert lens_setting(given).film_distance_mm == lens_setting(placed).film_distance_mm


@pytest.mark.parametrize("name", ["to a point", "to an object", "group", "natural size", "thick"])
def test_what_it_is_focused_on_is_as_far_from_the_pupil_as_in_the_scene(name):
    given = scene(LENSES[name])
    point = np.array(LENSES[name]["focus"].get("point", POINT))
    placed = on_film(given)
    setting = lens_setting(placed)
    ahead_m = entrance_pupil(placed, setting, drifts=False).ahead_mm * 1e-3
    forward = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    assert setting.focus_distance_mm * 1e-3 - ahead_m == pytest.approx((point - EYE) @ forward, rel=1e-8)


@pytest.mark.slow
def test_picture_is_that_of_a_film_so_far_behind():
    """And the layers: the way back is taken from the lens of a camera on its film, whose distance sets the same."""
    camera = LENSES["whole lens"]
    film = scene(camera | {"stands_at": "film"})
    behind = entrance_pupil(film, lens_setting(film), drifts=False).ahead_mm * 1e-3
    shift = behind * pose_matrix(np.array([EYE, TARGET, [0, 1, 0]]))[:3, 2]
    there = {"eye": (EYE + shift).tolist(), "target": (TARGET + shift).tolist(), "stands_at": "film"}
    layers = ["depth", "normal", "sharp_depth", "pupil_depth"]
    moved, given = (rptcam_cl.render(scene(camera | keys), spp=16, layers=layers, seed=3) for keys in (there, {}))
    np.testing.assert_allclose(given.pixels, moved.pixels, rtol=1e-5)
    for name in layers:
        np.testing.assert_allclose(given[name], moved[name], rtol=1e-5, atol=1e-6)
    middle = (12, 18)
    forward = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    aside = np.array(POINT) - EYE - ((np.array(POINT) - EYE) @ forward) * forward
    near = (np.array(POINT) - EYE) @ forward - np.sqrt(0.1**2 - aside @ aside)
    assert given["pupil_depth"][middle] == pytest.approx(near, abs=0.001)
    assert given.metadata["world_from_camera"] == pytest.approx(np.array(moved.metadata["world_from_camera"]))
    assert given.metadata["entrance_pupil"]["world_m"] == pytest.approx(EYE, abs=1e-9)


def test_film_goes_along_an_arc_while_the_camera_turns():
    turning = [{"time_s": 0.0}, {"time_s": 1.0, "target": [5.0, 2.5, 3.0]}, {"time_s": 2.0, "eye": [1.0, 2.0, 4.0]}]
    given = scene(LENSES["whole lens"] | {"motion": turning}, shutter={"time_s": 2.0})
    placed = on_film(given)
    ahead = entrance_pupil(placed, lens_setting(placed), drifts=False).ahead_mm * 1e-3
    for time_s in np.linspace(-0.1, 2.1, 57):
        matrix = pose_matrix(placed.camera.pose_at(time_s))
        wanted = pose_matrix(given.camera.pose_at(time_s))
        np.testing.assert_allclose(matrix[:3, 3] - ahead * matrix[:3, 2], wanted[:3, 3], atol=1e-6)
        np.testing.assert_allclose(matrix[:3, :3], wanted[:3, :3], atol=1e-12)
    assert len(placed.camera.motion) > 100


@pytest.mark.parametrize("name", ["whole lens", "to an object"])
def test_film_stays_where_it_is_in_the_steps_of_an_exposure(name):
    opened = [{"time_s": time_s, "value": value} for time_s, value in ((0.0, 2.8), (1.0, 8.0))]
    given = scene(LENSES[name], shutter={"time_s": 1.0, "steps": 2, "keys": {"camera.f_number": opened}})
    still = on_film(scene(LENSES[name]))
    plan = make_plan(given)
    assert len(plan.steps) == 2
    for step, f_number in zip(plan.steps, (4.1, 6.7), strict=True):
        assert step.eye_m == pytest.approx(still.camera.eye, abs=1e-12)
        assert step.camera.setting.film_distance_mm == pytest.approx(lens_setting(still).film_distance_mm, abs=1e-9)
        assert step.camera.setting.metadata["f_number"] == pytest.approx(f_number)


@pytest.mark.slow
def test_session_stays_at_the_pupil_while_the_focus_is_pulled():
    given = scene(LENSES["whole lens"])
    with rptcam_cl.RenderSession(given) as session:
        for keys in ({"camera.focus.distance_m": 0.7}, {"camera.f_number": 8}, {"camera.eye": [1.0, 2.0, 2.9]}):
            session.change(keys)
            given = rptcam_cl.load_scene(given.model_dump(exclude_unset=True), [f"{k}={v}" for k, v in keys.items()])
            session.take(4)
            image = session.image()
            assert image.metadata["entrance_pupil"]["world_m"] == pytest.approx(given.camera.eye, abs=1e-9)
            np.testing.assert_array_equal(image.pixels, rptcam_cl.render(given, spp=4).pixels)


@pytest.mark.parametrize("tier", ["pinhole", "thin_lens", "thick_lens"])
def test_cheaper_models_stand_in_the_same_pupil(tier):
    cheaper = equivalent(scene(LENSES["to a point"]), tier)
    assert view(cheaper).pose()[:3, 3] == pytest.approx(EYE, abs=1e-8)


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match=r"camera\.stands_at: moves the film, which autofocus has in its place"):
        scene({"lens": "dgauss-50mm", "focus": {"auto": "contrast"}})
    moved = {"camera.eye": [{"time_s": 0.0, "value": EYE.tolist()}, {"time_s": 1.0, "value": TARGET.tolist()}]}
    with pytest.raises(InputError, match=r"camera\.stands_at: does not go with keys that move"):
        scene(LENSES["whole lens"], shutter={"time_s": 1.0, "keys": moved})
    with pytest.raises(InputError, match=r"camera\.stands_at: .*allowed: film"):
        focus_drive(scene(LENSES["whole lens"]))
    telecentric = {
        "name": "stop in the back focal plane",
        "surfaces": [
            {"radius": 50.0, "thickness": 4.0, "glass": {"index": 1.5}, "diameter": 20},
            {"thickness": 100.0 - 4.0 / 1.5, "diameter": 20},
            {"stop": True, "thickness": 30.0, "diameter": 10},
        ],
    }
    with pytest.raises(InputError, match=r"camera\.stands_at: the entrance pupil of .* lies at infinity"):
        on_film(scene({"lens": telecentric, "focus": {"film_distance_mm": 40.0}}))
