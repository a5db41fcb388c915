"""Keys that change while the shutter is open: the picture is the mean over the steps of the exposure."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering.film import step_of
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.changes import exposure_steps, set_keys
from rptcam_cl.scene.load import load_scene
from tests.support.cases import fast

BALL = {"name": "ball", "shape": "sphere", "center": [0, 0, 0], "radius": 1}
SCENE = {
    "film": {"resolution": [24, 16]},
    "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
    "objects": [BALL | {"material": {"kind": "matte", "reflectance": 0.5}}],
    "environment": {"kind": "constant", "radiance": 1},
}
ZOOM = {"camera.fov_degrees": [{"time_s": 0, "value": 30}, {"time_s": 1, "value": 60}]}
DAWN = {"environment.radiance": [{"time_s": 0, "value": 1}, {"time_s": 2, "value": 5}]}


def moving(keys, steps=4, **shutter):
    return load_scene(SCENE | {"shutter": {"time_s": 1, "keys": keys, "steps": steps, **shutter}})


def test_picture_is_the_mean_over_the_steps():
    """The lamps of a dawn: 1 to 3 during the exposure, so 2, and 1.25 to 2.75 in the middles of four steps."""
    empty = set_keys(moving(DAWN), {"objects": []})
    assert rptcam_cl.render(empty, spp=4).pixels == pytest.approx(2.0, rel=1e-6)
    assert [step.environment.radiance[0] for step in exposure_steps(empty)] == [1.25, 1.75, 2.25, 2.75]
    once = rptcam_cl.render(empty, spp=1).pixels
    assert len(np.unique(once)) == 1  # a sample of every pixel is of the same step
    assert once[0, 0, 0] in (1.25, 1.75, 2.25, 2.75)


def test_zoom_is_the_mean_of_pictures_that_hold_still():
    scene = moving(ZOOM)
    stills = [rptcam_cl.render(set_keys(moving(ZOOM), {
        "camera.fov_degrees": 30 * (1 + (step + 0.5) / 4), "shutter": {"time_s": 1},
    }), spp=256).pixels for step in range(4)]  # fmt: skip
    blurred = rptcam_cl.render(scene, spp=256).pixels
    assert np.abs(blurred - np.mean(stills, axis=0)).max() < 0.05  # 64 samples of a step, whose noise is 0.04
    assert np.abs(blurred - stills[0]).max() > 0.3


def test_bits_depend_neither_on_waves_nor_on_parts(tmp_path):
    scene = moving(ZOOM, steps=3)
    whole = rptcam_cl.render(scene, spp=7).pixels
    np.testing.assert_array_equal(rptcam_cl.render(scene, spp=7, wave_size=256).pixels, whole)
    for part in ("1/2", "2/2"):
        rptcam_cl.render(scene, spp=7, part=part, checkpoint=tmp_path / f"{part[0]}.rpck")
    merged = rptcam_cl.merge([tmp_path / "1.rpck", tmp_path / "2.rpck"])
    np.testing.assert_array_equal(merged.pixels, whole)
    rptcam_cl.render(scene, spp=4, checkpoint=tmp_path / "a.rpck", resume=True)
    on = rptcam_cl.render(scene, spp=7, checkpoint=tmp_path / "a.rpck", resume=True)
    np.testing.assert_array_equal(on.pixels, whole)


def test_objects_move_on_within_the_steps():
    way = [{"time_s": 0}, {"time_s": 1, "translate": [2, 0, 0]}]
    scene = set_keys(moving(DAWN), {"objects.0.motion": way})
    places = [step.objects[0].placed_at(step.shutter.open_s)[0, 3] for step in exposure_steps(scene)]
    assert places == pytest.approx([0, 0.5, 1, 1.5])
    steps = [rptcam_cl.render(step, spp=64).pixels for step in exposure_steps(scene)]
    blurred = rptcam_cl.render(scene, spp=256).pixels
    assert blurred.mean() == pytest.approx(np.mean(steps), rel=0.01)
    assert np.abs(blurred - np.mean(steps, axis=0)).max() < 0.25


def test_physical_exposure_gathers_the_light_of_the_whole_time():
    lens = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 4}
    camera = {key: value for key, value in SCENE["camera"].items() if key in ("eye", "target")} | lens
    keys = {"camera.f_number": [{"time_s": 0, "value": 2}, {"time_s": 1, "value": 2}]}
    scene = set_keys(moving(keys, steps=3), {"camera": camera, "exposure": {"mode": "physical", "iso": 0.01}})
    plan = make_plan(scene)
    still = make_plan(set_keys(scene, {"shutter.keys": None, "shutter.steps": None}))
    for step in plan.steps:
        assert step.camera.record["exposure"][0] == pytest.approx(still.camera.record["exposure"][0], rel=1e-6)


@pytest.mark.slow
def test_layers_are_the_mean_over_the_steps():
    closer = {"camera.eye": [{"time_s": 0, "value": [0, 0, 4]}, {"time_s": 1, "value": [0, 0, 8]}]}
    image = rptcam_cl.render(moving(closer), spp=64, layers=["depth"])
    assert image["depth"][8, 12] == pytest.approx(5.0, abs=0.02)  # from 3 to 7, to the front of the ball


def test_every_step_is_seen_once_in_as_many_samples():
    order = [step_of(sample, 5) for sample in range(15)]
    assert all(sorted(order[first : first + 5]) == [0, 1, 2, 3, 4] for first in (0, 5, 10))
    assert len({tuple(order[first : first + 5]) for first in (0, 5, 10)}) > 1


def test_keys_without_use_cost_nothing():
    plan = make_plan(load_scene(SCENE))
    assert plan.steps == ()
    assert exposure_steps(load_scene(SCENE)) == []


QUAD = np.array([[-1.0, -9, 0], [1, -9, 0], [1, 9, 0], [-1, 9, 0]])
WIDE = np.diag([3.0, 1, 1])
DEFORMED = {
    "vertices": {"objects.0.vertices": (QUAD, QUAD @ WIDE)},
    "matrix": {"objects.0.transform.0.matrix": [np.eye(4)[:3].tolist(), np.hstack([WIDE, np.zeros((3, 1))]).tolist()]},
}


@pytest.mark.parametrize("kind", fast(["vertices"], DEFORMED))
def test_what_is_deformed_covers_each_place_for_its_time(kind):
    """A strip grows from 2 to 6 wide: a place at x is covered for (3 - x) / 2 of the exposure."""
    strip = {
        "shape": "mesh", "vertices": QUAD, "faces": [[0, 1, 2, 3]], "material": {"kind": "emissive", "radiance": 1},
        "transform": [{"matrix": np.eye(4)[:3].tolist()}],
    }  # fmt: skip
    keys = {
        name: [{"time_s": time, "value": value} for time, value in zip((0, 1), values, strict=True)]
        for name, values in DEFORMED[kind].items()
    }
    scene = {
        "film": {"resolution": [32, 2]},
        "camera": {"kind": "orthographic", "eye": [0, 0, 5], "target": [0, 0, 0], "width_m": 8},
        "objects": [strip],
        "shutter": {"time_s": 1, "keys": keys, "steps": 16},
    }
    picture = rptcam_cl.render(scene, spp=128).pixels[0, :, 0]
    middles = np.abs((np.arange(32) + 0.5) / 4 - 4)
    assert np.abs(picture - np.clip((3 - middles) / 2, 0, 1)).max() < 0.06  # a step is 0.06 of the time
