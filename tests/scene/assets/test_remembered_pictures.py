"""Pictures are read once for many plans, seen anew when their file changes, and kept only up to a limit."""

import os
from dataclasses import dataclass

import numpy as np
import PIL.Image
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import Memory
from rptcam_cl.rendering.plan import textures as picture_table
from rptcam_cl.rendering.plan import textures as remembered
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene

CAMERA = {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40}
TEXTURE = {"kind": "image", "file": "a.png"}
BALL = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {"kind": "matte", "reflectance": TEXTURE}}
SCENE = {"camera": CAMERA, "objects": [BALL], "environment": TEXTURE}
RNG = np.random.default_rng(5)


@pytest.fixture(autouse=True)
def nothing_kept():
    remembered.PICTURES.clear()
    yield
    remembered.PICTURES.clear()


@pytest.fixture
def readings(monkeypatch):
    """The sources of all pictures that are decoded."""
    seen = []

    def read(source):
        seen.append(source)
        return picture_of(source)

    picture_of = picture_table.read_picture
    monkeypatch.setattr(picture_table, "read_picture", read)
    return seen


def save(path, texels):
    """Write a picture; the file keeps its time and, being uncompressed, its size."""
    PIL.Image.fromarray(texels).save(path, compress_level=0)
    os.utime(path, (1e9, 1e9))


def plan_in(folder, mapping=SCENE):
    return make_plan(load_scene(mapping, base_dir=folder))


def test_second_plan_reads_no_picture_and_is_the_same(tmp_path, readings):
    save(tmp_path / "a.png", RNG.integers(0, 256, (8, 16, 3), np.uint8))
    first, second = plan_in(tmp_path), plan_in(tmp_path)
    assert len(readings) == 1
    np.testing.assert_array_equal(first.textures.texels, second.textures.texels)
    np.testing.assert_array_equal(first.textures.records, second.textures.records)
    np.testing.assert_array_equal(first.surroundings.distribution, second.surroundings.distribution)
    remembered.PICTURES.clear()
    np.testing.assert_array_equal(plan_in(tmp_path).textures.texels, first.textures.texels)
    assert len(readings) == 2


def test_changed_file_is_seen_even_with_the_time_and_size_of_the_old_one(tmp_path, readings):
    texels = RNG.integers(0, 256, (8, 16, 3), np.uint8)
    save(tmp_path / "a.png", texels)
    size, first = (tmp_path / "a.png").stat().st_size, plan_in(tmp_path)
    save(tmp_path / "a.png", 255 - texels)
    assert (tmp_path / "a.png").stat().st_size == size
    second = plan_in(tmp_path)
    assert len(readings) == 2
    assert (first.textures.texels != second.textures.texels).any()
    assert (first.surroundings.distribution != second.surroundings.distribution).any()


def test_each_way_to_store_a_picture_is_remembered(tmp_path, readings):
    save(tmp_path / "a.png", RNG.integers(0, 256, (4, 4, 3), np.uint8))
    plans = [
        plan_in(tmp_path, {"camera": CAMERA, "environment": TEXTURE | {"color_space": space}})
        for space in ("auto", "linear", "srgb")
    ]
    formats = [int(plan.textures.records["format"][0]) for plan in plans]
    assert formats[0] == formats[2] != formats[1]
    assert len(readings) == 2  # srgb is what auto found, so it is remembered


def test_file_that_breaks_later_is_refused(tmp_path):
    save(tmp_path / "a.png", RNG.integers(0, 256, (4, 4, 3), np.uint8))
    plan_in(tmp_path)
    (tmp_path / "a.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"a\.png|environment\.file|reflectance\.file"):
        plan_in(tmp_path)


@dataclass(frozen=True)
class Made:
    nbytes: int


def test_what_was_unused_longest_goes_first_and_nothing_too_large_is_kept(monkeypatch):
    pictures = Memory(most_bytes=100)
    made = []

    def use(key, size):
        made.clear()
        pictures.find_or_make(key, lambda: made.append(key) or Made(size))
        return bool(made)

    assert use("a", 40)
    assert use("b", 40)
    assert not use("a", 40)
    assert use("c", 40)  # b has to go
    assert not use("a", 40)
    assert not use("c", 40)
    assert use("b", 40)
    assert use("huge", 101)
    assert use("huge", 101)
    assert not use("b", 40)
