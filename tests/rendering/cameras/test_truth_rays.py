"""Every ray of the truth files through the device, both ways, at every wavelength, in float32 and float64."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.optics.glass import AIR
from tests.optics.truth import CASES, NAMES, truth, truth_lens
from tests.rendering.cameras.beams import PRECISIONS, on_device

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
