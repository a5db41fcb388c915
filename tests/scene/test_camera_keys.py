"""Cameras made of others: each key belongs to something, and what a camera of another kind has as well goes with it."""

from typing import Any

import pytest

from rptcam_cl.scene.camera import CAMERA_KINDS, KEY_GROUPS, keys_as
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tier_models import TIERS, Tier, equivalent

POSE = {"eye": [0, 0, 0], "target": [0, 0, -2], "up": [0, 1, 0.1], "flip": False}
LENS = {
    "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 2}, "f_number": 8, **POSE,
    "movements": {"rise_mm": 2}, "diffraction": "on", "stop": {"dirt": {}},
    "aperture": {"shape": "polygon", "blades": 5},
}  # fmt: skip


def test_every_key_of_every_kind_belongs_to_one_group() -> None:
    for kind in CAMERA_KINDS:
        for name in kind.model_fields:
            assert sum(name in keys for keys in KEY_GROUPS.values()) == 1, name
    assert set().union(*KEY_GROUPS.values()) == {name for kind in CAMERA_KINDS for name in kind.model_fields}


def test_keys_that_another_kind_has_not_are_named() -> None:
    camera = load_scene({"camera": LENS}).camera
    keys, left_out = keys_as(
        camera, {"kind": "pinhole", "fov_degrees": 40}, without=("view", "lens", "focus", "opening")
    )
    assert left_out == ("diffraction", "stop", "aperture")
    assert {"movements", "up", "flip", "eye", "target"} <= keys.keys()


@pytest.mark.parametrize("tier", TIERS[:3])
def test_simpler_camera_keeps_what_its_kind_has_too(tier: Tier) -> None:
    camera: dict[str, Any] = LENS if tier == "thin_lens" else LENS | {"aperture": {"shape": "circle"}}
    scene = load_scene({"camera": camera})
    simple = equivalent(scene, tier).camera
    for name in ("up", "flip", "movements", *(("diffraction", "stop") if simple.opens else ())):
        assert getattr(simple, name) == getattr(scene.camera, name), name
    assert simple.outline == scene.camera.outline
