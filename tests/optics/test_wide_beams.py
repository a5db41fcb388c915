"""Beams from the side and from behind, and small pupils behind wide fronts."""

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam, chief_ray, passing_beam, passing_steep_beam, steep_chief_ray
from rptcam_cl.optics.library import load_lens

# A strong meniscus far before its stop: it sees more than a half space.
MENISCUS = {
    "name": "meniscus",
    "surfaces": [
        {"radius": 45, "thickness": 3, "glass": {"index": 1.8}, "diameter": 89},
        {"radius": 12, "thickness": 16, "diameter": 23.7},
        {"stop": True, "diameter": 2},
    ],
}


@pytest.mark.parametrize("field", [40.0, 60.0, 70.0])
def test_both_ways_of_spreading_a_beam_give_the_same_chief_ray(field):
    lens = load_lens("fisheye-10mm")
    _, plane = chief_ray(lens, field)
    _, across = steep_chief_ray(lens, field, lens.stop_index, LINE_D_NM)
    assert plane.passed[0]
    assert across.passed[0]
    assert across.surface[0] == -1
    np.testing.assert_allclose(across.origins, plane.origins, atol=1e-9)
    np.testing.assert_allclose(across.directions, plane.directions, atol=1e-10)


def test_both_ways_give_the_same_beam():
    lens = load_lens("fisheye-10mm")
    _, plane, cell = passing_beam(lens, Beam(70.0), LINE_D_NM, 200)
    _, across, cell_across = passing_steep_beam(lens, 70.0, LINE_D_NM, 200)
    # area of the beam in the plane of the first vertex, and across
    assert len(across.origins) * cell_across == pytest.approx(
        len(plane.origins) * cell * np.cos(np.radians(70.0)), rel=0.02
    )
    np.testing.assert_allclose(across.origins.mean(axis=0), plane.origins.mean(axis=0), atol=2e-3)


def test_light_from_behind_goes_the_way_of_rays_traced_from_the_film_side():
    lens = load_lens(MENISCUS)
    tilts = np.radians([20.0, 35.0, 48.0, 53.0])
    out = np.column_stack([np.zeros(4), -np.sin(tilts), -np.cos(tilts)])
    rays = lens.trace([[0.0, 0.0, lens.length + 1e-9]], out, LINE_D_NM)
    assert rays.passed.all()
    fields = np.degrees(np.arctan2(-rays.directions[:, 1], -rays.directions[:, 2]))
    assert fields.max() > 92
    for field, direction in zip(fields.tolist(), out, strict=True):
        _, forward = steep_chief_ray(lens, field, 2, LINE_D_NM)
        assert forward.passed[0]
        np.testing.assert_allclose(forward.origins[0], [0, 0, lens.length], atol=1e-5)
        np.testing.assert_allclose(forward.directions[0], -direction, atol=1e-6)


@pytest.mark.slow
def test_a_small_pupil_behind_a_wide_front_is_found():
    lens = load_lens(MENISCUS)
    closed = lens.with_stop_diameter(0.5)
    for field in (0.0, 50.0, 92.0):
        points, _, cell = passing_beam(closed, Beam(field), LINE_D_NM, 64)
        wide, _, wide_cell = passing_beam(lens, Beam(field), LINE_D_NM, 64)
        assert len(points) * cell == pytest.approx(len(wide) * wide_cell / 16, rel=0.06)


def test_steep_light_that_no_plane_of_objects_sends_is_refused():
    lens = load_lens(MENISCUS)
    with pytest.raises(InputError, match="does not reach there"):
        passing_beam(lens, Beam(92.0, 1000.0), LINE_D_NM, 32)
    with pytest.raises(InputError, match="spherical"):
        passing_beam(load_lens("biconcave"), Beam(92.0), LINE_D_NM, 32)
