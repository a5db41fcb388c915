"""Light sampling of boxes, ellipsoids, cylinders and cones under affine maps: densities, counts, solid angles."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.records import Kind
from rptcam_cl.rendering.plan.emitters import area_of_solid
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.primitives import scene_primitives
from rptcam_cl.scene.load import load_scene
from tests.rendering.light.lamps import lit, picks, unit_numbers
from tests.rendering.light.test_environment_pictures import batches
from tests.rendering.pictures import MATTE, flat_mean, lamp, looking, scene_of, seed_of
from tests.support.cases import fast
from tests.support.statistics import ALPHA, assert_equivalent, assert_same_tiles, chi_squared, sidak

COUNT = 1 << 16
SHAPES = {
    "box": {"shape": "box", "min": [-0.5, -0.5, -0.5], "max": [0.5, 0.5, 0.5]},
    "ellipsoid": {"shape": "sphere", "center": [0, 0, 0], "radius": 0.5},
    "cylinder": {"shape": "cylinder", "base": [0, 0, -0.5], "top": [0, 0, 0.5], "radius": 0.4, "capped": False},
    "cone": {"shape": "cone", "base": [0, 0, -0.5], "apex": [0, 0, 0.5], "radius": 0.4, "capped": False},
}
KINDS = {"box": Kind.BOX, "ellipsoid": Kind.ELLIPSOID, "cylinder": Kind.CYLINDER, "cone": Kind.CONE}
MAPS = {
    "skewed and mirrored": [
        {"scale": [1.0, 0.4, 2.0]}, {"rotate": {"axis": [1, 2, 3], "degrees": 50}}, {"scale": [1.5, -0.7, 1]},
    ],
    "thin": [{"scale": [1.0, 0.8, 1e-3]}, {"rotate": {"axis": [2, 1, 0], "degrees": 35}}],
    "long": [{"scale": [0.02, 0.03, 2.0]}, {"rotate": {"axis": [1, 0, 0], "degrees": 70}}],
}  # fmt: skip
PLACES = {"skewed and mirrored": [0, 0, 4], "thin": [0, 4, 0], "long": [4, 0, 0]}
POINTS = {"near": [0.5, 0.6, 1.9], "far": [-3.0, 1.0, -30.0], "aside": [-1.5, 2.0, 0.2]}  # from the middle of a lamp
CASES = [(shape, name) for shape in SHAPES for name in MAPS]
LEVEL = sidak(ALPHA, len(SHAPES) * len(POINTS))


def every_lamp():
    """Every shape under every map, each with a radiance that makes them about as likely."""
    objects = []
    for shape, name in CASES:
        x, y, z = PLACES[name]
        transform = [*MAPS[name], {"translate": [x, y, z + 40.0 * list(SHAPES).index(shape)]}]
        objects.append({**SHAPES[shape], "transform": transform, "material": lamp(1.0), "name": f"{shape} {name}"})
    return load_scene(scene_of(objects, looking([0, 0, 0], [1, 1, 0])))


@pytest.fixture(scope="module")
def scene():
    return every_lamp()


@pytest.fixture(scope="module")
def plan(scene):
    return make_plan(scene)


def placed(scene, shape, name):
    """Return index among the primitives, placement and object of a lamp."""
    index = CASES.index((shape, name))
    primitives = scene_primitives(scene)
    found = next(i for i, primitive in enumerate(primitives) if primitive.object == index)
    return found, primitives[found].placement


def surface(kind, steps=300):
    """Return points of a canonical shape by cells (…, steps + 1, steps + 1, 3), whose cells turn outwards."""
    a, b = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1), indexing="ij")
    turn = 2 * np.pi * a
    if kind == "box":
        square = np.stack([2 * a - 1, 2 * b - 1, np.ones_like(a)], axis=-1)
        behind = square * [-1, 1, -1]
        return np.stack([np.roll(side, shift, axis=-1) for side in (square, behind) for shift in range(3)])
    if kind == "ellipsoid":
        polar = np.pi * b
        return np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), -np.cos(polar)], axis=-1)[None]
    radius = np.ones_like(b) if kind == "cylinder" else 1 - b
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), b], axis=-1)[None]


def cells_of(shape, placement):
    """Return middles and area vectors, outwards, of the cells of a placed shape."""
    points = surface(shape) @ placement[:3, :3].T + placement[:3, 3]
    near, right, up, far = points[:, :-1, :-1], points[:, 1:, :-1], points[:, :-1, 1:], points[:, 1:, 1:]
    area = np.cross(far - near, up - right) / 2 * np.sign(np.linalg.det(placement[:3, :3]))
    return ((near + right + up + far) / 4).reshape(-1, 3), area.reshape(-1, 3)


def solid_angle(shape, placement, point):
    """Return the solid angle of the outside that a point sees, by quadrature of flat cells."""
    middle, area = cells_of(shape, placement)
    to = middle - point
    return float((np.maximum(-(area * to).sum(axis=1), 0) / np.linalg.norm(to, axis=1) ** 3).sum())


@pytest.mark.parametrize(("shape", "name"), CASES)
def test_area_of_a_solid_is_that_of_its_cells(scene, shape, name) -> None:
    _, placement = placed(scene, shape, name)
    _, area = cells_of(shape, placement)
    found = area_of_solid(KINDS[shape], placement[:3, :3])
    # edges of a thin ellipsoid bend within a step of either quadrature
    assert found == pytest.approx(np.linalg.norm(area, axis=1).sum(), rel=2e-3)


def sampled(session, scene, plan, shape, name, point, count=COUNT):
    """Return samples of one lamp at a point beside it, with density and weight freed of its pick."""
    index, placement = placed(scene, shape, name)
    number, chance = picks(plan, int(plan.primitives["emitter"][index]))
    numbers = unit_numbers(count, seed_of(f"{shape} {name}"))
    numbers[:, 0] = number
    centre = placement @ [0, 0, 0.5 if shape in ("cylinder", "cone") else 0, 1]
    at = centre[:3] + point
    got = lit(session, plan, at, numbers)
    assert (got.primitive == index).all()
    return at, got, got.pdf / chance, chance


@pytest.mark.parametrize(("shape", "name"), fast([(shape, "skewed and mirrored") for shape in SHAPES], CASES))
def test_weights_add_up_to_the_solid_angle(session, scene, plan, shape, name) -> None:
    for place, point in POINTS.items():
        at, _, pdf, _ = sampled(session, scene, plan, shape, name, point)
        weight = np.where(pdf > 0, 1 / np.where(pdf > 0, pdf, 1), 0)
        _, placement = placed(scene, shape, name)
        expected = solid_angle(shape, placement, at)
        if expected == 0:  # a flat cone seen from within
            assert (pdf == 0).all()
            continue
        # the quadrature's cells are flat: good to 1e-4 of round shapes
        assert_equivalent(weight.mean(), weight.std() / math.sqrt(COUNT), expected, 0.04 * expected)
        assert weight.std() < 1.5 * weight.mean(), (place, weight.std() / weight.mean())
        if place == "far":
            assert weight.std() < 0.1 * weight.mean()


@pytest.mark.parametrize(("shape", "name"), CASES)
def test_density_of_a_sample_is_that_of_its_direction(session, scene, plan, shape, name) -> None:
    for point in POINTS.values():
        at, got, pdf, chance = sampled(session, scene, plan, shape, name, point, 1 << 14)
        again = lit(session, plan, at, directions=got.direction)
        index, _ = placed(scene, shape, name)
        met = (again.met == index) & (pdf > 0)
        if not (pdf > 0).any():
            continue
        assert met.mean() > 0.99  # those on the outline may miss by rounding
        # a generator of a cone is found from its angle, good to 1e-7 turns: more of what is seen where that is narrow
        close = np.isclose(again.density[met] / chance, pdf[met], rtol=5e-3)
        assert close.mean() > 0.995
        np.testing.assert_allclose(np.median(again.density[met] / chance / pdf[met]), 1, rtol=1e-4)
        np.testing.assert_allclose(again.distance[met], got.reach[met], rtol=2e-3)


@pytest.mark.parametrize("shape", SHAPES)
def test_counts_follow_the_density(session, scene, plan, shape) -> None:
    name = "skewed and mirrored"
    index, placement = placed(scene, shape, name)
    for point in POINTS.values():
        at, got, _, chance = sampled(session, scene, plan, shape, name, point)
        # cells of the plane across the way to the lamp, wide enough for all of it
        axis = placement[:3] @ [0, 0, 0.5 if shape in ("cylinder", "cone") else 0, 1] - at
        axis /= np.linalg.norm(axis)
        side = np.cross(axis, [1, 0, 0] if abs(axis[0]) < 0.8 else [0, 1, 0])
        side /= np.linalg.norm(side)
        frame = np.stack([side, np.cross(axis, side), axis])
        local = got.direction @ frame.T
        flat = local[:, :2] / local[:, 2:]
        low, high = flat.min(axis=0), flat.max(axis=0)
        cells, fine = 32, 8
        steps = (np.arange(cells * fine) + 0.5) / (cells * fine)
        grid = np.stack(np.meshgrid(*(low[k] + (high[k] - low[k]) * steps for k in range(2)), indexing="ij"), axis=-1)
        rays = np.concatenate([grid, np.ones((*grid.shape[:2], 1))], axis=-1).reshape(-1, 3)
        length = np.linalg.norm(rays, axis=1)
        density = lit(session, plan, at, directions=rays / length[:, None] @ frame)
        there = np.where(density.met == index, density.density / chance, 0) / length**3
        share = there.reshape(cells, fine, cells, fine).mean(axis=(1, 3)) * np.prod(high - low) / cells**2
        observed, *_ = np.histogram2d(*flat.T, bins=cells, range=[[low[0], high[0]], [low[1], high[1]]])
        assert share.sum() == pytest.approx(1, abs=0.02)  # midpoints at the outline
        # cells on the outline are wrong by the midpoints: those inside tell
        whole = (there.reshape(cells, fine, cells, fine) > 0).all(axis=(1, 3)) & (share * COUNT > 10)
        if whole.sum() < 4:
            continue
        expected = share[whole] / share[whole].sum() * observed[whole].sum()
        assert chi_squared(observed[whole], expected) > LEVEL


def test_inside_of_a_solid_is_not_sampled(session, scene, plan) -> None:
    for shape, name in CASES:
        index, placement = placed(scene, shape, name)
        number, _ = picks(plan, int(plan.primitives["emitter"][index]))
        numbers = unit_numbers(256, 3)
        numbers[:, 0] = number
        inside = (placement @ [0.1, 0.2, 0.3, 1])[:3]
        got = lit(session, plan, inside, numbers, directions=[0.6, 0, 0.8])
        assert (got.pdf == 0).all()
        assert (got.weight == 0).all()
        assert (got.density == 0).all()


@pytest.mark.parametrize("distance", [1e-6, 1e4, 1e7])
def test_densities_are_finite_at_the_extremes(session, scene, plan, distance) -> None:
    for shape, name in CASES:
        for direction in ([0, 0, 1], [0, 1, 0], [1, 0, 0], [0.48, -0.6, 0.64]):
            index, placement = placed(scene, shape, name)
            number, _ = picks(plan, int(plan.primitives["emitter"][index]))
            numbers = unit_numbers(1024, 4)
            numbers[:, 0] = number
            edge = (placement @ [*direction, 1])[:3]
            away = (placement[:3, :3] @ np.array(direction)) / np.linalg.norm(placement[:3, :3] @ np.array(direction))
            got = lit(session, plan, edge + distance * away, numbers)
            assert np.isfinite(got.pdf).all()
            assert np.isfinite(got.weight).all()
            assert (got.pdf >= 0).all()


GROUND = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}


def hung(shape):
    """A solid over the ground, stretched and turned."""
    turn = [{"scale": [1.0, 0.6, 1.4]}, {"rotate": {"axis": [1, 2, 3], "degrees": 50}}, {"translate": [0.4, 0.1, 1.2]}]
    return {**SHAPES[shape], "transform": turn}


@pytest.mark.slow
def test_light_of_solids_is_that_of_their_cells() -> None:
    # E = sum of L cos cos dA / d^2; from below they do not hide one another
    shine = {"box": [8, 1, 1], "ellipsoid": [1, 2, 1], "cone": [1, 1, 40]}
    aside = dict(zip(shine, ([-3.0, 0, 0], [0, 0, 0], [3.0, 0, 0]), strict=True))
    objects = [
        {**hung(shape), "material": lamp(colour), "name": shape,
         "transform": [*hung(shape)["transform"], {"translate": aside[shape]}]}
        for shape, colour in shine.items()
    ]  # fmt: skip
    camera = looking([-0.1, -0.1, 0.03], [0, 0, 0], fov=0.0002)
    scene = scene_of([GROUND, *objects], camera, depth=2, resolution=(64, 64))
    loaded = load_scene(scene)
    expected = np.zeros(3)
    origin = -np.array(loaded.camera.eye) * loaded.metres_per_unit
    for primitive in scene_primitives(loaded):
        if primitive.object == 0 or primitive.kind is Kind.DISK:
            continue
        shape = list(shine)[primitive.object - 1]
        middle, area = cells_of(shape, primitive.placement)
        to = middle - origin
        facing = np.maximum(-(area * to).sum(axis=1), 0) * np.maximum(to[:, 2], 0)
        expected += np.array(shine[shape]) * (facing / (to**2).sum(axis=1) ** 2).sum()
    mean, error = flat_mean(scene, "solids", spp=256)
    assert_equivalent(mean * math.pi, error * math.pi, expected, 0.015 * expected)


@pytest.mark.slow
@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_picture_is_the_same_without_light_sampling(shape, two_sided) -> None:
    glossy = {"kind": "conductor", "reflectance": 0.9, "alpha": 0.2}
    ball = {"shape": "sphere", "center": [-0.6, 0.3, 0.4], "radius": 0.4, "material": glossy}
    objects = [GROUND, ball, {**hung(shape), "material": lamp([3, 2, 1], two_sided=two_sided)}]
    scene = load_scene(scene_of(objects, looking([0, -4, 2], [0, 0, 0.4]), depth=4, resolution=(32, 24)))
    plan = make_plan(scene)
    alone = replace(plan, facts={**plan.facts, **{fact: 0 for fact in plan.facts if "EMITTER" in fact}})
    both, bsdf = batches(scene, plan, "solids", 6, 64), batches(scene, alone, "solids bsdf", 6, 512)
    assert_same_tiles(both, bsdf)
