"""What an autofocus found and what it took, as data and as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, field, replace
from typing import Any, Literal

from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.probe import Zone
from rptcam_cl.lenstools import INK, SERIES, Axes, Drawing, Legend, Path, Text, draw_key, padded


class NoContrast(InputError):  # noqa: N818  (a refusal, as photographers call it)
    """Nothing in the zone tells focus from blur; the camera stays as it was."""


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
        Measure and its standard error, of the zone that decided.
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
        The zone that decided.
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
        """Return the same focus, kept for want of a better one."""
        failure = f"{why}; the focus of the frame before is kept"
        return replace(self, confidence=0.0, probes=[], notes={"kept": True}, failure=failure, remarks=())

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values, with ``probes`` as pairs of film distance and measure."""
        plain = asdict(self)
        plain["probes"] = [[probe.film_distance_mm, probe.value] for probe in self.probes]
        plain["details"] = [asdict(probe) for probe in self.probes]
        plain["samples"], plain["seconds"] = self.samples, self.seconds
        return plain


WIDTH, HEIGHT = 960.0, 460.0
LEFT, RIGHT = (70.0, 46.0, 470.0, 350.0), (540.0, 46.0, 940.0, 350.0)
FEWEST = 3  # looks that make a curve
FEWEST_SHIFTS = 2  # looks that show which way the halves part


def focus_plot(report: FocusReport, title: str) -> Drawing:
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
    picture = Drawing(WIDTH, HEIGHT, title)
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
    keys = [Legend("full aperture" if stop == 1 else f"{stop:.2g} of the aperture", colours[stop]) for stop in stops]
    draw_key(picture, [*keys, Legend("found", INK, (5.0, 4.0))], HEIGHT - 46)
    return picture


def _shifts(
    picture: Drawing,
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
    picture: Drawing,
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
