"""Irradiance behind a flat opening against closed forms and quadrature."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

from rptcam_cl.optics.surface import StopMask, blades, heart, star
from rptcam_cl.rendering.cameras.model import opening_irradiance

RADII = [1e-4, 0.05, 0.6]


@pytest.mark.parametrize("radius", RADII)
def test_many_blades_and_fine_masks_come_to_the_circle(radius):
    circle = math.pi * radius**2 / (1 + radius**2)
    assert opening_irradiance(None, radius, 1.0) == circle
    assert opening_irradiance(blades(64, 0.0, 1.0), radius, 1.0) == pytest.approx(circle, rel=1e-3)
    y, x = np.mgrid[-255.5:256, -255.5:256] / 256
    assert opening_irradiance(StopMask(np.hypot(x, y) <= 1), radius, 1.0) == pytest.approx(circle, rel=1e-3)


@pytest.mark.parametrize("radius", RADII)
def test_square_is_the_integral_of_the_fourth_power_of_the_cosine(radius):
    half = radius * math.sqrt(0.5)
    expected, _ = dblquad(lambda y, x: (1 + x * x + y * y) ** -2, -half, half, -half, half, epsrel=1e-9)
    square = blades(4, 45.0, 0.0)
    assert opening_irradiance(square, radius, 1.0) == pytest.approx(expected, rel=1e-9)
    assert opening_irradiance(square, 2 * radius, 2.0) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("shape", [star(5, 0.4, 90.0), heart(0.0)])
def test_far_away_the_area_counts(shape):
    assert opening_irradiance(shape, 1e-3, 1.0) == pytest.approx(shape.area * 1e-6, rel=1e-5)
