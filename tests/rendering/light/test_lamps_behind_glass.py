"""Lamps behind clear glass: closed forms of their light, and the pictures of paths that find them by chance."""

import numpy as np
import pytest

from rptcam_cl.device.session import Session
from rptcam_cl.rendering import tracer
from rptcam_cl.rendering.plan import plan as plans
from rptcam_cl.scene.load import load_scene
from tests.device.probes import open_session
from tests.rendering.light.pictures import save_exr
from tests.rendering.pictures import batches, looking, pixels, scene_of, seed_of
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent, assert_same_tiles, overall

WHITE = {"kind": "matte", "reflectance": 1.0}
FLOOR = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": WHITE}
DOWN = looking([0.9, 0, 0.5], [0.9, 0, 0], fov=1.0, up=(0, 1, 0))
LAMP = {"kind": "emissive", "radiance": [9.0, 6.0, 3.0]}
GLASS = {"kind": "dielectric", "index": 1.5}
CENTRE, OUTER, INNER, LAMP_RADIUS = np.array([0.0, 0.0, 1.0]), 0.4, 0.36, 0.2


def ball(radius, material, center=CENTRE):
    return {"shape": "sphere", "center": [*map(float, center)], "radius": radius, "material": material}


def pane(height, material):
    return {"shape": "rectangle", "corner": [-3, -3, height], "edge_u": [6, 0, 0], "edge_v": [0, 6, 0],
            "material": material}  # fmt: skip


GLOBE = [FLOOR, ball(OUTER, GLASS), ball(INNER, {"kind": "dielectric", "index": 1 / 1.5}), ball(LAMP_RADIUS, LAMP)]
CEILING_LAMP = {"shape": "rectangle", "corner": [-0.3, -0.2, 1.4], "edge_u": [0, 0.4, 0], "edge_v": [0.6, 0, 0],
                "material": LAMP}  # fmt: skip


def transmitted(sine, index=1.5):
    """Share of light that one surface of glass lets pass, by the sine outside."""
    cosine, inside = np.sqrt(1 - sine**2), np.sqrt(1 - (sine / index) ** 2)
    across = (cosine - index * inside) / (cosine + index * inside)
    along = (index * cosine - inside) / (index * cosine + inside)
    return 1 - (across**2 + along**2) / 2


def radiosity_under_globe(place):
    """Irradiance over pi: a ray keeps its distance from the centre of concentric spheres, by Bouguer's formula."""
    to = CENTRE - place
    distance = np.linalg.norm(to)
    nodes, weights = np.polynomial.legendre.leggauss(200)
    sine = LAMP_RADIUS / distance * (nodes + 1) / 2
    passed = distance * sine
    share = transmitted(passed / OUTER) * transmitted(passed / INNER)
    # the mean of the cosine to the floor over a circle about the axis is that of the axis times that to the axis
    ring = 2 * np.pi * sine * to[2] / distance * share  # d(omega) cos = 2 pi sin d(sin)
    return float((ring * weights).sum() * LAMP_RADIUS / distance / 2 / np.pi)


def radiosity_under_pane(place):
    nodes, weights = np.polynomial.legendre.leggauss(60)
    x, y = np.meshgrid(0.3 * nodes, 0.2 * nodes)
    to = np.stack([x, y, np.full_like(x, 1.4)], axis=-1) - place
    d2 = (to**2).sum(axis=-1)
    cosine = 1.4 / np.sqrt(d2)
    once = transmitted(np.sqrt(1 - cosine**2))
    share = once / (2 - once)  # both faces and all reflections between them
    return float((cosine**2 / d2 * share * np.outer(weights, weights)).sum() * 0.3 * 0.2 / np.pi)


def radiosity_under_sun(_):
    """Of the smallest of suns, whose irradiance is 1 where it is faced."""
    once = transmitted(np.sin(SLANT))
    return float(np.cos(SLANT) * once / (2 - once) / np.pi)


def radiosity_under_sky(_):
    """Of all directions above, whose radiance is 1."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    angle = np.pi / 4 * (nodes + 1)
    once = transmitted(np.sin(angle))
    return float((2 * np.cos(angle) * np.sin(angle) * once / (2 - once)) @ weights * np.pi / 4)


THIN = {"kind": "thin_glass", "index": 1.5}
PANED = [FLOOR, pane(0.8, THIN), CEILING_LAMP]
SLANT = 0.9  # radians from straight down
SUN = {"kind": "sun", "direction": [np.sin(SLANT), 0, -np.cos(SLANT)], "irradiance": LAMP["radiance"]}
SUNNY = {"lights": [SUN]}
SKY = {"environment": {"kind": "image", "file": "glow.exr", "up": [0, 0, 1]}}
ROOF = pane(0.8, THIN) | {"corner": [-3e3, -3e3, 0.8], "edge_u": [6e3, 0, 0], "edge_v": [0, 6e3, 0]}
DARK_FLOOR = FLOOR | {"material": {"kind": "matte", "reflectance": 1e-3}}  # else the slab sends its light back
SLAB = {"shape": "box", "min": [-30, -30, 0.6], "max": [30, 30, 0.62], "material": GLASS}


@pytest.mark.parametrize(
    ("objects", "rest", "edges", "expected"),
    [
        slow(GLOBE, {}, 4, radiosity_under_globe),
        slow(PANED, {}, 3, radiosity_under_pane),
        ([DARK_FLOOR, SLAB], SUNNY, 12, lambda place: 1e-3 * radiosity_under_sun(place)),
        slow([FLOOR, ROOF], SUNNY, 3, radiosity_under_sun),
        slow([FLOOR, ROOF], SKY, 3, radiosity_under_sky),
    ],
)
def test_floor_has_the_light_that_glass_lets_pass(objects, rest, edges, expected, tmp_path):
    above = np.repeat([[LAMP["radiance"]], [[0.0, 0.0, 0.0]]], 128, axis=0)
    save_exr(tmp_path / "glow.exr", above.astype(np.float32))
    scene = load_scene(scene_of(objects, DOWN, depth=edges, resolution=(16, 16), **rest), base_dir=tmp_path)
    assert plans.make_plan(scene).facts["LAMPS_BEHIND_GLASS"] == 1
    light = batches(scene, "floor under glass", 4, spp=4096)
    mean, error = light.mean.mean(axis=(0, 1)), np.sqrt(light.variance.mean(axis=(0, 1)) / light.mean[..., 0].size)
    wanted = expected(np.array([0.9, 0.0, 0.0])) * np.array(LAMP["radiance"])
    assert_equivalent(mean, error, wanted, 2e-3 * wanted)  # three standard errors, and the width of the picture


def test_no_light_comes_by_paths_that_are_too_long():
    slab = [scene_of([DARK_FLOOR, SLAB], DOWN, depth=depth, resolution=(16, 16), **SUNNY) for depth in (3, 4)]
    assert pixels(slab[0], spp=16).max() == 0 < pixels(slab[1], spp=16).min()


SHINY = FLOOR | {"material": {"kind": "plastic", "reflectance": 0.5, "roughness": 0.15}}  # too much to take photons
WALL = {"shape": "rectangle", "corner": [-3, 3, 0], "edge_u": [6, 0, 0], "edge_v": [0, 0, 2], "material": WHITE}
ENDLESS = {"shape": "plane", "point": [0, 0, 1], "normal": [0, 0, 1], "material": THIN}  # where no photon starts


@pytest.mark.parametrize(
    ("objects", "rest", "within"),
    [
        slow([SHINY, WALL, pane(0.8, THIN)], SUNNY, 1e-3),
        slow([FLOOR, pane(0.8, THIN), ENDLESS, ball(0.5, LAMP, (0.9, 0, 1.6))], {}, 0.05),
    ],
)
def test_light_that_photons_do_not_bring_comes_as_without_them(objects, rest, within):
    scene = scene_of(objects, DOWN, resolution=(16, 16), **rest)
    lit = scene | {"render": scene["render"] | {"caustics": "on"}}
    facts = plans.make_plan(load_scene(lit)).facts
    assert (facts["CAUSTICS"], facts["LAMPS_BEHIND_GLASS"]) == (1, 1)
    by_samples, beside_photons = (pixels(each, spp=64).mean() for each in (scene, lit))
    assert beside_photons == pytest.approx(by_samples, rel=within)


TINTED = {"kind": "dielectric", "index": 1.5, "transmittance": [0.9, 0.6, 0.3]}
SMOKED = {"kind": "dielectric", "index": 1.5, "absorption_per_m": [1.0, 3.0, 9.0]}
FLINT = {"kind": "dielectric", "glass": "SF6"}
BOWL = [FLOOR, ball(OUTER, GLASS)]
FILAMENT = {
    "shape": "mesh", "vertices": [[-0.2, -0.2, 0.9], [0.2, -0.2, 0.9], [0.2, 0.2, 0.9], [-0.2, 0.2, 1.1]],
    "faces": [[0, 2, 1], [0, 3, 2]], "material": LAMP,
}  # fmt: skip
DISK = {"shape": "disk", "center": [0.1, 0, 1], "normal": [0.3, 0, -1], "radius": 0.2, "material": LAMP}
BOX = {"shape": "box", "min": [-1, -1, 0.5], "max": [1, 1, 0.6], "material": SMOKED}
PLASTIC = FLOOR | {"material": {"kind": "plastic", "reflectance": 0.5, "alpha": 0.2}}
GLOW = {"kind": "principled", "base_color": [0.9, 0.8, 0.8], "roughness": 0.5, "emission": [5.0, 4.0, 3.0]}
PAINTED = LAMP | {"radiance": {"kind": "image", "file": "glow.exr"}}
LOW_SUN = {"lights": [SUN | {"diameter_degrees": 20}]}
SEEN = looking([2.4, -1.0, 1.2], [0, 0, 0.4], fov=50)
CASES = {
    "globe": (GLOBE, {}),
    "solid": ([*BOWL, ball(LAMP_RADIUS, LAMP)], {}),
    "tinted": ([PLASTIC, ball(OUTER, TINTED), ball(LAMP_RADIUS, LAMP)], {}),
    "smoked box": ([FLOOR, BOX, CEILING_LAMP, ball(0.3, LAMP, (1, 0, 1.2))], {}),
    "filament": ([*BOWL, ball(INNER, {"kind": "dielectric", "index": 1 / 1.5}), FILAMENT], {}),
    "disk": ([*BOWL, DISK], {}),
    "panes": ([*PANED[:2], ball(0.3, PAINTED, (1, 0, 1.2)), CEILING_LAMP | {"material": PAINTED}], {}),
    "flint": ([FLOOR, ball(OUTER, FLINT), ball(LAMP_RADIUS, LAMP)], {}),
    "spectral": ([FLOOR, ball(OUTER, FLINT), ball(LAMP_RADIUS, LAMP)], {"spectrum": {"mode": "spectral"}}),
    "low sun": ([PLASTIC, SLAB, ball(0.2, WHITE)], LOW_SUN),
    "sky": (
        [FLOOR, pane(0.8, THIN), BOX],
        {**SKY, "lights": [SUN | {"diameter_degrees": 20}], "spectrum": {"mode": "spectral"}},
    ),
    "lobes": (
        [
            FLOOR,
            {
                "shape": "rectangle",
                "corner": [-2, 1.5, 0],
                "edge_u": [4, 0, 0],
                "edge_v": [0, 0, 2],
                "material": {"kind": "principled", "base_color": 0.6, "roughness": 0.5},
            },
            {"shape": "box", "min": [-1.2, 0.1, 0.3], "max": [-0.5, 0.8, 1], "material": WHITE},
            ball(0.1, GLOW),
            {"shape": "cylinder", "base": [0, 0, 0.7], "top": [0, 0, 1.3], "radius": 0.25, "material": THIN},
            ball(0.1, LAMP, (0.5, 0.5, 1.8)),
        ],
        {},
    ),
    "many": ([*GLOBE, *(ball(0.1, LAMP, (x, 1, z)) for x in (-1, 0, 1) for z in (0.5, 1.0, 1.5))], {}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_picture_is_that_of_paths_that_find_lamps_by_chance(name, monkeypatch, tmp_path):
    save_exr(tmp_path / "glow.exr", 8.0 * (np.random.default_rng(5).random((4, 6, 3)) > 0.5))
    objects, rest = CASES[name]
    scene = load_scene(scene_of(objects, SEEN, depth=8, resolution=(24, 16), **rest), base_dir=tmp_path)
    assert plans.make_plan(scene).facts["LAMPS_BEHIND_GLASS"] == 1
    followed = batches(scene, name, 8, spp=2048)
    monkeypatch.setattr(plans, "stand_behind_glass", lambda *_: False)
    assert plans.make_plan(scene).facts["LAMPS_BEHIND_GLASS"] == 0
    by_chance = batches(scene, name, 8, spp=12288)
    assert_same_tiles(followed, by_chance)
    one, other = overall(followed), overall(by_chance)
    assert_equivalent(one.mean / other.mean, np.sqrt(one.variance + other.variance) / other.mean, 1.0, 1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lobes", "globe", "spectral", "filament", "low sun", "many"])
def test_both_organisations_and_widths_render_the_same(name, monkeypatch):
    """A compiler let paths count twice in sixteen lanes alone (`departure_of` of integrator/path.h)."""
    films = []
    for organisation, lanes in (("stream", 16), ("passes", 8)):
        monkeypatch.setattr(tracer, "ORGANISATION", dict.fromkeys(tracer.ORGANISATION, organisation))
        monkeypatch.setattr(Session, "lanes", lanes)
        objects, rest = CASES[name]
        scene = scene_of(objects, SEEN, resolution=(16, 16), **rest)
        films.append(pixels(scene, spp=16, seed=seed_of(name), device=open_session()))
    np.testing.assert_allclose(*films, rtol=1e-5, atol=1e-6)
