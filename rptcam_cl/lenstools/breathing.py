"""Breathing: how the field of view and the speed of a lens change as it focuses nearer, and as it zooms."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rptcam_cl.lenstools.charts import add_key, new_chart, series, styled
from rptcam_cl.optics import IDEAL, Lens, LensTransmission, on_axis_irradiance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, float | str | None]


def breathing_table(
    lenses: Sequence[tuple[str, Lens]],
    distances_m: Sequence[float],
    film_width_mm: float,
    wavelength_nm: float,
    transmission: LensTransmission = IDEAL,
) -> list[Row]:
    """Return a row for each position of a zoom lens and each distance from the object to the film.

    Each has the focal length and the film distance [mm], the field of view across the film [degrees] by chief rays of
    first-order optics, by how much more the film sees than at the first distance [% of the tangent], the magnification,
    and the f-number and T-number that light the film's centre as much: E = pi / (4 T^2), without losses and with them.

    Raises
    ------
    InputError
        When the lens does not reach a distance, or has no one focal length.
    """
    from rptcam_cl.cameras import focused, thick_lens_of  # takes long to import, and other commands need none of it

    rows: list[Row] = []
    for name, lens in lenses:
        first: float | None = None
        for distance in distances_m:
            state, back_mm = focused(lens, 1000 * distance, "film", "thick", wavelength_nm)
            thick = thick_lens_of(state, back_mm, wavelength_nm)
            tangent = film_width_mm / 2 * abs(thick.slope[0])
            first = tangent if first is None else first
            ahead = 1000 * distance - state.film_z(back_mm)  # of the first vertex
            speeds = (_f_number(state, back_mm, wavelength_nm, losses) for losses in (IDEAL, transmission))
            row: Row = {
                "zoom": name,
                "focus_distance_m": distance if math.isfinite(distance) else None,
                "focal_length_mm": state.first_order(wavelength_nm).focal_length_mm,
                "film_distance_mm": back_mm,
                "field_of_view_degrees": 2 * math.degrees(math.atan(tangent)),
                "breathing_percent": 100 * (tangent / first - 1),
                "magnification": 1 / abs(thick.height[0] + ahead * thick.slope[0]) if math.isfinite(ahead) else 0.0,
            }
            rows.append(row | dict(zip(("working_f_number", "t_number"), speeds, strict=True)))
    return rows


def _f_number(lens: Lens, back_mm: float, wavelength_nm: float, losses: LensTransmission) -> float:
    return math.sqrt(math.pi / (4 * on_axis_irradiance(lens, back_mm, wavelength_nm, losses)))


def breathing_csv(rows: Sequence[Row]) -> str:
    """Return the rows as comma-separated values with a head; infinity is an empty cell."""
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


@styled()
def breathing_chart(title: str, rows: Sequence[Row]) -> Figure:
    """Return the breathing of each zoom position over the magnification."""
    largest = max(_number(row["magnification"]) for row in rows)
    labels = ("magnification", "wider field of view than at the first distance [%]")
    figure, axes = new_chart(f"{title}: breathing", labels, (0.0, largest * 1.02 or 1.0))
    for k, name in enumerate(dict.fromkeys(row["zoom"] for row in rows)):
        own = [row for row in rows if row["zoom"] == name]
        x, y = ([_number(row[key]) for row in own] for key in ("magnification", "breathing_percent"))
        axes.plot(x, y, "o-", color=series(k), label=str(name))
    add_key(figure, axes.lines)
    return figure


def _number(value: float | str | None) -> float:
    assert isinstance(value, int | float)
    return float(value)
