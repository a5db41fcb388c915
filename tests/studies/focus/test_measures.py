"""Measures of contrast: free of the noise's own square, of exposure and of smooth light."""

import numpy as np
import pytest

from benchmarks.focus_measures import COMPARED as MEASURES
from rptcam_cl.studies.focus.probe import ZoneImage, energy, rich_part
from tests.rendering.pictures import seed_of
from tests.support.cases import one_in, slow

QUADRATIC = ["normalised_variance", "tenengrad", "brenner", "energy_of_laplacian", "wavelet"]
SHAPE = (24, 32)


def image_of(picture, noise, rng, parts=4):
    """Return an image whose parts are a picture with independent noise of a standard deviation."""
    grey = picture + noise * rng.standard_normal((parts, *picture.shape))
    return ZoneImage(np.repeat(grey[..., None], 3, axis=-1).astype(np.float32), 16)


def ramp():
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / SHAPE[1]
    return 1 + 0.3 * x - 0.2 * y + 0.1 * x * y


def stripes(amplitude=0.2, period=6.0):
    x = np.arange(SHAPE[1])
    return np.broadcast_to(1 + amplitude * np.sin(2 * np.pi * x / period), SHAPE)


def repeated(name, picture, noise, count=200):
    rng = np.random.default_rng(seed_of(name))
    found = [MEASURES[name].of(image_of(picture, noise, rng)) for _ in range(count)]
    return np.array([measured.value for measured in found]), np.array([measured.error for measured in found])


def naive(name, picture, noise):
    """Return the square of what filters make of the mean picture: two parts that are the same picture."""
    mean = image_of(picture, noise, np.random.default_rng(7)).parts.mean(axis=0)
    return MEASURES[name].of(ZoneImage(np.stack([mean] * 3), 16)).value


@pytest.mark.parametrize("name", one_in(3, QUADRATIC))
def test_noise_adds_nothing_on_the_average(name):
    exact = MEASURES[name].of(image_of(stripes(), 0.0, np.random.default_rng(0))).value
    values, _ = repeated(name, stripes(), 0.3)
    error = values.std(ddof=1) / np.sqrt(len(values))
    assert 3.89 * error < 0.1 * (naive(name, stripes(), 0.3) - exact)
    # the mean that luminance is divided by has noise too: 1.5e-4 of relative variance for 768 pixels
    assert abs(values.mean() - exact) < 3.89 * error + 1e-3 * exact
    flat, _ = repeated(name, np.ones(SHAPE), 0.3)
    assert abs(flat.mean()) < 3.89 * flat.std(ddof=1) / np.sqrt(len(flat))


@pytest.mark.parametrize("name", one_in(3, QUADRATIC))
def test_error_is_that_of_the_spread(name):
    values, errors = repeated(name, stripes(), 0.1)
    # the jackknife of products errs upwards (Efron and Stein 1981): by up to 1.6 where noise outweighs the picture
    assert 0.8 < np.sqrt(np.mean(errors**2)) / values.std(ddof=1) < 1.8


@pytest.mark.parametrize("name", [name for name in MEASURES if name != "variance"])
def test_exposure_changes_nothing_and_smooth_light_is_no_contrast(name):
    rng = np.random.default_rng(0)
    measure = MEASURES[name].of
    dim, bright = (measure(image_of(factor * stripes(), 0.0, rng)).value for factor in (0.01, 100.0))
    assert dim == pytest.approx(bright, rel=1e-4)
    assert measure(image_of(ramp(), 0.0, rng)).value < MEASURES[name].least
    assert dim > MEASURES[name].least


@pytest.mark.parametrize("name", [name for name in MEASURES if name != "variance"])
def test_blur_lowers_every_measure(name):
    rng = np.random.default_rng(1)
    sharp = 1 + 0.3 * rng.standard_normal(SHAPE)
    soft = (sharp + np.roll(sharp, 1, 0) + np.roll(sharp, 1, 1) + np.roll(sharp, (1, 1), (0, 1))) / 4
    measure = MEASURES[name].of
    assert measure(image_of(soft, 0.0, rng)).value < 0.6 * measure(image_of(sharp, 0.0, rng)).value


@pytest.mark.parametrize("name", [name for name in MEASURES if name != "variance"])
def test_dark_zone_measures_nothing(name):
    found = MEASURES[name].of(ZoneImage(np.zeros((4, *SHAPE, 3), np.float32), 16))
    assert (found.value, found.error) == (0.0, 0.0)


@pytest.mark.parametrize("noise", [slow(0.05), slow(1.0)])
def test_modified_laplacian_of_noise_alone_is_none(noise):
    values, errors = repeated("sum_modified_laplacian", np.ones(SHAPE), noise, 100)
    assert abs(values.mean()) < 3.89 * values.std(ddof=1) / np.sqrt(len(values))
    # the error is that of noise, or more where the jackknife says so; four of them are what a search goes by
    assert 1.0 < np.sqrt(np.mean(errors**2)) / values.std(ddof=1) < 2.0
    assert np.mean(values > 4 * errors) == 0


def test_modified_laplacian_sees_what_noise_hides_in_every_pixel():
    found = MEASURES["sum_modified_laplacian"].of(image_of(stripes(0.2, 12.0), 0.1, np.random.default_rng(5)))
    assert found.value > 4 * found.error


def test_modified_laplacian_of_stripes_is_that_of_a_sine_at_every_step():
    found = MEASURES["sum_modified_laplacian"].of(image_of(stripes(), 0.0, np.random.default_rng(0))).value
    expected = 0.0
    for step in (1, 2, 4):
        # |2 I - I_left - I_right| of a sine: 4 a sin^2(pi step / period) |sin|, and the mean over a side of pixels
        blurred = np.sin(np.pi * step / 6) / (step * np.sin(np.pi / 6))
        x = np.arange(SHAPE[1] - 3 * step + 1) + 1.5 * step - 0.5
        expected += 4 * 0.2 * np.sin(np.pi * step / 6) ** 2 * abs(blurred) * np.abs(np.sin(2 * np.pi * x / 6)).mean()
    assert found == pytest.approx(expected, rel=0.03)  # less the quadratic that stripes hold too


def test_energy_of_a_filter_is_the_mean_square_of_its_output():
    picture = stripes()
    found = energy(lambda parts: [parts])(image_of(picture, 0.0, np.random.default_rng(0)))
    assert found.value == pytest.approx(0.02, rel=0.1)


def haar(k):
    """Of a wave along x, whose details down are none: differences over a step, means over the steps before."""
    gains, mean = [], 1.0
    for step in (1, 2, 4):
        gains.append(mean * abs(np.sin(k * step / 2)))
        mean *= abs(np.cos(k * step / 2))
    return sum(gain**2 for gain in gains)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("name", "gain2"),
    [
        ("brenner", lambda k: (2 * np.sin(k)) ** 2),
        ("tenengrad", lambda k: (8 * np.sin(k)) ** 2),
        ("energy_of_laplacian", lambda k: (4 * np.sin(k / 2) ** 2) ** 2),
        ("wavelet", haar),
    ],
)
def test_measure_of_a_wave_is_the_square_of_its_filters_gain(name, gain2, turned):
    period = 8.0
    wave = np.tile(1 + 0.2 * np.sin(2 * np.pi * (np.arange(64) + 0.5) / period), (64, 1))
    found = MEASURES[name].of(image_of(wave.T if turned else wave, 0.0, np.random.default_rng(0)))
    assert found.value == pytest.approx(gain2(2 * np.pi / period) * 0.2**2 / 2, rel=0.03)


def edge_in_noise(noise: float, seed: int = 0) -> np.ndarray:
    """Four pictures of a grey zone with one dark bar of 20 by 6 pixels at the left, with noise of their own."""
    shown = np.ones((48, 48))
    shown[10:30, 8:14] = 0.4
    return shown + noise * np.random.default_rng(seed).standard_normal((4, 48, 48))


@pytest.mark.parametrize("noise", [1e-3, 0.2])
def test_part_of_a_zone_is_where_its_details_are(noise: float) -> None:
    part = rich_part(edge_in_noise(noise))
    assert part is not None
    left, right, top, bottom = part
    assert left <= 8 and right >= 14 and top <= 12 and bottom >= 28
    assert (right - left) * (bottom - top) <= 48 * 48 / 2


def test_zones_of_even_or_of_coarse_detail_and_of_noise_stay_whole() -> None:
    dice = np.random.default_rng(1)
    spots = np.repeat(np.repeat(dice.random((16, 16)), 3, axis=0), 3, axis=1)
    assert rich_part(spots + 0.05 * dice.standard_normal((4, 48, 48))) is None  # everywhere alike
    x = np.linspace(-1, 1, 48)
    bowl = np.exp(-2 * ((x - 0.5) ** 2 + (x[:, None] + 0.5) ** 2))  # wider than any part: a trend in it
    assert rich_part(1 + bowl + 0.01 * dice.standard_normal((4, 48, 48))) is None
    assert sum(rich_part(1 + dice.standard_normal((4, 48, 48))) is not None for _ in range(20)) == 0
    assert rich_part(np.ones((4, 48, 48))) is None
