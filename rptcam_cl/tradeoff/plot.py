"""Three pictures of a comparison in one: error against time, error over the field, and where pictures differ."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.lenstools import FAINT, GRID, INK, SERIES, Axes, Drawing, Legend, Path, Point, Text, draw_key
from rptcam_cl.tradeoff.comparison import Comparison
from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.tiers.errors import FIELDS
from rptcam_cl.tradeoff.words import seconds

LOW, HIGH = 0.003, 1.0  # relative differences between which the shade changes, by logarithm
SHADES = ((247, 247, 250), (170, 195, 222), (60, 110, 165), (96, 40, 110), (40, 5, 40))


def draw_map(picture: Drawing, corner: Point, size: Point, bias: NDArray[np.float64]) -> None:
    """Draw squared differences (rows, columns) of tiles as a map with its upper left corner at a point."""
    rows, columns = bias.shape
    width, height = size[0] / columns, size[1] / rows
    for (y, x), value in np.ndenumerate(bias):
        left, top = corner[0] + x * width, corner[1] + y * height
        picture.add(_box((left, top), (width, height), _shade(math.sqrt(max(value, 0.0)))))
    picture.add(Path(_corners(corner, size), INK, 0.8, closed=True))


def map_scale(picture: Drawing, corner: Point) -> None:
    """Draw what the shades stand for."""
    steps, width = 60, 4.0
    for step in range(steps):
        value = LOW * (HIGH / LOW) ** ((step + 0.5) / steps)
        picture.add(_box((corner[0] + step * width, corner[1]), (width, 10.0), _shade(value)))
    for value in (0.003, 0.01, 0.03, 0.1, 0.3, 1.0):
        at = corner[0] + steps * width * math.log(value / LOW) / math.log(HIGH / LOW)
        picture.add(Text((at, corner[1] + 22), f"{100 * value:g} %", 10, "middle"))


def _shade(value: float) -> str:
    share = math.log(max(value, LOW) / LOW) / math.log(HIGH / LOW)
    at = np.linspace(0, 1, len(SHADES))
    return "#" + "".join(f"{round(float(np.interp(share, at, channel))):02x}" for channel in zip(*SHADES, strict=True))


def _box(corner: Point, size: Point, fill: str) -> Path:
    return Path(_corners(corner, size), fill, 0.4, fill=fill, closed=True)


def _corners(corner: Point, size: Point) -> list[Point]:
    (left, top), (width, height) = corner, size
    return [(left, top), (left + width, top), (left + width, top + height), (left, top + height)]


WIDTH, HEIGHT = 1180.0, 800.0
LEFT, RIGHT = (70.0, 66.0, 600.0, 400.0), (690.0, 66.0, 1150.0, 400.0)
MAPS_TOP, MAP_WIDTH, MAP_GAP = 570.0, 250.0, 26.0
MOST_MAPS = 4
POINTS = 200  # of a curve
FINEST, COARSEST = 0.005, 3.0  # errors that the chart reaches from the one to the other, about
DASHES: dict[str, tuple[float, ...]] = {"thick_lens": (7.0, 5.0)}  # which often lies on the thin lens's curve


def tradeoff_plot(report: Comparison, title: str) -> Drawing:
    """Return the three pictures.

    On the left root of relMSE over time, a line each; those that become level have reached their bias, and what falls
    as fast as noise does falls along the dotted guide. Dots are where a line meets that of the most accurate one. On
    the right how far cheaper cameras put light beside its place. Below how much the pictures of the configurations that
    differ most do so, tile by tile; those that are advised come first.
    """
    picture = Drawing(WIDTH, HEIGHT, title)
    picture.add(Text((LEFT[0], 28), title, 15))
    colours = {found.name: SERIES[i % len(SERIES)] for i, found in enumerate(report.measurements)}
    dashes: dict[str, tuple[float, ...]] = {
        found.name: () if i < len(SERIES) else (6.0, 3.0) for i, found in enumerate(report.measurements)
    }
    _errors_over_time(picture, report.measurements, colours, dashes)
    keys = [Legend(found.name, colours[found.name], dashes[found.name]) for found in report.measurements]
    draw_key(picture, [*keys, Legend("slope of independent samples", FAINT, (2.0, 3.0))], 470)
    _errors_over_field(picture, report, colours)
    _maps(picture, report)
    return picture


def log_axes(
    picture: Drawing, box: tuple[float, float, float, float], x: tuple[float, float], y: tuple[float, float]
) -> Axes:
    """Return axes of decimal logarithms over whole decades, with a grid and the values at the decades."""
    whole = [(math.floor(low), max(math.ceil(high), math.floor(low) + 1)) for low, high in (x, y)]
    axes = Axes(picture, box, *whole)
    left, top, right, bottom = box
    for decade in range(whole[0][0], whole[0][1] + 1):
        at, _ = axes.place(decade, whole[1][0])
        picture.add(Path([(at, top), (at, bottom)], GRID, 0.7))
        picture.add(Text((at, bottom + 16), seconds(10.0**decade), 11, "middle"))
    for decade in range(whole[1][0], whole[1][1] + 1):
        _, at = axes.place(whole[0][0], decade)
        picture.add(Path([(left, at), (right, at)], GRID, 0.7))
        picture.add(Text((left - 6, at + 4), f"{100 * 10.0**decade:g} %", 11, "end"))
    picture.add(Path([(left, top), (right, top), (right, bottom), (left, bottom)], INK, 1.0, closed=True))
    return axes


def _errors_over_time(
    picture: Drawing, found: Sequence[Measurement], colours: dict[str, str], dashes: dict[str, tuple[float, ...]]
) -> None:
    full = found[0].rate.value or found[0].sample_s.value  # an even picture has no noise
    x = (math.log10(full), math.log10(full / FINEST**2))  # from an error of 100 % of the most accurate one
    times = 10 ** np.linspace(math.floor(x[0]), math.ceil(x[1]), POINTS)
    curves = {each.name: _log_error(each, times) for each in found}
    axes = log_axes(picture, LEFT, x, (math.log10(FINEST / 5), math.log10(COARSEST)))
    _titles(picture, LEFT, "error (root of relMSE) over time, with bands of 95 %", "time to render the picture", "")
    low, high = axes.y_range
    for each in found:
        band = [np.clip(_log_error(each, times, end), low, high) for end in ("low", "high")]
        outline = [*zip(np.log10(times), band[0], strict=True), *zip(np.log10(times)[::-1], band[1][::-1], strict=True)]
        picture.add(Path([axes.place(*point) for point in outline], None, fill=_pale(colours[each.name])))
    begin = axes.x_range[0] + 0.3
    guide = [(begin + decades, low + 1.4 - decades / 2) for decades in (0.0, 2.0)]
    picture.add(Path([axes.place(*point) for point in guide], FAINT, 1.4, dash=(2.0, 3.0)))
    _beside_the_chart(picture, curves, axes.y_range)
    for each in found:
        inside = np.where((curves[each.name] >= low) & (curves[each.name] <= high), curves[each.name], np.nan)
        axes.curve(np.log10(times), inside, colours[each.name], dashes[each.name])
        meets = each.better_until.value
        if each.knob and times[0] < meets < times[-1]:
            at = np.array([meets])
            axes.dots(np.log10(at), np.clip(_log_error(each, at), low, high), colours[each.name], 4.0)


def _beside_the_chart(picture: Drawing, curves: dict[str, np.ndarray], y_range: tuple[float, float]) -> None:
    """Say which curves lie wholly above or below the chart."""
    _, top, right, bottom = LEFT
    for where, place, out in (
        ("above", top + 18, {name for name, curve in curves.items() if (curve > y_range[1]).all()}),
        ("below", bottom - 10, {name for name, curve in curves.items() if (curve < y_range[0]).all()}),
    ):
        if out:
            names = "all" if len(out) == len(curves) else ", ".join(name for name in curves if name in out)
            picture.add(Text((right - 8, place), f"{where} the chart: {names}", 11, "end", colour=FAINT))


def _log_error(found: Measurement, times: np.ndarray, end: str = "value") -> np.ndarray:
    floor = 0.0 if found.unbiased or not found.knob else max(getattr(found.bias, end), 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log10(floor + found.law(end).even(times / found.sample_s.value)) / 2)


def _pale(colour: str) -> str:
    """Return a colour mixed with much white: bands lie over each other without transparency."""
    channels = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return "#" + "".join(f"{round(255 - 0.16 * (255 - value)):02x}" for value in channels)


def _titles(picture: Drawing, box: tuple[float, float, float, float], title: str, below: str, beside: str) -> None:
    left, top, right, bottom = box
    picture.add(Text((left, top - 10), title, 12.5))
    picture.add(Text(((left + right) / 2, bottom + 36), below, 12, "middle"))
    if beside:
        picture.add(Text((left - 48, (top + bottom) / 2), beside, 12, "middle", turned=True))


def _errors_over_field(picture: Drawing, report: Comparison, colours: dict[str, str]) -> None:
    cameras = [each for each in report.cameras if each.tier != "realistic"]
    title = "error of cheaper cameras over the field [pixels]"
    if not cameras:
        _titles(picture, RIGHT, title, "", "")
        picture.add(Text((RIGHT[0], RIGHT[1] + 24), "The camera has no cheaper model.", 12, colour=FAINT))
        return
    values = [value for each in cameras for value in each.pixels if math.isfinite(value)]
    axes = Axes(picture, RIGHT, (0.0, 1.0), (0.0, 1.08 * max([*values, 1.0])))
    axes.frame("", "")
    _titles(picture, RIGHT, title, "film point, share of the half diagonal", "pixels")
    axes.curve([0.0, 1.0], [0.5, 0.5], FAINT, (5.0, 4.0))
    if any(math.isinf(value) for each in cameras for value in each.pixels):
        note = "a line ends where the lens sees nothing"
        picture.add(Text((RIGHT[2] - 8, RIGHT[3] - 10), note, 11, "end", colour=FAINT))
    for each in cameras:
        colour = colours.get(each.tier.replace("_", " "), INK)
        axes.curve(FIELDS, each.pixels, colour, DASHES.get(each.tier, ()))
        good = [(field, value) for field, value in zip(FIELDS, each.pixels, strict=True) if math.isfinite(value)]
        axes.dots([field for field, _ in good], [value for _, value in good], colour, 3.0)


def _maps(picture: Drawing, report: Comparison) -> None:
    biased = [found for found in report.measurements if found.knob and not found.unbiased]
    chosen = {advice.chosen for advice in report.advice}
    shown = sorted(biased, key=lambda found: (found.name in chosen, found.bias.value), reverse=True)[:MOST_MAPS]
    top = MAPS_TOP - 40
    picture.add(
        Text(
            (LEFT[0], top),
            "where pictures differ from the most accurate one: root of relMSE of tiles, white where it may be noise",
            12.5,
        )
    )
    height = MAP_WIDTH * report.resolution[1] / report.resolution[0]
    size = (MAP_WIDTH, height) if height <= HEIGHT - MAPS_TOP - 44 else _narrow(report)
    for place, found in enumerate(shown):
        left = LEFT[0] + place * (MAP_WIDTH + MAP_GAP)
        picture.add(Text((left, MAPS_TOP - 8), found.name, 11))
        draw_map(picture, (left, MAPS_TOP), size, found.sure_bias_of_tiles.reshape(report.grid))
    map_scale(picture, (LEFT[0], HEIGHT - 26))


def _narrow(report: Comparison) -> tuple[float, float]:
    height = HEIGHT - MAPS_TOP - 44
    return height * report.resolution[0] / report.resolution[1], height
