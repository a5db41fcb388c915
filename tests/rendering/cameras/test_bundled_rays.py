"""Random rays through every lens of the library: device against the float64 reference."""

import numpy as np
import pytest

from rptcam_cl.optics.library import load_lens
from tests.rendering.cameras.beams import ASSIGNMENT, PRECISIONS, doubtful, film_beam, neighbours, on_device
from tests.support.lenses import each_lens

COUNT = 2000


def bundle(name):
    lens = load_lens(name)
    back, half = ASSIGNMENT.get(name, (None, None))
    return lens, *film_beam(lens, COUNT, half, back)


def assert_alike(lens, got, wanted, beam, precision, changes):
    assert np.isfinite(got.origins).all() and np.isfinite(got.directions).all()
    np.testing.assert_allclose(np.linalg.norm(got.directions, axis=1), 1, atol=3e-7)
    assert (got.surface[got.passed] == -1).all()
    assert (got.surface[~got.passed] >= 0).all()
    same = (got.status == wanted.status) & (got.surface == wanted.surface)
    if not same.all():
        assert doubtful(lens, *beam)[~same].all()
    # 6e-5 mm in a lens of 100 mm: float32 keeps 24 bits of the longest way between two surfaces; 3e-6 of direction.
    # Near grazing and the critical angle every rounding counts more: then as much as a millionth of every index does.
    position, direction = (6e-5 * max(1, lens.length / 100), 3e-6) if precision == "single" else (1e-9, 1e-12)
    places, angles = changes
    share = 0.1 if precision == "single" else 1e-7
    # A ray that is stopped may have grazed, and ends where errors are largest.
    loose = np.where(wanted.passed, 1, 100)[:, None]
    assert (np.abs(got.origins - wanted.origins) <= np.maximum(loose * position, share * places))[same].all()
    assert (np.abs(got.directions - wanted.directions) <= np.maximum(loose * direction, share * angles))[same].all()


def sensitivities(lens, wanted, origins, directions):
    """How far a change of rims and indices by 1e-5 moves each ray: points [mm] and directions, as columns."""
    places, angles = np.zeros((2, len(origins), 1))
    for other in neighbours(lens):
        traced = other.trace(origins, directions)
        places = np.maximum(places, np.abs(traced.origins - wanted.origins).max(axis=1, keepdims=True))
        angles = np.maximum(angles, np.abs(traced.directions - wanted.directions).max(axis=1, keepdims=True))
    return places, angles


@pytest.mark.parametrize("name", each_lens())
def test_rays_from_the_film_are_those_of_the_reference(session, name):
    lens, *beam = bundle(name)
    wanted = lens.trace(*beam)
    assert wanted.passed.sum() > 30
    changes = sensitivities(lens, wanted, *beam)
    for precision in PRECISIONS:
        assert_alike(lens, on_device(session, lens, *beam, precision), wanted, beam, precision, changes)
