"""White balance: the light that is named becomes grey."""

import numpy as np
import pytest

from rptcam_cl.core.colour import WAVELENGTHS_NM, blackbody, illuminant, srgb_from_reflectance, srgb_from_spectrum
from rptcam_cl.imaging.development import developed_values
from rptcam_cl.imaging.image import Image, development_of
from rptcam_cl.scene.film import LIGHTS, PictureSettings, WhiteBalance
from rptcam_cl.scene.load import load_picture

WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


def wall(colour: np.ndarray, shape: tuple[int, int] = (4, 5)) -> np.ndarray:
    return np.broadcast_to(np.asarray(colour, np.float32), (*shape, 3)).copy()


def linear(pixels: np.ndarray, *, spectrum: str = "rgb", **settings: object) -> np.ndarray:
    return developed_values(
        pixels, development_of(load_picture({"tone": "linear", **settings}), {"spectrum": spectrum})
    )


@pytest.mark.parametrize("name", [name for name in LIGHTS if name != "auto"])
@pytest.mark.parametrize("spectrum", ["rgb", "spectral"])
def test_wall_in_the_light_of_an_illuminant_becomes_grey(name: str, spectrum: str) -> None:
    lit = wall(0.4 * srgb_from_spectrum(illuminant(name)))
    shown = linear(lit, white_balance=name, spectrum=spectrum)
    assert np.ptp(shown) < 1e-6
    assert shown.mean() == pytest.approx(0.4, abs=1e-3)  # its luminance stays
    other = linear(lit, white_balance="A" if name != "A" else "D50", spectrum=spectrum)
    assert np.ptp(other) > 1e-2


@pytest.mark.parametrize("kelvin", [1800.0, 2000.0, 3200.0, 5600.0, 40000.0])  # at 1800 K, blue is below 0
@pytest.mark.parametrize("adaptation", ["channels", "bradford"])
def test_wall_in_the_light_of_a_black_body_becomes_grey(kelvin: float, adaptation: str) -> None:
    light = srgb_from_spectrum(blackbody(kelvin))
    lit = wall(0.3 * light / (light @ WEIGHTS))
    shown = linear(lit, white_balance={"temperature_k": kelvin, "adaptation": adaptation})
    assert np.ptp(shown) < 1e-6
    assert shown.mean() == pytest.approx(0.3, abs=1e-3)


def reflectances() -> np.ndarray:
    """Smooth reflectance spectra of many colours, (300, 401)."""
    random = np.random.default_rng(1)
    centre, width = random.uniform(420, 680, (2, 300, 1)), random.uniform(40, 120, (2, 300, 1))
    humps = np.exp(-(((WAVELENGTHS_NM - centre) / width) ** 2) / 2) * random.uniform(-0.3, 0.6, (2, 300, 1))
    return np.clip(random.uniform(0.1, 0.4, (300, 1)) + humps.sum(axis=0), 0.02, 1)


@pytest.mark.parametrize("name", ["A", "F11", "LED-B1"])
def test_colours_of_an_rgb_render_are_those_under_white_light_exactly(name: str) -> None:
    colours = np.maximum(srgb_from_reflectance(reflectances()), 0)[None] * 0.4
    light = srgb_from_spectrum(illuminant(name))  # multiplied channel by channel where RGB is rendered
    shown = linear((colours * light).astype(np.float32), white_balance=name)
    np.testing.assert_allclose(shown / shown.max(), colours / colours.max(), atol=2e-6)
    by_bradford = linear((colours * light).astype(np.float32), white_balance={"light": name, "adaptation": "bradford"})
    assert np.abs(by_bradford - shown).max() > 0.02


@pytest.mark.parametrize("name", ["A", "F11", "LED-B1"])
def test_colours_of_a_spectral_render_are_nearer_to_those_under_white_light_by_bradford(name: str) -> None:
    truth = 0.4 * srgb_from_reflectance(reflectances())[None]
    lit = (0.4 * srgb_from_spectrum(reflectances() * illuminant(name))[None]).astype(np.float32)
    balanced, by_channel = (
        linear(lit, white_balance={"light": name, "adaptation": adaptation}) for adaptation in ("bradford", "channels")
    )
    assert np.array_equal(linear(lit, white_balance=name, spectrum="spectral"), balanced)
    errors = [float(np.sqrt(np.mean((shown - truth) ** 2))) for shown in (balanced, by_channel, np.maximum(lit, 0))]
    assert errors[0] < 0.02
    assert 1.5 * errors[0] < errors[1]
    assert 5 * errors[0] < errors[2]


def test_daylight_is_ten_tints_greener_than_a_black_body() -> None:
    pixels = np.random.default_rng(1).random((6, 7, 3), dtype=np.float32)
    shown = linear(pixels, white_balance={"temperature_k": 6504, "tint": 9.6})
    np.testing.assert_allclose(shown, pixels, atol=3e-4)  # tint 9.6 is rounded
    greener = linear(wall([0.5, 0.5, 0.5]), white_balance={"temperature_k": 6504, "tint": 40})[0, 0]
    assert greener[1] < min(greener[0], greener[2])  # green light is compensated by magenta


def test_colder_setting_makes_a_warmer_picture() -> None:
    red, _, blue = linear(wall([0.3, 0.3, 0.3]), white_balance={"temperature_k": 12000})[0, 0]
    assert red > 0.3 > blue


def test_d65_and_none_change_nothing() -> None:
    pixels = np.random.default_rng(2).random((6, 7, 3), dtype=np.float32)
    np.testing.assert_allclose(linear(pixels, white_balance="D65"), pixels, atol=5e-7)
    assert np.array_equal(linear(pixels, white_balance="none"), pixels)


def test_gains_are_factors_on_the_channels() -> None:
    pixels = np.random.default_rng(3).random((6, 7, 3), dtype=np.float32) * 0.4
    shown = linear(pixels, white_balance={"gains": [2, 1, 0.5]})
    np.testing.assert_allclose(shown, pixels * [2, 1, 0.5], rtol=1e-6)


def scene() -> np.ndarray:
    """Ten by twenty pixels: the left half in warm light, the right half in blue light, one bright lamp."""
    pixels = wall([0.4, 0.3, 0.1], (10, 20))
    pixels[:, 10:] = [0.1, 0.2, 0.5]
    pixels[0, 0] = 50.0
    return pixels


@pytest.mark.parametrize(
    ("grey", "column", "other"),
    [([0.25, 0.5], 4, 14), ([0.75, 0.5], 14, 4), ([0.0, 0.5, 0.2, 1.0], 4, 14), ([0.5, 1.0, 0.0, 1.0], 14, 4)],
)
def test_place_that_is_told_becomes_grey(grey: list[float], column: int, other: int) -> None:
    shown = linear(scene(), white_balance={"grey": grey})
    assert np.ptp(shown[5, column]) < 1e-6
    assert np.ptp(shown[5, other]) > 0.1
    assert shown[5, column].mean() == pytest.approx(scene()[5, column] @ WEIGHTS, abs=1e-3)


@pytest.mark.parametrize(
    "place", [(0.4, 0.5, 0.3, 0.7), (0.5, 0.5), (0.55, 0.4), (0.61, 0.47), (0.41, 0.415, 0.3, 0.301)]
)
def test_place_is_of_the_whole_film_also_in_a_part_of_it(place: tuple[float, ...]) -> None:
    picture = PictureSettings(tone="linear", white_balance=WhiteBalance(grey=place))
    metadata = {"resolution": [20, 10], "window": [8, 2, 12, 7]}
    pixels = np.random.default_rng(4).random((10, 20, 3), dtype=np.float32)
    part = Image(pixels[2:9, 8:], metadata, development=picture).developed()
    np.testing.assert_allclose(part, Image(pixels, development=picture).developed()[2:9, 8:], atol=1e-6)


def test_mean_of_the_picture_becomes_grey_without_its_lamps() -> None:
    pixels = scene()
    shown = linear(pixels, white_balance="auto")
    mean = np.delete(shown.reshape(-1, 3), 0, axis=0).mean(axis=0, dtype=np.float64)
    assert np.ptp(mean) < 1e-6
    pixels[0, 0] = [5000.0, 0, 0]  # another lamp, as little of the scene's light as the first
    np.testing.assert_allclose(linear(pixels, white_balance="auto")[1:], shown[1:], atol=1e-6)


@pytest.mark.parametrize("balance", [WhiteBalance(light="auto"), WhiteBalance(grey=(0.5, 0.5))])
@pytest.mark.parametrize("colour", [[0, 0, 0], [0.1, 0.3, -0.1], [-0.1, -0.2, 0.3]])
def test_what_cannot_be_grey_is_left_with_a_warning(balance: WhiteBalance, colour: list[float]) -> None:
    with pytest.warns(UserWarning, match="black or of no colour that light has; left as it is"):
        shown = developed_values(wall(colour), PictureSettings(tone="linear", white_balance=balance))
    assert np.array_equal(shown, np.clip(wall(colour), 0, 1))


def test_not_a_number_does_not_spread_to_other_channels_or_pixels() -> None:
    pixels = wall([0.4, 0.3, 0.2])
    pixels[0, 0] = [np.nan, 0.3, 0.2]
    pixels[1, 1] = np.inf
    shown = developed_values(pixels, PictureSettings(tone="linear", white_balance=WhiteBalance(light="A")))
    assert np.isfinite(shown).all()
    assert shown[1, 1].tolist() == [1, 1, 1]
