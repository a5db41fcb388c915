"""The looks of a search: what a method is given, what each look measured, and the top of the curve."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.focusing.measures import Measure, Measured
from rptcam_cl.focusing.probe import FocusProbe, Policy, Zone
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import FocusReport, NoContrast, ProbeRecord
from rptcam_cl.scene import AutoFocus, LensCamera, Scene, ThinLensCamera

NEAR = 8.0  # depths of focus to either side within which the focus is sought when it was found a moment ago


@dataclass(frozen=True)
class Task:
    """A camera to focus.

    Attributes
    ----------
    probe : ProbeRenderer
    zones : tuple of Zone
    policy : Policy
        Which zone decides.
    seed : int
    near : float or None
        State near which the focus is expected; None for anywhere.
    on_look : callable or None
        Told of every look.
    """

    probe: ProbeRenderer
    zones: tuple[Zone, ...]
    policy: Policy
    seed: int = 0
    near: float | None = None
    on_look: Callable[[Probe], None] | None = None

    def looks(self, measure: Measure) -> Probes:
        """Return looks at the zones with a measure."""
        return Probes(self.probe, self.zones, measure, self.seed, self.on_look)

    def near_place(self, looks: Probes) -> tuple[float, float] | None:
        """Return where the focus is expected and how far from there to look [mm]."""
        return None if self.near is None else (looks.place_of(self.near), NEAR * self.probe.depth_of_focus)

    def report(
        self, method: str, state: float, zone: Zone, error: float, confidence: float, probes: list[ProbeRecord]
    ) -> FocusReport:
        """Return the account of a focus that was found."""
        probe = self.probe
        return FocusReport(
            method=method,
            state=state,
            film_distance_mm=probe.film_distance(state),
            focus_distance_m=probe.object_distance(state, zone),
            confidence=confidence,
            error=error,
            depth_of_focus_mm=probe.depth_of_focus,
            zone=zone,
            zones=self.zones,
            probes=probes,
        )


def within(tolerance: float, error: float) -> float:
    """Return the probability that a normal error of a standard deviation stays within a tolerance."""
    return math.erf(tolerance / (math.sqrt(2) * error)) if error > 0 else 1.0


def wanted(scene: Scene) -> AutoFocus | None:
    """Return the autofocus that a scene asks for, if it does."""
    camera = scene.camera
    if isinstance(camera, LensCamera):
        return camera.focus.auto
    return camera.focus.auto if isinstance(camera, ThinLensCamera) and camera.focus is not None else None


Array = NDArray[np.float64]

DETAIL = 1.5  # power of the image scale by which the contrast between pixels falls: 1 to 2 for natural textures
FLOOR = 0.02  # of the greatest measure: smaller ones say no more than that they are small


@dataclass(frozen=True)
class Peak:
    """The top of a curve.

    Attributes
    ----------
    place : float
        Where it is [mm].
    error : float
        Its standard error, from noise.
    width : float
        Distance from it at which the measure is half of its greatest; infinite for a flat curve.
    rise : float
        By how many of its standard errors the greatest measure exceeds the least.
    inside : bool
        Whether the greatest measure has lesser ones on both sides.
    """

    place: float
    error: float
    width: float
    rise: float
    inside: bool


def peak_of(looks: Sequence[Probe], zone: int) -> Peak:
    """Return the top of the curve through some looks at one stop, for one zone.

    A blur of diameter b takes the share 1 / (1 + (b / b0)^2) or so of the contrast of a texture of many scales, and b
    grows evenly with the distance from the focus. So a parabola is laid through the *reciprocal* of the measure, at the
    greatest and its neighbours. The error is that of the jackknife over the parts, which the looks have in common.

    Where the film is scaled with the image, the blur grows evenly on that film with d / scale, d being the distance
    from the place of reference; as the scale is 1 + k d, the parabola is laid over d / (1 + k d). Where it is not, the
    details that pixels see shrink as the image grows.
    """
    looks = sorted(looks, key=lambda look: look.place)
    scale = np.array([look.scale for look in looks])
    is_scaled = looks[0].reference is not None
    origin = looks[0].reference or 0.0
    away = np.array([look.place for look in looks]) - origin
    growth = _growth(away, scale) if is_scaled else 0.0
    places = away / (1 + growth * away)
    gain = np.ones_like(scale) if is_scaled else scale**DETAIL
    values = gain * [look.found[zone].value for look in looks]
    without = gain[:, None] * [look.found[zone].leave_one_out for look in looks]
    top = int(values.argmax())
    inside = 0 < top < len(looks) - 1
    three = np.arange(max(min(top - 1, len(looks) - 3), 0), min(max(top + 2, 3), len(looks)))
    place, width = _vertex(places[three], values[three])
    others = np.array([_vertex(places[three], values)[0] for values in without[three].T])
    error = _spread(others)
    bottom = int(values.argmin())
    difference = _spread(without[top] - without[bottom])
    rise = float((values[top] - values[bottom]) / difference) if difference > 0 else np.inf
    unscaled = 1 - growth * place
    return Peak(
        origin + place / unscaled, error / unscaled**2, width, rise if values[top] > values[bottom] else 0.0, inside
    )


def _growth(away: Array, scale: Array) -> float:
    """Return by how much the scale grows with the distance from the place of reference [1/mm]."""
    farthest = int(np.abs(away).argmax())
    return float((scale[farthest] - 1) / away[farthest]) if away[farthest] else 0.0


def _spread(without: Array) -> float:
    """Return the standard error of a statistic from its values without each of the parts."""
    count = len(without)
    return float(np.sqrt((count - 1) / count * np.square(without - without.mean()).sum()))


def _vertex(places: Array, values: Array) -> tuple[float, float]:
    """Return where the reciprocal of three values is least, not beyond the places, and the half width there."""
    top = int(values.argmax())
    if len(places) < 3 or not values[top] > 0:
        return float(places[top]), np.inf
    middle, reach = places[top], float(np.ptp(places))
    reciprocal = values[top] / np.maximum(values, FLOOR * values[top])
    a, b, c = np.linalg.solve(np.vander((places - middle) / reach, 3), reciprocal)
    if not a > 0:
        return float(middle), np.inf
    at = float(np.clip(middle - reach * b / (2 * a), places.min(), places.max()))
    least = max(c - b * b / (4 * a), 1e-6)
    return at, reach * float(np.sqrt(least / a))


MOST_LOOKS = 40  # after which a search gives up


@dataclass(frozen=True)
class Probe:
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
class Probes:
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
    on_look: Callable[[Probe], None] | None = None
    made: list[Probe] = field(default_factory=list)

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

    def at(self, place: float, samples: int, stop: float = 1.0, reference: float | None = None) -> Probe:
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
        look = Probe(place, stop, reference, scale, found, pixels * images[0].samples, time.perf_counter() - begun)
        self.made.append(look)
        if self.on_look is not None:
            self.on_look(look)
        return look

    def records(self, zone: int) -> list[ProbeRecord]:
        """Return what was seen in one zone, look by look."""
        return [self._record(look, zone) for look in self.made]

    def _record(self, look: Probe, zone: int) -> ProbeRecord:
        state, found = self.state_of(look.place), look.found[zone]
        return ProbeRecord(
            state, self.probe.film_distance(state), found.value, found.error, look.stop, look.samples, look.seconds
        )
