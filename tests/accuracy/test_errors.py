"""Errors of cheaper camera models against the traced lens, and the choice among them."""

from __future__ import annotations

import numpy as np
import pytest

from rptcam_cl.accuracy import TIERS, decided, equivalent, tier_errors

from rptcam_cl.accuracy.depths import FAR_MM, depth_range_mm
from rptcam_cl.accuracy.tiers import first_order_camera
from rptcam_cl.errors import InputError
from rptcam_cl.scene import load_scene

LENSES = ("dgauss-50mm", "telephoto-250mm", "wide-22mm", "tessar-100mm", "cooke-triplet-50mm", "heliar-105mm")
BALL = {"shape": "sphere", "center": [0, 0, -5], "radius": 0.5, "material": {"kind": "matte", "reflectance": 0.5}}


def scene_of(lens, *, accuracy=None, focus=5.0, film=None, **camera):
    keys = {"kind": "realistic", "lens": lens, "eye": [0, 0, 0], "target": [0, 0, -1], "focus": {"distance_m": focus}}
    keys |= camera | ({} if accuracy is None else {"accuracy": accuracy})
    return load_scene({"film": film or {"resolution": [640, 360]}, "camera": keys, "objects": [BALL]})


def errors_of(scene, depths=(4000.0, 6000.0)):
    first = first_order_camera(scene)
    return {error.tier: error for error in tier_errors(first, scene.film, depths, TIERS)}


@pytest.mark.parametrize("lens", LENSES)
def test_tiers_agree_with_the_traced_lens_to_first_order(lens):
    """On a film of 1 mm behind a twentieth of the aperture, what is left is of third order."""
    diameter = first_order_camera(scene_of(lens)).setting.lens.stop.semi_diameter * 2
    scene = scene_of(lens, film={"resolution": [1000, 1000], "width_mm": 1}, stop_diameter_mm=diameter / 20)
    errors = errors_of(scene)
    for tier in ("thin_lens", "thick_lens"):
        assert errors[tier].worst_px < 0.1, tier
        assert errors[tier].worst_illumination < 2e-3, tier  # of a flat film: cos^4


def test_pinhole_errs_by_the_blur_of_the_aperture():
    scene = scene_of("dgauss-50mm", film={"resolution": [1000, 1000], "width_mm": 1}, f_number=22)
    first = first_order_camera(scene)
    far = 10_000.0
    spread = first.radius_mm / np.sqrt(2) * abs((far - first.pupil_mm) / first.plane_mm - 1)  # rms of an even disk
    expected = spread / (far - first.pupil_mm) * first.film_mm_per_tangent * 1000
    assert errors_of(scene, (far,))["pinhole"].worst_px == pytest.approx(expected, rel=0.02)


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
    assert other.camera.kind == tier
    assert other.objects == scene.objects
    assert other.film == scene.film


@pytest.mark.parametrize(
    ("accuracy", "tier"),
    [
        ({"max_error_px": 0}, "realistic"),
        ({"max_error_px": 1000, "max_illumination_error": 1000}, "pinhole"),
        ({"max_error_px": 0.9, "max_illumination_error": 0.1}, "thin_lens"),
        ({"max_error_px": 0.9, "max_illumination_error": 0.005}, "thick_lens"),
    ],
)
def test_cheapest_camera_within_the_bounds_is_taken(accuracy, tier):
    film = {"resolution": [320, 213]}
    found = decided(scene_of("telephoto-250mm", accuracy=accuracy, film=film, focus=8.0, f_number=22))
    assert found.tier == tier
    assert found.scene.camera.kind == tier
    assert found.metadata["accuracy"]["camera_model"] == tier


def test_word_auto_stands_for_half_a_pixel_and_one_per_cent():
    scene = scene_of("dgauss-50mm", accuracy="auto")
    assert (scene.camera.accuracy.max_error_px, scene.camera.accuracy.max_illumination_error) == (0.5, 0.01)


def test_without_the_key_every_ray_is_traced():
    scene = scene_of("telephoto-250mm")
    assert decided(scene).scene is scene


def test_lens_that_is_not_round_is_traced_and_says_why():
    found = decided(scene_of("anamorphic-100mm", accuracy={"max_error_px": 1e6, "max_illumination_error": 1e6}))
    assert found.tier == "realistic"
    assert "not the same from every side" in found.metadata["accuracy"]["reason"]


def random_case(rng):
    """A lens in use, and a tolerance."""
    lens = str(rng.choice([*LENSES, "fisheye-10mm", "retrofocus-28mm", "phone-5.6mm"]))
    width = {"fisheye-10mm": 14.0, "phone-5.6mm": 4.0}.get(lens, float(rng.uniform(4, 36)))
    film = {"resolution": [int(rng.integers(64, 800))] * 2, "width_mm": width}
    accuracy = {
        "max_error_px": float(10 ** rng.uniform(-0.3, 1.5)),
        "max_illumination_error": float(10 ** rng.uniform(-1, 1)),
    }
    stop = first_order_camera(scene_of(lens)).setting.lens.stop.semi_diameter * 2 * float(rng.uniform(0.05, 1))
    return scene_of(lens, accuracy=accuracy, film=film, focus=float(rng.uniform(4, 40)), stop_diameter_mm=stop)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_choice_never_errs_by_more_than_it_may(seed):
    """Between the probed film points and depths, by bundles of rays through every surface."""
    scene = random_case(np.random.default_rng(seed))
    found = decided(scene)
    if found.tier == "realistic":
        return
    first, allowed = first_order_camera(scene), scene.camera.accuracy
    half = np.array(scene.film.size_m()) / 2 * 1e3
    setting = first.setting
    for field in np.linspace(0.05, 1, 9):
        truth = traced_bundle(setting.lens, setting.film_distance_mm, field * half, setting.camera.wavelength_nm)
        near = traced_bundle(
            setting.lens, setting.film_distance_mm, (field - 1e-3) * half, setting.camera.wavelength_nm
        )
        other = first_order_bundle(first, found.tier, field * half)
        for depth in np.linspace(4500, 5500, 3):
            (place, radius), (own, own_radius) = truth.spot(depth), other.spot(depth)
            pixel = (
                np.hypot(*(near.spot(depth)[0] - place))
                / (1e-3 * np.hypot(*half))
                * half[0]
                * 2
                / scene.film.resolution[0]
            )
            assert np.hypot(*(own - place)) / pixel <= 1.02 * allowed.max_error_px
            assert abs(own_radius - radius) / pixel <= 1.02 * allowed.max_error_px


def test_depths_are_those_of_the_boxes_ahead():
    scene = scene_of("dgauss-50mm")
    assert depth_range_mm(scene, (0.3, 0.2)) == pytest.approx((4500, 5500))


def test_depths_reach_far_under_a_sky_and_over_a_plane():
    plane = {"shape": "plane", "point": [0, -1, 0], "normal": [0, 1, 0], "material": BALL["material"]}
    base = scene_of("dgauss-50mm")
    camera = {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 30}
    over = load_scene({"camera": camera, "objects": [BALL, plane]})
    assert depth_range_mm(over, (0.3, 0.2)) == pytest.approx((4500, FAR_MM))
    assert depth_range_mm(over, (0.3, 0.25)) == pytest.approx((4000, FAR_MM))
    under = load_scene({"camera": camera, "objects": [BALL], "environment": {"kind": "constant", "radiance": 1}})
    assert depth_range_mm(under, (0.3, 0.2)) == pytest.approx((4500, FAR_MM))
    assert base.objects


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
