"""A stop without glass is a lens without power: a pinhole with an opening of its own size."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.irradiance import film_irradiance, lens_info
from rptcam_cl.optics.lens import film_distance, object_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.pupils import pupil_shapes

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
