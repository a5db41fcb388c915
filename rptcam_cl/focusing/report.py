"""What an autofocus found and what it took: as data, and drawn over the film distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple, field, replace
from typing import TYPE_CHECKING, Any, Literal

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.probe import Zone
from rptcam_cl.lenstools import INK, add_key, new_figure, series, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class NoContrast(InputError):  # noqa: N818  (a refusal, as photographers call it)
    """Focus and blur cannot be distinguished in the zone; the camera stays as it was."""


class OutOfReach(InputError):  # noqa: N818  (the same)
    """What the zone shows is nearer than the camera can focus, or farther.

    Attributes
    ----------
    state : float
        The end of the focus that comes nearest to it.
    zone : Zone
        What shows it.
    """

    def __init__(self, message: str, state: float, zone: Zone) -> None:
        super().__init__(message)
        self.state, self.zone = state, zone


@dataclass(frozen=True)
class ProbeRecord:
    """One probe through the lens.

    Attributes
    ----------
    state : float
        Focus state, see `Drive`.
    film_distance_mm : float
        Distance to the film in that state.
    value, error : float
        Measure and its standard error, of the chosen zone.
    stop : float
        Share of the opening's diameter.
    samples : int
        Of all pixels of all zones.
    seconds : float
        Wall clock.
    quantity : str
        What the value is: a contrast, the displacement of the pupil's halves [pixels], or a distance [m].
    """

    state: float
    film_distance_mm: float
    value: float
    error: float
    stop: float
    samples: int
    seconds: float
    quantity: Literal["contrast", "displacement", "distance"] = "contrast"


@dataclass(frozen=True)
class FocusReport:
    """The focus that was found.

    Attributes
    ----------
    method : str
    state : float
        Focus state, see `Drive`.
    film_distance_mm : float
        Last vertex (thin lens: lens) to film.
    focus_distance_m : float or None
        Plane in focus to film by first-order optics (thin lens: to the lens); None where none is.
    confidence : float
        Probability, from 0 to 1, that the state lies within a quarter of the depth of focus of where the measure is
        greatest, as far as noise is concerned.
    error : float
        Standard error of the state's coordinate [mm], from noise.
    depth_of_focus_mm : float
        2 N c along the coordinate.
    zone : Zone
        The chosen zone.
    zones : tuple of Zone
        All of them.
    probes : list of ProbeRecord
        In the order in which they were made.
    notes : dict
        What else the method has to say.
    failure : str or None
        Why the zone cannot be relied on to be in focus; None where it can.
    remarks : tuple of str
        What a photographer should know of the zone all the same.
    """

    method: str
    state: float
    film_distance_mm: float
    focus_distance_m: float | None
    confidence: float
    error: float
    depth_of_focus_mm: float
    zone: Zone
    zones: tuple[Zone, ...] = ()
    probes: list[ProbeRecord] = field(default_factory=list)
    notes: dict[str, Any] = field(default_factory=dict)
    failure: str | None = None
    remarks: tuple[str, ...] = ()

    @property
    def warnings(self) -> list[str]:
        """The failure and the remarks."""
        return [*(() if self.failure is None else (self.failure,)), *self.remarks]

    @property
    def samples(self) -> int:
        """Samples that all probes took together."""
        return sum(probe.samples for probe in self.probes)

    @property
    def seconds(self) -> float:
        """Time that all probes took together [s]."""
        return sum(probe.seconds for probe in self.probes)

    def summary(self) -> dict[str, Any]:
        """Return what a picture's metadata should say."""
        return {
            "method": self.method,
            "film_distance_mm": self.film_distance_mm,
            "focus_distance_m": self.focus_distance_m,
            "confidence": self.confidence,
            "failure": self.failure,
            "warnings": self.warnings,
            "zone": list(astuple(self.zone)),
            "probes": len(self.probes),
            "samples": self.samples,
        }

    def kept(self, why: InputError) -> FocusReport:
        """Return the same focus, kept because no better one was found."""
        failure = f"{why}; the focus of the frame before is kept"
        return replace(self, confidence=0.0, probes=[], notes={"kept": True}, failure=failure, remarks=())

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, with ``probes`` as pairs of film distance and measure."""
        plain = asdict(self)
        plain["probes"] = [[probe.film_distance_mm, probe.value] for probe in self.probes]
        plain["details"] = [asdict(probe) for probe in self.probes]
        plain["samples"], plain["seconds"] = self.samples, self.seconds
        return plain


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
