"""The alias table gives every item its share."""

import numpy as np
import pytest

from rptcam_cl.alias import alias_table

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


@pytest.mark.parametrize("name", WEIGHTS)
def test_every_item_has_its_share(name: str) -> None:
    weights = WEIGHTS[name]
    keep, other = alias_table(weights)
    assert ((keep >= 0) & (keep <= 1)).all()
    assert ((other >= 0) & (other < len(weights))).all()
    shares = keep.copy()
    np.add.at(shares, other, 1 - keep)
    # running sums of 1e5 numbers up to 1e3 in float64
    np.testing.assert_allclose(shares / len(weights), weights / weights.sum(), rtol=0, atol=1e-8 / len(weights))
