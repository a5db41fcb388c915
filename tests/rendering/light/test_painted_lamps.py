"""Lamps with a texture: what arrives from them, against quadrature in float64."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.load import load_scene
from tests.rendering.light.pictures import save_exr
from tests.rendering.light.test_environment_pictures import batches
from tests.rendering.light.test_textures import expected_colours
from tests.rendering.pictures import MATTE, looking, scene_of, seed_of
from tests.support.statistics import assert_equivalent, assert_same_tiles

GROUND = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}
PICTURE = np.random.default_rng(8).random((5, 8, 3)) ** 3
GLOW = {"kind": "emissive", "radiance": {"kind": "image", "file": "glow.exr", "gain": 5}}
# Under the ground, and too small to be chosen: with them one program renders all lamps.
SPECKS = [
    {"shape": "rectangle", "corner": [0, 0, -9], "edge_u": [0, 1e-5, 0], "edge_v": [1e-5, 0, 0], "material": GLOW},
    {"shape": "disk", "center": [1, 0, -9], "normal": [0, 0, -1], "radius": 1e-5, "material": GLOW},
    {"shape": "sphere", "center": [0, 0, 0], "radius": 1e-5, "material": GLOW,
     "transform": [{"rotate": {"axis": [1, 2, 0], "degrees": 50}}, {"translate": [2, 0, -9]}]},
    {"shape": "box", "min": [3, 0, -9], "max": [3.00001, 0.00001, -8.99999], "material": GLOW},
    {"shape": "cylinder", "base": [4, 0, -9], "top": [4, 0, -8.99999], "radius": 1e-5, "capped": False,
     "material": GLOW},
    {"shape": "mesh", "vertices": [[5, 0, -9], [5, 1e-5, -9], [5.00001, 0, -9]], "faces": [[0, 1, 2]],
     "uvs": [[0, 0], [1, 0], [0, 1]], "material": GLOW},
]  # fmt: skip
COUNT = 400
STEPS = (np.arange(COUNT) + 0.5) / COUNT


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_exr(tmp_path / "glow.exr", PICTURE)
    return tmp_path


def assert_irradiance(folder, lamp, expected, name) -> None:
    camera = looking([-0.1, -0.1, 0.03], [0, 0, 0], fov=0.0002)
    scene = load_scene(scene_of([GROUND, lamp, *SPECKS], camera, depth=2, resolution=(64, 64)), base_dir=folder)
    film = np.pi * np.asarray(rptcam_cl.render(scene, spp=128, seed=seed_of(name)), np.float64).reshape(-1, 3)
    assert_equivalent(film.mean(axis=0), film.std(axis=0) / 64, expected, 0.01 * expected)


def irradiance(points, normals, areas, colours):
    """Return the irradiance of the ground at the origin from patches that face it or not."""
    distance2 = (points**2).sum(axis=1)
    facing = np.maximum(-(normals * points).sum(axis=1), 0) * np.maximum(points[:, 2], 0) / distance2**2
    return (colours * (facing * areas)[:, None]).sum(axis=0)


def flat(corner, x, y, place):
    """Return the irradiance from corner + a x + b y for all (a, b) of ``place``, each with its share of the area."""
    a, b, share = place
    points = np.asarray(corner) + a[:, None] * np.asarray(x) + b[:, None] * np.asarray(y)
    normal = np.cross(x, y)
    area = np.linalg.norm(normal)
    colours = 5 * expected_colours(PICTURE, np.stack([a, b]), "repeat")
    return irradiance(points, np.broadcast_to(normal / area, points.shape), area * share, colours)


def square():
    a, b = (grid.ravel() for grid in np.meshgrid(STEPS, STEPS))
    return a, b, np.full(COUNT**2, 1 / COUNT**2)


@pytest.mark.slow
def test_painted_rectangle(folder) -> None:
    corner, x, y = [-0.4, -0.2, 0.8], [0, 1.2, 0], [1.1, 0, 0.2]
    lamp = {"shape": "rectangle", "corner": corner, "edge_u": x, "edge_v": y, "material": GLOW}
    assert_irradiance(folder, lamp, flat(corner, x, y, square()), "rectangle")


@pytest.mark.slow
def test_painted_disk(folder) -> None:
    lamp = {"shape": "disk", "center": [0.2, 0.1, 1], "normal": [0, 0, -1], "radius": 0.7, "material": GLOW}
    a, b, share = square()
    a, b = 2 * a - 1, 2 * b - 1
    inside = a**2 + b**2 <= 1
    # +z turned to -z about x: x stays, y goes to -y
    expected = flat([0.2, 0.1, 1], [0.7, 0, 0], [0, -0.7, 0], (a[inside], b[inside], 4 * share[inside]))
    assert_irradiance(folder, lamp, expected, "disk")


@pytest.mark.parametrize("mirror", [1, -1])
def test_painted_sphere(folder, mirror) -> None:
    turn = [{"scale": [mirror, 1, 1]}, {"rotate": {"axis": [1, 2, 0], "degrees": 50}}, {"translate": [0.3, 0.1, 1.2]}]
    lamp = {"shape": "sphere", "center": [0, 0, 0], "radius": 0.5, "material": GLOW, "transform": turn}
    u, v, _ = square()
    polar, longitude = np.pi * v, 2 * np.pi * u
    unit = np.stack([np.sin(polar) * np.cos(longitude), np.sin(polar) * np.sin(longitude), -np.cos(polar)], axis=1)
    axis, angle = np.array([1, 2, 0]) / np.sqrt(5), np.deg2rad(50)
    cross = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
    turned = unit * [mirror, 1, 1] @ (np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross).T
    areas = 0.25 * np.sin(polar) * 2 * np.pi**2 / COUNT**2
    colours = 5 * expected_colours(PICTURE, np.stack([u, v]), "repeat")
    expected = irradiance([0.3, 0.1, 1.2] + 0.5 * turned, turned, areas, colours)
    assert_irradiance(folder, lamp, expected, f"sphere {mirror}")


def test_painted_box(folder) -> None:
    # from the ground below only its bottom is seen, whose u and v go along x and y
    low, size = np.array([-0.4, -0.2, 0.8]), np.array([1.1, 0.9, 0.3])
    lamp = {"shape": "box", "min": low.tolist(), "max": (low + size).tolist(), "material": GLOW}
    a, b, share = square()
    points = low + np.stack([a, b, np.zeros_like(a)], axis=1) * size
    colours = 5 * expected_colours(PICTURE, np.stack([a, b]), "repeat")
    down = np.broadcast_to([0.0, 0.0, -1.0], points.shape)
    assert_irradiance(folder, lamp, irradiance(points, down, size[0] * size[1] * share, colours), "box")


def test_painted_cylinder(folder) -> None:
    base, radius, height = np.array([0.3, 0.2, 1.0]), 0.4, 0.7
    lamp = {"shape": "cylinder", "base": base.tolist(), "top": [0.3, 0.2, 1.7], "radius": radius, "capped": False}
    a, b, share = square()
    around = np.stack([np.cos(2 * np.pi * a), np.sin(2 * np.pi * a), np.zeros_like(a)], axis=1)
    points = base + radius * around + height * b[:, None] * [0, 0, 1]
    colours = 5 * expected_colours(PICTURE, np.stack([a, b]), "repeat")
    expected = irradiance(points, around, 2 * np.pi * radius * height * share, colours)
    assert_irradiance(folder, {**lamp, "material": GLOW}, expected, "cylinder")


def test_painted_mesh(folder) -> None:
    # the rectangle as two triangles, with corners out of order
    corner, x, y = np.array([-0.4, -0.2, 0.8]), np.array([0, 1.2, 0]), np.array([1.1, 0, 0.2])
    corners = [corner, corner + x, corner + y, corner + x + y]
    mesh = {"vertices": [c.tolist() for c in corners], "faces": [[1, 3, 0], [2, 0, 3]]}
    lamp = {"shape": "mesh", **mesh, "uvs": [[0, 0], [1, 0], [0, 1], [1, 1]], "material": GLOW}
    assert_irradiance(folder, lamp, flat(corner, x, y, square()), "mesh")


@pytest.mark.slow
def test_picture_is_the_same_without_light_sampling(folder) -> None:
    lamps = [
        {"shape": "rectangle", "corner": [-1, 1, 0], "edge_u": [2, 0, 0], "edge_v": [0, 0, 1.5], "material": GLOW},
        {"shape": "sphere", "center": [0.3, -0.5, 0.4], "radius": 0.3, "material": GLOW},
    ]
    camera = looking([0, -4, 2], [0, 0, 0.4])
    scene = load_scene(scene_of([GROUND, *lamps], camera, depth=2, resolution=(32, 24)), base_dir=folder)
    plan = make_plan(scene)
    off = {fact: 0 for fact in plan.facts if "EMITTER" in fact}
    alone = replace(plan, facts={**plan.facts, **off})
    both, bsdf = batches(scene, plan, "lamps", 6, 32), batches(scene, alone, "lamps bsdf", 6, 256)
    assert_same_tiles(both, bsdf)


def test_black_texture_is_not_sampled(tmp_path: Path) -> None:
    save_exr(tmp_path / "glow.exr", np.zeros((2, 2, 3)))
    lamp = {"shape": "disk", "center": [0, 0, 1], "normal": [0, 0, -1], "radius": 0.5, "material": GLOW}
    scene = scene_of([GROUND, lamp], looking([0, -4, 2], [0, 0, 0]), depth=2)
    assert make_plan(load_scene(scene, base_dir=tmp_path)).emitters.count == 0
