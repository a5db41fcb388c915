"""Hybrid focus: phase detection points to the focus, and contrast finds it there."""

from __future__ import annotations

import math
from dataclasses import replace

from rptcam_cl.focusing.contrast import focus_by_contrast, greatest_contrast
from rptcam_cl.focusing.measures import BEST, MEASURES
from rptcam_cl.focusing.phase import SAMPLES, PhaseSearch, phase_search
from rptcam_cl.focusing.probe import Policy
from rptcam_cl.focusing.report import FocusReport, NoContrast
from rptcam_cl.focusing.search import Probes, Task, within


def still_to_move(search: PhaseSearch) -> float:
    """Return how uncertain the state of a search is [depths of focus], its distance from the last probe included.

    Far from the focus the blur of the target's surroundings shifts the match by a few percent of the way.
    """
    return math.hypot(search.error, 0.03 * search.moved)


NEAR_ENOUGH = 1.0  # depths of focus: uncertainty from which contrast finds the way
REACH = 2.5  # depths of focus to either side that contrast searches
AGREEMENT = 3.0  # standard errors that it searches in any case
MOST_STEPS = 3
DISAGREE = 0.5  # depths of focus between the two from which aberrations are to blame


def focus_by_hybrid(task: Task) -> FocusReport:
    """Return the focus: a probe or two through half pupils, then the greatest contrast near where they point.

    Where the halves show no distance, contrast searches the whole reach. Where contrast shows nothing, or is greatest
    elsewhere because of aberrations, which phase detection knows from its rays, phase detection finishes.

    Raises
    ------
    NoContrast
        When neither finds a focus.
    """
    try:
        search = phase_search(task)
        _approach(search)
    except NoContrast:
        report = replace(focus_by_contrast(task), method="hybrid")
        report.notes["finished_by"] = "contrast alone"
        return report
    probes = task.probes(MEASURES[BEST])
    probes.zones = [search.zone]
    sharp = task.drive.depth_of_focus
    reach = max(REACH, AGREEMENT * still_to_move(search)) * sharp
    pointed = probes.place_of(search.state)
    try:
        peak, _ = greatest_contrast(probes, Policy.CENTRE, (pointed, reach))
    except NoContrast:
        return _by_phase(task, search, probes, "phase")
    if abs(peak.place - pointed) > DISAGREE * sharp:
        search.step(probes.state_of(peak.place), SAMPLES)
        return _by_phase(task, search, probes, "phase, as contrast is greatest elsewhere")
    sure = within(sharp / 4, peak.error)
    records = search.records() + probes.records(0)
    report = task.report("hybrid", probes.state_of(peak.place), search.zone, peak.error, sure, records)
    report.notes["finished_by"] = "contrast"
    return report


def _by_phase(task: Task, search: PhaseSearch, probes: Probes, why: str) -> FocusReport:
    """Return the focus that phase detection finds with further probes."""
    state = search.finish()
    error = search.error * task.drive.depth_of_focus
    sure = within(0.25, search.error)
    report = task.report("hybrid", state, search.zone, error, sure, search.records() + probes.records(0))
    report.notes["finished_by"] = why
    return report


def _approach(search: PhaseSearch) -> None:
    """Probe through half pupils until contrast finds the way."""
    for _ in range(MOST_STEPS):
        if still_to_move(search) <= NEAR_ENOUGH:
            return
        search.step(search.state, SAMPLES)
