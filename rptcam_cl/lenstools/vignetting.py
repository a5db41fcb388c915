"""How the film darkens from the centre outwards, and which part of that is the pupil's and which is cos^4's."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.chart import Legend, chart
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.lenstools.picture import FAINT, SERIES, Drawing
from rptcam_cl.optics import FilmProbe, cells, film_irradiance, grid, image_circle, narrowed

Array = NDArray[np.float64]

GRID = (96, 96)
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
    areas = pass_areas(setting, radii_mm)
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


def pass_areas(setting: Setting, radii_mm: Array) -> Array:
    """Return the area of the plane of the last vertex through which light reaches each film radius [mm2]."""
    probe = FilmProbe(setting.lens, setting.film, setting.wavelength_nm)
    film = np.stack([radii_mm, np.zeros_like(radii_mm)], axis=1)
    boxes = probe.windows(film)
    for _ in range(2):
        boxes, _found = narrowed(probe, film, boxes, GRID)
    hits = probe.passes(film[:, None], grid(boxes, *GRID))
    return np.asarray(hits.sum(axis=1) * cells(boxes, *GRID).prod(axis=1))


def vignetting_picture(setting: Setting, rows: Sequence[Row]) -> Drawing:
    """Return the curves over the film radius."""
    curves = (("relative irradiance", "relative", SERIES[0], ()), ("pass area", "pass_share", SERIES[1], (6.0, 4.0)),
              ("cos^4", "cos4", FAINT, (2.0, 3.0)))  # fmt: skip
    radii = [row["film_radius_mm"] or 0.0 for row in rows]
    highest = max(1.0, *(row["pass_share"] or 0.0 for row in rows), *(row["relative"] or 0.0 for row in rows))
    axes = chart(
        f"{setting.lens.name}: light falling off over the film",
        ("distance from the axis on the film [mm]", "part of that of the centre"),
        (0.0, radii[-1]),
        (0.0, 1.04 * highest),
        [Legend(label, colour, dash) for label, _, colour, dash in curves],
    )
    for _, name, colour, dash in curves:
        axes.curve(radii, [row[name] or 0.0 for row in rows], colour, dash)
    return axes.picture
