"""The curve of contrast that an autofocus saw, as a picture."""

from __future__ import annotations

from collections.abc import Sequence

from rptcam_cl.autofocus.report import FocusReport, ProbeRecord
from rptcam_cl.errors import InputError
from rptcam_cl.lensview.chart import Axes, Key, draw_key, padded
from rptcam_cl.lensview.picture import INK, SERIES, Path, Picture, Text

WIDTH, HEIGHT = 960.0, 460.0
LEFT, RIGHT = (70.0, 46.0, 470.0, 350.0), (540.0, 46.0, 940.0, 350.0)
FEWEST = 3  # looks that make a curve


def focus_plot(report: FocusReport, title: str) -> Picture:
    """Return the measure over the film distance, on the left of every look and on the right of the last ones.

    Each look's measure is shown as a share of the greatest at the same stop, with its standard error.

    Raises
    ------
    InputError
        When a method has not looked often enough for a curve.
    """
    if report.method in ("phase", "hybrid"):
        raise InputError(f"--plot: method {report.method} has no curve to draw (it looks at displacements)")
    if len(report.probes) < FEWEST:
        raise InputError(f"--plot: method {report.method} has no curve to draw (it looks {len(report.probes)} times)")
    stops = sorted({probe.stop for probe in report.probes})
    colours = {stop: SERIES[k % len(SERIES)] for k, stop in enumerate(stops)}
    last = [probe for probe in report.probes if probe.stop == stops[-1]]
    picture = Picture(WIDTH, HEIGHT, title)
    picture.add(Text((LEFT[0], 28), title, 15))
    _panel(picture, LEFT, report.probes, report, colours)
    _panel(picture, RIGHT, last, report, colours)
    keys = [Key("full aperture" if stop == 1 else f"{stop:.2g} of the aperture", colours[stop]) for stop in stops]
    draw_key(picture, [*keys, Key("found", INK, (5.0, 4.0))], HEIGHT - 46)
    return picture


def _panel(
    picture: Picture,
    box: tuple[float, float, float, float],
    probes: Sequence[ProbeRecord],
    report: FocusReport,
    colours: dict[float, str],
) -> None:
    greatest = {
        stop: max((probe.value for probe in probes if probe.stop == stop), default=1.0) or 1.0 for stop in colours
    }
    shares = [probe.value / greatest[probe.stop] for probe in probes]
    places = [probe.film_distance_mm for probe in probes]
    axes = Axes(picture, box, padded([*places, report.film_distance_mm]), padded([*shares, 0.0, 1.05]))
    axes.frame("film distance [mm]", "measure, share of the greatest")
    axes.curve([report.film_distance_mm] * 2, axes.y_range, INK, (5.0, 4.0))
    for stop, colour in colours.items():
        rows = sorted(
            (place, share, probe.error / greatest[stop])
            for place, share, probe in zip(places, shares, probes, strict=True)
            if probe.stop == stop
        )
        if not rows:
            continue
        axes.curve([row[0] for row in rows], [row[1] for row in rows], colour)
        for place, share, error in rows:
            ends = (max(share - error, axes.y_range[0]), min(share + error, axes.y_range[1]))
            picture.add(Path([axes.place(place, end) for end in ends], colour, 1.5))
        axes.dots([row[0] for row in rows], [row[1] for row in rows], colour, 3.0)
