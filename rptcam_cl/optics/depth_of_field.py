"""Depth of field of a lens on its axis: by the blur of traced rays, and by the thin-lens formula beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import charts
from rptcam_cl.optics.best_focus import axial_blur, best_film_distance
from rptcam_cl.optics.image_quality import Setting, result_of
from rptcam_cl.optics.lens import Lens, brought_to_focus, film_distance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = dict[str, float | None]

CIRCLE_MM = math.hypot(36, 24) / 1500  # of confusion, as for autofocus: the diagonal of the film / 1500
STOPS = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0)
ENGRAVED_M = (
    0.03, 0.04, 0.05, 0.07, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0,
    30.0, 50.0, 70.0, 100.0, 150.0, 200.0, 300.0, 500.0,
)  # fmt: skip
CHOSEN = (10.0, 20.0, 40.0, 80.0, 160.0)  # focal lengths, whose nearest engraved distances are looked at
OF_A_DISK = 2 * math.sqrt(2)  # diameter over root mean square distance from the middle
ROUNDS = 60
CLOSE = 1e-4  # of the circle of confusion, within which the blur is found


def thin_limits(focal_mm: float, f_number: float, focus_mm: float, circle_mm: float) -> tuple[float, float]:
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


@dataclass(frozen=True)
class _Focus:
    """A lens focused at a distance by its least spot."""

    lens: Lens
    film_mm: float
    front_mm: float
    wavelength_nm: float

    @property
    def behind_mm(self) -> float:
        """From the first vertex to the film."""
        return self.lens.length + self.lens.sense * self.film_mm

    def blur(self, vergence: float) -> float:
        """Return the diameter of the disk that spreads as much as the picture of a point of a vergence [1/mm] [mm]."""
        away = 1 / vergence if vergence > 0 else math.inf
        return OF_A_DISK * axial_blur(self.lens, self.film_mm, away, self.wavelength_nm)


def _focused(lens: Lens, focus_mm: float, wavelength_nm: float) -> _Focus:
    lens, film = brought_to_focus(lens, focus_mm, wavelength_nm)
    front = focus_mm - lens.length - lens.sense * film
    if front <= 0:
        raise InputError(f"{lens.name}: cannot be focused at {focus_mm:g} mm from the film, within the lens")
    return _Focus(lens, best_film_distance(lens, front, "front", (wavelength_nm,)), front, wavelength_nm)


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


def traced_limits(at: _Focus, circle_mm: float) -> tuple[float, float] | None:
    """Return the nearest and the farthest distance from the film whose points blur no wider than a circle [mm].

    None where the lens makes nothing as sharp.
    """

    def excess(vergence: float) -> float:
        return at.blur(vergence) / circle_mm - 1

    own = 1 / at.front_mm
    if excess(own) > 0:
        return None
    step = max(own, circle_mm / at.lens.first_order(at.wavelength_nm).focal_length_mm ** 2)
    near = own + step
    while excess(near) < 0:
        step *= 2
        near += step
    near = _crossing(excess, own, near)
    far = math.inf if excess(0.0) <= 0 else 1 / _crossing(excess, own, 0.0)
    return 1 / near + at.behind_mm, far + at.behind_mm


def hyperfocal(lens: Lens, circle_mm: float, wavelength_nm: float) -> float | None:
    """Return the nearest focus from the film at which points infinitely far away blur no wider than a circle [mm]."""

    def excess(reciprocal: float) -> float:
        focus = 1 / reciprocal if reciprocal else math.inf
        return _focused(lens, focus, wavelength_nm).blur(0.0) / circle_mm - 1

    if excess(0.0) > 0:
        return None
    first = lens.first_order(wavelength_nm)
    near = 1 / thin_limits(first.focal_length_mm, first.f_number, math.inf, circle_mm)[0]
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
        distances_m = [*sorted({_engraved(lengths * focal_m) for lengths in CHOSEN}), math.inf]
    rows: list[Row] = []
    for stopped in _stopped(lens, f_numbers, wavelength_nm):
        first = stopped.first_order(wavelength_nm)
        focal_mm, f_number = abs(first.focal_length_mm), first.f_number
        beyond = hyperfocal(stopped, circle_mm, wavelength_nm)
        thin_beyond = focal_mm**2 / (f_number * circle_mm) + 2 * focal_mm + f_number * circle_mm  # to the film
        for distance in distances_m:
            at = _focused(stopped, 1e3 * distance, wavelength_nm)
            blur, limits = at.blur(1 / at.front_mm), traced_limits(at, circle_mm)
            thin = thin_limits(focal_mm, f_number, 1e3 * distance, circle_mm)
            near, far = (None, None) if limits is None else (1e-3 * limits[0], 1e-3 * limits[1])
            near_thin, far_thin = (None if math.isnan(end) else 1e-3 * end for end in thin)
            rows.append({
                "f_number": f_number, "focus_m": distance, "blur_mm": blur, "near_m": near, "far_m": far,
                "near_thin_m": near_thin, "far_thin_m": far_thin, "hyperfocal_thin_m": 1e-3 * thin_beyond,
                "hyperfocal_m": None if beyond is None else 1e-3 * beyond,
            })  # fmt: skip
    caption = f"{lens.name}, {1e3 * focal_m:.4g} mm, points blurred by up to {circle_mm:.4g} mm, on the axis"
    return result_of(
        setting, "depth of field", rows, lambda: _chart(lens, rows, circle_mm, wavelength_nm), caption,
        circle_mm=circle_mm,
    )  # fmt: skip


def _engraved(distance_m: float) -> float:
    """Return the engraved distance that is nearest to another."""
    return min(ENGRAVED_M, key=lambda engraved: abs(math.log(engraved / distance_m)))


def _stopped(lens: Lens, f_numbers: Sequence[float] | None, wavelength_nm: float) -> list[Lens]:
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
        [at for at in ENGRAVED_M if at < 0.99 * focus_m and at > 4.2e-3 * focal_mm],
        [at for at in ENGRAVED_M if at > 1.01 * focus_m])]  # fmt: skip
    reach = max(reach, *(1.05 * abs(place(at) - middle) for at in beside))
    axes.set_xlim(middle - reach, middle + reach)
    axes.set_ylim(-1.0, 1.0)
    axes.set_axis_off()
    axes.axhline(0.0, color=charts.INK, linewidth=1.0)
    last = -math.inf
    for distance in (math.inf, *reversed(ENGRAVED_M)):
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
