"""Wavefronts of fields and wavelengths: path differences, Strehl ratios, and the map over the pupil."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.charts import SIZE, new_figure, styled
from rptcam_cl.lenstools.fields import default_fields
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.optics import Beam, PupilFunction, peak_to_valley, pupil_function, rms_waves, strehl

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

PANELS = 3  # side by side
PANEL, REST = 2.9, 0.6  # height of a row of panels, and of the title [inches]


@dataclass(frozen=True)
class FieldWave:
    """The light of one field and wavelength behind the lens."""

    field_degrees: float
    wavelength_nm: float
    pupil: PupilFunction


def field_waves(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], across: int | None = None
) -> list[FieldWave]:
    """Return the light of each field and wavelength; fields whose light does not pass are left out.

    Parameters
    ----------
    setting : Setting
    fields : sequence of float, optional
        Angles from the axis [degrees]; the axis and two more when absent.
    wavelengths_nm : sequence of float
    across : int, optional
        Cells across each pupil; as many as its wavefront needs when absent.

    Raises
    ------
    InputError
        When nothing of any beam passes, or the lens has no film.
    """
    film = setting.film
    waves: list[FieldWave] = []
    refused: InputError | None = None
    for degrees in default_fields(setting) if fields is None else fields:
        for wavelength in wavelengths_nm:
            beam = Beam(degrees, setting.object_distance_mm)
            try:
                pupil = pupil_function(setting.lens, film, beam, wavelength, across)
            except InputError as problem:
                refused = problem
                continue
            waves.append(FieldWave(degrees, wavelength, pupil))
    if refused is not None and not waves:
        raise refused
    return waves


def waves_by_field(waves: Sequence[FieldWave]) -> dict[float, list[FieldWave]]:
    """Return the light of each field, in order."""
    groups: dict[float, list[FieldWave]] = {}
    for wave in waves:
        groups.setdefault(wave.field_degrees, []).append(wave)
    return groups


def wavefront_table(waves: Sequence[FieldWave]) -> list[dict[str, Any]]:
    """Return a row for each wavefront, up to the sphere about the chief ray's point: rms, range, Strehl ratios."""
    rows = []
    for wave in waves:
        pupil, ratio = wave.pupil, strehl(wave.pupil)
        rows.append({
            "field_degrees": wave.field_degrees,
            "wavelength_nm": wave.wavelength_nm,
            "rms_waves": rms_waves(pupil, pupil.waves_on_sphere),
            "rms_waves_without_tilt": rms_waves(pupil, pupil.waves_on_sphere, without_tilt=True),
            "peak_to_valley_waves": peak_to_valley(pupil, pupil.waves_on_sphere),
            "strehl": ratio.at_chief_ray,
            "strehl_at_peak": ratio.at_peak,
            "chief_y_mm": float(pupil.chief[1]),
        })  # fmt: skip
    return rows


@styled()
def wavefront_chart(setting: Setting, waves: Sequence[FieldWave]) -> Figure:
    """Return the maps of path differences over the pupil side by side, to one scale, in direction cosines."""
    rows = math.ceil(len(waves) / PANELS)
    columns = min(len(waves), PANELS)
    figure = new_figure(f"{setting.lens.name}: wavefront at the exit pupil", (SIZE[0], rows * PANEL + REST))
    panels = figure.subplots(rows, columns, squeeze=False)
    maps = [_map(wave.pupil) for wave in waves]
    most = max(float(np.nanmax(np.abs(part))) for part in maps) or 1.0
    for axes, wave, part in zip(panels.flat, waves, maps, strict=False):
        pupil = wave.pupil
        extent = (pupil.cosines_x[0], pupil.cosines_x[-1], pupil.cosines_y[0], pupil.cosines_y[-1])
        shown = axes.imshow(part, cmap="RdBu_r", vmin=-most, vmax=most, origin="lower", extent=extent)
        rms = rms_waves(pupil, pupil.waves_on_sphere)
        axes.set_title(f"{wave.field_degrees:g}°, {wave.wavelength_nm:g} nm\nrms {rms:.3g} waves")
        axes.set(xlabel="direction cosine in x", ylabel="in y" if axes in panels[:, 0] else "")
        axes.locator_params(nbins=4)
        axes.grid(visible=False)
    for axes in panels.flat[len(waves) :]:
        axes.set_visible(False)
    figure.colorbar(shown, ax=panels, label="ahead of the chief ray [waves]", shrink=0.8)
    return figure


def _map(pupil: PupilFunction) -> Array:
    """Return the path differences about their mean; NaN outside of the pupil."""
    weight = pupil.flux / pupil.flux.sum()
    mean = float(np.sum(weight * pupil.waves_on_sphere))
    return np.where(pupil.coverage >= 0.5, pupil.waves_on_sphere - mean, np.nan)
