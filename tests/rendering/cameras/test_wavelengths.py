"""A wavelength for every ray: the polynomials that the device bends rays by, against the laws of the glasses."""

import numpy as np
import pytest

from rptcam_cl.core.records import DISPERSION_SCALE, DISPERSION_SHIFT
from rptcam_cl.optics.library import list_lenses, load_lens
from rptcam_cl.rendering.cameras import lens_records as records
from rptcam_cl.rendering.cameras.lens_records import ENOUGH, disperses, fewest_terms, fit_nodes, lens_records, usable_nm
from rptcam_cl.scene.film import Film
from tests.optics.truth import truth
from tests.rendering.cameras.beams import ASSIGNMENT, film_beam, generator, neighbours, on_device
from tests.support.cases import slow
from tests.support.lenses import each_lens

DISPERSIVE = [name for name in list_lenses() if disperses(load_lens(name))]
COUNT = 1000
# Bundled lenses that truth files hold with the indices of their glasses.
SAME = {"la1509": "plano-convex-100mm", "ac254_100_a": "achromat-100mm"}


def wavelengths_of(lens, count, *name):
    return generator("wavelengths", lens.name, *name).uniform(*usable_nm(lens), count)


def bundle(name):
    lens = load_lens(name)
    back, half = ASSIGNMENT.get(name, (None, None))
    origins, directions = film_beam(lens, COUNT, half, back)
    return lens, origins, directions, wavelengths_of(lens, len(origins))


def test_library_has_many_lenses_that_disperse():
    assert len(DISPERSIVE) > 20


@pytest.mark.parametrize("name", each_lens(DISPERSIVE))
def test_ratios_of_indices_are_polynomials(name):
    lens = load_lens(name)
    low, high = usable_nm(lens)
    nodes = fit_nodes(low, high)
    between = np.linspace(low, high, 1001)
    for side, exact in (("film", lens.indices(between)[::-1]), ("scene", lens.indices(between))):
        traced = lens_records(lens, 550.0, side, 0.0, dispersive=True, double=True)
        assert 0 < traced.facts["LENS_DISPERSION"] <= 12
        x = scaled_inverse(between)
        for record, ratio in zip(traced.surfaces, exact[:-1] / exact[1:], strict=True):
            fitted = np.polynomial.Polynomial(record["dispersion"])(x)
            assert np.abs(fitted - ratio).max() < 2 * ENOUGH
    ratios = lens.indices(nodes)[:-1] / lens.indices(nodes)[1:]
    fewer = len(fewest_terms(ratios, nodes)[0]) - 1  # one term less is not enough
    short = [np.polynomial.Polynomial.fit(scaled_inverse(nodes), ratio, fewer - 1) for ratio in ratios]
    errors = [np.abs(curve(scaled_inverse(nodes)) - ratio).max() for curve, ratio in zip(short, ratios, strict=True)]
    assert max(errors) > ENOUGH


def scaled_inverse(wavelengths_nm):
    return DISPERSION_SCALE / wavelengths_nm - DISPERSION_SHIFT


@pytest.mark.parametrize("name", each_lens(DISPERSIVE))
def test_every_ray_has_the_wavelength_of_its_own(session, name):
    lens, origins, directions, wavelengths = bundle(name)
    wanted = lens.trace(origins, directions, wavelengths)
    got = on_device(session, lens, origins, directions, wavelength_nm=wavelengths)
    assert wanted.passed.sum() > 30
    same = (got.status == wanted.status) & (got.surface == wanted.surface)
    for index in np.flatnonzero(~same):  # by less than float32 can tell
        others = neighbours(lens, wavelengths[index])
        rays = [other.trace(origins[index : index + 1], directions[index : index + 1]) for other in others]
        assert any(ray.status[0] != wanted.status[index] or ray.surface[0] != wanted.surface[index] for ray in rays)
    nudged = lens.trace(origins, directions, np.minimum(wavelengths + 0.5, usable_nm(lens)[1]))
    places = np.abs(nudged.origins - wanted.origins).max(axis=1, keepdims=True)
    angles = np.abs(nudged.directions - wanted.directions).max(axis=1, keepdims=True)
    passed = same & wanted.passed
    position = 6e-5 * max(1, lens.length / 100)
    assert (np.abs(got.origins - wanted.origins) <= np.maximum(position, 0.1 * places))[passed].all()
    assert (np.abs(got.directions - wanted.directions) <= np.maximum(3e-6, 0.1 * angles))[passed].all()
    # The control: with the wavelengths of other rays the device is wrong.
    wrong = on_device(session, lens, origins, directions, wavelength_nm=wavelengths[::-1])
    both = passed & wrong.passed
    assert np.abs(wrong.directions - wanted.directions)[both].max() > 1e-5


@pytest.mark.parametrize("start", ["film", "scene"])
def test_one_launch_is_as_good_as_one_per_wavelength(session, start):
    lens = load_lens("achromat-100mm")
    origins, directions = film_beam(lens, 600)
    if start == "scene":
        out = lens.trace(origins, directions)
        origins, directions = out.origins[out.passed], -out.directions[out.passed]
    wavelengths = np.resize([450.0, 550.0, 650.0], len(origins))
    together = on_device(session, lens, origins, directions, start=start, wavelength_nm=wavelengths)
    for wavelength in (450.0, 550.0, 650.0):
        rows = wavelengths == wavelength
        apart = on_device(session, lens, origins[rows], directions[rows], start=start, wavelength_nm=wavelength)
        agree = apart.passed & together.passed[rows]
        assert agree.sum() > 20
        np.testing.assert_allclose(together.directions[rows][agree], apart.directions[agree], atol=2e-6)


def test_wavelengths_beyond_the_polynomials_are_traced_one_by_one(session):
    lens = load_lens("plano-convex-100mm")
    origins, directions = film_beam(lens, 40)
    wavelengths = np.resize([350.0, 1060.0], len(origins))
    got = on_device(session, lens, origins, directions, wavelength_nm=wavelengths)
    wanted = lens.trace(origins, directions, wavelengths)
    np.testing.assert_allclose(got.directions[wanted.passed], wanted.directions[wanted.passed], atol=3e-6)


@pytest.mark.parametrize("name", SAME)
def test_bundled_lens_bends_the_lines_of_the_truth_files(session, name):
    lens = load_lens(SAME[name])
    lines = truth(name)["wavelengths_nm"]
    rows = truth(name)["rays_film_to_scene"]
    starts = np.array([row["start"] for row in rows for _ in lines])
    directions = np.array([row["through"] for row in rows for _ in lines]) - starts
    wavelengths = np.tile(list(lines.values()), len(rows))
    results = [row["result"][label] for row in rows for label in lines]
    passed = np.array([result["status"] == "pass" for result in results])
    reference = lens.trace(starts, directions, wavelengths)
    device = on_device(session, lens, starts, directions, wavelength_nm=wavelengths)
    np.testing.assert_array_equal(reference.passed, passed)
    expected = np.array([result["exit_dir"] for result in np.array(results)[passed]])
    # the catalogue's indices are those of the table to 1e-9 or better
    np.testing.assert_allclose(reference.directions[passed], expected, atol=1e-8)
    np.testing.assert_allclose(device.directions[passed], expected, atol=3e-6)


@pytest.mark.parametrize("name", SAME)
def test_colour_of_bundled_lenses_is_that_of_the_truth_files(session, name):
    lens, lines, chromatic = load_lens(SAME[name]), truth(name)["wavelengths_nm"], truth(name)["chromatic"]
    for label, wavelength in lines.items():
        assert lens.first_order(wavelength).back_focal_distance_mm == pytest.approx(chromatic[label]["BFL"], abs=1e-6)
        entrance = lens.first_order().entrance_pupil.diameter_mm / 2
        for zone, focus in chromatic["real_axial_focus_by_zone"].items():
            start = [0.0, float(zone) * entrance if zone != "0.70710" else np.sqrt(0.5) * entrance, -1.0]
            rays = lens.trace([start], [[0.0, 0.0, 1.0]], wavelength, "scene")
            crossing = rays.origins[0, 2] - rays.origins[0, 1] * rays.directions[0, 2] / rays.directions[0, 1]
            assert crossing - lens.length == pytest.approx(focus[label], abs=2e-4)
        film_mm = truth(name)["film_z"]
        for field in truth(name)["fields"]:
            if field[label]["chief_ray"]["passes"]:
                slope = np.radians(field["field_deg"])
                rays = on_device(session, lens, [[0.0, 0.0, 0.0]], [[0.0, np.sin(slope), np.cos(slope)]],
                                 start="scene", wavelength_nm=wavelength)  # fmt: skip
                y, z = rays.origins[0, 1:]
                height = y + (film_mm - z) * rays.directions[0, 1] / rays.directions[0, 2]
                assert height == pytest.approx(field[label]["chief_ray"]["image_y"], abs=3e-5)


def matrix_to_scene(lens, film_mm, object_mm, wavelength_nm):
    """Paraxial (height, slope) from the film to a plane so far ahead of the first vertex, of surfaces in air."""
    total = np.array([[1.0, film_mm], [0.0, 1.0]])
    indices = lens.indices(wavelength_nm)
    for k in range(len(lens.surfaces) - 1, -1, -1):
        before, behind, surface = indices[k], indices[k + 1], lens.surfaces[k]
        total = np.array([[1.0, 0.0], [surface.curvature * (before - behind) / before, behind / before]]) @ total
        total = np.array([[1.0, lens.surfaces[k - 1].thickness if k else object_mm], [0.0, 1.0]]) @ total
    return total


def test_colour_of_a_single_lens_on_the_axis_is_that_of_paraxial_optics():
    lens = load_lens("plano-convex-100mm")
    lens = lens.with_stop_diameter(lens.stop_diameter_for(25.0))
    first = lens.first_order()
    film_mm, object_mm = first.back_focal_distance_mm, 1e9
    here, *ends = (matrix_to_scene(lens, film_mm, object_mm, nm) for nm in (587.5618, 440.0, 640.0))
    to_pupil = film_mm - first.exit_pupil.distance_mm
    per_film_mm = here[0, 0] - here[0, 1] / to_pupil
    rim_mm = max(abs(end[0, 1] - here[0, 1]) / to_pupil * first.exit_pupil.diameter_mm / 2 for end in ends)
    expected_px = np.sqrt(0.9) * rim_mm / abs(per_film_mm) / 0.001  # nine tenths of the light pass within that height
    film = Film(resolution=(100, 100), width_mm=0.1)
    got, sampling = records.colour_error_px(lens, film_mm, None, film, 587.5618)
    assert got == pytest.approx(expected_px, rel=0.005)
    assert sampling < 0.005 * got


@pytest.mark.parametrize("name", ["achromat-100mm", "petzval-51mm", *map(slow, ("anamorphic-100mm", "zoom-35-51mm"))])
def test_colour_error_stays_within_its_sampling_error_with_more_rays(name, monkeypatch):
    lens = load_lens(name)
    film = Film(resolution=(300, 200), width_mm=24)
    of = lens, lens.first_order().back_focal_distance_mm, None, film, 587.5618
    got, sampling = records.colour_error_px(*of)
    bounded, less_known = records.colour_error_px(*of, bound_px=0.01 * got)
    monkeypatch.setattr(records, "MANY", 4 * records.MOST)
    monkeypatch.setattr(records, "MOST", 4 * records.MOST)
    more, _ = records.colour_error_px(*of)
    assert abs(got - more) < 4 * sampling < 0.06 * more
    assert abs(bounded - more) < 6 * less_known < more
