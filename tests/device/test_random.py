"""The random numbers of kernels/common/rng.h: uniform, independent, never 1, never twice the same counter."""

import numpy as np
import pytest

from rptcam_cl.studies.selfcheck import (
    CORNERS,
    INCREMENT,
    MASK,
    MULTIPLIER,
    pcg4d,
    random_numbers,
    run_probe,
    wrong_random_numbers,
)
from tests.support.statistics import ALPHA, Z, chi_squared, moment_scores, sidak

COUNT = 1 << 18


def random4(session, pixel, sample, dimension, seed=(12345, 67890), lanes=8):
    """Four numbers per counter, shape (n, 4)."""
    return random_numbers(session, pixel, sample, dimension, seed, lanes=lanes)


def undo_pcg4d(x, y, z, w):
    """The inverse permutation: every step is undone in turn."""
    for mix in (True, False):
        w = (w - y * z) & MASK
        z = (z - x * y) & MASK
        y = (y - z * x) & MASK
        x = (x - y * w) & MASK
        if mix:
            x, y, z, w = (v ^ (v >> 16) for v in (x, y, z, w))
    inverse = pow(MULTIPLIER, -1, 1 << 32)
    return tuple(((v - INCREMENT) * inverse) & MASK for v in (x, y, z, w))


def test_permutation_has_an_inverse_so_no_two_counters_collide():
    rng = np.random.default_rng(1)
    states = [tuple(map(int, state)) for state in rng.integers(0, 1 << 32, (2000, 4))]
    states += [(a, b, c, d) for a in CORNERS for b in CORNERS for c in CORNERS for d in CORNERS]
    assert all(undo_pcg4d(*pcg4d(*state)) == state for state in states)


@pytest.mark.parametrize("lanes", [1, 8, 16])
def test_device_computes_the_published_permutation(session, lanes):
    assert wrong_random_numbers(session, lanes) == 0


def test_unit_float_is_below_one_and_hits_zero(session):
    words = np.array([0, 255, 256, 0x7FFFFFFF, 0x80000000, 0xFFFFFF00, 0xFFFFFF80, 0xFFFFFFFF], np.uint32)
    out = session.allocate(32)
    run_probe(session, "probe_unit_float", {"VW": 1}, 8, words=session.upload(words), out=out)
    got = session.read(out, np.float32, 8)
    np.testing.assert_array_equal(got, (words >> 8).astype(np.float64) * 2.0**-24)
    assert got.max() < 1
    # the obvious other way reaches 1
    assert np.float32(0xFFFFFFFF) * np.float32(2.0**-32) == 1


INDEX = np.arange(COUNT, dtype=np.uint32)
STREAMS = {
    "pixels": lambda k: (INDEX, 0, 0),
    "samples": lambda k: (k, INDEX, 3),
    "dimensions": lambda k: (k, k, INDEX),
    "pixels by samples": lambda k: (INDEX & 511, INDEX >> 9, 5),
}


@pytest.mark.parametrize("stream", STREAMS)
def test_numbers_are_uniform_in_every_component(session, stream):
    values = random4(session, *STREAMS[stream](17))
    for column in values.T:
        counts = np.bincount((column * 1024).astype(int), minlength=1024)
        assert chi_squared(counts, np.full(1024, COUNT / 1024)) > sidak(ALPHA, 16)
        scores = moment_scores(np.stack([column, column**2, column**3], 1).astype(float), [1 / 2, 1 / 3, 1 / 4])
        assert np.abs(scores).max() < Z


@pytest.mark.parametrize("stream", STREAMS)
def test_pairs_of_components_fill_the_square_evenly(session, stream):
    values = random4(session, *STREAMS[stream](99))
    for a in range(4):
        for b in range(a):
            cells = (values[:, a] * 64).astype(int) * 64 + (values[:, b] * 64).astype(int)
            counts = np.bincount(cells, minlength=4096)
            assert chi_squared(counts, np.full(4096, COUNT / 4096)) > sidak(ALPHA, 24)


@pytest.mark.parametrize("stream", STREAMS)
def test_successive_numbers_are_uncorrelated(session, stream):
    values = random4(session, *STREAMS[stream](5)).astype(float) - 0.5
    for lag in (1, 2, 4, 8, 512):
        for a in range(4):
            for b in range(4):
                products = values[lag:, a] * values[:-lag, b]
                assert abs(products.mean() * 12) < 1.2 * Z / np.sqrt(len(products))


def test_successive_samples_of_a_pixel_fill_the_square_evenly(session):
    values = random4(session, 31337, INDEX, 2)
    cells = (values[1:, 0] * 64).astype(int) * 64 + (values[:-1, 0] * 64).astype(int)
    assert chi_squared(np.bincount(cells, minlength=4096), np.full(4096, (COUNT - 1) / 4096)) > ALPHA


def test_counters_of_a_render_give_no_duplicates(session):
    # 2^18 quadruples of 24 bits: any equal pair of whole quadruples would be a collision of counters
    for stream in STREAMS.values():
        values = random4(session, *stream(7))
        assert len(np.unique(np.ascontiguousarray(values, np.float32).view(np.complex128))) == COUNT


@pytest.mark.parametrize("other", [(12346, 67890), (12345, 67891), (67890, 12345)])
def test_seeds_give_unrelated_numbers(session, other):
    first = random4(session, INDEX, 3, 4).astype(float) - 0.5
    second = random4(session, INDEX, 3, 4, seed=other).astype(float) - 0.5
    assert np.abs((first * second).mean(axis=0) * 12).max() < 1.2 * Z / np.sqrt(COUNT)
