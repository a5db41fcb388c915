"""What `camera.accuracy` decides: the camera model, whether colours are traced, and what it says of both."""

import json
from itertools import product

import numpy as np
import pytest

from rptcam_cl.optics.surface import star
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.setting import lens_to_focus
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.studies.tiers import choose_camera, measure_lens
from tests.studies.tradeoff.tiers.cases import BALL, scene_of
from tests.support.cases import one_in, slow

STAR = {"shape": "star", "points": 5}
NEAR = BALL | {"center": [0, 0, -4]}
SMALL = {"resolution": [160, 120], "width_mm": 6}


def said(found):
    return "\n".join(found.metadata["accuracy"]["says"])


def coloured(bound_px, *, spectrum="auto"):
    """A lens that disperses: a fifth of a pixel on this film, and its other errors are less than a tenth."""
    accuracy = {"max_error_px": bound_px, "max_illumination_error": 0.1}
    film = {"resolution": [300, 300], "width_mm": 3}
    return choose_camera(scene_of("tessar-100mm", accuracy=accuracy, film=film, f_number=16, spectrum=spectrum))


def test_colour_beyond_the_bound_keeps_the_traced_lens_that_disperses():
    found = coloured(0.3)
    colour_px = found.metadata["accuracy"]["lens_colour_px"]
    assert colour_px > 0.3
    assert found.tier == "realistic"
    assert found.scene.spectrum.lens == "on"
    assert camera_model(found.scene, found.scene.spectrum.lens_colour).facts["LENS_DISPERSION"] > 0
    assert "not thin_lens: colour" in said(found)
    assert "the lens refracts each wavelength separately" in said(found)


def test_colour_within_the_bound_leaves_the_cheaper_model():
    found = coloured(2.0)
    assert found.tier != "realistic"
    assert "one wavelength stands for all" in said(found)


@pytest.mark.slow
def test_bound_of_the_colour_is_that_of_the_scene_and_not_half_a_pixel():
    """Distortion keeps the traced lens; whether it disperses goes by the bound."""
    film = {"resolution": [300, 200], "width_mm": 36}
    by_bound = {}
    for bound_px in (0.02, 0.3):
        accuracy = {"max_error_px": bound_px, "max_illumination_error": 1e-4}
        found = choose_camera(scene_of("tessar-100mm", accuracy=accuracy, film=film, f_number=11))
        assert found.tier == "realistic"
        by_bound[bound_px] = found.scene.spectrum.lens
    assert by_bound == {0.02: "on", 0.3: "off"}


@pytest.mark.parametrize("spectrum", ["rgb", slow({"mode": "auto", "lens": "off"})])
def test_colour_that_the_scene_leaves_out_decides_nothing(spectrum):
    found = coloured(0.3, spectrum=spectrum)
    assert found.tier != "realistic"
    assert "lens_colour_px" not in found.metadata["accuracy"]


def test_colour_that_the_scene_asks_for_stays_with_the_traced_lens():
    found = coloured(0.0, spectrum="dispersive")
    assert found.tier == "realistic"
    assert found.scene.spectrum.lens_colour == "on"


@pytest.mark.parametrize("near_m", [0.075, *map(slow, (0.09, 0.11, 4.0))])
def test_errors_are_measured_from_the_nearest_object_on_even_close_before_the_lens(near_m):
    """The first surface is 68.7 mm from the film."""
    close = BALL | {"center": [0, 0, -near_m - 0.002], "radius": 0.002}
    found = measure_lens(scene_of("dgauss-50mm", objects=[close, BALL]))
    assert found.depths_m == pytest.approx((near_m, 5.5))
    around = BALL | {"center": [0, 0, 0], "radius": 9}
    near, far = measure_lens(scene_of("dgauss-50mm", objects=[around])).depths_m
    assert 0.0687 < near < 0.07 and far == pytest.approx(9.0)


def test_aperture_whose_blur_is_below_the_bound_is_a_pinhole():
    accuracy = {"max_error_px": 0.5, "max_illumination_error": 0.02}
    found = choose_camera(scene_of("telephoto-250mm", accuracy=accuracy, film=SMALL, f_number=64, objects=[BALL]))
    assert found.tier == "pinhole"
    assert "the aperture does not show" in said(found)
    wide = choose_camera(scene_of("telephoto-250mm", accuracy=accuracy, film=SMALL, f_number=32, objects=[NEAR, BALL]))
    assert wide.tier == "thin_lens"
    assert "the aperture shows" in said(wide)


def starry(bound_px, **keys):
    film = {"resolution": [400, 400], "width_mm": 4}
    accuracy = {"max_error_px": bound_px, "max_illumination_error": 0.05}
    scene = {"accuracy": accuracy, "film": film, "aperture": STAR, "objects": [NEAR, BALL], "f_number": 16}
    return choose_camera(scene_of("telephoto-250mm", **(scene | keys)))


def test_shape_that_shows_goes_with_a_thin_lens():
    found = starry(4.0)
    assert found.metadata["accuracy"]["stop_shape_px"] > 4
    assert found.tier == "thin_lens"
    assert found.scene.camera.aperture.shape == "star"
    assert "its shape shows" in said(found)
    assert "its shape does not show" in said(starry(12.0))


@pytest.mark.slow
def test_shape_that_shows_keeps_the_traced_lens_where_no_thin_lens_has_it():
    """With the film nearer than any image no plane is in focus, so that a thin lens cannot stand in."""
    blurred = {"focus": {"film_distance_mm": 90}}
    scene_px = starry(0.0, **blurred).metadata["accuracy"]["stop_shape_px"]
    shows, does_not = (starry(share * scene_px, **blurred) for share in (0.95, 1.05))
    assert shows.tier == "realistic"
    assert "not thick_lens: round stop" in said(shows)
    assert does_not.tier == "thick_lens"
    whole_mm = 2 * lens_to_focus(shows.scene, shows.scene.camera).stop.semi_diameter
    open_share = (does_not.scene.camera.stop_diameter_mm / whole_mm) ** 2
    assert open_share == pytest.approx(star(5).area / np.pi, rel=0.02)


def test_lens_that_a_thin_lens_stands_for_costs_no_surfaces():
    accuracy = {"max_error_px": 1, "max_illumination_error": 0.05}
    film = {"resolution": [320, 240], "width_mm": 6}
    found = choose_camera(scene_of("dgauss-50mm", accuracy=accuracy, film=film, f_number=4, objects=[NEAR, BALL]))
    assert found.tier == "thin_lens"
    model = camera_model(found.scene)
    assert not model.has_lens
    assert len(model.surfaces) == 1  # the empty one


@pytest.mark.parametrize(("film_mm", "width"), one_in(8, product((6, 12, 24), (64, 160, 640))))
def test_fisheye_is_never_a_pinhole(width, film_mm):
    film = {"resolution": [width, width], "width_mm": film_mm}
    found = choose_camera(scene_of("fisheye-10mm", accuracy="auto", film=film, focus=50.0, f_number=22))
    assert found.tier == "realistic"


def test_dark_corners_are_named():
    found = choose_camera(scene_of("fisheye-10mm", accuracy="auto"))
    assert "part of the film sees nothing" in said(found)
    json.dumps(found.metadata, allow_nan=False)


def test_lens_without_an_equivalent_still_decides_its_colour():
    accuracy = {"max_error_px": 1e-6}
    found = choose_camera(scene_of("anamorphic-100mm", accuracy=accuracy, focus=50.0))
    assert "no cheaper camera model" in said(found)
    assert found.scene.spectrum.lens in ("on", "off")


def test_polynomials_stand_for_many_surfaces_where_enough_rays_cross_them():
    film = {"resolution": [1280, 853]}
    many, few = (
        choose_camera(change_scene(scene_of("retrofocus-28mm", accuracy="auto", film=film), render={"spp": spp}))
        for spp in (128, 16)
    )
    assert few.tier == "realistic" and few.scene.camera.rays == "traced"
    assert many.tier == "fitted" and many.scene.camera.rays == "fitted"
    error = many.errors[-1]
    assert error.tier == "fitted" and 0 < error.worst_px <= 0.25 and error.worst_illumination <= 2e-3
    assert said(many).startswith("fitted: distortion")
    assert camera_model(many.scene).kernel == "camera/fitted.h"


@pytest.mark.slow
def test_lens_without_polynomials_keeps_its_surfaces():
    film = {"resolution": [1280, 853], "width_mm": 4}
    found = choose_camera(change_scene(scene_of("phone-5.6mm", accuracy="auto", film=film), render={"spp": 1024}))
    assert found.tier == "realistic"


def test_moving_camera_keeps_its_traced_lens_and_says_why():
    accuracy = {"max_error_px": 1000, "max_illumination_error": 1000}
    way = [{"time_s": 0, "eye": [0, 0, 0]}, {"time_s": 1, "eye": [0.1, 0, 0]}]
    found = choose_camera(scene_of("telephoto-250mm", accuracy=accuracy, film=SMALL, motion=way))
    assert found.tier == "realistic"
    assert "no cheaper camera model: camera.motion" in said(found)


def test_polynomials_that_the_scene_asks_for_are_told_as_such():
    found = choose_camera(scene_of("wide-22mm", accuracy="auto", film=SMALL, rays="fitted"))
    assert found.tier == "fitted"
    assert said(found).startswith("fitted: distortion")
