"""Every ray of the truth files through the device, both ways, at every wavelength, in float32 and float64."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.optics.glass import AIR
from rptcam_cl.optics.library import load_lens
from tests.optics.truth import CASES, NAMES, truth, truth_lens
from tests.rendering.cameras.beams import ASSIGNMENT, PRECISIONS, doubtful, film_beam, neighbours, on_device
from tests.support.lenses import each_lens

# float32: what a careful tracer measures on these files is 3.2e-5 mm and 1.4e-6, doubled; small lenses are held to the
# tolerance of their own file. float64: what three programs agree to.
SINGLE = (6e-5, 3e-6)
DOUBLE = (1e-9, 1e-12)
DECIDED = 1e-5  # share of its rim that a ray must keep from it for float32 to know on which side it is


def tolerances(name, precision):
    if precision == "double":
        return DOUBLE
    suggested = truth(name)["suggested_tolerances"]["float32"]
    return min(SINGLE[0], suggested["position"]), min(SINGLE[1], suggested["direction"])


def table(name, start):
    rows = truth(name)["rays_film_to_scene" if start == "film" else "rays_scene_to_film"]
    origins = np.array([row["start"] for row in rows], dtype=float)
    directions = np.array([row["through"] for row in rows]) - origins if start == "film" else [r["dir"] for r in rows]
    return rows, origins, np.array(directions, dtype=float)


def compare(rays, rows, label, position, direction):
    expected = [row["result"][label] for row in rows]
    decided = np.array([abs(e.get("min_relative_aperture_margin", 1.0)) > DECIDED for e in expected])
    passed = np.array([e["status"] == "pass" for e in expected])
    np.testing.assert_array_equal(rays.passed[decided], passed[decided])
    assert np.all(rays.surface[rays.passed] == -1)
    assert np.all(rays.surface[~rays.passed] >= 0)
    assert np.all(np.isfinite(rays.origins)) and np.all(np.isfinite(rays.directions))
    for index in np.flatnonzero(passed & rays.passed):
        assert np.abs(rays.origins[index] - expected[index]["exit_point"]).max() <= position
        assert np.abs(rays.directions[index] - expected[index]["exit_dir"]).max() <= direction


@pytest.mark.parametrize(("name", "label"), CASES)
def test_rays_are_those_of_the_truth_table(session, name, label):
    for start in ("film", "scene"):
        rows, origins, directions = table(name, start)
        for precision in PRECISIONS:
            rays = on_device(session, truth_lens(name, label), origins, directions, precision, start)
            compare(rays, rows, label, *tolerances(name, precision))


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", NAMES)
def test_rays_meet_every_surface_where_the_truth_table_says(session, name, precision):
    lens = truth_lens(name)
    rows, origins, directions = table(name, "film")
    for k in range(1, len(lens.surfaces)):
        rest = replace(lens, surfaces=lens.surfaces[k:], object_medium=lens.surfaces[k - 1].glass, stop_index=None)
        rays = on_device(session, rest, origins - (0, 0, lens.vertices[k]), directions, precision)
        for index, row in enumerate(rows):
            if row["result"]["d"]["status"] == "pass":
                hit = next(h[1:] for h in row["result"]["d"]["hits"] if h[0] == k)
                assert rays.passed[index]
                error = rays.origins[index] + (0, 0, lens.vertices[k]) - hit
                assert np.abs(error).max() <= tolerances(name, precision)[0]


@pytest.mark.parametrize("name", ["dgauss50", "wide22"])
def test_the_tables_tell_a_wrong_glass_from_the_right_one(session, name):
    # 1e-3 of one index is what another melt of the same glass has
    lens = truth_lens(name)
    first = next(k for k, surface in enumerate(lens.surfaces) if surface.glass != AIR)
    glass = replace(lens.surfaces[first].glass, value=lens.surfaces[first].glass.value + 1e-3)
    surfaces = list(lens.surfaces)
    surfaces[first] = replace(surfaces[first], glass=glass)
    rows, origins, directions = table(name, "film")
    rays = on_device(session, replace(lens, surfaces=tuple(surfaces)), origins, directions)
    with pytest.raises(AssertionError):
        compare(rays, rows, "d", *tolerances(name, "single"))


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
