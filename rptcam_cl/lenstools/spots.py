"""Spots: where the rays of beams from fields and wavelengths meet the film."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.charts import SIZE, add_key, new_figure, styled
from rptcam_cl.lenstools.colours import wavelength_colour
from rptcam_cl.lenstools.fields import at_plane, default_fields
from rptcam_cl.lenstools.lens_state import Setting
from rptcam_cl.optics import Beam, best_film_distance, passing_beam

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

ACROSS, MOST_ACROSS = 64, 1024  # rays that span a beam each way: at first, and at most
STAYS = 0.005  # share of a figure by which twice as many rays across may change it
SMALL_PART = 0.05  # of a spot's rms, below which that across or down counts by as much
NOTHING = 1e-9  # [mm], of no account
FACTS = ("centroid_x_mm", "centroid_y_mm", "rms_um", "rms_x_um", "rms_y_um", "largest_um")
PANELS = 3  # side by side
PANEL, REST = 2.9, 0.9  # height of a row of panels, and of title and key [inches]
MOST_DOTS = 700  # of each colour in a panel
FILL = 0.45  # half width of the largest spot, in widths of a panel


@dataclass(frozen=True)
class FilmSpot:
    """The rays of one field and wavelength on the film.

    Attributes
    ----------
    field_degrees, wavelength_nm : float
    points : (n, 2) array
        Where they meet the film, x and y [mm]; none when nothing of the beam passes.
    cone : (x, y)
        Half widths of the cone of light on the film, in x and y: numerical apertures.
    fewer : (m, 2) array or None
        The points by half as many rays across.
    """

    field_degrees: float
    wavelength_nm: float
    points: Array
    cone: tuple[float, float] = (0.0, 0.0)
    fewer: Array | None = None


Moves = Callable[[Sequence[FilmSpot], Sequence[FilmSpot]], float]


def film_spots(
    setting: Setting,
    fields: Sequence[float] | None,
    wavelengths_nm: Sequence[float],
    across: int | None = None,
    moves: Moves | None = None,
) -> list[FilmSpot]:
    """Return the spots of each field and wavelength, traced in float64.

    Parameters
    ----------
    setting : Setting
    fields : sequence of float, optional
        Angles from the axis [degrees]; the axis and two more when absent.
    wavelengths_nm : sequence of float
    across : int, optional
        Rays that span the beam each way; in each field twice as many, and again, till figures stay, when absent.
    moves : function, optional
        Of the spots of a field by few rays and by more: how far its figures move, in units of what they may. Those of
        `spots_move` when absent.

    Raises
    ------
    InputError
        When nothing of any beam passes; of one among others the spot is empty.
    """
    refused: InputError | None = None

    def traced(degrees: float, across: int) -> list[FilmSpot]:
        nonlocal refused
        spots = []
        for wavelength in wavelengths_nm:
            try:
                _, rays, _ = passing_beam(setting.lens, Beam(degrees, setting.object_distance_mm), wavelength, across)
            except InputError as problem:
                spots.append(FilmSpot(degrees, wavelength, np.zeros((0, 2))))
                refused = problem
                continue
            points = at_plane(rays.origins, rays.directions, setting.film_z)[:, :2]
            spots.append(FilmSpot(degrees, wavelength, points, _cone(setting, wavelength, rays.directions)))
        return spots

    found: list[FilmSpot] = []
    for degrees in default_fields(setting) if fields is None else fields:
        count = across or ACROSS
        few, many = traced(degrees, max(count // 2, 1)), traced(degrees, count)
        while across is None and count < MOST_ACROSS and (moves or spots_move)(few, many) > 1:
            count *= 2
            few, many = many, traced(degrees, count)
        found += [replace(more, fewer=less.points) for less, more in zip(few, many, strict=True)]
    if refused is not None and not any(len(spot.points) for spot in found):
        raise refused
    return found


def spots_move(few: Sequence[FilmSpot], many: Sequence[FilmSpot]) -> float:
    """Return how far the rms of spots moves with more rays, in units of what it may: of the whole, across and down."""
    return max((_rms_moves(less.points, more.points) for less, more in zip(few, many, strict=True)), default=0.0)


def _rms_moves(few: Array, many: Array) -> float:
    if not len(many) or not len(few):
        return 0.0 if len(many) == len(few) else math.inf
    one, other = np.std(few, axis=0), np.std(many, axis=0)
    return float(np.max(np.abs(one - other) / (STAYS * np.maximum(other, SMALL_PART * np.hypot(*other)) + NOTHING)))


def fewer(group: Sequence[FilmSpot]) -> list[FilmSpot]:
    """Return the spots of a field by half as many rays across, which show how exact they are."""
    return [replace(spot, points=spot.fewer) for spot in group if spot.fewer is not None]


def _cone(setting: Setting, wavelength_nm: float, directions: Array) -> tuple[float, float]:
    """Return the numerical apertures in x and y of the ellipse with the second moments of a bundle's directions.

    Twice the standard deviation is the half axis of an ellipse that is evenly filled.
    """
    x, y = 2.0 * float(setting.lens.indices(wavelength_nm)[-1]) * np.std(directions[:, :2], axis=0)
    return float(x), float(y)


def at_best_focus(setting: Setting, wavelengths_nm: Sequence[float], field_degrees: float = 0.0) -> Setting:
    """Return the setting with its film where the spot of a field is least: on the axis of all wavelengths together."""
    _ = setting.film
    distance = best_film_distance(setting.lens, setting.object_distance_mm, "front", wavelengths_nm, field_degrees)
    return replace(setting, film_distance_mm=distance)


def by_field(spots: Sequence[FilmSpot]) -> dict[float, list[FilmSpot]]:
    """Return the spots of each field, in order."""
    groups: dict[float, list[FilmSpot]] = {}
    for spot in spots:
        groups.setdefault(spot.field_degrees, []).append(spot)
    return groups


def spot_facts(points: Array) -> dict[str, Any]:
    """Return centroid [mm], and rms and largest distance from it [micrometres], of points (n, 2); None without any."""
    if not len(points):
        return {"rays": 0} | dict.fromkeys(FACTS)
    centroid = points.mean(axis=0)
    off = (points - centroid) * 1e3
    rms_x, rms_y = np.sqrt(np.mean(off * off, axis=0))
    return {
        "rays": len(points),
        "centroid_x_mm": float(centroid[0]),
        "centroid_y_mm": float(centroid[1]),
        "rms_um": float(np.hypot(rms_x, rms_y)),
        "rms_x_um": float(rms_x),
        "rms_y_um": float(rms_y),
        "largest_um": float(np.hypot(off[:, 0], off[:, 1]).max()),
    }


def spot_table(spots: Sequence[FilmSpot]) -> list[dict[str, Any]]:
    """Return a row for each spot, and for each field of several wavelengths one of all together (wavelength None).

    ``rms_error_um`` and ``largest_error_um`` are what half as many rays across change.
    """
    rows: list[dict[str, Any]] = []
    for degrees, group in by_field(spots).items():
        for spot in group:
            rows.append(_row(degrees, spot.wavelength_nm, [spot]))
        if len(group) > 1:
            rows.append(_row(degrees, None, group))
    return rows


def _row(degrees: float, wavelength_nm: float | None, group: Sequence[FilmSpot]) -> dict[str, Any]:
    facts, errors = spot_facts(np.concatenate([spot.points for spot in group])), {}
    less = fewer(group)
    before = spot_facts(np.concatenate([spot.points for spot in less])) if less else facts
    for name in ("rms", "largest"):
        value, other = facts[f"{name}_um"], before[f"{name}_um"]
        errors[f"{name}_error_um"] = None if value is None or other is None or not less else abs(value - other)
    return {"field_degrees": degrees, "wavelength_nm": wavelength_nm, **facts, **errors}


@styled()
def spot_chart(setting: Setting, spots: Sequence[FilmSpot]) -> Figure:
    """Return the spot diagrams of all fields side by side, to the same scale, about their centroids."""
    from matplotlib.lines import Line2D

    spots = [spot for spot in spots if len(spot.points)]
    groups = by_field(spots)
    rows = math.ceil(len(groups) / PANELS)
    columns = min(len(groups), PANELS)
    figure = new_figure(f"{setting.lens.name}: spots on the film", (SIZE[0], rows * PANEL + REST))
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    centres = {field: np.concatenate([spot.points for spot in group]).mean(axis=0) for field, group in groups.items()}
    reach = max(float(np.abs(spot.points - centres[spot.field_degrees]).max()) for spot in spots) * 1e3
    half = max(reach * 0.5 / FILL, 1e-6)
    for axes, (degrees, group) in zip(panels.flat, groups.items(), strict=False):
        rms = spot_facts(np.concatenate([spot.points for spot in group]))["rms_um"]
        axes.set_title(f"{degrees:g}°, y = {round(centres[degrees][1], 4) + 0.0:g} mm\nrms {rms:.3g} µm")
        axes.set(xlabel="x [µm]", xlim=(-half, half), ylim=(-half, half), aspect="equal")
        for spot in group:
            shown = np.random.default_rng(0).permutation(len(spot.points))[:MOST_DOTS]
            off = (spot.points[shown] - centres[degrees]) * 1e3
            axes.plot(*off.T, "o", color=wavelength_colour(spot.wavelength_nm), markersize=1.3, markeredgewidth=0,
                      rasterized=True)  # fmt: skip
    for axes in panels[:, 0]:
        axes.set_ylabel("y [µm]")
    for axes in panels.flat[len(groups) :]:
        axes.set_visible(False)
    waves = dict.fromkeys(spot.wavelength_nm for spot in spots)
    add_key(figure, [Line2D([], [], color=wavelength_colour(wave), linestyle="", marker="o", label=f"{wave:g} nm")
                     for wave in waves])  # fmt: skip
    return figure
