"""Where chief rays meet the film, against an ideal projection: distortion, and between wavelengths lateral colour."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.charts import add_key, new_chart, series, styled
from rptcam_cl.lenstools.colours import INK, wavelength_colour
from rptcam_cl.lenstools.fields import at_plane
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.optics import Beam, chief_ray, passing_beam

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, float | None]

# Film height per focal length at an angle, and in words (Kingslake, A History of the Photographic Lens; ISO 17850).
PROJECTIONS: dict[str, tuple[Callable[[float], float], str]] = {
    "tan": (math.tan, "f tan(angle)"),
    "theta": (lambda angle: angle, "f angle"),
    "stereographic": (lambda angle: 2 * math.tan(angle / 2), "2 f tan(angle / 2)"),
    "equisolid": (lambda angle: 2 * math.sin(angle / 2), "2 f sin(angle / 2)"),
    "orthographic": (math.sin, "f sin(angle)"),
}
NARROW = 30.0  # degrees up to which all projections are alike, and f tan(angle) is what is meant
RECTILINEAR = 0.1  # largest distortion of a lens that counts as keeping lines straight, as a share of the height
ACROSS = 48  # rays across a beam whose middle is sought
BARREL = 90.0  # degrees at which f tan(angle) has no height


def followed_projection(setting: Setting, fields: Sequence[float]) -> str:
    """Return the projection that a lens follows best over fields [degrees], by its chief rays.

    "tan" for narrow fields, and for lenses that keep lines straight within a tenth of the height: they are meant to.
    """
    widest = max(map(abs, fields))
    if widest <= NARROW:
        return "tan"
    heights = {degrees: film_height(setting, degrees, setting.wavelength_nm) for degrees in fields if degrees}
    seen = {degrees: height for degrees, height in heights.items() if height is not None}
    if not seen or max(map(abs, seen)) <= NARROW:
        return "tan"
    off = {}
    for name in PROJECTIONS:
        ideals = {degrees: ideal_height(setting, degrees, name) for degrees in seen}
        errors = [
            math.inf if (ideal := ideals[degrees]) is None else abs(height / ideal - 1)
            for degrees, height in seen.items()
        ]
        off[name] = max(errors)
    return "tan" if off["tan"] <= RECTILINEAR else min(off, key=lambda name: off[name])


def ideal_height(setting: Setting, field_degrees: float, projection: str) -> float | None:
    """Return the film height [mm] that a projection gives a field, by the lens's focal length and magnification.

    None where it gives none: f tan(angle) from 90 degrees on, f sin(angle) beyond.
    """
    if projection not in PROJECTIONS:
        raise InputError(f"projection must be one of {', '.join(PROJECTIONS)} (got {projection!r})")
    first = setting.lens.first_order(setting.wavelength_nm)
    angle = math.radians(field_degrees)
    if (projection == "tan" and abs(field_degrees) >= BARREL) or (
        projection == "orthographic" and abs(field_degrees) > BARREL
    ):
        return None
    spread = PROJECTIONS[projection][0](angle)
    if math.isinf(setting.object_distance_mm):
        return first.front_focal_length_mm * spread
    # Newton: magnification f / x, x from the object plane to the front focal point
    to_focal_point = setting.object_distance_mm + first.front_focal_distance_mm
    return first.front_focal_length_mm / to_focal_point * setting.object_distance_mm * spread


def film_height(setting: Setting, field_degrees: float, wavelength_nm: float) -> float | None:
    """Return the film height of the chief ray [mm]; None when something blocks it.

    Where no ray of the field reaches the centre of the stop, as at the edge of a fisheye's field, that of the middle of
    what passes.
    """
    try:
        _, rays = chief_ray(setting.lens, field_degrees, wavelength_nm, setting.object_distance_mm)
    except InputError:
        return _beam_height(setting, field_degrees, wavelength_nm)
    if not rays.passed[0]:
        return None
    return float(at_plane(rays.origins, rays.directions, setting.film_z)[0, 1])


def _beam_height(setting: Setting, field_degrees: float, wavelength_nm: float) -> float | None:
    try:
        _, rays, _ = passing_beam(setting.lens, Beam(field_degrees, setting.object_distance_mm), wavelength_nm, ACROSS)
    except InputError:
        return None
    return float(at_plane(rays.origins, rays.directions, setting.film_z)[:, 1].mean())


def distortion_table(
    setting: Setting, fields: Sequence[float], wavelengths_nm: Sequence[float], projection: str
) -> list[Row]:
    """Return a row for each field and wavelength: height, ideal height, their difference, and lateral colour.

    Lateral colour is the height less that at the wavelength of the setting. A field that nothing reaches has None.

    Raises
    ------
    InputError
        When no ray of any field reaches the stop.
    """
    rows: list[Row] = []
    for degrees in fields:
        ideal = ideal_height(setting, degrees, projection)
        main = film_height(setting, degrees, setting.wavelength_nm)
        for wavelength in wavelengths_nm:
            height = film_height(setting, degrees, wavelength)
            off = None if height is None or ideal is None else height - ideal
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
    if fields and all(row["height_mm"] is None for row in rows):  # then say why
        chief_ray(setting.lens, fields[0], setting.wavelength_nm, setting.object_distance_mm)
    return rows


@styled()
def distortion_chart(setting: Setting, rows: Sequence[Row], projection: str) -> Figure:
    """Return distortion over the field, a curve for each wavelength."""
    fields = [row["field_degrees"] or 0.0 for row in rows]
    title = f"{setting.lens.name}: distortion against {PROJECTIONS[projection][1]}"
    labels = ("angle from the axis [degrees]", "distortion [%]")
    figure, axes = new_chart(title, labels, (min(*fields, 0.0), max(*fields, 1e-3)))
    axes.axhline(0.0, color=INK, linewidth=0.8)
    waves = dict.fromkeys(row["wavelength_nm"] or 0.0 for row in rows)
    curves = []
    for wave in waves:
        own = [row for row in rows if row["wavelength_nm"] == wave]
        curves += axes.plot(
            [row["field_degrees"] or 0.0 for row in own],
            [np.nan if row["distortion_percent"] is None else row["distortion_percent"] for row in own],
            marker=".",
            color=wavelength_colour(wave) if len(waves) > 1 else series(0),
            label=f"{wave:g} nm",
        )
    add_key(figure, curves)
    return figure
