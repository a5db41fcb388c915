"""What an autofocus saw, as a picture: the curve of contrast, or how the halves of the pupil parted."""

from __future__ import annotations

from collections.abc import Sequence

from rptcam_cl.autofocus.report import FocusReport, ProbeRecord
from rptcam_cl.errors import InputError
from rptcam_cl.lensview.chart import Axes, Key, draw_key, padded
from rptcam_cl.lensview.picture import INK, SERIES, Path, Picture, Text

WIDTH, HEIGHT = 960.0, 460.0
LEFT, RIGHT = (70.0, 46.0, 470.0, 350.0), (540.0, 46.0, 940.0, 350.0)
FEWEST = 3  # looks that make a curve
FEWEST_SHIFTS = 2  # looks that show which way the halves part


def focus_plot(report: FocusReport, title: str) -> Picture:
    """Return what an autofocus saw over the film distance.

    Contrast: on the left every look and on the right the last ones, each as a share of the greatest at the same stop.
    Phase: how far apart the halves of the pupil show the zone, zero where it is sharp; of the hybrid on the left, with
    its contrast on the right. Bars are standard errors.

    Raises
    ------
    InputError
        When a method has not looked often enough for a curve.
    """
    contrast = [probe for probe in report.probes if probe.quantity == "contrast"]
    shifts = [probe for probe in report.probes if probe.quantity == "displacement"]
    if len(contrast) < FEWEST and len(shifts) < FEWEST_SHIFTS:
        raise InputError(f"--plot: method {report.method} has no curve to draw (it looks {len(report.probes)} times)")
    picture = Picture(WIDTH, HEIGHT, title)
    picture.add(Text((LEFT[0], 28), title, 15))
    stops = sorted({probe.stop for probe in report.probes})
    colours = {stop: SERIES[k % len(SERIES)] for k, stop in enumerate(stops)}
    if shifts:
        _shifts(picture, LEFT, shifts, report, colours)
    else:
        _panel(picture, LEFT, contrast, report, colours)
    if len(contrast) >= FEWEST:
        last = max(probe.stop for probe in contrast)
        _panel(picture, RIGHT, [probe for probe in contrast if probe.stop == last], report, colours)
    keys = [Key("full aperture" if stop == 1 else f"{stop:.2g} of the aperture", colours[stop]) for stop in stops]
    draw_key(picture, [*keys, Key("found", INK, (5.0, 4.0))], HEIGHT - 46)
    return picture


def _shifts(
    picture: Picture,
    box: tuple[float, float, float, float],
    probes: Sequence[ProbeRecord],
    report: FocusReport,
    colours: dict[float, str],
) -> None:
    """Draw displacements of the halves, in the order of the looks."""
    places = [probe.film_distance_mm for probe in probes]
    ends = [probe.value + side * probe.error for probe in probes for side in (-1, 1)]
    axes = Axes(picture, box, padded([*places, report.film_distance_mm]), padded([*ends, 0.0]))
    axes.frame("film distance [mm]", "displacement of the halves [pixels]")
    axes.curve([report.film_distance_mm] * 2, axes.y_range, INK, (5.0, 4.0))
    axes.curve(axes.x_range, [0.0, 0.0], INK)
    for number, probe in enumerate(probes, 1):
        place, colour = probe.film_distance_mm, colours[probe.stop]
        bar = [axes.place(place, probe.value + side * probe.error) for side in (-1, 1)]
        picture.add(Path(bar, colour, 1.5))
        axes.dots([place], [probe.value], colour, 4.0)
        x, y = axes.place(place, probe.value)
        picture.add(Text((x + 8, y - 6), str(number), 12))


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
