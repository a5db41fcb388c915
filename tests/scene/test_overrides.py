from pathlib import Path

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.camera import RealisticCamera
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.materials import Matte
from rptcam_cl.scene.shapes import Sphere

from .conftest import EVERYTHING, SMALL, Load


def test_override_sets_a_value_of_a_list(load: Load) -> None:
    for path in ("objects.0.radius", "objects[0].radius"):
        ball = load(SMALL, f"{path}=2.5").objects[0]
        assert isinstance(ball, Sphere)
        assert ball.radius == 2.5


def test_later_override_wins(load: Load) -> None:
    assert load(SMALL, "render.seed=1", "render.seed=2").render.seed == 2


def test_override_makes_mappings_that_are_missing(load: Load) -> None:
    assert load(SMALL, "film.resolution=[320, 180]").film.resolution == (320, 180)


def test_override_takes_a_whole_mapping(load: Load) -> None:
    material = load(SMALL, "objects.0.material={kind: matte, reflectance: 1e-1}").objects[0].material
    assert material == Matte(kind="matte", reflectance=(0.1, 0.1, 0.1))


@pytest.mark.parametrize("value", ["null", "~", ""])
def test_null_removes_a_key(load: Load, value: str) -> None:
    assert load(EVERYTHING, f"environment={value}").environment is None


def test_null_removes_an_entry_of_a_list(load: Load) -> None:
    assert [item.shape for item in load(EVERYTHING, "objects.0=null").objects][:2] == ["disk", "rectangle"]


def test_override_replaces_the_key_that_it_excludes(load: Load) -> None:
    camera = load(EVERYTHING, "camera.stop_diameter_mm=10", "camera.focus.film_distance_mm=36.77").camera
    assert isinstance(camera, RealisticCamera)
    assert (camera.stop_diameter_mm, camera.f_number) == (10.0, None)
    assert (camera.focus.film_distance_mm, camera.focus.distance_m) == (36.77, None)
    assert load(EVERYTHING, "film.width_mm=24").film.size_mm is None


def test_place_of_focus_replaces_any_other(load: Load) -> None:
    camera = load(EVERYTHING, "camera.focus.point=[0, 0, 1]", "camera.focus.method=spot", "camera.zoom=tele").camera
    assert isinstance(camera, RealisticCamera)
    assert (camera.focus.point, camera.focus.distance_m, camera.focus.method) == ((0.0, 0.0, 1.0), None, "spot")
    again = load(EVERYTHING, "camera.zoom=tele", "camera.focal_length_mm=85").camera
    assert isinstance(again, RealisticCamera)
    assert (again.focal_length_mm, again.zoom) == (85.0, None)


def test_null_leaves_the_excluded_key_alone(load: Load) -> None:
    camera = load(EVERYTHING, "camera.stop_diameter_mm=null").camera
    assert isinstance(camera, RealisticCamera)
    assert camera.f_number == 4


@pytest.mark.parametrize(
    ("key", "owners"),
    [("accuracy", "kind realistic has it"), ("f_number", "kinds thin_lens, thick_lens, realistic have it")],
)
def test_key_of_another_kind_names_the_kinds_that_have_it(load: Load, key: str, owners: str) -> None:
    pinhole = "camera: {kind: pinhole, fov_degrees: 40, eye: [0, 0, 0], target: [0, 0, -1]}"
    with pytest.raises(InputError, match=rf"camera\.{key}: unknown key; {owners} \(got"):
        load(pinhole, f"camera.{key}=2")


def test_error_after_a_removed_entry_names_the_removal(load: Load) -> None:
    with pytest.raises(InputError, match=r"^--set objects\.0=null: objects\[0\]\.radius: is out of range \(got -8"):
        load(EVERYTHING.replace("radius: 8", "radius: -8"), "objects.0=null")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("camera.f_number", r"not of the form key\.path=value"),
        ("=4", r"not of the form key\.path=value"),
        ("camera..eye=4", r"not of the form key\.path=value"),
        ("objects.7.radius=2", r"objects: no such entry \(got 7; allowed: 0 to 6\)"),
        ("objects.ball.radius=2", r"objects: no such entry \(got ball; allowed: 0 to 6\)"),
        ("camera.eye.x=2", r"camera\.eye: no such entry \(got x; allowed: 0 to 2\)"),
        ("camera.f_number.x=2", r"camera\.f_number: is 4 and has no keys"),
        ("objects.0.material.reflectance=1", r"is 'red' and has no keys; set materials\.red\.reflectance instead"),
        (
            "camera.accuracy=high",
            r"is not what a camera may err by \(got 'high'; allowed: auto, or a mapping of bounds\)",
        ),
        ("camera.f_nmber=2", r"^--set camera\.f_nmber=2: camera\.f_nmber: unknown key; did you mean f_number\?"),
        ("camra.f_number=2", r"^--set camra\.f_number=2: camra: unknown key; did you mean camera\?"),
        ("camera.f_number=-2", r"^--set camera\.f_number=-2: camera\.f_number: is out of range \(got -2; allowed: at "),
        ("camera.eye=[1, 2", r"^--set camera\.eye=\[1, 2:2:1: not valid YAML"),
        ("camera.eye=*here", r"aliases are not allowed"),
        ("camera=null", r"camera: is required but missing"),
    ],
)
def test_wrong_override_is_named(load: Load, override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load(EVERYTHING, override)


def test_changed_scene_is_a_copy(load: Load) -> None:
    scene = load(SMALL)
    changed = change_scene(scene, film={"resolution": (100, 50)}, render={"spp": 3, "seed": 9})
    assert (changed.film.resolution, changed.render.spp, changed.render.seed) == ((100, 50), 3, 9)
    assert (scene.film.resolution, scene.render.spp, scene.render.seed) == ((640, 360), 64, 0)
    assert changed.render.max_depth == scene.render.max_depth


def test_change_is_the_same_as_an_override(load: Load) -> None:
    changed = change_scene(load(EVERYTHING), film={"crop": (0, 1, 0, 0.5)}, camera={"f_number": 8})
    assert changed.content_hash() == load(EVERYTHING, "film.crop=[0, 1, 0, 0.5]", "camera.f_number=8").content_hash()


def test_objects_and_folders_stay_the_same(tmp_path: Path, load: Load) -> None:
    scene = load(EVERYTHING)
    changed = change_scene(scene, render={"spp": 3})
    assert all(new is old for new, old in zip(changed.objects, scene.objects, strict=True))
    assert changed.base_dir == tmp_path


def test_wrong_change_is_refused(load: Load) -> None:
    with pytest.raises(InputError, match=r"^film\.resolution\[0\]: is out of range \(got 0; allowed: at least 1\)$"):
        change_scene(load(SMALL), film={"resolution": (0, 50)})
    with pytest.raises(InputError, match=r"^film\.resolution: .*would need a film of"):
        change_scene(load(SMALL), film={"resolution": (10**6, 10**6)})
    with pytest.raises(InputError, match=r"^film\.resolution: does not fit an environment camera"):
        change_scene(load(SMALL.replace("pinhole", "environment").replace(", fov_degrees: 40", "")
                          + "film: {resolution: [64, 32]}\n"), film={"resolution": (64, 64)})  # fmt: skip
