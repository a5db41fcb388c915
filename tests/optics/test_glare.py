"""Veiling glare against closed forms, and how it goes with coatings and the stop."""

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.glass import MAGNESIUM_FLUORIDE
from rptcam_cl.optics.irradiance import veiling_glare
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.ray_trace import with_coating


def plates(count: int, index: float = 1.5):
    """Windows far before a small stop, through which the film sees the whole sky: rays are nearly upright."""
    rows = []
    for _ in range(count):
        rows += [{"thickness": 1, "diameter": 300, "glass": {"index": index}}, {"thickness": 1, "diameter": 300}]
    rows += [{"thickness": 1, "diameter": 2, "stop": True}, {"radius": 1e7, "diameter": 2}]
    return load_lens({"name": "window", "surfaces": rows})


@pytest.mark.parametrize("count", [1, 2])
def test_windows_have_the_glare_of_all_pairs_of_their_surfaces(count: int) -> None:
    r = 0.04
    found = veiling_glare(plates(count), 20.0)
    pairs = sum((1 - r) ** (2 * (j - i - 1)) for j in range(2 * count) for i in range(j))
    assert found.surfaces == pytest.approx(r * r * pairs, rel=0.01)
    assert found.index == pytest.approx(found.surfaces / (1 + found.surfaces), rel=1e-12)


def test_light_that_a_film_scatters_comes_back_from_a_window() -> None:
    found = veiling_glare(plates(1), 20.0, film_reflectance=0.5, barrel_reflectance=0.1)
    r, there, back = 0.04, 24.0, 24.0 + 2 / 1.5  # to the rear surface again, of rays at small angles
    returned = r / (1 + there**2) + r * (1 - r) ** 2 / (1 + back**2)
    assert found.film == pytest.approx(0.5 * returned, rel=0.01)
    assert found.barrel >= 0


@pytest.mark.slow
def test_layers_take_most_of_the_glare_away() -> None:
    lens = load_lens("dgauss-50mm")
    bare = veiling_glare(lens, 36.1)
    coated = veiling_glare(with_coating(lens, MAGNESIUM_FLUORIDE), 36.1)
    assert 0.02 < bare.surfaces < 0.12
    assert coated.surfaces < 0.15 * bare.surfaces
    lit = veiling_glare(lens, 36.1, film_reflectance=0.1, barrel_reflectance=0.02)
    assert lit.surfaces == bare.surfaces and lit.film > 0 and lit.barrel > 0


def test_glare_says_what_it_does_not_know() -> None:
    with pytest.raises(InputError, match="without mirrors"):
        veiling_glare(load_lens("mirror-500mm"), 50.0)
    with pytest.raises(InputError, match="the film reflects a share"):
        veiling_glare(load_lens("dgauss-50mm"), 36.1, film_reflectance=1.0)
