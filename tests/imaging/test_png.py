"""PNG files as other programs read them: every code of 8 and 16 bits, whatever the bands, and texts of any letters."""

import io
import struct
import zlib

import numpy as np
import PIL.Image
import png as pypng
import pytest

from rptcam_cl.imaging.formats import _BAND_BYTES, write_png_to

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
@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 1), (1, 2), (7, 5), (701, 600), (3, 200_000)])
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
