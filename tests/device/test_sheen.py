"""The sheen of cloth: its shadowing, the share that it sends back, and what it leaves of the surface below."""

import numpy as np
import pytest

from rptcam_cl.rendering.plan.materials import sheen_albedo, sheen_lobe
from tests.device import bsdfs
from tests.device.scattering import direction, scatter
from tests.support.cases import slow

WHITE = [1.0, 1.0, 1.0]
ALPHAS = [0.01, 0.04, 0.16, 0.36, 1.0]
SOME_ALPHAS = [a if a in (ALPHAS[0], 0.16, ALPHAS[-1]) else slow(a) for a in ALPHAS]


def hemisphere(count):
    """Directions of equal solid angle."""
    cosine, turn = np.meshgrid((np.arange(count) + 0.5) / count, (np.arange(count) + 0.5) / count)
    return direction(cosine.ravel(), turn.ravel())


def exact_lambda(cosine, alpha):
    """Smith's Lambda: the area of all normals seen from a direction over that of the surface."""
    theta = (np.arange(2000) + 0.5) / 2000 * np.pi / 2
    turn = (np.arange(1000) + 0.5) / 1000 * np.pi
    seen = np.sqrt(1 - cosine**2) * np.outer(np.sin(theta), np.cos(turn)) + cosine * np.cos(theta)[:, None]
    around = 2 * np.pi * np.maximum(seen, 0).mean(axis=1)
    density = bsdfs.sheen_density(np.sin(theta), alpha)
    return np.sum(around * density * np.sin(theta)) * np.pi / 4000 / cosine - 1


@pytest.mark.parametrize("alpha", [0.25, 0.5, 1.0])
def test_fitted_lambda_is_nearly_smiths(alpha):
    # the fit by Estevez and Kulla is their own; a wrong digit of it would show
    for cosine in (0.05, 0.2, 0.5, 0.8):
        assert bsdfs.sheen_lambda(np.array(cosine), alpha) == pytest.approx(exact_lambda(cosine, alpha), rel=0.2)


@pytest.mark.parametrize("alpha", SOME_ALPHAS)
def test_share_sent_back_is_the_integral_of_the_formula(alpha):
    wo = hemisphere(600)
    for cosine in (0.1, 0.4, 0.9):
        expected = 2 * np.pi * bsdfs.sheen(direction(cosine)[None], wo, alpha).mean()
        assert sheen_albedo(cosine, alpha) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("alpha", SOME_ALPHAS)
def test_fit_of_the_share_is_from_above_and_close(alpha):
    scale, members = sheen_lobe(alpha)
    roots = np.linspace(0.1, 1, 20)
    share = scale * np.array([sheen_albedo(root**2, alpha) for root in roots])
    fit = np.exp(sum(c * roots**i for i, c in enumerate((*members["sheen_cover"], members["sheen_last"]))))
    off = fit - share
    assert off.min() > -0.003
    assert np.average(off, weights=roots**3) < 0.005
    assert off.max() < 0.08


@pytest.mark.parametrize("alpha", SOME_ALPHAS)
def test_no_direction_gets_back_more_than_arrives(alpha):
    most = max(sheen_albedo(cosine, alpha) for cosine in np.geomspace(1e-4, 1, 20))
    assert sheen_lobe(alpha)[0] * most <= 1 + 1e-3
    assert (sheen_lobe(alpha)[0] == 1) == (alpha > 0.0625)


@pytest.mark.parametrize("roughness", [0.3, slow(0.6), 1.0])
@pytest.mark.parametrize("again", [False, True])
def test_base_gets_what_the_sheen_leaves(session, roughness, again):
    base = {"kind": "principled", "base_color": [0.8, 0.4, 0.2], "roughness": 0.7}
    sheen = {"sheen": [0.2, 0.9, 0.5], "sheen_roughness": roughness}
    rng = np.random.default_rng(5)
    wi, wo = (direction(rng.uniform(0.05, 1, 2048), rng.uniform(size=2048)) for _ in range(2))
    black = base | {"base_color": 0, "specular": 0} | sheen
    both, alone, below = (scatter(session, each, wi, wo, again=again).value for each in (base | sheen, black, base))
    cosines = np.linspace(0.2, 1, 16) ** 2
    share = [sheen_albedo(cosine, roughness**2) for cosine in cosines]
    # of the largest channel; of the lower of both directions, or where nothing is lost of both, over even light
    seen, lit = (1 - 0.9 * np.interp(w[:, 2], cosines, share) for w in (wi, wo))
    even = 1 - 0.9 * np.mean([sheen_albedo(cosine, roughness**2) for cosine in np.sqrt((np.arange(32) + 0.5) / 32)])
    left = seen * lit / even if again else np.minimum(seen, lit)
    off = (both - alone) / below - left[:, None]
    assert np.abs(off).max() < 0.08  # what the fit of the share may be off where it grazes
    assert np.abs(off).mean() < 0.02


@pytest.mark.parametrize("roughness", [0.1, slow(0.5), 1.0])
def test_white_cloth_over_a_white_base_keeps_its_light(session, roughness):
    """All of it with the light that fibres and base pass between them, to the fit of the share at grazing angles."""
    rng = np.random.default_rng(8)
    cloth = {"kind": "principled", "base_color": WHITE, "specular": 0, "sheen": WHITE, "sheen_roughness": roughness}
    for cosine, least, again in (
        (0.1, 0.85, False),
        (0.4, 0.85, False),
        (1.0, 0.85, False),
        (0.4, 0.985, True),
        (1.0, 0.985, True),
    ):
        numbers = rng.uniform(size=(1 << 17, 3))
        got = scatter(session, cloth, direction(cosine), numbers=numbers, again=again).weight[:, 1]
        error = got.std() / np.sqrt(len(got))
        # once, the base loses at both directions what the larger share of both is
        assert least - 4 * error < got.mean() < 1 + 4 * error, (cosine, got.mean())
