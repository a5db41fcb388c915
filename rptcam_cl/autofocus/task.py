"""What a method of autofocus is given, and what all of them do in the end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from rptcam_cl.autofocus.looks import Look, Looks
from rptcam_cl.autofocus.measures import Measure
from rptcam_cl.autofocus.policy import Policy
from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.autofocus.renderer import ProbeRenderer
from rptcam_cl.autofocus.report import FocusReport, ProbeRecord
from rptcam_cl.scene import AutoFocus, LensCamera, ThinLensCamera
from rptcam_cl.scene.scene import Scene

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
    on_look: Callable[[Look], None] | None = None

    def looks(self, measure: Measure) -> Looks:
        """Return looks at the zones with a measure."""
        return Looks(self.probe, self.zones, measure, self.seed, self.on_look)

    def near_place(self, looks: Looks) -> tuple[float, float] | None:
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
