"""Phase detection: the move to the focus, predicted from the two halves of the pupil; contrast may finish it.

A look through both halves tells the distance of the target (`phase_match`), and the lens which state makes it sharpest.
The first look goes through a stop so small that the displacement over the whole reach of the lens stays within the
zone; the next ones through the opening of the picture, where displacements are large and the distance is precise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rptcam_cl.cameras import Split
from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.contrast import focus_by_contrast, greatest_contrast, nothing_to_see
from rptcam_cl.focusing.half_looks import HalfProbe, half_probe, half_view
from rptcam_cl.focusing.lens_drive import circle_of_confusion
from rptcam_cl.focusing.looks import Probe, Probes, Task, within
from rptcam_cl.focusing.measures import BEST, MEASURES, Measured
from rptcam_cl.focusing.phase_match import LEAST_CONTRAST, LEAST_SIGNIFICANCE, Match, PhaseMatch
from rptcam_cl.focusing.probe import Policy, Zone, chosen
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import FocusReport, NoContrast, ProbeRecord

CAPTURE = 0.3  # of the zone's side: largest displacement that a look is to find
LEAST_STOP = 0.04  # share of the opening
SAMPLES, MOST_SAMPLES = 64, 512  # per pixel
DEVIATIONS = 6.0  # standard errors to either side that the next look is prepared for
LEAST_REACH = 5.0  # displacement at full aperture that it is prepared for in any case [pixels]
NEAR = 1.0  # depths of focus: a look so near to the focus that it found is the last one
PRECISE, ENOUGH = 0.08, 0.125  # depths of focus: standard error aimed at, and taken
MOST_LOOKS = 12
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
    probe : ProbeRenderer
    zone : Zone
    seed : int
    on_look : callable or None
        Told of every look.
    looks : list
        Every look so far and what was made of it; None where it shows nothing.
    others : list
        The same of zones that did not decide.
    """

    probe: ProbeRenderer
    zone: Zone
    seed: int = 0
    on_look: Callable[[Probe], None] | None = None
    looks: list[tuple[HalfProbe, Match | None]] = field(default_factory=list)
    others: list[tuple[HalfProbe, Match | None]] = field(default_factory=list)

    @property
    def look(self) -> HalfProbe:
        """The last look."""
        return self.looks[-1][0]

    @property
    def match(self) -> Match:
        """What was made of it."""
        match = self.looks[-1][1]
        assert match is not None
        return match

    def begin(self, start: float) -> None:
        """Look from a state, and from others where that shows too little, until there is a distance.

        Raises
        ------
        NoContrast
            When there is none.
        """
        reach = self._reach()
        refusal = "flat"
        for number, state in enumerate(self._starts(start)):
            samples = SAMPLES if number == 0 else 4 * SAMPLES
            match = self._look(state, "x", samples, reach)
            if match is not None and match.refusal in ("vague", "ambiguous"):  # it may change along the other axis
                refusal = str(match.refusal)
                match = self._look(state, "y", samples, reach)
            if match is not None and match.refusal is None:
                return
            if match is not None and match.refusal in ("vague", "ambiguous"):
                refusal = str(match.refusal)
            if not self.look.halves.pictures.any():
                raise nothing_to_see(REASONS["dark"])
        raise nothing_to_see(REASONS[refusal])

    def finish(self) -> float:
        """Return the state that makes the target sharpest, after as many looks as that takes.

        Raises
        ------
        NoContrast
            When the target is lost on the way.
        """
        samples = SAMPLES
        while len(self.looks) < MOST_LOOKS:
            state = self.state
            if self.moved <= NEAR:
                if self.error <= ENOUGH or samples == MOST_SAMPLES:
                    return state
                samples *= 2 if self.look.stop == 1.0 else 1
            samples = self.step(state, samples)
        raise NoContrast(f"no focus found in the zone after {MOST_LOOKS} looks; the focus stays as it was")

    def step(self, state: float, samples: int) -> int:
        """Look from a state near the focus, and return with how many samples per pixel."""
        match, look = self.match, self.look
        samples = int(min(max(samples, SAMPLES * self.error * look.stop / PRECISE), MOST_SAMPLES))
        reach = max(DEVIATIONS * match.error, LEAST_REACH * look.stop * match.error / match.displacement_error)
        found = self._look(state, look.view.split, samples, (match.vergence - reach, match.vergence + reach))
        if found is None or found.refusal in ("flat", "vague"):  # the first look has told rivals apart
            raise nothing_to_see(REASONS["flat" if found is None else str(found.refusal)])
        return samples

    def _starts(self, start: float) -> Iterator[float]:
        yield start
        ends = sorted((self.probe.coordinate(limit) for limit in self.probe.limits), reverse=self.probe.nearer < 0)
        for share in OTHER_STARTS:
            yield self.probe.state_at(ends[0] + share * (ends[1] - ends[0]))

    def _reach(self) -> tuple[float, float]:
        """Return the vergences [1/m] that are sharp at the ends of the focus."""
        try:
            ends = [half_view(self.probe, state, self.zone, "x").sharpest() for state in self.probe.limits]
        except InputError as problem:
            raise NoContrast(f"no contrast in the zone: {problem}") from None
        return min(ends), max(ends)

    def _look(self, state: float, split: Split, samples: int, reach: tuple[float, float]) -> Match | None:
        """Look from a state for a distance within a reach, through as small a stop as that needs."""
        view = half_view(self.probe, state, self.zone, split)
        low, high = max(reach[0], -view.nearest), min(reach[1], view.nearest)
        largest = max(abs(view.displacement(low)), abs(view.displacement(high)))
        room = CAPTURE * self._side(view.axis)
        stop = min(max(room / largest, LEAST_STOP), 1.0)
        if stop < 1.0:
            view = half_view(self.probe, state, self.zone, split, stop)
        blur = math.ceil(BLUR * min(largest * stop, room)) + 2
        look = half_probe(self.probe, view, state, self.zone, samples, self.seed, stop, (blur, blur))
        match = PhaseMatch(look.halves, view).best(low, high) if look.halves.pictures.any() else None
        self.looks.append((look, match))
        if self.on_look is not None:
            value, error = self._shown(look, match)
            place = self.probe.nearer * self.probe.coordinate(state)
            found = [Measured(value, error, np.zeros(0))]
            self.on_look(Probe(place, stop, None, 1.0, found, look.samples, look.seconds))
        return match

    def _side(self, axis: int) -> float:
        """Return the side of the zone [pixels]."""
        share = (self.zone.right - self.zone.left, self.zone.bottom - self.zone.top)[axis]
        return share * self.probe.film.resolution[axis]

    @property
    def state(self) -> float:
        """The state that makes the target sharpest, by the last look."""
        low, high = self.probe.limits
        vergence = self.match.vergence
        try:
            state = self.probe.state_for(1 / vergence if vergence > 0 else math.inf, self.zone)
        except InputError:  # out of reach
            state = high if (self.probe.nearer > 0) == (vergence > 0) else low
        return min(max(state, low), high)

    @property
    def moved(self) -> float:
        """How far that state lies from the one looked from [depths of focus]."""
        probe = self.probe
        return abs(probe.coordinate(self.state) - probe.coordinate(self.look.state)) / probe.depth_of_focus

    @property
    def error(self) -> float:
        """Standard error of that state [depths of focus]."""
        axis = self.look.view.axis
        pixel_mm = self.probe.film.size_m()[axis] * 1e3 / self.probe.film.resolution[axis]
        per_pixel = pixel_mm / (2 * SEPARATION * circle_of_confusion(self.probe.scene))
        return self.match.displacement_error * per_pixel / self.look.stop

    def _shown(self, look: HalfProbe, match: Match | None) -> tuple[float, float]:
        """Return the displacement that a look shows, and its standard error; the zone's side where it shows none."""
        if match is None:
            return 0.0, self._side(look.view.axis)
        return match.displacement, match.displacement_error

    def records(self) -> list[ProbeRecord]:
        """Return every look: its value is the displacement of the halves [pixels]."""
        return [
            ProbeRecord(
                look.state,
                self.probe.film_distance(look.state),
                *self._shown(look, match),
                look.stop,
                look.samples,
                look.seconds,
                "displacement",
            )
            for look, match in (*self.others, *self.looks)
        ]

    def notes(self) -> dict[str, Any]:
        """Return what else there is to say of the last look."""
        match = self.match
        return {
            "displacement_pixels": match.displacement,
            "split": {"x": "left and right", "y": "below and above"}[self.look.view.split],
            "contrast": match.contrast,
            "target_distance_m": 1 / match.vergence if match.vergence > 0 else None,
        }


def focus_by_phase(task: Task) -> FocusReport:
    """Return the focus found by phase detection.

    Raises
    ------
    NoContrast
        When no zone tells a distance.
    """
    search = phase_search(task)
    state = search.finish()
    sure = within(0.25, search.error)
    report = task.report("phase", state, search.zone, search.error * task.probe.depth_of_focus, sure, search.records())
    report.notes.update(search.notes())
    return report


def phase_search(task: Task) -> PhaseSearch:
    """Return the search of the zone that decides, after its first look.

    Raises
    ------
    NoContrast
        When no zone tells a distance.
    """
    start = task.probe.state if task.near is None else task.near
    searches: dict[int, PhaseSearch] = {}
    refusal: NoContrast | None = None
    for k, zone in enumerate(task.zones):
        search = PhaseSearch(task.probe, zone, task.seed, task.on_look)
        try:
            search.begin(start)
        except NoContrast as problem:
            refusal = problem
        else:
            searches[k] = search
    if not searches:
        assert refusal is not None
        raise refusal
    decides = chosen(task.policy, task.zones, {k: search.match.vergence for k, search in searches.items()})
    found = searches[decides]
    found.others = [look for search in searches.values() if search is not found for look in search.looks]
    return found


def still_to_move(search: PhaseSearch) -> float:
    """Return how uncertain the state of a search is [depths of focus], its distance from the last look included.

    Far from the focus the blur of the target's surroundings shifts the match by a few percent of the way.
    """
    return math.hypot(search.error, 0.03 * search.moved)


NEAR_ENOUGH = 1.0  # depths of focus: uncertainty from which contrast finds the way
REACH = 2.5  # depths of focus to either side that contrast looks at
AGREEMENT = 3.0  # standard errors that it looks at in any case
MOST_STEPS = 3
DISAGREE = 0.5  # depths of focus between the two from which aberrations are to blame


def focus_by_hybrid(task: Task) -> FocusReport:
    """Return the focus: a look or two through half pupils, then the greatest contrast near where they point.

    Where halves tell nothing, contrast has the whole reach. Where contrast tells nothing more, or is greatest elsewhere
    because of aberrations, which phase detection knows from its rays, that one ends it.

    Raises
    ------
    NoContrast
        When neither tells anything.
    """
    try:
        search = phase_search(task)
        _approach(search)
    except NoContrast:
        report = replace(focus_by_contrast(task), method="hybrid")
        report.notes["finished_by"] = "contrast alone"
        return report
    looks = task.looks(MEASURES[BEST])
    looks.zones = [search.zone]
    sharp = task.probe.depth_of_focus
    reach = max(REACH, AGREEMENT * still_to_move(search)) * sharp
    pointed = looks.place_of(search.state)
    try:
        peak, _ = greatest_contrast(looks, Policy.CENTRE, (pointed, reach))
    except NoContrast:
        return _by_phase(task, search, looks, "phase")
    if abs(peak.place - pointed) > DISAGREE * sharp:
        search.step(looks.state_of(peak.place), SAMPLES)
        return _by_phase(task, search, looks, "phase, as contrast is greatest elsewhere")
    sure = within(sharp / 4, peak.error)
    records = search.records() + looks.records(0)
    report = task.report("hybrid", looks.state_of(peak.place), search.zone, peak.error, sure, records)
    report.notes["finished_by"] = "contrast"
    return report


def _by_phase(task: Task, search: PhaseSearch, looks: Probes, why: str) -> FocusReport:
    """Return the focus to which phase detection comes by looks of its own."""
    state = search.finish()
    error = search.error * task.probe.depth_of_focus
    sure = within(0.25, search.error)
    report = task.report("hybrid", state, search.zone, error, sure, search.records() + looks.records(0))
    report.notes["finished_by"] = why
    return report


def _approach(search: PhaseSearch) -> None:
    """Look through half pupils until contrast finds the way."""
    for _ in range(MOST_STEPS):
        if still_to_move(search) <= NEAR_ENOUGH:
            return
        search.step(search.state, SAMPLES)
