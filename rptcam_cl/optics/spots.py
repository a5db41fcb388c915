"""Images of points in a lens in use: spots, modulation transfer, point spread and wavefront."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import charts
from rptcam_cl.optics import waves as wave_optics
from rptcam_cl.optics.beams import Beam, passing_beam, spot_of
from rptcam_cl.optics.best_focus import best_film_distance
from rptcam_cl.optics.lens import brought_to_focus
from rptcam_cl.optics.ray_trace import at_plane
from rptcam_cl.optics.waves import THIRDS_OVER_ALL, PointImage, PupilFunction

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from rptcam_cl.optics.lens import Lens


# A lens as it stands on a camera: stopped down, zoomed, focused, with its film.


@dataclass(frozen=True)
class Setting:
    """A lens in use.

    Attributes
    ----------
    lens : Lens
        At its working aperture and focal length.
    film_distance_mm : float or None
        Last vertex to film; None when the lens forms no real image.
    object_distance_mm : float
        Object plane to first vertex; infinite for a distant object.
    wavelength_nm : float
        For which it is focused.
    """

    lens: Lens
    film_distance_mm: float | None
    object_distance_mm: float = math.inf
    wavelength_nm: float = LINE_D_NM

    @property
    def film(self) -> float:
        """Last vertex to film [mm]; an error without a real image."""
        if self.film_distance_mm is None:
            raise InputError(f"{self.lens.name}: forms no real image of a distant object, so there is no film")
        return self.film_distance_mm

    @property
    def film_z(self) -> float:
        """Film plane in the frame of the lens [mm]."""
        return self.lens.film_z(self.film)


def setting(
    lens: Lens,
    f_number: float | None = None,
    focus_distance_m: float | None = None,
    wavelength_nm: float = LINE_D_NM,
) -> Setting:
    """Return a lens in use.

    Parameters
    ----------
    lens : Lens
        Zoomed already.
    f_number : float, optional
        To stop down to; as wide as the file has it when absent.
    focus_distance_m : float, optional
        Object plane to film [m]; infinity when absent.
    wavelength_nm : float
    """
    if f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(f_number, wavelength_nm))
    if focus_distance_m is not None:
        lens, film = brought_to_focus(lens, 1000 * focus_distance_m, wavelength_nm)
        return Setting(lens, film, 1000 * focus_distance_m - lens.sense * film - lens.length, wavelength_nm)
    first = lens.first_order(wavelength_nm)
    real = 0 < first.focal_length_mm < math.inf and first.back_focal_distance_mm > 0
    return Setting(lens, first.back_focal_distance_mm if real else None, math.inf, wavelength_nm)


def result_of(
    setting: Setting,
    what: str,
    rows: list[dict[str, Any]],
    chart: Callable[[], Figure] | None,
    caption: str | None = None,
    **about: Any,
) -> charts.Measured:
    """Return a result about a lens in use, with where film and object stand."""
    name, film = setting.lens.name, setting.film_distance_mm
    about |= {"film_distance_mm": film, "object_distance_mm": setting.object_distance_mm}
    caption = f"{name}, film at {film:.6g} mm" if caption is None else caption
    return charts.Measured(f"{name}: {what}", rows, chart, about, caption)


# Fields of view worth looking at, and fans of rays across a beam.

Array = NDArray[np.float64]

SHARES = (0.0, 0.7, 1.0)
_LEFT_OPEN = 0.5  # share of the axial fan that the widest field keeps
_LARGEST_SPOT = 0.02  # rms of its fan on the film, in focal lengths, unless that on the axis is larger
STEEPEST = 85.0  # degrees
FAN = 401


def widest_field(setting: Setting, section: str = "y") -> float:
    """Return the largest field [degrees] at which the lens still draws a picture.

    Half of the meridional fan of the axis passes, and what passes stays together on the film.
    """
    if _measure_fan(setting, 0.0, section)[0] == 0:
        raise InputError(f"{setting.lens.name}: the ray on the axis does not come through")
    focal_length_mm = setting.lens.first_order(setting.wavelength_nm, section).focal_length_mm
    return widest_by(lambda degrees: _measure_fan(setting, degrees, section), focal_length_mm, 12)


def widest_by(
    see: Callable[[float], tuple[float, float]], focal_length_mm: float, rounds: int, steepest: float = STEEPEST
) -> float:
    """Return the largest field [degrees] that keeps half of the beam on the axis, and it together on the film.

    Parameters
    ----------
    see
        Returns how much of a field passes, and its rms on the film [mm].
    rounds
        By which the interval up to the steepest field is halved.
    """
    low, high, (axis, blur) = 0.0, steepest, see(0.0)
    largest = max(_LARGEST_SPOT * abs(focal_length_mm), 2 * blur)
    for _ in range(rounds):
        middle = (low + high) / 2
        width, spread = see(middle)
        low, high = (middle, high) if width >= _LEFT_OPEN * axis and spread <= largest else (low, middle)
    return low


def default_fields(setting: Setting, shares: Sequence[float] = SHARES, section: str = "y") -> list[float]:
    """Return the axis and parts of the widest field [degrees], rounded to be read."""
    return parts_of_field(widest_field(setting, section), shares)


def parts_of_field(widest: float, shares: Sequence[float] = SHARES) -> list[float]:
    """Return parts of a widest field [degrees], rounded to be read."""
    digits = 1 - math.floor(math.log10(widest)) if widest > 0 else 0
    return [round(share * widest, max(digits, 0)) for share in shares]


def fan_points(setting: Setting, field_degrees: float, section: str) -> Array:
    """Return points (`FAN`, 2) of the plane of the first vertex, in a line along the section, over the first surface.

    Their rays are all those of the beam that meet the first surface inside its rim, and a few more.
    """
    first = setting.lens.surfaces[0]
    if not np.isfinite(first.semi_diameter):
        raise InputError(f"{setting.lens.name}: the first surface needs a diameter")
    heights = np.linspace(-first.semi_diameter, first.semi_diameter, 65)
    zero = np.zeros_like(heights)
    sag = first.sag(zero, heights) if section == "y" else first.sag(heights, zero)
    source = -math.tan(math.radians(field_degrees)) * setting.object_distance_mm
    slope = (
        math.tan(math.radians(field_degrees))
        if math.isinf(setting.object_distance_mm)
        else (heights - source) / setting.object_distance_mm
    )
    at_vertex = heights - np.nan_to_num(sag) * slope
    line = np.linspace(at_vertex.min(), at_vertex.max(), FAN)
    return line[:, None] * ([0.0, 1.0] if section == "y" else [1.0, 0.0])


def section_rays(setting: Setting, field_degrees: float, points: Array, section: str) -> tuple[Array, Array]:
    """Return origins and directions (n, 3) of the rays of a beam through points of the plane of the first vertex.

    The beam is tilted in the section: light of a positive field travels towards +y, or +x.
    """
    beam = Beam(field_degrees, setting.object_distance_mm)
    origins, directions = beam.rays(points if section == "y" else points[:, ::-1])
    if section == "x":
        return origins[:, [1, 0, 2]], directions[:, [1, 0, 2]]
    return origins, directions


def _measure_fan(setting: Setting, field_degrees: float, section: str) -> tuple[float, float]:
    """Return the width across the beam of its meridional fan that passes, and the rms of that fan on the film [mm].

    The rms is 0 without a film, or when less than two rays pass.
    """
    points = fan_points(setting, field_degrees, section)
    origins, directions = section_rays(setting, field_degrees, points, section)
    rays = setting.lens.trace(origins, directions, setting.wavelength_nm, "scene")
    good = rays.passed
    width = float(good.sum()) * float(np.abs(points[1] - points[0]).sum()) * math.cos(math.radians(field_degrees))
    if setting.film_distance_mm is None or good.sum() < 2:
        return width, 0.0
    return width, float(
        np.std(at_plane(rays.origins[good], rays.directions[good], setting.film_z)[:, :2], axis=0).max()
    )


# Spots: where the rays of beams from fields and wavelengths meet the film.

ACROSS, MOST_ACROSS = 64, 1024  # rays that span a beam each way: at first, and at most
STAYS = 0.005  # share of a figure by which twice as many rays across may change it
_SMALL_PART = 0.05  # of a spot's rms, below which that across or down counts by as much
NOTHING = 1e-9  # [mm], of no account
FACTS = ("centroid_x_mm", "centroid_y_mm", "rms_um", "rms_x_um", "rms_y_um", "largest_um")
_PANELS = 3  # side by side
PANEL, TITLE, TITLE_AND_KEY = 2.9, 0.6, 0.9  # heights: of a row of panels, and of what stands beside them [inches]
_MOST_DOTS = 700  # of each colour in a panel
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


OfField = TypeVar("OfField", "FilmSpot", "PupilFunction")
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

    of_fields: list[FilmSpot] = []
    for degrees in default_fields(setting) if fields is None else fields:
        count = across or ACROSS
        few, many = traced(degrees, max(count // 2, 1)), traced(degrees, count)
        while across is None and count < MOST_ACROSS and (moves or spots_move)(few, many) > 1:
            count *= 2
            few, many = many, traced(degrees, count)
        of_fields += [replace(more, fewer=less.points) for less, more in zip(few, many, strict=True)]
    if refused is not None and not any(len(spot.points) for spot in of_fields):
        raise refused
    return of_fields


def pool(group: Sequence[FilmSpot]) -> Array:
    """Return the points (n, 2) of several spots together."""
    return np.concatenate([spot.points for spot in group])


def spots_move(few: Sequence[FilmSpot], many: Sequence[FilmSpot]) -> float:
    """Return how far the rms of spots moves with more rays, in units of what it may: of the whole, across and down."""
    return max((_rms_moves(less.points, more.points) for less, more in zip(few, many, strict=True)), default=0.0)


def _rms_moves(few: Array, many: Array) -> float:
    if not len(many) or not len(few):
        return 0.0 if len(many) == len(few) else math.inf
    one, other = np.std(few, axis=0), np.std(many, axis=0)
    return float(np.max(np.abs(one - other) / (STAYS * np.maximum(other, _SMALL_PART * np.hypot(*other)) + NOTHING)))


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


def _by_field(of_fields: Sequence[OfField]) -> dict[float, list[OfField]]:
    """Return the spots or wavefronts of each field, in order."""
    groups: dict[float, list[OfField]] = {}
    for one in of_fields:
        groups.setdefault(one.field_degrees, []).append(one)
    return groups


def spot_facts(points: Array) -> dict[str, Any]:
    """Return centroid [mm], and rms and largest distance from it [micrometres], of points (n, 2); None without any."""
    if not len(points):
        return {"rays": 0} | dict.fromkeys(FACTS)
    spot = spot_of(points)
    sizes = (1e3 * size for size in (spot.rms, spot.rms_x, spot.rms_y, spot.largest))
    return {"rays": spot.rays} | dict(zip(FACTS, (*spot.centroid, *sizes), strict=True))


def spot_table(spots: Sequence[FilmSpot]) -> list[dict[str, Any]]:
    """Return a row for each spot, and for each field of several wavelengths one of all together (wavelength None).

    ``rms_error_um`` and ``largest_error_um`` are what half as many rays across change, in the wavelength of the field
    that changes most: in one alone it may be nothing by chance.
    """
    rows: list[dict[str, Any]] = []
    for degrees, group in _by_field(spots).items():
        moves = np.max([_moves(spot) for spot in group], axis=0)
        for spot in group:
            rows.append(_row(degrees, spot.wavelength_nm, [spot], moves))
        if len(group) > 1:
            rows.append(_row(degrees, None, group, moves))
    return rows


def _moves(spot: FilmSpot) -> Array:
    """Return the shares of a spot's rms, whole or across or down, and of its largest distance that more rays change."""
    if spot.fewer is None or not len(spot.points):
        return np.zeros(2)
    facts, before = spot_facts(spot.points), spot_facts(spot.fewer)
    if not len(spot.fewer):
        return np.full(2, math.inf)
    rms = max(abs(facts[name] - before[name]) for name in ("rms_um", "rms_x_um", "rms_y_um"))
    off = [rms, abs(facts["largest_um"] - before["largest_um"])]
    return np.divide(off, [facts["rms_um"] or math.inf, facts["largest_um"] or math.inf])


def _row(degrees: float, wavelength_nm: float | None, group: Sequence[FilmSpot], moves: Array) -> dict[str, Any]:
    facts = spot_facts(pool(group))
    known = facts["rays"] and np.isfinite(moves).all() and all(spot.fewer is not None for spot in group)
    errors = {
        f"{name}_error_um": share * facts[f"{name}_um"] if known else None
        for name, share in zip(("rms", "largest"), moves.tolist(), strict=True)
    }
    return {"field_degrees": degrees, "wavelength_nm": wavelength_nm, **facts, **errors}


def _panels_of(title: str, count: int, rest: float, **shared: Any) -> tuple[Figure, NDArray[Any]]:
    """Return a figure of so many charts in rows, with room for the rest [inches], and the charts (rows, columns)."""
    rows = math.ceil(count / _PANELS)
    figure = charts.new_figure(title, (charts.SIZE[0], rows * PANEL + rest))
    panels = figure.subplots(rows, min(count, _PANELS), squeeze=False, **shared)
    for axes in panels.flat[count:]:
        axes.set_visible(False)
    return figure, panels


@charts.styled()
def spot_chart(setting: Setting, spots: Sequence[FilmSpot]) -> Figure:
    """Return the spot diagrams of all fields side by side, to the same scale, about their centroids."""
    from matplotlib.lines import Line2D

    spots = [spot for spot in spots if len(spot.points)]
    groups = _by_field(spots)
    figure, panels = _panels_of(
        f"{setting.lens.name}: spots on the film", len(groups), TITLE_AND_KEY, sharex=True, sharey=True
    )
    centres = {field: pool(group).mean(axis=0) for field, group in groups.items()}
    reach = max(float(np.abs(spot.points - centres[spot.field_degrees]).max()) for spot in spots) * 1e3
    half = max(reach * 0.5 / FILL, 1e-6)
    for axes, (degrees, group) in zip(panels.flat, groups.items(), strict=False):
        rms = spot_facts(pool(group))["rms_um"]
        axes.set_title(f"{degrees:g}°, y = {round(centres[degrees][1], 4) + 0.0:g} mm\nrms {rms:.3g} µm")
        axes.set(xlabel="x [µm]", xlim=(-half, half), ylim=(-half, half), aspect="equal")
        for spot in group:
            shown = np.random.default_rng(0).permutation(len(spot.points))[:_MOST_DOTS]
            off = (spot.points[shown] - centres[degrees]) * 1e3
            colour = charts.wavelength_colour(spot.wavelength_nm)
            axes.plot(*off.T, "o", color=colour, markersize=1.3, markeredgewidth=0, rasterized=True)
    for axes in panels[:, 0]:
        axes.set_ylabel("y [µm]")
    waves = dict.fromkeys(spot.wavelength_nm for spot in spots)
    colours = {wave: charts.wavelength_colour(wave) for wave in waves}
    dots = [Line2D([], [], color=colours[wave], linestyle="", marker="o", label=f"{wave:g} nm") for wave in waves]
    charts.add_key(figure, dots)
    return figure


def spot(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], rays: int | None
) -> charts.Measured:
    """Return the sizes of spots, and where rays land by field and wavelength."""
    spots = film_spots(setting, fields, wavelengths_nm, rays)
    points = {(one.field_degrees, one.wavelength_nm): one.points for one in spots}
    return result_of(setting, "spots", spot_table(spots), lambda: spot_chart(setting, spots), points=points)


#
# Modulation transfer: that of the spots times that of diffraction at the aperture that each field has.
#
# The geometrical transfer knows no diffraction and exceeds its limit where a lens is sharp. The transfer of a lens is
# that of its perfect pupil times a factor of its aberrations (Wetherell, The Calculation of Image Quality, 1980), for
# which the geometrical one stands here: right where aberrations are none or many waves, and never above the limit.

CURVE = 101
COLUMNS = ("tangential", "sagittal", "tangential_limit", "sagittal_limit")


def geometric_mtf(points: Array, frequencies_per_mm: ArrayLike) -> tuple[Array, Array]:
    """Return the modulation (tangential, sagittal) of light spread over points (n, 2) of the film [mm].

    Tangential lines lie along x, so that they blur in y; sagittal ones along y. Each is the length of the mean of
    exp(-2 pi i f y) over the rays, the Fourier transform of the spot.
    """
    waves = -2j * np.pi * np.asarray(frequencies_per_mm, dtype=np.float64)[:, None]
    off = points - points.mean(axis=0)
    tangential, sagittal = (np.abs(np.mean(np.exp(waves * off[:, axis]), axis=1)) for axis in (1, 0))
    return tangential, sagittal


def limits(group: Sequence[FilmSpot], frequencies_per_mm: ArrayLike) -> tuple[Array, Array]:
    """Return the modulation (tangential, sagittal) that diffraction leaves the spots of one field.

    The mean over the wavelengths by their rays. A pupil that is not round counts as the ellipse of its second moments.
    """
    rays = np.array([len(spot.points) for spot in group], dtype=np.float64)
    curves = [
        np.average(
            [wave_optics.diffraction_mtf(frequencies_per_mm, spot.cone[axis], spot.wavelength_nm) for spot in group],
            axis=0, weights=rays)
        for axis in (1, 0)
    ]  # fmt: skip
    return curves[0], curves[1]


def field_mtf(group: Sequence[FilmSpot], frequencies_per_mm: ArrayLike) -> list[Array] | None:
    """Return tangential and sagittal modulation and the limit of each, of one field; None when no light passes."""
    points = pool(group)
    if not len(points):
        return None
    most = limits(group, frequencies_per_mm)
    drawn = geometric_mtf(points, frequencies_per_mm)
    return [*(shape * limit for shape, limit in zip(drawn, most, strict=True)), *most]


def mtf_moves(frequencies_per_mm: Sequence[float]) -> Moves:
    """Return the function that says how far the modulation of a field moves with more rays, in units of what it may.

    Rays that lie farther apart on the film than half a period of the finest lines show nothing of these.
    """

    def moves(few: Sequence[FilmSpot], many: Sequence[FilmSpot]) -> float:
        for spot in few:
            if len(spot.points) and np.ptp(spot.points, axis=0).max() * max(frequencies_per_mm) > math.sqrt(
                len(spot.points)
            ):
                return math.inf
        one, other = (field_mtf(group, frequencies_per_mm) for group in (few, many))
        if one is None or other is None:
            return 0.0 if one is other else math.inf
        return float(max(np.abs(a - b).max() for a, b in zip(one[:2], other[:2], strict=True))) / STAYS

    return moves


def mtf_table(spots: Sequence[FilmSpot], frequencies_per_mm: Sequence[float]) -> list[dict[str, Any]]:
    """Return a row for each field and frequency, the wavelengths of a field together; None where no light passes.

    ``error`` is what half as many rays across change of either modulation.
    """
    groups = _by_field(spots)
    fields = {degrees: field_mtf(group, frequencies_per_mm) for degrees, group in groups.items()}
    rows = table_of(fields, frequencies_per_mm)
    before = table_of(
        {degrees: field_mtf(less, frequencies_per_mm) if (less := fewer(group)) else None
         for degrees, group in groups.items()},
        frequencies_per_mm,
    )  # fmt: skip
    for row, other in zip(rows, before, strict=True):
        known = row["tangential"] is not None and other["tangential"] is not None
        row["error"] = max(abs(row[name] - other[name]) for name in COLUMNS[:2]) if known else None
    return rows


def table_of(
    fields: Mapping[float, Sequence[Array] | None], frequencies_per_mm: Sequence[float]
) -> list[dict[str, Any]]:
    """Return a row for each field and frequency, of curves as `field_mtf` has them."""
    rows = []
    for degrees, curves in fields.items():
        for k, frequency in enumerate(frequencies_per_mm):
            values = [None] * len(COLUMNS) if curves is None else [float(curve[k]) for curve in curves]
            modulation = dict(zip(COLUMNS, values, strict=True))
            rows.append({"field_degrees": degrees, "frequency_per_mm": frequency, **modulation})
    return rows


@charts.styled()
def _mtf_chart(title: str, frequencies: Array, fields: Mapping[float, Sequence[Array] | None]) -> Figure:
    """Return a chart of curves as `field_mtf` has them: tangential full, sagittal dashed, the first limit dotted."""
    from matplotlib.lines import Line2D

    labels = ("frequency on the film [cycles/mm]", "modulation [%]")
    figure, axes = charts.new_chart(title, labels, (0.0, float(frequencies[-1])), (0.0, 102.0))
    keys: list[Artist] = []
    for number, (degrees, curves) in enumerate(fields.items()):
        if curves is None:
            continue
        tangential, sagittal, limit, _ = (100 * curve for curve in curves)
        if number == 0:
            axes.plot(frequencies, limit, ":", color=charts.FAINT)
        keys += axes.plot(frequencies, tangential, color=charts.series(number), label=f"{degrees:g}°")
        axes.plot(frequencies, sagittal, "--", color=charts.series(number))
    keys.append(Line2D([], [], color=charts.INK, label="tangential"))
    keys.append(Line2D([], [], color=charts.INK, linestyle="--", label="sagittal"))
    keys.append(Line2D([], [], color=charts.FAINT, linestyle=":", label="diffraction limit"))
    charts.add_key(figure, keys)
    return figure


def mtf(
    setting: Setting,
    frequencies_per_mm: Sequence[float],
    fields: Sequence[float] | None,
    wavelengths_nm: Sequence[float],
    *,
    diffraction: bool,
    rays: int | None,
) -> charts.Measured:
    """Return the modulation of each field at frequencies, by rays times diffraction or by waves."""
    groups: Mapping[float, Sequence[Any]]
    curves: Callable[[Sequence[Any], ArrayLike], list[Array] | None]
    if diffraction:
        groups, curves = _by_field(field_waves(setting, fields, wavelengths_nm, rays)), wave_optics.wave_transfer
        values = {one: wave_optics.wave_transfer(group, frequencies_per_mm) for one, group in groups.items()}
        errors = [wave_optics.transfer_errors(group, frequencies_per_mm, values[one]) for one, group in groups.items()]
        rows = [
            row | {"error": error}
            for row, error in zip(table_of(values, frequencies_per_mm), np.concatenate(errors).tolist(), strict=True)
        ]
    else:
        spots = film_spots(setting, fields, wavelengths_nm, rays, mtf_moves(frequencies_per_mm))
        groups, curves, rows = _by_field(spots), field_mtf, mtf_table(spots, frequencies_per_mm)
    how = " by wave optics" if diffraction else ", geometrical times diffraction"
    frequencies = np.linspace(0.0, max(frequencies_per_mm), CURVE)

    def chart() -> Figure:
        shown = {degrees: curves(group, frequencies) for degrees, group in groups.items()}
        return _mtf_chart(f"{setting.lens.name}: MTF{how}", frequencies, shown)

    return result_of(setting, "MTF", rows, chart)


# The image of a point by geometrical optics: the share of its light that each small square of the film receives.

SIDE = 6.0  # of the plot [inches]
ROOM = 1.1  # half width of the image over the radius that holds nearly all light, when none is given


def point_image(spots: Sequence[FilmSpot], pixels: int, width_um: float | None = None) -> PointImage:
    """Return the image of one field by rays, its wavelengths together; pixels and width as of `psf`."""
    points = pool(spots)
    facts, less = spot_facts(points), fewer(spots)
    off, radii = _radii(points)
    names = [f"radius_of_{100 * share:.0f}_percent_um" for share in wave_optics.PSF_SHARES]
    facts |= dict(zip(names, np.quantile(radii, wave_optics.PSF_SHARES).tolist(), strict=True))
    if less and len(before := pool(less)):
        few = spot_facts(before)
        facts["rms_error_um"] = max(abs(facts[name] - few[name]) for name in ("rms_um", "rms_x_um", "rms_y_um"))
        changes = np.quantile(_radii(before)[1], wave_optics.PSF_SHARES) - np.quantile(radii, wave_optics.PSF_SHARES)
        facts["radius_error_um"] = float(np.abs(changes).max())
    half = (width_um or 2 * ROOM * max(float(np.quantile(radii, 0.99)), 1e-6)) / 2
    counts, _, _ = np.histogram2d(-off[:, 1], off[:, 0], bins=pixels, range=[[-half, half], [-half, half]])
    return PointImage(counts / len(points), 2 * half, facts)


def image_moves(few: Sequence[FilmSpot], many: Sequence[FilmSpot]) -> float:
    """Return how far rms and radii of an image of a point move with more rays, in units of what they may."""
    one, other = (pool(group) for group in (few, many))
    if not len(one) or not len(other):
        return 0.0 if len(one) == len(other) else np.inf
    one, other = (np.quantile(_radii(points)[1], wave_optics.PSF_SHARES) for points in (one, other))
    return max(spots_move(few, many), float(np.max(np.abs(one - other) / (STAYS * other + 1e3 * NOTHING))))


def _radii(points: Array) -> tuple[Array, Array]:
    """Return points (n, 2) from their centroid, and how far they are from it (n,) [micrometres]."""
    off = (points - points.mean(axis=0)) * 1e3
    return off, np.hypot(off[:, 0], off[:, 1])


def npy_bytes(values: Array) -> bytes:
    """Return an array as a NumPy file, float32."""
    out = io.BytesIO()
    np.save(out, values.astype(np.float32))
    return out.getvalue()


@charts.styled()
def psf_chart(setting: Setting, image: PointImage, field_degrees: float) -> Figure:
    """Return the image of a point as it is seen, bright on dark, with the share of light that a pixel receives."""
    figure = charts.new_figure(f"{setting.lens.name}: image of a point at {field_degrees:g}°", (SIDE + 1.4, SIDE))
    axes = figure.add_subplot()
    half = image.width_um / 2
    shown = axes.imshow(100 * image.shares, cmap="inferno", vmin=0.0, extent=(-half, half, -half, half))
    axes.set(xlabel="x from the centroid [µm]", ylabel="y from the centroid [µm]")
    axes.grid(visible=False)
    pixel = image.width_um / len(image.shares)
    figure.colorbar(shown, ax=axes, label=f"light in a square of {pixel:.3g} µm [% of all]")
    return figure


def psf(
    setting: Setting,
    field_degrees: float,
    wavelengths_nm: Sequence[float],
    *,
    rays: int | None,
    pixels: int,
    width_um: float | None,
    diffraction: bool,
) -> charts.Measured:
    """Return facts of the image of a point, and the image.

    Parameters
    ----------
    pixels : int
        Along each side of the image.
    width_um : float or None
        Side of the image; as large as the light needs when absent.
    diffraction : bool
        Whether it is by wave optics in place of rays.
    """
    if pixels < 2:
        raise InputError(f"an image needs at least 2 pixels a side (got {pixels})")
    if diffraction:
        waves = field_waves(setting, [field_degrees], wavelengths_nm, rays)
        image = wave_optics.wave_point_image(waves, pixels, width_um)
    else:
        image = point_image(film_spots(setting, [field_degrees], wavelengths_nm, rays, image_moves), pixels, width_um)
    facts = {"field_degrees": field_degrees, "width_um": image.width_um, "pixels": pixels, **image.facts}
    return result_of(
        setting, f"image of a point at {field_degrees:g}°", [facts],
        lambda: psf_chart(setting, image, field_degrees), setting.lens.name, shares=image.shares,
    )  # fmt: skip


# Wavefronts of fields and wavelengths: path differences, Strehl ratios, and the map over the pupil.


def field_waves(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], across: int | None = None
) -> list[PupilFunction]:
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
    waves: list[PupilFunction] = []
    refused: InputError | None = None
    for degrees in default_fields(setting) if fields is None else fields:
        for wavelength in wavelengths_nm:
            beam = Beam(degrees, setting.object_distance_mm)
            try:
                waves.append(wave_optics.pupil_function(setting.lens, film, beam, wavelength, across))
            except InputError as problem:
                refused = problem
    if refused is not None and not waves:
        raise refused
    return waves


def _wavefront_table(waves: Sequence[PupilFunction]) -> list[dict[str, Any]]:
    """Return a row for each wavefront, up to the sphere about the chief ray's point: rms, range, Strehl ratios.

    The errors are what a third of the cells across the pupil changes, at most, of Strehl ratios over `THIRDS_OVER_ALL`;
    of the range no less than half of what it is from one cell to the next.
    """
    rows = []
    for wave in waves:
        ratio, extent = wave_optics.strehl(wave), wave_optics.peak_to_valley(wave, wave.waves_on_sphere)
        thirds = [
            (wave_optics.peak_to_valley(part, part.waves_on_sphere), wave_optics.strehl(part)) for part in wave.thirds()
        ]
        moves = [(part.at_chief_ray - ratio.at_chief_ray, part.at_peak - ratio.at_peak) for _, part in thirds]
        rows.append({
            "field_degrees": wave.field_degrees,
            "wavelength_nm": wave.wavelength_nm,
            **dict(zip(("rms_waves", "rms_waves_without_tilt"), _rms(wave), strict=True)),
            "peak_to_valley_waves": extent,
            "strehl": ratio.at_chief_ray,
            "strehl_at_peak": ratio.at_peak,
            "rms_error_waves": float(np.abs([np.subtract(_rms(part), _rms(wave)) for part in wave.thirds()]).max()),
            "range_error_waves": max(*(abs(part - extent) for part, _ in thirds), _steepest(wave)) / THIRDS_OVER_ALL,
            "strehl_error": float(np.abs(moves).max()) / THIRDS_OVER_ALL,
            "chief_y_mm": float(wave.chief[1]),
        })  # fmt: skip
    return rows


def _steepest(wave: PupilFunction) -> float:
    """Return by how much a wavefront on its sphere differs at most from one cell in the pupil to the next [waves]."""
    return wave_optics.largest_step(np.where(wave.coverage >= 0.5, wave.waves_on_sphere, np.nan))


def _rms(wave: PupilFunction) -> list[float]:
    """Return the rms of a wavefront on its sphere, and less its tilt [waves]."""
    return [wave_optics.rms_waves(wave, wave.waves_on_sphere, without_tilt=flat) for flat in (False, True)]


@charts.styled()
def _wavefront_chart(setting: Setting, waves: Sequence[PupilFunction]) -> Figure:
    """Return the maps of path differences over the pupil side by side, to one scale, in direction cosines."""
    figure, panels = _panels_of(f"{setting.lens.name}: wavefront at the exit pupil", len(waves), TITLE)
    maps = [_map(wave) for wave in waves]
    most = max(float(np.nanmax(np.abs(part))) for part in maps) or 1.0
    for axes, wave, part in zip(panels.flat, waves, maps, strict=False):
        extent = (wave.cosines_x[0], wave.cosines_x[-1], wave.cosines_y[0], wave.cosines_y[-1])
        shown = axes.imshow(part, cmap="RdBu_r", vmin=-most, vmax=most, origin="lower", extent=extent)
        rms = wave_optics.rms_waves(wave, wave.waves_on_sphere)
        axes.set_title(f"{wave.field_degrees:g}°, {wave.wavelength_nm:g} nm\nrms {rms:.3g} waves")
        axes.set(xlabel="direction cosine in x", ylabel="in y" if axes in panels[:, 0] else "")
        axes.locator_params(nbins=4)
        axes.grid(visible=False)
    figure.colorbar(shown, ax=panels, label="ahead of the chief ray [waves]", shrink=0.8)
    return figure


def _map(pupil: PupilFunction) -> Array:
    """Return the path differences about their mean; NaN outside of the pupil."""
    weight = pupil.flux / pupil.flux.sum()
    mean = float(np.sum(weight * pupil.waves_on_sphere))
    return np.where(pupil.coverage >= 0.5, pupil.waves_on_sphere - mean, np.nan)


def wavefront(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], rays: int | None
) -> charts.Measured:
    """Return how far wavefronts are from spheres."""
    waves = field_waves(setting, fields, wavelengths_nm, rays)
    return result_of(setting, "wavefront", _wavefront_table(waves), lambda: _wavefront_chart(setting, waves))
