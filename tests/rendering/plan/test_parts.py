"""Plans made of what the one before was made of: to the bit what making them anew gives."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rptcam_cl.rendering.plan import geometry, primitives
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.rendering.plan.test_with_lens import assert_same

SCENE: dict[str, Any] = {
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 6},
        "eye": [0, -6, 1.5], "target": [0, 0, 0.5], "up": [0, 0, 1],
    },
    "film": {"resolution": [16, 12]},
    "materials": {
        "grey": {"kind": "plastic", "reflectance": {"kind": "image", "file": "wood.png"}, "roughness": 0.4},
        "red": {"kind": "matte", "reflectance": {"wavelengths_nm": [400, 700], "values": [0.1, 0.8]}},
        "lamp": {"kind": "emissive", "radiance": 10},
        "mixed": {"kind": "mix", "materials": ["red", {"kind": "mirror"}]},
    },
    "objects": [
        {"shape": "sphere", "center": [0, 0, 0.5], "radius": 0.5, "material": "red"},
        {"shape": "sphere", "center": [0, 0, 4], "radius": 0.5, "material": "lamp"},
        {"shape": "box", "min": [1, 0, 0], "max": [2, 1, 1], "material": "mixed"},
        {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": "grey"},
        {
            "shape": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.5]],
            "faces": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], "material": "grey",
        },
    ],
    "lights": [{"kind": "point", "position": [1, 0, 3], "intensity": {"wavelengths_nm": [400, 700], "values": [1, 3]}}],
    "environment": {"kind": "sky", "sun_elevation_degrees": 30},
}  # fmt: skip
CHANGES: dict[str, dict[str, Any]] = {
    "pose": {"camera.eye": [0.5, -5, 1.5]},
    "light": {"materials.lamp.radiance": [1, 2, 3]},
    "material": {"materials.red.reflectance": 0.3},
    "texture": {"materials.grey.reflectance": {"kind": "image", "file": "other.png"}},
    "object": {"objects.0.radius": 0.7},
    "mesh": {"objects.4.transform": [{"translate": [0.2, 0, 0.1]}]},
    "lights": {"lights.0.intensity": 4},
    "sky": {"environment.sun_elevation_degrees": 50},
    "f-number": {"camera.f_number": 4},
    "film": {"film.width_mm": 24},
    "exposure": {"exposure": "irradiance"},
    "time": {"shutter": {"time_s": 0.01}},
    "spectrum": {"spectrum": {"mode": "dispersive", "lens": "on"}},
    "focus at a point": {"camera.focus": {"point": [0, 0, 0.5]}, "camera.eye": [0, -4, 1.5]},
    "nothing": {"render.seed": 5},
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    place = tmp_path_factory.mktemp("parts")
    draw(place / "wood.png", 1)
    draw(place / "other.png", 2)
    return load_scene(SCENE, base_dir=place)


def draw(path: Path, seed: int) -> None:
    Image.fromarray(np.random.default_rng(seed).integers(0, 255, (8, 8, 3), np.uint8)).save(path)


def test_plans_one_after_the_other_are_those_of_their_scenes(scene: Scene) -> None:
    kept = PlanParts()
    make_plan(scene, parts=kept)
    for name, changes in CHANGES.items():
        scene = set_keys(scene, changes)
        assert_same(make_plan(scene, parts=kept), make_plan(scene), name)
    assert_same(make_plan(scene, parts=kept), make_plan(scene))


def test_a_picture_written_anew_is_seen(scene: Scene) -> None:
    kept = PlanParts()
    before = make_plan(scene, parts=kept)
    draw(scene.base_dir / "wood.png", 3)
    after = make_plan(scene, parts=kept)
    assert_same(after, make_plan(scene))
    assert after.textures.texels.tobytes() != before.textures.texels.tobytes()


TENT = {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.5]], "faces": [[0, 2, 1], [0, 1, 3], [1, 2, 3]]}
EDITS: tuple[dict[str, Any], ...] = (
    {"materials.grey.reflectance": 0.2},
    {"camera.eye": [0.5, -5, 1.5]},
    {"objects.2.transform": [{"translate": [0, 1, 0.2]}], "objects.1.material": "red"},
    {"materials.red": {"kind": "emissive", "radiance": 3}, "materials.grey.reflectance": 0.4},
    {"objects.3.visible": {"camera": False}, "objects.4.material": "grey"},
    {"objects.4.instances": {"file": np.tile(np.eye(3, 4), (3, 1, 1)) * 0.5}},
    {"objects.1.mesh": "board", "objects.5.motion": [{"time_s": 0}, {"time_s": 1, "translate": [0, 2, 0]}]},
    {"materials.red": {"kind": "matte", "reflectance": 0.6}},
    {"objects.1.transform": None, "objects.0.radius": 0.4},
    {"objects.2": None},
)


def test_meshes_placed_one_after_the_other_are_those_of_their_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(geometry, "MOST_COPIED", 0)
    meshes = [{"shape": "mesh", "mesh": "tent", "material": name} for name in ("grey", "red", "grey", "grey", "red")]
    meshes[3]["instances"] = {"file": np.tile(np.eye(3, 4), (4, 1, 1))}  # type: ignore[assignment]
    scene = load_scene({
        "camera": SCENE["camera"], "film": SCENE["film"], "lights": SCENE["lights"], "shutter": {"time_s": 0.5},
        "materials": {"grey": {"kind": "matte", "reflectance": 0.3}, "red": {"kind": "mirror"}},
        "meshes": {"tent": TENT, "board": TENT | {"faces": [[0, 1, 2]]}},
        "objects": [SCENE["objects"][0] | {"material": "red"}, *meshes],
    })  # fmt: skip
    kept = PlanParts()
    make_plan(scene, parts=kept)
    for number, changes in enumerate(EDITS):
        scene = set_keys(scene, changes)
        fresh = load_scene(scene.made_of)
        assert_same(make_plan(scene, parts=kept), make_plan(scene), str(number))
        assert make_plan(scene).primitives.tobytes() == make_plan(fresh).primitives.tobytes(), number


@pytest.mark.parametrize("name", ["pose", "light", "material", "object", "nothing"])
def test_a_camera_that_is_only_moved_about_is_made_once(
    scene: Scene, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = PlanParts()
    make_plan(scene, parts=kept)
    monkeypatch.delattr(primitives, "camera_model")
    make_plan(set_keys(scene, CHANGES[name]), parts=kept)


def test_what_surfaces_look_like_is_found_once_for_the_same_materials(scene: Scene) -> None:
    kept = PlanParts()
    before, moved = make_plan(scene, parts=kept), make_plan(set_keys(scene, CHANGES["pose"]), parts=kept)
    assert moved.materials is before.materials and moved.textures is before.textures
    lit = make_plan(set_keys(scene, CHANGES["light"]), parts=kept)
    assert lit.materials is not before.materials
    dyed = make_plan(set_keys(scene, CHANGES["light"]), parts=kept)
    assert dyed.meshes is lit.meshes is not None
