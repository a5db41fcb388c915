"""MTF50 of rendered edges, against closed forms."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import erf

from rptcam_cl.api.combined import _window, mtf50_at


def edge(sigma, degrees, size=64, low=0.1, high=1.0):
    """A straight edge through the middle, blurred by a Gaussian and averaged over square pixels."""
    fine = (np.arange(8 * size) + 0.5) / 8 - size / 2
    x, y = np.meshgrid(fine, fine)
    distance = x * math.cos(math.radians(degrees)) + y * math.sin(math.radians(degrees))
    values = low + (high - low) * 0.5 * (1 + erf(distance / (math.sqrt(2) * sigma)))
    return values.reshape(size, 8, size, 8).mean(axis=(1, 3))


def expected(sigma, degrees):
    """Where the product of the Gaussian's and the pixel's transforms is a half [cycles per pixel]."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return brentq(
        lambda f: math.exp(-2 * (math.pi * sigma * f) ** 2) * np.sinc(f * c) * np.sinc(f * s) - 0.5, 1e-6, 0.7
    )


@pytest.mark.parametrize("degrees", [5, 12, 50, 85, 174, -97])
@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.0])
def test_mtf50_of_a_blurred_edge_is_that_of_gaussian_and_pixel(sigma, degrees):
    assert mtf50_at(edge(sigma, degrees), 0.5, 0.5) == pytest.approx(expected(sigma, degrees), rel=0.03)


@pytest.mark.parametrize(("degrees", "aside"), [(40, 12), (60, 12), (30, 14)])
def test_edge_that_leaves_at_the_sides_of_what_is_looked_at_is_measured(degrees, aside):
    picture = edge(0.5, degrees, size=96)
    assert mtf50_at(picture, 0.5 + aside / 96, 0.5) == pytest.approx(expected(0.5, degrees), rel=0.03)


def test_point_on_the_rim_of_the_picture_belongs_to_its_last_pixel():
    picture = edge(1.0, 40, size=128)[16:80, 16:80]
    found = mtf50_at(picture, 1.0, 0.5)
    assert found == mtf50_at(picture, 63.5 / 64, 0.5) == pytest.approx(expected(1.0, 40), rel=0.05)
    assert mtf50_at(picture.T, 0.5, 1.0) == mtf50_at(picture.T, 0.5, 63.5 / 64) == pytest.approx(found, rel=0.05)


def test_edge_with_what_is_no_number_has_none():
    picture = edge(1.0, 8)
    picture[30, 40] = np.nan
    assert mtf50_at(picture, 0.5, 0.5) is None


@pytest.mark.parametrize("length", [9, 96])
def test_window_over_an_edge_is_that_of_tukey(length):
    from scipy.signal.windows import tukey  # every process that collects tests would wait for it

    np.testing.assert_allclose(_window(length), tukey(length, 0.5), atol=1e-12)


def test_noise_of_a_hundredth_leaves_it_within_a_tenth():
    noisy = edge(1.0, 8) + np.random.default_rng(3).normal(0, 0.01, (64, 64))
    assert mtf50_at(noisy, 0.5, 0.5) == pytest.approx(expected(1.0, 8), rel=0.1)


@pytest.mark.parametrize(
    "picture",
    [np.full((64, 64), 0.5), np.zeros((64, 64)), edge(1, 0), edge(1, 90), edge(1, 8, low=0.98), np.ones((8, 8))],
    ids=["flat", "black", "upright", "level", "without contrast", "small"],
)
def test_what_is_no_slanted_edge_has_none(picture):
    assert mtf50_at(picture, 0.5, 0.5) is None
