import json
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.writers import CHANNELS as EVERY
from rptcam_cl.scene.film import SINGLE_LAYERS

SHAPE = (5, 7)
LIGHTS = ("lights.key", "lights.fill")
NAMES = (*SINGLE_LAYERS, *LIGHTS)
CHANNELS = EVERY | {name: tuple(f"{name}.{colour}" for colour in "RGB") for name in LIGHTS}


def values(name: str) -> np.ndarray:
    generator = np.random.default_rng(len(name))
    if name.endswith("_id"):
        return generator.integers(-1, 9, SHAPE, dtype=np.int32)
    count = len(CHANNELS[name])
    kind = np.float64 if name == "position" else np.float32
    return generator.random(SHAPE if count == 1 else (*SHAPE, count)).astype(kind)


@pytest.fixture
def image() -> Image:
    layers = {name: values(name) for name in NAMES}
    layers["depth"][0, 0] = np.inf
    layers["position"][0, 0] = np.nan
    pixels = np.random.default_rng(1).random((*SHAPE, 3), dtype=np.float32)
    return Image(pixels, {"spp": 4, "object_names": ["ball", "floor"]}, layers=layers)


def test_every_layer_of_a_scene_has_channels() -> None:
    assert tuple(CHANNELS) == NAMES
    channels = [channel for names in CHANNELS.values() for channel in names]
    assert len(set(channels) | {"R", "G", "B", "A"}) == len(channels) + 4


def test_exr_holds_the_picture_and_every_layer(tmp_path: Path, image: Image) -> None:
    image.save(tmp_path / "film.exr")
    with OpenEXR.File(str(tmp_path / "film.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert {"R", "G", "B", "Z", "N.X", "N.Y", "N.Z", "albedo.R", "object_id.X", "uv.U"} <= channels.keys()
    np.testing.assert_array_equal(np.stack([channels[name] for name in "RGB"], axis=-1), image.pixels)
    for name, names in CHANNELS.items():
        for index, channel in enumerate(names):
            plane = image[name] if image[name].ndim == 2 else image[name][..., index]
            np.testing.assert_array_equal(channels[channel], plane.astype(np.float32), err_msg=channel)


def test_exr_tells_the_place_of_a_crop_in_the_whole_film(tmp_path: Path, image: Image) -> None:
    metadata = {"resolution": [20, 10], "window": [6, 3, SHAPE[1], SHAPE[0]]}
    Image(image.pixels, metadata, layers=image.layers).save(tmp_path / "part.exr")
    with OpenEXR.File(str(tmp_path / "part.exr")) as file:
        header = dict(file.header())
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, image.pixels)
    np.testing.assert_array_equal(header["dataWindow"], [[6, 3], [12, 7]])
    np.testing.assert_array_equal(header["displayWindow"], [[0, 0], [19, 9]])
    Image(image.pixels[:2, :3], metadata).save(tmp_path / "scaled.exr")
    with OpenEXR.File(str(tmp_path / "scaled.exr")) as file:
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, image.pixels[:2, :3])


def test_npz_holds_every_layer_bit_for_bit_and_the_metadata(tmp_path: Path, image: Image) -> None:
    image.save(tmp_path / "film.npz")
    with np.load(tmp_path / "film.npz", allow_pickle=False) as held:
        assert set(held) == {"rgb", "metadata", *NAMES}
        np.testing.assert_array_equal(held["rgb"], image.pixels)
        for name in NAMES:
            np.testing.assert_array_equal(held[name], image[name])
            assert held[name].dtype == image[name].dtype
        assert json.loads(str(held["metadata"])) == {"spp": 4, "object_names": ["ball", "floor"]}


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ({"colour": np.zeros(SHAPE)}, "unknown layer .*colour"),
        ({"depth": np.zeros((7, 5))}, r"depth: wrong shape .*allowed \(5, 7\)"),
        ({"normal": np.zeros(SHAPE)}, r"normal: wrong shape .*allowed \(5, 7, 3\)"),
    ],
)
def test_layers_that_do_not_fit_are_refused(layers: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Image(np.zeros((*SHAPE, 3), np.float32), layers=layers)
