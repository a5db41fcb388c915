"""The rays that each camera makes, one by one, against projection by hand and against lenses traced in float64."""

import math
from typing import get_args

import numpy as np
import pytest

from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.camera import RealisticCamera
from rptcam_cl.scene.load import load_scene
from tests.device.probes import camera_rays, camera_slots
from tests.support.cases import slow
from tests.support.statistics import ALPHA, Z, chi_squared, moment_scores

POSE = {"eye": [1, 2, 3], "target": [4, 0, 1], "up": [0, 0, 1]}
SLACK = 2e-4  # of a pixel: float32 directions


def scene(kind, resolution=(24, 16), film=None, **camera):
    return {
        "film": {"resolution": list(resolution), **(film or {})},
        "camera": {"kind": kind, **POSE, **camera},
        "objects": [],
        "environment": {"kind": "constant", "radiance": 1},
    }


def assert_within_pixels(x, y, rays, slack=SLACK):
    """Fail unless film coordinates [pixels, row 0 on top] lie within the pixels of the rays and fill them."""
    u, v = x - rays.pixel[:, 0], y - rays.pixel[:, 1]
    for inside in (u, v):
        assert inside.min() > -slack
        assert inside.max() < 1 + slack
        # jitter is uniform: a box filter
        assert np.abs(moment_scores(np.stack([inside, inside**2], 1), [1 / 2, 1 / 3])).max() < Z


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("axis", ["horizontal", "vertical", "diagonal"])
def test_pinhole_is_a_perspective_projection(session, axis, lanes):
    rays = camera_rays(session, scene("pinhole", fov_degrees=70, fov_axis=axis), 64, lanes)
    side = {"horizontal": 24, "vertical": 16, "diagonal": math.hypot(24, 16)}[axis]
    pixels_per_tangent = side / 2 / math.tan(math.radians(35))
    x = 12 + rays.direction[:, 0] / -rays.direction[:, 2] * pixels_per_tangent
    y = 8 - rays.direction[:, 1] / -rays.direction[:, 2] * pixels_per_tangent
    assert_within_pixels(x, y, rays)
    np.testing.assert_allclose(np.linalg.norm(rays.direction, axis=1), 1, atol=3e-7)
    assert (rays.origin == 0).all()
    assert (rays.weight == 1).all()


def test_near_plane_moves_the_start_of_a_pinhole_ray(session):
    rays = camera_rays(session, scene("pinhole", fov_degrees=70, near_m=0.5), 4)
    np.testing.assert_allclose(rays.origin[:, 2], -0.5, rtol=1e-6)
    np.testing.assert_allclose(np.cross(rays.origin, rays.direction), 0, atol=1e-6)


@pytest.mark.parametrize("kind", ["pinhole", "thin_lens", "environment"])
def test_unflipped_picture_is_turned_by_half_a_turn(session, kind):
    options = {
        "pinhole": {"fov_degrees": 60},
        "thin_lens": {"fov_degrees": 60, "aperture_radius_m": 0, "focus_distance_m": 2},
        "environment": {"resolution": (32, 16)},
    }[kind]
    upright = camera_rays(session, scene(kind, **options), 2)
    inverted = camera_rays(session, scene(kind, flip=False, **options), 2)
    # the same jitter in the same pixel, with the other sign on the film
    np.testing.assert_allclose(inverted.direction[:, :2], -upright.direction[:, :2], atol=1e-6)
    np.testing.assert_allclose(inverted.direction[:, 2], upright.direction[:, 2], atol=1e-6)


@pytest.mark.parametrize("lanes", [1, 8])
def test_environment_camera_maps_longitude_and_latitude(session, lanes):
    rays = camera_rays(session, scene("environment", resolution=(32, 16)), 64, lanes)
    right, up, forward = rays.direction[:, 0], rays.direction[:, 1], -rays.direction[:, 2]
    x = 16 + np.arctan2(right, forward) / (2 * np.pi) * 32
    y = 8 - np.arcsin(np.clip(up, -1, 1)) / np.pi * 16
    # arcsin near the poles loses half the digits: sqrt(6e-8) of a radian is 0.001 pixel
    assert_within_pixels(x, y, rays, slack=3e-3)


def thin(**options):
    """A 50 mm f/2 lens focused at 2 m, over so small a film that its centre is all there is."""
    film = {"size_mm": [1e-4, 1e-4]}
    defaults = {"focal_length_mm": 50, "f_number": 2, "focus_distance_m": 2.0}
    return scene("thin_lens", (16, 16), film, **defaults | options)


def at_depth(rays, depth):
    """Where the rays meet the plane at a distance along the axis, x and y [m]."""
    t = (-depth - rays.origin[:, 2]) / rays.direction[:, 2]
    return (rays.origin + t[:, None] * rays.direction)[:, :2]


def test_rays_of_a_thin_lens_meet_in_the_plane_of_focus(session):
    options = {"fov_degrees": 50, "aperture_radius_m": 0.4, "focus_distance_m": 3.0}
    rays = camera_rays(session, scene("thin_lens", **options), 64)
    x, y = at_depth(rays, 3.0).T * 12 / (3 * math.tan(math.radians(25)))
    assert_within_pixels(12 + x, 8 - y, rays)


def test_circle_of_confusion_has_its_closed_form(session):
    # 12.5 mm in an object plane at 3 m; on the sensor 0.2136752 mm, through the magnification of that plane
    rays = camera_rays(session, thin(), 512)
    spread = np.linalg.norm(at_depth(rays, 3.0), axis=1)
    aperture, focus, far = 0.025, 2.0, 3.0
    radius = aperture / 2 * (far - focus) / focus
    assert radius == pytest.approx(0.0125 / 2)
    sensor = 2 * radius * (1 / (1 / 0.05 - 1 / focus)) / far
    assert sensor * 1e3 == pytest.approx(0.2136752, abs=1e-7)
    # the film is 1e-4 mm wide, which the plane at 3 m sees as 6e-6 m
    assert 0.999 * radius < spread.max() < radius + 1e-5
    scores = moment_scores((spread[:, None] / radius) ** [2, 4], [1 / 2, 1 / 3])
    assert np.abs(scores).max() < Z + 2  # the film's width adds 4e-7 to the mean of r^2


def test_round_aperture_is_filled_evenly(session):
    rays = camera_rays(session, thin(), 512)
    x, y = rays.origin[:, :2].T / 0.0125
    assert np.hypot(x, y).max() <= 1 + 1e-6
    turn = np.arctan2(y, x) / (2 * np.pi) % 1
    cells = np.histogram2d(x**2 + y**2, turn, bins=16, range=[[0, 1.000001], [0, 1]])[0]
    assert chi_squared(cells, np.full(256, len(x) / 256)) > ALPHA
    expected = [0, 0, 1 / 4, 1 / 4, 0, 1 / 3]
    moments = np.stack([x, y, x**2, y**2, x * y, (x**2 + y**2) ** 2], 1)
    assert np.abs(moment_scores(moments, expected)).max() < Z


@pytest.mark.parametrize(("blades", "degrees"), [(3, 0), slow(5, 0), slow(6, 20), (8, -11)])
def test_polygon_aperture_is_filled_evenly_to_its_edges(session, blades, degrees):
    aperture = {"shape": "polygon", "blades": blades, "rotation_degrees": degrees}
    rays = camera_rays(session, thin(aperture=aperture), 512)
    x, y = rays.origin[:, :2].T / 0.0125
    first = math.radians(degrees)
    inner = math.cos(math.pi / blades)
    middles = first + (np.arange(blades) + 0.5) * 2 * np.pi / blades
    heights = np.outer(x, np.cos(middles)) + np.outer(y, np.sin(middles))
    height = heights.max(axis=1) / inner
    assert height.max() <= 1 + 1e-6
    assert height.max() > 0.999
    # blade by blade, height squared and the way along the blade are uniform
    blade = heights.argmax(axis=1)
    sideways = (y * np.cos(middles[blade]) - x * np.sin(middles[blade])) / (height * math.sin(math.pi / blades))
    cells = np.histogramdd((blade, height**2, sideways), (blades, 8, 8), [(0, blades), (0, 1.00001), (-1.0001, 1.0001)])
    assert chi_squared(cells[0], np.full(blades * 64, len(x) / blades / 64)) > ALPHA
    corner = (2 + math.cos(2 * math.pi / blades)) / 6  # mean of r^2 over a regular polygon of unit circumradius
    assert np.abs(moment_scores(np.stack([x, y, x**2 + y**2], 1), [0, 0, corner])).max() < Z


LENSES = ["dgauss-50mm", "wide-22mm", "telephoto-250mm", "fisheye-10mm", "ball", "biconvex-stop"]


def through(lens, resolution=(24, 16), **options):
    distance = {"ball": 0.5}.get(lens, 20.0)
    return scene("realistic", resolution, None, lens=lens, focus={"distance_m": distance}, **options)


@pytest.mark.parametrize("flip", [True, slow(False)])
@pytest.mark.parametrize("lens", LENSES)
def test_rays_through_a_lens_come_from_their_pixel_when_traced_back(session, lens, flip):
    loaded = load_scene(through(lens, flip=flip))
    setting = lens_setting(loaded)
    glass, back = setting.lens, setting.film_distance_mm
    rays = camera_rays(session, loaded, 64, lanes=16)
    lit = rays.weight > 0
    assert lit.sum() > 1000
    # the camera's frame is the lens's, turned by half a turn about x: there +z points at the film
    start = rays.origin[lit] * [1e3, -1e3, 1e3] + [0, 0, back + glass.length]
    heading = -rays.direction[lit] * [1, -1, 1]
    traced = glass.trace(start, heading, start="scene")
    # a ray within 1e-5 of a rim may pass here and fail there
    assert (traced.status == 0).mean() > 0.9999
    ok = traced.status == 0
    step = (glass.length + back - traced.origins[ok, 2]) / traced.directions[ok, 2]
    film = (traced.origins[ok] + step[:, None] * traced.directions[ok])[:, :2]
    width, height = (side * 1e3 for side in loaded.film.size_m())
    sign = -1 if flip else 1
    x = 12 + sign * film[:, 0] / width * 24
    y = 8 - sign * -film[:, 1] / height * 16
    inside_x, inside_y = x - rays.pixel[lit][ok, 0], y - rays.pixel[lit][ok, 1]
    # float32 through a lens is good to 6e-5 mm and 3e-6 rad, times the lever of the way back: a pixel is 1.5 mm
    for inside in (inside_x, inside_y):
        assert inside.min() > -0.01
        assert inside.max() < 1.01


def test_outcomes_of_the_lens_have_the_shares_of_rays_traced_in_float64(session):
    loaded = load_scene(through("dgauss-50mm", (48, 32), pupil="rear"))
    setting = lens_setting(loaded)
    lens, back = setting.lens, setting.film_distance_mm
    rays = camera_rays(session, loaded, 64, lanes=16)
    shares = np.bincount(rays.status, minlength=4) / len(rays.status)
    rng = np.random.default_rng(3)
    count = 200_000
    film = (rng.random((count, 2)) - 0.5) * [36, 24]
    rear = lens.surfaces[-1]
    turn, radius = 2 * np.pi * rng.random(count), rear.semi_diameter * np.sqrt(rng.random(count))
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn)], 1)
    start = np.column_stack([film, np.full(count, lens.length + back)])
    target = np.column_stack([rim, np.full(count, lens.length + rear.rim_sag())])
    status = lens.trace(start, target - start).status
    expected = np.bincount(status, minlength=4) / count
    error = np.sqrt(expected * (1 - expected) * (1 / count + 1 / len(rays.status)))
    # the circle that the device aims at is widened by what it shifts within a step of the table: 1.2e-3 of its area
    assert (np.abs(shares - expected) < 0.001 + Z * error).all()


@pytest.mark.parametrize("f_number", [2.8, slow(8)])
def test_a_pupil_of_less_than_a_square_millimetre_clips_no_more(session, f_number):
    film = {"size_mm": [0.4, 0.3]}
    lens = {"lens": "asphere-1.4mm", "focus": {"distance_m": 20.0}, "f_number": f_number}
    rays = camera_rays(session, scene("realistic", film=film, **lens), 64)
    assert ((rays.status == 0) == (rays.weight > 0)).all()
    assert (rays.status == 0).mean() > 0.8


PUPILS = [tier for tier in get_args(RealisticCamera.model_fields["pupil"].annotation) if tier != "auto"]


@pytest.mark.parametrize("pupil", PUPILS)
@pytest.mark.parametrize("resolution", [(1, 1), slow((5, 3)), slow((33, 17))])
def test_no_lane_reads_beyond_the_pupil_table(session, resolution, pupil):
    # not even those of padding, whose film points lie many films away
    scene = load_scene(through("dgauss-50mm", resolution, pupil=pupil))
    first, second = (camera_slots(session, scene, 2, lanes=16, beyond=value) for value in (np.nan, 1.0))
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, second)
