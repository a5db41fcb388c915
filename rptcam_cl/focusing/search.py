"""The probes of a search: the task that a method is given, and what each probe measured."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import field

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.focusing.measures import Measure, Probe
from rptcam_cl.focusing.probe import Drive, Policy, Zone
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import FocusReport, NoContrast, ProbeRecord

NEAR = 8.0  # depths of focus to either side within which the focus is searched when it was found a moment ago


@dataclass(frozen=True)
class Task:
    """A camera to focus.

    Attributes
    ----------
    renderer : ProbeRenderer
    zones : tuple of Zone
    policy : Policy
        Which zone decides.
    seed : int
    near : float or None
        State near which the focus is expected; None for anywhere.
    on_probe : callable or None
        Called with every probe.
    """

    renderer: ProbeRenderer
    zones: tuple[Zone, ...]
    policy: Policy
    seed: int = 0
    near: float | None = None
    on_probe: Callable[[Probe], None] | None = None

    @property
    def drive(self) -> Drive:
        """What moves when the camera focuses."""
        return self.renderer.drive

    def probes(self, measure: Measure) -> Probes:
        """Return a search of the zones with a measure, with no probe so far."""
        return Probes(self.renderer, self.zones, measure, self.seed, self.on_probe)

    def near_place(self, probes: Probes) -> tuple[float, float] | None:
        """Return where the focus is expected and how far to either side of it to search [mm]."""
        return None if self.near is None else (probes.place_of(self.near), NEAR * self.drive.depth_of_focus)

    def report(
        self, method: str, state: float, zone: Zone, error: float, confidence: float, probes: list[ProbeRecord]
    ) -> FocusReport:
        """Return the report of a focus that was found."""
        drive = self.drive
        return FocusReport(
            method=method,
            state=state,
            film_distance_mm=drive.film_distance(state),
            focus_distance_m=drive.object_distance(state, zone),
            confidence=confidence,
            error=error,
            depth_of_focus_mm=drive.depth_of_focus,
            zone=zone,
            zones=self.zones,
            probes=probes,
        )


def within(tolerance: float, error: float) -> float:
    """Return the probability that a normal error of a standard deviation stays within a tolerance."""
    return math.erf(tolerance / (math.sqrt(2) * error)) if error > 0 else 1.0


MOST_PROBES = 40  # after which a search gives up


@dataclass
class Probes:
    """A camera to probe, and every probe so far.

    Attributes
    ----------
    renderer : ProbeRenderer
    zones : sequence of Zone
    measure : Measure
    seed : int
        Of every probe: their noise is alike, so that differences between states are seen through it.
    on_probe : callable or None
        Called with every probe.
    """

    renderer: ProbeRenderer
    zones: Sequence[Zone]
    measure: Measure
    seed: int = 0
    on_probe: Callable[[Probe], None] | None = None
    made: list[Probe] = field(default_factory=list)

    @property
    def drive(self) -> Drive:
        """What moves when the camera focuses."""
        return self.renderer.drive

    @property
    def ends(self) -> tuple[float, float]:
        """Lowest and highest place."""
        sense = self.drive.nearer
        low, high = sorted(sense * self.drive.coordinate(state) for state in self.drive.limits)
        return low, high

    def state_of(self, place: float) -> float:
        """Return the focus state of a place."""
        low, high = self.drive.limits
        return min(max(self.drive.state_at(self.drive.nearer * place), low), high)

    def place_of(self, state: float) -> float:
        """Return the place of a focus state."""
        return self.drive.nearer * self.drive.coordinate(state)

    def at(self, place: float, samples: int, stop: float = 1.0, reference: float | None = None) -> Probe:
        """Probe a place; the zones are given in the place of reference (see `ProbeRenderer.measure`).

        Raises
        ------
        NoContrast
            After more probes than a search ever needs.
        """
        if len(self.made) >= MOST_PROBES:
            raise NoContrast(f"no focus found in the zone after {MOST_PROBES} probes")
        begun = time.perf_counter()
        fixed = None if reference is None else self.state_of(reference)
        images = self.renderer.measure(self.state_of(place), self.zones, samples, self.seed, stop, fixed)
        pixels = sum(image.parts.shape[1] * image.parts.shape[2] for image in images)
        found = [self.measure.of(image) for image in images]
        scale = self.drive.image_scale(self.state_of(place), self.state_of(self.ends[0]) if fixed is None else fixed)
        probe = Probe(place, stop, reference, scale, found, pixels * images[0].samples, time.perf_counter() - begun)
        self.made.append(probe)
        if self.on_probe is not None:
            self.on_probe(probe)
        return probe

    def records(self, zone: int) -> list[ProbeRecord]:
        """Return what each probe measured in one zone."""
        return [self._record(probe, zone) for probe in self.made]

    def _record(self, probe: Probe, zone: int) -> ProbeRecord:
        state, found = self.state_of(probe.place), probe.found[zone]
        return ProbeRecord(
            state, self.drive.film_distance(state), found.value, found.error, probe.stop, probe.samples, probe.seconds
        )
