import numpy as np
import pytest

from rptcam_cl.imaging import srgb_from_linear, tone_mapped


@pytest.mark.parametrize(
    ("linear", "encoded"),
    [(0.0, 0.0), (0.0031308, 0.04045), (0.18, 0.46135613), (0.21404114, 0.5), (1.0, 1.0)],
)
def test_srgb_curve_has_the_values_of_the_standard(linear: float, encoded: float) -> None:
    # 0.04045 is the knee that IEC 61966-2-1 rounds to five digits
    assert srgb_from_linear(np.array([linear]))[0] == pytest.approx(encoded, abs=2e-6)


def test_srgb_curve_rises_everywhere() -> None:
    assert np.all(np.diff(srgb_from_linear(np.linspace(0.0, 1.0, 10001))) > 0)


def test_values_off_the_scale_are_clipped_and_nan_is_black() -> None:
    pixels = np.array([[[-1.0, 2.0, np.nan], [np.inf, -np.inf, 1e38]]], np.float32)
    assert tone_mapped(pixels, ev=4.0).tolist() == [[[0, 255, 0], [255, 0, 255]]]


def test_one_stop_doubles_the_light() -> None:
    pixels = np.linspace(0.0, 0.5, 60, dtype=np.float32).reshape(4, 5, 3)
    assert np.array_equal(tone_mapped(pixels, ev=1.0), tone_mapped(2 * pixels))


def test_every_code_of_eight_bits_survives_the_way_there_and_back() -> None:
    codes = np.arange(256) / 255.0
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    assert tone_mapped(linear).tolist() == list(range(256))
