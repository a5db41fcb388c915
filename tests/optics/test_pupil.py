"""Exit pupil circles: nothing that passes lies outside."""

import time

import numpy as np
import pytest

from rptcam_cl.errors import InputError
from rptcam_cl.optics import load_lens
from rptcam_cl.optics.focus import film_distance
from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.optics.probe import FilmProbe
from rptcam_cl.optics.pupil import exit_pupil_circles
from rptcam_cl.optics.pupil_shape import pupil_shapes

CASES = [
    ("dgauss-50mm", 36.77, 21.633),
    ("wide-22mm", 14.54, 21.633),
    ("fisheye-10mm", 23.192, 35.0),
    ("telephoto-250mm", 123.7439, 35.0),
    ("dgauss-100mm", None, 21.633),
    ("ball", None, 21.633),
    ("biconvex-stop", None, 21.633),
]


@pytest.mark.parametrize(("name", "film", "radius"), CASES)
def test_no_passing_ray_lies_outside_its_circle(name, film, radius):
    lens = load_lens(name)
    film = film or film_distance(lens, np.inf)
    start = time.perf_counter()
    pupil = exit_pupil_circles(lens, film, radius)
    assert time.perf_counter() - start < 5  # 0.3 s alone; other tests may share the processor
    circles = np.asarray(pupil)
    assert circles.shape == (64, 3)
    rng = np.random.default_rng(3)
    probe = FilmProbe(lens, film, WAVELENGTH_D)
    points = np.zeros((150_000, 2))
    points[:, 0] = radius * rng.random(len(points))
    boxes = probe.windows(points)
    rear = boxes[:, [0, 2]] + (boxes[:, [1, 3]] - boxes[:, [0, 2]]) * rng.random((len(points), 2))
    passing = probe.passes(points, rear)
    row = np.minimum((points[:, 0] / radius * 64).astype(int), 63)
    outside = np.hypot(rear[:, 0] - circles[row, 0], rear[:, 1]) > circles[row, 1]
    assert passing.sum() > 500
    assert not np.any(passing & outside)


@pytest.mark.parametrize("name", ["cylinder-pair", "anamorphic-100mm"])
def test_circles_of_an_anamorphic_lens_hold_its_pupil_at_every_azimuth(name):
    lens = load_lens(name)
    film = film_distance(lens, np.inf)
    circles = np.asarray(exit_pupil_circles(lens, film, 15.0, intervals=16))
    rng = np.random.default_rng(5)
    angle, radius = rng.uniform(0, 2 * np.pi, 60_000), 15.0 * rng.random(60_000)
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    probe = FilmProbe(lens, film, WAVELENGTH_D)
    boxes = probe.windows(points)
    rear = boxes[:, [0, 2]] + (boxes[:, [1, 3]] - boxes[:, [0, 2]]) * rng.random((len(points), 2))
    passing = probe.passes(points, rear)
    row = np.minimum((radius / 15.0 * 16).astype(int), 15)
    centre = circles[row, :1] * points / radius[:, None]
    outside = np.hypot(*(rear - centre).T) > circles[row, 1]
    assert passing.sum() > 1000
    assert not np.any(passing & outside)
    assert np.all((circles[:, 2] > 0) & (circles[:, 2] <= 1))


def test_circles_of_a_clear_lens_waste_little():
    pupil = exit_pupil_circles(load_lens("telephoto-250mm"), 123.7439, 20.0)
    assert pupil.circles[:, 2].min() > 0.9
    on_axis = exit_pupil_circles(load_lens("dgauss-50mm"), 36.77, 0.5)
    assert np.abs(on_axis.circles[0, 0]) < 0.2


def test_beyond_the_image_circle_the_radius_is_zero():
    pupil = exit_pupil_circles(load_lens("fisheye-10mm"), 23.192, 35.0)
    assert np.all(pupil.circles[30:] == 0)
    assert pupil.image_circle_radius_mm == pytest.approx(13.45, abs=0.6)


def test_no_light_at_all_is_an_error():
    lens = load_lens("dgauss-50mm")
    with pytest.raises(InputError, match="film must stand behind"):
        exit_pupil_circles(lens, -1.0, 20.0)
    with pytest.raises(InputError, match="film radius must be above 0"):
        exit_pupil_circles(lens, 36.0, 0.0)


def test_outlines_of_a_pupil_much_smaller_than_the_rear_element_are_found():
    lens = load_lens("phone-5.6mm")  # 0.17 mm of 6.8 mm
    film = lens.first_order().back_focal_distance_mm
    shapes = pupil_shapes(lens, film, (2.8, 2.1))
    assert np.all(shapes.axes > 0.07) and np.all(shapes.axes < 0.1)
    probe = FilmProbe(lens, film, WAVELENGTH_D)
    points = np.stack([shapes.x[:-1], np.zeros(len(shapes.x) - 1)], axis=1)
    assert np.all(probe.passes(points, shapes.centres[0, :-1]))
    assert not np.any(probe.passes(points, shapes.centres[0, :-1] + [0.0, 0.15]))
