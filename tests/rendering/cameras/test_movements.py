"""Films that are moved and turned: rays and light against float64, and the closed forms of view cameras."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.film_probe import UNMOVED, FilmProbe, grid
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import Status
from rptcam_cl.rendering.cameras.kinds import camera_model, camera_of
from rptcam_cl.rendering.cameras.setting import film_frame, half_film_mm, lens_setting
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from tests.device.probes import camera_rays
from tests.support.statistics import Z

SIZE = (18, 12)
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]}
CASES = {
    "tilted": ("dgauss-50mm", 36.0, {"tilt_degrees": 8}),
    "swung and shifted": ("wide-22mm", 15.0, {"swing_degrees": 5, "shift_mm": 6}),
    "risen": ("dgauss-50mm", 36.0, {"rise_mm": 9, "shift_mm": -4}),
    "not round": ("anamorphic-100mm", 80.0, {"tilt_degrees": 5, "swing_degrees": 3, "rise_mm": 4}),
}

# The table of a pupil without symmetry takes seconds.
EACH_CASE = [pytest.param(name, marks=pytest.mark.slow if name != "swung and shifted" else ()) for name in CASES]


def scene_of(kind="realistic", movements=None, size_mm=(36, 24), **camera):
    return load_scene(
        {
            "film": {"resolution": list(SIZE), "size_mm": list(size_mm)},
            "camera": {"kind": kind, **POSE, "movements": movements or {}, **camera},
            "objects": [],
            "environment": {"kind": "constant", "radiance": 1},
        }
    )


def scene_with(name, **camera):
    lens, back, movements = CASES[name]
    return scene_of(movements=movements, lens=lens, focus={"film_distance_mm": back}, **camera)


def film_of(scene, rays, points):
    """Return where points (n, 2) of the film [mm], right and up as the lens draws them, lie in the pixels of rays."""
    half = np.array(half_film_mm(scene))
    places = (1 - points / half * [1, -1]) / 2 * SIZE  # the picture is turned over
    return places - rays.pixel


def landed(lens, film_distance_mm, frame, rays):
    """Return where rays, sent back from the scene in float64, meet a film, on the film [mm]."""
    origins = rays.origin * 1e3 + [0, 0, lens.film_z(film_distance_mm)]
    traced = lens.trace(origins, -rays.direction, start="scene")
    normal = np.array(frame.normal)
    away = traced.origins - [*frame.centre, lens.film_z(film_distance_mm)]
    points = traced.origins - ((away @ normal) / (traced.directions @ normal))[:, None] * traced.directions
    centre = np.array([*frame.centre, lens.film_z(film_distance_mm)])
    return (points - centre) @ np.array([frame.across, frame.up]).T, traced.passed


@pytest.mark.parametrize("name", EACH_CASE)
def test_rays_come_from_their_pixels_of_the_film(session, name):
    scene = scene_with(name)
    lens, back, _ = CASES[name]
    rays = camera_rays(session, scene, 8)
    good = rays.status == Status.ok
    points, passed = landed(load_lens(lens), back, film_frame(scene.camera), rays)
    inside = film_of(scene, rays, points)[good]
    assert passed[good].mean() > 0.999  # a few graze a rim
    inside = inside[passed[good]]
    assert inside.min() > -2e-3 and inside.max() < 1 + 2e-3  # float32 rays, in pixels of 2 mm


@pytest.mark.parametrize("name", EACH_CASE)
def test_nine_of_ten_rays_of_a_moved_film_pass(session, name):
    rays = camera_rays(session, scene_with(name), 32)
    assert (rays.status == Status.ok).mean() >= 0.90


@pytest.mark.parametrize("name", EACH_CASE)
def test_the_film_is_lit_as_by_quadrature(session, name):
    """E is the integral of cos(film) cos(lens) / length^2 over the pupil, at middles of pixels all over the film."""
    scene = scene_with(name)
    lens, back, _ = CASES[name]
    frame = film_frame(scene.camera)
    rays = camera_rays(session, scene, 64)
    probe = FilmProbe(load_lens(lens), back, 587.5618, frame)
    sums, counts, expected = 0.0, 0, 0.0
    for column, row in ((2, 2), (9, 6), (15, 3), (5, 10)):
        steps = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2)
        places = (np.array([column, row]) + (steps + 0.5) / 4) / SIZE
        film = frame.points((1 - 2 * places) * [1, -1] * half_film_mm(scene))
        boxes = probe.windows(film[:, :2])
        aims = grid(boxes, 150, 150)
        away = np.concatenate([aims - film[:, None, :2], np.full((*aims.shape[:2], 1), -back)], axis=-1)
        away[..., 2] -= film[:, None, 2]
        facing = -away @ np.array(frame.normal)
        density = facing * -away[..., 2] / np.sum(away * away, axis=-1) ** 2 * probe.passes(film[:, None, :2], aims)
        area = (boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])
        expected += float(np.mean(density.mean(axis=1) * area))
        weights = rays.weight[(rays.pixel == [column, row]).all(axis=1)]
        sums, counts = sums + weights.mean(), counts + 1
    # 64 rays a pixel of which nine in ten pass scatter by 4 %, four pixels by 2; the grid of the quadrature by 0.5
    assert sums / counts == pytest.approx(expected / counts, rel=0.02 * Z / 3 + 0.005)


TILT, FOCUS, FOCAL = np.radians(20.0), 3.0, 0.1


def closed_form(y_film):
    """Scheimpflug: where a thin lens images a point of the tilted film, height and distance ahead [m]."""
    behind = 1 / (1 / FOCAL - 1 / FOCUS) + y_film * np.sin(TILT)
    ahead = 1 / (1 / FOCAL - 1 / behind)
    return -y_film * np.cos(TILT) * ahead / behind, ahead


def test_film_lens_and_plane_of_focus_meet_in_one_line():
    (y0, z0), (y1, z1) = closed_form(-0.01), closed_form(0.01)
    behind = 1 / (1 / FOCAL - 1 / FOCUS)
    at_lens = y0 - z0 * (y1 - y0) / (z1 - z0)
    assert at_lens == pytest.approx(-behind / np.tan(TILT))  # where the film's plane meets that of the lens
    at_focal = at_lens + FOCAL * (y1 - y0) / (z1 - z0)
    assert at_focal == pytest.approx(-FOCAL / np.tan(TILT))  # the hinge, one focal length ahead


@pytest.mark.parametrize("kind", ["thin_lens", "pinhole"])
def test_rays_of_ideal_cameras_meet_in_scheimpflugs_plane(session, kind):
    own = {"thin_lens": {"focal_length_mm": FOCAL * 1e3, "f_number": 4, "focus_distance_m": FOCUS}}
    across = np.degrees(2 * np.arctan(0.018 / (1 / (1 / FOCAL - 1 / FOCUS))))
    own["pinhole"] = {"fov_degrees": float(across)}
    movements = {"tilt_degrees": float(np.degrees(TILT)), "rise_mm": 3.0, "shift_mm": -2.0}
    scene = scene_of(kind, movements, **own[kind])
    rays = camera_rays(session, scene, 16)
    assert (rays.weight == 1).all()
    # the plane through the line in the plane of the lens; the film has gone 3 mm down
    behind = 1 / (1 / FOCAL - 1 / FOCUS)
    at_lens, slope = -behind / np.tan(TILT) - 0.003, (behind / FOCAL - 1) / np.tan(TILT)
    slope += 0.003 / FOCAL  # height per distance ahead: the film meets the axis farther back
    o, d = rays.origin, rays.direction
    step = (at_lens - o[:, 1] - slope * o[:, 2]) / (d[:, 1] + slope * d[:, 2])
    if kind == "thin_lens":
        points = o + step[:, None] * d
    else:
        points = o + d
    # back through the middle of the lens to the film
    frame = film_frame(scene.camera)
    normal, centre = np.array(frame.normal), np.array([*frame.centre, 0.0]) * 1e-3 + [0, 0, behind]
    on_film = points * ((centre @ normal) / (points @ normal))[:, None] - centre
    film = on_film @ np.array([frame.across, frame.up]).T * 1e3
    inside = film_of(scene, rays, film)
    assert inside.min() > -1e-3 and inside.max() < 1 + 1e-3


@pytest.mark.slow
def test_a_tilted_lens_is_sharp_in_the_plane_of_first_order_optics(session):
    """A real lens: rays of small film areas meet in the tilted plane, and spread far there without tilt."""
    focus = {"distance_m": 2.5}
    spreads = {}
    for tilt in (0.0, 6.0):
        scene = scene_of(
            movements={"tilt_degrees": tilt}, lens="tessar-100mm", focus=focus, f_number=11.0, size_mm=(0.18, 24)
        )
        setting = lens_setting(scene)
        first = setting.lens.first_order()
        rays = camera_rays(session, scene, 32)
        good = rays.status == Status.ok
        o, d, rows = rays.origin[good], rays.direction[good], rays.pixel[good, 1]
        # principal planes: v behind the rear one, distances ahead of the front one
        f = first.focal_length_mm * 1e-3
        v = (setting.film_distance_mm - first.principal_planes_mm.rear) * 1e-3
        front = -(setting.lens.film_z(setting.film_distance_mm)) * 1e-3 + first.principal_planes_mm.front * 1e-3
        slope = (v / f - 1) / np.tan(np.radians(6.0))
        y, z = o[:, 1] + v / np.tan(np.radians(6.0)), front - o[:, 2]
        step = -(y - slope * z) / (d[:, 1] + slope * d[:, 2])
        points = o + step[:, None] * d
        pixels = rows * SIZE[0] + rays.pixel[good, 0]
        flat = o + ((-2.5 - o[:, 2]) / d[:, 2])[:, None] * d
        for plane, met in (("tilted", points), ("flat", flat)):
            spreads[tilt, plane] = np.mean([np.std(met[pixels == pixel, 0]) for pixel in np.unique(pixels)])
    # each film is sharp in its own plane, but for aberrations and pixels, which are as large in both
    assert spreads[6.0, "tilted"] < 1.2 * spreads[0.0, "flat"]
    assert spreads[0.0, "tilted"] > 3 * spreads[6.0, "tilted"]


def test_a_risen_film_sees_what_a_larger_film_sees_there(session):
    """Keystone correction is a part of a larger picture: verticals stay parallel."""
    lens = {"lens": "dgauss-50mm", "focus": {"film_distance_mm": 36.0}}
    risen = camera_rays(session, scene_of(movements={"rise_mm": 6, "shift_mm": 3}, size_mm=(12, 8), **lens), 4)
    large = scene_of(size_mm=(36, 24), **lens)
    points, _ = landed(load_lens("dgauss-50mm"), 36.0, UNMOVED, risen)
    good = risen.status == Status.ok
    right, down = ((1 - points / np.array(half_film_mm(large)) * [1, -1]) / 2)[good].T
    assert right.min() > 0.5 + (3 - 6.01) / 36 and right.max() < 0.5 + (3 + 6.01) / 36
    assert down.min() > 0.5 - (6 + 4.01) / 24 and down.max() < 0.5 - (6 - 4.01) / 24


@pytest.mark.parametrize("kind", ["pinhole", "thick_lens"])
def test_intrinsics_project_what_rays_see(session, kind):
    own = {"fov_degrees": 40.0}
    if kind == "thick_lens":
        own = {"lens": "dgauss-50mm", "focus": {"distance_m": 2.0}, "f_number": 1e3}
    scene = scene_of(kind, {"tilt_degrees": 7, "swing_degrees": -4, "rise_mm": 5}, **own)
    model = camera_model(scene)
    rays = camera_rays(session, scene, 8)
    away = rays.direction * [1, 1, -1]
    column, row, scale = np.array(model.metadata["intrinsics"]["matrix"]) @ away.T
    inside = np.stack([column / scale, row / scale], axis=1) - rays.pixel
    assert inside.min() > -0.02 and inside.max() < 1.02  # at f/1000 rays of a pixel are all but one


def test_metadata_say_how_the_film_stands():
    said = camera_model(scene_with("tilted", pupil="rear")).metadata["movements"]
    assert said["tilt_degrees"] == 8
    assert said["film_normal"] == pytest.approx([0, -np.sin(np.radians(8)), np.cos(np.radians(8))])
    risen = camera_model(scene_with("risen", pupil="rear")).metadata
    assert risen["movements"]["film_centre_mm"] == [4.0, -9.0, 0.0]
    assert (risen["intrinsics"]["cx"], risen["intrinsics"]["cy"]) == pytest.approx((9 + 4 / 2, 6 + 9 / 2))


def test_movements_of_zero_are_no_movements():
    plain, given = scene_of(lens="dgauss-50mm", focus={"distance_m": 2}), {"tilt_degrees": 0.0, "rise_mm": 0.0}
    zero = scene_of(movements=given, lens="dgauss-50mm", focus={"distance_m": 2})
    first, second = camera_model(plain), camera_model(zero)
    assert first.record.tobytes() == second.record.tobytes()
    assert first.facts == second.facts and "FILM_MOVED" not in first.facts


@pytest.mark.parametrize(
    ("camera", "match"),
    [
        ({"movements": {"tilt_degrees": 75}, "size_mm": (36, 90)}, "corner of the film would stand"),
        ({"movements": {"tilt_degrees": 5}, "rays": "fitted"}, "camera.rays: stands for a film across"),
        ({"movements": {"rise_mm": 5}, "accuracy": "auto"}, "camera.accuracy: stands for a film across"),
        ({"movements": {"tilt_degrees": 5}, "diffraction": "on"}, "camera.diffraction: is known on a film across"),
        ({"movements": {"tilt": 5}}, "camera.movements.tilt"),
    ],
)
def test_what_a_moved_film_cannot_do_is_refused(camera, match):
    with pytest.raises(InputError, match=match):
        camera_model(scene_of(**({"lens": "dgauss-50mm", "focus": {"distance_m": 2}} | camera)))


def test_focus_by_spot_counts_the_depth_of_the_tilted_film():
    common = {"lens": "dgauss-50mm", "f_number": 4.0}
    focus = {"distance_m": 1.5, "method": "spot", "field": [0.5, 0.75]}
    flat, tilted = (
        lens_setting(scene_of(movements={"tilt_degrees": tilt}, focus=focus, **common)).film_distance_mm
        for tilt in (0.0, 5.0)
    )
    # that point of the picture lies 6 mm up the film, so that the film's centre has to be nearer to the lens
    assert flat - tilted == pytest.approx(6 * np.sin(np.radians(5.0)), rel=0.02)


@pytest.mark.slow
def test_focus_by_spot_near_natural_size_is_for_the_distance_from_the_middle_of_the_tilted_film():
    scene = scene_of(
        lens="dgauss-50mm",
        f_number=4.0,
        movements={"tilt_degrees": 8},
        focus={"distance_m": 0.22, "method": "spot", "field": [0.5, 0.85]},
    )
    middle = np.array([0.5, 0.85]) * scene.film.resolution
    at, along = (camera_of(scene).pupil_rays(middle[None]).seen(vergence)[0] for vergence in (0.0, 1.0))
    weights = camera_of(scene).pupil_rays(middle[None]).weights[0][:, None]
    at, along = (places - np.sum(weights * places, axis=0) for places in (at, along - at))
    sharpest = -np.sum(weights * at * along) / np.sum(weights * along * along)
    # by the 1.2 mm that the film leans back there it would be 5e-3 off
    assert 1 / sharpest == pytest.approx(0.22, rel=3e-4)


@pytest.mark.slow
def test_circle_of_confusion_on_a_tilted_film_is_that_of_its_depth():
    """A wall at the distance in focus: the cone of each point is cut where the film has gone out of focus."""
    camera = {"focal_length_mm": FOCAL * 1e3, "f_number": 4, "focus_distance_m": FOCUS}
    scene = scene_of("thin_lens", {"tilt_degrees": float(np.degrees(TILT))}, **camera)
    wall = {"shape": "plane", "point": [0, 0, -FOCUS], "normal": [0, 0, 1]}
    scene = set_keys(scene, {"objects": [wall | {"material": {"kind": "matte", "reflectance": 0.5}}]})
    coc = rptcam_cl.render(scene, spp=32, layers=["coc"])["coc"]
    up_mm = (np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2) / SIZE[1] * 24.0
    opening, behind = FOCAL * 1e3 / 4, 1e3 / (1 / FOCAL - 1 / FOCUS)
    expected = opening * np.abs(up_mm * np.sin(TILT)) / behind * SIZE[0] / 36.0
    np.testing.assert_allclose(coc, np.broadcast_to(expected[:, None], coc.shape), rtol=0.05, atol=0.01)


@pytest.mark.slow
def test_circle_of_confusion_vanishes_in_the_tilted_plane_of_focus():
    camera = {"focal_length_mm": FOCAL * 1e3, "f_number": 4, "focus_distance_m": FOCUS}
    scene = scene_of("thin_lens", {"tilt_degrees": float(np.degrees(TILT))}, **camera)
    (y0, z0), (y1, z1) = closed_form(-0.01), closed_form(0.01)
    across = np.array([0.0, z0 - z1, y0 - y1]) * np.sign(z0 - z1)
    plane = {"shape": "plane", "point": [0, y0, -z0], "normal": across.tolist()}
    scene = set_keys(scene, {"objects": [plane | {"material": {"kind": "matte", "reflectance": 0.5}}]})
    coc = rptcam_cl.render(scene, spp=16, layers=["coc"])["coc"]
    assert coc.max() < 0.042  # a pixel counts at its middle: half a row of 2 mm; at the edges of a flat film 0.46


@pytest.mark.slow
def test_autofocus_in_a_zone_of_a_tilted_film_counts_its_depth_there():
    wall = {"shape": "plane", "point": [0, 0, -1.5], "normal": [0, 0, 1]}
    found = []
    for tilt in (0.0, 5.0):
        camera = {"lens": "dgauss-50mm", "f_number": 4.0, "focus": {"distance_m": 1.5}}
        scene = scene_of(movements={"tilt_degrees": tilt}, **camera)
        scene = set_keys(scene, {"objects": [wall | {"material": {"kind": "matte", "reflectance": 0.5}}]})
        found.append(rptcam_cl.autofocus(scene, "depth", zones=[[0.45, 0.55, 0.72, 0.78]]).film_distance_mm)
    assert found[0] - found[1] == pytest.approx(6 * np.sin(np.radians(5.0)), rel=0.02)
