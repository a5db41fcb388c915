"""Curves give every cell its share, and evenly spread numbers stay evenly spread."""

import numpy as np
import pytest

from rptcam_cl.core.records import curves

RNG = np.random.default_rng(3)
WEIGHTS = {
    "even": np.ones(5),
    "one": np.array([3.0]),
    "only the first": np.array([1.0, 0, 0, 0]),
    "only the last": np.array([0.0, 0, 0, 7]),
    "one heavy among many light": np.append(np.full(1000, 1e-6), 1.0),
    "one light among many heavy": np.append(np.ones(1000), 1e-6),
    "uneven": RNG.random(1000) ** 8,
    "very uneven": RNG.exponential(size=100_000) ** 3,
    "even but for rounding": np.full(128, 1.7724128e-07),
}


def cells_of(curve: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Return the cells of numbers as ``kernels/common/curve.h`` finds them: between two guides."""
    count = len(curve) // 2 - 1
    at = np.minimum((numbers * count).astype(int), count - 1)
    cells, last = curve[2 * at + 1].astype(int), curve[2 * at + 3].astype(int)
    while (cells < last).any():
        middle = (cells + last + 1) // 2
        before = curve[2 * middle] <= numbers
        cells, last = np.where(before, middle, cells), np.where(before, last, middle - 1)
    return cells


@pytest.mark.parametrize("name", WEIGHTS)
def test_numbers_find_the_cell_whose_share_they_lie_in(name) -> None:
    weights = WEIGHTS[name]
    found, chance = curves(weights[None])
    curve = found[0]
    np.testing.assert_allclose(chance[0], weights / weights.sum(), atol=1.2e-7)
    numbers = (np.random.default_rng(2).integers(0, 1 << 24, 5000) / (1 << 24)).astype(np.float32)
    cells = cells_of(curve, numbers)
    assert (curve[2 * cells] <= numbers).all()
    assert ((numbers < curve[2 * cells + 2]) | (cells == len(weights) - 1)).all()
    assert (weights[cells] > 0).all()


def test_even_numbers_are_shared_out_to_within_one() -> None:
    weights = np.random.default_rng(4).random(37) ** 4
    found, chance = curves(weights[None])
    counts = np.bincount(cells_of(found[0], ((np.arange(1024) + 0.5) / 1024).astype(np.float32)), minlength=37)
    assert (np.abs(counts - 1024 * chance[0]) <= 1).all()


def test_row_without_shares_is_even() -> None:
    _, chance = curves(np.array([[0.0, 0, 0, 0], [0, 0, 1, 0]]))
    np.testing.assert_allclose(chance, [[0.25] * 4, [0, 0, 1, 0]])
