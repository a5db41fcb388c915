"""Where the scene comes from: changes are kept once each; YAML and command line say what is shown."""

import importlib.util
import shlex
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import named_files
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.viewfinder.slot import with_changes
from rptcam_cl.viewfinder.studio import Origin

SCENE = """
film: {resolution: [16, 8]}
camera: {kind: realistic, lens: dgauss-50mm, eye: [0, 0, 1], target: [0, 0, 0], focus: {distance_m: 0.9}}
materials:
  "1e3": {kind: matte, reflectance: {kind: image, file: wood.png}}
objects:
  - {shape: sphere, center: [0, 0, 0], radius: 0.1, material: "1e3"}
"""
GREY = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b550000000a49444154789c636800000082008177cd72b6"
    "0000000049454e44ae426082"
)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "wood.png").write_bytes(GREY)
    (tmp_path / "scene.yaml").write_text(SCENE)
    return tmp_path / "scene.yaml"


def test_changes_are_kept_in_the_order_of_their_last_value() -> None:
    changes = with_changes({"camera.f_number": 4, "camera.focus.distance_m": 2}, {"camera.stop_diameter_mm": 5})
    changes = with_changes(changes, {"camera.f_number": 8})
    assert list(changes) == ["camera.focus.distance_m", "camera.stop_diameter_mm", "camera.f_number"]
    assert "camera.focus.distance_m" not in with_changes(changes, {"camera.focus": {"auto": "hybrid"}})


def test_thousands_of_values_of_a_key_take_the_room_of_one() -> None:
    changes: dict[str, Any] = {}
    for value in range(5000):
        changes = with_changes(changes, {"camera.f_number": value})
    assert changes == {"camera.f_number": 4999}


def test_yaml_of_what_is_shown_is_the_same_scene(path: Path) -> None:
    origin = Origin(path, ["render.seed=3"])
    shown = set_keys(origin.load(), {"camera.f_number": 4.1, "objects.0.radius": 0.2, "film.resolution": [32, 16]})
    text = origin.text(shown)
    copy = path.with_name("copy.yaml")
    copy.write_text(text)
    again = load_scene(copy)
    assert again.content_hash() == shown.content_hash()
    assert again.render.seed == 3
    assert "wood.png" in text
    said = "# scene.yaml as the viewfinder showed it; lies beside scene.yaml"
    assert text.startswith(said) == (importlib.util.find_spec("ruamel") is None)  # the file's own comments are kept


def test_command_of_what_is_shown_renders_the_same_scene(path: Path) -> None:
    origin = Origin(path, ["render.seed=3"])
    shown = set_keys(origin.load(), {"camera.f_number": 4.1, "camera.focus": {"point": [0, 0, 0.1]}})
    words = shlex.split(origin.command(shown, 7, {}))
    assert words[:3] == ["rptcam", "render", str(path)]
    assert words[-4:] == ["--spp", "7", "-o", "scene.png"]
    overrides = [after for word, after in pairwise(words) if word == "--set"]
    assert load_scene(path, overrides).content_hash() == shown.content_hash()


def test_scene_made_in_python_is_written_out() -> None:
    data = {"camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 1], "target": [0, 0, 0]}}
    scene = load_scene(data)
    for origin in (Origin(scene), Origin(data)):
        assert "pinhole" in origin.text(origin.load())


def test_all_files_that_a_scene_names_are_known(path: Path) -> None:
    origin = Origin(path)
    origin.load()
    assert {found.name for found in origin.files} == {"scene.yaml", "wood.png"}


def test_files_named_up_to_an_error_are_known_too(path: Path) -> None:
    origin = Origin(path)
    origin.load()
    path.write_text(SCENE.replace("wood.png", "oak.png"))
    with pytest.raises(InputError, match=r"oak\.png"):
        origin.load()
    assert {found.name for found in origin.files} == {"scene.yaml", "wood.png", "oak.png"}


def test_nobody_listens_to_names_outside_the_block(path: Path) -> None:
    with named_files() as named:
        pass
    load_scene(path)
    assert named == set()
