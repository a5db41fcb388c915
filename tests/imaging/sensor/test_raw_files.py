"""Raw files as other software reads them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rawpy
import tifffile

from rptcam_cl.core.colour import RESPONSES
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.imaging.development import SensorModel, expose
from rptcam_cl.imaging.formats import RawImage, check_raw_output
from tests.imaging.sensor.sensors import sensor
from tests.imaging.sensor.test_mosaic import CHART

METADATA = {
    "software": "rptcam_cl 0", "iso": 400.0, "exposure_time_s": 1 / 125, "f_number": 2.8, "focal_length_mm": 50.0,
    "lens": "Größe", "not_finite": float("inf"),
}  # fmt: skip
SENSORS = [("nikon_d5100", order) for order in ("RGGB", "BGGR", "GRBG", "GBRG", "none")]
SENSORS += [("canon_eos_5d_mark_ii", "RGGB"), ("sigma_sd_merrill", "none"), (None, "RGGB"), (None, "monochrome")]


def raw_of(chosen: SensorModel, size: int = 24) -> RawImage:
    film = CHART.repeat(size, axis=0).repeat(size, axis=1)
    return RawImage(expose(film, chosen), chosen, METADATA)


def quiet(response: str | None, bayer: str) -> SensorModel:
    """A sensor of so many electrons that noise does not show in the mean of a patch."""
    chosen = sensor(response, bayer=bayer, full_well_e=3e8, dark_e=1e5)
    gain = chosen.system_gain_dn_per_e * 1e-4
    return replace(chosen, electrons=chosen.electrons * 1e4, system_gain_dn_per_e=gain)


@pytest.mark.parametrize(("response", "bayer"), SENSORS)
def test_libraw_finds_the_colours_of_the_chart(tmp_path: Path, response: str | None, bayer: str) -> None:
    raw = raw_of(quiet(response, bayer))
    raw.save(tmp_path / "chart.dng")
    with rawpy.imread(str(tmp_path / "chart.dng")) as file:
        shape = (file.sizes.height, file.sizes.width)
        assert shape == raw.numbers.shape[:2]
        if raw.numbers.ndim == 2:
            assert np.array_equal(file.raw_image, raw.numbers)
        picture = file.postprocess(
            use_camera_wb=True, output_bps=16, gamma=(1, 1), no_auto_bright=True, user_flip=0,
            output_color=rawpy.ColorSpace.sRGB,
        ).reshape(*shape, -1)  # fmt: skip
    patches = picture.reshape(3, 24, 6, 24, -1)[:, 6:-6, :, 6:-6].mean(axis=(1, 3)) / 65535
    ours = raw.linear().reshape(3, 24, 6, 24, 3)[:, 6:-6, :, 6:-6].mean(axis=(1, 3))
    expected = ours[..., : patches.shape[-1]]
    # Its exposure ends where the first channel saturates; ours is that of the film.
    scale = patches[0, 4].mean() / expected[0, 4].mean()
    assert patches / scale == pytest.approx(expected, abs=0.004)


def test_digital_negative_tells_how_it_was_taken(tmp_path: Path) -> None:
    raw = raw_of(sensor("nikon_d5100", bayer="GRBG", dark_e=1000.0))
    raw.save(tmp_path / "chart.dng")
    with tifffile.TiffFile(tmp_path / "chart.dng") as file:
        tags = {tag.code: tag.value for tag in file.pages.first.tags.values()}
    assert bytes(tags[50706]) == bytes((1, 4, 0, 0))
    assert bytes(tags[33422]) == bytes((1, 0, 2, 1))
    assert tags[50714][0] / tags[50714][1] == pytest.approx(512 + 1000 * raw.sensor.system_gain_dn_per_e, abs=1e-3)
    assert tags[50717] == 16383
    assert tags[33434][0] / tags[33434][1] == pytest.approx(1 / 125)
    assert tags[33437][0] / tags[33437][1] == pytest.approx(2.8)
    assert tags[34855] == 400
    neutral = np.array(tags[50728], float).reshape(3, 2)
    assert neutral[:, 0] / neutral[:, 1] == pytest.approx(raw.sensor.white_electrons / raw.sensor.white_electrons.max())


@pytest.mark.parametrize("bayer", ["RGGB", "none", "monochrome"])
def test_tiff_and_array_hold_the_numbers(tmp_path: Path, bayer: str) -> None:
    raw = raw_of(sensor(bayer=bayer), 4)
    raw.save(tmp_path / "raw.tif")
    raw.save(tmp_path / "raw.npy")
    stored = tifffile.imread(tmp_path / "raw.tif")
    assert stored.dtype == np.uint16 and np.array_equal(stored, raw.numbers)
    assert np.array_equal(np.load(tmp_path / "raw.npy"), np.asarray(raw))
    with tifffile.TiffFile(tmp_path / "raw.tif") as file:
        assert json.loads(file.pages.first.description)["iso"] == 400.0


@pytest.mark.parametrize("suffix", [".dng", ".tif", ".npy"])
def test_same_seed_gives_the_same_file(tmp_path: Path, suffix: str) -> None:
    for name in "abc":
        raw_of(sensor(seed=7 if name < "c" else 8), 8).save(tmp_path / f"{name}{suffix}")
    first, second, other = ((tmp_path / f"{name}{suffix}").read_bytes() for name in "abc")
    assert first == second != other


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"raw\.png: the suffix sets the raw format \(got \.png; allowed: \.dng"):
        raw_of(sensor(), 4).save(tmp_path / "raw.png")
    with pytest.raises(InputError, match="got no suffix"):
        check_raw_output(tmp_path / "raw")
    with pytest.raises(StateError, match="there is no folder"):
        check_raw_output(tmp_path / "nowhere" / "raw.dng")
    assert RESPONSES and list(tmp_path.iterdir()) == []
