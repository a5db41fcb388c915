"""What an autofocus saw over the film distance, as a plot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.report import FocusReport, ProbeRecord
from rptcam_cl.lenstools import INK, add_key, new_figure, series, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (8.0, 4.6)  # [inches]
FEWEST = 3  # probes that make a curve
FEWEST_SHIFTS = 2  # probes that show which way the halves part


@styled()
def focus_plot(report: FocusReport, title: str) -> Figure:
    """Return what an autofocus saw over the film distance.

    Contrast: on the left every probe and on the right the last ones, each as a share of the greatest at the same stop.
    Phase: how far apart the halves of the pupil show the zone, zero where it is sharp; of the hybrid on the left, with
    its contrast on the right. Bars are standard errors.

    Raises
    ------
    InputError
        When a method has not probed often enough for a curve.
    """
    from matplotlib.lines import Line2D

    contrast = [probe for probe in report.probes if probe.quantity == "contrast"]
    shifts = [probe for probe in report.probes if probe.quantity == "displacement"]
    if len(contrast) < FEWEST and len(shifts) < FEWEST_SHIFTS:
        raise InputError(f"--plot: method {report.method} has no curve to draw (it looks {len(report.probes)} times)")
    stops = sorted({probe.stop for probe in report.probes})
    colours = {stop: series(number) for number, stop in enumerate(stops)}
    figure = new_figure(title, SIZE)
    panels = figure.subplots(1, 1 + (len(contrast) >= FEWEST), squeeze=False)[0]
    if shifts:
        _draw_shifts(panels[0], shifts, colours)
    else:
        _draw_contrast(panels[0], contrast, colours)
    if len(contrast) >= FEWEST:
        last = max(probe.stop for probe in contrast)
        _draw_contrast(panels[1], [probe for probe in contrast if probe.stop == last], colours)
        panels[1].set_title("all probes of contrast" if shifts else "the last probes")
        panels[0].set_title("displacement, in the order of the probes" if shifts else "all probes")
    for axes in panels:
        axes.axvline(report.film_distance_mm, color=INK, linestyle="--", linewidth=1.2)
        axes.set_xlabel("film distance [mm]")
    labels = {stop: "full aperture" if stop == 1 else f"{stop:.2g} of the aperture" for stop in stops}
    keys = [Line2D([], [], color=colours[stop], marker="o", label=label) for stop, label in labels.items()]
    add_key(figure, [*keys, Line2D([], [], color=INK, linestyle="--", label="found")])
    return figure


def _draw_shifts(axes: Axes, probes: Sequence[ProbeRecord], colours: dict[float, str]) -> None:
    """Draw displacements of the halves, numbered in the order of the probes."""
    axes.set_ylabel("displacement of the halves [pixels]")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.margins(0.12)
    for number, probe in enumerate(probes, 1):
        place, colour = (probe.film_distance_mm, probe.value), colours[probe.stop]
        axes.errorbar(*place, yerr=probe.error, fmt="o", color=colour)
        axes.annotate(str(number), place, xytext=(7, 5), textcoords="offset points")


def _draw_contrast(axes: Axes, probes: Sequence[ProbeRecord], colours: dict[float, str]) -> None:
    """Draw a curve for each stop, in shares of its greatest value."""
    axes.set_ylabel("measure, of the greatest [%]")
    for stop, colour in colours.items():
        own = sorted((probe for probe in probes if probe.stop == stop), key=lambda probe: probe.film_distance_mm)
        scale = 100 / (max((probe.value for probe in own), default=1.0) or 1.0)
        places = [probe.film_distance_mm for probe in own]
        values, errors = ([scale * amount for amount in amounts]
                          for amounts in ([probe.value for probe in own], [probe.error for probe in own]))  # fmt: skip
        axes.errorbar(places, values, yerr=errors, fmt="o-", markersize=4, color=colour)
    axes.set_ylim(0.0, 112.0)
