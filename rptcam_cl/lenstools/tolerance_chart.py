"""The chart of a tolerance run: how many copies are good enough, and which tolerances cost most."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rptcam_cl.lenstools.charts import new_figure, series, styled
from rptcam_cl.lenstools.colours import FAINT, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rptcam_cl.tolerances import ToleranceRun

SIZE = (8.0, 7.6)  # inches
OFFENDERS = 10
LIMITS = 101


@styled()
def tolerance_chart(run: ToleranceRun) -> Figure:
    """Return the yield curve with its 95 % band, above the worst offenders."""
    tolerances = f" within {run.tolerances.name} tolerances" if run.tolerances.name else ""
    figure = new_figure(f"{run.lens.name}: {run.copies.count} copies{tolerances}", SIZE)
    parts = figure.subfigures(2, 1, squeeze=False, height_ratios=(5, 4))
    _draw_yield(parts[0, 0].add_subplot(), run)
    _draw_offenders(parts[1, 0].add_subplot(), run)
    return figure


def _draw_yield(axes: Axes, run: ToleranceRun) -> None:
    from rptcam_cl.tolerances import yield_curve  # of this chart alone

    scale, unit = _scale(run)
    curve = yield_curve(run, LIMITS)
    limits = scale * np.array([limit for limit, _ in curve])
    value, low, high = (100 * np.array(row) for row in zip(*(found for _, found in curve), strict=True))
    axes.fill_between(limits, low, high, color=series(0), alpha=0.2, linewidth=0)
    axes.plot(limits, value, color=series(0))
    design = scale * float(run.design.by(run.rank_by)[0])
    axes.axvline(design, color=FAINT, linestyle=":")
    axes.text(design, 93, " design", color=INK)
    side = "or less" if run.rank_by == "spot" else "or more"
    axes.set(xlabel=f"{unit}, {side}", ylabel="copies [%]", ylim=(0, 102))


def _draw_offenders(axes: Axes, run: ToleranceRun) -> None:
    scale, _ = _scale(run)
    change = "spot with one tolerance at its limit, less the design's [µm]"
    if run.rank_by != "spot":
        change = "modulation with one tolerance at its limit, less the design's [%]"
    worst = run.worst_offenders(OFFENDERS)[::-1]
    changes = [scale * (one.spot_change_um if run.rank_by == "spot" else one.mtf_change) for one in worst]
    axes.barh([f"{one.label}, {one.direction}" for one in worst], changes, color=series(1))
    axes.set(xlabel=change)
    axes.tick_params(axis="y", labelsize=8)
    axes.grid(False, axis="y")


def _scale(run: ToleranceRun) -> tuple[float, str]:
    if run.rank_by == "spot":
        return 1.0, "rms spot over the fields [µm]"
    return 100.0, f"modulation at {run.tolerances.merit.mtf_per_mm:g} cycles/mm [%]"
