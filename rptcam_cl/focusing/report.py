"""What an autofocus found and what it took, as data."""

from __future__ import annotations

from dataclasses import asdict, astuple, dataclass, field, replace
from typing import Any, Literal

from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.probe import Zone


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
