"""Spots, chief rays, distortion, zonal foci and best focus against the truth tables."""

import numpy as np
import pytest

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam, chief_ray, passing_beam, shift_to_least_spot, spot
from rptcam_cl.optics.best_focus import best_film_distance, best_film_distance_at
from rptcam_cl.optics.field_measures import distortion_table
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.spots import Setting
from tests.optics.truth import NAMES, truth, truth_lens
from tests.support.cases import one_in

FIELDS = [name for name in NAMES if "fields" in truth(name)]


def film_distance(name):
    return truth(name)["film_z"] - truth_lens(name).length


def distortion(lens, film, degrees):
    (row,) = distortion_table(Setting(lens, film), [degrees], [LINE_D_NM], "tan")
    return row["distortion_percent"]


@pytest.mark.parametrize("name", FIELDS)
def test_chief_rays_and_distortion(name):
    lens = truth_lens(name)
    for row in truth(name)["fields"]:
        expected = row["d"]["chief_ray"]
        height, ray = chief_ray(lens, row["field_deg"])
        assert height == pytest.approx(expected["y_at_z0"], abs=1e-8)
        assert bool(ray.passed[0]) == expected["passes"]
        if expected["passes"]:
            step = (truth(name)["film_z"] - ray.origins[0, 2]) / ray.directions[0, 2]
            assert ray.origins[0, 1] + step * ray.directions[0, 1] == pytest.approx(expected["image_y"], abs=1e-8)
        if "distortion_pct_vs_EFLd_tan" in row["d"]:
            got = distortion(lens, film_distance(name), row["field_deg"])
            assert got == pytest.approx(row["d"]["distortion_pct_vs_EFLd_tan"], abs=1e-5)


def area(lens, beam):
    """Return the cross-section of the beam that passes [mm2]."""
    points, _, cell = passing_beam(lens, beam, LINE_D_NM, 128)
    return len(points) * cell


@pytest.mark.parametrize("name", one_in(2, FIELDS))
def test_spots(name):
    for row in truth(name)["fields"]:
        for label in truth(name)["wavelengths_nm"] if name == "cooke50" else ["d"]:
            expected = row[label].get("spot_full")
            if expected is None or expected.get("area", 0) == 0:
                continue
            seen = truth_lens(name, label), film_distance(name), Beam(row["field_deg"])
            got, scale = spot(*seen, across=128), expected["rms"]
            assert area(seen[0], seen[2]) == pytest.approx(expected["area"], rel=3e-3)
            assert got.rms == pytest.approx(scale, rel=1e-2)
            assert got.rms_x == pytest.approx(expected["rms_x"], abs=1e-2 * scale)
            assert got.rms_y == pytest.approx(expected["rms_y"], abs=1e-2 * scale)
            assert got.centroid == pytest.approx(expected["centroid"], abs=1e-2 * scale)
            shift = shift_to_least_spot(*seen, across=128)
            best = spot(seen[0], seen[1] + shift, seen[2], across=128)
            assert best.rms == pytest.approx(expected["best_rms"], rel=2e-2)
            assert shift == pytest.approx(
                expected["best_dz"], abs=2e-2 * abs(expected["best_dz"]) + 1e-4 * film_distance(name)
            )


@pytest.mark.parametrize("name", [name for name in NAMES if "chromatic" in truth(name)])
def test_focal_length_over_the_spectrum_and_zonal_foci(name):
    chromatic = truth(name)["chromatic"]
    half = truth_lens(name).first_order().entrance_pupil.diameter_mm / 2
    for label in truth(name)["wavelengths_nm"]:
        lens = truth_lens(name, label)
        assert lens.first_order().focal_length_mm == pytest.approx(chromatic[label]["EFL"], rel=1e-10)
        assert lens.first_order().back_focal_distance_mm == pytest.approx(chromatic[label]["BFL"], rel=1e-10)
        for zone, row in chromatic.get("real_axial_focus_by_zone", {}).items():
            rays = lens.trace([[0, float(zone) * half, 0]], [[0, 0, 1]], start="scene")
            if not rays.passed[0]:
                continue
            crossing = rays.origins[0, 2] - rays.origins[0, 1] / rays.directions[0, 1] * rays.directions[0, 2]
            assert crossing - lens.length == pytest.approx(row[label], abs=1e-4 if zone == "0.70710" else 1e-9)


@pytest.mark.parametrize("name", one_in(4, [name for name in NAMES if name != "cyl_pair_open"]))
def test_best_focus_on_the_axis(name):
    scale = 1.0 if truth(name)["units"].startswith("scene") else 1000.0
    autofocus = truth(name)["autofocus"]
    for aperture, semi_diameter in autofocus["apertures"].items():
        lens = truth_lens(name).with_stop_diameter(2 * semi_diameter)
        length = abs(lens.first_order().focal_length_mm)
        for case in autofocus["cases"]:
            expected = case["from_first_vertex"][aperture]["best_rms_real_stop"]
            got = best_film_distance(lens, float(case["object_distance"]) * scale, "front")
            allowed = max(1e-6 * length, 0.05 * expected["rms_min"] / expected["slope_rms"])
            assert got == pytest.approx(expected["back_distance"], abs=allowed)
    for case in autofocus["cases"]:
        expected = (case.get("from_film") or {}).get("best_rms_real_stop_wide_open")
        if expected:
            got = best_film_distance(truth_lens(name), float(case["object_distance"]) * scale)
            assert got == pytest.approx(
                expected["back_distance"], abs=2e-5 * abs(truth_lens(name).first_order().focal_length_mm)
            )


def test_best_focus_of_three_colours():
    case = truth("cooke50")["autofocus"]["cases"][0]
    lens = load_lens(
        {
            "name": "cooke",
            "surfaces": [
                {"radius": 22.01359, "thickness": 3.25896, "glass": "N-SK16", "diameter": 13.4},
                {"radius": -435.76044, "thickness": 6.00755, "diameter": 12.6},
                {"radius": -22.21328, "thickness": 0.99997, "glass": "F2", "diameter": 9.0},
                {"radius": 20.29192, "thickness": 4.75041, "diameter": 7.6, "stop": True},
                {"radius": 79.6836, "thickness": 2.95208, "glass": "N-SK16", "diameter": 11.0},
                {"radius": -18.39533, "diameter": 11.8},
            ],
        }
    )
    got = best_film_distance(lens, 500.0, "front", [587.5618, 486.1327, 656.2725])
    expected = case["from_first_vertex"]["wide_open"]["best_rms_polychromatic_dFC_real_stop"]
    assert got == pytest.approx(expected["back_distance"], abs=0.05 * expected["rms_min"] / expected["slope_rms"])


def test_best_focus_off_the_axis_lies_nearer_for_an_undercorrected_lens():
    lens = load_lens("biconvex-stop")
    on_axis = best_film_distance(lens, np.inf)
    off_axis = best_film_distance(lens, np.inf, field_degrees=15)
    assert off_axis < on_axis - 1.0


@pytest.mark.parametrize("measured_from", ["film", "front"])
def test_best_focus_at_the_centre_of_the_film_is_that_on_the_axis(measured_from):
    lens = load_lens("dgauss-50mm").with_stop_diameter(8.0)
    expected = best_film_distance(lens, 2000.0, measured_from)
    # rays counted against rays integrated
    assert best_film_distance_at(lens, (0.0, 0.0), 2000.0, measured_from) == pytest.approx(expected, abs=2e-3)


def test_best_focus_at_a_film_point_makes_its_spot_least_there():
    lens, point, distance = load_lens("biconvex-stop"), (6.0, -5.0), 3000.0
    back = best_film_distance_at(lens, point, distance, "front")
    assert back < best_film_distance(lens, distance, "front") - 0.7  # its field is curved
    field = np.degrees(np.arctan(np.hypot(*point) / back))
    beams = [Beam(field + turn, distance, float(np.degrees(np.arctan2(point[1], point[0])))) for turn in (-1.5, 0, 1.5)]
    beam = min(beams, key=lambda beam: np.hypot(*np.subtract(spot(lens, back, beam).centroid, point)))
    assert np.hypot(*np.subtract(spot(lens, back, beam).centroid, point)) < 0.5
    sizes = [spot(lens, back + shift, beam).rms for shift in (-0.2, 0.0, 0.2)]
    assert sizes[1] < min(sizes[0], sizes[2])


def test_best_focus_knows_the_directions_of_a_lens_that_is_not_round():
    rows = [
        {"radius": 50, "thickness": 4, "glass": {"index": 1.5}, "diameter": 20, "tilt_degrees": [4, 0]},
        {"radius": -50, "thickness": 5, "diameter": 20, "tilt_degrees": [4, 0]},
        {"stop": True, "diameter": 6},
    ]
    lens = load_lens({"name": "tilted", "surfaces": rows})
    up, down, right, left = (best_film_distance_at(lens, point, np.inf) for point in ((0, 5), (0, -5), (5, 0), (-5, 0)))
    assert abs(up - down) > 0.1
    assert right == pytest.approx(left, abs=1e-3)


def test_best_focus_where_no_light_arrives_is_refused():
    with pytest.raises(InputError, match=r"no light reaches the film point \(0, 90\) mm"):
        best_film_distance_at(load_lens("telephoto-250mm"), (0.0, 90.0), np.inf)


def test_a_beam_that_does_not_come_through_is_an_error():
    with pytest.raises(InputError, match="nothing of a beam at 80 degrees"):
        spot(load_lens("telephoto-250mm"), 100.0, Beam(80))


@pytest.mark.parametrize("radius", [5.0, 7.3, 1 / 3])
def test_a_beam_fills_a_first_surface_that_is_a_whole_hemisphere(radius):
    rows = [
        {"radius": radius, "thickness": 2 * radius, "glass": {"index": 1.5}, "diameter": 2 * radius},
        {"radius": -radius, "diameter": 2 * radius},
    ]
    lens = load_lens({"name": "ball", "surfaces": rows})
    assert area(lens, Beam(0.0)) == pytest.approx(np.pi * radius**2, rel=0.01)


def test_distortion_in_other_media_is_against_the_angle_in_front_of_the_lens():
    eye = load_lens("human-eye")  # with water behind it
    film = eye.first_order().back_focal_distance_mm
    assert distortion(eye, film, 0.1) == pytest.approx(0, abs=1e-4)
