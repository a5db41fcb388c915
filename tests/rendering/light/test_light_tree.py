"""The light tree: picks follow their probabilities, which add up to one and are those of the estimate in float64."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.plan.emitters import Lamps, lamps_of, light_tree, variance_by_power
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene
from tests.device.probes import run
from tests.rendering.light.test_environment_pictures import batches
from tests.rendering.pictures import MATTE, flat_mean, lamp, looking, scene_of
from tests.support.statistics import assert_equivalent, assert_same_tiles

GROUND = {"shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1], "material": MATTE}


def assorted(spread=6.0):
    """Lamps of every kind strewn over a hall."""
    rng = np.random.default_rng(11)
    shapes = [
        {"shape": "sphere", "center": [0, 0, 0], "radius": 0.1},
        {"shape": "disk", "center": [0, 0, 0], "normal": [0, 0.6, -0.8], "radius": 0.2},
        {"shape": "rectangle", "corner": [0, 0, 0], "edge_u": [0, 0.3, 0], "edge_v": [0.2, 0, 0]},
        {"shape": "box", "min": [0, 0, 0], "max": [0.2, 0.3, 0.1]},
        {"shape": "cylinder", "base": [0, 0, 0], "top": [0.5, 0, 0], "radius": 0.02, "capped": False},
        {"shape": "cone", "base": [0, 0, 0], "apex": [0, 0, 0.3], "radius": 0.2, "capped": False},
        {"shape": "mesh", "vertices": [[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0.1], [0.1, 0, 0.2]],
         "faces": [[0, 2, 1], [0, 3, 1], [1, 2, 3]]},
    ]  # fmt: skip
    objects = []
    for index in range(23):
        place = [*rng.uniform(-spread, spread, 2), rng.uniform(1, 3)]
        transform = [{"rotate": {"axis": rng.normal(size=3).tolist(), "degrees": 70}}, {"translate": place}]
        objects.append({**shapes[index % len(shapes)], "transform": transform, "material": lamp(rng.lognormal(0, 1))})
    lights = [
        {"kind": "point", "position": [1, 2, 2], "intensity": 0.3},
        {"kind": "spot", "position": [-4, 2, 2.5], "direction": [0.2, 0, -1], "intensity": 1, "outer_degrees": 50},
    ]
    return [GROUND, *objects], lights


AFAR = [
    {"kind": "sun", "direction": [1, 1, -2], "irradiance": 0.2},
    {"kind": "directional", "direction": [-1, 0, -1], "irradiance": [0.1, 0.2, 0.1]},
]


METAL = {"kind": "conductor", "reflectance": 0.9, "alpha": 0.04}


def planned(afar=(), metal=False):
    objects, lights = assorted()
    if metal:
        objects[0] = GROUND | {"material": METAL}
    camera = looking([0, -7, 2], [0, 0, 0.3])
    return make_plan(load_scene(scene_of(objects, camera, depth=2, lights=[*lights, *afar])))


@pytest.fixture(scope="module", params=["lamps", "lamps and suns", "lamps, suns and metal"])
def plan(request):
    metal = "metal" in request.param
    plan = planned(AFAR if "suns" in request.param else (), metal)
    assert (plan.facts["LIGHT_TREE"], plan.facts["LIGHT_LOBES"]) == (1, metal)
    return plan


def probed(session, plan, points, normals=(0.0, 0.0, 1.0), numbers=0.5, emitters=0, lanes=8):
    """Return the emitter that each number picks, its probability, and that of the given emitters."""
    parts = [np.atleast_2d(points), np.atleast_2d(normals), np.atleast_1d(numbers), np.atleast_1d(emitters)]
    count = max(map(len, parts))
    padded = -(-count // 256) * 256
    table = np.zeros((8, padded), np.float32)
    for rows, part in zip((slice(0, 3), slice(3, 6), 6, 7), parts, strict=True):
        table[rows, :count] = np.transpose(part) if part.ndim == 2 else part
    out = session.allocate(12 * padded)
    run(
        session, "probe_light_tree", plan.facts | {"VW": lanes}, padded // lanes, **SceneBuffers(session, plan).scene,
        out=out, count=np.uint32(padded), **{"in": session.upload(table)},
    )  # fmt: skip
    picked, pick, chance = session.read(out, np.float32, 3 * padded).reshape(3, padded)[:, :count].astype(np.float64)
    return picked.astype(int), pick, chance


def some_places(count, seed=2):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-8, -8, 0], [8, 8, 4], (count, 3))
    normals = rng.normal(size=(count, 3))
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def test_probabilities_of_all_emitters_add_up_to_one(session, plan) -> None:
    points, normals = some_places(64)
    normals[:8] = 0  # all directions
    count = plan.emitters.count
    asked = np.tile(np.arange(count), len(points))
    _, _, chance = probed(session, plan, points.repeat(count, axis=0), normals.repeat(count, axis=0), 0.5, asked)
    sums = chance.reshape(len(points), count).sum(axis=1)
    # a few roundings per level of the tree
    np.testing.assert_allclose(sums, 1, rtol=3e-6)
    shines = plan.emitters.records["a"][:, 3] > 0
    assert (chance.reshape(len(points), count)[:, shines] > 0).all()


def test_evenly_spread_numbers_pick_each_emitter_as_often_as_it_says(session, plan) -> None:
    # the emitters of the tree have an interval of the numbers each, so that their count is right to a grid point or two
    count, numbers = plan.emitters.count, (np.arange(1 << 14) + 0.5) / (1 << 14)
    points, normals = some_places(4, 7)
    for point, normal in zip(points, normals, strict=True):
        picked, pick, _ = probed(session, plan, point, normal, numbers)
        _, _, chance = probed(session, plan, point, normal, 0.5, np.arange(count))
        np.testing.assert_allclose(pick, chance[picked], rtol=2e-6)
        observed = np.bincount(picked, minlength=count)
        np.testing.assert_allclose(observed, chance * len(numbers), atol=1.5)


def test_facets_that_mirror_a_lamp_take_their_light_from_it(session) -> None:
    plan = planned(metal=True)
    lamps = plan.emitters.records[: plan.emitters.count]
    middles = lamps["a"][:, :3].astype(np.float64)
    for index in (0, 9, 22):
        point = np.array([0.0, 0.0, 0.0])
        towards = (middles[index] - point) / np.linalg.norm(middles[index] - point)
        # the kernel of this test mirrors into (y, z, x) of what it takes for the normal
        chances = [
            probed(session, plan, point, np.roll(direction, 1), 0.5, index)[2][0] for direction in (towards, -towards)
        ]
        assert chances[0] > 4 * chances[1]


@pytest.mark.slow
@pytest.mark.parametrize("lanes", [1, 16])
def test_picks_are_the_same_in_any_width(session, lanes) -> None:
    plan = planned(AFAR)
    points, normals = some_places(512, 9)
    numbers = np.random.default_rng(1).random(512).astype(np.float32)
    picked, pick, _ = probed(session, plan, points, normals, numbers)
    other, same, _ = probed(session, plan, points, normals, numbers, lanes=lanes)
    np.testing.assert_array_equal(other, picked)
    np.testing.assert_array_equal(same, pick)


def facing(cosine, spread):
    return max((cosine + math.sqrt(max(cosine**2 + spread, 0))) / 2, 0.01)


def light_of(node, point, normal):
    """The estimate of kernels/light/light_tree.h, in float64."""
    to = node[:3] - point
    inverse = 1 / (to @ to + node[3])
    spread = node[3] * inverse / 2
    shines = facing(-(node[4:7] @ to) * math.sqrt(inverse), spread + (1 - node[4:7] @ node[4:7]) / 4)
    return node[7] * shines * facing(normal @ to * math.sqrt(inverse), spread + 0.01) * inverse


def test_probabilities_are_those_of_the_estimate_in_float64(session) -> None:
    plan = planned()
    tree, count = plan.emitters.tree, plan.emitters.count
    nodes = tree.nodes[: 16 << (2 * tree.levels)].reshape(-1, 8).astype(np.float64)
    for point, normal in zip(*some_places(6, 3), strict=True):
        _, _, chance = probed(session, plan, point, normal, 0.5, np.arange(count))
        for emitter in range(count):
            leaf, node, expected = int(plan.emitters.records["leaf"][emitter]), 1, 1.0
            for level in reversed(range(tree.levels)):
                light = [light_of(nodes[4 * node + child], point, normal) for child in range(4)]
                child = leaf >> (2 * level) & 3
                expected *= light[child] / sum(light)
                node = 4 * node + child
            assert chance[emitter] == pytest.approx(expected, rel=2e-5, abs=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1e7])
def test_picks_are_finite_at_the_extremes(session, plan, scale) -> None:
    lamps = plan.emitters.records["a"][:, :3].astype(np.float64)
    points = np.concatenate([lamps, lamps + scale * np.array([0.6, 0, 0.8]), lamps - [0, scale, 0]])
    for number in (0.0, 0.5, 1 - 2.0**-24):
        picked, pick, _ = probed(session, plan, points, [0, 0, 1], np.full(len(points), number))
        assert np.isfinite(pick).all()
        assert (pick > 0).all()
        assert (picked >= 0).all()
        assert (picked < plan.emitters.count).all()


def test_the_number_zero_picks_no_lamp_where_all_light_comes_from_afar(session) -> None:
    plan = planned([{"kind": "directional", "direction": [0, 0, 1], "irradiance": 1e30}])
    far_below = ([0, 0, -1e10], [0, 0, -1])  # where the lamps' share of the light is 0 to float32
    count = plan.emitters.count
    _, _, chances = probed(session, plan, *far_below, 0.0, np.arange(count))
    np.testing.assert_allclose(chances, np.arange(count) == count - 1, rtol=1e-6)
    picked, pick, _ = probed(session, plan, *far_below, 0.0)
    assert picked[0] == count - 1
    assert pick[0] == pytest.approx(1)


@pytest.mark.slow
def test_light_from_infinity_may_be_1e40_times_that_of_the_lamps() -> None:
    rows = [(x, y, 2) for x in (-20, 0, 20) for y in (-20, 0, 20)]
    faint = [{"shape": "sphere", "center": place, "radius": 0.1, "material": lamp(1e-20)} for place in rows]
    afar = {"kind": "directional", "direction": [0, 0, -1], "irradiance": 1e20}
    scene = scene_of([GROUND, *faint], looking([0, -1, 1], [0, 5, 0], 10), depth=2, lights=[afar])
    assert make_plan(load_scene(scene)).facts["LIGHT_TREE"] == 1
    mean, _ = flat_mean(scene, "faint lamps", spp=4)
    assert mean == pytest.approx(1e20 / math.pi, rel=1e-5)


def test_lamps_without_power_are_never_picked(session) -> None:
    plan = planned()
    lamps = lamps_of(plan.emitters.records, np.where(np.arange(plan.emitters.count) % 3 == 0, 0.0, 1.0))
    tree, records = light_tree(lamps), plan.emitters.records.copy()
    records["leaf"] = tree.leaf_of
    some_dark = replace(plan, emitters=replace(plan.emitters, records=records, tree=tree))
    points, normals = some_places(256, 8)
    picked, pick, _ = probed(session, some_dark, points, normals, np.random.default_rng(2).random(256))
    assert (lamps.power[picked] > 0).all()
    assert (pick > 0).all()
    _, _, chance = probed(session, some_dark, points[0], normals[0], 0.5, np.arange(plan.emitters.count))
    np.testing.assert_array_equal(chance == 0, lamps.power == 0)


def test_what_stands_in_memory_behind_the_emitters_is_none(session) -> None:
    plan = planned(AFAR)
    beyond = plan.emitters.records[plan.emitters.count - 1 :][:1].copy()
    beyond["pick"] = 1e6
    records = np.concatenate([plan.emitters.records[: plan.emitters.count], beyond])
    more = replace(plan, emitters=replace(plan.emitters, records=records))
    points, normals = some_places(256, 8)
    numbers, asked = np.random.default_rng(2).random(256), np.arange(256) % plan.emitters.count
    np.testing.assert_array_equal(*(probed(session, each, points, normals, numbers, asked) for each in (plan, more)))


def lamps_at(middle, power=None):
    middle = np.asarray(middle, float)
    power = np.ones(len(middle)) if power is None else np.asarray(power, float)
    return Lamps(middle, np.zeros(len(middle)), np.zeros_like(middle), power / power.sum())


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 17, 64, 100])
def test_every_lamp_has_a_leaf_of_its_own(count) -> None:
    rng = np.random.default_rng(count)
    lamps = lamps_at(rng.normal(size=(count, 3)), rng.random(count))
    tree = light_tree(lamps)
    assert len(set(tree.leaf_of.tolist())) == count
    leaves = 1 << (2 * tree.levels)
    assert leaves < 8 * count
    lamp_of = tree.nodes[16 * leaves :].view(np.int32)
    np.testing.assert_array_equal(lamp_of[tree.leaf_of], np.arange(count))
    nodes = tree.nodes[: 16 * leaves].reshape(-1, 8)
    np.testing.assert_allclose(nodes[leaves + tree.leaf_of, :3], lamps.middle, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(nodes[leaves + tree.leaf_of, 7], lamps.power, rtol=1e-6)
    middle = lamps.power @ lamps.middle
    np.testing.assert_allclose(nodes[1, :3], middle, atol=1e-6)
    assert nodes[1, 3] == pytest.approx(lamps.power @ ((lamps.middle - middle) ** 2).sum(axis=1), rel=1e-5, abs=1e-9)


def test_spread_of_a_node_is_that_of_all_points_of_its_lamps() -> None:
    rng = np.random.default_rng(3)
    offsets = rng.normal(size=(5, 400, 3)) * [[[1.0]], [[0.5]], [[2.0]], [[0.1]], [[0.7]]]
    offsets -= offsets.mean(axis=1, keepdims=True)
    middles, power = rng.normal([50.0, 0, 0], 1, (5, 3)), np.array([0.1, 0.3, 0.2, 0.25, 0.15])
    lamps = replace(lamps_at(middles, power), extent2=(offsets**2).sum(axis=2).mean(axis=1))
    points = middles[:, None] + offsets
    tree = light_tree(lamps)
    node_of = 4 + (tree.leaf_of >> 2)  # of the four below the root, node 1; the leaves are below these
    for node in (1, *set(node_of.tolist())):
        share = power * ((node == 1) | (node_of == node))
        mean = share @ middles / share.sum()
        spread = share @ ((points - mean) ** 2).sum(axis=2).mean(axis=1) / share.sum()
        assert tree.nodes[8 * node + 3] == pytest.approx(spread, rel=1e-5)


def test_variance_by_power_has_its_closed_form() -> None:
    # two equal point lamps at distances 1 and 2: light 1 and 1/4, so that 2 (1 + 1/16) / (5/4)^2 - 1
    lamps = lamps_at([[0, 0, 1], [0, 0, -2]])
    found = variance_by_power(lamps, np.zeros((1, 3)))
    assert found == pytest.approx(2 * (1 + 1 / 16) / (5 / 4) ** 2 - 1, rel=1e-6)
    assert variance_by_power(lamps_at([[0, 0, 1], [0, 0, -1]]), np.zeros((1, 3))) == pytest.approx(0, abs=1e-12)
    # the same two, the farther one a ball of radius 1 and the nearer a panel that faces away: its cosine is -1
    lamps = replace(lamps, extent2=np.array([0.5, 1.0]), axis=np.array([[0, 0, 1.0], [0, 0, 0]]))
    light = []
    for distance2, extent2, cosine, round_ in ((1, 0.5, -1, 0), (4, 1, 0, 1)):
        spread = extent2 / (distance2 + extent2) / 2
        cosine *= math.sqrt(distance2 / (distance2 + extent2))
        light.append((cosine + math.sqrt(cosine**2 + spread + round_ / 4)) / 2 / (distance2 + extent2))
    expected = 2 * (light[0] ** 2 + light[1] ** 2) / sum(light) ** 2 - 1
    assert variance_by_power(lamps, np.zeros((1, 3))) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("pitch", "height", "tree"), [(4.0, 2.5, 1), (0.3, 3.0, 0)])
def test_tree_is_for_lamps_that_stand_apart(pitch, height, tree) -> None:
    lamps = [
        {"shape": "sphere", "center": [x * pitch, y * pitch, height], "radius": 0.1, "material": lamp(1.0)}
        for x in range(3)
        for y in range(3)
    ]
    plan = make_plan(load_scene(scene_of([GROUND, *lamps], looking([0, -4, 2], [0, 0, 0]))))
    assert plan.facts["LIGHT_TREE"] == tree


@pytest.mark.slow
def test_light_of_many_spheres_has_its_closed_form() -> None:
    # E = pi L (r / d)^2 cos, exactly, of spheres wholly above the ground
    rng = np.random.default_rng(5)
    lamps, expected = [], 0.0
    for index in range(40):  # none hides another
        centre = [1.7 * (index % 8 - 3.6), 1.7 * (index // 8 - 2.3), 2.5]
        radius, shine = rng.uniform(0.05, 0.1), rng.lognormal()
        lamps.append({"shape": "sphere", "center": centre, "radius": radius, "material": lamp(shine)})
        expected += math.pi * shine * radius**2 * centre[2] / np.linalg.norm(centre) ** 3
    camera = looking([-0.1, -0.1, 0.03], [0, 0, 0], fov=0.0002)
    scene = scene_of([GROUND, *lamps], camera, depth=2, resolution=(64, 64))
    assert make_plan(load_scene(scene)).facts["LIGHT_TREE"] == 1
    mean, error = flat_mean(scene, "spheres", spp=64)
    assert_equivalent(mean * math.pi, error * math.pi, expected, 0.01 * expected)


def hall():
    objects, lights = assorted()
    metal = {"kind": "conductor", "reflectance": 0.9, "alpha": 0.2}
    balls = [
        {"shape": "sphere", "center": [-1, 1, 0.5], "radius": 0.5, "material": metal},
        {"shape": "sphere", "center": [1, 0, 0.5], "radius": 0.5, "material": {"kind": "dielectric", "alpha": 0.3}},
    ]
    camera = looking([0, -5, 2], [0, 0, 0.5])
    return scene_of([*objects, *balls], camera, depth=3, lights=[*lights, *AFAR], resolution=(24, 16))


def film(session, scene, organisation):
    wavefront = Wavefront(session, make_plan(scene), FilmLayout.of(scene.film), scene.render, organisation=organisation)
    for wave in wavefront.waves(0, 4):
        wavefront.enqueue(*wave)
    wavefront.finish()
    return wavefront.picture(4)


def large_lamps(material=MATTE):
    """Nine lamps over the ground, so large that scattered rays meet them as often as light samples do."""
    lamps = [
        {"shape": "sphere", "center": [4.0 * x, 4.0 * y, 1.2], "radius": 0.8, "material": lamp(1.0 + x)}
        for x in range(3)
        for y in range(3)
    ]
    ground = GROUND | {"material": material}
    return scene_of([ground, *lamps], looking([3, -5, 4], [3, 3, 0]), depth=3, resolution=(24, 16))


def large_lamps_over_plastic():
    return large_lamps({"kind": "plastic", "reflectance": [0.5, 0.3, 0.2], "roughness": 0.3})


def glossy_hall():
    """The hall, whose ground is matte under glossy facets, and part metal."""
    scene = hall()
    cover = {"kind": "principled", "base_color": [0.5, 0.3, 0.2], "roughness": 0.3, "metallic": 0.4}
    scene["objects"][0] = GROUND | {"material": cover}
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("made", [large_lamps_over_plastic, large_lamps, hall])
def test_passes_and_stream_give_the_same_bits(session, made) -> None:
    scene = load_scene(made())
    assert make_plan(scene).facts["LIGHT_TREE"] == 1
    np.testing.assert_array_equal(film(session, scene, "passes"), film(session, scene, "stream"))


@pytest.mark.slow
@pytest.mark.parametrize("made", [hall, glossy_hall])
def test_picture_is_the_same_by_power(made) -> None:
    scene = load_scene(made())
    plan = make_plan(scene)
    assert (plan.facts["LIGHT_TREE"], plan.facts["LIGHT_LOBES"]) == (1, 1)
    chance = plan.emitters.records.copy()
    by_power = np.diff(plan.emitters.curve[::2].astype(np.float64))
    chance["pick"] = by_power
    emitters = replace(plan.emitters, records=chance, tree=None)
    plain = replace(plan, facts={**plan.facts, "LIGHT_TREE": 0, "LIGHT_LOBES": 0}, emitters=emitters)
    assert_same_tiles(batches(scene, plan, "tree", 6, 128), batches(scene, plain, "power", 6, 512))
