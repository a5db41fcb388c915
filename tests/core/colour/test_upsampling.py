"""Spectra for colours: bounds, and the colour that comes back."""

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import linprog

from benchmarks import rgb_basis as solver
from benchmarks import upsampling
from rptcam_cl.core.colour import (
    METALS,
    WAVELENGTHS_NM,
    cie_1931,
    daylight_65,
    exact_luminance,
    lines_on_grid,
    metal_optics,
    on_grid,
    reflectance_from_srgb,
    rgb_basis,
    srgb_from_reflectance,
    srgb_from_spectrum,
    within_srgb,
)

CUBE = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 3), axis=-1).reshape(-1, 3)


def test_basis_is_never_negative_and_sums_to_one():
    assert rgb_basis().min() >= 0
    np.testing.assert_allclose(rgb_basis().sum(axis=1), 1, atol=1e-11)


def test_every_colour_of_srgb_comes_back():
    spectra = reflectance_from_srgb(CUBE)
    assert spectra.min() >= 0 and spectra.max() <= 1 + 1e-11
    np.testing.assert_allclose(srgb_from_reflectance(spectra), CUBE, atol=1e-10)


def test_lights_come_back_at_any_strength():
    colours = np.array([[1, 1, 1], [100, 0, 3], [0, 1e-3, 0.5]])
    np.testing.assert_allclose(
        srgb_from_spectrum(reflectance_from_srgb(colours) * daylight_65()), colours, rtol=1e-10, atol=1e-11
    )


def test_tables_in_float32_keep_colours():
    table = rgb_basis().astype(np.float32).astype(np.float64)
    assert np.abs(srgb_from_reflectance(CUBE @ table.T) - CUBE).max() < 1e-8


def test_mixtures_of_colours_are_mixtures_of_spectra():
    one, other = CUBE[100], CUBE[500]
    mixed = reflectance_from_srgb(0.3 * one + 0.7 * other)
    np.testing.assert_allclose(mixed, 0.3 * reflectance_from_srgb(one) + 0.7 * reflectance_from_srgb(other), atol=1e-12)


def test_no_allowed_basis_is_smoother():
    H, A, b, G, h = solver.problem()
    x = rgb_basis()[:, :2].T.ravel()
    slope = 2 * H @ x
    # the problem is convex: nothing allowed lies down the slope from its least point
    lowest = linprog(slope, A_ub=G, b_ub=h, A_eq=A, b_eq=b, bounds=(None, None))
    assert lowest.status == 0
    assert slope @ x == pytest.approx(lowest.fun, rel=1e-6)


def test_patches_of_a_chart_come_back():
    patches = np.clip([srgb_from_reflectance(patch) for patch in upsampling.color_checker().values()], 0, 1)
    assert len(patches) == 24
    assert upsampling.round_trip(reflectance_from_srgb, patches) < 1e-10
    assert upsampling.round_trip(upsampling.sigmoid_spectrum, patches[:4]) < 1e-10


def test_spectra_are_as_near_to_measured_ones_as_documented():
    found = upsampling.against_measured(reflectance_from_srgb)
    np.testing.assert_allclose(found.mean(axis=0), [0.051, 2.8, 2.2, 3.4, 1.7], rtol=0.03)
    np.testing.assert_allclose(found.max(axis=0), [0.130, 9.6, 6.9, 10.5, 4.5], rtol=0.03)
    even = upsampling.against_measured(lambda colour: np.full(401, colour.mean()))
    assert (even.mean(axis=0) > 1.5 * found.mean(axis=0)).all()


@pytest.mark.slow
def test_table_is_what_the_solver_finds():
    np.testing.assert_allclose(solver.solve(), rgb_basis(), atol=1e-9)


def test_grid_goes_from_380_to_780_nm():
    assert WAVELENGTHS_NM.tolist() == list(range(380, 781))


def test_coarse_tables_have_straight_lines_between_rows():
    found = on_grid([400, 500, 700], [1, 3, 2])
    np.testing.assert_allclose(found[[0, 20, 70, 120, 220, 320, 400]], [1, 1, 2, 3, 2.5, 2, 2])
    assert on_grid([400, 500], [1, 3], beyond=0.0)[[19, 20, 120, 121]].tolist() == [0, 1, 3, 0]


def test_fine_tables_keep_their_integral():
    fine = np.arange(500, 600.01, 0.1)
    spike = np.exp(-0.5 * ((fine - 546.07) / 0.2) ** 2)
    found = on_grid(fine, spike, beyond=0.0)
    assert found.sum() == pytest.approx(trapezoid(spike, fine), rel=1e-9)
    points = np.interp(WAVELENGTHS_NM, fine, spike)
    assert abs(points.sum() / found.sum() - 1) > 0.5


@pytest.mark.parametrize("wavelength", [380.0, 546.07, 632.8, 780.0])
def test_lines_keep_amount_and_wavelength(wavelength):
    found = lines_on_grid([(wavelength, 2.5)])
    assert found.sum() == pytest.approx(2.5)
    assert found @ WAVELENGTHS_NM / 2.5 == pytest.approx(wavelength)
    assert np.count_nonzero(found) <= 2


def test_colours_outside_srgb_keep_their_luminance():
    laser = np.array([-0.3, 1.2, -0.05])
    kept = within_srgb(laser)
    assert kept.min() >= 0
    assert exact_luminance(kept) == pytest.approx(float(exact_luminance(laser)))
    np.testing.assert_allclose(within_srgb([0.2, 0.5, 1.7]), [0.2, 0.5, 1.7])
    assert within_srgb([0.0, 0.0, 0.0]).tolist() == [0, 0, 0]


@pytest.mark.parametrize("name", METALS)
def test_metals_are_known_at_every_wavelength(name):
    n, k = metal_optics(name)
    assert n.shape == k.shape == WAVELENGTHS_NM.shape
    assert n.min() > 0 and k.min() > 0


def test_gold_has_its_measured_index():
    # Johnson and Christy 1972: 2.26 eV, 548.6 nm
    n, k = (np.interp(1239.84198 / 2.26, WAVELENGTHS_NM, part) for part in metal_optics("gold"))
    assert (n, k) == (pytest.approx(0.43, abs=0.01), pytest.approx(2.455, abs=0.01))


@pytest.mark.parametrize("table", [cie_1931, rgb_basis])
def test_tables_that_all_share_cannot_be_written_to(table) -> None:
    with pytest.raises(ValueError, match="read-only"):
        table()[0] = 0.0
