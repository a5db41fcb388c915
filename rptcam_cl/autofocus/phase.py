"""Phase detection: the move to the focus, predicted from what the two halves of the pupil show.

A look through both halves tells the distance of the target (`phase_match`), and the lens which state makes it sharpest.
The first look goes through a small stop, which keeps the displacement over the whole reach of the lens within the zone;
the next ones at full aperture, where displacements are large and the distance is precise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from rptcam_cl.autofocus.drive import circle_of_confusion
from rptcam_cl.autofocus.half_looks import HalfLook, half_look, half_view
from rptcam_cl.autofocus.phase_match import Match, PhaseMatch
from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.autofocus.renderer import ProbeRenderer
from rptcam_cl.autofocus.report import FocusReport, NoContrast, ProbeRecord
from rptcam_cl.autofocus.search import nothing_to_see
from rptcam_cl.cameras.half_pupil import Split
from rptcam_cl.errors import InputError

CAPTURE = 0.3  # of the zone's side: largest displacement that a look is to find
LEAST_STOP = 0.04  # share of the opening
SAMPLES, MOST_SAMPLES = 64, 512  # per pixel
DEVIATIONS = 6.0  # standard errors to either side that the next look is prepared for
LEAST_REACH = 5.0  # displacement that it is prepared for in any case [pixels]
NEAR = 1.0  # depths of focus: a look so near to the focus that it found is the last one
PRECISE, ENOUGH = 0.08, 0.125  # depths of focus: standard error aimed at, and taken
MOST_LOOKS = 8
BLUR = 1.2  # radius of a blurred point over the displacement of its halves
SEPARATION = 8 / (3 * math.pi) / 2  # of the middles of the halves of a disk, over its diameter
REASONS = {
    "flat": "its details are no stronger than the noise",
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
    """

    probe: ProbeRenderer
    zone: Zone
    seed: int = 0
    on_look: Callable[[HalfLook, Match | None], None] | None = None
    looks: list[tuple[HalfLook, Match | None]] = field(default_factory=list)

    def run(self, start: float) -> tuple[float, Match]:
        """Return the state that makes the target sharpest, and the match that says so.

        Raises
        ------
        NoContrast
            When the halves show nothing, or nothing that fits one distance alone.
        """
        look, match = self._first(start)
        samples = SAMPLES
        while len(self.looks) < MOST_LOOKS:
            state = self.state_of(match)
            moved = abs(self.probe.coordinate(state) - self.probe.coordinate(look.state)) / self.probe.depth_of_focus
            error = self.error_of(match)
            if look.stop == 1.0 and moved <= NEAR:
                if error <= ENOUGH or samples == MOST_SAMPLES:
                    return state, match
                samples *= 2
            samples = int(min(max(samples, SAMPLES * error * look.stop / PRECISE), MOST_SAMPLES))
            reach = max(DEVIATIONS * match.error, LEAST_REACH * match.error / match.displacement_error)
            look, found = self._look(state, look.view.split, samples, (match.vergence - reach, match.vergence + reach))
            if found is None or found.refusal in ("flat", "vague"):  # the first look has told rivals apart
                raise nothing_to_see(REASONS["flat" if found is None else str(found.refusal)])
            match = found
        raise NoContrast(f"no focus found in the zone after {MOST_LOOKS} looks")

    def _first(self, start: float) -> tuple[HalfLook, Match]:
        """Return the first look that shows a distance."""
        reach = self._reach()
        refusal = "flat"
        for number, state in enumerate(self._starts(start)):
            samples = SAMPLES if number == 0 else 4 * SAMPLES
            look, match = self._look(state, "x", samples, reach)
            if match is not None and match.refusal in ("vague", "ambiguous"):  # it may change along the other axis
                refusal = str(match.refusal)
                look, match = self._look(state, "y", samples, reach)
            if match is not None and match.refusal is None:
                return look, match
            if match is not None and match.refusal in ("vague", "ambiguous"):
                refusal = str(match.refusal)
            if not look.halves.pictures.any():
                raise nothing_to_see(REASONS["dark"])
        raise nothing_to_see(REASONS[refusal])

    def _starts(self, start: float) -> Iterator[float]:
        """Yield the states to begin from: the present one, and three over the reach in case it shows too little."""
        yield start
        low, high = (self.probe.coordinate(limit) for limit in self.probe.limits)
        for share in (0.12, 0.45, 0.8) if self.probe.nearer > 0 else (0.88, 0.55, 0.2):
            yield self.probe.state_at(low + share * (high - low))

    def _reach(self) -> tuple[float, float]:
        """Return the vergences [1/m] that are sharp at the ends of the focus."""
        try:
            ends = [half_view(self.probe, state, self.zone, "x").sharpest() for state in self.probe.limits]
        except InputError as problem:
            raise NoContrast(f"no contrast in the zone: {problem}") from None
        return min(ends), max(ends)

    def _look(
        self, state: float, split: Split, samples: int, reach: tuple[float, float]
    ) -> tuple[HalfLook, Match | None]:
        """Look from a state for a distance within a reach, with the stop as small as that needs."""
        view = half_view(self.probe, state, self.zone, split)
        low, high = max(reach[0], -view.nearest), min(reach[1], view.nearest)
        largest = max(abs(view.displacement(low)), abs(view.displacement(high)))
        room = CAPTURE * self._side(view.axis)
        stop = min(max(room / largest, LEAST_STOP), 1.0)
        if stop < 1.0:
            view = half_view(self.probe, state, self.zone, split, stop)
        blur = math.ceil(BLUR * min(largest * stop, room)) + 2
        look = half_look(self.probe, view, state, self.zone, samples, self.seed, stop, (blur, blur))
        match = PhaseMatch(look.halves, view).best(low, high) if look.halves.pictures.any() else None
        self.looks.append((look, match))
        if self.on_look is not None:
            self.on_look(look, match)
        return look, match

    def _side(self, axis: int) -> float:
        """Return the side of the zone [pixels]."""
        share = (self.zone.right - self.zone.left, self.zone.bottom - self.zone.top)[axis]
        return share * self.probe.film.resolution[axis]

    def state_of(self, match: Match) -> float:
        """Return the state that makes the target sharpest."""
        low, high = self.probe.limits
        try:
            state = self.probe.state_for(1 / match.vergence if match.vergence > 0 else math.inf, self.zone)
        except InputError:  # out of reach
            state = high if (self.probe.nearer > 0) == (match.vergence > 0) else low
        return min(max(state, low), high)

    def error_of(self, match: Match) -> float:
        """Return the standard error of that state [depths of focus]."""
        view, stop = next((look.view, look.stop) for look, found in self.looks if found is match)
        pixel_mm = self.probe.film.size_m()[view.axis] * 1e3 / self.probe.film.resolution[view.axis]
        return match.displacement_error * pixel_mm / (stop * 2 * SEPARATION * circle_of_confusion(self.probe.scene))

    def records(self) -> list[ProbeRecord]:
        """Return every look: its value is the displacement of the halves [pixels]."""
        return [
            ProbeRecord(
                look.state,
                self.probe.film_distance(look.state),
                match.displacement if match is not None else math.nan,
                match.displacement_error if match is not None else math.nan,
                look.stop,
                look.samples,
                look.seconds,
            )
            for look, match in self.looks
        ]


def phase(probe: ProbeRenderer, zone: Zone, seed: int = 0) -> FocusReport:
    """Return the focus on a zone, found by phase detection; the probe's own state becomes it.

    Raises
    ------
    NoContrast
        When the zone tells nothing; the probe's state stays as it was.
    """
    search = PhaseSearch(probe, zone, seed)
    state, match = search.run(probe.state)
    error = search.error_of(match)
    probe.state = state
    return FocusReport(
        method="phase",
        state=state,
        film_distance_mm=probe.film_distance(state),
        focus_distance_m=1 / match.vergence if match.vergence > 0 else None,
        confidence=math.erf(0.25 / (error * math.sqrt(2))) if error > 0 else 1.0,
        error=error * probe.depth_of_focus,
        depth_of_focus_mm=probe.depth_of_focus,
        zone=zone,
        probes=search.records(),
        notes={
            "displacement_pixels": match.displacement,
            "contrast": match.contrast,
            "rival": match.rival,
        },
    )
