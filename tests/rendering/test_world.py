"""Environment light, textures, depth and units."""

import math

import numpy as np
import pytest

from tests.conftest import PLAIN_KINDS
from tests.rendering.pictures import MATTE, WHITE, flat_mean, lamp, looking, pixels, scene_of, seed_of
from tests.support.statistics import Z, assert_equivalent

KERNELS_KNOW_OF = PLAIN_KINDS
GRADIENT = {"kind": "gradient", "bottom": [0.2, 1.0, 0.5], "top": [2.0, 0.1, 0.5], "up": [0, 0, 1]}
BOTTOM, TOP = np.array(GRADIENT["bottom"]), np.array(GRADIENT["top"])


@pytest.mark.parametrize("degrees", [0, 50, 90, 140])
def test_gradient_world_on_a_tilted_plane_has_its_closed_form(degrees):
    # E / pi = bottom + (top - bottom) / 2 (1 + 2/3 cos of the tilt)
    tilt = math.radians(degrees)
    normal = np.array([math.sin(tilt), 0, math.cos(tilt)])
    plane = {"shape": "plane", "point": [0, 0, 0], "normal": normal.tolist(), "material": MATTE}
    scene = scene_of([plane], looking(2 * normal, [0, 0, 0], up=(0, 1, 0)), depth=2, environment=GRADIENT)
    mean, error = flat_mean(scene, f"gradient {degrees}", spp=2000)
    expected = BOTTOM + (TOP - BOTTOM) / 2 * (1 + 2 / 3 * math.cos(tilt))
    assert_equivalent(mean, error, expected, 0.005 * expected)


def test_gradient_world_seen_directly_is_linear_in_height():
    camera = looking([0, 0, 0], [0, 1, 1.2], fov=90)
    film = pixels(scene_of([], camera, resolution=(65, 65), environment=GRADIENT), seed=seed_of("sky"), spp=4)
    centre = film[32, 32]
    height = 1.2 / math.hypot(1, 1.2)
    # a pixel is 1.5 degrees high: four jittered samples keep its middle to a quarter of that
    np.testing.assert_allclose(centre, BOTTOM + (TOP - BOTTOM) * (1 + height) / 2, rtol=0.01)


def test_gradient_turns_with_its_up():
    for up, expected in (([1, 0, 0], TOP), ([-1, 0, 0], BOTTOM), ([0, 1, 0], (TOP + BOTTOM) / 2)):
        scene = scene_of([], looking([0, 0, 0], [1, 0, 0], 0.01), environment={**GRADIENT, "up": up})
        np.testing.assert_allclose(pixels(scene, spp=1).mean((0, 1)), expected, rtol=1e-3)


def test_world_without_environment_or_lamps_is_black():
    assert (pixels(scene_of([], looking([0, 0, 0], [1, 0, 0])), spp=1) == 0).all()


@pytest.mark.parametrize(("depth", "expected"), [(1, 0.0), (2, 0.5), (3, 0.5)])
def test_depth_counts_edges(depth, expected):
    plane = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": {**MATTE, "reflectance": 0.5}}
    scene = scene_of([plane], looking([0, 0, 1], [0, 0, 0], up=(0, 1, 0)), depth=depth, environment=WHITE)
    np.testing.assert_allclose(pixels(scene, spp=2), expected, rtol=1e-6)


def test_lamp_is_seen_with_one_edge():
    disk = {"shape": "disk", "center": [0, 0, 0], "normal": [0, 0, 1], "radius": 9, "material": lamp([3, 2, 1])}
    scene = scene_of([disk], looking([0, 0, 1], [0, 0, 0], up=(0, 1, 0)), depth=1)
    np.testing.assert_array_equal(pixels(scene, spp=3), np.broadcast_to([3.0, 2.0, 1.0], (32, 32, 3)))


def cells(texture, shape, resolution, fov=90):
    """A textured floor from straight above: x to the right, y up, one unit each way from the middle."""
    floor = {**shape, "material": {"kind": "matte", "reflectance": texture}}
    camera = looking([0, 0, 1], [0, 0, 0], fov, up=(0, 1, 0))
    return pixels(scene_of([floor], camera, depth=2, resolution=resolution, environment=WHITE), spp=2)[..., 0]


PLANE = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
SQUARE = {"shape": "rectangle", "corner": [-1, -1, 0], "edge_u": [2, 0, 0], "edge_v": [0, 2, 0]}


def test_checker_on_a_plane_follows_the_coordinates():
    texture = {"kind": "checker", "even": 0.75, "odd": 0.25, "scale": [4, 2]}
    film = cells(texture, PLANE, (8, 8))
    x, y = np.meshgrid(np.arange(-4, 4), np.arange(3, -5, -1))  # cells of 1/4 unit; row 0 on top
    expected = np.where((x + np.floor(y / 2)) % 2 == 0, 0.75, 0.25)
    np.testing.assert_allclose(film, expected, rtol=1e-6)


def test_checker_on_a_rectangle_follows_its_edges():
    texture = {"kind": "checker", "even": 0.75, "odd": 0.25, "scale": [8, 8], "offset": [1, 0]}
    film = cells(texture, SQUARE, (8, 8))
    u, v = np.meshgrid(np.arange(8), np.arange(7, -1, -1))
    np.testing.assert_allclose(film, np.where((u + 1 + v) % 2 == 0, 0.75, 0.25), rtol=1e-6)


def test_grid_has_lines_of_its_width():
    texture = {"kind": "grid", "background": 0.9, "line": 0.1, "line_width": 0.25, "scale": [2, 2]}
    film = cells(texture, SQUARE, (8, 8))
    u, v = np.meshgrid(np.arange(8), np.arange(7, -1, -1))
    np.testing.assert_allclose(film, np.where((u % 4 == 0) | (v % 4 == 0), 0.1, 0.9), rtol=1e-6)


@pytest.mark.parametrize("mirror", [1, -1])
def test_texture_turns_with_its_sphere(mirror):
    # a sphere that is stretched by a ten-thousandth is computed as an ellipsoid, and must look the same
    texture = {"kind": "checker", "even": 0.8, "odd": 0.1, "scale": [6, 4]}
    turn = [{"rotate": {"axis": [1, 2, 3], "degrees": 70}}, {"translate": [0.1, 0, 0]}]
    material = {"kind": "matte", "reflectance": texture}
    films = []
    for stretch in (1.0, 1.0001):
        steps = [{"scale": [mirror, 1, stretch]}, *turn]
        ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": material, "transform": steps}
        scene = scene_of([ball], looking([0, -4, 1], [0, 0, 0]), depth=2, resolution=(64, 64), environment=WHITE)
        films.append(pixels(scene, spp=1))
    assert films[0].std() > 0.2
    # along the edges of the cells a few pixels of 4096 change sides
    assert (np.abs(films[0] - films[1]).max(axis=2) > 1e-3).sum() < 10


@pytest.mark.parametrize("ratio", [1e1, 1e3, 1e5])
def test_far_sphere_covers_the_film_that_it_should(ratio):
    # a sphere of radius 1 at distance `ratio`, in a view that is four radii wide
    sphere = {"shape": "sphere", "center": [0, ratio, 0], "radius": 1, "material": lamp(1.0)}
    half = 2 / ratio
    camera = looking([0, 0, 0], [0, ratio, 0], math.degrees(2 * math.atan(half)))
    mean, error = flat_mean(scene_of([sphere], camera, depth=1, resolution=(64, 64)), f"far {ratio}", spp=64)
    silhouette = math.tan(math.asin(1 / ratio))
    expected = math.pi * silhouette**2 / (2 * half) ** 2
    # pixels differ, so their spread overestimates the error of the mean of stratified pixels
    del error
    assert mean[0] == pytest.approx(expected, abs=0.001 + Z * 0.5 / math.sqrt(64**3))


@pytest.mark.parametrize("ratio", [1e1, 1e3, 1e5])
def test_far_white_sphere_does_not_shadow_itself(ratio):
    sphere = {"shape": "sphere", "center": [0, ratio, 0], "radius": 1, "material": MATTE}
    camera = looking([0, 0, 0], [0, ratio, 0], math.degrees(4 / ratio))
    film = pixels(scene_of([sphere], camera, depth=2, environment=WHITE), seed=seed_of("far"), spp=32)
    np.testing.assert_allclose(film, 1, rtol=1e-6)


def still_life(scale=1.0, brightness=1.0):
    """Every shape, material, texture and emitter; ``scale`` stretches it, ``brightness`` multiplies its light."""
    checker = {"kind": "checker", "even": 0.7, "odd": 0.2, "scale": [8, 8]}
    turn = [{"rotate": {"axis": [0, 0, 1], "degrees": 30}}, {"translate": [-1.5, 0.5, 0]}]
    metal = {"kind": "conductor", "reflectance": [0.9, 0.7, 0.4], "alpha": 0.2}
    floor = {"shape": "rectangle", "corner": [-4, -4, 0], "edge_u": [8, 0, 0], "edge_v": [0, 8, 0]}
    objects = [
        {**floor, "material": {"kind": "matte", "reflectance": checker}},
        {"shape": "sphere", "center": [0, 0, 0.6], "radius": 0.6, "material": {"kind": "dielectric", "index": 1.5}},
        {"shape": "sphere", "center": [1.3, 0, 0.5], "radius": 0.5, "material": metal},
        {"shape": "box", "min": [-0.3, -0.3, 0], "max": [0.3, 0.3, 0.8], "material": MATTE, "transform": turn},
        {"shape": "cylinder", "base": [0.5, -1, 0], "top": [0.5, -1, 0.5], "radius": 0.2, "material": metal},
        {"shape": "cone", "base": [-0.6, -1, 0], "apex": [-0.6, -1, 0.6], "radius": 0.25, "material": MATTE},
        {
            "shape": "plane",
            "point": [0, 4, 0],
            "normal": [0, -1, 0],
            "material": {"kind": "mirror", "reflectance": 0.8},
        },
        {"shape": "disk", "center": [0, 0, 4], "normal": [0, 0, -1], "radius": 0.7, "material": lamp(5 * brightness)},
        {"shape": "sphere", "center": [2, 1, 2], "radius": 0.2, "material": lamp([4 * brightness, 0, brightness])},
    ]
    intensity = [brightness * scale**2] * 3  # W/sr: what arrives falls with the square of the metres
    lights = [
        {"kind": "point", "position": [-2, -2, 3], "intensity": intensity},
        {"kind": "directional", "direction": [1, 2, -3], "irradiance": [0.2 * brightness] * 3},
    ]
    sky = {"kind": "gradient", "bottom": [0, 0, 0], "top": [0.3 * brightness] * 3}
    return scene_of(
        objects,
        looking([0.5, -5, 2], [0, 0, 0.5], near_m=0.5 * scale),
        depth=6,
        roulette=3,
        resolution=(48, 32),
        lights=lights,
        environment=sky,
        metres_per_unit=scale,
    )


@pytest.mark.parametrize("power", [-10, -3, 7, 10])
def test_scene_of_another_size_gives_the_same_bits(power):
    # powers of two are exact in every step, so one absolute epsilon anywhere would show
    plain = pixels(still_life(), seed=5, spp=8)
    assert plain.std() > 0.1
    np.testing.assert_array_equal(pixels(still_life(scale=2.0**power), seed=5, spp=8), plain)


@pytest.mark.parametrize("power", [-10, 10])
def test_light_of_another_power_gives_the_same_bits(power):
    plain = pixels(still_life(), seed=5, spp=8)
    np.testing.assert_array_equal(pixels(still_life(brightness=2.0**power), seed=5, spp=8), plain * 2.0**power)
