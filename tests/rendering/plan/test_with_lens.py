"""A plan whose lens alone is another: what making it anew gives."""

from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest

from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.plan.plan import make_plan, with_exposure, with_lens, with_pose
from rptcam_cl.rendering.plan.primitives import PlanParts, TablePlaces
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene

SCENE: dict[str, Any] = {
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 6},
        "eye": [0, -6, 1.5], "target": [0, 0, 0.5], "up": [0, 0, 1],
    },
    "film": {"resolution": [16, 12]},
    "materials": {
        "grey": {"kind": "matte", "reflectance": 0.5},
        "lamp": {"kind": "emissive", "radiance": 10},
        "glass": {"kind": "dielectric", "index": 1.5},
    },
    "objects": [
        {"shape": "sphere", "center": [0, 0, 0.5], "radius": 0.5, "material": "glass"},
        {"shape": "sphere", "center": [0, 0, 4], "radius": 0.5, "material": "lamp"},
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": "grey"},
    ],
    "lights": [{"kind": "point", "position": [1, 0, 3], "intensity": 5}],
}  # fmt: skip

DISPERSIVE = SCENE | {"camera": SCENE["camera"] | {"lens": "double-gauss-50mm-f1.8"}}


def assert_same(one: Any, other: Any, where: str = "plan") -> None:
    """Compare two values to the bit, arrays and records in them too."""
    assert type(one) is type(other), where
    if isinstance(one, TablePlaces):
        one, other = one.origin, other.origin  # its object may show another material
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype and one.tobytes() == other.tobytes(), where
    elif is_dataclass(one) and not isinstance(one, type):
        for field in fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    elif isinstance(one, dict):
        assert list(one) == list(other), where
        for key in one:
            assert_same(one[key], other[key], f"{where}.{key}")
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), where
        for index, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{where}[{index}]")
    elif not callable(one):
        assert one == other, where


@pytest.mark.parametrize("spectrum", ["rgb", "dispersive", "spectral"])
@pytest.mark.parametrize(
    "changes",
    [
        {"camera.f_number": 4},
        {"camera.focus.distance_m": 3, "exposure": {"mode": "physical", "iso": 200}},
        {"camera.target": [0.5, 0, 0.5]},
        {"camera.eye": [0, -5, 1.5]},
        {"camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, -6, 1.5], "target": [0, 0, 0], "up": [0, 0, 1]}},
    ],
    ids=["f-number", "focus and exposure", "turned", "elsewhere", "another camera"],
)
def test_plan_with_another_lens_is_that_of_the_scene(spectrum: str, changes: dict[str, Any]) -> None:
    scene = load_scene(SCENE | {"spectrum": spectrum})
    changed = set_keys(scene, changes)
    assert_same(with_lens(make_plan(scene), changed), make_plan(changed))


def test_glances_keep_the_records_of_what_has_not_changed() -> None:
    scene = load_scene(SCENE)
    plan = make_plan(scene)
    other = with_lens(plan, set_keys(scene, {"camera.f_number": 4}), coarse=True)
    assert other.primitives is plan.primitives and other.emitters is plan.emitters
    assert other.camera.tables.tobytes() != plan.camera.tables.tobytes()


@pytest.mark.parametrize(
    "changes", [{"camera.target": [0.5, 0, 0.5]}, {"camera.eye": [0, -5, 1.5], "camera.up": [0.1, 0, 1]}]
)
def test_plan_in_another_pose_is_that_of_the_scene(changes: dict[str, Any]) -> None:
    scene = load_scene(SCENE)
    changed = set_keys(scene, changes)
    assert_same(with_pose(make_plan(scene), changed), make_plan(changed))


@pytest.mark.parametrize("mode", ["relative", "physical"])
def test_plan_in_another_exposure_is_that_of_the_scene_and_keeps_its_camera(mode: str) -> None:
    scene = load_scene(SCENE | {"exposure": {"mode": mode, "ev": 1}, "spectrum": "dispersive"})
    brighter, parts = set_keys(scene, {"exposure.ev": -1, "shutter.time_s": 0.5}), PlanParts()
    plan = make_plan(scene, parts=parts)
    again = make_plan(brighter, parts=parts)
    assert again.camera.tables is plan.camera.tables and again.camera.value != plan.camera.value
    assert_same(again, make_plan(brighter))
    assert_same(with_exposure(plan, brighter), make_plan(brighter))


def test_another_mode_of_exposure_is_another_camera_where_colours_of_the_lens_show() -> None:
    scene = load_scene(DISPERSIVE | {"spectrum": {"mode": "dispersive", "lens": "on"}})
    measured, parts = set_keys(scene, {"exposure": {"mode": "physical", "iso": 200}}), PlanParts()
    make_plan(scene, parts=parts)
    assert_same(make_plan(measured, parts=parts), make_plan(measured))


@pytest.mark.parametrize("lens_colour", ["on", "off"])
def test_a_glance_refracts_colours_apart_as_the_picture_before_it_did(lens_colour: str) -> None:
    scene = load_scene(DISPERSIVE | {"spectrum": {"mode": "dispersive", "lens": lens_colour}})
    other = set_keys(scene, {"camera.f_number": 4, "spectrum.lens": "auto"})
    coarse = with_lens(make_plan(scene), other, coarse=True, colours_stay=True)
    assert coarse.camera.bends_colours == (lens_colour == "on")
    assert "lens_colour_px" not in coarse.camera.metadata  # which takes some milliseconds to find


def test_colours_of_a_glance_are_those_of_the_picture_within_its_noise() -> None:
    scene = load_scene(DISPERSIVE | {"spectrum": {"mode": "dispersive", "lens": "on"}})
    coarse, fine = (camera_model(scene, "on", coarse=coarse).axial_colour for coarse in (True, False))
    assert coarse is not None and fine is not None
    np.testing.assert_array_equal(coarse[0], fine[0])
    np.testing.assert_allclose(coarse[1], fine[1], rtol=0.003)
    assert np.ptp(fine[1]) > 0.003  # 1 would not do
