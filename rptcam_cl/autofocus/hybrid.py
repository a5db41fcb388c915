"""Phase detection to get near, contrast to finish."""

from __future__ import annotations

from dataclasses import replace

from rptcam_cl.autofocus.contrast import focus_by_contrast
from rptcam_cl.autofocus.looks import Looks
from rptcam_cl.autofocus.measures import BEST, MEASURES
from rptcam_cl.autofocus.phase import phase_search, still_to_move
from rptcam_cl.autofocus.phase_search import SAMPLES, PhaseSearch
from rptcam_cl.autofocus.policy import Policy
from rptcam_cl.autofocus.report import FocusReport, NoContrast
from rptcam_cl.autofocus.search import greatest_contrast
from rptcam_cl.autofocus.task import Task, within

NEAR_ENOUGH = 1.0  # depths of focus: uncertainty from which contrast finds the way
REACH = 2.5  # depths of focus to either side that contrast looks at
DEVIATIONS = 3.0  # standard errors that it looks at in any case
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
    reach = max(REACH, DEVIATIONS * still_to_move(search)) * sharp
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


def _by_phase(task: Task, search: PhaseSearch, looks: Looks, why: str) -> FocusReport:
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
