"""How much light rough materials lose: the table of docs/materials.md, and the fits of covers."""

import itertools
import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.rendering.plan.materials import (
    cover_mean,
    fresnel,
    internal_reflectance,
    rough_albedo,
    rough_cover,
    smooth_mean,
)
from rptcam_cl.scene.materials import alpha_pair
from tests.device.scattering import direction, scatter
from tests.support.cases import fast, one_in, slow

WHITE = [1.0, 1.0, 1.0]
COLUMNS = {
    "metal": lambda r: {"kind": "conductor", "reflectance": WHITE, "roughness": r},
    "rough glass": lambda r: {"kind": "dielectric", "roughness": r},
    "rough plastic": lambda r: {"kind": "plastic", "reflectance": WHITE, "roughness": r},
    "principled": lambda r: {"kind": "principled", "base_color": WHITE, "roughness": r},
    "coated": lambda r: {"kind": "principled", "base_color": WHITE, "roughness": r, "clearcoat": 1},
}
COUNT = 1 << 16


def table():
    """Rows of the table of albedos: roughness, then the columns, in per cent."""
    text = (Path(__file__).parents[2] / "docs" / "materials.md").read_text("utf-8")
    body = text.split("| roughness |")[1].split("\n\n")[0]
    return [[float(cell) for cell in line.strip("| ").split("|")] for line in body.splitlines()[2:]]


def albedo(session, material):
    """Share of even light [per cent] that comes back, refracted radiance counted as energy."""
    rng = np.random.default_rng(3)
    wi = direction(np.sqrt(rng.uniform(size=COUNT)), rng.uniform(size=COUNT))
    got = scatter(session, material, wi, numbers=rng.uniform(size=(COUNT, 3)), again=True)
    return 100 * np.mean(got.weight[:, 1] * np.where(got.direction[:, 2] < 0, 1.5**2, 1.0))


@pytest.mark.parametrize("row", one_in(2, [(row,) for row in table()]))
def test_documented_albedo_is_what_comes_back(session, row):
    got = [albedo(session, material(row[0])) for material in COLUMNS.values()]
    assert got == pytest.approx(row[1:], abs=0.6), np.round(got, 1)


COATS = {
    "bare": {},
    "dense": {"index": 2.5},
    "half of metal": {"metallic": 0.5},
    "coated": {"clearcoat": 0.7, "clearcoat_roughness": 0.3},
    "brushed": {"anisotropy": 0.8},
    "brushed, coated": {"anisotropy": 0.8, "clearcoat": 1, "clearcoat_roughness": 0.1},
}


@pytest.mark.parametrize("coat", fast(COATS.keys() - {"brushed, coated"}, COATS))
@pytest.mark.parametrize("roughness", [0.3, *map(slow, (0.1, 0.6, 1.0))])
def test_white_principled_surfaces_give_back_all_light_at_every_angle(session, coat, roughness):
    for cosine in (0.05, 0.2, 0.6, 1.0):
        for turns in (0, 0.06, 0.25) if "anisotropy" in COATS[coat] else (0,):
            numbers = np.random.default_rng(7).uniform(size=(COUNT, 3))
            material = {"kind": "principled", "base_color": WHITE, "roughness": roughness} | COATS[coat]
            got = scatter(session, material, direction(cosine, turns), numbers=numbers, again=True).weight[:, 1]
            error = got.std() / np.sqrt(COUNT)
            least, most = 0.995, 1.003 if "anisotropy" in COATS[coat] else 1.001  # tables are interpolated
            if "clearcoat" in COATS[coat]:  # the same either way; 0.9 to 1.9 of lamps by the camera's direction alone
                least, most = 0.98, 1.03
            assert least - 4 * error < got.mean() < most + 4 * error, (roughness, cosine, turns)


def test_coat_over_chalk_is_a_smooth_plastic(session):
    """Two formulas of one surface: both let light in and out by its two directions."""
    rng = np.random.default_rng(9)
    wi, wo = direction(*rng.uniform([[[0.1]], [[0.0]]], 1, (2, 2, 4096)))
    away = np.linalg.norm(wi * [-1, -1, 1] - wo, axis=1) > 0.4  # from the highlight
    coat = {"clearcoat": 1, "clearcoat_roughness": 0.02, "specular": 0, "roughness": 1.0}
    coated = scatter(session, {"kind": "principled", "base_color": WHITE} | coat, wi[away], wo[away], again=True)
    plastic = scatter(session, {"kind": "plastic", "reflectance": WHITE}, wi[away], wo[away])
    assert away.sum() > 3000
    np.testing.assert_allclose(coated.value, plastic.value, rtol=0.01)


@pytest.mark.parametrize("roughness", [0.3, slow(0.9)])
def test_white_brushed_plastic_gives_back_all_light_from_every_side(session, roughness):
    """By one alpha, as without tables, 0.87 to 1.10."""
    material = {"kind": "plastic", "reflectance": WHITE, "roughness": roughness, "anisotropy": 0.8}
    for cosine, turns in itertools.product((0.05, 0.3, 0.8), (0, 0.06, 0.25)):
        numbers = np.random.default_rng(7).uniform(size=(COUNT, 3))
        got = scatter(session, material, direction(cosine, turns), numbers=numbers, again=True).weight[:, 1]
        error = got.std() / np.sqrt(COUNT)
        assert 0.995 - 4 * error < got.mean() < 1.002 + 4 * error, (cosine, turns)


@pytest.mark.parametrize("index", [1.3, 1.5, 2.0])
@pytest.mark.parametrize("alpha", [0.02, 0.1, 0.3, 1.0])
def test_cover_of_plastic_is_its_quadrature_from_above(index, alpha):
    cover = rough_cover((alpha, alpha), index)
    cosines = np.linspace(0.05, 1, 40)
    share = np.array([rough_albedo(cosine, (alpha, alpha), partial(fresnel, index=index)) for cosine in cosines])
    off = sum(c * (1 - cosines) ** i for i, c in enumerate(cover)) - share
    assert off.min() > -0.003
    assert np.average(off, weights=cosines) < 0.006
    assert cover_mean(cover) == pytest.approx(np.average(share + off, weights=cosines), abs=0.01)


def test_smooth_cover_sends_back_what_tables_say():
    # Egan and Hilgeman 1973: 0.5963 from inside at 1.5; Judd 1942: 0.0918 from outside
    assert smooth_mean(1.5) == pytest.approx(0.0918, abs=5e-5)
    assert internal_reflectance(smooth_mean(1.5), 1.5) == pytest.approx(0.5963, abs=1e-4)
    assert fresnel(np.array(1.0), 1.5) == pytest.approx(0.04)


def share_once(w, alphas):
    """Share of light along w (n, 3) that white facets of two alphas reflect once, over visible normals."""
    node, weight = np.polynomial.legendre.leggauss(48)
    u, v = np.meshgrid((np.arange(192) + 0.5) / 192, (node + 1) / 2)
    stretch = np.array([*alphas, 1.0])
    shares = []
    for wi in w:
        up = wi * stretch / np.linalg.norm(wi * stretch)
        z = (1 - v) * (1 + up[2]) - up[2]
        r = np.sqrt(1 - np.minimum(z * z, 1))
        h = np.stack([r * np.cos(2 * np.pi * u), r * np.sin(2 * np.pi * u), z], axis=-1) + up
        h = h * stretch / np.linalg.norm(h * stretch, axis=-1, keepdims=True)
        wo = 2 * (h @ wi)[..., None] * h - wi
        own, other = (np.sqrt(1 + ((x * stretch)[..., :2] ** 2).sum(-1) / x[..., 2] ** 2) for x in (wi, wo))
        shares.append((np.where(wo[..., 2] > 0, (1 + own) / (own + other), 0).mean(axis=1) * weight).sum() / 2)
    return np.array(shares)


def test_brushed_metal_gives_back_all_light_from_every_side(session):
    turns, cosines = np.meshgrid(np.linspace(0, 0.25, 7), [0.01, 0.03, 0.1, 0.25, 0.5, 0.8, 1.0])
    w = direction(cosines.ravel(), turns.ravel())
    for alphas in ((0.1, 0.6), (0.9, 0.05), (0.3, 0.4), (0.02, 0.5), (1.0, 0.5), alpha_pair(1.0, 0.8)):
        white = {"kind": "conductor", "reflectance": WHITE, "alpha": list(alphas)}
        if max(alphas) > 1:
            white = {"kind": "conductor", "reflectance": WHITE, "roughness": 1.0, "anisotropy": 0.8}
        ways = even_light(24, 32)
        each, all_ways = np.repeat(w, len(ways), axis=0), np.tile(ways, (len(w), 1))
        several, once = (scatter(session, white, each, all_ways, again=again).value[:, 1] for again in (True, False))
        added = (np.pi * (several - once) / all_ways[:, 2]).reshape(len(w), -1).mean(axis=1)
        furnace = added + share_once(w, alphas)
        assert furnace.min() >= 0.996 and furnace.max() <= 1.004, (alphas, furnace.min(), furnace.max())


def even_light(rings, around):
    """Directions of even light, each of the same part of it: shape (rings x around, 3)."""
    squares, turns = np.meshgrid((np.arange(rings) + 0.5) / rings, (np.arange(around) + 0.5) / around)
    return direction(np.sqrt(squares.ravel()), turns.ravel())


@pytest.mark.parametrize("roughness", [0.5, slow(0.3), slow(0.7), 1.0])
@pytest.mark.parametrize("kind", ["conductor", "principled"])
def test_metal_reflects_what_walks_among_its_facets_say_the_same_either_way(session, kind, roughness):
    """By a factor of the camera's direction alone, white metal reflects 0.76 to 2.06 of the light of a lamp."""
    colour = {"conductor": {"reflectance": COLOUR}, "principled": {"base_color": COLOUR, "metallic": 1.0}}[kind]
    steep = np.zeros(3) if kind == "conductor" else 1 - np.array(COLOUR)
    metal = {"kind": kind, "roughness": roughness} | colour
    rng = np.random.default_rng(7)
    for cosine in (0.1, 0.35, 0.9):
        one = np.broadcast_to(direction(cosine), (COUNT, 3))
        got = scatter(session, metal, one, numbers=rng.uniform(size=(COUNT, 3)), again=True).weight
        expected = metal_walk(cosine, roughness**2, np.array(COLOUR), steep, 1 << 17)
        assert got.mean(axis=0) == pytest.approx(expected, rel=0.015 if kind == "conductor" else 0.03), cosine
    wi, wo = direction(*rng.uniform([[[0.02]], [[0.0]]], 1, (2, 2, 4096)))
    there, back = (scatter(session, metal, *pair, again=True).value / pair[1][:, 2:] for pair in ((wi, wo), (wo, wi)))
    np.testing.assert_allclose(there, back, rtol=2e-3)


def metal_walk(cosine, alpha, normal, steep, count):
    """Share of light that facets of metal reflect, as `facet_walk`; each of the share `normal` + `steep` (1 - c)^5."""
    rng = np.random.default_rng(13)
    way, height = np.tile([-math.sqrt(1 - cosine**2), 0.0, -cosine], (count, 1)), np.ones(count)
    weight, total = np.ones((count, 3)), np.zeros(3)
    while len(way):
        number = rng.random(len(way))
        slope = np.sqrt(1 + alpha**2 * (way[:, 0] ** 2 + way[:, 1] ** 2) / way[:, 2] ** 2)
        masking = (np.sign(way[:, 2]) * slope - 1) / 2
        leaves = (way[:, 2] > 0) & (number > 1 - height ** np.maximum(masking, 0))
        total += weight[leaves].sum(axis=0)
        way, height, weight, masking, number = (each[~leaves] for each in (way, height, weight, masking, number))
        height = np.clip(height * (1 - number) ** (-1 / masking), 0, 1)
        h = visible_normals(-way, alpha, rng)
        c = np.clip(-np.sum(way * h, axis=1), 0, 1)[:, None]
        way, weight = way + 2 * c * h, weight * (normal + steep * (1 - c) ** 5)
    return total / count


def visible_normals(w, alpha, rng):
    """One facet normal for each direction ``w`` (n, 3), below the surface, too (Dupuy and Benyoub 2023)."""
    w = w * [alpha, alpha, 1]
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    u, v = rng.random((2, len(w)))
    z = (1 - v) * (1 + w[:, 2]) - w[:, 2]
    r = np.sqrt(np.clip(1 - z**2, 0, None))
    h = np.stack([r * np.cos(2 * np.pi * u) + w[:, 0], r * np.sin(2 * np.pi * u) + w[:, 1], z + w[:, 2]], axis=1)
    h = h * [alpha, alpha, 1]
    return h / np.linalg.norm(h, axis=1, keepdims=True)


@pytest.mark.slow
def test_glass_brushed_or_of_textured_roughness_passes_on_all_light(session):
    rng = np.random.default_rng(5)
    frosted = {"kind": "dielectric", "alpha": [0.1, 0.6]}
    even = {"kind": "gradient", "start": 0.7, "end": 0.7}
    painted = {"kind": "principled", "base_color": WHITE, "transmission": 1, "roughness": even}
    for material in (frosted, painted):
        for wi in direction([0.9, 0.3, 0.3, -0.9, -0.2], [0.1, 0, 0.25, 0.2, 0.05]):
            got = scatter(session, material, wi, numbers=rng.uniform(size=(1 << 16, 3)), again=True)
            energy = got.weight[:, 1] * np.where(got.direction[:, 2] * wi[2] < 0, 1.5 ** (2 * np.sign(wi[2])), 1)
            assert energy.mean() == pytest.approx(1, abs=0.01 + 4 * energy.std() / 256), (material, wi)


GLASSES = [
    {"kind": "dielectric", "roughness": 0.7},
    {"kind": "dielectric", "roughness": 0.5, "index": 0.7},
    {"kind": "dielectric", "alpha": [0.1, 0.6]},
    {"kind": "principled", "base_color": WHITE, "transmission": 1.0, "roughness": 0.6},
]


@pytest.mark.parametrize("material", GLASSES, ids=str)
def test_rough_glass_is_the_same_either_way(session, material):
    """Radiance over the squared index (Veach 1997, ch. 5.2), with the light that facets scatter more than once."""
    one, other = np.random.default_rng(7).normal(size=(2, 4096, 3))
    one, other = (each / np.linalg.norm(each, axis=1)[:, None] for each in (one, other))
    values = []
    for wi, wo in ((one, other), (other, one)):
        value = scatter(session, material, wi, wo, again=True).value[:, 1] / np.abs(wo[:, 2])
        values.append(value * np.where(wo[:, 2] < 0, material.get("index", 1.5) ** 2, 1))
    seen = np.maximum(*values) > 1e-4
    assert seen.sum() > 1000
    np.testing.assert_allclose(values[0][seen], values[1][seen], rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("roughness", [0.5, 0.7])
def test_as_much_light_is_reflected_in_rough_glass_as_walks_tell(session, roughness):
    """Without what is scattered again, or with the shares of what is scattered once, 0.1 to 0.2 less of it is."""
    numbers = np.random.default_rng(5).uniform(size=(1 << 15, 3))
    for cosine in (0.98, 0.9, 0.8):
        got = scatter(
            session, {"kind": "dielectric", "roughness": roughness}, direction(-cosine), numbers=numbers, again=True
        )
        reflected = got.weight[:, 1] * (got.direction[:, 2] < 0)
        expected = facet_walk(cosine, roughness**2, 1 / 1.5, np.ones((2, 1)), fresnel, 1 << 16)[0, 0]
        assert reflected.mean() == pytest.approx(expected, abs=0.05), cosine


def facet_walk(cosine, alpha, eta, tints, reflectance, count):
    """Share of light that GGX facets of glass send on, by walks among them (Heitz and others 2016, uniform heights).

    `tints` is (2, k), of what a facet reflects, the share `reflectance(cosine, index)`, and of what it refracts; the
    result (2, k) is of what is reflected and of what passes. In float64, from the paper: a walk leaves the height h
    upwards with the probability C(h)^Lambda, C the distribution of heights, and meets a visible normal otherwise; below
    the surface everything is turned over.
    """
    rng = np.random.default_rng(11)
    way, height = np.tile([-math.sqrt(1 - cosine**2), 0.0, -cosine], (count, 1)), np.ones(count)  # share C(h)
    outside, weight, total = np.ones(count, bool), np.ones((count, tints.shape[1])), np.zeros((2, tints.shape[1]))
    while len(way):
        slope = np.sqrt(1 + alpha**2 * (way[:, 0] ** 2 + way[:, 1] ** 2) / way[:, 2] ** 2)
        masking = (np.sign(way[:, 2]) * slope - 1) / 2
        number = rng.random(len(way))
        leaves = (way[:, 2] > 0) & (number > 1 - height ** np.maximum(masking, 0))
        total += [weight[leaves & side].sum(axis=0) for side in (outside, ~outside)]
        way, height, outside, weight, masking, number = (
            each[~leaves] for each in (way, height, outside, weight, masking, number)
        )
        height = np.clip(height * (1 - number) ** (-1 / masking), 0, 1)
        h = visible_normals(-way, alpha, rng)
        c = np.clip(-np.sum(way * h, axis=1), 0, 1)[:, None]
        index = np.where(outside, eta, 1 / eta)[:, None]
        bounces = rng.random((len(way), 1)) < reflectance(c, index)
        bent = way / index + (c / index - np.sqrt(np.clip(1 - (1 - c**2) / index**2, 0, None))) * h
        way = np.where(bounces, way + 2 * c * h, -bent)
        weight = weight * np.where(bounces, tints[0], tints[1])
        height, outside = np.where(bounces[:, 0], height, 1 - height), outside == bounces[:, 0]
    return total / count


def schlick(cosine, index):
    """Reflectance by the angle outside, total beyond the critical one inside."""
    cosine = np.where(index > 1, cosine, np.sqrt(np.clip(1 - (1 - cosine**2) / index**2, 0, None)))
    f0 = ((index - 1) / (index + 1)) ** 2
    return f0 + (1 - f0) * (1 - cosine) ** 5


COLOUR = [0.8, 0.5, 0.2]
STAINED = {
    "both": ({"kind": "dielectric", "reflectance": COLOUR, "transmittance": COLOUR}, [COLOUR, COLOUR], fresnel),
    "passed": ({"kind": "dielectric", "transmittance": COLOUR}, [WHITE, COLOUR], fresnel),
    "principled": ({"kind": "principled", "base_color": COLOUR, "transmission": 1.0}, [WHITE, COLOUR], schlick),
}


@pytest.mark.parametrize("kind", STAINED)
def test_rough_glass_tints_light_as_often_as_it_meets_facets(session, kind):
    """Beside walks among facets; tinted once, glass that tints both would be up to 2.5 and 14 % too bright."""
    material, tints, reflectance = STAINED[kind]
    for roughness, near in ((0.5, 0.006), (0.8, 0.022)):
        for cosine in (0.95, 0.6):
            numbers = np.random.default_rng(5).uniform(size=(1 << 15, 3))
            got = scatter(session, material | {"roughness": roughness}, direction(cosine), numbers=numbers, again=True)
            mean = (got.weight * np.where(got.direction[:, 2:] < 0, 1.5**2, 1.0)).mean(axis=0)
            expected = facet_walk(cosine, roughness**2, 1.5, np.array(tints), reflectance, 1 << 16).sum(axis=0)
            assert mean == pytest.approx(expected, rel=near)
