"""How much light of each wavelength a lens lets through along its axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rptcam_cl.lenstools.charts import add_key, new_chart, series, styled
from rptcam_cl.lenstools.colours import FAINT
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.optics import COATED, UNCOATED, LensTransmission, axial_transmittance, has_coatings, t_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GLASS_ALONE = LensTransmission(fresnel=False, coatings=False)
STEPS = 121  # of a curve

Row = dict[str, float | None]


def transmittance_table(setting: Setting, wavelengths_nm: Sequence[float]) -> list[Row]:
    """Return a row for each wavelength.

    Each has the share of light on the axis that is left by the glass alone, as far as its absorption is known, by glass
    and bare surfaces, and by glass and coated surfaces (None when the lens does not say how it is coated); then the
    T-numbers of the last two, of the film in the middle (None without one).
    """
    rows: list[Row] = []
    for wavelength in wavelengths_nm:
        glass, bare, coated = (
            float(axial_transmittance(setting.lens, wavelength, losses)) for losses in (GLASS_ALONE, UNCOATED, COATED)
        )
        known, film = has_coatings(setting.lens), setting.film_distance_mm
        t_bare, t_coated = (
            t_number(setting.lens, film, wavelength, losses) if film is not None and passed > 0 else None
            for passed, losses in ((bare, UNCOATED), (coated if known else 0.0, COATED))
        )
        rows.append(
            {
                "wavelength_nm": wavelength,
                "glass": glass,
                "bare": bare,
                "coated": coated if known else None,
                "t_number_bare": t_bare,
                "t_number_coated": t_coated,
            }
        )
    return rows


@styled()
def transmittance_chart(setting: Setting, rows: Sequence[Row]) -> Figure:
    """Return curves from the shortest to the longest wavelength of the rows."""
    ends = [row["wavelength_nm"] or 0.0 for row in rows]
    low, high = min(ends), max(ends)
    if low == high:
        low, high = low - 1.0, high + 1.0
    waves = np.linspace(low, high, STEPS)
    title, labels = f"{setting.lens.name}: light let through on the axis", ("wavelength [nm]", "transmittance [%]")
    figure, axes = new_chart(title, labels, (low, high), (0.0, 104.0))
    curves = [("glass alone", GLASS_ALONE, FAINT, ":"), ("bare surfaces", UNCOATED, series(1), "--")]
    if has_coatings(setting.lens):
        curves.append(("coated surfaces", COATED, series(0), "-"))
    for label, losses, colour, line in curves:
        axes.plot(waves, 100 * axial_transmittance(setting.lens, waves, losses), line, color=colour, label=label)
    add_key(figure, axes.lines)
    return figure
