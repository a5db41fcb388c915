"""Curves give every cell its share, and evenly spread numbers stay evenly spread."""

import numpy as np
import pytest

from rptcam_cl.plan.curves import curves
from tests.light.test_alias import WEIGHTS


def cells_of(curve: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Return the cells of numbers as ``kernels/light/curve.h`` finds them: from the guide onwards."""
    count = len(curve) // 2 - 1
    cells = curve[2 * np.minimum((numbers * count).astype(int), count - 1) + 1].astype(int)
    while (on := (curve[2 * cells + 2] <= numbers) & (cells < count - 1)).any():
        cells[on] += 1
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
