"""Vectors of three numbers."""

import numpy as np

from rptcam_cl.scene.quantities import cross


def test_the_cross_product_is_that_of_numpy_bit_by_bit() -> None:
    random = np.random.default_rng(5)
    for scale in (1e-8, 1.0, 1e12):
        for a, b in random.normal(size=(200, 2, 3)) * scale:
            assert np.array_equal(cross(a, b), np.cross(a, b))
    assert np.array_equal(cross([1, 0, 0], (0, 1, 0)), [0, 0, 1])
