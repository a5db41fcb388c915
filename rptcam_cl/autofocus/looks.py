"""The looks of a search: what they measured in every zone, and what they cost."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from rptcam_cl.autofocus.measures import Measure, Measured
from rptcam_cl.autofocus.probe import FocusProbe, Zone
from rptcam_cl.autofocus.report import NoContrast, ProbeRecord

MOST_LOOKS = 40  # after which a search gives up


@dataclass(frozen=True)
class Look:
    """One look.

    Attributes
    ----------
    place : float
        Coordinate [mm], see `FocusProbe`; rising towards nearer objects.
    stop : float
        Share of the opening's diameter.
    found : list of Measured
        Of each zone.
    reference : float or None
        Place in which the zones lie where they say; None where the film was not scaled with the image.
    scale : float
        Of the image against that place, or else against the lowest one.
    samples : int
        Of all pixels of all zones.
    seconds : float
    """

    place: float
    stop: float
    reference: float | None
    scale: float
    found: list[Measured]
    samples: int
    seconds: float


@dataclass
class Looks:
    """A camera to look through, and every look so far.

    Attributes
    ----------
    probe : FocusProbe
    zones : sequence of Zone
    measure : Measure
    seed : int
        Of every look: their noise is alike, so that differences between states are seen through it.
    on_look : callable or None
        Told of every look.
    """

    probe: FocusProbe
    zones: Sequence[Zone]
    measure: Measure
    seed: int = 0
    on_look: Callable[[Look], None] | None = None
    made: list[Look] = field(default_factory=list)

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest place."""
        sense = self.probe.nearer
        low, high = sorted(sense * self.probe.coordinate(state) for state in self.probe.limits)
        return low, high

    def state_of(self, place: float) -> float:
        """Return the focus state of a place."""
        low, high = self.probe.limits
        return min(max(self.probe.state_at(self.probe.nearer * place), low), high)

    def place_of(self, state: float) -> float:
        """Return the place of a focus state."""
        return self.probe.nearer * self.probe.coordinate(state)

    def at(self, place: float, samples: int, stop: float = 1.0, reference: float | None = None) -> Look:
        """Look; the zones lie where they say in the place of reference (see `FocusProbe.measure`).

        Raises
        ------
        NoContrast
            After more looks than a search ever needs.
        """
        if len(self.made) >= MOST_LOOKS:
            raise NoContrast(f"no focus found in the zone after {MOST_LOOKS} looks")
        begun = time.perf_counter()
        fixed = None if reference is None else self.state_of(reference)
        images = self.probe.measure(self.state_of(place), self.zones, samples, self.seed, stop, fixed)
        pixels = sum(image.parts.shape[1] * image.parts.shape[2] for image in images)
        found = [self.measure.of(image) for image in images]
        scale = self.probe.image_scale(self.state_of(place), self.state_of(self.ends[0]) if fixed is None else fixed)
        look = Look(place, stop, reference, scale, found, pixels * images[0].samples, time.perf_counter() - begun)
        self.made.append(look)
        if self.on_look is not None:
            self.on_look(look)
        return look

    def records(self, zone: int) -> list[ProbeRecord]:
        """Return what was seen in one zone, look by look."""
        return [self._record(look, zone) for look in self.made]

    def _record(self, look: Look, zone: int) -> ProbeRecord:
        state, found = self.state_of(look.place), look.found[zone]
        return ProbeRecord(
            state, self.probe.film_distance(state), found.value, found.error, look.stop, look.samples, look.seconds
        )
