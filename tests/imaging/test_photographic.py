"""What cameras write into their files, read back by other programs' readers."""

import io
import json
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import PIL.Image
import png
import pytest
import tifffile
from PIL import ImageCms
from PIL.ExifTags import IFD, Base

from rptcam_cl.imaging.development import quantise
from rptcam_cl.imaging.formats import profile, rational
from rptcam_cl.imaging.image import Image
from rptcam_cl.scene.film import PictureSettings

METADATA: dict[str, Any] = {
    "software": "rptcam_cl 1.2",
    "lens": "Double Gauss 50 mm f/2",
    "f_number": 2.8,
    "exposure_time_s": 1 / 125,
    "iso": 200,
    "focal_length_mm": 51.5,
    "focus_distance_m": 1.25,
    "film_size_mm": [23.6, 15.7],
    "spp": 64,
}
EXIF = {
    Base.FNumber: 2.8,
    Base.ExposureTime: 1 / 125,
    Base.ISOSpeedRatings: 200,
    Base.ISOSpeed: 200,
    Base.SensitivityType: 3,
    Base.FocalLength: 51.5,
    Base.FocalLengthIn35mmFilm: 79,  # 51.5 mm x 43.27 mm / 28.35 mm
    Base.SubjectDistance: 1.25,
    Base.LensModel: "Double Gauss 50 mm f/2",
    Base.ColorSpace: 1,
    Base.ExifVersion: b"0232",
}
TIFFFILE_NAMES = {"ISOSpeedRatings": 200, "FNumber": (14, 5), "ExposureTime": (1, 125), "SubjectDistance": (5, 4)}


def pixels() -> np.ndarray:
    return np.random.default_rng(1).random((70, 9, 3), dtype=np.float32)


def saved(path: Path, metadata: dict[str, Any] = METADATA, **settings: Any) -> Image:
    image = Image(pixels(), metadata, development=PictureSettings(**settings))
    image.save(path)
    return image


@pytest.mark.parametrize("name", ["a.png", "a16.png", "a.tif"])
def test_exif_data_are_read_by_another_program(tmp_path: Path, name: str) -> None:
    saved(tmp_path / name, bits=16 if "16" in name else 8)
    with PIL.Image.open(tmp_path / name) as picture:
        picture.load()
        exif = picture.getexif()
        assert exif[Base.Software] == "rptcam_cl 1.2"
        assert dict(exif.get_ifd(IFD.Exif)) == pytest.approx(EXIF)


def test_exif_fields_have_the_types_of_the_standard(tmp_path: Path) -> None:
    saved(tmp_path / "a.tif")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        exif = file.pages[0].tags["ExifTag"].value
        assert {key: exif[key] for key in TIFFFILE_NAMES} == TIFFFILE_NAMES
    saved(tmp_path / "a.png")
    with PIL.Image.open(tmp_path / "a.png") as picture:
        data = picture.info["exif"].removeprefix(b"Exif\0\0")  # which Pillow adds
    pointer = fields(data, 8)[Base.ExifOffset]
    assert list(fields(data, 8)) == sorted(fields(data, 8))  # as TIFF asks
    assert list(fields(data, pointer[1])) == sorted(fields(data, pointer[1]))
    kinds = {tag: kind for tag, (kind, _) in fields(data, pointer[1]).items()}
    assert kinds == {
        Base.FNumber: 5, Base.ExposureTime: 5, Base.FocalLength: 5, Base.SubjectDistance: 5, Base.ISOSpeedRatings: 3,
        Base.SensitivityType: 3, Base.ISOSpeed: 4, Base.FocalLengthIn35mmFilm: 3, Base.ColorSpace: 3,
        Base.LensModel: 2, Base.ExifVersion: 7,
    }  # fmt: skip


def fields(data: bytes, start: int) -> dict[int, tuple[int, int]]:
    """Type and value, or its place, by the tags of a directory."""
    count = int.from_bytes(data[start : start + 2], "little")
    entries = struct.iter_unpack("<HHII", data[start + 2 : start + 2 + 12 * count])
    return {tag: (kind, value) for tag, kind, _, value in entries}


@pytest.mark.parametrize("metadata", [{}, {"f_number": math.inf, "iso": None, "lens": "", "focal_length_mm": -20.0}])
@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr"])
def test_what_is_not_known_is_left_out(tmp_path: Path, metadata: dict[str, Any], suffix: str) -> None:
    saved(tmp_path / f"a{suffix}", metadata)
    if suffix == ".exr":
        with OpenEXR.File(str(tmp_path / "a.exr")) as file:
            assert not {"aperture", "isoSpeed", "lensModel", "effectiveFocalLength"} & set(file.header())
        return
    with PIL.Image.open(tmp_path / f"a{suffix}") as picture:
        assert set(picture.getexif().get_ifd(IFD.Exif)) == {Base.ExifVersion, Base.ColorSpace}


def test_exr_has_the_standard_attributes_in_their_types(tmp_path: Path) -> None:
    saved(tmp_path / "a.exr", METADATA | {"t_number": 3.1, "focus_distance_m": math.inf})
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        header = dict(file.header())
    expected = {"aperture": 2.8, "tStop": 3.1, "expTime": 0.008, "isoSpeed": 200.0, "effectiveFocalLength": 51.5}
    assert {key: header[key] for key in expected} == pytest.approx(expected, rel=1e-7)
    assert all(type(header[key]) is float for key in (*expected, "focus"))
    assert header["focus"] == math.inf
    assert header["lensModel"] == "Double Gauss 50 mm f/2"
    assert header["cameraFirmwareVersion"] == "rptcam_cl 1.2"
    assert header["colorInteropID"] == "lin_rec709_scene"


@pytest.mark.parametrize(
    ("value", "fraction"),
    [
        (1 / 8000, (1, 8000)), (1 / 3, (1, 3)), (30.0, (30, 1)), (math.inf, (2**32 - 1, 1)), (1e300, (2**32 - 1, 1)),
        (1e-300, (1, 2**32 - 2)), (4e9, (4_000_000_000, 1)), (1.4, (7, 5)),
    ],
)  # fmt: skip
def test_numbers_become_near_fractions(value: float, fraction: tuple[int, int]) -> None:
    _, _, data = rational(value)
    assert (int.from_bytes(data[:4], "little"), int.from_bytes(data[4:], "little")) == fraction


def test_every_number_becomes_a_fraction_within_a_millionth() -> None:
    for value in 10.0 ** np.random.default_rng(1).uniform(-9, 9, 500):
        _, _, data = rational(float(value))
        near = int.from_bytes(data[:4], "little") / int.from_bytes(data[4:], "little")
        assert near == pytest.approx(value, rel=1e-6)


def decoded(icc: bytes, codes: np.ndarray) -> np.ndarray:
    """What a colour management system makes of codes: those of an sRGB display of its own."""
    source = ImageCms.ImageCmsProfile(io.BytesIO(icc))
    transform = ImageCms.buildTransform(source, ImageCms.createProfile("sRGB"), "RGB", "RGB")
    return np.asarray(ImageCms.applyTransform(PIL.Image.fromarray(codes), transform)).astype(int)


def test_profiles_mean_srgb_and_linear_light() -> None:
    codes = np.random.default_rng(1).integers(0, 256, (40, 40, 3), dtype=np.uint8)
    difference = np.abs(decoded(profile(encoded=True), codes) - codes)
    assert difference.max() <= 1
    assert difference.mean() < 0.02
    linear = codes / 255
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.abs(decoded(profile(encoded=False), codes) - 255 * encoded).max() <= 1.5
    name = ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(profile(encoded=True))))
    assert name.strip() == "sRGB IEC61966-2-1"


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("tone", ["srgb", "linear"])
def test_tiff_holds_the_developed_picture(tmp_path: Path, bits: int, tone: str) -> None:
    image = saved(tmp_path / "a.tif", bits=bits, tone=tone)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        page = file.pages[0]
        assert np.array_equal(page.asarray(), quantise(image.developed(), bits))
        assert page.tags["InterColorProfile"].value == profile(encoded=tone == "srgb")
        assert json.loads(page.description) == METADATA | {"ev": 0.0}
    with PIL.Image.open(tmp_path / "a.tif") as picture:
        eight = np.asarray(picture).astype(int)
    assert np.abs(eight - quantise(image.developed(), 8)).max() <= 1


def test_tiff_of_many_strips_is_read_whole(tmp_path: Path) -> None:
    film = np.random.default_rng(2).random((300, 500, 3), dtype=np.float32)
    image = Image(film)
    image.save(tmp_path / "a.tiff")
    with tifffile.TiffFile(tmp_path / "a.tiff") as file:
        assert len(file.pages[0].dataoffsets) > 3
        assert file.pages[0].dtype == np.uint16  # unless the picture says otherwise
        assert np.array_equal(file.pages[0].asarray(), quantise(image.developed(), 16))


@pytest.mark.parametrize("tone", ["srgb", "linear"])
def test_png_of_16_bits_is_read_bit_for_bit(tmp_path: Path, tone: str) -> None:
    image = saved(tmp_path / "a.png", bits=16, tone=tone)
    width, height, rows, told = png.Reader(str(tmp_path / "a.png")).asDirect()
    codes = np.array([list(row) for row in rows], np.uint16).reshape(height, width, 3)
    assert told["bitdepth"] == 16
    assert np.array_equal(codes, quantise(image.developed(), 16))
    with PIL.Image.open(tmp_path / "a.png") as picture:
        assert np.array_equal(np.asarray(picture), (codes >> 8).astype(np.uint8))
        assert picture.text["lens"] == METADATA["lens"]
        assert picture.info.get("srgb") == (0 if tone == "srgb" else None)
        assert picture.info.get("icc_profile") == (None if tone == "srgb" else profile(encoded=False))


def test_png_of_8_bits_tells_that_it_is_linear(tmp_path: Path) -> None:
    saved(tmp_path / "a.png", tone="linear")
    with PIL.Image.open(tmp_path / "a.png") as picture:
        assert picture.info["icc_profile"] == profile(encoded=False)
        assert "srgb" not in picture.info
        assert picture.getexif().get_ifd(IFD.Exif)[Base.ColorSpace] == 0xFFFF


@pytest.mark.parametrize("name", ["a.png", "a16.png", "a.tif"])
def test_same_picture_is_the_same_file(tmp_path: Path, name: str) -> None:
    (tmp_path / "again").mkdir()
    for path in (tmp_path / name, tmp_path / "again" / name):
        saved(path, bits=16 if "16" in name else None)
    assert (tmp_path / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
