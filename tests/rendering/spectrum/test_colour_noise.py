"""The noise that choosing wavelengths adds to white light, per sample: as it was worked out, and small."""

import numpy as np
import pytest

from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.rendering.plan.plan import least_noise, primary_spectra
from tests.rendering.pictures import WHITE, looking, pixels, scene_of, seed_of
from tests.rendering.spectrum.scenes import SINGLET_BACK_MM, room, singlet, white_wall
from tests.rendering.spectrum.test_modes import FORCED, GLASS_BALL


def noise(values, weights=None):
    """Variances of the luminance of colours (n, 3), and of the differences of red and blue to it together."""
    bright = values @ LUMINANCE
    parts = np.column_stack([bright, values[:, 0] - bright, values[:, 2] - bright])
    mean = np.average(parts, axis=0, weights=weights)
    variance = np.average((parts - mean) ** 2, axis=0, weights=weights)
    return variance[0], variance[1] + variance[2]


def sky(**rest):
    world = looking([0, 0, 0], [0, 1, 0])
    scene = scene_of([], world, environment=WHITE, depth=1, resolution=(128, 128), **rest)
    return {**scene, "render": {**scene["render"], "sampler": "independent"}}


def test_three_wavelengths_of_white_leave_little_noise():
    film = pixels(sky(spectrum="spectral"), seed=seed_of("three"), spp=1).reshape(-1, 3)
    luminance, colour = noise(film)
    assert luminance < 0.02
    assert colour < 0.25  # 11 with one wavelength


def test_noise_of_one_wavelength_is_the_least_that_there_is():
    spectra = primary_spectra()
    found = {}
    for name, density in {"least": least_noise(spectra), "mean": spectra.mean(axis=1)}.items():
        seen = density > 0
        share = (density / density.sum())[seen]
        found[name] = noise(spectra[seen] / share[:, None], share)
    assert sum(found["least"]) < 0.96 * sum(found["mean"])
    scene = white_wall(singlet(1e9), SINGLET_BACK_MM[15], resolution=(128, 128), spectrum=FORCED["dispersive"])
    scene["film"]["size_mm"] = [0.005, 0.005]
    scene["render"]["sampler"] = "independent"
    film = pixels(scene, seed=seed_of("one"), spp=1).reshape(-1, 3)
    lit = film[film.max(axis=1) > 0]
    share = len(lit) / len(film)  # of rays, the others are stopped
    luminance, colour = noise(lit * share)
    assert luminance == pytest.approx(found["least"][0], rel=0.05)
    assert colour == pytest.approx(found["least"][1], rel=0.05)


def test_light_that_meets_no_dispersive_glass_has_the_noise_of_rgb():
    pictures = {mode: pixels({**room(GLASS_BALL), "spectrum": mode}, seed=3, spp=4) for mode in ("rgb", "dispersive")}
    same = np.isclose(pictures["rgb"], pictures["dispersive"], rtol=1e-5, atol=1e-6).all(axis=-1)
    assert 0.5 < same.mean() < 0.98  # sample by sample, away from the ball and what it lights
