"""Phase detection: the move to the focus, predicted from what the two halves of the pupil show.

A look through both halves tells the distance of the target (`phase_match`), and the lens which state makes it sharpest.
The first look goes through a stop so small that the displacement over the whole reach of the lens stays within the
zone; the next ones through the opening of the picture, where displacements are large and the distance is precise.
"""

from __future__ import annotations

import math

from rptcam_cl.autofocus.phase_search import PhaseSearch
from rptcam_cl.autofocus.policy import chosen
from rptcam_cl.autofocus.report import FocusReport, NoContrast
from rptcam_cl.autofocus.task import Task, within


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
