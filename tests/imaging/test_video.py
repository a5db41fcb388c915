"""Videos hold the developed pictures, in their order, as another reader decodes them."""

import av
import numpy as np
import pytest

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.imaging.development import quantise
from rptcam_cl.imaging.image import Image, check_video, write_video
from rptcam_cl.scene.film import PictureSettings

LEVELS = (0.05, 0.2, 0.6)


def pictures(height=34, width=51):
    ramp = np.linspace(0.2, 1.0, width, dtype=np.float32)[None, :, None]
    return [Image(np.broadcast_to(level * ramp, (height, width, 3)).astype(np.float32)) for level in LEVELS]


# FFV1 is without loss; the others quantise colour differences and frequencies
@pytest.mark.parametrize(("suffix", "most"), [(".mkv", 0), (".mov", 2 / 255), (".mp4", 4 / 255), (".webm", 6 / 255)])
def test_frames_of_a_video_are_the_developed_pictures(suffix, most, tmp_path):
    path = tmp_path / f"a{suffix}"
    assert write_video(path, pictures(), 23.976) == 3
    with av.open(str(path)) as file:
        (stream,) = file.streams.video
        assert float(stream.average_rate) == pytest.approx(23.976, rel=1e-3)
        found = [frame.to_ndarray(format="rgb48le").astype(int) for frame in file.decode(stream)]
    assert len(found) == 3
    for frame, image in zip(found, pictures(), strict=True):
        assert frame.shape == (34, 50, 3)  # an odd column is left out
        wanted = quantise(image.developed()[:, :50], 16).astype(int)
        assert np.abs(frame - wanted).mean() <= 65535 * most


@pytest.mark.slow
def test_equal_pictures_have_equal_bits_in_a_video(tmp_path):
    """With several threads in the filter some in a thousand differed, which one run in three shows."""
    noise = np.random.default_rng(1).random((38, 50, 3), np.float32)
    write_video(tmp_path / "a.mov", [Image(noise)] * 600, 24)
    with av.open(str(tmp_path / "a.mov")) as file:
        found = {frame.to_ndarray().tobytes() for frame in file.decode(video=0)}
    assert len(found) == 1


@pytest.mark.parametrize("suffix", [".mov", ".mp4", ".webm", ".mkv"])
def test_equal_videos_are_equal_files(suffix, tmp_path):
    for name in "ab":
        write_video(tmp_path / f"{name}{suffix}", pictures(), 24)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize("suffix", [".mov", ".mp4", ".webm", ".mkv"])
def test_colours_of_a_video_are_by_the_matrix_that_it_names(suffix, tmp_path):
    """Players take the numbers of a video that names none for those of one standard or of the other."""
    path, colour = tmp_path / f"a{suffix}", (1.0, 0.05, 0.2)
    image = Image(np.full((32, 32, 3), colour, np.float32))
    write_video(path, [image], 24)
    with av.open(str(path)) as file:
        (stream,) = file.streams.video
        codec = stream.codec_context
        named = (codec.color_primaries, codec.color_trc, codec.colorspace)
        frame = next(file.decode(stream))
        named += (frame.color_range,)
        bits = {"yuv420p": 8, "gbrp16le": 16}.get(frame.format.name, 10)
        planes = [np.frombuffer(plane, np.uint8 if bits == 8 else np.uint16) for plane in frame.planes]
    first, second, third = (float(plane[0]) for plane in planes)
    red, green, blue = image.developed()[0, 0]
    if suffix == ".mkv":
        assert named == (1, 13, 0, 2)  # Rec. 709, the curve of sRGB, no matrix, the full range: ITU-T H.273
        assert np.array([third, first, second]) / 65535 == pytest.approx([red, green, blue], abs=1e-4)
    else:
        assert named == (1, 13, 1, 1)
        luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue  # ITU-R BT.709-6
        wanted = 16 + 219 * luma, 128 + 224 * (blue - luma) / 1.8556, 128 + 224 * (red - luma) / 1.5748
        assert np.array([first, second, third]) / 2 ** (bits - 8) == pytest.approx(wanted, abs=2)


def test_video_of_linear_pictures_says_so(tmp_path):
    image = Image(np.full((8, 8, 3), 0.5, np.float32), development=PictureSettings(tone="linear"))
    write_video(tmp_path / "a.mkv", [image], 24)
    with av.open(str(tmp_path / "a.mkv")) as file:
        assert file.streams.video[0].codec_context.color_trc == 8


def test_mistakes_of_a_video_are_named(tmp_path):
    with pytest.raises(InputError, match=r"a\.avi: is no video .got \.avi; allowed: \.mov"):
        check_video(tmp_path / "a.avi")
    with pytest.raises(StateError, match="there is no folder"):
        check_video(tmp_path / "none" / "a.mkv")
    with pytest.raises(InputError, match="pictures of a video have one size"):
        write_video(tmp_path / "a.mkv", [*pictures(), *pictures(20, 20)], 24)
    with pytest.raises(InputError, match=r"need more pixels \(got 9 x 1; allowed: at least 2 x 2\)"):
        write_video(tmp_path / "a.mkv", pictures(1, 9), 24)
    with pytest.raises(InputError, match="at least one picture"):
        write_video(tmp_path / "a.mkv", [], 24)
    assert list(tmp_path.iterdir()) == []
