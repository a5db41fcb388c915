"""The same bits whatever the wave size, process or crop; other noise with another seed."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from tests.rendering.pictures import pixels
from tests.rendering.test_emitters import ground_under, rectangle_above
from tests.rendering.test_world import still_life
from tests.support.cases import slow
from tests.support.statistics import assert_same_tiles, sampled

LENS = {
    "kind": "realistic",
    "lens": "dgauss-50mm",
    "focus": {"distance_m": 5.0},
    "eye": [0.5, -5, 2],
    "target": [0, 0, 0.5],
    "up": [0, 0, 1],
}
THROUGH = {"pinhole": {}, "lens": {"camera": LENS}}
SIZE, SPP = (150, 90), 9  # no multiple of a tile, a block or a wave


def scene(name):
    return still_life() | THROUGH[name]


def bits(scene_or_file, **options):
    film = np.asarray(rptcam_cl.render(scene_or_file, size=SIZE, spp=SPP, **options))
    return hashlib.sha256(film.tobytes()).hexdigest()


@pytest.fixture(scope="module", params=THROUGH)
def named(request):
    return request.param, bits(scene(request.param), seed=3)


@pytest.mark.parametrize("wave_size", [1024, *map(slow, (1, 4097, 65536, 1 << 20))])
def test_wave_size_does_not_change_a_bit(named, wave_size):
    name, plain = named
    assert bits(scene(name), seed=3, wave_size=wave_size) == plain


def test_second_render_in_a_process_is_the_same(named):
    name, plain = named
    assert bits(scene(name), seed=3) == plain


@pytest.mark.slow  # `test_resume.py` has another process go on to the same bits
@pytest.mark.parametrize("named", THROUGH, indirect=True)
def test_another_process_makes_the_same_bits(named):
    name, plain = named
    program = f"from tests.rendering import test_determinism as t; print(t.bits(t.scene({name!r}), seed=3))"
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=root)
    assert done.stdout.split() == [plain], done.stderr


@pytest.mark.parametrize("seed", [0, 4, 2**32 + 3, 2**64 - 1])
def test_another_seed_makes_other_noise(named, seed):
    name, plain = named
    assert bits(scene(name), seed=seed) != plain


def test_seeds_agree_in_the_mean():
    pictures = [pixels(scene("pinhole"), size=(48, 32), seed=seed, spp=64) for seed in range(8)]
    assert_same_tiles(sampled(pictures[:4]), sampled(pictures[4:]))


INDEPENDENT = ["render.sampler=independent"]


def noise(seed, spp=1, overrides=()):
    """Noise of 128 x 128 pixels that all estimate the same direct light."""
    scene = rptcam_cl.load_scene(ground_under([rectangle_above()]), overrides)
    film = pixels(scene, size=(128, 128), seed=seed, spp=spp)[..., 0]
    return film - film.mean()


def correlation(a, b):
    return np.corrcoef(a.ravel(), b.ravel())[0, 1]


CORRELATION = 4 / 128  # four standard deviations of that of 16384 independent pairs


def test_neighbouring_seeds_are_independent():
    first = noise(7)
    for seed in (6, 8, 7 + 2**32):
        assert abs(correlation(first, noise(seed))) < CORRELATION


def test_neighbouring_pixels_are_independent():
    film = noise(7)
    for shifted, still in ((film[1:], film[:-1]), (film[:, 1:], film[:, :-1]), (film[:, 4:], film[:, :-4])):
        assert abs(correlation(shifted, still)) < CORRELATION


def test_variance_of_independent_samples_falls_as_one_over_their_number():
    # 16384 pixels know a variance to 1.5 %
    assert noise(7, 64, INDEPENDENT).var() * 64 == pytest.approx(noise(8, 1, INDEPENDENT).var(), rel=0.06)


@pytest.mark.slow
def test_variance_of_smooth_light_falls_far_faster_on_the_lattice():
    assert noise(7, 64).var() < noise(7, 64, INDEPENDENT).var() / 15
    assert noise(7, 1024).var() < noise(7, 1024, INDEPENDENT).var() / 150


@pytest.mark.slow
def test_samplers_agree_in_the_mean_and_the_lattice_is_less_noisy():
    options = {"size": (48, 32), "spp": 64}
    one, other = (
        [pixels(rptcam_cl.load_scene(scene("lens"), overrides), seed=seed, **options) for seed in range(8)]
        for overrides in ((), INDEPENDENT)
    )
    assert_same_tiles(sampled(one), sampled(other))
    # the typical pixel: caustics, which no sampler tames, rule the mean of the variances
    assert np.median(np.var(one, axis=0) / np.var(other, axis=0)) < 1 / 1.8


@pytest.mark.parametrize("crop", [(0.25, 0.75, 0.5, 1.0), (0.0, 0.02, 0.0, 1.0), (0.62, 0.63, 0.31, 0.33)])
def test_crop_is_the_part_of_the_picture_bit_for_bit(named, crop):
    name, _ = named
    whole = pixels(scene(name), size=SIZE, spp=SPP, seed=3)
    part = pixels(scene(name), size=SIZE, spp=SPP, seed=3, crop=crop)
    (width, height), (x0, x1, y0, y1) = SIZE, crop
    left, right, top, bottom = round(x0 * width), round(x1 * width), round(y0 * height), round(y1 * height)
    np.testing.assert_array_equal(part, whole[top:bottom, left:right])


def test_size_of_one_pixel_works(named):
    name, _ = named
    assert pixels(scene(name), size=(1, 1), spp=3).shape == (1, 1, 3)


@pytest.mark.slow
def test_independent_samples_converge_with_the_square_root():
    truth = pixels(scene("pinhole"), size=(48, 32), seed=100, spp=4096)
    counts = [4, 16, 64]
    errors = []
    for count in counts:
        independent = rptcam_cl.load_scene(scene("pinhole"), INDEPENDENT)
        trials = [pixels(independent, size=(48, 32), seed=seed, spp=count) for seed in range(4)]
        errors.append(np.sqrt(np.mean([np.square(trial - truth).mean() for trial in trials])))
    # correlated samples would flatten it; heavy tails keep 0.07 of play
    assert np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(-0.5, abs=0.07)
