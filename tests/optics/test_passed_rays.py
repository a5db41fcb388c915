"""Rays that pass, found sooner than by `trace`: the same rays, points and directions, to the bit."""

import numpy as np
import pytest

from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import passed_rays

LENSES = ("dgauss-50mm", "fisheye-10mm", "mirror-500mm", "phone-5.6mm", "anamorphic-100mm", "zoom-70-200mm")


@pytest.mark.parametrize("start", ["film", "scene"])
@pytest.mark.parametrize("name", LENSES)
def test_rays_that_pass_are_those_of_the_trace(name: str, start: str) -> None:
    lens, rng = load_lens(name), np.random.default_rng(5)
    size = lens.surfaces[0].semi_diameter
    if start == "scene":
        origins = np.column_stack([rng.uniform(-1.3, 1.3, (3000, 2)) * size, np.full(3000, -3 * size)])
        directions = np.column_stack([rng.normal(0, 0.01, (3000, 2)), np.ones(3000)])
    else:
        z = lens.film_z(lens.first_order().focal_length_mm)
        origins = np.column_stack([rng.uniform(-0.3, 0.3, (3000, 2)) * size, np.full(3000, z)])
        directions = (
            np.column_stack([rng.uniform(-1.3, 1.3, (3000, 2)) * size, np.full(3000, lens.length / 2)]) - origins
        )
    rays = lens.trace(origins, directions, 550.0, start)
    rows, points, after = passed_rays(lens, origins, directions, 550.0, start)
    assert 0 < len(rows) < 3000
    assert np.array_equal(rows, np.flatnonzero(rays.passed))
    assert points.T.tobytes() == rays.origins[rows].tobytes()
    assert after.T.tobytes() == rays.directions[rows].tobytes()


def test_no_ray_may_pass() -> None:
    lens = load_lens("dgauss-50mm")
    rows, points, directions = passed_rays(
        lens, np.array([[0.0, 500.0, -9.0]]), np.array([[0.0, 0.0, 1.0]]), 550.0, "scene"
    )
    assert len(rows) == 0 and points.shape == directions.shape == (3, 0)
