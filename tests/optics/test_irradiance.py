"""Film irradiance against the truth tables, the vignetting table and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import irradiance, spots
from rptcam_cl.optics.aberrations import in_section
from rptcam_cl.optics.field_measures import vignetting_table
from rptcam_cl.optics.film_probe import FilmProbe
from rptcam_cl.optics.irradiance import (
    axial_irradiance,
    disk_irradiance,
    film_irradiance,
    image_circle,
    irradiance_with_error,
    lens_info,
    on_axis_irradiance,
)
from rptcam_cl.optics.lens import film_distance
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.pupils import COARSE_OUTLINES, pupil_shapes, reach_of
from rptcam_cl.optics.surface import blades
from tests.optics.truth import NAMES, truth, truth_lens
from tests.support.cases import one_in, slow


@pytest.mark.parametrize("name", one_in(6, NAMES))
def test_truth_rows(name):
    lens = truth_lens(name)
    for block in truth(name)["irradiance"]:
        stopped = lens.with_stop_diameter(2 * block["stop_semi_diameter"])
        radii = [row["r"] for row in block["rows"]]
        expected = np.array([row["E"] for row in block["rows"]])
        got = film_irradiance(stopped, block["film_z"] - lens.length, radii, azimuth_degrees=90)
        np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-9)


# Film radius [mm] against irradiance; Monte Carlo, so within 0.4 %, and the digits printed.
VIGNETTING = {
    ("dgauss-50mm", 36.77, 17.1): [0.18893, 0.16371, 0.12362, 0.08187, 0.04346, 0.01196, 0, 0],
    ("dgauss-50mm", 36.77, 8.55): [0.04665, 0.04608, 0.04411, 0.04104, 0.03200, 0.01162, 0, 0],
    ("wide-22mm", 14.54, 8.756): [0.0990, 0.0853, 0.0619, 0.0381, 0.0173, 0.00037, 0, 0],
    ("fisheye-10mm", 23.192, 6.08): [0.04914, 0.03860, 0.01969, 0, 0, 0, 0, 0],
    ("telephoto-250mm", 123.7439, 40.5): [0.02062, 0.02050, 0.02046, 0.02029, 0.02005, 0.01907, 0.01728, 0.01516],
    ("telephoto-250mm", 123.7439, 20.25): [0.00546, 0.00542, 0.00537, 0.00531, 0.00524, 0.00519, 0.00514, 0.00502],
}


@pytest.mark.parametrize("case", one_in(3, [(case,) for case in VIGNETTING]))
def test_vignetting_of_the_assignment_lenses(case):
    name, film, stop = case
    got = film_irradiance(load_lens(name).with_stop_diameter(stop), film, np.arange(8) * 5.0)
    np.testing.assert_allclose(got, VIGNETTING[case], rtol=0.012, atol=1.2e-4)


def test_axial_irradiance_is_pi_sine_squared():
    lens = load_lens("biconvex-stop")
    film = 48.0
    low, high = 0.0, 8.0
    for _ in range(60):
        middle = (low + high) / 2
        passes = lens.trace([[0, 0, lens.length + film]], [[middle, 0, -film]]).passed[0]
        low, high = (middle, high) if passes else (low, middle)
    assert on_axis_irradiance(lens, film) == pytest.approx(np.pi * low**2 / (low**2 + film**2), rel=1e-6)


def test_no_light_on_the_axis_is_an_error():
    blocked = {
        "name": "blind",
        "surfaces": [
            {"stop": True, "thickness": 50, "diameter": 0.001},
            {"radius": -3, "thickness": 1, "glass": {"index": 4.0}, "diameter": 1},
            {"radius": 1, "diameter": 1.99},
        ],
    }
    lens = load_lens(blocked)
    assert film_irradiance(lens, 2.0, [5.0])[0] == 0
    with pytest.raises(InputError, match="film must stand behind the last surface"):
        on_axis_irradiance(lens, 0.5)


@pytest.mark.parametrize("f_number", [None, 5.6])
def test_axial_irradiance_is_the_integral_over_the_pupil(f_number: float | None) -> None:
    lens = load_lens("dgauss-50mm")
    if f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number))
    assert axial_irradiance(lens, 31.0) == pytest.approx(on_axis_irradiance(lens, 31.0), rel=2e-5)
    assert axial_irradiance(load_lens("anamorphic-100mm"), 31.0) is None


@pytest.mark.parametrize("name", ["dgauss-50mm", "achromat-100mm", "double-gauss-100mm-f1.25", "wide-22mm"])
def test_axial_irradiance_near_that_of_another_wavelength_is_within_a_thousandth(name: str) -> None:
    lens = load_lens(name)
    film_mm = film_distance(lens, 3000.0)
    green = axial_irradiance(lens, film_mm, 545.0)
    for wavelength_nm in (400.0, 480.0, 700.0):
        found = axial_irradiance(lens, film_mm, wavelength_nm, near=green)
        assert found == pytest.approx(axial_irradiance(lens, film_mm, wavelength_nm), rel=7e-4)
        assert axial_irradiance(lens, film_mm, wavelength_nm, near=1.2 * green) is None  # the rim is not there
        assert axial_irradiance(lens, film_mm, wavelength_nm, near=0.8 * green) is None
    assert axial_irradiance(load_lens("mirror-500mm"), 100.0, near=0.01) is None


def test_coarse_outlines_in_few_calls_are_those_of_many() -> None:
    lens = load_lens("retrofocus-35mm")
    probe = FilmProbe(lens, film_distance(lens, 3000.0), 545.0)
    film = np.stack([np.linspace(0.0, 21.0, 8), np.zeros(8)], axis=1)
    pupil = lens.first_order(545.0).exit_pupil
    shrink = probe.distance / (probe.distance - pupil.distance_mm)
    frames = film * (1 - shrink), np.full((8, 2), 0.5 * pupil.diameter_mm * shrink)
    at_once, one_by_one = (
        reach_of(probe, film, *frames, fineness, mirrored=True)
        for fineness in (COARSE_OUTLINES, replace(COARSE_OUTLINES))
    )
    np.testing.assert_allclose(at_once, one_by_one, rtol=1e-12)
    assert len(np.unique(at_once)) > 10


def test_pupil_of_a_glance_holds_that_of_every_wavelength_but_for_slivers() -> None:
    """Less than a thousandth of red and blue over the film lies beyond coarse outlines of one wavelength."""
    scale = (np.arange(45) + 0.5)[:, None, None] / 30
    for name in ("achromat-100mm", "dgauss-100mm", "retrofocus-35mm", "zoom-35-51mm", "double-gauss-100mm-f1.25"):
        lens = load_lens(name)
        film_mm = film_distance(lens, 3000.0)
        shapes = pupil_shapes(lens, film_mm, (18.0, 12.0), fineness=COARSE_OUTLINES)
        nodes, directions = shapes.radii.shape[1:]
        turns = np.arange(directions) * 2 * np.pi / directions
        for wavelength_nm in (420.0, 680.0):
            probe, inside, all_of_it = FilmProbe(lens, film_mm, wavelength_nm), 0.0, 0.0
            for k in range(nodes):
                rim = shapes.radii[0, k][:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
                points = shapes.centres[0, k] + shapes.axes[0, k] * rim * scale
                film = np.array([shapes.reach[0] * k / (nodes - 1), 0.0])
                light = (
                    probe.passes(film, points) * scale[..., 0] * np.prod(shapes.axes[0, k]) * shapes.radii[0, k] ** 2
                )
                inside, all_of_it = inside + light[:30].sum(), all_of_it + light.sum()
            assert inside > 0.999 * all_of_it > 0, (name, wavelength_nm, 1 - inside / all_of_it)


@pytest.mark.parametrize("name", ["dgauss-50mm", slow("heliar-105mm")])
def test_sampling_error_is_said_and_holds_for_round_lenses_too(name, monkeypatch):
    lens = load_lens(name)
    back = film_distance(lens, np.inf)
    radii = np.array([0.0, 0.8, 0.99]) * image_circle(lens, back)
    values, errors = irradiance_with_error(lens, back, radii)
    np.testing.assert_array_equal(values, film_irradiance(lens, back, radii))
    assert errors[0] == 0  # all azimuths are alike
    assert (errors[1:] > 1e-7 * values[1:]).all()  # half of a pupil is no mirror image of the other half
    monkeypatch.setattr(irradiance, "AZIMUTHS", 1024)
    many = np.array([irradiance_with_error(lens, back, radius)[0] for radius in radii])
    assert (np.abs(values - many)[1:] < 2 * errors[1:]).all()
    assert (errors[1:] < 0.005 * values[1:]).all()


NM = 587.56


@pytest.mark.parametrize("name", ["dgauss-50mm", "double-gauss-50mm-f1.1", "fisheye-10mm", "zoom-70-200mm", "biconvex"])
def test_irradiance_of_a_disk_is_that_of_the_quadrature(name: str) -> None:
    lens = load_lens(name)
    for stop, away in ((1.0, 1.0), (0.6, 1.02), (0.17, 1.1)):
        state = lens if lens.stop is None else lens.with_stop_diameter(2 * stop * lens.stop.semi_diameter)
        film_distance_mm = away * film_distance(lens, np.inf)
        found = disk_irradiance(state, film_distance_mm, NM)
        assert found == pytest.approx(
            on_axis_irradiance(state, film_distance_mm, NM), rel=1e-8
        )  # its bisection ends at 2e-9


def test_nothing_is_traced_again_for_another_stop_or_film(monkeypatch: pytest.MonkeyPatch) -> None:
    lens, film_distance_mm = load_lens("dgauss-50mm"), 32.0
    disk_irradiance(lens.with_stop_diameter(8.4), film_distance_mm, NM)
    monkeypatch.setattr(irradiance, "_trace_beam", None)  # whatever traces again fails
    state = lens.with_stop_diameter(8.3)
    assert disk_irradiance(state, 32.1, NM) == pytest.approx(on_axis_irradiance(state, 32.1, NM), rel=1e-8)


@pytest.mark.parametrize("name", ["mirror-500mm", "anamorphic-100mm", "shaped"])
def test_pupils_that_are_no_disk_are_refused(name: str) -> None:
    lens = load_lens("dgauss-50mm").with_stop_shape(blades(6)) if name == "shaped" else load_lens(name)
    assert disk_irradiance(lens, film_distance(lens, np.inf), NM) is None


@pytest.mark.parametrize(("section", "along"), [slow("y", [0.0, 1.0]), slow("x", [1.0, 0.0])])
def test_vignetting_of_an_anamorphic_lens_is_that_of_its_section(section, along):
    lens = load_lens("anamorphic-100mm")
    setting = in_section(spots.setting(lens), section)
    side, radii = np.linspace(-20, 20, 401), np.array([0.0, 25.0, 45.0])  # the rear rim has a radius of 16.5 mm
    plane = np.stack([*(each.ravel() for each in np.meshgrid(side, side)), np.full(401**2, lens.length)], axis=1)
    for row, radius in zip(vignetting_table(setting, radii), radii, strict=True):
        start = np.array([*(radius * np.array(along)), lens.film_z(setting.film)])
        passed = lens.trace(np.broadcast_to(start, plane.shape), plane - start, setting.wavelength_nm).passed
        square = np.sum((plane - start) ** 2, axis=1)
        expected = np.sum(passed * (setting.film / square) ** 2) * (side[1] - side[0]) ** 2
        assert row["irradiance"] == pytest.approx(expected, rel=2e-3)
        assert row["pass_area_mm2"] == pytest.approx(np.count_nonzero(passed) * (side[1] - side[0]) ** 2, rel=2e-3)


def test_the_image_circle_of_an_anamorphic_lens_is_that_along_y():
    lens = load_lens("anamorphic-100mm")
    info = lens_info(lens)
    radius, film = info["image_circle_mm"] / 2, info["film_distance_mm"]
    along_y, along_x = (film_irradiance(lens, film, radius * np.array([0.998, 1.002]), azimuth_degrees=degrees)
                        for degrees in (90, 0))  # fmt: skip
    assert along_y[0] > along_y[1] == 0 < along_x.min()
