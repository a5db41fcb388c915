"""The lattice of kernels/common/sampler.h: uniform, stratified, even in every pair that paths depend on, unbiased."""

import itertools
import re
from functools import cache

import numpy as np
import pytest

from rptcam_cl.core.files import kernels_dir
from rptcam_cl.studies.selfcheck import CORNERS, pcg4d, random_numbers
from tests.support.statistics import ALPHA, Z, assert_equivalent, chi_squared, sidak

MASK = (1 << 32) - 1
SEED = (12345, 67890)
DIMENSIONS = {
    "camera": 0, "unused": 1, "first direction": 2, "first light": 3, "second direction": 4, "second light": 5,
    "third direction": 6, "third light": 7, "late direction": 40, "late light": 41, "last": MASK,
}  # fmt: skip


def numbers(session, pixel, sample, dimension, *, lanes=8, lattice=True, seed=SEED):
    """Four numbers per counter, shape (n, 4)."""
    return random_numbers(session, pixel, sample, dimension, seed, lanes=lanes, lattice=lattice)


@cache
def vector():
    """The generating vector as the kernel holds it, shape (4 numbers, 4 uses): camera, light, first and other edges."""
    text = (kernels_dir() / "common" / "sampler.h").read_text("utf-8")
    rows = re.findall(r"component\(dimension, (\d+)u, (\d+)u, (\d+)u, (\d+)u\)", text)
    return np.array(rows, np.int64)


def mirrored(sample):
    return int(f"{sample:032b}"[::-1], 2)


def permuted(x, seed):
    x ^= x * 0x3D20ADEA & MASK
    x = (x + seed & MASK) * (seed >> 16 | 1) & MASK
    x ^= x * 0x05526C56 & MASK
    return x ^ x * 0x53A22864 & MASK


def expected(pixel, sample, dimension):
    """Four numbers by the text of the sampler's comment, in Python's integers."""
    shift = pcg4d(pixel, 0, dimension ^ SEED[1], SEED[0])
    light = dimension % 2 == 1
    phi = mirrored(sample)
    if dimension >= 6 and not light:
        phi = permuted(phi, shift[0] ^ (shift[2] << 16 & MASK | shift[2] >> 16))
    use = 1 if light else {0: 0, 2: 2}.get(dimension, 3)
    return [(shift[k] + phi * int(vector()[k, use]) & MASK) >> 8 for k in range(4)]


@pytest.mark.parametrize("lanes", [1, 8, 16])
def test_device_computes_the_lattice_that_is_described(session, lanes):
    rng = np.random.default_rng(3)
    grid = np.array(list(itertools.product(CORNERS[:4], CORNERS, DIMENSIONS.values())))
    counters = np.concatenate([rng.integers(0, 1 << 32, (1024 - len(grid), 3)), grid])
    got = numbers(session, *counters.T, lanes=lanes)
    words = np.array([expected(*map(int, counter)) for counter in counters])
    np.testing.assert_array_equal(got, words.astype(np.float32) * np.float32(2**-24))


@pytest.mark.parametrize(("first", "count"), [(0, 16), (48, 16), (0, 4096), (8192, 4096)])
def test_aligned_power_of_two_of_samples_has_one_in_every_stratum(session, first, count):
    samples = np.arange(first, first + count)
    for dimension, pixel in itertools.product(DIMENSIONS.values(), (0, 77, MASK)):
        values = numbers(session, pixel, samples, dimension)
        for column in values.T.astype(float):
            # the shift moves the strata; all gaps round the circle are equal up to the rounding to 24 bits
            ordered = np.sort(column)
            gaps = np.diff(np.append(ordered, ordered[0] + 1))
            np.testing.assert_allclose(gaps, 1 / count, atol=2**-23)


def test_independent_samples_leave_strata_empty(session):
    ordered = np.sort(numbers(session, 77, np.arange(4096), 0, lattice=False)[:, 0].astype(float))
    assert np.diff(ordered).max() > 4 / 4096


@pytest.mark.parametrize("sample", [0, 1, 1000, MASK])
def test_any_one_sample_is_uniform_over_the_pixels(session, sample):
    for dimension in DIMENSIONS.values():
        values = numbers(session, np.arange(1 << 16), sample, dimension)
        cells = [(column * 256).astype(int) for column in values.T]
        for a, b in itertools.combinations(range(4), 2):
            cells.append((values[:, a] * 16).astype(int) * 16 + (values[:, b] * 16).astype(int))
        for each in cells:
            assert chi_squared(np.bincount(each, minlength=256), np.full(256, 256)) > sidak(ALPHA, 300), dimension


def unevenness(u, v):
    """Variance of a product of two step functions relative to that of independent samples, from the points.

    The worst-case error P2 of Korobov's space, whose Fourier coefficients fall as those of functions with jumps do.
    """

    def kernel(x):
        return 2 * np.pi**2 * (x * x - x + 1 / 6)

    differences = [(x - x[0]) % 1 for x in (u, v)]  # of a lattice all points see the same differences
    return (kernel(differences[0]) * kernel(differences[1])).sum() / (np.pi**2 / 3) ** 2


IMPORTANT = [(0, 0), (0, 3), (0, 2), (3, 2)]  # camera with itself, first light and direction, and these two


@pytest.mark.parametrize(("count", "bound"), [(64, 0.8), (256, 0.5), (1024, 0.2), (4096, 0.12), (1 << 16, 0.02)])
def test_important_pairs_are_more_even_than_random(session, count, bound):
    points = {d: numbers(session, 5, np.arange(count), d).astype(float) for d in (0, 2, 3)}
    worst = [
        unevenness(points[c][:, a], points[d][:, b])
        for c, d in IMPORTANT
        for a, b in itertools.product((0, 1), (0, 1) if c != d else (2, 3))
    ]
    assert np.mean(worst) < bound


def test_late_directions_are_independent_of_the_camera(session):
    # the order of samples differs, so the pairs of one pixel do not line up whatever the components
    pixels = np.repeat(np.arange(4096), 16)
    samples = np.tile(np.arange(16), 4096)
    camera, late = (numbers(session, pixels, samples, d).astype(float) for d in (0, 8))
    for a, b in itertools.product(range(4), repeat=2):
        centred = [x - x.reshape(-1, 16).mean(axis=1).repeat(16) for x in (camera[:, a], late[:, b])]
        assert abs(np.corrcoef(*centred)[0, 1]) < Z / np.sqrt(4096 * 15)


def smooth(values):
    """An integrand of the unit cube with integral 1."""
    return np.prod(1 + (values - 0.5), axis=-1)


def test_smooth_integral_is_unbiased_and_far_less_noisy(session):
    pixels, spp = 512, 256
    counters = np.repeat(np.arange(pixels), spp), np.tile(np.arange(spp), pixels)
    spread = {}
    for lattice in (True, False):
        values = numbers(session, *counters, 0, lattice=lattice).astype(float)
        means = smooth(values).reshape(pixels, spp).mean(axis=1)
        spread[lattice] = means.var(ddof=1)
        assert_equivalent(means.mean(), np.sqrt(spread[lattice] / pixels), 1, 0.02)
    assert spread[True] < spread[False] / 20
