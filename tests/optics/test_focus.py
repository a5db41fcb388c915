"""Focusing by the thick lens, against the truth tables and traced rays."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.best_focus import best_film_distance
from rptcam_cl.optics.lens import film_distance, nearest_object_distance, object_distance
from rptcam_cl.optics.library import load_lens
from tests.optics.truth import NAMES, truth, truth_lens


def autofocus_cases(name):
    scale = 1.0 if truth(name)["units"].startswith("scene") else 1000.0
    for case in truth(name)["autofocus"]["cases"]:
        distance = case["object_distance"]
        yield (float(distance) * scale), case


@pytest.mark.parametrize("name", NAMES)
def test_focus_for_an_object_in_front_of_the_lens(name):
    lens = truth_lens(name)
    for distance, case in autofocus_cases(name):
        expected = case["from_first_vertex"]["paraxial_back_distance"]
        assert film_distance(lens, distance, "front") == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_focus_for_an_object_at_a_distance_from_the_film(name):
    lens = truth_lens(name)
    for distance, case in autofocus_cases(name):
        if "from_film" not in case:
            continue
        solution = case["from_film"]["paraxial"]
        if solution is None:
            with pytest.raises(InputError, match="nearest possible"):
                film_distance(lens, distance)
            continue
        back = film_distance(lens, distance)
        assert back == pytest.approx(solution["back_distance"], rel=1e-9)
        assert object_distance(lens, back) == pytest.approx(distance, rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_finite_conjugates(name):
    for row in truth(name)["finite_conjugates"]:
        back = film_distance(truth_lens(name), row["object_distance_from_vertex0"], "front")
        assert back == pytest.approx(row["back_distance"], rel=1e-9)


@pytest.mark.parametrize(
    ("name", "film", "front"),
    [
        ("dgauss-50mm", 36.77, 3846),
        ("wide-22mm", 14.54, 2194),
        ("fisheye-10mm", 23.192, 3165),
        ("telephoto-250mm", 123.7439, 3668),
    ],
)
def test_assignment_scenes_are_focused_where_they_should(name, film, front):
    lens = load_lens(name)
    assert object_distance(lens, film) - film - lens.length == pytest.approx(front, abs=0.6)


@pytest.mark.parametrize("name", ["dgauss-50mm", "dgauss-100mm", "telephoto-250mm"])
def test_a_traced_ray_close_to_the_axis_meets_the_object_plane(name):
    lens = load_lens(name)
    for distance in (500.0, 2000.0, 5000.0):
        if distance < nearest_object_distance(lens):
            continue
        film = film_distance(lens, distance)
        z = lens.length + film
        rays = lens.trace([[0, 0, z]], [[0, 1e-4 * lens.surfaces[-1].semi_diameter, -film]])
        crossing = rays.origins[0, 2] - rays.origins[0, 1] / rays.directions[0, 1] * rays.directions[0, 2]
        assert z - crossing == pytest.approx(distance, rel=1e-5)


def test_too_near_an_object_is_refused_with_the_nearest_possible():
    lens = load_lens("dgauss-50mm")
    nearest = nearest_object_distance(lens)
    # At equal conjugates the object stands four focal lengths from the film, but for the gap of the principal planes.
    gap = lens.length + lens.first_order().principal_planes_mm.rear - lens.first_order().principal_planes_mm.front
    assert nearest == pytest.approx(4 * 50.35816695831366 + gap, rel=1e-9)
    with pytest.raises(
        InputError, match=rf"cannot focus at 100 mm from the film; the nearest possible is {nearest:.6g} mm"
    ):
        film_distance(lens, 100.0)
    with pytest.raises(InputError, match=r"nearest possible is 27\.1224 mm"):
        film_distance(lens, 20.0, "front")
    assert film_distance(lens, nearest) == pytest.approx(
        lens.first_order().back_focal_distance_mm + 50.358167, rel=1e-4
    )


def test_no_real_image_is_said_so():
    with pytest.raises(InputError, match=r"forms no real image \(focal length -49\.98"):
        film_distance(load_lens("biconcave"), 1000.0)
    plate = load_lens(
        {"name": "plate", "surfaces": [{"thickness": 5, "glass": {"index": 1.5}, "diameter": 10}, {"diameter": 10}]}
    )
    with pytest.raises(InputError, match="plate: has no power"):
        film_distance(plate, 1000.0)
    rod = {"radius": 10, "thickness": 60, "glass": {"index": 1.5}, "diameter": 5}
    telescope = load_lens({"name": "telescope", "surfaces": [rod, {"radius": -10, "diameter": 5}]})
    with pytest.raises(InputError, match="telescope: is afocal"):
        film_distance(telescope, 1000.0)


def test_a_virtual_object_is_refused():
    lens = load_lens("dgauss-50mm")
    with pytest.raises(InputError, match="nothing in front of the lens is sharp"):
        object_distance(lens, 30.0)
    assert object_distance(lens, lens.first_order().back_focal_distance_mm) == np.inf
    assert film_distance(lens, np.inf) == lens.first_order().back_focal_distance_mm


def stopped_behind(gap, semi_diameter):
    """Return a biconvex lens of 50 mm whose stop stands behind it."""
    return load_lens(
        {
            "name": "behind",
            "surfaces": [
                {"radius": 51.68, "thickness": 3, "glass": {"index": 1.5168}, "diameter": 30},
                {"radius": -51.68, "thickness": gap, "diameter": 30},
                {"stop": True, "diameter": 2 * semi_diameter},
            ],
        }
    )


TELECENTRIC = 49.50059928086297  # the gap with the stop in the rear focal plane: the entrance pupil is at infinity


@pytest.mark.parametrize("share", [1 - 1e-9, 1.0, 1 + 1e-9, 1.02, 1.2])
def test_best_focus_of_lenses_that_see_objects_telecentrically(share):
    lens = stopped_behind(TELECENTRIC * share, 0.5)
    radii = np.sqrt(np.linspace(0.0, 1.0, 200_001)[1:]) * 15.0  # even over a plane, up to the first ray that is stopped
    through = np.column_stack([0 * radii, radii, 0 * radii])
    rays = lens.trace(through, np.add(through, (0.0, 0.0, 200.0)), start="scene")
    seen = slice(0, int(np.argmin(rays.passed)))
    slopes = rays.directions[seen, 1] / rays.directions[seen, 2]
    heights = rays.origins[seen, 1] + (lens.length - rays.origins[seen, 2]) * slopes
    least = -np.sum(heights * slopes) / np.sum(slopes**2)
    assert best_film_distance(lens, 200.0, "front") == pytest.approx(least, abs=1e-3)
