"""Films that were saved come back, and other files are refused."""

import json
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.imaging.image import Image, read_film

METADATA = {
    "lens": "Tessar",
    "f_number": 2.8,
    "exposure_time_s": 0.01,
    "spp": 7,
    "resolution": [9, 6],
    "version": "1.2",
}


@pytest.fixture
def image() -> Image:
    pixels = np.random.default_rng(1).random((6, 9, 3), dtype=np.float32) * 5
    pixels[0, 0] = [np.inf, np.nan, -1]
    return Image(pixels, METADATA | {"picture": {"tone": "agx"}})


@pytest.mark.parametrize("suffix", [".exr", ".npz"])
def test_film_comes_back_with_its_metadata(tmp_path: Path, image: Image, suffix: str) -> None:
    image.save(tmp_path / f"film{suffix}")
    film = read_film(tmp_path / f"film{suffix}")
    np.testing.assert_array_equal(film.pixels, image.pixels)
    assert {key: film.metadata[key] for key in image.metadata} == image.metadata
    assert "aperture" not in film.metadata


def test_array_alone_comes_back(tmp_path: Path, image: Image) -> None:
    image.save(tmp_path / "film.npy")
    np.testing.assert_array_equal(read_film(tmp_path / "film.npy").pixels, image.pixels)


def test_exr_of_another_program_tells_by_the_standard_names(tmp_path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "aperture": 4.0, "lensModel": "X"}
    with OpenEXR.File(header, {"RGB": np.ones((2, 3, 3), np.float16)}) as file:
        file.write(str(tmp_path / "other.exr"))
    film = read_film(tmp_path / "other.exr")
    assert film.metadata == {"f_number": 4.0, "lens": "X"}
    assert film.pixels.dtype == np.float32


def test_exr_of_other_primaries_is_refused(tmp_path: Path) -> None:
    aces = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "chromaticities": aces}
    with OpenEXR.File(header, {"RGB": np.ones((2, 3, 3), np.float32)}) as file:
        file.write(str(tmp_path / "aces.exr"))
    with pytest.raises(InputError, match=r"aces\.exr: has primaries that films are not read with \(got 0\.7347"):
        read_film(tmp_path / "aces.exr")


def test_file_that_is_no_film_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken.exr").write_bytes(b"v/1\x01 and nothing else")
    (tmp_path / "broken.npz").write_bytes(b"PK\x03\x04 and nothing else")
    (tmp_path / "empty.npy").write_bytes(b"")
    np.save(tmp_path / "grey.npy", np.zeros((3, 4)))
    np.savez(tmp_path / "other.npz", depth=np.zeros((3, 4)))
    for name in ("broken.exr", "broken.npz", "empty.npy", "other.npz"):
        with pytest.raises(InputError, match=f"{name}: is damaged, or holds no film"):
            read_film(tmp_path / name)
    with pytest.raises(InputError, match=r"grey\.npy: pixels: wrong shape"):
        read_film(tmp_path / "grey.npy")
    with pytest.raises(InputError, match=r"allowed: \.exr, \.npy, \.npz"):
        read_film(tmp_path / "a.png")
    for name in ("none.exr", "none.npy"):
        with pytest.raises(StateError, match=f"{name}: cannot be read: No such file"):
            read_film(tmp_path / name)


ODD = [
    None,
    True,
    -1,
    0,
    1e300,
    2**70,
    "x",
    "\0ß",
    [],
    [1],
    [1, 2],
    [0, 0, 9, 6],
    ["a", "b"],
    {"a": [1]},
    float("nan"),
    float("inf"),
]


@pytest.mark.parametrize("suffix", [".npz", ".exr"])
def test_metadata_of_any_author_do_no_harm(tmp_path: Path, image: Image, suffix: str) -> None:
    names = ["window", "resolution", "film_size_mm", "lens", "software", "iso", "f_number", "focal_length_mm", "spp",
             "focus_distance_m", "exposure_time_s", "größe", "", "a b", "x" * 100]  # fmt: skip
    random = np.random.default_rng(1)
    for _ in range(8):
        metadata = {name: ODD[random.integers(len(ODD))] for name in names}
        if suffix == ".npz":
            np.savez(tmp_path / "film.npz", rgb=image.pixels, metadata=np.array(json.dumps(metadata)))
        else:
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            header |= {"rptcam_metadata": json.dumps(metadata), "lensModel": "", "focus": -1.0}
            with OpenEXR.File(header, {"RGB": image.pixels}) as file:
                file.write(str(tmp_path / "film.exr"))
        film = read_film(tmp_path / f"film{suffix}")
        for name in ("a.png", "a.tif", "a.npz", "a.exr"):
            film.save(tmp_path / name)
