"""Aberrations of a beam as curves: its ray fans, where its sections are sharp, and its spot through focus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.charts import add_key, new_chart, series, styled
from rptcam_cl.lenstools.colours import INK
from rptcam_cl.lenstools.fields import at_plane, default_fields
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.lenstools.spots import MOST_ACROSS, NOTHING, STAYS
from rptcam_cl.optics import Beam, Rays, chief_ray, passing_beam, unobstructed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rptcam_cl.optics import Lens

Array = NDArray[np.float64]
Row = dict[str, Any]

NEAR = 1e-5  # of the size of the first surface: how far from the chief ray the rays lie that say where it is sharp
ACROSS = 64  # rays across a beam whose width, or middle, is sought
FEWEST = 32  # of a spot, at first


def _through(setting: Setting, lens: Lens, degrees: float, wavelength_nm: float, points: Array) -> Rays:
    origins, directions = Beam(degrees, setting.object_distance_mm).rays(points)
    return lens.trace(origins, directions, wavelength_nm, "scene")


def fan_rows(setting: Setting, fields: Sequence[float], wavelengths_nm: Sequence[float], rays: int) -> list[Row]:
    """Return where the rays of the tangential and the sagittal fan of each field land beside its chief ray [um].

    `pupil` goes from -1 to 1 over what passes in the plane of the first vertex, along y and along x; at 0 is the chief
    ray of the setting's wavelength, or, where none of the field reaches the middle of the stop, the ray through the
    middle of what passes. What does not pass has no row.
    """
    rows: list[Row] = []
    for degrees in fields:
        beam, main = Beam(degrees, setting.object_distance_mm), setting.wavelength_nm
        points, _, _ = passing_beam(setting.lens, beam, main, ACROSS)
        try:
            height, chief = chief_ray(setting.lens, degrees, main, setting.object_distance_mm)
        except InputError:
            height = float(points[:, 1].mean())
            chief = _through(setting, unobstructed(setting.lens), degrees, main, np.array([[0.0, height]]))
        middle = at_plane(chief.origins, chief.directions, setting.film_z)[0, :2]
        for axis in (1, 0):
            start = np.array([0.0, height])
            reach = float(np.abs(points[:, axis] - start[axis]).max())
            steps = np.linspace(-1.0, 1.0, rays)
            line = np.tile(start, (rays, 1))
            line[:, axis] += steps * reach
            for wavelength in wavelengths_nm:
                traced = _through(setting, setting.lens, degrees, wavelength, line)
                off = (at_plane(traced.origins, traced.directions, setting.film_z)[:, :2] - middle) * 1e3
                rows += [
                    {"field_degrees": degrees, "wavelength_nm": wavelength, "tangential": float(axis == 1),
                     "pupil": float(steps[k]), "off_um": float(off[k, axis])}
                    for k in np.flatnonzero(traced.passed)
                ]  # fmt: skip
    return rows


def curvature_rows(setting: Setting, fields: Sequence[float], wavelengths_nm: Sequence[float]) -> list[Row]:
    """Return where thin pencils about the chief ray are sharp, along the axis from the film [mm], as Coddington has it.

    By rays close beside the chief ray on both sides, through obstructions in the middle of the lens. Positive: behind
    the film. None where rims stop them, or no ray of the field reaches the middle of the stop.

    Raises
    ------
    InputError
        When no ray of any field reaches the stop.
    """
    refused: InputError | None = None
    step = NEAR * min(setting.lens.surfaces[0].semi_diameter, 1e3)
    rows: list[Row] = []
    for degrees in fields:
        for wavelength in wavelengths_nm:
            try:
                height, _ = chief_ray(setting.lens, degrees, wavelength, setting.object_distance_mm)
            except InputError as problem:  # what passes goes nowhere near the middle of the stop
                refused, height = problem, math.nan
            beside = np.array([0.0, height]) + step * np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [-1.0, 0.0]])
            traced = _through(setting, unobstructed(setting.lens), degrees, wavelength, beside)
            at = at_plane(traced.origins, traced.directions, setting.film_z)
            slopes = setting.lens.sense * traced.directions[:, :2] / traced.directions[:, 2:]
            off = [
                float(-(at[a, k] - at[b, k]) / (slopes[a, k] - slopes[b, k])) if traced.passed[[a, b]].all() else None
                for a, b, k in ((0, 1, 1), (2, 3, 0))
            ]
            rows.append(
                {"field_degrees": degrees, "wavelength_nm": wavelength, "tangential_mm": off[0], "sagittal_mm": off[1],
                 "astigmatism_mm": None if None in off else off[0] - off[1]}  # type: ignore[operator]
            )  # fmt: skip
    if refused is not None and all(row["tangential_mm"] is row["sagittal_mm"] is None for row in rows):
        raise refused
    return rows


def focus_rows(
    setting: Setting, fields: Sequence[float], wavelengths_nm: Sequence[float], shifts_mm: Array, across: int | None
) -> list[Row]:
    """Return the rms spot of each field, its wavelengths together, over shifts of the film away from the lens.

    By default as many rays as its least and its largest spot need.
    """
    rows: list[Row] = []
    for degrees in fields:
        count = across or FEWEST
        before, sides = None, _through_focus(setting, degrees, wavelengths_nm, shifts_mm, count)
        while (
            across is None
            and count < MOST_ACROSS
            and (before is None or np.max(np.abs(before - sides) / (STAYS * np.hypot(*sides) + NOTHING)) > 1)
        ):
            count *= 2
            before, sides = sides, _through_focus(setting, degrees, wavelengths_nm, shifts_mm, count)
        rows += [
            {"field_degrees": degrees, "shift_mm": shift, "rms_um": math.hypot(x, y), "rms_x_um": x, "rms_y_um": y}
            for shift, x, y in zip(shifts_mm.tolist(), *(1e3 * sides).tolist(), strict=True)
        ]
    return rows


def _through_focus(
    setting: Setting, degrees: float, wavelengths_nm: Sequence[float], shifts_mm: Array, across: int
) -> Array:
    """Return the rms of a spot in x and in y (2, shifts) over shifts of the film [mm]."""
    beam = Beam(degrees, setting.object_distance_mm)
    passed = [passing_beam(setting.lens, beam, wavelength, across)[1] for wavelength in wavelengths_nm]
    origins, directions = (
        np.concatenate([getattr(rays, name) for rays in passed]) for name in ("origins", "directions")
    )
    moved = (replace(setting, film_distance_mm=setting.film + shift).film_z for shift in shifts_mm.tolist())
    return np.stack([np.std(at_plane(origins, directions, z)[:, :2], axis=0) for z in moved], axis=1)


@styled()
def curves_over(
    title: str, rows: Sequence[Row], across: tuple[str, str], up: Sequence[tuple[str, str]], unit: str, by: str
) -> Figure:
    """Return curves of columns (name, label) over another, in a colour for each value of a third."""
    values = [row[across[0]] for row in rows]
    figure, axes = new_chart(title, (across[1], unit), (min(values), max(values)))
    axes.axhline(0.0, color=INK, linewidth=0.8)
    for number, kind in enumerate(dict.fromkeys(row[by] for row in rows)):
        own = [row for row in rows if row[by] == kind]
        for line, (name, label) in zip(("-", "--"), up, strict=False):
            shown = [np.nan if row[name] is None else row[name] for row in own]
            said = f"{kind:g} {label}"
            axes.plot([row[across[0]] for row in own], shown, line, color=series(number), label=said)
    add_key(figure, axes.lines[1:])
    return figure


def fields_of(setting: Setting, fields: Sequence[float] | None, shares: Sequence[float]) -> list[float]:
    """Return the fields given, or shares of the widest [degrees]."""
    return default_fields(setting, shares) if fields is None else list(fields)
