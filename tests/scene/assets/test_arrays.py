"""Arrays in place of files: pictures of textures, surroundings and apertures, as files with the same content."""

import io

import numpy as np
import pytest
from PIL import Image

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.pictures import read_array, read_picture, write_exr

RNG = np.random.default_rng(5)
CODES = RNG.integers(0, 256, (9, 14, 3), dtype=np.uint8)
LIGHT = RNG.random((8, 16, 3), dtype=np.float32) * 3


def scene(texture, around):
    return {
        "camera": {"kind": "pinhole", "eye": [0, 0, 3], "target": [0, 0, 0], "fov_degrees": 60},
        "objects": [
            {
                "shape": "rectangle",
                "corner": [-1, -1, 0],
                "edge_u": [2, 0, 0],
                "edge_v": [0, 2, 0],
                "material": {"kind": "matte", "reflectance": {"kind": "image", "file": texture}},
            }
        ],
        "environment": {"kind": "image", "file": around},
    }


def film(made, **options):
    return np.asarray(rptcam_cl.render(made, size=(24, 18), spp=2, **options))


@pytest.fixture
def of_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(CODES).save("texture.png")
    write_exr({"RGB": LIGHT}, tmp_path / "around.exr")
    return film(scene("texture.png", "around.exr"))


def test_arrays_give_the_picture_of_files(of_files):
    np.testing.assert_array_equal(film(scene(CODES, LIGHT)), of_files)


def test_session_takes_another_array(of_files):
    with rptcam_cl.RenderSession(scene(CODES[::-1].copy(), LIGHT), size=(24, 18)) as session:
        other = session.take(2).pixels.copy()
        session.change({"objects.0.material.reflectance.file": CODES})
        np.testing.assert_array_equal(session.take(2).pixels, of_files)
        session.change({"environment.file": LIGHT[:, ::-1]})
        assert not np.array_equal(session.take(2).pixels, of_files)
    assert not np.array_equal(other, of_files)


def test_scene_is_known_by_what_its_arrays_hold():
    one, same, other = (rptcam_cl.load_scene(scene(CODES, light)) for light in (LIGHT, LIGHT.copy(), LIGHT + 1))
    assert one.content_hash() == same.content_hash() != other.content_hash()


@pytest.mark.parametrize(
    ("array", "texel", "alpha", "encoded"),
    [
        (np.full((2, 3), 7, np.uint8), (7, 7, 7, 255), False, True),
        (np.full((2, 3, 4), 7, np.uint8), (7, 7, 7, 7), True, True),
        (np.full((2, 3, 1), 13107, np.uint16), (0.2, 0.2, 0.2, 1), False, True),
        (np.full((2, 3, 3), 2.5, np.float64), (2.5, 2.5, 2.5, 1), False, False),
        (np.full((2, 3, 4), 0.5, np.float16), (0.5, 0.5, 0.5, 0.5), True, False),
    ],
    ids=str,
)
def test_kinds_of_arrays(array, texel, alpha, encoded):
    picture = read_picture(content(array))
    assert (picture.width, picture.height, picture.has_alpha, picture.encoded) == (3, 2, alpha, encoded)
    np.testing.assert_allclose(picture.texels[1, 2], texel, rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (np.zeros((2, 3, 2)), "is no picture"),
        (np.zeros(5), "is no picture"),
        (np.zeros((2, 2), np.int32), "is no picture"),
        (np.zeros((2, 2), np.uint32), "is no picture"),
        (np.zeros((0, 3, 3)), "has no pixels"),
        (np.full((1, 2, 3), np.nan), "2 pixels are not finite"),
    ],
    ids=["channels", "row", "whole numbers", "long", "empty", "nan"],
)
def test_array_that_is_no_picture_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        read_picture(content(given))
    with pytest.raises(InputError, match=f"environment.file: .*{message}"):
        film(scene(CODES, given))


def test_hostile_array_is_refused_before_its_memory_is_taken():
    head = content(np.zeros((1, 1, 3), np.float32))
    huge = head.replace(b"(1, 1, 3)", b"(9999999, 99999, 3)", 1)
    with pytest.raises(InputError, match=r"too large|damaged"):
        read_array(huge)
    with pytest.raises(InputError, match="damaged"):
        read_array(content(np.zeros((4, 4, 3)))[:-20])


def content(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()
