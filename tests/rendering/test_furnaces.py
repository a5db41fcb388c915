"""White furnaces and exact series: energy neither appears nor disappears, and depth is counted right.

In a uniform world of radiance 1 everything that absorbs nothing looks exactly as bright as the world, from whatever
side. A convex body meets the world after one scattering, so with max_depth 2 a single ray that hit its own surface
again would show as a dark sample.
"""

import math
from itertools import product

import numpy as np
import pytest

from tests.conftest import PLAIN_KINDS
from tests.rendering.pictures import MATTE, WHITE, flat_mean, looking, pixels, scene_of, seed_of
from tests.support.cases import fast, slow
from tests.support.statistics import assert_equivalent

KERNELS_KNOW_OF = PLAIN_KINDS
SQUASH = [{"scale": [1.0, 0.5, 0.7]}, {"rotate": {"axis": [1, 2, 3], "degrees": 40}}]
CONVEX = {
    "sphere": {"shape": "sphere", "center": [0, 0, 0], "radius": 1},
    "ellipsoid": {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "transform": SQUASH},
    "box": {"shape": "box", "min": [-0.7, -0.6, -0.5], "max": [0.6, 0.5, 0.4], "transform": SQUASH[1:]},
    "cylinder": {"shape": "cylinder", "base": [0, 0, -0.7], "top": [0.1, 0.2, 0.6], "radius": 0.6, "capped": True},
    "cone": {"shape": "cone", "base": [0, 0, -0.7], "apex": [0.1, 0.2, 0.8], "radius": 0.7, "capped": True},
    "disk": {"shape": "disk", "center": [0, 0, 0], "normal": [0.3, -1, 0.5], "radius": 1},
    "rectangle": {"shape": "rectangle", "corner": [-1, 0, -1], "edge_u": [2, 0.5, 0], "edge_v": [0, 0.5, 2]},
    "plane": {"shape": "plane", "point": [0, 0, -1], "normal": [0.1, 0.2, 1]},
}
ROUND_TRIP = 1e-6  # a handful of float32 roundings per sample
# Far above, and far too small to be seen: with them one program renders all shapes.
SPECKS = [
    {"shape": "sphere", "center": [0, 0, 60], "radius": 0.01},
    {"shape": "sphere", "center": [0, 0, 0], "radius": 0.01, "transform": [*SQUASH, {"translate": [1, 0, 60]}]},
    {"shape": "box", "min": [2, 0, 60], "max": [2.01, 0.01, 60.01]},
    {"shape": "cylinder", "base": [3, 0, 60], "top": [3, 0, 60.01], "radius": 0.01, "capped": True},
    {"shape": "cone", "base": [4, 0, 60], "apex": [4, 0, 60.01], "radius": 0.01, "capped": True},
    {"shape": "disk", "center": [5, 0, 60], "normal": [0, 0, 1], "radius": 0.01},
    {"shape": "rectangle", "corner": [6, 0, 60], "edge_u": [0.01, 0, 0], "edge_v": [0, 0.01, 0]},
]


def furnace(shape, material, scale=1.0, **options):
    """A body of about unit size in a white world, seen from three units away."""
    camera = looking([0.4, -3, 0.8], [0, 0, 0], fov=38)
    objects = [item | {"material": material} for item in (shape, *SPECKS)]
    return scene_of(objects, camera, environment=WHITE, metres_per_unit=scale, **options)


@pytest.mark.parametrize("scale", [1.0, slow(1e-3), 1e4], ids=["metres", "millimetres", "ten kilometres"])
@pytest.mark.parametrize("shape", CONVEX)
def test_white_convex_body_vanishes_in_a_white_world(shape, scale):
    film = pixels(furnace(CONVEX[shape], MATTE, scale, depth=2), seed=seed_of(shape), spp=64)
    np.testing.assert_allclose(film, 1, rtol=ROUND_TRIP)


@pytest.mark.parametrize(
    "glass",
    [
        {"kind": "dielectric", "roughness": 0.7},
        slow({"kind": "dielectric", "roughness": 1.0}),
        slow({"kind": "dielectric", "alpha": [0.6, 0.2]}),
        slow({"kind": "principled", "base_color": 1.0, "roughness": 0.7, "transmission": 1.0}),
    ],
    ids=str,
)
def test_lamp_in_a_ball_of_rough_glass_loses_no_light(glass):
    """In a matte sphere, which the ball lights evenly: E = I / R^2 and E / (1 - rho) with all that comes back."""
    sphere = {"shape": "sphere", "center": [0, 0, 0], "radius": 2, "material": {"kind": "matte", "reflectance": 0.3}}
    ball = {"shape": "sphere", "center": [0, 0, 0], "radius": 0.5, "material": glass}
    lamp = {"kind": "point", "position": [0, 0, 0], "intensity": 3.0}
    scene = scene_of([sphere, ball], looking([0.9, -0.6, 0.7], [2, 0, 0], fov=20), depth=40, lights=[lamp])
    scene["render"] |= {"caustics": "off"}
    found = np.array([pixels(scene, seed=seed_of(f"{glass} {number}"), spp=512).mean() for number in range(8)])
    expected = 0.3 / np.pi * 3.0 / 2**2 / (1 - 0.3)
    assert_equivalent(found.mean(), found.std(ddof=1) / np.sqrt(len(found)), expected, 0.03 * expected)


@pytest.mark.parametrize("shape", CONVEX)
def test_grey_convex_body_shows_its_reflectance_and_nothing_else(shape):
    material = {"kind": "matte", "reflectance": [0.5, 0.25, 0.75]}
    film = pixels(furnace(CONVEX[shape], material, depth=3, resolution=(64, 64)), seed=seed_of(shape), spp=4)
    # every sample is 1 or the reflectance: four of them mix in quarters
    share = (1 - film) / (1 - np.array([0.5, 0.25, 0.75]))
    np.testing.assert_allclose(share, np.round(share * 4) / 4, atol=4e-6)
    np.testing.assert_allclose(share[..., 0], share[..., 1], atol=4e-6)
    assert 0.15 < share.mean() <= 1


def test_mirror_shows_the_world_times_its_tint():
    material = {"kind": "mirror", "reflectance": [1.0, 0.5, 0.25]}
    close = looking([0, -3, 0], [0, 0, 0], fov=10)
    film = pixels(scene_of([{**CONVEX["sphere"], "material": material}], close, environment=WHITE, depth=2), spp=4)
    np.testing.assert_allclose(film, np.broadcast_to([1, 0.5, 0.25], film.shape), rtol=ROUND_TRIP)


@pytest.mark.parametrize("index", [0.6, slow(1.0), 1.5, slow(2.4)])
@pytest.mark.parametrize("shape", ["sphere", "ellipsoid", "box"])
def test_glass_vanishes_in_a_white_world(shape, index):
    glass = {"kind": "dielectric", "index": index}
    film = pixels(furnace(CONVEX[shape], glass, depth=200, resolution=(64, 64)), seed=seed_of(shape), spp=8)
    assert film.max() <= 1 + 4e-6
    if shape == "box":  # totally reflected round and round for ever: such paths end black
        assert film.mean() > 0.9
    elif shape == "ellipsoid":  # the same for hundreds of edges, but seldom
        assert film.mean() > 0.9995
    else:
        # two factors 1/n^2 and n^2 per pair of refractions, and nothing else
        np.testing.assert_allclose(film, 1, rtol=4e-6)


@pytest.mark.parametrize("index", [0.8, 1.5])
def test_white_world_is_n_squared_as_bright_inside_glass(index):
    # from the centre every ray meets the surface head on: it leaves, or comes back and tries again
    glass = {**CONVEX["sphere"], "material": {"kind": "dielectric", "index": index}}
    scene = scene_of([glass], looking([0, 0, 0], [1, 0, 0], fov=90), environment=WHITE, depth=40)
    np.testing.assert_allclose(pixels(scene, spp=4), index**2, rtol=4e-6)


def smith_reflectance(alpha, cosine):
    """Share of light that a GGX mirror reflects once, by float64 quadrature over visible normals (Heitz 2014)."""
    # stretched view, uniform visible hemisphere normals on a midpoint grid of the spherical cap (Dupuy 2023)
    u, v = np.meshgrid((np.arange(1200) + 0.5) / 1200, (np.arange(1200) + 0.5) / 1200)
    wi = np.array([math.sqrt(1 - cosine**2), 0, cosine])
    w = wi * [alpha, alpha, 1]
    w /= np.linalg.norm(w)
    z = (1 - v) * (1 + w[2]) - w[2]
    r = np.sqrt(np.clip(1 - z * z, 0, None))
    h = np.stack([r * np.cos(2 * np.pi * u) + w[0], r * np.sin(2 * np.pi * u) + w[1], z + w[2]], -1)
    h *= [alpha, alpha, 1]
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    wo = 2 * (h @ wi)[..., None] * h - wi

    def smith(z):
        return (np.sqrt(1 + alpha**2 * np.clip(1 / z**2 - 1, 0, None)) - 1) / 2

    own, other = smith(cosine), smith(np.where(wo[..., 2] > 0, wo[..., 2], 1.0))
    return float(np.where(wo[..., 2] > 0, (1 + own) / (1 + own + other), 0).mean())


@pytest.mark.parametrize(("alpha", "degrees"), fast([(0.3, 85), (1.0, 60)], product((0.05, 0.3, 1.0), (0, 60, 85))))
def test_rough_metal_reflects_what_single_scattering_leaves(alpha, degrees):
    metal = {"kind": "conductor", "reflectance": 1.0, "alpha": alpha}
    angle = math.radians(degrees)
    ground = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": metal}
    eye = [-math.sin(angle), 0, math.cos(angle)]
    scene = scene_of([ground], looking(eye, [0, 0, 0], 0.001, up=(0, 1, 0)), environment=WHITE, depth=2)
    scene["render"]["multiple_scattering"] = False
    mean, error = flat_mean(scene, f"metal {alpha} {degrees}", spp=512)
    expected = smith_reflectance(alpha, math.cos(angle))
    assert expected < 1
    assert_equivalent(mean, error, expected, 0.005)


GLOSSY = {
    "metal": {"kind": "conductor", "reflectance": 1.0},
    "glass": {"kind": "dielectric", "index": 1.5},
    "principled metal": {"kind": "principled", "base_color": 1.0, "metallic": 1.0},
    "principled glass": {"kind": "principled", "base_color": 1.0, "transmission": 1.0},
}
ROUGHNESSES = (0.1, 0.3, 0.55, 0.8, 1.0)
FRONT = {"kind": "orthographic", "width_m": 1.3, "eye": [0, -3, 0], "target": [0, 0, 0], "up": [0, 0, 1]}


@pytest.mark.parametrize("kind", fast(["principled glass"], GLOSSY))
def test_rough_white_balls_nearly_vanish_in_a_white_world(kind):
    """What facets scatter more than once is not lost, to the fits of their albedos."""
    for roughness in ROUGHNESSES:
        ball = CONVEX["sphere"] | {"material": GLOSSY[kind] | {"roughness": roughness}}
        mean, error = flat_mean(scene_of([ball], FRONT, environment=WHITE, depth=64), f"{kind} {roughness}", spp=256)
        assert (np.abs(mean - 1) < 0.005 + 4 * error).all(), (roughness, mean)


@pytest.mark.parametrize("under", [{"specular": 0.0, "roughness": 0.5}, {"metallic": 1.0, "roughness": 0.3}])
def test_clear_coat_over_white_takes_no_light(under):
    for roughness in ROUGHNESSES:
        coated = {"kind": "principled", "base_color": 1.0, "clearcoat": 1.0, "clearcoat_roughness": roughness} | under
        scene = scene_of([CONVEX["sphere"] | {"material": coated}], FRONT, environment=WHITE, depth=2)
        mean, error = flat_mean(scene, f"coat {roughness}", spp=256)
        assert (np.abs(mean - 1) < 0.005 + 4 * error).all(), (roughness, mean)


def mirror(reflectance):
    return {"kind": "mirror", "reflectance": [reflectance] * 3}


def lit_cavity(radius, reflectance, depth, roulette=0):
    """Inside a matte sphere with a point light at its centre, which every vertex sees at the same distance."""
    wall = {"shape": "sphere", "center": [0, 0, 0], "radius": radius, "material": {**MATTE, "reflectance": reflectance}}
    light = {"kind": "point", "position": [0, 0, 0], "intensity": [radius**2 * math.pi] * 3}
    camera = looking([0.3 * radius, -0.4 * radius, 0.1 * radius], [radius, radius, 0], fov=100)
    return scene_of([wall], camera, lights=[light], depth=depth, roulette=roulette)


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("depth", [1, 2, 5, 9])
@pytest.mark.parametrize("reflectance", [0.5, 0.8, 1.0])
def test_every_sample_in_a_cavity_is_the_truncated_series(radius, reflectance, depth):
    # vertex k adds reflectance^k; max_depth edges have max_depth - 1 vertices that the light can reach
    expected = sum(reflectance**k for k in range(1, depth))
    film = pixels(lit_cavity(radius, reflectance, depth), seed=seed_of("cavity"), spp=4)
    np.testing.assert_allclose(film, expected, rtol=2e-6 + 1e-6 * depth)


@pytest.mark.parametrize("roulette", [1, slow(2), slow(4)])
def test_roulette_changes_no_mean(roulette):
    series = sum(0.8**k for k in range(1, 12))
    mean, error = flat_mean(lit_cavity(1.0, 0.8, 12, roulette), f"roulette {roulette}", spp=2000)
    assert_equivalent(mean, error, series, 0.005 * series)


def test_roulette_ends_paths():
    film = pixels(lit_cavity(1.0, 0.8, 12, 1), seed=seed_of("roulette"), spp=4)
    assert film.std() > 0.1


def test_roulette_is_kinder_than_the_throughput():
    # the first vertex adds 1/2, the second 1/4, and the path goes on with twice this chance to a third, where it adds
    # 1/8 over that; the picture is as bright everywhere, up to the few samples that say so
    film = pixels(lit_cavity(1.0, 0.5, 4, 2), seed=seed_of("lit"), spp=1)
    more = film > 0.8
    np.testing.assert_allclose(film, np.where(more, 0.75 + 0.125 / 0.5, 0.75), rtol=0.02)
    assert more.mean() == pytest.approx(0.5, abs=0.063)  # four standard errors of 1024 pixels


def test_roulette_of_a_path_without_light_is_four_times_as_kind():
    # a plane of reflectance r < 1/4 below a white sky: a path goes on with the chance 4 r, and brings 1/4 then
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": {**MATTE, "reflectance": 0.2}}
    camera = looking([0, 0, 1], [0, 0, 0], up=(0, 1, 0))
    film = pixels(scene_of([floor], camera, depth=2, roulette=1, environment=WHITE), spp=1, seed=seed_of("unlit"))
    np.testing.assert_allclose(film, np.where(film > 0, 0.25, 0), rtol=1e-6)
    assert (film > 0).mean() == pytest.approx(0.8, abs=0.05)  # four standard errors of 1024 pixels


def test_roulette_spares_paths_where_the_picture_is_dark():
    # mirrors under a white sky, their edge between tiles: the scout sees hardly any of what the dark one reflects
    bright = {"shape": "rectangle", "corner": [-2, -2, 0], "edge_u": [2, 0, 0], "edge_v": [0, 4, 0]}
    dark = {"shape": "rectangle", "corner": [0, -2, 0], "edge_u": [2, 0, 0], "edge_v": [0, 4, 0]}
    floor = [{**bright, "material": mirror(0.5)}, {**dark, "material": mirror(0.02)}]
    scene = scene_of(floor, looking([0, 0, 1], [0, 0, 0], up=(0, 1, 0)), depth=2, roulette=1, environment=WHITE)
    film = pixels(scene, spp=1, seed=seed_of("dark"))
    np.testing.assert_allclose(film[:, :16], 0.5, rtol=1e-5)
    np.testing.assert_allclose(film[:, 16:], 0.02, rtol=1e-5)


def test_roulette_lets_go_on_one_of_twenty_at_least():
    # a mirror of reflectance 1e-3 fills the picture: four times that is less than the least chance
    floor = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": mirror(1e-3)}
    camera = looking([0, 0, 1], [0, 0, 0], up=(0, 1, 0))
    scene = scene_of([floor], camera, depth=2, roulette=1, environment=WHITE, resolution=(128, 128))
    film = pixels(scene, spp=1, seed=seed_of("least"))
    np.testing.assert_allclose(film[film > 0].max(), 0.02, rtol=1e-5)


def test_roulette_keeps_the_mean_of_coloured_walls():
    reflectance = [0.9, 0.5, 0.1]
    series = np.array([sum(r**k for k in range(1, 10)) for r in reflectance])
    mean, error = flat_mean(lit_cavity(1.0, reflectance, 10, 1), "coloured roulette", spp=2000)
    assert_equivalent(mean, error, series, 0.006 * series)


@pytest.mark.parametrize("roulette", [slow(0), 2])
def test_lamp_in_a_cavity_gives_the_series_of_form_factors(roulette):
    # a lamp of radius a in the middle of a sphere of radius 1: seen from the wall it fills a^2 of the cosine-weighted
    # hemisphere, and what it hides is lost, since it reflects nothing
    a, reflectance, depth = 0.4, 0.7, 7
    wall = {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {**MATTE, "reflectance": reflectance}}
    lamp = {"shape": "sphere", "center": [0, 0, 0], "radius": a, "material": {"kind": "emissive", "radiance": 1.0}}
    camera = looking([0, -0.8, 0], [0, -2, 0], fov=60)
    mean, error = flat_mean(
        scene_of([wall, lamp], camera, depth=depth, roulette=roulette), f"lamp {roulette}", spp=2000
    )
    expected = reflectance * a**2 * sum((reflectance * (1 - a**2)) ** k for k in range(depth - 1))
    assert_equivalent(mean, error, expected, 0.005 * expected)
