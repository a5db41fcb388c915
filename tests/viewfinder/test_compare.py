"""Simpler cameras in the place of a lens: the same view and brightness, so that what differs is the lens."""

import json
import math
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.camera import PinholeCamera
from rptcam_cl.scene.load import apply_overrides, load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.instruments import as_model
from rptcam_cl.viewfinder.lens_panel import perspective
from rptcam_cl.viewfinder.panel import value_per_radiance

POSE = {"eye": [0, 0, 0], "target": [0, 0, -2]}
LENS = {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 2}, "f_number": 4, **POSE}
THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 4, "focus_distance_m": 2, **POSE}


def changed(camera: dict[str, Any], kind: str, exposure: dict[str, Any]) -> tuple[Scene, Scene]:
    content: dict[str, Any] = {"film": {"resolution": [36, 24]}, "camera": camera, "exposure": exposure}
    scene = load_scene(content)
    data = json.loads(json.dumps(content))
    changes = as_model(scene, scene, kind)
    apply_overrides(data, [f"{key}={json.dumps(value)}" for key, value in changes.items()])
    return scene, load_scene(data)


@pytest.mark.parametrize("exposure", [{"mode": "relative"}, {"mode": "physical", "iso": 200}])
@pytest.mark.parametrize(
    ("camera", "kind"),
    [
        (LENS, "thick_lens"),
        (LENS, "thin_lens"),
        (LENS, "pinhole"),
        (LENS | {"kind": "thick_lens"}, "thin_lens"),
        (THIN, "pinhole"),
    ],
)
def test_view_and_brightness_stay(camera: dict[str, Any], kind: str, exposure: dict[str, Any]) -> None:
    scene, simple = changed(camera, kind, exposure)
    assert simple.camera.kind == kind
    assert math.log2(value_per_radiance(simple) / value_per_radiance(scene)) == pytest.approx(0, abs=0.03)
    before, after = perspective(scene), perspective(simple)
    assert before is not None
    if after is not None:  # seen from the entrance pupil
        assert after.focus_mm - after.pupil_mm == pytest.approx(before.focus_mm - before.pupil_mm, rel=1e-6)
        assert after.diameter_mm == pytest.approx(before.diameter_mm, rel=1e-6)
        assert after.per_tangent_mm == pytest.approx(before.per_tangent_mm, rel=1e-6)
    else:
        width_mm = simple.film.size_m()[0] * 1e3
        assert isinstance(simple.camera, PinholeCamera)
        tangent = math.tan(math.radians(simple.camera.fov_degrees) / 2)
        assert width_mm / 2 / tangent == pytest.approx(before.per_tangent_mm, rel=1e-6)


def test_same_kind_changes_nothing_and_a_better_one_is_refused() -> None:
    scene = load_scene({"camera": THIN})
    assert as_model(scene, scene, "thin_lens") == {}
    for kind in ("thick_lens", "realistic", "camera obscura"):
        with pytest.raises(InputError, match="model"):
            as_model(scene, scene, kind)
