"""The image of a point and the transfer of a lens by wave optics, over all wavelengths of a field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.lenstools.mtf import CURVE, curves_chart, table_of
from rptcam_cl.lenstools.psf import SHARES, PointImage
from rptcam_cl.lenstools.wavefronts import FieldWave, waves_by_field
from rptcam_cl.optics import AIRY, PupilFunction, centroid, encircling, radius_of_share, spread, strehl, transfer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WIDEST = 48.0  # radius of the first circle that is searched, in Airy radii
SHOWN = 1.2  # half width of the image over the radius that holds 80 % of the light
FINEST = 16.0  # points per wavelength times f-number that pixels are averaged over at least; 4 leave 2 % at the peak
MOST_POINTS = 1200  # along each side of the image


def wave_transfer(group: Sequence[FieldWave], frequencies_per_mm: ArrayLike) -> list[Array]:
    """Return tangential and sagittal modulation of one field, and what its perfect pupil would leave of each."""
    weights = _weights(group)
    origin = group[0].pupil.chief
    parts, limits = [], []
    for wave in group:
        off = origin - wave.pupil.chief
        parts.append(transfer(wave.pupil, frequencies_per_mm, (float(off[0]), float(off[1]))))
        limits.append([np.abs(curve) for curve in transfer(wave.pupil.without_aberrations(), frequencies_per_mm)])
    curves = [np.abs(np.tensordot(weights, [part[axis] for part in parts], 1)) for axis in (0, 1)]
    return [*curves, *(np.tensordot(weights, [limit[axis] for limit in limits], 1) for axis in (0, 1))]


def wave_mtf_table(waves: Sequence[FieldWave], frequencies_per_mm: Sequence[float]) -> list[dict[str, Any]]:
    """Return a row for each field and frequency, the wavelengths of a field together."""
    fields = {degrees: wave_transfer(group, frequencies_per_mm) for degrees, group in waves_by_field(waves).items()}
    return table_of(fields, frequencies_per_mm)


def wave_mtf_chart(setting: Setting, waves: Sequence[FieldWave], highest_per_mm: float) -> Figure:
    """Return the curves of every field up to a frequency."""
    frequencies = np.linspace(0.0, highest_per_mm, CURVE)
    fields = {degrees: wave_transfer(group, frequencies) for degrees, group in waves_by_field(waves).items()}
    return curves_chart(f"{setting.lens.name}: MTF by wave optics", frequencies, fields)


def wave_point_image(group: Sequence[FieldWave], pixels: int, width_um: float | None = None) -> PointImage:
    """Return the image of one field, its wavelengths together, about the middle of its light.

    Parameters
    ----------
    group : sequence of FieldWave
        Of one field.
    pixels : int
        Along each side.
    width_um : float, optional
        Side of the image; as large as the light needs when absent.
    """
    if pixels < 2:
        raise InputError(f"an image needs at least 2 pixels a side (got {pixels})")
    weights = _weights(group)
    middles = np.array([wave.pupil.chief + centroid(wave.pupil) for wave in group])
    middle = weights @ middles
    offsets = [middle - wave.pupil.chief for wave in group]
    facts = _facts(group, weights, offsets)
    facts |= {"centroid_x_mm": float(middle[0]), "centroid_y_mm": float(middle[1])}
    half = (width_um or 2 * SHOWN * facts["radius_of_80_percent_um"]) / 2e3
    shares = np.zeros((pixels, pixels))
    for wave, weight, offset in zip(group, weights, offsets, strict=True):
        shares += weight * _pixel_shares(wave.pupil, offset, half, pixels)
    return PointImage(shares, 2e3 * half, facts)


def _weights(group: Sequence[FieldWave]) -> Array:
    """Return the share of each wavelength: that of the light of its beam."""
    light = np.array([wave.pupil.flux.sum() * wave.pupil.step**2 for wave in group])
    return np.asarray(light / light.sum())


def _facts(group: Sequence[FieldWave], weights: Array, offsets: Sequence[Array]) -> dict[str, float]:
    """Return the Strehl ratios and the radii about the middle of the light that hold shares of it [micrometres]."""
    ratios = [strehl(wave.pupil) for wave in group]
    facts = {
        "strehl": float(weights @ [ratio.at_chief_ray for ratio in ratios]),
        "strehl_at_peak": float(weights @ [ratio.at_peak for ratio in ratios]),
    }

    circles = [encircling(wave.pupil, (float(off[0]), float(off[1]))) for wave, off in zip(group, offsets, strict=True)]

    def within(radii: Array) -> Array:
        return np.asarray(weights @ [shares(radii) for shares in circles])

    airy = [_airy_radius(wave.pupil) for wave in group]
    held = [float(shares(np.array([radius]))[0]) for shares, radius in zip(circles, airy, strict=True)]
    facts |= {"airy_radius_um": 1e3 * float(weights @ airy), "share_within_airy_radius": float(weights @ held)}
    widest = WIDEST * max(airy)
    room = min(wave.pupil.length_mm / wave.pupil.step for wave in group) / 2  # beyond it the light repeats
    while widest < room and within(np.array([widest]))[0] < max(SHARES):
        widest = min(2 * widest, room)
    for share in SHARES:
        facts[f"radius_of_{100 * share:.0f}_percent_um"] = 1e3 * radius_of_share(within, share, widest)
    return facts


def _airy_radius(pupil: PupilFunction) -> float:
    """Return the first dark ring of a round pupil of the same area in direction cosines [mm]."""
    diameter = 2 * float(np.sqrt(pupil.coverage.sum() * pupil.step**2 / np.pi))
    return AIRY * pupil.length_mm / diameter


def _pixel_shares(pupil: PupilFunction, offset: Array, half_mm: float, pixels: int) -> Array:
    """Return the share of light in each pixel, row 0 at the top, about a point off C; by the mean over its points."""
    pixel = 2 * half_mm / pixels
    finer = int(np.ceil(pixel * FINEST * AIRY / _airy_radius(pupil)))
    finer = max(1, min(finer, MOST_POINTS // pixels))
    count = pixels * finer
    places = ((np.arange(count) + 0.5) / count * 2 - 1) * half_mm
    light = spread(pupil, offset[0] + places, offset[1] - places)
    return np.asarray(light.reshape(pixels, finer, pixels, finer).sum(axis=(1, 3)) * (pixel / finer) ** 2)
