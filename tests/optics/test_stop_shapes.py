"""Shapes of the stop: areas, sampling without rejection, and rays that they let through."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.irradiance import on_axis_irradiance
from rptcam_cl.optics.library import load_lens
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
