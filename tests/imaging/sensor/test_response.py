"""Response curves, and the electrons that light sets free."""

from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.colour import (
    RESPONSES,
    WAVELENGTHS_NM,
    daylight_65,
    electrons_per_joule,
    exact_luminance,
    on_grid,
    response,
    response_curves,
    rgb_basis,
    srgb_from_reflectance,
    srgb_from_spectrum,
)
from rptcam_cl.core.files import response_curves_dir
from rptcam_cl.imaging.development import rgb_from_balanced, system_gain, white_electrons_at_iso
from tests.imaging.sensor.sensors import sensor
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent


def test_every_file_of_curves_has_its_name_and_source() -> None:
    assert {path.stem for path in response_curves_dir().glob("*.csv")} == set(RESPONSES)
    for path in response_curves_dir().glob("*.csv"):
        assert path.read_text("utf-8").startswith("# ")


@pytest.mark.parametrize("name", RESPONSES)
def test_curves_lie_in_the_order_of_their_colours(name: str) -> None:
    curves = response(name)
    assert curves.shape == (401, 3) and (curves >= 0).all() and curves.max() == 1
    red, green, blue = WAVELENGTHS_NM @ curves / curves.sum(axis=0)
    assert 420 < blue < green < red < 640


@pytest.mark.parametrize("name", RESPONSES)
def test_camera_sees_daylight_white_and_rgb_light_as_its_colour(name: str) -> None:
    curves = response_curves(name)
    assert daylight_65() @ curves == pytest.approx(np.ones(3))
    assert (rgb_basis() * daylight_65()[:, None]).T @ curves == pytest.approx(np.eye(3), abs=1e-12)


@pytest.mark.parametrize("name", RESPONSES)
def test_quantum_efficiency_is_that_of_the_peak(name: str) -> None:
    energy = 6.62607015e-34 * 299792458.0 / (WAVELENGTHS_NM * 1e-9)
    per_photon = response(name) * energy[:, None]
    for index, efficiency in enumerate((0.6, 0.5, 0.4)):
        curve = response(name)[:, index] * efficiency / per_photon[:, index].max()  # electrons per joule
        found = electrons_per_joule(name, (0.6, 0.5, 0.4)).sum(axis=0)[index]
        assert found == pytest.approx(daylight_65() @ curve)


def test_without_curves_each_channel_counts_its_own_photons() -> None:
    found = electrons_per_joule(None, (1.0, 0.5, 0.25))
    photons = np.array([610e-9, 545e-9, 465e-9]) / (6.62607015e-34 * 299792458.0)
    assert found == pytest.approx(np.diag(photons * [1.0, 0.5, 0.25]))


@pytest.mark.parametrize("name", RESPONSES)
def test_colours_of_the_film_come_back_exactly_and_white_stays_white(name: str) -> None:
    chosen = sensor(name)
    balanced = (chosen.electrons / chosen.electrons.sum(axis=0)).T
    assert rgb_from_balanced(chosen) @ balanced == pytest.approx(np.eye(3), abs=1e-12)
    assert rgb_from_balanced(chosen) @ np.ones(3) == pytest.approx(np.ones(3))


@pytest.mark.parametrize("name", RESPONSES)
def test_colours_of_other_spectra_come_near(name: str) -> None:
    """Smooth reflectances that are no mixtures of the basis: sigmoids and bumps. The matrix is not made for them."""
    x = (WAVELENGTHS_NM - 580) / 60
    spectra = np.stack([0.1 + 0.6 / (1 + np.exp(-x)), 0.5 / (1 + np.exp(x)) + 0.1, 0.1 + 0.4 * np.exp(-((x + 1) ** 2))])
    found, true = (spectra * daylight_65()) @ response_curves(name), srgb_from_reflectance(spectra)
    assert exact_luminance(found) == pytest.approx(exact_luminance(true), rel=0.1)
    raw = (spectra * daylight_65()) @ response(name) / (daylight_65() @ response(name))
    assert np.abs(found - true).max() < 0.6 * np.abs(raw - true).max()


def test_iso_speed_saturates_at_78_lux_seconds_over_speed() -> None:
    per_joule = electrons_per_joule("nikon_d5100", (0.5, 0.5, 0.5))
    area = 4.78e-6**2
    fullest = float(per_joule.sum(axis=0).max())
    at_100 = white_electrons_at_iso(fullest, area, 100)
    assert at_100 == pytest.approx(0.78 / 683 * area * fullest)
    assert white_electrons_at_iso(fullest, area, 6400) == pytest.approx(at_100 / 64)
    assert system_gain(16383, 512, at_100) * at_100 + 512 == pytest.approx(16383)
    assert 20_000 < at_100 < 50_000  # what wells of such pixels hold


# A lamp of two broad lines, which no mixture of RGB colours is.
WAVELENGTHS = [380, 430, 450, 470, 560, 590, 610, 640, 780]
VALUES = [0, 0.001, 0.006, 0.001, 0.001, 0.008, 0.009, 0.001, 0]
SCENE: dict[str, Any] = {
    "film": {"resolution": [64, 64]},
    "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 10},
    "environment": {"kind": "constant", "radiance": {"wavelengths_nm": WAVELENGTHS, "values": VALUES}},
    "spectrum": "spectral",
}


def film(response: str | None) -> tuple[np.ndarray, np.ndarray, rptcam_cl.Image]:
    """Return mean and standard error of the film's channels, and the image."""
    sensor = {"bayer": "none", "full_well_e": 1e9, **({"response": response} if response else {})}
    image = rptcam_cl.render({**SCENE, "sensor": sensor}, spp=64)
    pixels = image.pixels.reshape(-1, 3).astype(float)
    return pixels.mean(axis=0), pixels.std(axis=0) / np.sqrt(len(pixels)), image


@pytest.mark.parametrize("response", [slow("nikon_d5100"), "canon_eos_5d_mark_ii"])
def test_film_holds_what_the_camera_takes_a_spectrum_for(response: str) -> None:
    lamp = on_grid(WAVELENGTHS, VALUES)
    expected = lamp @ response_curves(response)
    mean, error, image = film(response)
    assert_equivalent(mean, error, expected, 0.005 * np.abs(expected).max())
    assert image.metadata["observer"] == response
    assert image.seen.mean(axis=(0, 1)) == pytest.approx(mean, rel=0.002)
    raw = np.asarray(image.raw()).mean(axis=(0, 1)) - image.raw().sensor.black_level_dn
    assert raw / raw.sum() == pytest.approx(channels(response, lamp), rel=0.01)


def channels(response: str, lamp: np.ndarray) -> np.ndarray:
    """Shares of the raw channels by the published curves alone, as electrons per joule."""
    from rptcam_cl.core.colour import response as curves

    seen = lamp @ curves(response)
    energy = 1 / np.arange(380, 781)
    peaks = (curves(response) * energy[:, None]).max(axis=0)  # each channel has the same highest quantum efficiency
    return (seen / peaks) / (seen / peaks).sum()


def test_eye_sees_another_colour() -> None:
    lamp = on_grid(WAVELENGTHS, VALUES)
    mean, error, image = film(None)
    assert image.metadata["observer"] == "cie_1931"
    assert_equivalent(mean, error, srgb_from_spectrum(lamp), 0.005 * np.abs(mean).max())
    assert (
        np.abs(srgb_from_spectrum(lamp) - lamp @ response_curves("nikon_d5100")).max() > 0.03 * mean.max()
    )  # six times the tolerance
