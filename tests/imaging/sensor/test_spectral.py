"""Spectra as a camera sees them."""

from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.colour import on_grid, response_curves, srgb_from_spectrum
from tests.support.cases import slow
from tests.support.statistics import assert_equivalent

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
