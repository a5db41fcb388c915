"""Where chief rays meet the film, against an ideal projection: distortion, and between wavelengths lateral colour."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rptcam_cl.errors import InputError
from rptcam_cl.lensview.chart import Key, chart, padded
from rptcam_cl.lensview.colours import wavelength_colour
from rptcam_cl.lensview.fields import at_plane
from rptcam_cl.lensview.picture import SERIES, Picture
from rptcam_cl.lensview.setting import Setting
from rptcam_cl.optics.spot import chief_ray

Row = dict[str, float | None]

PROJECTIONS = ("tan", "theta")
FISHEYE = 55.0  # degrees from which f tan(angle) no longer says how a lens is meant to draw


def usual_projection(fields: Sequence[float]) -> str:
    """Return "theta" (h = f angle) for fields as wide as those of fisheyes, else "tan" (h = f tan(angle))."""
    return "theta" if max(map(abs, fields)) > FISHEYE else "tan"


def ideal_height(setting: Setting, field_degrees: float, projection: str) -> float:
    """Return the film height [mm] that a projection gives a field, by the lens's focal length and magnification."""
    if projection not in PROJECTIONS:
        raise InputError(f"projection must be one of {', '.join(PROJECTIONS)} (got {projection!r})")
    first = setting.lens.first_order(setting.wavelength_nm)
    angle = math.radians(field_degrees)
    spread = math.tan(angle) if projection == "tan" else angle
    if math.isinf(setting.object_distance_mm):
        return first.front_focal_length_mm * spread
    # Newton: magnification f / x, x from the object plane to the front focal point
    to_focal_point = setting.object_distance_mm + first.front_focal_distance_mm
    return first.front_focal_length_mm / to_focal_point * setting.object_distance_mm * spread


def film_height(setting: Setting, field_degrees: float, wavelength_nm: float) -> float | None:
    """Return the film height of the chief ray [mm]; None when something blocks it."""
    _, rays = chief_ray(setting.lens, field_degrees, wavelength_nm, setting.object_distance_mm)
    if not rays.passed[0]:
        return None
    return float(at_plane(rays.origins, rays.directions, setting.film_z)[0, 1])


def distortion_table(
    setting: Setting, fields: Sequence[float], wavelengths_nm: Sequence[float], projection: str
) -> list[Row]:
    """Return a row for each field and wavelength: height, ideal height, their difference, and lateral colour.

    Lateral colour is the height less that at the wavelength of the setting.
    """
    rows: list[Row] = []
    for degrees in fields:
        ideal = ideal_height(setting, degrees, projection)
        main = film_height(setting, degrees, setting.wavelength_nm)
        for wavelength in wavelengths_nm:
            height = film_height(setting, degrees, wavelength)
            off = None if height is None else height - ideal
            rows.append(
                {
                    "field_degrees": degrees,
                    "wavelength_nm": wavelength,
                    "height_mm": height,
                    "ideal_mm": ideal,
                    "distortion_mm": off,
                    "distortion_percent": None if off is None or not ideal else 100 * off / ideal,
                    "lateral_colour_um": None if height is None or main is None else 1e3 * (height - main),
                }
            )
    return rows


def distortion_picture(setting: Setting, rows: Sequence[Row], projection: str) -> Picture:
    """Return distortion over the field, a curve for each wavelength."""
    waves = list(dict.fromkeys(row["wavelength_nm"] or 0.0 for row in rows))
    colours = [wavelength_colour(wave) if len(waves) > 1 else SERIES[0] for wave in waves]
    fields = [row["field_degrees"] or 0.0 for row in rows]
    values = [np.nan if row["distortion_percent"] is None else row["distortion_percent"] for row in rows]
    widest = max(*fields, 1e-3) if len(fields) > 1 else max(fields[0], 1e-3)
    meant = "f tan(angle)" if projection == "tan" else "f angle"
    axes = chart(
        f"{setting.lens.name}: distortion against {meant}",
        ("angle from the axis [degrees]", "distortion [%]"),
        (min(*fields, 0.0), widest),
        padded([*values, 0.0]),
        [Key(f"{wave:g} nm", colour) for wave, colour in zip(waves, colours, strict=True)],
    )
    for wave, colour in zip(waves, colours, strict=True):
        own = [i for i, row in enumerate(rows) if row["wavelength_nm"] == wave]
        axes.curve([fields[i] for i in own], [values[i] for i in own], colour)
    return axes.picture
