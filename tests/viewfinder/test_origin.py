"""Where the scene comes from: changes are kept once each; YAML and command line say what is shown."""

import importlib.util
import os
import shlex
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import named_files
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.viewfinder.slot import with_changes
from rptcam_cl.viewfinder.studio import Origin, Watch

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


class Calls:
    """Counts calls and waits for them."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self) -> None:
        self.count += 1

    def reach(self, count: int) -> bool:
        end = time.monotonic() + 30
        while self.count < count and time.monotonic() < end:
            time.sleep(0.005)
        return self.count == count


def test_edits_replacements_and_new_files_are_seen(tmp_path: Path) -> None:
    scene, asset = tmp_path / "scene.yaml", tmp_path / "wood.png"
    scene.write_text("a")
    calls = Calls()
    watch = Watch(lambda: [scene, asset], calls, interval_s=0.02)
    watch.start()
    try:
        scene.write_text("ab")
        assert calls.reach(1)
        other = tmp_path / "new"
        other.write_text("cd")
        os.replace(other, scene)  # noqa: PTH105 -- what editors do
        assert calls.reach(2)
        asset.write_text("came")
        assert calls.reach(3)
        asset.unlink()
        assert calls.reach(4)
        time.sleep(0.1)
        assert calls.count == 4, "nothing changes, nothing is called"
    finally:
        watch.stop()


def test_file_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    looks, called = 0, Calls()

    def files() -> list[Path]:  # asked at each look, from the thread that looks
        nonlocal looks
        looks += called.count == 0
        if looks <= 20:
            scene.write_text("a" * looks)
        return [scene]

    watch = Watch(files, called, interval_s=0.001)
    watch.start()
    try:
        assert called.reach(1)
        assert looks == 21, "the first at which it had stayed as it was"
    finally:
        watch.stop()
