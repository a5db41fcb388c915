"""Phase detection: the move to the focus, predicted from the two halves of the pupil.

A probe through both halves shows how far away the target is (`phase_match`), and the lens knows the state that makes it
sharpest. The first probe goes through a stop so small that the displacement over the whole reach of the lens stays
within the zone; the next ones go through the opening of the picture, where displacements are large and the distance is
precise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field
from typing import Any

import numpy as np

from rptcam_cl.cameras import Split, halved
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.contrast import nothing_to_see
from rptcam_cl.focusing.distance import state_within_reach
from rptcam_cl.focusing.half_view import STEP, HalfView, places_round
from rptcam_cl.focusing.measures import Measured, Probe
from rptcam_cl.focusing.phase_match import (
    LEAST_CONTRAST,
    LEAST_SIGNIFICANCE,
    Halves,
    Match,
    PhaseMatch,
)
from rptcam_cl.focusing.probe import Drive, Zone, ZoneImage, chosen, circle_of_confusion
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import FocusReport, NoContrast, OutOfReach, ProbeRecord
from rptcam_cl.focusing.search import Task, within

MARGIN_STEP = 8  # margins are multiples of so many pixels, so that probes can share their buffers


@dataclass(frozen=True)
class HalfProbe:
    """A probe at a zone through the two halves of the pupil.

    Attributes
    ----------
    state, stop : float
        As in `ProbeRenderer.measure`.
    view : HalfView
        What the halves do to the picture of a plane at any distance.
    halves : Halves
        The pictures.
    samples : int
        Camera rays of all pixels; half of them begin a path.
    seconds : float
    """

    state: float
    stop: float
    view: HalfView
    halves: Halves
    samples: int
    seconds: float


def half_view(renderer: ProbeRenderer, state: float, zone: Zone, split: Split, stop: float = 1.0) -> HalfView:
    """Return the halves of the pupil that the middle of a zone sees in a focus state."""
    across, down = zone.centre
    width, height = renderer.choose_zones([zone]).resolution
    middle = min(max(across * width, STEP), width - STEP), min(max(down * height, STEP), height - STEP)
    return HalfView.of(renderer.rays(state, places_round(middle), stop), split)


def measure_halves(
    renderer: ProbeRenderer, state: float, zones: Sequence[Zone], samples: int, seed: int, split: Split = "x"
) -> list[tuple[ZoneImage, ZoneImage]]:
    """Return what zones show through the left and the right half of the pupil, or the lower and the upper one.

    The parameters are those of `ProbeRenderer.measure`. Halves are of equal light in the middle of each zone, and of
    independent noise.
    """
    return [
        _through(renderer, half_view(renderer, state, zone, split), state, zone, samples, seed, 1.0) for zone in zones
    ]


def half_probe(
    renderer: ProbeRenderer,
    view: HalfView,
    state: float,
    zone: Zone,
    samples: int,
    seed: int,
    stop: float = 1.0,
    margin: tuple[int, int] = (0, 0),
) -> HalfProbe:
    """Return a probe through halves.

    Parameters
    ----------
    samples
        Per pixel of both halves together.
    margin
        Pixels across and down to show beyond the zone, at least.
    """
    begun = time.perf_counter()
    across, down = (-(-pixels // MARGIN_STEP) * MARGIN_STEP for pixels in margin)
    margins = renderer.choose_zones([zone], (across, down)).margins(zone)
    images = _through(renderer, view, state, zone, samples, seed, stop)
    parts = np.stack([image.luminance for image in images])
    light = parts.mean(axis=(1, 2, 3), keepdims=True)
    halves = Halves(parts / np.where(light > 0, light, 1.0), margins)
    taken = 2 * images[0].samples * parts[0, 0].size
    return HalfProbe(state, stop, view, halves, taken, time.perf_counter() - begun)


def _through(
    renderer: ProbeRenderer, view: HalfView, state: float, zone: Zone, samples: int, seed: int, stop: float
) -> tuple[ZoneImage, ZoneImage]:
    """Return what a zone shows through the half before the line and that beyond it.

    With the same random numbers the noise of the halves would be each other's negative. Two seeds avoid that.
    """
    camera = renderer.camera(state, stop)
    before, beyond = (
        renderer.render(halved(camera, view.line, beyond=half), samples, 2 * seed + half)[0] for half in (False, True)
    )
    return before, beyond


CAPTURE = 0.3  # of the zone's side: largest displacement that a probe is to find
LEAST_STOP = 0.04  # share of the opening
SAMPLES, MOST_SAMPLES = 64, 512  # per pixel
DEVIATIONS = 6.0  # standard errors to either side that the next probe is prepared for
LEAST_REACH = 5.0  # displacement at full aperture that it is prepared for in any case [pixels]
NEAR = 1.0  # depths of focus: a probe so near to the focus that it found is the last one
PRECISE, ENOUGH = 0.08, 0.125  # depths of focus: standard error aimed at, and taken
MOST_PROBES = 12
SEPARATION = 8 / (3 * math.pi) / 2  # of the middles of the halves of a disk, over its diameter
BLUR = 1.2  # radius of a blurred point over the displacement of its halves
OTHER_STARTS = (0.12, 0.45, 0.8)  # of the reach, from far to near
REASONS = {
    "flat": f"its details do not come to {LEAST_SIGNIFICANCE:g} standard errors of the noise"
    f" or {LEAST_CONTRAST:.1%} of its light",
    "vague": "it looks the same in and out of focus",
    "ambiguous": "it repeats itself, and fits at more than one distance",
    "dark": "it is dark",
}


@dataclass
class PhaseSearch:
    """A phase detection under way.

    Attributes
    ----------
    renderer : ProbeRenderer
    zone : Zone
    seed : int
    on_probe : callable or None
        Called with every probe.
    probes : list
        Every probe so far and what was made of it; None where it shows nothing.
    others : list
        The same of zones that did not decide.
    """

    renderer: ProbeRenderer
    zone: Zone
    seed: int = 0
    on_probe: Callable[[Probe], None] | None = None
    probes: list[tuple[HalfProbe, Match | None]] = field(default_factory=list)
    others: list[tuple[HalfProbe, Match | None]] = field(default_factory=list)

    @property
    def drive(self) -> Drive:
        """What moves when the camera focuses."""
        return self.renderer.drive

    @property
    def probe(self) -> HalfProbe:
        """The last probe."""
        return self.probes[-1][0]

    @property
    def match(self) -> Match:
        """What was made of it."""
        match = self.probes[-1][1]
        assert match is not None
        return match

    def begin(self, start: float) -> None:
        """Probe from a state, and from others where that shows too little, until there is a distance.

        Raises
        ------
        NoContrast
            When there is none.
        """
        reach = self._reach()
        refusal = "flat"
        for number, state in enumerate(self._starts(start)):
            samples = SAMPLES if number == 0 else 4 * SAMPLES
            match = self._probe(state, "x", samples, reach)
            if match is not None and match.refusal in ("vague", "ambiguous"):  # it may change along the other axis
                refusal = str(match.refusal)
                match = self._probe(state, "y", samples, reach)
            if match is not None and match.refusal is None:
                return
            if match is not None and match.refusal in ("vague", "ambiguous"):
                refusal = str(match.refusal)
            if not self.probe.halves.pictures.any():
                raise nothing_to_see(REASONS["dark"])
        raise nothing_to_see(REASONS[refusal])

    def finish(self) -> float:
        """Return the state that makes the target sharpest, after as many probes as that takes.

        Raises
        ------
        NoContrast
            When the target is lost on the way.
        """
        samples = SAMPLES
        while len(self.probes) < MOST_PROBES:
            state = self.state
            if self.moved <= NEAR:
                if self.error <= ENOUGH or samples == MOST_SAMPLES:
                    return state
                samples *= 2 if self.probe.stop == 1.0 else 1
            samples = self.step(state, samples)
        raise NoContrast(f"no focus found in the zone after {MOST_PROBES} probes; the focus stays as it was")

    def step(self, state: float, samples: int) -> int:
        """Probe from a state near the focus, and return with how many samples per pixel."""
        match, probe = self.match, self.probe
        samples = int(min(max(samples, SAMPLES * self.error * probe.stop / PRECISE), MOST_SAMPLES))
        reach = max(DEVIATIONS * match.error, LEAST_REACH * probe.stop * match.error / match.displacement_error)
        found = self._probe(state, probe.view.split, samples, (match.vergence - reach, match.vergence + reach))
        if found is None or found.refusal in ("flat", "vague"):  # the first probe has distinguished rivals
            raise nothing_to_see(REASONS["flat" if found is None else str(found.refusal)])
        return samples

    def _starts(self, start: float) -> Iterator[float]:
        yield start
        ends = sorted((self.drive.coordinate(limit) for limit in self.drive.limits), reverse=self.drive.nearer < 0)
        for share in OTHER_STARTS:
            yield self.drive.state_at(ends[0] + share * (ends[1] - ends[0]))

    def _reach(self) -> tuple[float, float]:
        """Return the vergences [1/m] that are sharp at the ends of the focus."""
        try:
            ends = [half_view(self.renderer, state, self.zone, "x").sharpest() for state in self.drive.limits]
        except InputError as problem:
            raise NoContrast(f"no contrast in the zone: {problem}") from None
        return min(ends), max(ends)

    def _probe(self, state: float, split: Split, samples: int, reach: tuple[float, float]) -> Match | None:
        """Probe from a state for a distance within a reach, through as small a stop as that needs."""
        view = half_view(self.renderer, state, self.zone, split)
        low, high = max(reach[0], -view.nearest), min(reach[1], view.nearest)
        largest = max(abs(view.displacement(low)), abs(view.displacement(high)))
        room = CAPTURE * self._side(view.axis)
        stop = min(max(room / largest, LEAST_STOP), 1.0)
        if stop < 1.0:
            view = half_view(self.renderer, state, self.zone, split, stop)
        blur = math.ceil(BLUR * min(largest * stop, room)) + 2
        probe = half_probe(self.renderer, view, state, self.zone, samples, self.seed, stop, (blur, blur))
        match = PhaseMatch(probe.halves, view).best(low, high) if probe.halves.pictures.any() else None
        self.probes.append((probe, match))
        if self.on_probe is not None:
            value, error = self._shown(probe, match)
            place = self.drive.nearer * self.drive.coordinate(state)
            found = [Measured(value, error, np.zeros(0))]
            self.on_probe(Probe(place, stop, None, 1.0, found, probe.samples, probe.seconds))
        return match

    def _side(self, axis: int) -> float:
        """Return the side of the zone [pixels]."""
        share = (self.zone.right - self.zone.left, self.zone.bottom - self.zone.top)[axis]
        return share * self.renderer.view.resolution[axis]

    @property
    def state(self) -> float:
        """The state that makes the target sharpest, by the last probe."""
        vergence = self.match.vergence
        try:
            return state_within_reach(self.drive, 1 / vergence if vergence > 0 else math.inf, self.zone)
        except OutOfReach as problem:
            return problem.state

    @property
    def moved(self) -> float:
        """How far that state lies from that of the last probe [depths of focus]."""
        drive = self.drive
        return abs(drive.coordinate(self.state) - drive.coordinate(self.probe.state)) / drive.depth_of_focus

    @property
    def error(self) -> float:
        """Standard error of that state [depths of focus]."""
        axis = self.probe.view.axis
        pixel_mm = self.renderer.view.scene.film.size_m()[axis] * 1e3 / self.renderer.view.resolution[axis]
        per_pixel = pixel_mm / (2 * SEPARATION * circle_of_confusion(self.renderer.scene))
        return self.match.displacement_error * per_pixel / self.probe.stop

    def _shown(self, probe: HalfProbe, match: Match | None) -> tuple[float, float]:
        """Return the displacement that a probe shows, and its standard error; the zone's side where it shows none."""
        if match is None:
            return 0.0, self._side(probe.view.axis)
        return match.displacement, match.displacement_error

    def records(self) -> list[ProbeRecord]:
        """Return every probe: its value is the displacement of the halves [pixels]."""
        return [
            ProbeRecord(
                probe.state,
                self.drive.film_distance(probe.state),
                *self._shown(probe, match),
                probe.stop,
                probe.samples,
                probe.seconds,
                "displacement",
            )
            for probe, match in (*self.others, *self.probes)
        ]

    def notes(self) -> dict[str, Any]:
        """Return what else there is to say of the last probe."""
        match = self.match
        return {
            "displacement_pixels": match.displacement,
            "split": {"x": "left and right", "y": "below and above"}[self.probe.view.split],
            "contrast": match.contrast,
            "target_distance_m": 1 / match.vergence if match.vergence > 0 else None,
        }


def focus_by_phase(task: Task) -> FocusReport:
    """Return the focus found by phase detection.

    Raises
    ------
    NoContrast
        When no zone gives a distance.
    """
    search = phase_search(task)
    state = search.finish()
    sure = within(0.25, search.error)
    report = task.report("phase", state, search.zone, search.error * task.drive.depth_of_focus, sure, search.records())
    report.notes.update(search.notes())
    return report


def phase_search(task: Task) -> PhaseSearch:
    """Return the search of the chosen zone, after its first probe.

    Raises
    ------
    NoContrast
        When no zone gives a distance.
    """
    start = task.renderer.state if task.near is None else task.near
    searches: dict[int, PhaseSearch] = {}
    refusal: NoContrast | None = None
    for k, zone in enumerate(task.zones):
        search = PhaseSearch(task.renderer, zone, task.seed, task.on_probe)
        try:
            search.begin(start)
        except NoContrast as problem:
            refusal = problem
        else:
            searches[k] = search
    if not searches:
        assert refusal is not None
        raise refusal
    index = chosen(task.policy, task.zones, {k: search.match.vergence for k, search in searches.items()})
    found = searches[index]
    found.others = [probe for search in searches.values() if search is not found for probe in search.probes]
    return found
