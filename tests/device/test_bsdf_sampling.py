"""The kernels' BSDFs are sampled with the density that they state, and send back no more light than they get."""

from functools import cache, partial

import numpy as np
import pytest

from tests.device import scattering
from tests.device.scattering import direction
from tests.rendering.pictures import seed_of
from tests.support.cases import fast
from tests.support.statistics import ALPHA, Z, chi_squared, moment_scores, sidak

scatter = partial(scattering.scatter, again=True)
COUNT = 1 << 16
BANDS, SECTORS, INNER = 24, 24, 12
WHITE = [1.0, 1.0, 1.0]
MATERIALS = {
    "matte": {"kind": "matte", "reflectance": WHITE},
    "clay": {"kind": "matte", "reflectance": WHITE, "sigma_degrees": 35},
    "leaf": {"kind": "translucent", "reflectance": 0.3, "transmittance": 0.7},
    "stained": {"kind": "dielectric", "alpha": 0.3, "reflectance": 0.8, "transmittance": 0.9},
    "conductor": {"kind": "conductor", "reflectance": WHITE, "alpha": 0.3},
    "brushed": {"kind": "conductor", "reflectance": WHITE, "alpha": [0.2, 0.7]},
    "copper": {"kind": "conductor", "metal": "copper", "roughness": 0.7},
    "frosted": {"kind": "dielectric", "alpha": 0.3},
    "frosted bubble": {"kind": "dielectric", "alpha": 0.4, "index": 0.7},
    "plastic": {"kind": "plastic", "reflectance": WHITE},
    "rough plastic": {"kind": "plastic", "reflectance": WHITE, "alpha": 0.25},
    "principled": {"kind": "principled", "base_color": WHITE, "roughness": 0.6},
    "brushed base": {"kind": "principled", "base_color": WHITE, "roughness": 0.5, "anisotropy": 0.8},
    "brushed plastic": {"kind": "plastic", "reflectance": WHITE, "alpha": [0.2, 0.7]},
    "principled metal": {"kind": "principled", "base_color": WHITE, "metallic": 0.6, "anisotropy": 0.6},
    "coated": {
        "kind": "principled", "base_color": WHITE, "clearcoat": 1.0, "clearcoat_roughness": 0.5, "roughness": 0.9,
    },
    "cloth": {"kind": "principled", "base_color": WHITE, "roughness": 0.8, "sheen": WHITE, "sheen_roughness": 0.4},
    "fine cloth": {"kind": "principled", "base_color": 0, "specular": 0, "sheen": WHITE, "sheen_roughness": 0.15},
    "oiled": {
        "kind": "principled", "base_color": WHITE, "roughness": 0.6, "metallic": 0.3,
        "thin_film": {"thickness_nm": 250, "index": 2.5},
    },
    "clear": {"kind": "principled", "base_color": WHITE, "transmission": 1.0, "roughness": 0.6},
    "white hair": {"kind": "hair", "reflectance": 1.0, "roughness": 0.2, "roughness_across": 0.5},
    "black hair": {"kind": "hair", "eumelanin": 8, "roughness": 0.6, "roughness_across": 0.15, "tilt_degrees": 5},
    "all": {
        "kind": "principled", "base_color": WHITE, "transmission": 0.5, "metallic": 0.2, "clearcoat": 0.6,
        "clearcoat_roughness": 0.5, "roughness": 0.6, "sheen": [0.6, 0.3, 0.1],
    },
}  # fmt: skip
# Every lobe, in what has the most of its numbers; the others have less, or the same with other numbers.
QUICK = {
    "clay", "leaf", "stained", "brushed", "copper", "frosted bubble", "rough plastic", "brushed plastic", "coated",
    "fine cloth", "oiled", "white hair", "black hair", "all",
}  # fmt: skip
COSINES = (1.0, 0.6, 0.15)
CLEAR = ("leaf", "stained", "frosted", "frosted bubble", "clear", "white hair", "black hair", "all")
CASES = [(cosine, side) for cosine in COSINES for side in (1, -1)]
LEVEL = sidak(ALPHA, 60)  # of each of the comparisons


def cases(name):
    """Cosine and side of the light for a material: opaque ones look the same from behind."""
    return CASES if name in CLEAR else [*CASES[::2], CASES[3]]


def numbers(name):
    rng = np.random.default_rng(seed_of(name))
    return rng.integers(0, 1 << 24, (COUNT, 3)) / (1 << 24)


def cells(directions):
    """Cell of each direction on a grid of equal areas about the y axis: lobes are not at its poles."""
    band = np.clip(((directions[:, 1] + 1) / 2 * BANDS).astype(int), 0, BANDS - 1)
    turns = np.arctan2(directions[:, 2], directions[:, 0]) / (2 * np.pi) % 1
    return band * SECTORS + np.clip((turns * SECTORS).astype(int), 0, SECTORS - 1)


@cache
def middles():
    """Directions in the middles of a grid finer than the cells, shape (n, 3)."""
    band = (np.arange(BANDS * INNER) + 0.5) / (BANDS * INNER) * 2 - 1
    turn = (np.arange(SECTORS * INNER) + 0.5) / (SECTORS * INNER)
    return direction(*np.meshgrid(band, turn, indexing="ij")).reshape(-1, 3)[:, [0, 2, 1]]


def expected_counts(session, material, wi):
    """Samples that each cell gets by the stated density, by midpoints."""
    pdf = scatter(session, material, wi, middles()).pdf.reshape(BANDS, INNER, SECTORS, INNER)
    return COUNT * pdf.mean(axis=(1, 3)).ravel() * 4 * np.pi / (BANDS * SECTORS)


def agreement(session, got, material, wi):
    """Return the p-value of samples against the density of a material, and how many more samples it expects."""
    spread = got.sampled_pdf > 0
    observed = np.bincount(cells(got.direction[spread]), minlength=BANDS * SECTORS)
    expected = expected_counts(session, material, wi)
    seen = expected > 1e-3  # of a sample; less is noise of the quadrature
    assert observed[~seen].sum() <= 3
    p = chi_squared(observed[seen], expected[seen] * observed[seen].sum() / expected[seen].sum())
    return p, expected.sum() - spread.sum()


@pytest.mark.parametrize("name", fast(QUICK, MATERIALS))
def test_weight_of_a_sample_is_value_over_density(session, name):
    for cosine, side in cases(name):
        wi = direction(cosine, 0.05) * side
        sampled = scatter(session, MATERIALS[name], wi, numbers=numbers(name)[:4096])
        spread = sampled.sampled_pdf > 0
        again = scatter(session, MATERIALS[name], wi, sampled.direction[spread])
        np.testing.assert_allclose(again.pdf, sampled.sampled_pdf[spread], rtol=2e-3)
        expected = again.value / again.pdf[:, None]
        np.testing.assert_allclose(sampled.weight[spread], expected, rtol=2e-3, atol=1e-6)


# Least albedo of each material: what single scattering and the fits of covers lose at most at these angles.
LEAST = {
    "matte": 1 - 1e-6,
    "plastic": 0.999,
    "rough plastic": 0.96,
    "principled": 0.95,
    "cloth": 0.87,
    "fine cloth": 0,
    "white hair": 0.999,
    "black hair": 0.03,
}


FIT = 1.0032  # of the share that facets scatter once, by which more may come back


@pytest.mark.parametrize("name", fast(QUICK, MATERIALS))
def test_samples_follow_the_density_and_no_more_light_comes_back(session, name):
    index = 1.0 if name == "leaf" or "hair" in name else MATERIALS[name].get("index", 1.5)
    for cosine, side in [*cases(name), (0.02, 1)]:
        wi = direction(cosine, 0.05) * side
        got = scatter(session, MATERIALS[name], wi, numbers=numbers(name))
        if cosine > 0.02:
            p, more = agreement(session, got, MATERIALS[name], wi)
            assert p > LEVEL, (cosine, side, p)
            # the rest is delta light or has no way on: a count of chance
            assert abs(more) < Z * 0.5 * np.sqrt(COUNT), (cosine, side, more)
        # radiance behind a surface of index n is n^2 times as large: undone, so that energy is compared
        beyond = np.sign(got.direction[:, 2]) != side
        energy = got.weight[:, 1] * np.where(beyond, index ** (2 * side), 1.0)
        mean, error = energy.mean(), energy.std() / np.sqrt(COUNT)
        assert mean <= FIT + Z * error, (cosine, side, mean)
        assert mean >= LEAST.get(name, 0.3) - Z * error, (cosine, side, mean)


def test_wrong_density_is_found(session):
    # the control: samples of one roughness against the density of another that is 5 % smaller
    wi = direction(0.6, 0.05)
    got = scatter(session, {"kind": "conductor", "reflectance": 1, "alpha": 0.3}, wi, numbers=numbers("control"))
    p, _ = agreement(session, got, {"kind": "conductor", "reflectance": 1, "alpha": 0.285}, wi)
    assert p < LEVEL


def test_cosines_of_matte_samples_have_their_moments(session):
    got = scatter(session, MATERIALS["matte"], direction(0.6), numbers=numbers("moments"))
    z = got.direction[:, 2]
    assert np.abs(moment_scores(np.stack([z, z**2], 1), [2 / 3, 1 / 2])).max() < Z
