"""Polynomials in place of a lens, on the host, beside rays traced in float64."""

from functools import cache

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import DISPERSION_SCALE, DISPERSION_SHIFT
from rptcam_cl.optics.film_probe import grid, narrowing_probes, pupil_boxes
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras.lens_records import usable_nm
from rptcam_cl.rendering.cameras.ray_map import LARGEST_ERROR_PX, LARGEST_ORDER, exponents, ray_map, terms
from tests.support.cases import slow

HALF_FILM_MM = (18.0, 12.0)
PIXELS_PER_MM = 1920 / 36
DISTANCES_MM = (1900.0, 1e9)


@cache
def mapped(name: str, wavelengths=587.5618, pixels_per_mm=PIXELS_PER_MM):
    """Return a lens focused at two metres, its distance to the film and its polynomials."""
    lens = load_lens(name)
    back = film_distance(lens, 2000.0)
    return lens, back, ray_map(lens, back, HALF_FILM_MM, wavelengths, pixels_per_mm, DISTANCES_MM)


def rays_of(lens, back, wavelength_nm):
    """Return film points all over the film, aims in their pupils, and the rays traced through both."""
    film = np.stack(np.meshgrid(np.linspace(-18, 18, 7), np.linspace(-12, 12, 5)), axis=-1).reshape(-1, 2)
    boxes, lit = pupil_boxes(narrowing_probes(lens, back, wavelength_nm), film)
    assert lit.all()
    aims = grid(boxes, 11, 11)
    film, aims = np.repeat(film, 121, axis=0), aims.reshape(-1, 2)
    start = np.column_stack([film, np.full(len(film), lens.length + back)])
    away = np.column_stack([aims - film, np.full(len(film), -back)])
    return film, aims, lens.trace(start, away, wavelength_nm)


def errors_px(found, film, aims, rays, wavelength_nm, focal_length_mm):
    """Return how far the directions of rays that pass are from those traced [pixels], of all rays but the blocked."""
    colour = np.full(len(film), DISPERSION_SCALE / wavelength_nm - DISPERSION_SHIFT)
    _, directions = found.trace(film, aims, colour)
    ok = rays.passed
    apart = directions[ok] - rays.directions[ok] * (1, 1, -1)
    return np.linalg.norm(apart, axis=1) * focal_length_mm * PIXELS_PER_MM


def test_terms_are_all_products_up_to_the_order():
    for order in range(1, LARGEST_ORDER + 1):
        for colours, count in ((False, 3), (True, 4)):
            powers = exponents(order, colours)
            assert (
                len(set(powers))
                == len(powers)
                == np.prod([order + k for k in range(1, count + 1)]) // np.prod(range(1, count + 1))
            )
            assert all(sum(each) <= order for each in powers)


def test_terms_do_not_change_when_the_lens_turns():
    rng = np.random.default_rng(3)
    x, y, colour = rng.normal(size=(9, 2)), rng.normal(size=(9, 2)), rng.normal(size=9)
    turn = np.array([[np.cos(1.1), -np.sin(1.1)], [np.sin(1.1), np.cos(1.1)]])
    powers = exponents(3, True)
    np.testing.assert_allclose(terms(x @ turn, y @ turn, colour, powers), terms(x, y, colour, powers), rtol=1e-9)


@pytest.mark.parametrize("name", ["dgauss-50mm", slow("wide-22mm")])
def test_polynomials_follow_rays_at_every_azimuth(name):
    lens, back, found = mapped(name)
    film, aims, rays = rays_of(lens, back, 587.5618)
    focal = lens.first_order().focal_length_mm
    assert errors_px(found, film, aims, rays, 587.5618, focal).max() < 1.2 * LARGEST_ERROR_PX
    passes = found.passes(lens, film, aims, np.zeros(len(film)))
    assert abs(np.count_nonzero(passes) / np.count_nonzero(rays.passed) - 1) < 3e-3
    # A polynomial of the wrong pupil does not: the test tells them apart.
    assert errors_px(found, film, aims * 1.03, rays, 587.5618, focal).max() > 2 * LARGEST_ERROR_PX


def test_polynomials_follow_every_wavelength():
    lens = load_lens("planar-1897")
    lens, back, found = mapped("planar-1897", usable_nm(lens))
    focal = lens.first_order().focal_length_mm
    for nm in (400.0, 470.0, 587.5618, 700.0):
        film, aims, rays = rays_of(lens, back, nm)
        assert errors_px(found, film, aims, rays, nm, focal).max() < 1.2 * LARGEST_ERROR_PX
    assert errors_px(found, film, aims, rays, 480.0, focal).max() > 2 * LARGEST_ERROR_PX  # the colour counts


def test_finer_pixels_take_higher_orders():
    orders = [mapped("dgauss-50mm", pixels_per_mm=pixels / 36)[2].rays.order for pixels in (40, 1920)]
    assert orders == sorted(orders) and len(set(orders)) == 2


@pytest.mark.parametrize(
    ("name", "why"),
    [("anamorphic-100mm", "not the same from every azimuth"), ("ball", "polynomials of degree 9 err by")],
)
def test_what_polynomials_cannot_follow_is_refused(name, why):
    lens = load_lens(name)
    with pytest.raises(InputError, match=why):
        ray_map(lens, 40.0 if name != "ball" else 10.0, (5.0, 5.0), 587.5618, 200.0, DISTANCES_MM)
