"""Tone curves: values of the published formulas, and what every curve keeps."""

from typing import get_args

import numpy as np
import pytest

from rptcam_cl.core.colour import linear_from_srgb
from rptcam_cl.imaging.development import MOST_LOG2, agx, agx_contrast, developed_values, quantise, srgb_from_linear
from rptcam_cl.scene.film import PictureSettings, Tone

TONES = get_args(Tone)
WHITES = {"srgb": 1.0, "linear": 1.0, "reinhard": 4.0, "aces": 7.25, "agx": 2.0**MOST_LOG2}
GREYS = np.r_[0.0, np.geomspace(1e-5, 1e5, 4001)].astype(np.float32)


def greys(values: np.ndarray) -> np.ndarray:
    return np.repeat(np.asarray(values, np.float32).reshape(1, -1, 1), 3, axis=2)


def shown(values: np.ndarray, tone: Tone, white: float | None = None, **settings: float) -> np.ndarray:
    """The linear light of the display for greys."""
    encoded = developed_values(greys(values), PictureSettings(tone={"kind": tone, "white": white}, **settings))
    assert np.all(np.ptp(encoded, axis=2) < 1e-6)  # a grey stays grey
    return encoded[0, :, 0] if tone == "linear" else linear_from_srgb(encoded[0, :, 0])


@pytest.mark.parametrize(
    ("linear", "encoded"),
    [(0.0, 0.0), (0.0031308, 0.04045), (0.18, 0.46135613), (0.21404114, 0.5), (1.0, 1.0)],
)
def test_srgb_curve_has_the_values_of_the_standard(linear: float, encoded: float) -> None:
    # 0.04045 is the knee that IEC 61966-2-1 rounds to five digits
    assert srgb_from_linear(np.array([linear]))[0] == pytest.approx(encoded, abs=2e-6)


def test_srgb_curve_rises_everywhere() -> None:
    assert np.all(np.diff(srgb_from_linear(np.linspace(0.0, 1.0, 10001))) > 0)


def test_srgb_decoding_undoes_the_encoding() -> None:
    linear = np.linspace(0.0, 1.0, 1001, dtype=np.float32)
    np.testing.assert_allclose(linear_from_srgb(srgb_from_linear(linear)), linear, atol=5e-7)


def test_plain_picture_has_the_very_codes_of_the_curve_alone() -> None:
    # the codes of the first versions, which had no other curve: sRGB of the exposed film, rounded to 8 bits
    pixels = np.random.default_rng(1).normal(0.3, 0.6, (64, 64, 3)).astype(np.float32)
    pixels[0, :6] = [[np.nan] * 3, [np.inf] * 3, [-np.inf] * 3, [1e38] * 3, [1e-40] * 3, [-0.0, 0.0031308, 1.0]]
    for ev in (-60.0, -1.3, 0.0, 2.0, 60.0):
        with np.errstate(over="ignore"):
            exposed = pixels * np.float32(2.0**ev)
        x = np.clip(np.nan_to_num(exposed, nan=0.0), 0.0, 1.0).astype(np.float32)
        curve = np.float32(1.055) * x ** np.float32(1 / 2.4) - np.float32(0.055)
        encoded = np.where(x <= np.float32(0.0031308), x * np.float32(12.92), curve)
        codes = (encoded * np.float32(255.0) + np.float32(0.5)).astype(np.uint8)
        assert np.array_equal(quantise(developed_values(pixels, PictureSettings(ev=ev)), 8), codes)


def test_every_code_of_eight_bits_survives_the_way_there_and_back() -> None:
    codes = np.arange(256) / 255.0
    linear = np.where(codes <= 0.04045, codes / 12.92, ((codes + 0.055) / 1.055) ** 2.4)
    assert quantise(developed_values(greys(linear)), 8)[0, :, 0].tolist() == list(range(256))


def test_sixteen_bits_tell_values_apart_that_eight_do_not() -> None:
    encoded = developed_values(greys(np.linspace(0.4, 0.41, 400)))
    assert np.unique(quantise(encoded, 16)).size == 400
    assert np.unique(quantise(encoded, 8)).size < 5
    assert quantise(np.ones((1, 1, 3), np.float32), 16).max() == 65535


@pytest.mark.parametrize("tone", TONES)
def test_curve_never_falls_and_goes_from_black_to_white(tone: Tone) -> None:
    values = shown(GREYS, tone)
    assert values[0] == 0
    assert np.all(np.diff(values) >= -2e-7)
    inside = (GREYS > 1e-3) & (0.97 * WHITES[tone] > GREYS)
    assert np.all(np.diff(values[inside]) > 0)
    assert shown(np.array([WHITES[tone], 100 * WHITES[tone]]), tone) == pytest.approx([1, 1], abs=1e-6)
    assert shown(np.array([0.9 * WHITES[tone]]), tone)[0] < 0.9995


@pytest.mark.parametrize("tone", TONES)
@pytest.mark.parametrize("gamut", ["clip", "desaturate"])
def test_values_of_any_size_stay_in_range(tone: Tone, gamut: str) -> None:
    odd = [np.nan, np.inf, -np.inf, 1e38, -1e38, 1e-40, -1e-40, 0.0, 0.5, 3.0]
    pixels = np.array([[r, g, b] for r in odd for g in odd for b in odd], np.float32)[None]
    with np.errstate(all="raise", under="ignore"):
        encoded = developed_values(pixels, PictureSettings(ev=3.0, tone=tone, gamut=gamut))
    assert encoded.dtype == np.float32
    assert np.isfinite(encoded).all()
    assert encoded.min() >= 0
    assert encoded.max() <= 1


def test_one_stop_doubles_the_light() -> None:
    pixels = np.linspace(0.0, 0.5, 60, dtype=np.float32).reshape(4, 5, 3)
    for tone in TONES:
        once, twice = PictureSettings(ev=1.0, tone=tone), PictureSettings(tone=tone)
        assert np.array_equal(developed_values(pixels, once), developed_values(2 * pixels, twice))


def test_linear_picture_is_the_light_itself() -> None:
    pixels = np.random.default_rng(2).random((3, 4, 3), dtype=np.float32)
    assert np.array_equal(developed_values(pixels, PictureSettings(tone="linear")), pixels)


@pytest.mark.parametrize("white", [1.0, 4.0, 100.0])
def test_reinhard_maps_luminance_by_the_formula_and_keeps_ratios(white: float) -> None:
    # Reinhard et al. 2002, eq. 4: L (1 + L / white^2) / (1 + L)
    light = np.array([0.01, 0.18, 0.5, 0.9])
    expected = light * (1 + light / white**2) / (1 + light)
    assert shown(light, "reinhard", white) == pytest.approx(expected, rel=2e-6)
    colour = np.array([0.8, 0.4, 0.1], np.float32)
    display = linear_from_srgb(
        developed_values(colour[None, None], PictureSettings(tone={"kind": "reinhard", "white": white}))[0, 0]
    )
    assert display / display[1] == pytest.approx(colour / colour[1], rel=1e-5)


def test_aces_has_the_values_of_the_published_fit() -> None:
    # Narkowicz 2016: x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14), rounded here to four digits by hand
    assert shown(np.array([0.18, 1.0, 4.0]), "aces") == pytest.approx([0.2669, 0.8038, 0.9734], abs=5e-5)


def test_agx_has_the_contrast_of_the_published_table() -> None:
    # rows of LUTs/AgX_Default_Contrast.spi1d of github.com/sobotka/AgX, 4096 in all, printed to seven digits
    published = {0: 0.0, 512: 0.0111792, 1024: 0.0390305, 2048: 0.2928964, 2482: 0.5000888, 3072: 0.7776929,
                 3584: 0.9361831, 4095: 1.0}  # fmt: skip
    share = np.array(list(published), np.float32) / np.float32(4095)
    assert agx_contrast(share) == pytest.approx(list(published.values()), abs=5e-7)


# Computed by OpenColorIO 2.6 from config.ocio of github.com/sobotka/AgX (Linear BT.709 to AgX Base) and the inverse of
# its matrix. They differ from ours by the rounding of that matrix, whose rows do not sum to 1, and the table's steps.
@pytest.mark.parametrize(
    ("linear", "encoded"),
    [
        ((0.18, 0.18, 0.18), (0.49994, 0.50001, 0.50002)),
        ((1.0, 1.0, 1.0), (0.78741, 0.78755, 0.78755)),
        ((1.0, 0.0, 0.0), (0.86126, 0.22956, 0.22973)),
        ((0.0, 1.0, 0.0), (0.31534, 0.83085, 0.31541)),
        ((0.0, 0.0, 1.0), (0.31679, 0.31675, 0.83040)),
        ((0.8, 0.3, 0.05), (0.77991, 0.60132, 0.36360)),
        ((4.0, 2.0, 0.5), (0.95270, 0.88412, 0.72488)),
        ((0.02, 0.05, 0.2), (0.20105, 0.29832, 0.53309)),
        ((12.0, 0.2, 0.1), (1.03764, 0.71926, 0.69446)),
        ((0.001, 0.002, 0.004), (0.01593, 0.02788, 0.04830)),
    ],
)
def test_agx_has_the_values_of_the_published_configuration(
    linear: tuple[float, ...], encoded: tuple[float, ...]
) -> None:
    light = agx(np.array([[linear]], np.float32))[0, 0]
    assert light ** (1 / 2.2) == pytest.approx(encoded, abs=2e-4)


def test_agx_shows_middle_grey_at_half_of_the_signal() -> None:
    assert shown(np.array([0.18]), "agx")[0] == pytest.approx(0.5**2.2, rel=1e-5)


def test_agx_turns_bright_colours_white_and_leaves_dim_ones_coloured() -> None:
    lamp = np.array([[[1.0, 0.05, 0.02]]], np.float32)
    spread = [
        float(np.ptp(developed_values(lamp, PictureSettings(ev=ev, tone="agx")))) for ev in (-2.0, 2.0, 4.0, 6.0, 9.0)
    ]
    assert spread == sorted(spread, reverse=True)
    assert spread[0] > 0.3
    assert spread[-1] < 0.02
    clipped = developed_values(lamp, PictureSettings(ev=2.0))[0, 0]
    assert clipped[0] == pytest.approx(1, abs=1e-6)  # plain sRGB shows the lamp as pure red
    assert np.ptp(clipped) > 0.4


WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture
def colours() -> np.ndarray:
    return np.random.default_rng(3).uniform(-0.4, 1.6, (1, 4000, 3)).astype(np.float32)


def linear(colours: np.ndarray, gamut: str) -> np.ndarray:
    return developed_values(colours, PictureSettings(tone="linear", gamut=gamut))


def test_clipping_is_by_channel(colours: np.ndarray) -> None:
    assert np.array_equal(linear(colours, "clip"), np.clip(colours, 0, 1))


def test_desaturating_keeps_luminance_and_the_direction_from_grey(colours: np.ndarray) -> None:
    shown = linear(colours, "desaturate").astype(np.float64)
    before = colours @ WEIGHTS
    inside = (before > 0) & (before < 1)
    assert inside.mean() > 0.6
    np.testing.assert_allclose((shown @ WEIGHTS)[inside], before[inside], atol=1e-6)
    np.testing.assert_array_equal(shown[before <= 0], 0)
    np.testing.assert_allclose(shown[before >= 1], 1, atol=1e-6)
    given, kept = colours - before[..., None], shown - before[..., None]
    cosine = (given * kept).sum(-1) / (np.linalg.norm(given, axis=-1) * np.linalg.norm(kept, axis=-1) + 1e-12)
    coloured = inside & (np.linalg.norm(kept, axis=-1) > 1e-2)
    assert cosine[coloured].min() > 0.9999


def test_desaturating_goes_no_further_than_it_must(colours: np.ndarray) -> None:
    shown = linear(colours, "desaturate")
    outside = (colours < 0).any(-1) | (colours > 1).any(-1)
    assert np.array_equal(shown[~outside], colours[~outside])
    touches = (shown < 1e-6).any(-1) | (shown > 1 - 1e-6).any(-1)
    assert touches[outside].all()
