"""Three pictures of a comparison in one: error against time, error over the field, and where pictures differ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rptcam_cl.lenstools import FAINT, INK, add_key, new_figure, series, styled
from rptcam_cl.tradeoff.comparison import Comparison
from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.tiers.errors import FIELDS
from rptcam_cl.tradeoff.words import seconds

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

WIDTH, CHARTS, MAPS = 8.0, 4.8, 1.3  # of the plot, its charts and the frame of its maps [inches]
WIDTHS = (3, 2)  # of the charts, one to the other
MOST_MAPS = 4
LOW, HIGH = 0.003, 1.0  # differences between which the shade of a map changes, by logarithm
POINTS = 200  # of a curve
FINEST, COARSEST = 0.005, 3.0  # errors that the chart reaches from the one to the other, about
# Colours after those of `series`, so that no two curves share one.
MORE = ("#e377c2", "#8c564b", "#6fb7ff", "#a7c957", "#000000", "#ffa62b", "#7a0c2e", "#a9a2e8", "#63d2a1", "#c9ada7")
DASHES = {"thick_lens": "--"}  # which often lies on the thin lens's curve


@styled()
def tradeoff_plot(report: Comparison, title: str) -> Figure:
    """Return the three pictures.

    On the left is the root of relMSE over time, one line for each configuration. A line becomes level where it reaches
    its bias; noise falls along the dotted guide. A dot marks where a line crosses that of the most accurate one. On the
    right is how far cheaper cameras displace light. Below are maps, tile by tile, of the configurations that differ
    most; those that are advised come first.
    """
    shown = _most_biased(report)
    columns, rows = report.resolution
    height = MAPS + min(WIDTH / MOST_MAPS * rows / columns, WIDTH / 2) if shown else 0.0
    figure = new_figure(title, (WIDTH, CHARTS + height))
    rooms = figure.subfigures(1 + bool(shown), 1, squeeze=False, height_ratios=(CHARTS, height)[: 1 + bool(shown)])
    charts = rooms[0, 0]
    if shown:
        _draw_maps(rooms[1, 0], report, shown)
    left, right = charts.subplots(1, 2, width_ratios=WIDTHS)
    different = [*dict.fromkeys(map(series, range(len(MORE)))), *MORE]
    colours = {found.name: different[number % len(different)] for number, found in enumerate(report.measurements)}
    _errors_over_time(left, report.measurements, colours)
    _errors_over_field(right, report, colours)
    add_key(charts, left.lines)
    return figure


def _errors_over_time(axes: Axes, found: Sequence[Measurement], colours: dict[str, str]) -> None:
    """Draw a curve for each configuration, with its band, and where it meets the most accurate one."""
    full = found[0].rate.value or found[0].sample_s.value  # an even picture has no noise
    first, last = _decades(full, full / FINEST**2)  # from an error of 100 % of the most accurate one
    low, high = _decades(FINEST / 5, COARSEST)
    times = np.geomspace(first, last, POINTS)
    curves = {each.name: _error(each, times) for each in found}
    axes.set(title="error over time, with bands of 95 %", xlabel="time to render the picture",
             ylabel="error: root of relMSE [%]", xscale="log", yscale="log", xlim=(first, last),
             ylim=(100 * low, 100 * high))  # fmt: skip
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda value, _: seconds(value))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    for number, each in enumerate(found):
        colour, line = colours[each.name], "-" if colours[each.name] not in list(colours.values())[:number] else "--"
        band = [100 * np.maximum(_error(each, times, end), low / 10) for end in ("low", "high")]
        axes.fill_between(times, *band, color=colour, alpha=0.16, linewidth=0)
        axes.plot(times, 100 * np.maximum(curves[each.name], low / 10), line, color=colour, label=each.name)
    guide = first * 10.0 ** np.array([0.3, 2.3])
    axes.plot(guide, 100 * low * np.array([25.0, 2.5]), ":", color=FAINT, label="slope of noise")
    for each in found:
        meets = each.better_until.value
        if each.knob and first < meets < last:
            axes.scatter([meets], 100 * _error(each, np.array([meets])), color=colours[each.name], zorder=3)
    _beside_the_chart(axes, curves, (low, high))


def _beside_the_chart(axes: Axes, curves: dict[str, np.ndarray], shown: tuple[float, float]) -> None:
    """Say which curves lie wholly above or below the chart."""
    for where, place, out in (
        ("above", 0.97, {name for name, curve in curves.items() if (curve > shown[1]).all()}),
        ("below", 0.03, {name for name, curve in curves.items() if (curve < shown[0]).all()}),
    ):
        if out:
            names = "all" if len(out) == len(curves) else ", ".join(name for name in curves if name in out)
            words, edge = f"{where} the chart: {names}", "top" if where == "above" else "bottom"
            axes.text(0.98, place, words, color=FAINT, transform=axes.transAxes, horizontalalignment="right",
                      verticalalignment=edge)  # fmt: skip


def _decades(low: float, high: float) -> tuple[float, float]:
    """Return the powers of ten, two different ones, that hold a range."""
    first = math.floor(math.log10(low))
    return 10.0**first, 10.0 ** max(math.ceil(math.log10(high)), first + 1)


def _error(found: Measurement, times: np.ndarray, end: str = "value") -> np.ndarray:
    """Return the root of relMSE after times, with bias and noise at an end of their intervals."""
    floor = 0.0 if found.unbiased or not found.knob else max(getattr(found.bias, end), 0.0)
    return np.asarray(np.sqrt(floor + found.law(end).even(times / found.sample_s.value)))


def _errors_over_field(axes: Axes, report: Comparison, colours: dict[str, str]) -> None:
    cameras = [each for each in report.cameras if each.tier != "realistic"]
    axes.set(title="error of cheaper cameras", xlim=(0.0, 1.0), xlabel="film point, share of half diagonal",
             ylabel="light beside its place [pixels]")  # fmt: skip
    if not cameras:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "The camera has\nno cheaper model.", color=FAINT, transform=axes.transAxes,
                  horizontalalignment="center")  # fmt: skip
        return
    axes.axhline(0.5, color=FAINT, linestyle="--", linewidth=1.2)
    for each in cameras:
        colour = colours.get(each.tier.replace("_", " "), INK)
        pixels = [value if math.isfinite(value) else math.nan for value in each.pixels]
        axes.plot(FIELDS, pixels, DASHES.get(each.tier, "-"), marker="o", markersize=4, color=colour)
    if any(math.isinf(value) for each in cameras for value in each.pixels):
        axes.text(0.03, 0.97, "a line ends where\nthe lens sees nothing", color=FAINT, transform=axes.transAxes,
                  verticalalignment="top")  # fmt: skip
    axes.set_ylim(0.0, max(1.08, axes.get_ylim()[1]))


def _most_biased(report: Comparison) -> list[Measurement]:
    """Return the configurations that get a map: those that are advised, then those that differ most."""
    biased = [found for found in report.measurements if found.knob and not found.unbiased]
    chosen = {advice.chosen for advice in report.advice}
    return sorted(biased, key=lambda found: (found.name in chosen, found.bias.value), reverse=True)[:MOST_MAPS]


def _draw_maps(figure: SubFigure, report: Comparison, shown: Sequence[Measurement]) -> None:
    """Draw how much each tile of the pictures differs, all in the same shades."""
    from matplotlib.colors import LogNorm

    figure.suptitle("where pictures differ from the most accurate one (white: it may be noise)", fontsize=10,
                    x=0.01, horizontalalignment="left")  # fmt: skip
    panels = figure.subplots(1, MOST_MAPS)
    columns, rows = report.resolution
    for axes, found in zip(panels, shown, strict=False):
        bias = np.sqrt(np.maximum(found.sure_bias_of_tiles.reshape(report.grid), LOW**2))
        image = axes.imshow(100 * bias, cmap="BuPu", norm=LogNorm(100 * LOW, 100 * HIGH, clip=True),
                            extent=(0, columns, rows, 0), interpolation="nearest")  # fmt: skip
        axes.set_title(found.name)
        axes.set(xticks=(), yticks=())
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    label = "root of relMSE of a tile [%]"
    ticks = (0.3, 1, 3, 10, 30, 100)
    figure.colorbar(image, ax=panels, label=label, ticks=ticks, format="%g", orientation="horizontal", aspect=50)
