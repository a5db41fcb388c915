"""Shapes of the stop: areas, sampling without rejection, and rays that they let through."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.irradiance import film_irradiance, lens_info, on_axis_irradiance
from rptcam_cl.optics.lens import film_distance, object_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.pupils import pupil_shapes
from rptcam_cl.optics.surface import blades, heart, polygon, star

SHAPES = {"hexagon": blades(6), "round blades": blades(7, 10.0, 0.6), "star": star(5), "heart": heart()}


def test_areas_of_known_shapes():
    assert blades(6).area == pytest.approx(1.5 * np.sqrt(3))
    assert blades(9, curvature=1.0).area == pytest.approx(np.pi, rel=1e-3)
    assert polygon([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]).area == pytest.approx(1.0)
    assert polygon([(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)]).area == pytest.approx(1.0)


@pytest.mark.parametrize("name", SHAPES)
def test_samples_fill_the_shape_evenly(name):
    shape, rng = SHAPES[name], np.random.default_rng(2)
    points = shape.sample(rng.random((200_000, 3)))
    assert shape.holds(points[:, 0] * (1 - 1e-9), points[:, 1] * (1 - 1e-9)).all()
    # Share and moments against points of the square that lie inside.
    square = rng.uniform(-1, 1, (400_000, 2))
    inside = square[shape.holds(square[:, 0], square[:, 1])]
    assert len(inside) / len(square) * 4 == pytest.approx(shape.area, abs=0.015)
    for power in ((1, 0), (0, 1), (2, 0), (0, 2), (1, 1)):
        mine, theirs = (np.mean(p[:, 0] ** power[0] * p[:, 1] ** power[1]) for p in (points, inside))
        assert mine == pytest.approx(theirs, abs=0.006)


def test_a_shaped_stop_takes_its_share_of_the_light():
    lens = load_lens("dgauss-50mm").with_stop_diameter(4.0)
    film = lens.first_order().back_focal_distance_mm
    for shape in SHAPES.values():
        share = on_axis_irradiance(lens.with_stop_shape(shape), film) / on_axis_irradiance(lens, film)
        assert share == pytest.approx(shape.area / np.pi, rel=6e-3)


def with_shape(shape):
    rows = [{"stop": True, "thickness": 1, "diameter": 4, "shape": shape}, {"radius": 20, "diameter": 10}]
    return load_lens({"name": "x", "surfaces": rows}).surfaces[0].stop_shape


def test_shapes_in_lens_files():
    assert with_shape({"blades": 6, "rotation_degrees": 30, "curvature": 0.2}) == blades(6, 30, 0.2)
    assert with_shape({"star": 5, "inner": 0.5}) == star(5, 0.5)
    assert with_shape("heart") == heart()
    assert with_shape({"polygon": [[-0.5, -0.5], [0.5, -0.5], [0, 0.7]]}).area == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"blades": 2}, r"x: surfaces\[0\]\.shape: an iris has 3 to 64 blades \(got 2\)"),
        ({"blades": 10**6}, r"an iris has 3 to 64 blades"),
        ({"blades": 6, "curvature": 2}, r"curvature of blades lies between 0 and 1"),
        ({"star": 5.5}, r"shape\.star: expected a whole number"),
        ({"star": 5, "inner": 1}, r"inner radius of a star"),
        ({"polygon": [[0, 0]]}, r"needs 3 to 1024 points"),
        ({"polygon": [[2, 0], [0, 1], [-1, 0]]}, r"must lie inside the unit circle"),
        ({"polygon": [[0, 0], [0.4, 0.4], [0.4, 0], [0, 0.4]]}, r"crosses itself"),
        ({"polygon": "round"}, r"shape\.polygon: expected a list of points"),
        ("circle", r"surfaces\[0\]\.shape: expected a mapping"),
        ({}, r"surfaces\[0\]\.shape: allowed: heart"),
    ],
)
def test_impossible_shapes_are_refused(shape, message):
    with pytest.raises(InputError, match=message):
        with_shape(shape)


def test_a_shape_belongs_to_a_stop():
    with pytest.raises(InputError, match=r"surfaces\[0\]\.shape: belongs to the stop"):
        load_lens({"name": "x", "surfaces": [{"radius": 20, "diameter": 10, "shape": "heart"}]})


RADIUS = 0.2
FILM = 35.0


@pytest.fixture
def hole():
    return load_lens({"name": "Hole", "surfaces": [{"stop": True, "diameter": 2 * RADIUS}]})


def test_it_has_pupils_but_no_focal_length(hole):
    data = hole.first_order()
    assert not hole.has_power
    assert np.isinf(data.focal_length_mm) and np.isinf(data.f_number)
    assert data.entrance_pupil == data.exit_pupil
    assert (data.exit_pupil.distance_mm, data.exit_pupil.diameter_mm) == (0.0, 2 * RADIUS)
    assert lens_info(hole)["film_distance_mm"] is None


def test_what_needs_power_is_refused(hole):
    for ask in (lambda: film_distance(hole, 1000.0), lambda: object_distance(hole, FILM)):
        with pytest.raises(InputError, match="Hole: has no power, so it focuses nothing; set film_distance_mm instead"):
            ask()
    with pytest.raises(InputError, match="Hole: has no focal length, so no f-number; set stop_diameter_mm instead"):
        hole.stop_diameter_for(8.0)
    with pytest.raises(InputError, match=r"the stop opens to 0\.4 mm \(requested 1 mm\)"):
        hole.with_stop_diameter(1.0)


def test_rays_go_straight_on_or_are_clipped(hole):
    direction = np.array([0.3, -0.1, -1.0]) / np.sqrt(1.1)
    origins = np.array([[0.1, 0.0, 0.0], [0.3, 0.0, 0.0]]) - FILM * direction
    rays = hole.trace(origins, [direction, direction])
    assert rays.passed.tolist() == [True, False]
    assert rays.origins[0] == pytest.approx([0.1, 0.0, 0.0], abs=1e-13)
    assert rays.directions[0] == pytest.approx(direction, abs=1e-15)


def test_the_film_is_lit_as_by_a_disk(hole):
    height = np.array([0.0, 10.0, 20.0])
    p = FILM**2 + RADIUS**2 + height**2  # of a disk parallel to the film: E = pi / 2 (1 - (p - 2 r^2) / sqrt(...))
    expected = np.pi / 2 * (1 - (p - 2 * RADIUS**2) / np.sqrt(p**2 - 4 * height**2 * RADIUS**2))
    assert film_irradiance(hole, FILM, height) == pytest.approx(expected, rel=1e-4)


def test_pupils_are_the_opening(hole):
    shapes = pupil_shapes(hole, FILM, (18.0, 12.0))
    assert np.abs(shapes.centres).max() < 1e-6
    assert shapes.axes * shapes.radii[..., :1] == pytest.approx(np.full_like(shapes.axes, RADIUS), rel=0.02)
