"""Lights against what the literature says of them."""

import numpy as np
import pytest

from rptcam_cl.core.colour import (
    ILLUMINANTS,
    WAVELENGTHS_NM,
    blackbody,
    cie_1931,
    daylight,
    illuminant,
    srgb_from_spectrum,
    xyz_from_spectrum,
)
from rptcam_cl.core.errors import InputError

# x, y for the 2 degree observer: CIE 15:2018, and CIE 15:2004 table T.8 for fluorescent lamps.
CHROMATICITIES = {
    "A": (0.44758, 0.40745), "D50": (0.34567, 0.35851), "D55": (0.33243, 0.34744), "D65": (0.3127, 0.3290),
    "D75": (0.29903, 0.31488), "E": (1 / 3, 1 / 3), "F2": (0.3721, 0.3751), "F7": (0.3129, 0.3292),
    "F11": (0.3805, 0.3769), "LED-B1": (0.4560, 0.4078), "LED-B3": (0.3756, 0.3723), "LED-B5": (0.3118, 0.3236),
}  # fmt: skip


def chromaticity(spectrum):
    xyz = xyz_from_spectrum(spectrum)
    return xyz[:2] / xyz.sum()


def colour_temperature(spectrum):
    """Temperature of the black body that is nearest in the CIE 1960 diagram [K]."""

    def uv(light):
        x, y, z = xyz_from_spectrum(light)
        return np.array([4 * x, 6 * y]) / (x + 15 * y + 3 * z)

    kelvins = np.geomspace(1000, 40000, 4001)
    away = [np.linalg.norm(uv(blackbody(kelvin)) - uv(spectrum)) for kelvin in kelvins]
    return kelvins[int(np.argmin(away))]


@pytest.mark.parametrize(("name", "expected"), CHROMATICITIES.items())
def test_illuminant_has_its_published_chromaticity(name, expected):
    # tables at 5 nm are read with straight lines between them, which moves lamps with lines by a little
    tolerance = 1e-4 if name[0] in "ADE" else 4e-4
    np.testing.assert_allclose(chromaticity(illuminant(name)), expected, atol=tolerance)


@pytest.mark.parametrize("name", ILLUMINANTS)
def test_illuminant_has_luminance_one(name):
    assert illuminant(name).min() >= 0
    assert xyz_from_spectrum(illuminant(name))[1] == pytest.approx(1, abs=1e-12)


def test_d65_is_white():
    np.testing.assert_allclose(srgb_from_spectrum(illuminant("D65")), 1, atol=1e-12)
    assert np.abs(srgb_from_spectrum(illuminant("E")) - 1).max() > 0.05


def test_matching_functions_have_equal_integrals():
    sums = cie_1931().sum(axis=0)
    np.testing.assert_allclose(sums, 106.857, atol=0.015)  # CIE: 106.857 each, from 360 to 830 nm
    assert cie_1931()[:, 1].max() == pytest.approx(1, abs=1e-4)
    assert WAVELENGTHS_NM[cie_1931()[:, 1].argmax()] == 555


def test_black_body_of_2856_kelvin_is_illuminant_a():
    found = blackbody(2856.0)
    found = found / xyz_from_spectrum(found)[1]
    # 2848 K with the constant 14350 is 2855.5 K with today's
    np.testing.assert_allclose(found, illuminant("A"), rtol=1e-3)
    exact = blackbody(2848 * 14387.76877 / 14350)
    np.testing.assert_allclose(exact / xyz_from_spectrum(exact)[1], illuminant("A"), rtol=1e-8)


@pytest.mark.parametrize("kelvin", [500.0, 2856.0, 6500.0, 20000.0])
def test_black_body_obeys_wien_and_rayleigh(kelvin):
    spectrum = blackbody(kelvin)
    peak = 2.897771955e6 / kelvin  # [nm], Wien's displacement law
    if 390 < peak < 770:
        assert WAVELENGTHS_NM[spectrum.argmax()] == pytest.approx(peak, abs=1)
    elif peak >= 770:
        assert np.all(np.diff(spectrum) > 0)
    else:
        assert np.all(np.diff(spectrum) < 0)


def test_black_body_radiates_what_stefan_and_boltzmann_say():
    # At 5772 K the grid holds 46.5 % of sigma T^4 / pi (tables of the fractional function of black bodies).
    share = blackbody(5772.0).sum() / (5.670374419e-8 * 5772.0**4 / np.pi)
    x = 1.438776877e7 / (5772.0 * np.linspace(379.5, 780.5, 200001))
    planck = x**5 / np.expm1(x)
    expected = 15 / np.pi**4 * np.sum(planck) * (1.438776877e7 / 5772.0) ** -1 * 401 / 200001
    assert share == pytest.approx(expected, rel=1e-5)
    assert 0.45 < share < 0.48


@pytest.mark.parametrize("kelvin", [4000.0, 5000.0, 6504.0, 7000.0, 10000.0, 25000.0])
def test_daylight_has_its_colour_temperature(kelvin):
    assert colour_temperature(daylight(kelvin)) == pytest.approx(kelvin, rel=0.006)


def test_daylight_of_6504_kelvin_is_d65():
    np.testing.assert_allclose(daylight(6504), illuminant("D65"), rtol=5e-4)
    assert np.abs(daylight(6000) / illuminant("D65") - 1).max() > 0.05


def test_unknown_lights_are_refused():
    with pytest.raises(InputError, match="D65"):
        illuminant("D66")
    with pytest.raises(InputError, match="4000 to 25000 K"):
        daylight(3999)
