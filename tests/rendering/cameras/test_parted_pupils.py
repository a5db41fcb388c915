"""Pupils of several parts: a ball behind a small window passes a ring of rays round its main pupil."""

from functools import cache
from itertools import product

import numpy as np
import pytest

from benchmarks.pupil_tables import aims, share_that_passes
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.optics.film_probe import FilmFrame, FilmProbe, spread_points
from rptcam_cl.optics.irradiance import film_irradiance, image_circle
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.optics.spots import setting
from rptcam_cl.rendering.cameras.pupil import left_out, pupil_sampling
from tests.device.probes import camera_rays
from tests.rendering.cameras.beams import back_distance
from tests.support.cases import fast, one_in, slow

OTHERS = [name for name in list_lenses() if name not in ("anamorphic-100mm", "ball", "dgauss-50mm", "fisheye-10mm")]
BALLS = [(1.5, 5.5), (1.5, 7.0), (1.458, 8.0), (1.8, 3.0)]  # index, film distance: all with a ring
TIERS = ["auto", "tight", "bounds", "thick", "rear"]
RADIUS, WINDOW = 5.0, 5.0


def ball(index):
    front = {"radius": RADIUS, "thickness": 2 * RADIUS, "glass": {"index": index}, "diameter": WINDOW}
    return {"name": "ball", "surfaces": [front, {"radius": -RADIUS, "diameter": 2 * RADIUS}]}


@cache
def light(lens, back, x, count=1500):
    """Irradiance of a film point (x, 0) by brute force over the whole outline of the ball, and its passing points.

    What lies below is the mirror image of what lies above.
    """
    probe, film = FilmProbe(lens, back, LINE_D_NM), np.array([x, 0.0])
    reach = 1.3 * back * np.tan(np.arcsin(RADIUS / (RADIUS + back))) + x
    side = np.linspace(-reach, reach, count)
    points = np.stack(np.meshgrid(side, side[side > 0]), axis=-1).reshape(-1, 2)
    points = points[probe.passes(film, points)]
    points = np.concatenate([points, points * [1, -1]])
    square = np.sum((points - film) ** 2, axis=1)
    return np.sum((back / (back**2 + square)) ** 2) * (side[1] - side[0]) ** 2, points


@pytest.mark.parametrize(("index", "back"), fast(BALLS[:1], BALLS))
def test_irradiance_counts_every_part_of_the_pupil(index, back):
    lens = load_lens(ball(index))
    for x in (0.0, 0.4):
        expected, _ = light(lens, back, x)
        # the grid's cells at the edges of pupil and ring are in or out: 1e-3 of the light
        assert float(film_irradiance(lens, back, x)) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("ball_of", "tier"), one_in(12, product(BALLS, TIERS)))
def test_no_ray_of_any_part_is_left_out(ball_of, tier):
    index, back = ball_of
    lens = load_lens(ball(index))
    sampling = pupil_sampling(lens, back, (0.7, 0.7), LINE_D_NM, tier)
    for x in (0.0, 0.3, 0.65):
        film = np.array([x, 0.0])
        _, points = light(lens, back, x, 500)
        assert len(points) > 1000
        assert not left_out(sampling, (0.7, 0.7), np.broadcast_to(film, points.shape), points).any()
    if tier == "tight" and (index, back) == BALLS[0]:
        assert sampling.tier == "rear"
        assert str(sampling.metadata["pupil_instead_of"]).startswith("tight: the pupil has parts")


def test_all_tiers_see_the_light_of_the_ring(session):
    index, back = BALLS[1]
    means = {}
    for tier in TIERS:
        camera = {"kind": "realistic", "lens": ball(index), "focus": {"film_distance_mm": back}, "pupil": tier}
        scene = {
            "film": {"resolution": [32, 32], "size_mm": [0.2, 0.2]},
            "camera": camera | {"eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]},
            "objects": [],
            "environment": {"kind": "constant", "radiance": 1},
        }
        means[tier] = camera_rays(session, scene, 64).weight.mean()
    expected = float(film_irradiance(load_lens(ball(index)), back, 0.0))
    for mean in means.values():
        assert mean == pytest.approx(means["rear"], rel=0.01)
    assert expected > 0.36


@pytest.mark.parametrize("name", ["ball", "dgauss-50mm", "fisheye-10mm", *map(slow, ("anamorphic-100mm", *OTHERS))])
def test_pupils_of_one_part_keep_their_tables(name):
    lens = load_lens(name)
    half = 0.2 * abs(lens.first_order().focal_length_mm)
    sampling = pupil_sampling(lens, back_distance(lens), (half, half), LINE_D_NM, "tight")
    assert sampling.tier == "tight"


def test_the_window_holds_the_bulge_of_a_ball():
    # rays that just touch the ball behind its rim: the tangents from the film point
    probe = FilmProbe(load_lens(ball(1.5)), 7.0, LINE_D_NM)
    tangent = 7.0 * np.tan(np.arcsin(RADIUS / (RADIUS + 7.0)))
    window = probe.windows(np.zeros((1, 2)))[0]
    assert tangent <= window[1] <= 1.001 * tangent


def test_spread_points_fill_their_box_evenly():
    points = spread_points(np.array([[-1.0, 3.0, 2.0, 4.0]]), 4096)[0]
    counts = np.histogram2d(*points.T, bins=(8, 8), range=[(-1, 3), (2, 4)])[0]
    assert counts.sum() == 4096
    assert counts.min() >= 58


@pytest.mark.parametrize("f_number", [4.53, slow(5.2)])
def test_slivers_between_nodes_are_traced_finer_and_not_given_up(f_number):
    eye = load_lens("human-eye")  # of an eye stopped down, rims cut slivers at 54 degrees
    eye = eye.with_stop_diameter(eye.stop_diameter_for(f_number))
    back = back_distance(eye)
    sampling = pupil_sampling(eye, back, (back, back), LINE_D_NM, "auto")
    assert sampling.tier == "tight"


@pytest.mark.slow
def test_small_pupils_close_behind_the_lens_are_found():
    phone = load_lens("phone-5.6mm")  # at f/22 all beyond 2.1 mm was black
    phone = phone.with_stop_diameter(phone.stop_diameter_for(22))
    back = back_distance(phone)
    grid = pupil_sampling(phone, back, (2.9, 2.1), LINE_D_NM, "tight").parameters
    assert float(film_irradiance(phone, back, 3.5)) == pytest.approx(8.4e-4, rel=0.05)  # of 4e6 rays over the window
    assert (grid.across - 1) / grid.per_mm_across > 3.5


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in list_lenses() if name != "ball"])  # whose pupil has two parts
def test_nine_of_ten_rays_of_every_pupil_pass(name):
    lens = load_lens(name)
    length, widest = abs(lens.first_order().focal_length_mm), abs(lens.first_order().f_number)
    stops = [None] if lens.stop_index is None else [None, 2 * widest, max(22.0, 4 * widest)]
    if name == "mirror-500mm":
        stops = [None, 8.0, 9.0, 10.0, 11.0, 12.0]  # dark from f/13 on
    for f_number in stops:
        for distance_m in (None, 0.01 * length + 0.004 * lens.length):
            if distance_m and name == "biconcave":
                continue
            used = setting(lens, f_number, distance_m)
            back = used.film_distance_mm or length
            radius = min(image_circle(used.lens, back), 0.43 * length, 21.6)
            sampling = pupil_sampling(used.lens, back, (radius, radius), LINE_D_NM, "tight")
            assert share_that_passes(used.lens, back, radius, sampling) >= 0.9, (f_number, distance_m)


@pytest.mark.slow
@pytest.mark.parametrize(("f_number", "half"), [(7.0, 37.7), (10.2, 15.3)])
def test_crescents_of_a_ring_are_held_with_their_hole(f_number, half):
    lens = load_lens("mirror-500mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number))
    back = back_distance(lens)
    sampling, probe = pupil_sampling(lens, back, (half, half), LINE_D_NM, "auto"), FilmProbe(lens, back, LINE_D_NM)
    assert sampling.ring
    film = np.stack([np.linspace(0.0, 0.9 * half, 12), np.zeros(12)], axis=1)
    points = spread_points(probe.windows(film), 4000).reshape(-1, 2)
    film = np.repeat(film, 4000, axis=0)
    passes, drawn = probe.passes(film, points), ~left_out(sampling, (half, half), film, points)
    assert (passes & ~drawn).sum() <= 2e-4 * passes.sum()  # corners of crescents between the directions of a table
    assert passes[drawn].mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("f_number", [7.0, 8.0, 9.0, 10.0, 11.0, 12.0])
def test_nine_of_ten_rays_of_rings_pass_on_the_whole_image_circle(f_number):
    lens = load_lens("mirror-500mm")  # two crescents towards its edge, which end at other rims
    lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number))
    back = back_distance(lens)
    radius = image_circle(lens, back)
    sampling = pupil_sampling(lens, back, (radius / np.sqrt(2), radius / np.sqrt(2)), LINE_D_NM, "tight")
    assert share_that_passes(lens, back, radius, sampling) >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize(("f_number", "swung"), [(10.5, 0.0), (10.5, 0.15)])
def test_rings_seen_from_a_tilted_film_are_held_closely(f_number, swung):
    lens = load_lens("mirror-500mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number))
    back, half, random = back_distance(lens), (18.0, 12.0), np.random.default_rng(3)
    c, s, q, t = np.cos(0.09), np.sin(0.09), np.cos(swung), np.sin(swung)
    frame = FilmFrame((0.0, 0.0), (c, 0.0, s), (-s * t, q, c * t))
    sampling = pupil_sampling(lens, back, half, LINE_D_NM, "tight", frame)
    probe, film = FilmProbe(lens, back, LINE_D_NM, frame), frame.points(random.uniform(-1, 1, (8000, 2)) * half)[:, :2]
    points, aimed = aims(sampling, film, half[0], random)
    assert probe.passes(film[aimed], points[aimed]).mean() > (0.9 if not swung else 0.85)  # 0.54 in frames of boxes
    window = np.array([-18.0, 18.0, -18.0, 18.0])[None]
    film, points = film.repeat(8, axis=0), spread_points(window, 64000)[0]
    passes = probe.passes(film, points)
    assert passes.sum() > 300 and not (passes & left_out(sampling, half, film, points)).any()


@pytest.mark.slow
@pytest.mark.parametrize("f_number", [12.0, 8.0])
def test_devices_receive_the_light_of_thin_rings_and_crescents(session, f_number):
    lens = load_lens("mirror-500mm")  # at f/12 the middle of the film was black
    back, columns, samples = back_distance(lens), 15, 1024
    stopped = lens.with_stop_diameter(lens.stop_diameter_for(f_number))
    radius = image_circle(stopped, back)
    camera = {"kind": "realistic", "lens": "mirror-500mm", "f_number": f_number, "focus": {"film_distance_mm": back}}
    scene = {
        "film": {"resolution": [columns, 1], "size_mm": [2 * radius, 0.1]},
        "camera": camera | {"eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]},
        "objects": [],
        "environment": {"kind": "constant", "radiance": 1},
    }
    rays = camera_rays(session, scene, samples)
    seen = np.bincount(rays.pixel[:, 0], rays.weight, columns) / samples
    assert (rays.weight > 0).mean() >= 0.9
    assert seen[columns // 2] > 0
    pixels = np.add.outer([3, 6], np.linspace(-0.45, 0.45, 10))  # 0.4 and 0.8 of the image circle
    light = film_irradiance(stopped, back, np.ravel(pixels * 2 * radius / columns)).reshape(2, 10).mean(axis=1)
    # 1 % of noise, and as much of the reference, whose azimuths cut thin crescents coarsely
    assert (seen[10] + seen[4]) / (seen[13] + seen[1]) == pytest.approx(light[0] / light[1], rel=0.03)
