"""Each effect by itself: light, colour, the shape of the stop, and the outline of blurs."""

import numpy as np
import pytest

from rptcam_cl.optics.irradiance import film_irradiance
from rptcam_cl.optics.surface import StopMask, blades, heart, star
from rptcam_cl.studies.tier_models import FAR_MM, RayBundle, first_order_camera, round_stop
from rptcam_cl.studies.tiers import EFFECTS, FIELDS, Truth, choose_camera, measure_lens, tier_error
from tests.studies.tradeoff.tiers.cases import errors_of, half_film_mm, scene_of, stop_mm, truth_of

STAR = {"shape": "star", "points": 5}


@pytest.mark.parametrize("lens", ["dgauss-50mm", "wide-22mm"])
def test_light_of_the_probed_points_is_that_of_the_dense_quadrature(lens):
    scene = scene_of(lens)
    truth = truth_of(scene)
    setting, radii = truth.first.setting, float(np.hypot(*half_film_mm(scene))) * np.array(FIELDS)
    expected = film_irradiance(setting.lens, setting.film_distance_mm, radii)
    assert [field.light[0] for field in truth.fields] == pytest.approx(expected, rel=2e-3)


@pytest.mark.slow
def test_light_through_a_shaped_stop_is_that_of_the_dense_quadrature():
    scene = scene_of("telephoto-250mm", aperture=STAR)
    truth = truth_of(scene)
    radii = float(np.hypot(*half_film_mm(scene))) * np.array(FIELDS)
    angle = float(np.rad2deg(np.arctan2(*half_film_mm(scene)[::-1])))
    expected = film_irradiance(truth.shaped, truth.first.setting.film_distance_mm, radii, azimuth_degrees=angle)
    found = np.array([field.light[0] for field in truth.fields])
    assert found / found[0] == pytest.approx(expected / expected[0], abs=5e-3)


def test_colour_on_the_axis_is_that_of_the_powers_at_both_wavelengths():
    scene = scene_of("plano-convex-100mm", film={"resolution": [1000, 1000], "width_mm": 1}, f_number=40)
    truth = truth_of(scene)
    setting = truth.first.setting
    focal = {nm: setting.lens.first_order(nm).focal_length_mm for nm in (440.0, 587.5618, 640.0)}
    apart = max(abs(1 / focal[nm] - 1 / focal[587.5618]) for nm in (440.0, 640.0))
    expected = apart * truth.first.radius_mm * truth.first.film_mm_per_tangent * 1000  # of the rim's rays, 1 um pixels
    assert truth.colour_px((5000.0,))[0] == pytest.approx(expected, rel=0.03)


def test_colour_counts_where_the_scene_asks_for_it_and_the_lens_has_it():
    assert truth_of(scene_of("tessar-100mm")).coloured
    assert not truth_of(scene_of("tessar-100mm", spectrum="rgb")).coloured
    assert not truth_of(scene_of("dgauss-50mm")).coloured  # its glasses have one index


def test_round_stop_of_a_square_has_its_area_and_misses_its_corners():
    radius, apart = round_stop(blades(4))
    assert radius == pytest.approx(np.sqrt(2 / np.pi), rel=0.01)
    assert apart == pytest.approx(1 - np.sqrt(2 / np.pi), abs=0.03)


def test_round_stop_fills_the_middle_of_a_ring():
    side = np.linspace(-1, 1, 400)
    ring = StopMask(np.hypot(*np.meshgrid(side, side)) > 0.5)
    assert round_stop(ring)[1] == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("shape", [star(5), heart(), blades(6)])
def test_round_stop_has_the_area_of_the_shape(shape):
    assert np.pi * round_stop(shape)[0] ** 2 == pytest.approx(shape.area, rel=0.02)


def test_round_stop_stands_for_itself():
    assert round_stop(None)[1] == 0


def test_shape_of_the_stop_is_an_error_of_models_that_cannot_have_it():
    depths = (5000.0, 20_000.0)
    scene = scene_of("telephoto-250mm", aperture=STAR)
    errors = errors_of(scene, depths)
    expected = round_stop(star(5))[1] * np.array(truth_of(scene).blur_px(depths))
    assert errors["thick_lens"].effects["shape"] == pytest.approx(expected.tolist())
    assert max(errors["thin_lens"].effects["shape"]) == 0


def test_outline_of_a_vignetted_bundle_lies_inside_the_full_one():
    """Far from the axis a rim cuts the blur of a double Gauss: its width shrinks in one direction only."""
    scene = scene_of("dgauss-50mm", film={"resolution": [640, 360], "width_mm": 28})
    depths = (5000.0, 50_000.0)
    errors = errors_of(scene, depths)["thick_lens"].effects
    assert errors["outline"][-1] > 3 * errors["outline"][0] > 0
    field = truth_of(scene).fields[-1]
    _, (along, across, _), _ = field.bundle.spot(50_000.0, field.along)
    assert along < 0.8 * across


def test_half_a_disk_differs_from_a_whole_one_by_its_missing_half():
    turn = (np.arange(256) + 0.5) * 2 * np.pi / 256
    radii, ways = np.sqrt((np.arange(64) + 0.5) / 64), np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = (radii[:, None, None] * ways).reshape(-1, 2)
    still = np.column_stack([np.zeros_like(points), np.ones(len(points))])
    whole, half = (
        RayBundle(np.column_stack([part, np.zeros(len(part))]), still[: len(part)], np.ones(len(part)))
        for part in (points, points[points[:, 0] > 0])
    )
    spots = [bundle.spot(1.0, np.array([1.0, 0.0])) for bundle in (whole, half)]
    assert spots[1][0][0] == pytest.approx(4 / (3 * np.pi), rel=0.01)
    assert spots[0][1] == pytest.approx([0.5, 0.5, np.sqrt(0.5)], rel=0.01)
    assert spots[1][2][16] == pytest.approx(4 / (3 * np.pi), rel=0.01)  # to the left, from its own middle


def test_errors_name_every_effect_at_every_field():
    error = errors_of(scene_of("tessar-100mm", f_number=8))["thin_lens"]
    assert tuple(error.effects) == EFFECTS
    assert all(len(values) == len(FIELDS) for values in error.effects.values())
    assert error.worst_px == max(max(values) for values in error.effects.values())


def test_light_that_the_exposure_shows_counts_on_the_axis_too():
    """A thin lens loses nothing; behind irradiance as it is that shows, relative to the axis it does not."""
    keys = {"transmission": "bare", "stop_diameter_mm": stop_mm("tessar-100mm") / 4, "accuracy": "auto"}
    small = {"resolution": [64, 64], "width_mm": 2}
    found = {}
    for exposure in ("relative", "irradiance"):
        scene = scene_of("tessar-100mm", film=small, spectrum="rgb", exposure=exposure, **keys)
        found[exposure] = {error.tier: error.illumination[0] for error in choose_camera(scene).errors}
    assert "pinhole" not in found["irradiance"]  # which has no irradiance
    assert found["relative"]["thin_lens"] == pytest.approx(0, abs=1e-9)
    assert found["irradiance"]["thin_lens"] > 0.2
    assert found["irradiance"]["thick_lens"] < 0.01


def test_effects_that_are_largest_between_film_points_count():
    """Where the rims of this lens begin to cut its beams, blurs are a tenth farther off than at the film points."""
    film = {"resolution": [300, 200], "width_mm": 30}
    scene = scene_of("petzval-50mm", focus=2.0, film=film, accuracy={}, objects=[])
    decision = measure_lens(scene)
    thin = next(error for error in decision.errors if error.tier == "thin_lens")
    assert thin.between["outline"] > 1.05 * max(thin.effects["outline"])
    assert thin.worst_px == thin.between["outline"] > max(thin.pixels)
    depths = [1e3 * depth if depth is not None else FAR_MM for depth in decision.depths_m]
    dense = Truth.of(scene, first_order_camera(scene), tuple(np.linspace(0, 1, 65)))
    assert thin.worst_px == pytest.approx(tier_error(dense, depths, "thin_lens").worst_px, rel=0.03)
