import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import plain
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.scene.camera import RealisticCamera, ThickLensCamera
from rptcam_cl.scene.lights import ConstantEnvironment, GradientEnvironment
from rptcam_cl.scene.load import load_scene, scene_text
from rptcam_cl.scene.materials import Matte
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.shapes import Sphere
from rptcam_cl.scene.textures import Checker, Grid
from tests.support.counting import calls

from .conftest import EVERYTHING, SMALL, Load


def test_attributes_are_the_keys_of_the_file(everything: Scene) -> None:
    camera = everything.camera
    assert isinstance(camera, RealisticCamera)
    assert (camera.lens, camera.f_number, camera.focus.distance_m) == ("double_gauss_50mm", 4.0, 8.8)
    assert everything.film.resolution == (640, 360)
    assert everything.render.spp == 100
    assert [item.shape for item in everything.objects] == [
        "sphere", "disk", "rectangle", "box", "cylinder", "cone", "plane",
    ]  # fmt: skip
    assert [light.kind for light in everything.lights] == ["point", "directional"]


def test_thick_lens_camera_takes_the_lens_keys_of_the_realistic_one(load: Load) -> None:
    camera = load(EVERYTHING, "camera.kind=thick_lens", "camera.zoom=tele").camera
    assert isinstance(camera, ThickLensCamera)
    assert (camera.lens, camera.f_number, camera.focus.distance_m) == ("double_gauss_50mm", 4.0, 8.8)
    assert camera.zoom == "tele"
    assert set(RealisticCamera.model_fields) - set(ThickLensCamera.model_fields) == {
        "accuracy", "aperture", "barrel_reflectance", "front_scatter", "ghost_order", "ghosts", "precision", "pupil",
        "rays", "sensor_grating",
    }  # fmt: skip


def test_depth_of_a_point_is_measured_along_the_axis(load: Load) -> None:
    camera = load(EVERYTHING, "camera.focus.point=[3, 0.5, 3.2]", "camera.target=[0, 0, 3.2]").camera
    assert isinstance(camera, RealisticCamera)
    assert (camera.focus.distance_m, camera.focus.point) == (None, (3.0, 0.5, 3.2))
    assert camera.ahead((3.0, 0.5, 3.2)) == pytest.approx(10.0)  # the eye stands at y = -9.5
    assert camera.ahead((0.0, -10.0, 3.2)) == pytest.approx(-0.5)


def test_named_material_is_the_same_instance_everywhere(everything: Scene) -> None:
    assert everything.objects[0].material is everything.materials["red"]
    floor, lines = everything.materials["floor"], everything.materials["lines"]
    assert isinstance(floor, Matte) and isinstance(floor.reflectance, Checker)
    assert isinstance(lines, Matte) and isinstance(lines.reflectance, Grid)


def test_small_scene_has_the_documented_defaults(load: Load) -> None:
    scene = load(SMALL)
    assert scene.film.resolution == (640, 360)
    assert scene.film.size_m() == pytest.approx((0.036, 0.02025))
    assert (scene.render.spp, scene.render.max_depth, scene.render.seed, scene.render.roulette_depth) == (64, 8, 0, 4)
    assert (scene.exposure.mode, scene.picture.ev, scene.metres_per_unit) == ("relative", 0.0, 1.0)
    assert scene.camera.up == (0.0, 1.0, 0.0)
    assert scene.camera.flip is True
    assert scene.warnings == ()
    assert isinstance(scene.environment, ConstantEnvironment)


def test_gradient_rises_along_the_camera_up_unless_told_otherwise(load: Load, everything: Scene) -> None:
    assert isinstance(everything.environment, GradientEnvironment)
    assert everything.environment.up == (0.0, 0.0, 1.0)
    other = load(EVERYTHING, "environment.up=[1, 0, 0]").environment
    assert isinstance(other, GradientEnvironment)
    assert other.up == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.25", (0.25, 0.25, 0.25)),
        ("[0.1, 0.2, 1]", (0.1, 0.2, 1.0)),
        ('"#ff8000"', (1.0, 0.2158605, 0.0)),  # IEC 61966-2-1: ((128/255 + 0.055) / 1.055) ** 2.4
        ('"#0A0a0A"', (0.0030353, 0.0030353, 0.0030353)),  # 10/255/12.92
    ],
)
def test_colour_is_grey_triple_or_srgb(load: Load, text: str, expected: tuple[float, float, float]) -> None:
    material = load(SMALL, f"objects.0.material.reflectance={text}").objects[0].material
    assert isinstance(material, Matte)
    assert material.reflectance == pytest.approx(expected, abs=1e-7)


def test_numpy_values_are_read_like_lists() -> None:
    data: dict[str, Any] = read_yaml(SMALL).data
    data["camera"]["eye"] = np.array([0, 1, 5], np.float32)
    data["objects"][0]["radius"] = np.float64(2)
    data["objects"][0]["material"]["reflectance"] = np.array([0.5, 0.25, 0.125])
    data["render"] = {"spp": np.int64(3)}
    scene = load_scene(data)
    assert scene.camera.eye == (0.0, 1.0, 5.0)
    assert scene.render.spp == 3
    assert isinstance(scene.objects[0], Sphere)


def test_json_is_a_scene_file_too(tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(read_yaml(SMALL).data, indent=2), "utf-8")
    assert load_scene(path).content_hash() == load_scene(read_yaml(SMALL).data).content_hash()


def test_scene_survives_the_way_to_data_and_back(everything: Scene) -> None:
    again = load_scene(json.loads(everything.model_dump_json()))
    assert again.model_dump() == everything.model_dump()
    assert again.content_hash() == everything.content_hash()


def test_scene_does_not_change(everything: Scene) -> None:
    with pytest.raises(ValidationError):
        everything.camera.eye = (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="read-only"):
        everything.objects[3].world_from_object[0, 0] = 2.0


def test_given_mapping_stays_as_it_was() -> None:
    data = read_yaml(SMALL).data
    load_scene(data, ["camera.fov_degrees=60", "objects.0.radius=3"])
    assert data == read_yaml(SMALL).data


@pytest.mark.parametrize(
    "override", ["render.spp=3", "picture.ev=2", "objects.0.name=thing", "materials.unused={kind: mirror}"]
)
def test_hash_ignores_what_leaves_the_film_alone(load: Load, override: str) -> None:
    assert load(EVERYTHING, override).content_hash() == load(EVERYTHING).content_hash()


@pytest.mark.parametrize(
    "override",
    [
        "render.seed=8",
        "render.max_depth=6",
        "film.crop=null",
        "objects.0.radius=1.0000001",
        "materials.red.reflectance=0.5",
        "camera.lens=other_lens",
        "camera.f_number=null",
        "environment=null",
        "metres_per_unit=0.1",
    ],
)
def test_hash_sees_what_changes_the_film(load: Load, override: str) -> None:
    assert load(EVERYTHING, override).content_hash() != load(EVERYTHING).content_hash()


def test_hash_is_the_same_in_every_session(checkout: Path, load: Load) -> None:
    program = "import sys; from rptcam_cl.scene.load import load_scene; print(load_scene(sys.argv[1]).content_hash())"
    path = load(EVERYTHING).base_dir / "scene.yaml"
    run = [sys.executable, "-c", program, str(path)]
    done = subprocess.run(run, env={"PYTHONHASHSEED": "1", "PYTHONPATH": str(checkout)}, capture_output=True, text=True)
    assert done.stdout.strip() == load(EVERYTHING).content_hash(), done.stderr


def test_hash_sees_the_content_of_a_lens_file(tmp_path: Path, load: Load) -> None:
    lens = tmp_path / "lens.yaml"
    lens.write_text("one")
    scene = load(EVERYTHING, "camera.lens=lens.yaml")
    before = scene.content_hash()
    lens.write_text("two")
    assert scene.content_hash() != before


def test_lens_is_a_name_a_file_or_a_mapping(tmp_path: Path, load: Load) -> None:
    assert load(SMALL).lens_source() is None
    assert load(EVERYTHING).lens_source() == "double_gauss_50mm"
    (tmp_path / "lenses").mkdir()
    (tmp_path / "lenses" / "own.dat").write_text("")
    assert load(EVERYTHING, "camera.lens=lenses/own.dat").lens_source() == tmp_path / "lenses" / "own.dat"
    inline = load(EVERYTHING, "camera.lens={name: x, surfaces: [{radius: 50, aspheric: {4: 1e-5}}]}").lens_source()
    assert inline == {"name": "x", "surfaces": [{"radius": 50, "aspheric": {4: 1e-5}}]}


def test_files_outside_the_folder_need_leave(tmp_path: Path) -> None:
    inside, outside = tmp_path / "scenes", tmp_path / "lenses"
    inside.mkdir()
    outside.mkdir()
    (outside / "own.yaml").write_text("")
    (inside / "scene.yaml").write_text(EVERYTHING.replace("double_gauss_50mm", "../lenses/own.yaml"))
    with pytest.raises(InputError, match=r"scene\.yaml:8:9: camera\.lens: lies outside the scene's folder"):
        load_scene(inside / "scene.yaml")
    assert load_scene(inside / "scene.yaml", allow_folders=[outside]).lens_source() == outside / "own.yaml"


def test_large_scene_loads_in_proportion_to_its_objects() -> None:
    ball = {"shape": "sphere", "center": [0, 1, 0], "radius": 1, "material": {"kind": "matte", "reflectance": 0.5}}
    small, large = (read_yaml(SMALL).data | {"objects": [ball] * count} for count in (100, 1000))
    assert len(load_scene(large).objects) == 1000
    assert calls(lambda: load_scene(large)) < 11 * calls(lambda: load_scene(small))


WORDS = [
    "1e-3", "0o17", "on", "2:8", "1_000", ".5e3", "0x1F", "null", "~", "12e03", "=", "<<", "a: b", "- a", "#1", "",
    " x", "true", ".inf", ".nan", "ä\u2028b", "'", '"', "1" * 60,
]  # fmt: skip
TEXT = st.text("aeFxo019.-+_:#'\"{}[], ~&*!|>%@ä", max_size=8) | st.sampled_from(WORDS)
NUMBERS = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**63), 2**63) | st.booleans() | st.none()
PARTS = st.sampled_from(["film", "camera", "materials", "objects", "lights", "sensor"])
VALUES = st.recursive(
    NUMBERS | TEXT, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3)
)


@given(st.dictionaries(PARTS, VALUES, min_size=1))
def test_text_reads_back_as_the_same_data(data: dict[str, object]) -> None:
    for name in ("objects", "lights"):
        if name in data:
            data[name] = [data[name]]
    if "materials" in data:
        data["materials"] = dict.fromkeys(WORDS[:4], data["materials"])
    read = read_yaml(scene_text(data)).data
    assert read == plain(data)


def test_objects_stand_on_a_line_each_below_the_comments() -> None:
    text = scene_text({"objects": [{"shape": "sphere"}, {"shape": "box"}], "film": {"width_mm": 36}}, ("one\ntwo",))
    assert text.splitlines() == [
        "# one", "# two", "film: {width_mm: 36}", "objects:", "  - {shape: sphere}", "  - {shape: box}",
    ]  # fmt: skip


def test_parts_of_scenes_are_equal_by_what_they_say() -> None:
    """Matrices that follow from the keys are kept beside them once they are known."""
    box: dict[str, Any] = {"shape": "box", "min": [-1, -1, -3], "max": [1, 1, -2], "material": {"kind": "mirror"}}
    camera = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 40}
    one, same, other = (
        load_scene({"camera": camera, "objects": [box | {"max": [1, 1, far]}]}).objects for far in (-2, -2, -2.5)
    )
    assert one == same and hash(one) == hash(same)
    assert one != other and one[0] != camera
