"""Picture files: what is read, and hostile ones that are refused in one sentence."""

import io
import os
import struct
import time
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import PIL.Image
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.pictures import LARGEST_PIXELS, read_picture, write_exr

RNG = np.random.default_rng(7)
BYTES = RNG.integers(0, 256, (5, 7, 3)).astype(np.uint8)


def encoded(array, form="PNG", **options) -> bytes:
    stream = io.BytesIO()
    image = array if isinstance(array, PIL.Image.Image) else PIL.Image.fromarray(array)
    image.save(stream, form, **options)
    return stream.getvalue()


@pytest.mark.parametrize("form", ["PNG", "TIFF", "BMP"])
def test_bytes_come_out_as_stored(form) -> None:
    picture = read_picture(encoded(BYTES, form))
    assert picture.texels.dtype == np.uint8
    np.testing.assert_array_equal(picture.texels[..., :3], BYTES)
    assert (picture.texels[..., 3] == 255).all()
    assert (picture.encoded, picture.has_alpha) == (True, False)
    assert (picture.width, picture.height) == (7, 5)


def test_jpeg_is_read() -> None:
    flat = np.full((16, 16, 3), (200, 100, 50), np.uint8)
    picture = read_picture(encoded(flat, "JPEG", quality=95))
    assert np.abs(picture.texels[..., :3].astype(int) - flat).max() <= 3


def test_other_modes_become_red_green_and_blue() -> None:
    image = PIL.Image.fromarray(BYTES)
    palette = read_picture(encoded(image.convert("P", palette=PIL.Image.Palette.ADAPTIVE)))
    np.testing.assert_array_equal(palette.texels[..., :3], BYTES)  # 35 colours fit a palette
    ink = read_picture(encoded(image.convert("CMYK"), "JPEG", quality=95))
    assert ink.texels.shape == (5, 7, 4)
    grey = read_picture(encoded(BYTES[..., 0]))
    np.testing.assert_array_equal(grey.texels[..., 1], BYTES[..., 0])
    one_bit = read_picture(encoded(image.convert("1")))
    assert set(np.unique(one_bit.texels[..., :3])) <= {0, 255}


def test_alpha_is_kept() -> None:
    rgba = RNG.integers(0, 256, (3, 4, 4)).astype(np.uint8)
    picture = read_picture(encoded(rgba))
    assert picture.has_alpha
    np.testing.assert_array_equal(picture.texels, rgba)


def test_sixteen_bits_stay_sixteen() -> None:
    grey = np.array([[0, 1, 256, 65535]], np.uint16)
    picture = read_picture(encoded(grey))
    assert picture.encoded
    np.testing.assert_allclose(picture.texels[0, :, 2], grey[0] / 65535, rtol=1e-7)


def rgbe(colours) -> np.ndarray:
    """Return shared-exponent bytes of colours (height, width, 3)."""
    mantissa, exponent = np.frexp(colours.max(axis=2))
    scale = mantissa * 256 / np.where(colours.max(axis=2) > 0, colours.max(axis=2), 1)
    pixels = np.zeros((*colours.shape[:2], 4), np.uint8)
    pixels[..., :3] = colours * scale[..., None]
    pixels[..., 3] = np.where(colours.max(axis=2) > 0, exponent + 128, 0)
    return pixels


def radiance_file(pixels, *, coded, header=b"", order=b"-Y %d +X %d\n") -> bytes:
    height, width, _ = pixels.shape
    out = b"#?RADIANCE\n# made for a test\nFORMAT=32-bit_rle_rgbe\n" + header + b"\n" + order % (height, width)
    for row in pixels:
        if not coded:
            out += row.tobytes()
            continue
        out += bytes([2, 2, width >> 8, width & 255])
        for component in row.T:
            out += run_lengths(component.tobytes())
    return out


def run_lengths(line: bytes) -> bytes:
    out, at = b"", 0
    while at < len(line):
        run = next((n for n in range(1, 128) if at + n >= len(line) or line[at + n] != line[at]), 127)
        if run > 2:
            out += bytes([128 + run, line[at]])
            at += run
        else:
            part = line[at : at + 5]
            out += bytes([len(part)]) + part
            at += len(part)
    return out


@pytest.mark.parametrize("coded", [True, False])
def test_radiance_pictures_are_read(coded) -> None:
    colours = RNG.exponential(size=(6, 40, 3)) ** 4
    colours[2] = colours[2, :1]
    colours[3, 3] = 0
    pixels = rgbe(colours)
    picture = read_picture(radiance_file(pixels, coded=coded))
    expected = pixels[..., :3] * np.where(pixels[..., 3:] > 0, np.ldexp(1.0, pixels[..., 3:].astype(int) - 136), 0)
    np.testing.assert_array_equal(picture.texels[..., :3], expected.astype(np.float32))
    assert not picture.encoded
    # a component has at least 8 bits below the largest of its pixel
    assert np.abs(picture.texels[..., :3] - colours).max() <= (colours.max(axis=2) / 128).max()


def test_runs_and_rows_of_bytes_may_have_any_length_that_their_code_can_say() -> None:
    """A code above 128 repeats one byte so often less 128; of others so many bytes follow (Ward 1991)."""
    numbers = [7, *range(100, 228), *[9] * 127, 3, *range(40), *[5] * 2]
    line = bytes([129, 7, 128, *range(100, 228), 255, 9, 1, 3, 40, *range(40), 130, 5])
    head = b"#?RADIANCE\n\n-Y 1 +X %d\n" % len(numbers) + bytes([2, 2, len(numbers) >> 8, len(numbers) & 255])
    picture = read_picture(head + 3 * line + bytes([255, 136, 128 + len(numbers) - 254, 136, 255, 136]))
    np.testing.assert_array_equal(picture.texels[0, :, :3], np.repeat(np.float32(numbers)[:, None], 3, axis=1))


def test_exponent_of_0_is_black() -> None:
    head = b"#?RADIANCE\n\n-Y 1 +X 2\n"
    texels = read_picture(head + bytes([10, 20, 30, 0, 10, 20, 30, 1])).texels
    np.testing.assert_array_equal(texels[0, :, :3], [[0, 0, 0], np.array([10, 20, 30]) * 2.0**-135], strict=False)


def test_radiance_exposure_is_undone_and_rows_may_run_upwards() -> None:
    pixels = rgbe(RNG.random((3, 9, 3)) + 0.5)
    plain = read_picture(radiance_file(pixels, coded=False)).texels
    low = read_picture(radiance_file(pixels // np.uint8([1, 1, 1, 9]), coded=False, header=b"EXPOSURE=1.2e-30\n"))
    assert np.isfinite(low.texels).all()
    header = b"EXPOSURE=2.0\nEXPOSURE= 0.25\n"
    brighter = read_picture(radiance_file(pixels, coded=False, header=header)).texels
    np.testing.assert_allclose(brighter[..., :3], 2 * plain[..., :3], rtol=1e-6)
    upwards = read_picture(radiance_file(pixels, coded=False, order=b"+Y %d -X %d\n")).texels
    np.testing.assert_array_equal(upwards, plain[::-1, ::-1])


def test_old_run_lengths_are_read() -> None:
    head = b"#?RGBE\n\n-Y 1 +X 7\n"
    picture = read_picture(head + bytes([10, 20, 30, 128, 1, 1, 1, 5, 9, 9, 9, 128]))
    np.testing.assert_array_equal(picture.texels[0, :6, 0], picture.texels[0, 0, 0])
    assert picture.texels[0, 6, 0] == np.float32(9 / 256)


def save_exr(path: Path, channels, **header) -> Path:
    base = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(base | header, channels) as file:
        file.write(str(path))
    return path


def test_exr_is_read_with_its_alpha(tmp_path: Path) -> None:
    colours = RNG.random((4, 6, 4)).astype(np.float32) * 100
    picture = read_picture(save_exr(tmp_path / "a.exr", {"RGBA": colours}))
    np.testing.assert_array_equal(picture.texels, colours)
    assert picture.has_alpha


# x and y of red, green, blue and white, and the matrix to linear sRGB that is published for them.
PUBLISHED = {
    "AP1": (  # colour-science.org's ACEScg to sRGB, Bradford, as in ACES' own utilities (to four digits)
        (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
        [[1.7051, -0.6217, -0.0833], [-0.1302, 1.1408, -0.0106], [-0.0240, -0.1289, 1.1529]],
    ),
    "Rec. 2020": (  # ITU-R BT.2087-0, the inverse of table 2
        (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
        [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]],
    ),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_exr_of_other_primaries_becomes_srgb(tmp_path: Path, name: str) -> None:
    primaries, matrix = PUBLISHED[name]
    colours = np.random.default_rng(2).random((3, 5, 3), np.float32) * 0.2 + 0.4  # inside sRGB: nothing is cut
    picture = read_picture(save_exr(tmp_path / "a.exr", {"RGB": colours}, chromaticities=primaries))
    assert picture.texels[..., :3] == pytest.approx(colours @ np.array(matrix).T, abs=2e-4)
    pure = np.array([[[1, 0, 0]] * 2], np.float32)
    picture = read_picture(save_exr(tmp_path / "b.exr", {"RGB": pure}, chromaticities=primaries))
    assert picture.negative[0] == 2
    assert picture.texels[0, 0, 0] == pytest.approx(matrix[0][0], abs=2e-4)


def test_exr_of_srgb_stays_as_it_is_and_no_primaries_are_refused(tmp_path: Path) -> None:
    colours = np.random.default_rng(2).random((3, 5, 3), np.float32)
    rounded = (0.6401, 0.33, 0.30, 0.60, 0.1499, 0.06, 0.3127, 0.3290)
    picture = read_picture(save_exr(tmp_path / "a.exr", {"RGB": colours}, chromaticities=rounded))
    assert np.array_equal(picture.texels[..., :3], colours)
    for wrong in ((0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3), (0.7, 0.0, 0.2, 0.7, 0.1, 0.0, 0.3, 0.3)):
        with pytest.raises(InputError, match="chromaticities that are no primaries"):
            read_picture(save_exr(tmp_path / "b.exr", {"RGB": colours}, chromaticities=wrong))


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L"])
def test_tga_is_read(tmp_path: Path, mode: str) -> None:
    own = PIL.Image.fromarray(np.random.default_rng(4).integers(0, 256, (5, 7, 4), np.uint8), "RGBA").convert(mode)
    own.save(tmp_path / "a.tga")
    picture = read_picture(tmp_path / "a.tga")
    assert np.array_equal(picture.texels, np.array(own.convert("RGBA")))
    assert picture.has_alpha == (mode == "RGBA") and picture.encoded


def test_exr_of_luminance_and_of_halves_is_grey(tmp_path: Path) -> None:
    grey = RNG.random((4, 6)).astype(np.float16)
    picture = read_picture(save_exr(tmp_path / "a.exr", {"Y": grey}))
    np.testing.assert_array_equal(picture.texels[..., :3], np.repeat(grey.astype(np.float32)[..., None], 3, axis=2))


def test_exr_covers_its_display_window(tmp_path: Path) -> None:
    colours = np.ones((4, 6, 3), np.float32)
    windows = {
        "dataWindow": (np.array([2, -1], np.int32), np.array([7, 2], np.int32)),
        "displayWindow": (np.array([0, 0], np.int32), np.array([4, 5], np.int32)),
    }
    picture = read_picture(save_exr(tmp_path / "a.exr", {"RGB": colours}, **windows))
    expected = np.zeros((6, 5))
    expected[:3, 2:] = 1
    np.testing.assert_array_equal(picture.texels[..., 0], expected)


@pytest.mark.parametrize(("left", "top"), [(-9, 0), (9, 0), (0, -9), (0, 9), (-9, 9)])
def test_exr_whose_data_are_beside_its_display_window_is_black(tmp_path: Path, left: int, top: int) -> None:
    windows = {
        "dataWindow": (np.array([left, top], np.int32), np.array([left + 5, top + 5], np.int32)),
        "displayWindow": (np.array([0, 0], np.int32), np.array([4, 3], np.int32)),
    }
    picture = read_picture(save_exr(tmp_path / "a.exr", {"RGB": np.ones((6, 6, 3), np.float32)}, **windows))
    assert picture.texels.shape == (4, 5, 4)
    assert not picture.texels.any()


def test_slightly_negative_texels_are_black(tmp_path: Path) -> None:
    colours = np.ones((2, 2, 3), np.float32)
    colours[0, 1, 2] = -5e-4
    picture = read_picture(save_exr(tmp_path / "a.exr", {"RGB": colours}))
    assert picture.texels[0, 1, 2] == 0
    assert picture.negative[0] == 0


def test_negative_texels_of_an_environment_are_black_with_one_warning(tmp_path: Path) -> None:
    from rptcam_cl.rendering.plan.textures import TextureTable
    from rptcam_cl.scene.load import load_scene

    colours = np.ones((4, 8, 3), np.float32)
    colours[0, 1, 2], colours[2, 5] = -0.25, -3
    save_exr(tmp_path / "a.exr", {"RGB": colours})
    camera = {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40}
    scene = load_scene({"camera": camera, "environment": {"kind": "image", "file": "a.exr"}}, base_dir=tmp_path)
    table = TextureTable(scene)
    with pytest.warns(
        UserWarning, match=r"2 of 32 texels are negative and count as black \(least value -3\)"
    ) as caught:
        found = table.colours(scene.environment, "rgb", "auto")
        table.colours(scene.environment, "r", "auto")
    assert len(caught) == 1
    assert found.mean == pytest.approx([31 / 32, 31 / 32, 30 / 32])


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_head(width, height) -> bytes:
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))


def bomb() -> bytes:
    """65 million pixels, all black, in a few kilobytes."""
    side = 8200
    rows = zlib.compressobj()
    data = b"".join(rows.compress(bytes(1 + 3 * side)) for _ in range(64)) + rows.flush()
    return png_head(side, side) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


PNG = encoded(RNG.integers(0, 256, (64, 64, 3)).astype(np.uint8))
HDR = radiance_file(rgbe(RNG.random((8, 32, 3)) + 0.5), coded=True)
LINE = bytes([2, 2, 0, 32])
BAD: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "is empty"),
    "text": (b"this is no picture", "is not a picture that can be read"),
    "an archive": (b"PK\x03\x04" + bytes(100), "is not a picture that can be read"),
    "PostScript": (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "is not a picture that can be read"),
    "SVG": (b'<svg xmlns="http://www.w3.org/2000/svg"/>', "is not a picture that can be read"),
    "GIF": (encoded(BYTES, "GIF"), "is not a picture that can be read"),
    "WebP": (b"RIFF\x24\0\0\0WEBPVP8 " + bytes(30), "is damaged"),
    "PNG cut off": (PNG[: len(PNG) // 2], "is damaged"),
    "PNG of a head alone": (png_head(4, 4), "is not a picture|is damaged"),
    "PNG with a broken checksum": (PNG[:100] + b"?" + PNG[101:], "is damaged"),
    "PNG bomb": (bomb(), f"is too large .got 8200 x 8200 pixels; allowed: at most {LARGEST_PIXELS}"),
    "PNG two thousand million wide": (png_head(2**31 - 1, 1) + chunk(b"IDAT", b""), "exceeds limit"),
    "JPEG cut off": (encoded(BYTES, "JPEG")[:200], "is not a picture|is damaged"),
    "HDR without resolution": (b"#?RADIANCE\n\nhello\n", "no resolution line"),
    "HDR without end of header": (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "no end of its header"),
    "HDR of XYZ": (b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n....", "holds 32-bit_rle_xyze"),
    "HDR with no exposure": (b"#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 1\n....", "EXPOSURE"),
    "HDR with an exposure in words": (b"#?RADIANCE\nEXPOSURE=bright\n\n-Y 1 +X 1\n....", "has an EXPOSURE that is not"),
    "HDR beyond float32": (
        b"#?RADIANCE\nEXPOSURE=1e-20\n\n-Y 1 +X 1\n" + bytes([9, 9, 9, 255]),
        "1 pixels are not finite",
    ),
    "HDR of no rows": (b"#?RADIANCE\n\n-Y 0 +X 7\n", "has no pixels"),
    "HDR larger than its file": (b"#?RADIANCE\n\n-Y 8000 +X 8000\n....", "is cut off"),
    "HDR of the largest size": (b"#?RADIANCE\n\n-Y 8192 +X 8192\n....", "is cut off"),
    "HDR of a row more": (b"#?RADIANCE\n\n-Y 8193 +X 8192\n....", "is too large"),
    "HDR too large": (b"#?RADIANCE\n\n-Y 90000 +X 90000\n....", "is too large"),
    "HDR cut off": (HDR[:-40], "cut off"),
    "HDR with a run past its line": (HDR.replace(LINE, LINE + bytes([255, 7]), 1), "damaged"),
    "HDR of runs alone": (b"#?RADIANCE\n\n-Y 1 +X 4\n\1\1\1\4" + bytes(12), "damaged"),
    "EXR in memory": (b"\x76\x2f\x31\x01" + bytes(100), "OpenEXR inside another file"),
}


@pytest.mark.parametrize("name", BAD)
def test_hostile_content_is_refused_at_once(name) -> None:
    content, message = BAD[name]
    start = time.process_time()
    with pytest.raises(InputError, match=message) as caught:
        read_picture(content)
    assert "\n" not in str(caught.value)
    assert time.process_time() - start < 20, "seconds; a hundredth of one is usual"


def exr_bytes(tmp_path: Path, colours) -> bytes:
    return save_exr(tmp_path / "whole.exr", {"RGB": np.asarray(colours, np.float32)}).read_bytes()


def with_window(content: bytes, name: bytes, window) -> bytes:
    at = content.index(name + b"\0box2i\0") + len(name) + 7 + 4
    return content[:at] + struct.pack("<4i", *window) + content[at + 16 :]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda whole: whole[:200], "is damaged"),
        (lambda whole: whole[:-10], "is damaged"),
        (lambda whole: whole[:4] + bytes(300), "is damaged"),
        (lambda whole: with_window(whole, b"dataWindow", (0, 0, 2**31 - 1, 0)), "is damaged|is too large"),
        (lambda whole: with_window(whole, b"dataWindow", (0, 0, 99_999, 99_999)), "is too large"),
        (lambda whole: with_window(whole, b"displayWindow", (0, 0, 99_999, 99_999)), "is too large"),
        (lambda whole: with_window(whole, b"dataWindow", (5, 5, 0, 0)), "is damaged|no pixels"),
    ],
    ids=["head cut off", "cut off", "zeros", "two thousand million wide", "huge data", "huge display", "inside out"],
)
def test_hostile_exr_is_refused(tmp_path: Path, capfd, change, message) -> None:
    path = tmp_path / "bad.exr"
    path.write_bytes(change(exr_bytes(tmp_path, np.ones((8, 9, 3)))))
    with pytest.raises(InputError, match=message):
        read_picture(path)


@pytest.mark.parametrize(("value", "word"), [(np.nan, "not finite"), (np.inf, "not finite")])
def test_texels_that_are_no_light_are_counted_and_placed(tmp_path: Path, value, word) -> None:
    colours = np.ones((8, 9, 3), np.float32)
    colours[3, 5, 1] = colours[6, 1, 0] = value
    path = save_exr(tmp_path / "bad.exr", {"RGB": colours})
    with pytest.raises(InputError, match=f"2 pixels are {word}, the first in column 5 of row 3"):
        read_picture(path)


def test_exr_without_colours_is_refused(tmp_path: Path) -> None:
    path = save_exr(tmp_path / "depth.exr", {"Z": np.ones((2, 2), np.float32)})
    with pytest.raises(InputError, match=r"has no colours \(got channels Z"):
        read_picture(path)


def test_written_exr_holds_the_channels_and_what_its_header_says(tmp_path: Path) -> None:
    colours, grey = RNG.random((3, 5, 3)), RNG.random((3, 5))
    write_exr({"RGB": colours}, tmp_path / "a.exr", {"lens": "of a test"})
    write_exr({"Y": grey}, tmp_path / "b.exr")
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert file.header()["lens"] == "of a test"
        np.testing.assert_array_equal(file.channels()["RGB"].pixels, colours.astype(np.float32))
    np.testing.assert_array_equal(read_picture(tmp_path / "b.exr").texels[..., 2], grey.astype(np.float32))


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_picture(tmp_path / "none.png")


def test_scene_names_the_place_of_a_bad_picture(tmp_path: Path) -> None:
    from rptcam_cl.api.job import render
    from rptcam_cl.scene.load import load_scene

    (tmp_path / "bad.png").write_bytes(PNG[:500])
    text = """\
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}
materials:
  wood: {kind: matte, reflectance: {kind: image, file: FILE}}
objects: [{shape: sphere, center: [0, 0, 0], radius: 1, material: wood}]
environment: {kind: constant, radiance: 1}
"""
    path = tmp_path / "scene.yaml"
    place = rf"^{path}:3:56: materials\.wood\.reflectance\.file: "
    path.write_text(text.replace("FILE", "bad.png"))
    with pytest.raises(InputError, match=place + "is damaged"):
        render(load_scene(path), spp=1)
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "away.png").symlink_to("/etc/passwd")
    for name, message in [
        ("none.png", "no such file"),
        ("../../etc/passwd", "lies outside|no such file"),
        ("/dev/zero", "lies outside"),
        ("away.png", "lies outside"),
        ("pipe.png", "is not a regular file"),
        ("http://example.org/a.png", "no such file"),
    ]:
        path.write_text(text.replace("FILE", f'"{name}"'))
        with pytest.raises(InputError, match=place + message):
            load_scene(path)
