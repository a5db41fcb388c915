"""How the film darkens from the centre outwards, and which part of that is the pupil's and which is cos^4's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.charts import add_key, new_chart, series, styled
from rptcam_cl.lenstools.colours import FAINT
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.optics import film_irradiance, image_circle, pass_areas

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

Row = dict[str, float | None]


def film_radii(setting: Setting, steps: int, film_radius_mm: float | None = None) -> Array:
    """Return radii from the centre to a film radius [mm], that of the image circle when absent."""
    if film_radius_mm is None:
        film_radius_mm = image_circle(setting.lens, setting.film, setting.wavelength_nm)
    return np.linspace(0.0, film_radius_mm, steps + 1)


def vignetting_table(setting: Setting, radii_mm: Array) -> list[Row]:
    """Return a row for each film radius.

    Each has the irradiance under a uniform world of unit radiance, the same over that of the centre, in stops below it,
    the angle at which light from the centre of the exit pupil arrives, cos^4 of it, the area of the plane of the last
    vertex through which light passes, and that area over the one of the centre.
    """
    values = film_irradiance(setting.lens, setting.film, radii_mm, setting.wavelength_nm)
    if not values[0] > 0:
        raise InputError(f"{setting.lens.name}: no light reaches the centre of the film")
    areas = pass_areas(setting.lens, setting.film, radii_mm, setting.wavelength_nm)
    pupil = setting.lens.first_order(setting.wavelength_nm).exit_pupil.distance_mm
    rows: list[Row] = []
    for radius, value, area in zip(radii_mm.tolist(), values.tolist(), areas.tolist(), strict=True):
        angle = math.atan2(radius, abs(setting.film - pupil)) if math.isfinite(pupil) else 0.0
        relative = value / float(values[0])
        rows.append(
            {
                "film_radius_mm": radius,
                "irradiance": value,
                "relative": relative,
                "stops": math.log2(relative) if relative > 0 else None,
                "angle_degrees": math.degrees(angle),
                "cos4": math.cos(angle) ** 4,
                "pass_area_mm2": area,
                "pass_share": area / float(areas[0]),
            }
        )
    return rows


@styled()
def vignetting_chart(setting: Setting, rows: Sequence[Row]) -> Figure:
    """Return the curves over the film radius."""
    radii = [row["film_radius_mm"] or 0.0 for row in rows]
    title = f"{setting.lens.name}: light falling off over the film"
    labels = ("distance from the axis on the film [mm]", "of the value at the centre [%]")
    figure, axes = new_chart(title, labels, (0.0, radii[-1]))
    for label, name, colour, line in (
        ("relative irradiance", "relative", series(0), "-"),
        ("area through which light passes", "pass_share", series(1), "--"),
        ("cos^4 of the angle on the film", "cos4", FAINT, ":"),
    ):
        axes.plot(radii, [100 * (row[name] or 0.0) for row in rows], line, color=colour, label=label)
    axes.set_ylim(bottom=0.0)
    add_key(figure, axes.lines)
    return figure
