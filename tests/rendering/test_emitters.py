"""Irradiance from every emitter against closed forms, seen as the radiance of a white matte plane: E = pi L.

The plane z = 0 is looked at through so narrow a field of view that the whole picture is one point, less than 3e-5
across: the irradiance changes linearly over it, so that the mean is that of the point. max_depth 2 is direct light.
"""

import math

import numpy as np
import pytest

from rptcam_cl.core.records import EmitterKind
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from tests.rendering.pictures import MATTE, flat_mean, lamp, looking, pixels, scene_of
from tests.support.cases import fast, slow
from tests.support.statistics import assert_equivalent

GROUND = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}


def ground_under(objects=(), lights=(), eye=(-1, -1, 0.3), **rest):
    camera = looking(eye, [0, 0, 0], fov=0.0002)
    return scene_of([GROUND, *objects], camera, depth=2, resolution=(64, 64), lights=list(lights), **rest)


def rectangle_above(radiance=2.0):
    """One corner straight above the point, facing down."""
    corner = {"corner": [0, 0, 0.9], "edge_u": [0, 0.7, 0], "edge_v": [1.3, 0, 0]}
    return {"shape": "rectangle", **corner, "material": lamp(radiance)}


def parallel_rectangle(a, b, h, radiance):
    """Irradiance below the corner of a parallel rectangle a x b at height h."""
    p, q = math.hypot(a, h), math.hypot(b, h)
    return radiance / 2 * (a / p * math.atan(b / p) + b / q * math.atan(a / q))


def perpendicular_rectangle(a, b, c):
    """Form factor to a rectangle standing at distance c, a high and b wide, corner level with the point."""
    x, y = a / b, c / b
    r = math.hypot(x, y)
    return (math.atan(1 / y) - y / r * math.atan(1 / r)) / (2 * math.pi)


def offset_disk(a, h, r):
    """Form factor to a parallel disk of radius r at height h whose axis passes at distance a."""
    s = a * a + h * h
    return (1 - (s - r * r) / math.sqrt((s + r * r) ** 2 - 4 * a * a * r * r)) / 2


def assert_irradiance(scene, name, expected, relative=0.004, spp=512):
    mean, error = flat_mean(scene, name, spp=spp)
    expected = np.broadcast_to(expected, 3)
    assert_equivalent(mean * math.pi, error * math.pi, expected, relative * expected)


def test_closed_forms_are_those_of_the_literature():
    assert parallel_rectangle(1.3, 0.7, 0.9, 2) == pytest.approx(0.8650171, abs=5e-8)
    assert perpendicular_rectangle(1.2, 0.8, 0.5) == pytest.approx(0.1273275, abs=5e-8)
    assert offset_disk(0.8, 1.1, 0.6) == pytest.approx(0.1257415, abs=5e-8)


def test_rectangle_above_its_corner():
    expected = parallel_rectangle(1.3, 0.7, 0.9, 2)
    assert_irradiance(ground_under([rectangle_above()]), "corner", expected)


def test_box_above_its_corner():
    # from the point below its corner only its bottom is seen
    box = {"shape": "box", "min": [0, 0, 0.9], "max": [1.3, 0.7, 1.0], "material": lamp(2.0)}
    assert_irradiance(ground_under([box]), "box", parallel_rectangle(1.3, 0.7, 0.9, 2))


def test_same_light_when_only_bsdf_sampling_finds_it():
    # within a box that shines on both sides; light sampling knows its outside alone
    room = {"shape": "box", "min": [-2, -3, -1], "max": [4, 3, 5], "material": lamp(0.5, two_sided=True)}
    assert_irradiance(ground_under([room]), "room", math.pi * 0.5, 1e-5, spp=4)


def test_rectangle_perpendicular_to_the_ground():
    wall = {"corner": [0, 0.5, 0], "edge_u": [0.8, 0, 0], "edge_v": [0, 0, 1.2]}
    wall = {"shape": "rectangle", **wall, "material": lamp(1.0)}
    assert_irradiance(ground_under([wall]), "wall", math.pi * perpendicular_rectangle(1.2, 0.8, 0.5))


def test_parallelogram_emits_in_proportion_to_its_area():
    # far away, E = L A cos cos / d^2; skewed edges of area 0.02 at (0, 0, 20): higher orders are below 1e-4
    skewed = {"corner": [-0.1, -0.05, 20], "edge_u": [0, 0.1, 0], "edge_v": [0.2, 0.1, 0]}
    skewed = {"shape": "rectangle", **skewed, "material": lamp(5e4)}
    assert_irradiance(ground_under([skewed]), "parallelogram", 5e4 * 0.02 / 400, 0.001, spp=64)


def test_disk_beside_the_normal():
    disk = {"shape": "disk", "center": [0.8, 0, 1.1], "normal": [0, 0, -1], "radius": 0.6, "material": lamp(1.0)}
    assert_irradiance(ground_under([disk]), "disk", math.pi * offset_disk(0.8, 1.1, 0.6))


STRETCH = [{"scale": [0.1, 0.05, 1.0]}, {"rotate": {"axis": [1, 0, 0], "degrees": 30}}, {"translate": [0, 0, 20]}]
FLAT = {
    "disk": ({"shape": "disk", "center": [0, 0, 0], "normal": [0, 0, -1], "radius": 1}, math.pi),
    "rectangle": ({"shape": "rectangle", "corner": [-1, -1, 0], "edge_u": [0, 2, 0], "edge_v": [2, 0, 0]}, 4.0),
}


@pytest.mark.parametrize("shape", FLAT)
def test_stretched_and_turned_lamp_emits_in_proportion_to_its_area(shape):
    # E = L A cos / d^2 from far away; the lamp is 0.1 wide at a distance of 20, so higher orders are below 1e-4
    description, area = FLAT[shape]
    flat = {**description, "material": lamp(4e4), "transform": STRETCH}
    expected = 4e4 * area * 0.1 * 0.05 * math.cos(math.radians(30)) / 400
    assert_irradiance(ground_under([flat]), f"stretched {shape}", expected, 0.001, spp=64)


def test_sphere_lamp_grows_with_its_transform():
    scaled = {**sphere([0, 0, 0], 0.25), "transform": [{"scale": [2, 2, 2]}, {"translate": [0, 0, 1.6]}]}
    assert_irradiance(ground_under([scaled]), "scaled sphere", math.pi * 0.25 / 2.56)


def sphere(center, radius, radiance=1.0):
    return {"shape": "sphere", "center": list(center), "radius": radius, "material": lamp(radiance)}


# E = pi L (r / d)^2 cos exactly, while the sphere is whole above the horizon
@pytest.mark.parametrize(
    ("distance", "radius"),
    [(1.5, 0.9), (2.0, 2.0 * math.sqrt(1e-4 / math.pi)), (2.0, 2e-6), (2.0, 2e-11), (1.0, 0.999)],
    ids=["wide", "1e-4 sr", "3e-12 sr", "3e-22 sr", "a thousandth above the surface"],
)
def test_sphere(distance, radius):
    scene = ground_under([sphere([0, 0, distance], radius, 1 / radius**2)], eye=(-0.02, 0, 0.0001))
    assert_irradiance(scene, f"sphere {radius}", math.pi / distance**2)


TURNED = [{"rotate": {"axis": [0, 0, 1], "degrees": 17}}, {"scale": 2e-7}, {"translate": [0, 0, 2]}]
CORNERS = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
SIDES = [face for a in range(4) for b in [(a + 1) % 4] for face in ([a, b, 4], [b, a, 5])]
OF_PIECES = {
    "octahedron": ({"shape": "mesh", "vertices": CORNERS, "faces": SIDES}, 2.0),
    "tube with its ends": (
        {"shape": "cylinder", "base": [-0.7, 0, -0.7], "top": [0.7, 0, 0.7], "radius": 0.5},
        1.4 + math.pi / 4 * math.sqrt(0.5),
    ),
}


# E = L A / d^2; a direction in float32 may lead to another piece of the lamp than the one that was chosen
@pytest.mark.parametrize("shape", fast(["octahedron"], OF_PIECES))
def test_lamp_of_pieces_ten_million_times_its_size_away_does_not_shade_itself(shape):
    description, area = OF_PIECES[shape]
    pieces = {**description, "material": lamp(1 / 4e-14), "transform": TURNED}
    scene = ground_under([pieces], eye=(-0.02, 0, 0.0001))
    assert_irradiance(scene, f"far {shape}", area / 4, 0.002, spp=256)


def test_sphere_aside_has_the_cosine_of_its_centre():
    scene = ground_under([sphere([1.2, 0, 1.6], 0.5)], eye=(-0.5, -0.5, 0.05))
    assert_irradiance(scene, "aside", math.pi * 0.25 / 4 * 0.8)


def test_point_light_is_exact():
    light = {"kind": "point", "position": [0.6, 0, 0.8], "intensity": [3, 2, 1]}
    film = pixels(ground_under(lights=[light]), spp=4)
    # no noise; the view is 3e-5 wide
    np.testing.assert_allclose(film * math.pi, np.broadcast_to(np.array([3, 2, 1]) * 0.8, film.shape), rtol=1e-4)


def test_directional_light_is_exact():
    light = {"kind": "directional", "direction": [-3, 0, -4], "irradiance": [1, 2, 3]}
    film = pixels(ground_under(lights=[light]), spp=4)
    expected = np.broadcast_to(np.array([1, 2, 3]) * 0.8, film.shape)
    # float32: a dozen roundings
    np.testing.assert_allclose(film * math.pi, expected, rtol=2e-6)


@pytest.mark.parametrize("light", ["point", slow("directional")])
def test_light_without_a_surface_is_blocked(light):
    lights = {
        "point": {"kind": "point", "position": [0, 0, 3], "intensity": [1, 1, 1]},
        "directional": {"kind": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]},
    }
    roof = {"shape": "disk", "center": [0, 0, 2], "normal": [0, 0, 1], "radius": 1, "material": MATTE}
    film = pixels(ground_under([roof], [lights[light]]), spp=4)
    assert (film == 0).all()


def test_lamp_turned_away_is_dark_and_a_two_sided_one_is_not():
    away = {"corner": [0, 0, 0.9], "edge_u": [1.3, 0, 0], "edge_v": [0, 0.7, 0]}
    dark = {"shape": "rectangle", **away, "material": lamp(2.0)}
    assert (pixels(ground_under([dark]), spp=16) == 0).all()
    bright = {"shape": "rectangle", **away, "material": lamp(2.0, two_sided=True)}
    assert_irradiance(ground_under([bright]), "two-sided", parallel_rectangle(1.3, 0.7, 0.9, 2))


def test_emitters_of_every_kind_add_up():
    disk = {"shape": "disk", "center": [0.8, 0, 1.1], "normal": [0, 0, -1], "radius": 0.6, "material": lamp([0, 5, 0])}
    wall = {"shape": "rectangle", "corner": [0, -0.7, 0], "edge_u": [0, 0, 1.2], "edge_v": [0.8, 0, 0]}
    lights = [
        {"kind": "point", "position": [-0.6, 0, 0.8], "intensity": [0, 0, 1]},
        {"kind": "directional", "direction": [-3, 4, -12], "irradiance": [0.3, 0, 0]},
    ]
    ball = sphere([-1.2, 0, 1.6], 0.5, [0.5, 0.5, 0.5])
    scene = ground_under([{**wall, "material": lamp([1, 0, 0])}, disk, ball], lights, eye=(-0.5, 0.5, 0.05))
    red = math.pi * perpendicular_rectangle(1.2, 0.8, 0.7) + 0.3 * 12 / 13
    green = 5 * math.pi * offset_disk(0.8, 1.1, 0.6)
    both = 0.5 * math.pi * 0.25 / 4 * 0.8
    assert_irradiance(scene, "all", np.array([red, green, 0.8]) + both, 0.012, spp=2048)


@pytest.mark.parametrize("unit_m", [1.0, 0.001, 1000.0])
@pytest.mark.parametrize("flat", ["rectangle", "disk"])
def test_lamp_beside_a_sky_is_sampled_as_often_whatever_the_unit_of_the_scene(flat, unit_m):
    def length(*metres):
        return [each / unit_m for each in metres]

    sides = {"corner": length(-0.1, -0.1, 0), "edge_u": length(0.2, 0, 0), "edge_v": length(0, 0.2, 0)}
    disk = {"center": [0, 0, 0], "normal": [0, 0, 1], "radius": 0.1 / unit_m}
    table = {"shape": flat, "material": MATTE, **(sides if flat == "rectangle" else disk)}
    light = {"kind": "point", "position": length(0, 0, 0.2), "intensity": 1.0}
    camera = {"kind": "pinhole", "eye": length(0, 0, 0.3), "target": [0, 0, 0], "up": [0, 1, 0], "fov_degrees": 40}
    scene = {"metres_per_unit": unit_m, "camera": camera, "objects": [table], "lights": [light]}
    plan = make_plan(load_scene(scene | {"environment": {"kind": "sky", "sun": False}}))
    (share,) = plan.emitters.records["pick"][plan.emitters.records["kind"] == EmitterKind.POINT]
    # The power of the lamp, beside what of the sky passes a disk about the eye of once to twice the table's distance.
    least, most = (4 / (4 + plan.surroundings.flux * reach**2) for reach in (0.6, 0.3))
    assert least <= share <= most


def test_a_glowing_surface_of_two_sides_shines_behind():
    """Its back is seen, and lights the ground below as that of an emissive one does."""
    back = {"shape": "rectangle", "corner": [0, 0, 0.9], "edge_u": [1.3, 0, 0], "edge_v": [0, 0.7, 0]}
    glowing = {"kind": "principled", "base_color": 0, "specular": 0, "emission": 2.0, "two_sided": True}
    expected = parallel_rectangle(1.3, 0.7, 0.9, 2.0)
    assert_irradiance(ground_under([back | {"material": glowing}]), "two sides", expected, relative=0.02, spp=64)
    eye, target = [0.5, 0.4, 0.2], [0.6, 0.4, 0.9]
    seen = ground_under([back | {"material": glowing}]) | {"camera": looking(eye, target, fov=0.0002)}
    assert pixels(seen, spp=1) == pytest.approx(2.0)
