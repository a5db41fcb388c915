"""What the kernels' BSDFs evaluate to: float64 formulas, symmetry, grazing angles, limits."""

import numpy as np
import pytest

from rptcam_cl.core.colour import METALS
from rptcam_cl.rendering.plan.materials import sheen_lobe
from rptcam_cl.rendering.plan.textures import metal_colour, metal_constants, reflectance
from tests.device import bsdfs, scattering
from tests.device.scattering import direction, scatter

COUNT = 4096
RGB = [0.9, 0.5, 0.1]
RNG = np.random.default_rng(11)
UP = direction(RNG.uniform(0.02, 1, COUNT), RNG.uniform(size=COUNT))
OTHER = direction(RNG.uniform(0.02, 1, COUNT), RNG.uniform(size=COUNT))
BELOW = OTHER * [1, 1, -1]
GOLD = metal_constants("gold")


def gold(cosine):
    return reflectance(np.array(GOLD[0]) + 1j * np.array(GOLD[1]), cosine)


def tinted(cosine):
    """Schlick's reflectance of a dielectric of index 2 whose reflectance at normal incidence is coloured."""
    normal = np.array(RGB) / 9
    return 0.8 * (normal + (1 - normal) * (1 - cosine) ** 5)


def oren_nayar(wi, wo, degrees):
    """The qualitative model of Oren and Nayar (1994), by its angles, times the cosine."""
    theta_i, theta_o = np.arccos(wi[:, 2:]), np.arccos(wo[:, 2:])
    turn = np.arctan2(wi[:, 1:2], wi[:, :1]) - np.arctan2(wo[:, 1:2], wo[:, :1])
    variance = np.radians(degrees) ** 2
    a, b = 1 - variance / (2 * (variance + 0.33)), 0.45 * variance / (variance + 0.09)
    alpha, beta = np.maximum(theta_i, theta_o), np.minimum(theta_i, theta_o)
    return wo[:, 2:] / np.pi * (a + b * np.maximum(0, np.cos(turn)) * np.sin(alpha) * np.tan(beta))


LEAF = {"kind": "translucent", "reflectance": RGB, "transmittance": [0.05, 0.4, 0.2]}
BLACK_CLOTH = {"kind": "principled", "base_color": 0, "specular": 0, "sheen": RGB}
FORMULAS = {
    "matte": ({"kind": "matte", "reflectance": RGB}, lambda i, o: o[:, 2:] / np.pi * RGB),
    "clay": ({"kind": "matte", "reflectance": RGB, "sigma_degrees": 30}, lambda i, o: oren_nayar(i, o, 30) * RGB),
    "moon": ({"kind": "matte", "reflectance": RGB, "sigma_degrees": 90}, lambda i, o: oren_nayar(i, o, 90) * RGB),
    "leaf": (LEAF, lambda i, o: o[:, 2:] / np.pi * RGB),
    "conductor": (
        {"kind": "conductor", "reflectance": RGB, "alpha": 0.2},
        lambda i, o: bsdfs.conductor(i, o, (0.2, 0.2), lambda c: np.array(RGB) + 0 * c),
    ),
    "brushed": (
        {"kind": "conductor", "reflectance": RGB, "alpha": [0.1, 0.6]},
        lambda i, o: bsdfs.conductor(i, o, (0.1, 0.6), lambda c: np.array(RGB) + 0 * c),
    ),
    "gold": (
        {"kind": "conductor", "metal": "gold", "roughness": 0.5},
        lambda i, o: bsdfs.conductor(i, o, (0.25, 0.25), gold),
    ),
    "coloured gloss": (
        {"kind": "principled", "base_color": 0, "roughness": 0.5, "index": 2, "specular": 0.8, "specular_color": RGB},
        lambda i, o: bsdfs.conductor(i, o, (0.25, 0.25), tinted),
    ),
    "rough sheen": (BLACK_CLOTH | {"sheen_roughness": 1.0}, lambda i, o: bsdfs.sheen(i, o, 1.0) * RGB),
    "sheen": (BLACK_CLOTH | {"sheen_roughness": 0.5}, lambda i, o: bsdfs.sheen(i, o, 0.25) * RGB),
    # below a roughness of 0.25 the formula wins energy: it is divided by the largest share that comes back
    "fine sheen": (
        BLACK_CLOTH | {"sheen_roughness": 0.15},
        lambda i, o: sheen_lobe(0.0225)[0] * bsdfs.sheen(i, o, 0.0225) * RGB,
    ),
    "hair": (
        {"kind": "hair", "reflectance": RGB},
        lambda i, o: bsdfs.hair(i, o, RGB, across=0.5),
    ),
    "straight hair": (
        {"kind": "hair", "reflectance": RGB, "roughness": 0.15, "roughness_across": 0.7, "tilt_degrees": -4},
        lambda i, o: bsdfs.hair(i, o, RGB, across=0.5, roughness=0.15, around=0.7, tilt_degrees=-4),
    ),
    "plastic": (
        {"kind": "plastic", "reflectance": RGB, "index": 1.4},
        lambda i, o: bsdfs.smooth_plastic(i, o, RGB, 1.4),
    ),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_value_is_that_of_the_formula(session, name):
    material, formula = FORMULAS[name]
    got = scatter(session, material, UP, OTHER).value
    expected = formula(UP, OTHER)
    np.testing.assert_allclose(got, expected, rtol=2e-4, atol=1e-6 * expected.max())


@pytest.mark.parametrize("alpha", [0.15, 0.5])
@pytest.mark.parametrize("index", [0.7, 1.5])
@pytest.mark.parametrize("behind", [False, True])
def test_rough_dielectric_is_walters(session, alpha, index, behind):
    material = {"kind": "dielectric", "alpha": alpha, "index": index}
    flip = np.array([1, 1, -1.0]) if behind else np.ones(3)
    eta = 1 / index if behind else index
    for wo in (OTHER, BELOW):
        got = scatter(session, material, UP * flip, wo * flip).value
        expected = bsdfs.rough_dielectric(UP, wo, (alpha, alpha), eta)
        np.testing.assert_allclose(got, expected, rtol=2e-3, atol=1e-5 * expected.max())


@pytest.mark.parametrize("flip", [1, -1])
def test_a_leaf_passes_its_own_share_either_way(session, flip):
    got = scatter(session, LEAF, UP * flip, BELOW * flip).value
    np.testing.assert_allclose(got, OTHER[:, 2:] / np.pi * LEAF["transmittance"], rtol=2e-4)


@pytest.mark.parametrize("behind", [False, True])
def test_tints_of_frosted_glass_are_factors(session, behind):
    plain = {"kind": "dielectric", "alpha": 0.3}
    tinted = plain | {"reflectance": RGB, "transmittance": [0.2, 0.4, 0.6]}
    flip = np.array([1, 1, -1.0]) if behind else np.ones(3)
    for wo, tint in ((OTHER, RGB), (BELOW, [0.2, 0.4, 0.6])):
        expected = scatter(session, plain, UP * flip, wo * flip).value * tint
        assert (expected > 0).mean() > 0.1
        np.testing.assert_allclose(scatter(session, tinted, UP * flip, wo * flip).value, expected, rtol=1e-5)


def test_tints_of_smooth_glass_are_factors(session):
    plain = {"kind": "dielectric"}
    tinted = plain | {"reflectance": RGB, "transmittance": [0.2, 0.4, 0.6]}
    numbers = RNG.integers(0, 1 << 24, (COUNT, 3)) / (1 << 24)
    before, after = (scatter(session, material, UP, numbers=numbers) for material in (plain, tinted))
    np.testing.assert_array_equal(before.direction, after.direction)
    tint = np.where(before.direction[:, 2:] > 0, RGB, [0.2, 0.4, 0.6])
    assert 0.02 < (before.direction[:, 2] > 0).mean() < 0.98
    np.testing.assert_allclose(after.weight, before.weight * tint, rtol=1e-6)


@pytest.mark.parametrize("alpha", [0.15, 0.5])
def test_rough_plastic_is_its_formula_to_the_fit_of_its_cover(session, alpha):
    material = {"kind": "plastic", "reflectance": RGB, "alpha": alpha}
    keep = (UP[:, 2] > 0.1) & (OTHER[:, 2] > 0.1)
    got = scatter(session, material, UP[keep], OTHER[keep]).value
    expected = bsdfs.rough_plastic(UP[keep], OTHER[keep], RGB, 1.5, (alpha, alpha))
    np.testing.assert_allclose(got, expected, rtol=0.03)


def test_principled_is_the_same_whatever_else_the_scene_has(session, monkeypatch):
    material = {"kind": "principled", "base_color": RGB, "roughness": 0.3, "metallic": 0.2, "sheen": 0.3}
    among = scatter(session, material, UP, OTHER).value
    for name in ("ROUGH_PLASTIC", "PLASTIC", "ROUGH_DIELECTRIC"):
        monkeypatch.setitem(scattering.FACTS, f"HAS_{name}", 0)
    np.testing.assert_allclose(scatter(session, material, UP, OTHER).value, among, rtol=2e-6)


SYMMETRIC = {
    "matte": {"kind": "matte", "reflectance": RGB},
    "clay": {"kind": "matte", "reflectance": RGB, "sigma_degrees": 40},
    "brushed": {"kind": "conductor", "reflectance": RGB, "alpha": [0.1, 0.6]},
    "copper": {"kind": "conductor", "metal": "copper", "roughness": 0.5},
    "plastic": {"kind": "plastic", "reflectance": RGB},
    "rough plastic": {"kind": "plastic", "reflectance": RGB, "alpha": 0.3},
    "principled": {"kind": "principled", "base_color": RGB, "metallic": 0.3, "clearcoat": 0.7, "anisotropy": 0.4},
    "coloured gloss": {"kind": "principled", "base_color": [0.1, 0.5, 0.9], "specular_color": RGB, "index": 3},
    "cloth": {
        "kind": "principled",
        "base_color": RGB,
        "sheen": [0.3, 0.6, 0.9],
        "sheen_roughness": 0.6,
        "clearcoat": 0.4,
    },
}


@pytest.mark.parametrize("again", [False, True])
@pytest.mark.parametrize("name", SYMMETRIC)
def test_reflection_is_the_same_either_way(session, name, again):
    there = scatter(session, SYMMETRIC[name], UP, OTHER, again=again).value / OTHER[:, 2:]
    back = scatter(session, SYMMETRIC[name], OTHER, UP, again=again).value / UP[:, 2:]
    np.testing.assert_allclose(there, back, rtol=2e-4, atol=1e-6 * there.max())


@pytest.mark.parametrize("kind", ["dielectric", "principled"])
def test_refraction_is_the_same_either_way_but_for_the_square_of_the_index(session, kind):
    own = {"alpha": 0.4} if kind == "dielectric" else {"roughness": 0.6, "transmission": 1.0, "base_color": RGB}
    material = {"kind": kind, "index": 1.5} | own
    there = scatter(session, material, UP, BELOW).value / OTHER[:, 2:]
    back = scatter(session, material, BELOW, UP).value / UP[:, 2:]
    assert (there > 0).mean() > 0.1
    np.testing.assert_allclose(there * 1.5**2, back, rtol=2e-3, atol=1e-5 * back.max())


GRAZING = {
    "conductor": {"kind": "conductor", "reflectance": 1},
    "metal": {"kind": "conductor", "metal": "iron"},
    "dielectric": {"kind": "dielectric"},
    "plastic": {"kind": "plastic", "reflectance": 1},
}


@pytest.mark.parametrize("again", [False, True])
@pytest.mark.parametrize("alpha", [1e-3, 0.03, 1.0])
@pytest.mark.parametrize("name", GRAZING)
def test_grazing_light_gives_numbers(session, name, alpha, again):
    cosines = np.array([0, 1e-30, 1e-12, 1e-6, 1e-3, 0.5, 1.0])
    wi, wo, u, lobe = np.meshgrid(cosines, np.r_[-cosines, cosines], [0, 0.3, 1 - 2**-24], [0, 0.5, 1 - 2**-24])
    for side in (1, -1):
        got = scatter(
            session, GRAZING[name] | {"alpha": alpha}, side * direction(wi.ravel(), 0.1),
            direction(wo.ravel(), 0.6), np.stack([u.ravel(), u.ravel()[::-1], lobe.ravel()], 1), again=again,
        )  # fmt: skip
        for numbers in (got.value, got.pdf, got.weight, got.sampled_pdf, got.direction):
            assert np.isfinite(numbers).all()
        assert got.weight.min() >= 0 and got.value.min() >= 0
        # n^2 on the way out of glass; a mixture of lobes is chosen by their albedos, not by their values
        assert got.weight.max() <= (50 if again else 3 if name == "plastic" else 1.5**2 * (1 + 1e-3))


@pytest.mark.parametrize("again", [False, True])
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.2, 1.0])
def test_principled_gives_numbers_at_grazing_light(session, metallic, roughness, again):
    cosines = np.array([0, 1e-30, 1e-12, 1e-6, 1e-3, 0.5, 1.0])
    wi, wo, u, lobe = np.meshgrid(cosines, np.r_[-cosines, cosines], [0, 0.3, 1 - 2**-24], [0, 0.5, 1 - 2**-24])
    material = {
        "kind": "principled", "roughness": roughness, "metallic": metallic, "transmission": 0.5, "clearcoat": 1,
        "sheen": RGB, "sheen_roughness": roughness,
    }  # fmt: skip
    for side in (1, -1):
        got = scatter(
            session, material, side * direction(wi.ravel(), 0.1), direction(wo.ravel(), 0.6),
            np.stack([u.ravel(), u.ravel()[::-1], lobe.ravel()], 1), again=again,
        )  # fmt: skip
        for numbers in (got.value, got.pdf, got.weight, got.sampled_pdf, got.direction):
            assert np.isfinite(numbers).all()


@pytest.mark.parametrize("name", METALS)
def test_metal_reflects_the_colour_of_its_spectrum(session, name):
    # facets of a nearly smooth metal all face the light: the weight of a sample is Fresnel's reflectance
    for degrees in (0, 60, 80):
        cosine = np.cos(np.radians(degrees))
        got = scatter(session, {"kind": "conductor", "metal": name, "alpha": 1e-3}, direction(cosine)).weight[0]
        np.testing.assert_allclose(got, metal_colour(name, float(cosine)), atol=0.025 if name == "gold" else 0.006)


def test_rough_glass_tends_to_smooth_glass(session):
    rng = np.random.default_rng(5)
    numbers = rng.uniform(size=(COUNT, 3))
    for cosine in (1.0, 0.6, 0.2):
        for side in (1, -1):
            wi = side * direction(cosine)
            smooth = scatter(session, {"kind": "dielectric"}, wi, numbers=numbers)
            rough = scatter(session, {"kind": "dielectric", "alpha": 1e-3}, wi, numbers=numbers)
            same = np.sign(smooth.direction[:, 2]) == np.sign(rough.direction[:, 2])
            assert same.mean() > 0.995  # but where the number lies between both reflectances
            assert np.abs(rough.direction - smooth.direction)[same].mean() < 3e-3
            np.testing.assert_allclose(rough.weight[same].mean(), smooth.weight[same].mean(), rtol=2e-3)
