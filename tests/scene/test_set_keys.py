"""Keys of a loaded scene set to other values: the same scene as from a file that says so, and what stays, stays."""

import gc
import weakref
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.changes import change_scene, set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

DATA: dict[str, Any] = {
    "camera": {"kind": "thin_lens", "eye": [0, -5, 1], "target": [0, 0, 1], "up": [0, 0, 1], "fov_degrees": 40,
               "aperture_radius_m": 0.02, "focus_distance_m": 5},
    "materials": {"grey": {"kind": "matte", "reflectance": 0.5}, "lamp": {"kind": "emissive", "radiance": [5, 4, 3]}},
    "objects": [
        {"shape": "sphere", "center": [0, 0, 1], "radius": 1, "material": "grey"},
        {"shape": "sphere", "center": [0, 3, 4], "radius": 0.5, "material": "lamp"},
    ],
    "environment": {"kind": "gradient", "bottom": 0.1, "top": 0.3},
}  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(DATA)


@pytest.mark.parametrize(
    "changes",
    [
        {"camera.f_number": 4, "camera.focal_length_mm": 50, "camera.focus_distance_m": 2.5},
        {"objects[1].center": [1, 1, 4], "picture.tone": "agx"},
        {"materials.grey.reflectance": [0.1, 0.2, 0.3]},
        {"objects.0": None},
        {"environment": None, "render": {"seed": 7}},
        {"camera.up": [0, 1, 0.1]},
        {"exposure": "auto"},
    ],
)
def test_scene_with_keys_set_is_that_of_such_a_file(scene: Scene, changes: dict[str, Any]) -> None:
    import json

    words = [f"{key}={json.dumps(value)}" for key, value in changes.items()]
    expected = load_scene(DATA, words)
    changed = set_keys(scene, changes)
    assert changed.content_hash() == expected.content_hash()
    assert changed.picture == expected.picture
    assert load_scene(changed.made_of).content_hash() == expected.content_hash()


def test_what_a_key_does_not_concern_stays_the_same_instances(scene: Scene) -> None:
    moved = set_keys(scene, {"camera.eye": [0, -4, 1]})
    assert all(one is other for one, other in zip(moved.objects, scene.objects, strict=True))
    larger = set_keys(scene, {"objects.0.radius": 2})
    assert larger.objects[1] is scene.objects[1] and larger.objects[0] is not scene.objects[0]


def test_one_material_alone_is_made_anew_with_what_shows_it(scene: Scene) -> None:
    brighter = set_keys(scene, {"materials.lamp.radiance": 2})
    assert brighter.materials["grey"] is scene.materials["grey"] and brighter.objects[0] is scene.objects[0]
    assert brighter.objects[1].material is brighter.materials["lamp"] is not scene.materials["lamp"]
    moved = set_keys(brighter, {"camera.eye": [0, -4, 1]})
    assert moved.environment is brighter.environment
    assert set_keys(moved, {"camera.up": [1, 0, 1]}).environment.up == (1.0, 0.0, 1.0)
    both = set_keys(moved, {"objects.0.radius": 2, "camera.up": [1, 0, 1]})
    assert both.environment.up == (1.0, 0.0, 1.0)


def test_mixed_materials_take_new_parts() -> None:
    mixed = {"kind": "mix", "materials": ["grey", {"kind": "mirror"}]}
    inline = {"shape": "sphere", "center": [0, 0, 3], "radius": 1, "material": mixed}
    spectrum = {"kind": "matte", "reflectance": {"wavelengths_nm": [400, 700], "values": [0.1, 0.8]}}
    materials = DATA["materials"] | {"mixed": mixed, "table": spectrum}
    named = inline | {"material": "mixed"}
    scene = load_scene(DATA | {"materials": materials, "objects": [*DATA["objects"], inline, named]})
    changed = set_keys(scene, {"materials.grey.reflectance": 0.25})
    assert [item.material.materials[0].reflectance for item in changed.objects[2:]] == [(0.25, 0.25, 0.25)] * 2
    only = load_scene(DATA | {"objects": [*DATA["objects"], inline]})
    changed = set_keys(only, {"materials.grey.reflectance": 0.25})
    assert changed.objects[2].material.materials[0].reflectance == (0.25, 0.25, 0.25)


def test_scene_and_given_values_stay_as_they_are(scene: Scene) -> None:
    before, value = scene.content_hash(), {"shape": "sphere", "center": [0, 0, 9], "radius": 1, "material": "grey"}
    changed = set_keys(scene, {"objects.1": value})
    value["radius"] = 3
    assert scene.content_hash() == before
    assert set_keys(changed, {"objects.1.center": [0, 0, 8]}).objects[1].radius == 1


def test_objects_of_a_changed_scene_take_new_materials(scene: Scene) -> None:
    smaller = change_scene(scene, film={"resolution": (32, 18)})
    changed = set_keys(smaller, {"materials.lamp.radiance": [1, 1, 1]})
    assert changed.objects[1].material.radiance == (1.0, 1.0, 1.0)
    assert changed.film.resolution == (32, 18)


def test_objects_given_as_instances_take_new_materials(scene: Scene) -> None:
    made = Scene.model_validate({name: getattr(scene, name) for name in scene.model_fields_set})
    assert set_keys(made, {"materials.lamp.radiance": 2}).objects[1].material.radiance == (2.0, 2.0, 2.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera.f_number": -1, "camera.focal_length_mm": 50}, r"^camera\.f_number: is out of range \(got -1"),
        ({"camera.fnumber": 2}, r"^camera\.fnumber: unknown key; did you mean f_number\?"),
        ({"objects.7.radius": 2}, r"^objects\.7\.radius: objects: no such entry \(got 7; allowed: 0 to 1\)"),
        ({"objects.0.radius.x": 2}, r"^objects\.0\.radius\.x: objects\[0\]\.radius: is 1 and has no keys"),
        ({"": 2}, r"is no key path"),
        ({"materials.grey": None}, r"^objects\[0\]\.material: names no material"),
        ({"camera.focus_distance_m": float("nan")}, r"^camera\.focus_distance_m: must be finite"),
        ({"objects": 3}, r"^objects: must be a list"),
        ({"camera": None}, r"^camera: is required but missing"),
    ],
)
def test_wrong_key_or_value_is_named(scene: Scene, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        set_keys(scene, changes)


def test_file_that_is_not_there_is_named(scene: Scene, tmp_path: Path) -> None:
    placed = load_scene(DATA, base_dir=tmp_path)
    with pytest.raises(InputError, match=r"environment\.file: no such file"):
        set_keys(placed, {"environment": {"kind": "image", "file": "missing.hdr"}})


def test_mesh_that_stays_is_not_read_again_and_one_that_goes_is_forgotten() -> None:
    corners, face = [[0, 4, 1], [1, 4, 1], [0, 4, 2]], [[0, 1, 2]]
    meshes = [{"shape": "mesh", "vertices": corners, "faces": face, "material": "grey"} for _ in range(2)]
    scene = load_scene(DATA | {"objects": meshes})
    held = [scene.load_mesh(item).contents for item in scene.objects]  # type: ignore[arg-type]
    changed = set_keys(scene, {"objects.1.vertices": [*corners[:2], [0, 4, 3]]})
    first, second = changed.objects
    assert changed.load_mesh(first).contents is held[0]  # type: ignore[arg-type]
    assert changed.load_mesh(second).bounds()[1][2] == 3  # type: ignore[arg-type]
    gone = weakref.ref(scene.objects[1])
    del scene, held
    gc.collect()
    assert gone() is None
