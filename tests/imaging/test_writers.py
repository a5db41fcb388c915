import io
import json
import struct
import zlib
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import png as pypng
import pytest

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import DEVELOPED_SUFFIXES, FILM_SUFFIXES, LAYER_SUFFIXES, RAW_SUFFIXES
from rptcam_cl.imaging import formats, writers
from rptcam_cl.imaging.development import quantise
from rptcam_cl.imaging.formats import _BAND_BYTES, write_png_to
from rptcam_cl.imaging.image import Image, read_film
from rptcam_cl.imaging.writers import check_output
from rptcam_cl.scene.film import PictureSettings
from tests.support.cases import slow

METADATA = {
    "scene_hash": "5e1f",
    "seed": 2**63,
    "spp": 64,
    "lens": "Gauß 50 mm f/2",
    "device": "cpu",
    "version": "0.1.0",
    "f_number": 2.0,
    "film_distance_mm": 36.77,
    "crop": [0.0, 1.0, 0.25, 0.75],
    "interrupted": False,
    "samples": np.int64(7),
}


def test_suffixes_that_are_said_are_those_that_are_written() -> None:
    assert set(writers._WRITERS) == {*DEVELOPED_SUFFIXES, *FILM_SUFFIXES} > set(LAYER_SUFFIXES)
    assert set(formats._WRITERS) == set(RAW_SUFFIXES)
    assert all(f"``{suffix}``" in str(Image.save.__doc__) for suffix in writers._WRITERS)


@pytest.fixture
def image() -> Image:
    pixels = np.random.default_rng(1).random((5, 7, 3), dtype=np.float32) * 4
    return Image(pixels, metadata=METADATA, development=PictureSettings(ev=-1.0))


def test_npy_holds_the_film_bit_for_bit(tmp_path: Path, image: Image) -> None:
    image.save(tmp_path / "film.npy")
    film = np.load(tmp_path / "film.npy", allow_pickle=False)
    assert film.dtype == np.float32
    assert np.array_equal(film, image.pixels)


def test_png_holds_the_developed_picture_and_the_metadata(tmp_path: Path, image: Image) -> None:
    image.save(tmp_path / "picture.PNG")
    with PIL.Image.open(tmp_path / "picture.PNG") as picture:
        assert picture.format == "PNG"
        assert picture.info["srgb"] == 0
        assert np.array_equal(np.asarray(picture), quantise(image.developed(), 8))
        text = picture.text
    assert text["lens"] == "Gauß 50 mm f/2"
    assert text["seed"] == str(2**63)
    assert text["spp"] == "64"
    assert text["crop"] == "[0.0, 1.0, 0.25, 0.75]"
    assert text["ev"] == "-1.0"


def test_jpeg_holds_the_developed_picture_closely_and_its_exif_data(tmp_path: Path) -> None:
    slope = np.linspace(0, 1, 64, dtype=np.float32)
    pixels = np.stack(np.broadcast_arrays(slope[:, None], slope[None, :], np.float32(0.3)), axis=-1)
    image = Image(pixels, metadata=METADATA)
    for name in ("picture.jpg", "picture.JPEG"):
        image.save(tmp_path / name)
        with PIL.Image.open(tmp_path / name) as picture:
            assert picture.format == "JPEG"
            error = np.asarray(picture, np.float64) - quantise(image.developed(), 8)
            assert abs(error).max() <= 6  # what quality 95 loses of a slope
            assert picture.getexif().get_ifd(0x8769)[0x829D] == 2.0  # FNumber
            assert picture.info["icc_profile"]
            kept = json.loads(picture.info["comment"])
            assert kept.keys() == METADATA.keys() | {"ev"}
            assert kept["lens"] == METADATA["lens"]


def test_jpeg_is_smaller_by_a_lower_quality(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).random((64, 64, 3), np.float32)
    sizes = []
    for quality in (100, 95, 60, 5):
        path = tmp_path / f"{quality}.jpg"
        Image(pixels, development=PictureSettings(jpeg_quality=quality)).save(path)
        sizes.append(path.stat().st_size)
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[-1] < sizes[0] / 5


def test_jpeg_keeps_metadata_of_any_length(tmp_path: Path) -> None:
    Image(np.ones((8, 8, 3), np.float32), metadata={"long": "ü" * 100_000}).save(tmp_path / "a.jpg")
    with PIL.Image.open(tmp_path / "a.jpg") as picture:
        comments = [content for marker, content in picture.applist if marker == "COM"]
    assert json.loads(b"".join(comments))["long"] == "ü" * 100_000


def test_exr_holds_the_film_bit_for_bit_in_scanlines(tmp_path: Path, image: Image) -> None:
    image.save(tmp_path / "film.exr")
    with OpenEXR.File(str(tmp_path / "film.exr")) as file:
        assert np.array_equal(file.channels()["RGB"].pixels, image.pixels)
        assert file.channels()["RGB"].pixels.dtype == np.float32
        assert file.header()["type"] == OpenEXR.scanlineimage
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION


def test_exr_keeps_each_piece_of_metadata_without_loss(tmp_path: Path, image: Image) -> None:
    image.save(tmp_path / "film.exr")
    with OpenEXR.File(str(tmp_path / "film.exr")) as file:
        header = dict(file.header())  # the file empties its own when it closes
    expected = {
        "scene_hash": "5e1f",
        "seed": str(2**63),  # EXR integers have 32 bits
        "spp": 64,
        "lens": "Gauß 50 mm f/2",
        "device": "cpu",
        "rptcam_version": "0.1.0",  # "version" means something else in EXR
        "f_number": 2.0,
        "film_distance_mm": "36.77",  # EXR floats are single
        "crop": "[0.0, 1.0, 0.25, 0.75]",
        "interrupted": "false",
        "samples": 7,
    }
    assert {key: header[key] for key in expected} == expected


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 65505.0, 3e38, 1e-40])
def test_exr_keeps_values_that_half_floats_cannot(tmp_path: Path, value: float) -> None:
    pixels = np.full((2, 2, 3), value, np.float32)
    Image(pixels).save(tmp_path / "film.exr")
    with OpenEXR.File(str(tmp_path / "film.exr")) as file:
        assert np.array_equal(file.channels()["RGB"].pixels, pixels, equal_nan=True)


@pytest.mark.parametrize("name", ["picture", "picture.gif", "picture.png.gz", ".png", "picture."])
def test_unknown_suffix_names_the_known_ones(tmp_path: Path, image: Image, name: str) -> None:
    with pytest.raises(InputError, match=r"allowed: \.png, \.jpg, \.jpeg, \.tif, \.tiff, \.exr, \.npy"):
        check_output(tmp_path / name)
    with pytest.raises(InputError, match=r"allowed: \.png, \.jpg, \.jpeg, \.tif, \.tiff, \.exr, \.npy"):
        image.save(tmp_path / name)


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
def test_folder_in_the_way_is_named(tmp_path: Path, image: Image, suffix: str) -> None:
    folder = tmp_path / f"taken{suffix}"
    folder.mkdir()
    with pytest.raises(StateError, match="is a folder"):
        check_output(folder)
    with pytest.raises(StateError, match="is a folder"):
        image.save(folder)


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
def test_missing_folder_is_named(tmp_path: Path, image: Image, suffix: str) -> None:
    path = tmp_path / "missing" / f"picture{suffix}"
    with pytest.raises(StateError, match="there is no folder"):
        check_output(path)
    with pytest.raises(StateError, match="there is no folder"):
        image.save(path)


def test_folder_where_nothing_can_be_made_is_refused() -> None:
    with pytest.raises(StateError, match="cannot be written"):
        check_output("/proc/picture.png")


def test_input_is_never_overwritten_not_even_through_a_link(tmp_path: Path) -> None:
    source = tmp_path / "texture.png"
    source.write_bytes(b"kept")
    link = tmp_path / "link.png"
    link.symlink_to(source)
    with pytest.raises(InputError, match="is an input"):
        check_output(link, inputs=[tmp_path / "scene.yaml", source])


def test_check_leaves_nothing_behind(tmp_path: Path) -> None:
    check_output(tmp_path / "picture.png")
    assert list(tmp_path.iterdir()) == []


def test_picture_too_long_for_a_jpeg_is_refused_in_words_of_ours(tmp_path):
    film = Image(np.ones((1, 65_501, 3), np.float32))
    with pytest.raises(
        StateError, match=r"the picture is 65501 x 1, and JPEG files have at most 65500 a side; use \.png"
    ):
        film.save(tmp_path / "a.jpg")
    assert list(tmp_path.iterdir()) == []
    film.save(tmp_path / "a.png")
    Image(np.ones((1, 65_500, 3), np.float32)).save(tmp_path / "a.jpg")


@pytest.mark.parametrize(
    ("size", "aspect"), [([36.0, 24.0], 1.5), ([24.0, 36.0], 2 / 3), ([24.0, 24.0], 1.0), (None, 1.0)]
)
def test_exr_says_how_wide_its_pixels_are(size, aspect, tmp_path):
    """A film of 36 x 24 mm in 8 x 8 pixels is shown half as wide again."""
    metadata = {"resolution": [8, 8]} | ({} if size is None else {"film_size_mm": size})
    Image(np.ones((8, 8, 3), np.float32), metadata).save(tmp_path / "a.exr")
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert file.header()["pixelAspectRatio"] == pytest.approx(aspect)


EXIF = b"MM\0*\0\0\0\x08\0\0\0\0\0\0"


def written(codes, texts=None, *, encoded=True):
    stream = io.BytesIO()
    write_png_to(stream, codes, texts or {}, EXIF, encoded=encoded)
    return stream.getvalue()


def chunks(content):
    place, found = 8, []
    while place < len(content):
        [length] = struct.unpack_from(">I", content, place)
        name, data = content[place + 4 : place + 8], content[place + 8 : place + 8 + length]
        [checksum] = struct.unpack_from(">I", content, place + 8 + length)
        assert checksum == zlib.crc32(name + data)
        found.append((name, data))
        place += 12 + length
    return found


def picture(height, width, dtype):
    random = np.random.default_rng(height)
    smooth = np.linspace(0, np.iinfo(dtype).max, width * 3).reshape(1, width, 3)
    noise = random.integers(0, np.iinfo(dtype).max // 8, (height, width, 3))
    return (smooth / 2 + noise).astype(dtype)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 1), (1, 2), (7, 5), (701, 600), slow(3, 200_000)])
def test_other_programs_read_every_code(height, width, dtype):
    codes = picture(height, width, dtype)
    content = written(codes)
    columns, rows, pixels, facts = pypng.Reader(bytes=content).asDirect()
    assert (columns, rows, facts["bitdepth"]) == (width, height, 8 * codes.itemsize)
    assert np.array_equal(np.vstack(list(pixels)).reshape(codes.shape), codes)
    packed = b"".join(data for name, data in chunks(content) if name == b"IDAT")
    assert len(zlib.decompress(packed)) == height * (3 * width * codes.itemsize + 1)  # its checksum holds, too
    if dtype == np.uint8:
        with PIL.Image.open(io.BytesIO(content)) as image:
            assert np.array_equal(np.asarray(image), codes)


def test_large_pictures_are_compressed_in_bands():
    codes = picture(701, 600, np.uint8)
    bands = [name for name, _ in chunks(written(codes))].count(b"IDAT") - 1  # the last one is the checksum
    assert bands == -(-701 // (_BAND_BYTES // (3 * 600))) == 3


def test_texts_have_any_letters_and_stand_before_the_pixels():
    texts = {"lens": "Gauß 50 mm", "scene": "日本\nline", "empty": ""}
    content = written(picture(3, 4, np.uint8), texts)
    with PIL.Image.open(io.BytesIO(content)) as image:
        assert image.text == texts
        assert image.info["srgb"] == 0
    names = [name for name, _ in chunks(content)]
    assert names == [b"IHDR", b"sRGB", b"tEXt", b"iTXt", b"tEXt", b"eXIf", b"IDAT", b"IDAT", b"IEND"]


def test_linear_codes_have_a_profile_that_says_so():
    with PIL.Image.open(io.BytesIO(written(picture(3, 4, np.uint8), encoded=False))) as image:
        assert image.info["icc_profile"]
        assert "srgb" not in image.info


def header_of(path: Path, **metadata: object) -> dict[str, object]:
    Image(np.zeros((4, 4, 3), np.float32), dict(metadata)).save(path)
    with OpenEXR.File(str(path)) as file:
        return dict(file.header())


def test_frames_have_smpte_time_codes(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    header = header_of(path, frame=90_000, timecode="01:02:29:23", frames_per_second=24.0)
    code = header["timeCode"]
    assert (code.hours, code.minutes, code.seconds, code.frame) == (1, 2, 29, 23)  # type: ignore[attr-defined]
    assert not code.dropFrame  # type: ignore[attr-defined]
    assert b"timeCode\x00timecode\x00\x08\x00\x00\x00\x23\x29\x02\x01" in path.read_bytes()  # two digits a byte
    assert header["framesPerSecond"] == Fraction(24)
    assert read_film(path).metadata["timecode"] == "01:02:29:23"


@pytest.mark.parametrize(("rate", "wanted"), [(24000 / 1001, Fraction(24000, 1001)), (12.5, Fraction(25, 2))])
def test_frame_rates_are_rational(tmp_path: Path, rate: float, wanted: Fraction) -> None:
    assert header_of(tmp_path / "a.exr", timecode="00:00:00:00", frames_per_second=rate)["framesPerSecond"] == wanted


@pytest.mark.parametrize("code", ["00:00:00:48", "30:00:00:00", "now"])
def test_what_smpte_cannot_say_is_text_alone(tmp_path: Path, code: str) -> None:
    header = header_of(tmp_path / "a.exr", timecode=code, frames_per_second=60.0)
    assert "timeCode" not in header
    assert header["timecode"] == code
