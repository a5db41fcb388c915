"""Tables on the grid of wavelengths."""

import numpy as np
import pytest

from rptcam_cl.core.colour import (
    METALS,
    WAVELENGTHS_NM,
    cie_1931,
    exact_luminance,
    lines_on_grid,
    metal_optics,
    on_grid,
    rgb_basis,
    within_srgb,
)


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
    assert found.sum() == pytest.approx(np.trapezoid(spike, fine), rel=1e-9)
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
