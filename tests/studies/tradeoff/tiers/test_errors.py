"""Errors of cheaper camera models against the traced lens, and the choice among them."""

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.studies.tier_models import TIERS, equivalent, first_order_camera
from rptcam_cl.studies.tiers import choose_camera
from tests.studies.tradeoff.tiers.cases import LENSES, errors_of, scene_of, stop_mm, truth_of
from tests.support.cases import one_in


@pytest.mark.parametrize("lens", one_in(3, LENSES))
def test_tiers_agree_with_the_traced_lens_to_first_order(lens):
    """On a film of 1 mm behind a twentieth of the aperture, what is left is of third order."""
    scene = scene_of(
        lens, film={"resolution": [1000, 1000], "width_mm": 1}, stop_diameter_mm=stop_mm(lens) / 20, spectrum="rgb"
    )
    errors = errors_of(scene)
    for tier in ("thin_lens", "thick_lens"):
        assert errors[tier].worst_px < 0.1, tier
        assert errors[tier].worst_illumination < 2e-3, tier  # of a flat film: cos^4


def test_pinhole_errs_by_the_radius_of_the_blur():
    scene = scene_of("dgauss-50mm", film={"resolution": [1000, 1000], "width_mm": 1}, f_number=22)
    first = first_order_camera(scene)
    far = 10_000.0
    radius = first.radius_mm * abs((far - first.pupil_mm) / first.plane_mm - 1)
    expected = radius / (far - first.pupil_mm) * first.film_mm_per_tangent * 1000
    errors = errors_of(scene, (far,))
    assert errors["pinhole"].worst_px == pytest.approx(expected, rel=0.02)
    assert max(truth_of(scene).blur_px((far,))) == pytest.approx(expected, rel=0.02)


def test_errors_grow_with_the_field_of_a_lens_that_distorts():
    pixels = errors_of(scene_of("fisheye-10mm", film={"resolution": [640, 360], "width_mm": 12}, focus=50.0))[
        "pinhole"
    ].pixels
    assert list(pixels) == sorted(pixels)
    assert pixels[-1] > 20


def test_film_beyond_the_image_circle_is_an_infinite_error():
    errors = errors_of(scene_of("fisheye-10mm"))
    assert errors["thick_lens"].worst_px == np.inf
    assert errors["realistic"].worst_px == 0


@pytest.mark.parametrize("tier", TIERS)
def test_equivalent_has_the_camera_of_its_tier_and_nothing_else_new(tier):
    scene = scene_of("dgauss-50mm", f_number=4)
    other = equivalent(scene, tier)
    assert other.camera.kind == ("realistic" if tier == "fitted" else tier)
    assert getattr(other.camera, "rays", "traced") == ("fitted" if tier == "fitted" else "traced")
    assert other.objects == scene.objects
    assert other.film == scene.film


@pytest.mark.parametrize(
    ("accuracy", "tier"),
    [
        ({"max_error_px": 0}, "realistic"),
        ({"max_error_px": 1000, "max_illumination_error": 1000}, "pinhole"),
        ({"max_error_px": 1.2, "max_illumination_error": 0.1}, "thin_lens"),
        ({"max_error_px": 1.2, "max_illumination_error": 0.005}, "thick_lens"),
    ],
)
def test_cheapest_camera_within_the_bounds_is_taken(accuracy, tier):
    film = {"resolution": [320, 213]}
    found = choose_camera(scene_of("telephoto-250mm", accuracy=accuracy, film=film, focus=8.0, f_number=22))
    assert found.tier == tier
    assert found.scene.camera.kind == tier
    assert found.metadata["accuracy"]["camera_model"] == tier


def test_word_auto_stands_for_half_a_pixel_and_one_per_cent():
    scene = scene_of("dgauss-50mm", accuracy="auto")
    assert (scene.camera.accuracy.max_error_px, scene.camera.accuracy.max_illumination_error) == (0.5, 0.01)


def test_without_the_key_every_ray_is_traced():
    scene = scene_of("telephoto-250mm")
    assert choose_camera(scene).scene is scene


def test_lens_that_is_not_round_is_traced_and_says_why():
    found = choose_camera(scene_of("anamorphic-100mm", accuracy={"max_error_px": 1e6, "max_illumination_error": 1e6}))
    assert found.tier == "realistic"
    assert "not the same from every side" in found.metadata["accuracy"]["reason"]


@pytest.mark.parametrize(
    ("accuracy", "problem"),
    [
        ("fast", "accuracy"),
        ({"max_error_px": -1}, "max_error_px"),
        ({"max_error": 1}, "unknown key; did you mean max_error_px"),
    ],
)
def test_bad_accuracy_is_refused(accuracy, problem):
    with pytest.raises(InputError, match=problem):
        scene_of("dgauss-50mm", accuracy=accuracy)
