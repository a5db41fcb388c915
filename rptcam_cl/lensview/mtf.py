"""Modulation transfer: geometrical, from the spots, beside what diffraction allows a perfect lens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.lensview.chart import Key, chart
from rptcam_cl.lensview.picture import FAINT, SERIES, Picture
from rptcam_cl.lensview.setting import Setting
from rptcam_cl.lensview.spots import FilmSpot, by_field
from rptcam_cl.optics.summary import working_f_number

Array = NDArray[np.float64]

CURVE = 101
DOTTED = (5.0, 4.0)


def geometric_mtf(points: Array, frequencies_per_mm: ArrayLike) -> tuple[Array, Array]:
    """Return the modulation (tangential, sagittal) of light spread over points (n, 2) of the film [mm].

    Tangential lines lie along x, so that they blur in y; sagittal ones along y. Each is the length of the mean of
    exp(-2 pi i f y) over the rays, the Fourier transform of the spot.
    """
    waves = -2j * np.pi * np.asarray(frequencies_per_mm, dtype=np.float64)[:, None]
    off = points - points.mean(axis=0)
    tangential, sagittal = (np.abs(np.mean(np.exp(waves * off[:, axis]), axis=1)) for axis in (1, 0))
    return tangential, sagittal


def diffraction_mtf(frequencies_per_mm: ArrayLike, f_number: float, wavelength_nm: float) -> Array:
    """Return the modulation of a perfect lens with a round pupil ; 0 from 1 / (wavelength f-number) on."""
    share = np.asarray(frequencies_per_mm, dtype=np.float64) * f_number * wavelength_nm * 1e-6
    inside = np.minimum(np.abs(share), 1.0)
    return np.asarray(2 / np.pi * (np.arccos(inside) - inside * np.sqrt(1 - inside * inside)))


def perfect_mtf(setting: Setting, spots: Sequence[FilmSpot], frequencies_per_mm: ArrayLike) -> Array:
    """Return the modulation on the axis of a perfect lens of the same aperture, the mean over the wavelengths."""
    f_number = working_f_number(setting.lens, setting.film, setting.wavelength_nm)
    waves = list(dict.fromkeys(spot.wavelength_nm for spot in spots))
    curves = [diffraction_mtf(frequencies_per_mm, f_number, wave) for wave in waves]
    return np.asarray(np.mean(curves, axis=0))


def mtf_table(setting: Setting, spots: Sequence[FilmSpot], frequencies_per_mm: Sequence[float]) -> list[dict[str, Any]]:
    """Return a row for each field and frequency, the wavelengths of a field together."""
    perfect = perfect_mtf(setting, spots, frequencies_per_mm)
    rows = []
    for degrees, group in by_field(spots).items():
        points = np.concatenate([spot.points for spot in group])
        curves = zip(frequencies_per_mm, *geometric_mtf(points, frequencies_per_mm), perfect, strict=True)
        for frequency, tangential, sagittal, limit in curves:
            rows.append(
                {
                    "field_degrees": degrees,
                    "frequency_per_mm": frequency,
                    "tangential": float(tangential),
                    "sagittal": float(sagittal),
                    "diffraction_limit": float(limit),
                }
            )
    return rows


def mtf_picture(setting: Setting, spots: Sequence[FilmSpot], highest_per_mm: float) -> Picture:
    """Return the curves of every field up to a frequency: tangential full, sagittal dashed, the limit grey."""
    groups = by_field(spots)
    keys = [Key(f"{degrees:g}°", SERIES[i % len(SERIES)]) for i, degrees in enumerate(groups)]
    keys += [Key("sagittal", SERIES[0], DOTTED), Key("diffraction limit", FAINT, (2, 3))]
    labels = ("cycles per mm on the film", "modulation")
    axes = chart(f"{setting.lens.name}: geometrical MTF", labels, (0.0, highest_per_mm), (0.0, 1.02), keys)
    frequencies = np.linspace(0.0, highest_per_mm, CURVE)
    axes.curve(frequencies, perfect_mtf(setting, spots, frequencies), FAINT, (2, 3))
    for number, group in enumerate(groups.values()):
        points = np.concatenate([spot.points for spot in group])
        tangential, sagittal = geometric_mtf(points, frequencies)
        colour = SERIES[number % len(SERIES)]
        axes.curve(frequencies, tangential, colour)
        axes.curve(frequencies, sagittal, colour, DOTTED)
    return axes.picture
