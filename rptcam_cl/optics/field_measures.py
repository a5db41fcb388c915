"""What a lens does over field and depth: distortion, vignetting, transmittance, depth of field, glare, ghosts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import aberrations, beams, best_focus, charts, drawing, irradiance
from rptcam_cl.optics.ghosts import Ghosts, ghost_image, steps, unfold, with_film
from rptcam_cl.optics.lens import Lens, brought_to_focus, exchange_axes, film_distance
from rptcam_cl.optics.ray_trace import COATED, UNCOATED, LensTransmission, at_plane, axial_transmittance, has_coatings
from rptcam_cl.optics.spots import Setting, fan_points, result_of, section_rays

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Row = dict[str, float | None]

# Where chief rays meet the film, against an ideal projection: distortion, and between wavelengths lateral colour.

# Film height per focal length at an angle, and in words (Kingslake, A History of the Photographic Lens; ISO 17850).
_PROJECTIONS: dict[str, tuple[Callable[[float], float], str]] = {
    "tan": (math.tan, "f tan(angle)"),
    "theta": (lambda angle: angle, "f angle"),
    "stereographic": (lambda angle: 2 * math.tan(angle / 2), "2 f tan(angle / 2)"),
    "equisolid": (lambda angle: 2 * math.sin(angle / 2), "2 f sin(angle / 2)"),
    "orthographic": (math.sin, "f sin(angle)"),
}
NARROW = 30.0  # degrees up to which all projections are alike, and f tan(angle) is what is meant
_RECTILINEAR = 0.1  # largest distortion of a lens that counts as keeping lines straight, as a share of the height
_DISTORTION_ACROSS = 48  # rays across a beam whose middle is sought
_BARREL = 90.0  # degrees at which f tan(angle) has no height


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
    for name in _PROJECTIONS:
        ideals = {degrees: ideal_height(setting, degrees, name) for degrees in seen}
        errors = [
            math.inf if (ideal := ideals[degrees]) is None else abs(height / ideal - 1)
            for degrees, height in seen.items()
        ]
        off[name] = max(errors)
    return "tan" if off["tan"] <= _RECTILINEAR else min(off, key=lambda name: off[name])


def ideal_height(setting: Setting, field_degrees: float, projection: str) -> float | None:
    """Return the film height [mm] that a projection gives a field, by the lens's focal length and magnification.

    None where it gives none: f tan(angle) from 90 degrees on, f sin(angle) beyond.
    """
    if projection not in _PROJECTIONS:
        raise InputError(f"projection must be one of {', '.join(_PROJECTIONS)} (got {projection!r})")
    first = setting.lens.first_order(setting.wavelength_nm)
    angle = math.radians(field_degrees)
    if (projection == "tan" and abs(field_degrees) >= _BARREL) or (
        projection == "orthographic" and abs(field_degrees) > _BARREL
    ):
        return None
    spread = _PROJECTIONS[projection][0](angle)
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
        _, rays = beams.chief_ray(setting.lens, field_degrees, wavelength_nm, setting.object_distance_mm)
    except InputError:
        beam = beams.Beam(field_degrees, setting.object_distance_mm)
        try:
            _, rays, _ = beams.passing_beam(setting.lens, beam, wavelength_nm, _DISTORTION_ACROSS)
        except InputError:
            return None
    if not rays.passed[0]:
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
        beams.chief_ray(setting.lens, fields[0], setting.wavelength_nm, setting.object_distance_mm)
    return rows


@charts.styled()
def distortion_chart(setting: Setting, rows: Sequence[Row], projection: str) -> Figure:
    """Return distortion over the field, a curve for each wavelength."""
    fields = [row["field_degrees"] or 0.0 for row in rows]
    title = f"{setting.lens.name}: distortion against {_PROJECTIONS[projection][1]}"
    labels = ("angle from the axis [degrees]", "distortion [%]")
    figure, axes = charts.new_chart(title, labels, (min(*fields, 0.0), max(*fields, 1e-3)))
    axes.axhline(0.0, color=charts.INK, linewidth=0.8)
    waves = dict.fromkeys(row["wavelength_nm"] or 0.0 for row in rows)
    curves = []
    for wave in waves:
        own = [row for row in rows if row["wavelength_nm"] == wave]
        curves += axes.plot(
            [row["field_degrees"] or 0.0 for row in own],
            [np.nan if row["distortion_percent"] is None else row["distortion_percent"] for row in own],
            marker=".",
            color=charts.wavelength_colour(wave) if len(waves) > 1 else charts.series(0),
            label=f"{wave:g} nm",
        )
    charts.add_key(figure, curves)
    return figure


def distortion(
    setting: Setting, fields: Sequence[float] | None, wavelengths_nm: Sequence[float], projection: str | None
) -> charts.Measured:
    """Return film heights against a projection, by default the one that the lens follows best."""
    film, fields = setting.film, aberrations.fields_of(setting, fields, aberrations.FINE)
    name = projection or followed_projection(setting, fields)
    rows = distortion_table(setting, fields, wavelengths_nm, name)
    meant = _PROJECTIONS[name][1] + ("" if projection else ", which it follows best")
    return result_of(
        setting, "distortion", rows, lambda: distortion_chart(setting, rows, name),
        f"{setting.lens.name}, film at {film:.6g} mm, against {meant}", projection=name,
    )  # fmt: skip


# How the film darkens from the centre outwards, and which part of that is the pupil's and which is cos^4's.


def film_radii(setting: Setting, steps: int, film_radius_mm: float | None = None) -> Array:
    """Return radii from the centre to a film radius [mm], that of the image circle when absent."""
    if film_radius_mm is None:
        film_radius_mm = irradiance.image_circle(
            exchange_axes(setting.lens), setting.film, setting.wavelength_nm
        )  # along y
    return np.linspace(0.0, film_radius_mm, steps + 1)


_BISECTED = 1e-9  # of the light: how exactly the ends of what passes are found


def vignetting_table(setting: Setting, radii_mm: Array) -> list[Row]:
    """Return a row for each film radius.

    Each has the irradiance under a uniform world of unit radiance, the same over that of the centre with its sampling
    error (what half as many rays would change), in stops below it, the angle at which light from the centre of the exit
    pupil arrives, cos^4 of it, the area of the plane of the last vertex through which light passes, and that area over
    the one of the centre.
    """
    lens = exchange_axes(setting.lens)  # fields lie along y, those of these functions along x
    values, errors = irradiance.irradiance_with_error(lens, setting.film, radii_mm, setting.wavelength_nm)
    if not values[0] > 0:
        raise InputError(f"{setting.lens.name}: no light reaches the centre of the film")
    areas = irradiance.pass_areas(lens, setting.film, radii_mm, setting.wavelength_nm)
    pupil = setting.lens.first_order(setting.wavelength_nm).exit_pupil.distance_mm
    rows: list[Row] = []
    for radius, value, error, area in zip(*(each.tolist() for each in (radii_mm, values, errors, areas)), strict=True):
        angle = math.atan2(radius, abs(setting.film - pupil)) if math.isfinite(pupil) else 0.0
        relative = value / float(values[0])
        rows.append(
            {
                "film_radius_mm": radius,
                "irradiance": value,
                "relative": relative,
                "relative_error": (error + relative * float(errors[0])) / float(values[0]) + _BISECTED,
                "stops": math.log2(relative) if relative > 0 else None,
                "angle_degrees": math.degrees(angle),
                "cos4": math.cos(angle) ** 4,
                "pass_area_mm2": area,
                "pass_share": area / float(areas[0]),
            }
        )
    return rows


@charts.styled()
def vignetting_chart(setting: Setting, rows: Sequence[Row]) -> Figure:
    """Return the curves over the film radius."""
    radii = [row["film_radius_mm"] or 0.0 for row in rows]
    title = f"{setting.lens.name}: light falling off over the film"
    labels = ("distance from the axis on the film [mm]", "of the value at the centre [%]")
    figure, axes = charts.new_chart(title, labels, (0.0, radii[-1]))
    for label, name, colour, line in (
        ("relative irradiance", "relative", charts.series(0), "-"),
        ("area through which light passes", "pass_share", charts.series(1), "--"),
        ("cos^4 of the angle on the film", "cos4", charts.FAINT, ":"),
    ):
        axes.plot(radii, [100 * (row[name] or 0.0) for row in rows], line, color=colour, label=label)
    axes.set_ylim(bottom=0.0)
    charts.add_key(figure, axes.lines)
    return figure


def vignetting(setting: Setting, film_radius_mm: float | None, steps: int) -> charts.Measured:
    """Return how the film darkens from the axis to a radius, that of the image circle when absent."""
    rows = vignetting_table(setting, film_radii(setting, steps, film_radius_mm))
    return result_of(setting, "vignetting", rows, lambda: vignetting_chart(setting, rows))


# How much light of each wavelength a lens lets through along its axis.

GLASS_ALONE = LensTransmission(fresnel=False, coatings=False)
STEPS = 121  # of a curve


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
            irradiance.t_number(setting.lens, film, wavelength, losses) if film is not None and passed > 0 else None
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


@charts.styled()
def transmittance_chart(setting: Setting, rows: Sequence[Row]) -> Figure:
    """Return curves from the shortest to the longest wavelength of the rows."""
    ends = [row["wavelength_nm"] or 0.0 for row in rows]
    low, high = min(ends), max(ends)
    if low == high:
        low, high = low - 1.0, high + 1.0
    waves = np.linspace(low, high, STEPS)
    title, labels = f"{setting.lens.name}: light let through on the axis", ("wavelength [nm]", "transmittance [%]")
    figure, axes = charts.new_chart(title, labels, (low, high), (0.0, 104.0))
    curves = [("glass alone", GLASS_ALONE, charts.FAINT, ":"), ("bare surfaces", UNCOATED, charts.series(1), "--")]
    if has_coatings(setting.lens):
        curves.append(("coated surfaces", COATED, charts.series(0), "-"))
    for label, losses, colour, line in curves:
        axes.plot(waves, 100 * axial_transmittance(setting.lens, waves, losses), line, color=colour, label=label)
    charts.add_key(figure, axes.lines)
    return figure


def transmittance(setting: Setting, wavelengths_nm: Sequence[float]) -> charts.Measured:
    """Return the light let through on the axis."""
    rows = transmittance_table(setting, wavelengths_nm)
    name = setting.lens.name
    return result_of(setting, "transmittance", rows, lambda: transmittance_chart(setting, rows), name)


def glare(
    setting: Setting, wavelengths_nm: Sequence[float], *, film_reflectance: float, barrel_reflectance: float
) -> charts.Measured:
    """Return the veiling glare at wavelengths, in parts of a white film's light."""
    rows = []
    for wavelength in wavelengths_nm:
        light, *fewer = (
            irradiance.veiling_glare(
                setting.lens, setting.film, wavelength, film_reflectance=film_reflectance,
                barrel_reflectance=barrel_reflectance, rays=irradiance.GLARE_RAYS // parts,
            ) for parts in (1, 2, 3)
        )  # fmt: skip
        error = max(abs(one.index - light.index) for one in fewer)
        rows.append({"wavelength_nm": wavelength, **asdict(light), "index_error": error})
    return result_of(setting, "veiling glare", rows, None, f"{setting.lens.name}; parts of a white film's light")


# Depth of field on the axis: by the blur of traced rays, and by the thin-lens formula beside it.

STOPS = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0)
_ENGRAVED_M = (
    0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0,
    30.0, 50.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0,
)  # fmt: skip
CHOSEN = (10.0, 20.0, 40.0, 80.0, 160.0)  # focal lengths, whose nearest engraved distances are looked at
_OF_A_DISK = 2 * math.sqrt(2)  # diameter over root mean square distance from the middle
ROUNDS = 60
CLOSE = 1e-4  # of the circle of confusion, within which the blur is found


def _thin_limits(focal_mm: float, f_number: float, focus_mm: float, circle_mm: float) -> tuple[float, float]:
    """Return the nearest and the farthest sharp distance from the film by the thin-lens formula [mm].

    With the object at u and its picture at v, u + v being the distance of focus: u f^2 / (f^2 ± N c (u - f)) from the
    lens (Ray, Applied Photographic Optics, 3rd ed., 2002, ch. 22).
    """
    if math.isinf(focus_mm):
        return focal_mm**2 / (f_number * circle_mm) + focal_mm, math.inf
    if focus_mm < 4 * focal_mm:
        return math.nan, math.nan  # nearer than natural size, where nothing is sharp
    u = (focus_mm + math.sqrt(focus_mm**2 - 4 * focal_mm * focus_mm)) / 2
    v, square, slack = focus_mm - u, focal_mm**2, f_number * circle_mm * (u - focal_mm)
    return u * square / (square + slack) + v, u * square / (square - slack) + v if slack < square else math.inf


def _blur(at: Setting, vergence: float) -> float:
    """Return the diameter of the disk that spreads as much as the picture of a point of a vergence [1/mm] [mm]."""
    away = 1 / vergence if vergence > 0 else math.inf
    return _OF_A_DISK * best_focus.axial_blur(at.lens, at.film, away, at.wavelength_nm)


def _focus_lens(lens: Lens, focus_mm: float, wavelength_nm: float) -> Setting:
    """Return a lens focused at a distance from the film by its least spot."""
    lens, film = brought_to_focus(lens, focus_mm, wavelength_nm)
    front = focus_mm - lens.length - lens.sense * film
    if front <= 0:
        raise InputError(f"{lens.name}: cannot be focused at {focus_mm:g} mm from the film, within the lens")
    return Setting(lens, best_focus.best_film_distance(lens, front, "front", (wavelength_nm,)), front, wavelength_nm)


def _crossing(excess: Callable[[float], float], inside: float, outside: float) -> float:
    """Return where a function changes its sign, from below 0 inside to above outside, by false position (Illinois)."""
    low, high = excess(inside), excess(outside)
    middle = outside
    for _ in range(ROUNDS):
        middle = inside - low * (outside - inside) / (high - low)
        value = excess(middle)
        if abs(value) <= CLOSE:
            break
        if value < 0:
            inside, low, high = middle, value, high / 2
        else:
            outside, high, low = middle, value, low / 2
    return middle


def _traced_limits(at: Setting, circle_mm: float) -> tuple[float, float] | None:
    """Return the nearest and the farthest distance from the film whose points blur no wider than a circle [mm].

    None where the lens makes nothing as sharp.
    """

    def excess(vergence: float) -> float:
        return _blur(at, vergence) / circle_mm - 1

    own = 1 / at.object_distance_mm
    if excess(own) > 0:
        return None
    step = max(own, circle_mm / at.lens.first_order(at.wavelength_nm).focal_length_mm ** 2)
    near = own + step
    while excess(near) < 0:
        step *= 2
        near += step
    near = _crossing(excess, own, near)
    far = math.inf if excess(0.0) <= 0 else 1 / _crossing(excess, own, 0.0)
    return 1 / near + at.film_z, far + at.film_z


def _hyperfocal(lens: Lens, circle_mm: float, wavelength_nm: float) -> float | None:
    """Return the nearest focus from the film at which points infinitely far away blur no wider than a circle [mm]."""

    def excess(reciprocal: float) -> float:
        focus = 1 / reciprocal if reciprocal else math.inf
        return _blur(_focus_lens(lens, focus, wavelength_nm), 0.0) / circle_mm - 1

    if excess(0.0) > 0:
        return None
    first = lens.first_order(wavelength_nm)
    near = 1 / _thin_limits(first.focal_length_mm, first.f_number, math.inf, circle_mm)[0]
    while excess(near) < 0:
        near *= 1.5
    return 1 / _crossing(excess, 0.0, near)


def depth_of_field(
    setting: Setting,
    distances_m: Sequence[float] | None,
    f_numbers: Sequence[float] | None,
    circle_mm: float,
) -> charts.Measured:
    """Return the depth of field on the axis at focus distances and f-numbers, from the object to the film.

    The blur is that of a disk which spreads as much as the traced rays: 2 sqrt(2) times their root mean square, which
    of a mere defocus is the diameter of its disk. The film stands at the least spot of each focus and f-number.
    """
    _ = setting.film
    lens, wavelength_nm = setting.lens, setting.wavelength_nm
    focal_m = 1e-3 * abs(setting.lens.first_order(wavelength_nm).focal_length_mm)
    if math.isfinite(setting.object_distance_mm):
        if lens.focuses_by_group or lens.floating:
            raise InputError(f"{lens.name}: focuses by a group; give its distances as --distances-m (distances_m)")
        own = 1e-3 * (setting.object_distance_mm + lens.length + lens.sense * setting.film)
        distances_m = distances_m or [own]
    if distances_m is None:
        engraved = {min(_ENGRAVED_M, key=lambda d: abs(math.log(d / (lengths * focal_m)))) for lengths in CHOSEN}
        distances_m = [*sorted(engraved), math.inf]
    rows: list[Row] = []
    for stopped in _stop_down(lens, f_numbers, wavelength_nm):
        first = stopped.first_order(wavelength_nm)
        focal_mm, f_number = abs(first.focal_length_mm), first.f_number
        beyond = _hyperfocal(stopped, circle_mm, wavelength_nm)
        thin_beyond = focal_mm**2 / (f_number * circle_mm) + 2 * focal_mm + f_number * circle_mm  # to the film
        for distance in distances_m:
            at = _focus_lens(stopped, 1e3 * distance, wavelength_nm)
            blur, limits = _blur(at, 1 / at.object_distance_mm), _traced_limits(at, circle_mm)
            thin = _thin_limits(focal_mm, f_number, 1e3 * distance, circle_mm)
            near, far = (None, None) if limits is None else (1e-3 * limits[0], 1e-3 * limits[1])
            near_thin, far_thin = (None if math.isnan(end) else 1e-3 * end for end in thin)
            rows.append({
                "f_number": f_number, "focus_m": distance, "blur_mm": blur, "near_m": near, "far_m": far,
                "near_thin_m": near_thin, "far_thin_m": far_thin,
                "hyperfocal_m": None if beyond is None else 1e-3 * beyond,
                "hyperfocal_thin_m": 1e-3 * thin_beyond,
            })  # fmt: skip
    caption = f"{lens.name}, {1e3 * focal_m:.4g} mm, points blurred by up to {circle_mm:.4g} mm, on the axis"
    return result_of(
        setting, "depth of field", rows, lambda: _chart(lens, rows, circle_mm, wavelength_nm), caption,
        circle_mm=circle_mm,
    )  # fmt: skip


def _stop_down(lens: Lens, f_numbers: Sequence[float] | None, wavelength_nm: float) -> list[Lens]:
    """Return the lens at f-numbers; by default as it is, and at every second full stop from there on."""
    if f_numbers is not None:
        return [lens.with_stop_diameter(lens.stop_diameter_for(number, wavelength_nm)) for number in f_numbers]
    widest = lens.first_order(wavelength_nm).f_number
    if lens.stop is None or lens.is_obstructed:  # a small stop lies within what obstructs the middle
        return [lens]
    numbers = [number for number in STOPS if number > 1.3 * widest][1::2]
    return [lens, *(lens.with_stop_diameter(lens.stop_diameter_for(number, wavelength_nm)) for number in numbers)]


#
# The drawing: curves over the distance, and the scale that would be engraved on the lens.


ENDLESS = 1e3  # times the greatest distance shown: where a limit at infinity is drawn


def _colours(rows: Sequence[Row]) -> dict[float | None, str]:
    """Return the colour of each f-number."""
    return {stop: charts.series(n) for n, stop in enumerate(dict.fromkeys(row["f_number"] for row in rows))}


@charts.styled()
def _chart(lens: Lens, rows: Sequence[Row], circle_mm: float, wavelength_nm: float) -> Figure:
    finite = sorted({float(row["focus_m"] or 0) for row in rows if math.isfinite(row["focus_m"] or 0)})
    title = f"{lens.name}: depth of field, circle of confusion {circle_mm:.3g} mm"
    if not finite:
        raise InputError(f"{lens.name}: a scale needs a finite distance of focus (--distances-m)")
    if len(finite) == 1:
        figure = charts.new_figure(title, (8.0, 2.6))
        _draw_scale(figure.subplots(), lens, rows, finite[0], wavelength_nm)
        return figure
    figure = charts.new_figure(title, (8.0, 6.4))
    curves, scale = figure.subplots(2, 1, height_ratios=(3, 1))
    _draw_limits(curves, rows, finite)
    charts.add_key(figure, curves.get_lines()[1::2])
    _draw_scale(scale, lens, rows, finite[len(finite) // 2], wavelength_nm)
    return figure


def _draw_limits(axes: Axes, rows: Sequence[Row], finite: Sequence[float]) -> None:
    """Draw both limits over the distance of focus: lines by rays, dashes by the formula."""
    from matplotlib.ticker import LogLocator

    top = 4 * finite[-1]
    for stop, colour in _colours(rows).items():
        own = [row for row in rows if row["f_number"] == stop and math.isfinite(row["focus_m"] or 0)]
        for style, ends in (("--", ("near_thin_m", "far_thin_m")), ("-", ("near_m", "far_m"))):
            at, values = [], []
            for end in ends:
                at += [*(float(row["focus_m"] or 0) for row in own), math.nan]
                values += [min(math.nan if (to := row[end]) is None else to, ENDLESS * top) for row in own] + [math.nan]
            marker = "." if style == "-" else ""
            axes.plot(at, values, style, color=colour, label=f"f/{stop:.3g}", marker=marker)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(None, top)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.set_minor_formatter("{x:g}")
    axes.set_xlabel("focus [m]")
    axes.set_ylabel("sharp from and to [m]; dashes: thin lens")


def _draw_scale(axes: Axes, lens: Lens, rows: Sequence[Row], focus_m: float, wavelength_nm: float) -> None:
    """Draw distances as on a ring whose turn moves the image evenly, and marks of the limits at one of them."""
    infinity = film_distance(lens, math.inf, wavelength_nm=wavelength_nm)
    focal_mm = abs(lens.first_order(wavelength_nm).focal_length_mm)

    def place(distance_m: float) -> float:
        return film_distance(lens, 1e3 * distance_m, wavelength_nm=wavelength_nm) - infinity

    own = [row for row in rows if row["focus_m"] == focus_m and row["near_m"] is not None]
    middle = place(focus_m)
    ends = [place(float(row[end] or 0)) for row in own for end in ("near_m", "far_m")]
    reach = 1.25 * max([abs(end - middle) for end in ends], default=0.5 * middle)
    beside = [min(side, key=lambda at: abs(at - focus_m), default=focus_m) for side in (
        [at for at in _ENGRAVED_M if at < 0.99 * focus_m and at > 4.2e-3 * focal_mm],
        [at for at in _ENGRAVED_M if at > 1.01 * focus_m])]  # fmt: skip
    reach = max(reach, *(1.05 * abs(place(at) - middle) for at in beside))
    axes.set_xlim(middle - reach, middle + reach)
    axes.set_ylim(-1.0, 1.0)
    axes.set_axis_off()
    axes.axhline(0.0, color=charts.INK, linewidth=1.0)
    last = -math.inf
    for distance in (math.inf, *reversed(_ENGRAVED_M)):
        if distance < 4.2e-3 * focal_mm:
            break
        at = place(distance)
        if abs(at - middle) > reach or at - last < 0.09 * reach:
            continue
        last = at
        axes.plot([at, at], [0.0, 0.18], color=charts.INK, linewidth=1.0)
        axes.text(at, 0.3, "∞" if math.isinf(distance) else f"{distance:g}", ha="center", va="bottom")
    axes.plot([middle], [-0.12], marker="^", color=charts.INK, markersize=8)
    axes.text(middle, -0.95, f"{focus_m:g} m", ha="center", va="bottom")
    for number, row in enumerate(own):
        for end in ("near_m", "far_m"):
            at = place(float(row[end] or 0))
            axes.plot([at, at], [-0.3, 0.0], color=_colours(rows)[row["f_number"]], linewidth=1.5)
            axes.text(at, -0.34 - 0.2 * (number % 2), f"{row['f_number']:.3g}", ha="center", va="top", fontsize=8)


# Ghosts of a lens as a table, and the way of one of them in cross-section.

RAYS = 9  # of the way that is drawn
PHASES = ("to the first reflection", "back", "on to the film")


def way_text(way: tuple[int, ...]) -> str:
    """Return a way by the surfaces that reflect it, as ``6, 3``."""
    return ", ".join(map(str, way))


def ghost_table(ghosts: Ghosts, fewer: Sequence[Ghosts] = ()) -> list[dict[str, Any]]:
    """Return a row for each ghost, brightest in the frame first.

    Shares are of the image's light, `share_error` is what fewer rays change of either most. `focus_mm` is how far
    behind the film its paraxial image lies; `blur_mm` the diameter on the film of a full beam from the axis.
    """
    lit = ghosts.lit
    with_its_film = with_film(lit.lens, lit.film_distance_mm)
    pupil = lit.lens.first_order(lit.wavelength_nm).entrance_pupil.diameter_mm
    others = [(each.reference, {ghost.way: ghost for ghost in each.ghosts}) for each in fewer]
    rows = []
    for ghost in ghosts.ghosts:
        own = np.array([ghost.flux_in_frame, ghost.flux]) / ghosts.reference
        less = [np.array([one.flux_in_frame, one.flux]) / of if (one := ways.get(ghost.way)) else 0 * own
                for of, ways in others]  # fmt: skip
        image = ghost_image(with_its_film, ghost.way, 0.0, lit.wavelength_nm, lit.source.object_distance_mm)
        rows.append({
            "surfaces": list(ghost.way),
            "share_in_frame": float(own[0]),
            "share": float(own[1]),
            "share_error": max((float(np.abs(one - own).max()) for one in less), default=math.nan),
            "x_mm": ghost.centroid_mm[0],
            "y_mm": ghost.centroid_mm[1],
            "rms_mm": ghost.rms_mm,
            "focus_mm": image.image_distance_mm,
            "blur_mm": abs(image.film_per_height) * pupil,
        })  # fmt: skip
    return rows


def ghost_summary(ghosts: Ghosts, fewer: Sequence[Ghosts] = ()) -> dict[str, Any]:
    """Return the sums, the worst ghost and where the light goes, as shares of what enters.

    Errors are what fewer rays change: `ghosts_error` of either sum, `account_error` of any of the account's shares.
    """
    sums = _ghost_sums(ghosts)
    account = asdict(ghosts.account)
    entered = account.pop("entered")
    worst = max(ghosts.ghosts, key=lambda ghost: ghost.flux_in_frame, default=None)
    densest = max(ghosts.ghosts, key=_density, default=None)
    return {
        "image_share": ghosts.image.flux / entered,
        "ghosts_in_frame": float(sums[0]),
        "ghosts": float(sums[1]),
        "ghosts_error": max((float(np.abs(_ghost_sums(one) - sums).max()) for one in fewer), default=math.nan),
        "shares_are_of": "image" if ghosts.image.flux else "light that enters",
        "worst": None if worst is None else list(worst.way),
        "densest": None if densest is None else list(densest.way),
        "account": {name: value / entered for name, value in account.items()},
        "account_error": max((
            abs(getattr(one.account, name) / one.account.entered - value / entered)
            for one in fewer for name, value in account.items()
        ), default=math.nan),
    }  # fmt: skip


def _ghost_sums(ghosts: Ghosts) -> NDArray[np.float64]:
    """Return the light of all ghosts in the frame and on the film's plane, as shares of the image's."""
    rows = np.array([(ghost.flux_in_frame, ghost.flux) for ghost in ghosts.ghosts], np.float64).reshape(-1, 2)
    return np.asarray(rows.sum(axis=0) / ghosts.reference, np.float64)


def _density(ghost: Any) -> float:
    """Return light over the area of a disk of the same rms radius."""
    return float(ghost.flux_in_frame / max(ghost.rms_mm, 1e-3) ** 2) if ghost.flux_in_frame else 0.0


def draw_ghost(setting: Setting, ghosts: Ghosts, way: tuple[int, ...]) -> charts.Drawing:
    """Return the lens in cross-section with rays of one way: coming, going back and going on in their colours.

    Raises
    ------
    InputError
        When no ray of the cross-section takes that way.
    """
    lit = ghosts.lit
    folded = with_film(lit.lens, lit.film_distance_mm)
    rays = _rays(setting, ghosts, way)
    if not rays:
        raise InputError(f"{setting.lens.name}: no ray of the cross-section is reflected at {way_text(way)}")
    view = drawing.View()
    film = np.array([[setting.film_z, -lit.film_mm[1] / 2], [setting.film_z, lit.film_mm[1] / 2]])
    outline = [drawing.profile(lit.lens, k, "y") for k in range(len(folded.surfaces) - 1)] + drawing.blades(
        lit.lens, "y"
    )
    frame = drawing.PixelFrame.around([*outline, film, *rays], setting)
    picture = charts.Drawing(drawing.WIDTH, frame.height, _title(ghosts, way))
    drawing.draw_glass(picture, frame, setting, view)
    picture.add(charts.Path(frame.axis(), charts.FAINT, 0.8, dash=(10, 3, 2, 3)))
    met = list(steps(way, len(folded.surfaces)))
    ends = [0, *(1 + i for i, step in enumerate(met) if step.reflects), len(met)]
    for ray in rays:
        for number, (start, end) in enumerate(pairwise(ends)):
            picture.add(
                charts.Path(frame.places(ray[start : end + 1]), charts.SERIES[number % len(charts.SERIES)], 0.9)
            )
    drawing.draw_surfaces(picture, frame, setting, view)
    picture.add(charts.Path(frame.places(film), charts.INK, 2.0, note="film"))
    _draw_words(picture, len(way))
    return picture


def _rays(setting: Setting, ghosts: Ghosts, way: tuple[int, ...]) -> list[Array]:
    """Return corners (m, 2), z and height, of rays of the cross-section that take a way to the film."""
    lit = ghosts.lit
    lens = unfold(with_film(lit.lens, lit.film_distance_mm), way)
    at = Setting(lit.lens, setting.film_distance_mm, lit.source.object_distance_mm, lit.wavelength_nm)
    points = fan_points(at, lit.source.field_degrees, "y")
    origins, directions = section_rays(at, lit.source.field_degrees, points, "y")
    passed = np.flatnonzero(lens.trace(origins, directions, lit.wavelength_nm, "scene").passed)
    if not len(passed):
        return []
    chosen = passed[np.unique(np.linspace(0, len(passed) - 1, RAYS).round().astype(int))]
    paths = drawing.ray_paths(lens, origins[chosen], directions[chosen], lit.wavelength_nm, drawing.reference)
    corners = np.moveaxis(paths.points, 0, 1).copy()
    along = lit.lens.from_scene_axes(origins[chosen].T, directions[chosen].T)[1].T
    along = along / np.linalg.norm(along, axis=1)[:, None]
    reach = min(drawing.APPROACH * drawing.size_of(lit.lens), lit.source.object_distance_mm)
    corners[:, 0] = corners[:, 1] - along * reach
    return [line[:, [2, 1]] for line in corners]


def _title(ghosts: Ghosts, way: tuple[int, ...]) -> str:
    ghost = next(ghost for ghost in ghosts.ghosts if ghost.way == way)
    share = ghost.flux_in_frame / ghosts.reference
    return f"{ghosts.lit.lens.name}; reflected at surfaces {way_text(way)}: {share:.2g} of the image's light"


def _draw_words(picture: charts.Drawing, reflections: int) -> None:
    picture.add(charts.Text((drawing.MARGIN, 24), picture.title, 15))
    words = PHASES if reflections == 2 else [f"after {number} reflections" for number in range(reflections + 1)]
    drawing.draw_key(picture, [(charts.SERIES[number % len(charts.SERIES)], word) for number, word in enumerate(words)])
