"""The thick lens: its rays go where cardinal points and pupils say, and where traced rays go near the axis."""

import math

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.lens import film_distance, thick_lens_of
from rptcam_cl.optics.library import load_lens
from tests.device.probes import camera_rays, open_session
from tests.rendering.pictures import WHITE, flat_mean, pixels, scene_of
from tests.support.statistics import assert_equivalent

WAVELENGTH = 587.5618
LENSES = ["dgauss-50mm", "wide-22mm", "fisheye-10mm", "telephoto-250mm", "biconvex-stop", "ball", "human-eye"]
PUPIL = np.array([-1.0, -0.4, 0.0, 0.7, 1.0])  # points across the unit disk
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}


def world(lens, focus, **options):
    """A white world through a thick lens."""
    rest = {key: options.pop(key) for key in ("resolution", "film", "exposure") if key in options}
    camera = {"kind": "thick_lens", "lens": lens, "focus": focus, **POSE, **options}
    return scene_of([], camera, environment=WHITE, depth=1, **rest)


def outside(thick, film, pupil):
    """Height at the first vertex and slope towards the scene of rays by the numbers of a thick lens."""
    return tuple(factor[0] * film + factor[1] * pupil for factor in (thick.height, thick.slope))


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("distance", [350.0, 1000.0, 20000.0])
def test_rays_of_a_film_point_meet_in_its_conjugate_object_point(name, distance):
    lens = load_lens(name)
    back = film_distance(lens, distance, "front")
    data = lens.first_order()
    behind = back - data.back_focal_distance_mm
    before = data.focal_length_mm * data.front_focal_length_mm / behind  # Newton
    assert before - data.front_focal_distance_mm == pytest.approx(distance)
    for film in (0.0, 0.3, -7.0):
        height, slope = outside(thick_lens_of(lens, back, WAVELENGTH), film, PUPIL)
        expected = -film * data.focal_length_mm / behind
        np.testing.assert_allclose(height + slope * distance, expected, rtol=1e-11, atol=1e-11 * distance)


@pytest.mark.parametrize("name", LENSES)
def test_rays_are_parallel_where_infinity_is_sharp(name):
    lens = load_lens(name)
    data = lens.first_order()
    _, slope = outside(thick_lens_of(lens, data.back_focal_distance_mm, WAVELENGTH), 2.0, PUPIL)
    np.testing.assert_allclose(slope, -2.0 / data.front_focal_length_mm, rtol=1e-10)


@pytest.mark.parametrize("name", LENSES)
def test_rays_go_through_the_same_point_of_both_pupils(name):
    lens = load_lens(name)
    back = film_distance(lens, 1000.0, "front")
    data, thick = lens.first_order(), thick_lens_of(lens, back, WAVELENGTH)
    height, slope = outside(thick, 3.0, PUPIL)
    entrance = height - slope * data.entrance_pupil.distance_mm
    towards_film = thick.film_slope[0] * 3.0 + thick.film_slope[1] * PUPIL
    exit_ = 3.0 - towards_film * (back - data.exit_pupil.distance_mm)
    for at, diameter in ((entrance, data.entrance_pupil.diameter_mm), (exit_, data.exit_pupil.diameter_mm)):
        np.testing.assert_allclose(np.abs(at), np.abs(PUPIL) * diameter / 2, rtol=1e-9, atol=1e-9 * diameter)


@pytest.mark.parametrize("name", LENSES)
def test_rays_near_the_axis_are_the_traced_ones(name):
    lens = load_lens(name)
    back = film_distance(lens, 5000.0)
    thick = thick_lens_of(lens, back, WAVELENGTH)
    off = []
    for size in (1e-1, 1e-2):  # of aperture and field
        film = size * 0.05 * lens.first_order().focal_length_mm
        height, slope = outside(thick, film, PUPIL * size)
        inwards = thick.film_slope[0] * film + thick.film_slope[1] * PUPIL * size
        zero = np.zeros_like(inwards)
        start = np.broadcast_to([0.0, film, lens.length + back], (len(PUPIL), 3))
        rays = lens.trace(start, np.column_stack([zero, -inwards, zero - 1]), WAVELENGTH)
        traced = -rays.directions[:, 1] / rays.directions[:, 2]
        reached = rays.origins[:, 1] + traced * rays.origins[:, 2]
        off.append((np.abs(slope - traced).max(), np.abs(height - reached).max()))
    assert off[1][0] < 1e-4
    # aberrations begin with the third power of aperture and field
    assert np.all(np.array(off[1]) < 2e-3 * np.array(off[0]))


@pytest.mark.parametrize("flip", [True, False])
def test_device_follows_the_numbers_of_the_thick_lens(flip):
    scene = rptcam_cl.load_scene(
        world("telephoto-250mm", {"front_distance_m": 2.0}, resolution=(24, 16), film={"width_mm": 36}, flip=flip)
    )
    lens = load_lens("telephoto-250mm")
    back = film_distance(lens, 2000.0, "front")
    for lanes in (1, 8):
        rays = camera_rays(open_session(), scene, 64, lanes)
        np.testing.assert_allclose(rays.origin[:, 2], -(back + lens.length) * 1e-3, rtol=1e-6)
        forward = -rays.direction[:, 2]
        at = rays.origin[:, :2] + rays.direction[:, :2] / forward[:, None] * 2.0
        behind = back - lens.first_order().back_focal_distance_mm
        scale = lens.first_order().focal_length_mm / behind * 36e-3 / 24  # object metres per pixel
        u, v = (at if flip else -at).T / scale + np.array([[12.0], [-8.0]])
        inside = np.stack([u - rays.pixel[:, 0], -v - rays.pixel[:, 1]])
        assert inside.min() > -1e-3
        assert inside.max() < 1 + 1e-3
        # at the first vertex the rays fill the beam, which is wider than the entrance pupil by what the field adds
        assert np.hypot(*rays.origin[:, :2].T).max() > 0.9 * lens.first_order().entrance_pupil.diameter_mm / 2e3


@pytest.mark.parametrize("name", ["dgauss-50mm", "wide-22mm", "human-eye"])
def test_light_falls_off_as_from_a_disk_at_the_exit_pupil(name):
    lens = load_lens(name)
    back = film_distance(lens, 5000.0)
    pupil = lens.first_order().exit_pupil
    away, radius = back - pupil.distance_mm, pupil.diameter_mm / 2
    index = float(lens.indices(WAVELENGTH)[-1])
    width = 1.2 * away
    film = {"width_mm": width}
    scene = world(name, {"distance_m": 5.0}, resolution=(64, 2), film=film, exposure="irradiance")
    got = pixels(scene, spp=20000)[..., 0].mean(axis=0)
    h2 = ((np.arange(64) + 0.5) / 64 * width - width / 2) ** 2 + (width / 128) ** 2
    square = h2 + away**2
    # form factor of a disk for a parallel element beside its axis
    exact = math.pi / 2 * (1 - (square - radius**2) / np.sqrt((square + radius**2) ** 2 - 4 * h2 * radius**2))
    means = [values.reshape(8, 8).mean(axis=1) for values in (got, exact * index**2)]
    # 320 000 samples whose weights vary by a fifth at the edge
    np.testing.assert_allclose(*means, rtol=2e-3)


@pytest.mark.parametrize("name", ["dgauss-50mm", "human-eye"])
@pytest.mark.parametrize("f_number", [None, 8])
def test_relative_exposure_is_one_on_the_axis(name, f_number):
    options = {"f_number": f_number} if f_number else {}
    scene = world(name, {"distance_m": 5.0}, film={"width_mm": 0.01}, **options)
    mean, error = flat_mean(scene, name, spp=256)
    assert_equivalent(mean[0], error[0], 1.0, 1e-3)
    stated = rptcam_cl.render(scene, spp=1).metadata["on_axis_irradiance"]
    mean, error = flat_mean(scene | {"exposure": "irradiance"}, name, spp=256)
    assert_equivalent(mean[0], error[0], stated, 1e-3 * stated)


CHECKER = {"kind": "matte", "reflectance": {"kind": "checker", "even": 0.9, "odd": 0.1, "scale": [20, 20]}}
BOARD = {
    "shape": "rectangle", "corner": [-1, -1, -2], "edge_u": [2, 0, 0], "edge_v": [0, 2, 0], "material": CHECKER,
}  # fmt: skip


@pytest.mark.slow
def test_picture_of_a_small_stop_and_field_is_that_of_the_traced_lens():
    films = {}
    for kind in ("thick_lens", "realistic"):
        camera = {"kind": kind, "lens": "dgauss-50mm", "f_number": 11, "focus": {"distance_m": 2.0}, **POSE}
        scene = scene_of([BOARD], camera, film={"width_mm": 8}, resolution=(48, 32), environment=WHITE, depth=2)
        films[kind] = pixels(scene, spp=256)[..., 0]
    difference = films["thick_lens"] - films["realistic"]
    # noise of 256 samples in edge pixels, where half the samples are white and half are black: 0.4 / 16 / sqrt(2)
    assert np.sqrt(np.mean(difference**2)) < 0.02
    assert np.abs(difference.mean()) < 2e-3


REFUSED = [
    ("anamorphic-100mm", {"film_distance_mm": 90}, "is not the same from every side"),
    ("cylinder-pair", {"film_distance_mm": 90}, "take camera.kind: realistic"),
    (
        {"name": "plate", "surfaces": [{"thickness": 5, "glass": {"index": 1.5}, "diameter": 10}, {"diameter": 10}]},
        {"film_distance_mm": 50},
        "plate: is afocal, so it has no cardinal points",
    ),
    (
        {
            "name": "star",
            "surfaces": [
                {"radius": 50, "thickness": 5, "glass": {"index": 1.5}, "diameter": 20},
                {"radius": -50, "thickness": 2, "diameter": 20},
                {"stop": True, "diameter": 10, "shape": {"blades": 6}},
            ],
        },
        {"film_distance_mm": 50},
        "star: its stop is not round",
    ),
]


@pytest.mark.parametrize(("lens", "focus", "message"), REFUSED, ids=["anamorphic", "cylinders", "afocal", "shape"])
def test_lens_without_one_thick_lens_is_refused(lens, focus, message):
    with pytest.raises(InputError, match=message):
        rptcam_cl.render(world(lens, focus), spp=1)


PLANO_CONVEX = [  # 50 mm; its front principal plane is the first vertex
    {"radius": 25, "thickness": 3, "glass": {"index": 1.5}, "diameter": 20},
    {"diameter": 20},
]


def test_film_on_the_exit_pupil_is_refused():
    # a stop at a focal length and a half before the lens has its image three focal lengths behind it
    lens = {"name": "field lens", "surfaces": [{"stop": True, "thickness": 75, "diameter": 5}, *PLANO_CONVEX]}
    image = load_lens(lens).first_order().exit_pupil.distance_mm
    with pytest.raises(InputError, match="field lens: its exit pupil lies on the film"):
        rptcam_cl.render(world(lens, {"film_distance_mm": image}), spp=1)


def test_lens_telecentric_at_the_film_has_its_closed_form():
    # the stop in the front focal plane: every film point sees the same cone
    lens = {"name": "telecentric", "surfaces": [{"stop": True, "thickness": 50, "diameter": 10}, *PLANO_CONVEX]}
    thick = thick_lens_of(load_lens(lens), 48.0, WAVELENGTH)
    np.testing.assert_allclose(thick.film_slope, [0.0, -0.1], atol=1e-12)
    np.testing.assert_allclose(thick.slope, [-1 / 50, 0.0], atol=1e-12)


def test_stop_of_a_lens_without_one_is_the_rim_that_limits():
    lens = load_lens("biconvex")
    assert lens.stop_index is None
    thick = thick_lens_of(lens, 60.0, WAVELENGTH)
    away = 60.0 - lens.first_order().exit_pupil.distance_mm
    assert abs(thick.film_slope[1]) == pytest.approx(lens.first_order().exit_pupil.diameter_mm / 2 / away)
    with pytest.raises(InputError, match="has no stop to set"):
        rptcam_cl.render(world("biconvex", {"distance_m": 2.0}, f_number=8), spp=1)
