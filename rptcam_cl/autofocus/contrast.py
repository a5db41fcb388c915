"""Contrast detection: the state in which a zone shows most detail."""

from __future__ import annotations

from rptcam_cl.autofocus.measures import BEST, MEASURES
from rptcam_cl.autofocus.report import FocusReport
from rptcam_cl.autofocus.search import greatest_contrast
from rptcam_cl.autofocus.task import Task, within


def focus_by_contrast(task: Task) -> FocusReport:
    """Return the focus of greatest contrast by the best of the measures.

    Raises
    ------
    NoContrast
        When nothing in the zones tells sharp from blurred.
    """
    return _by("contrast", BEST, task)


def focus_by_laplacian(task: Task) -> FocusReport:
    """Return the focus of the greatest sum-modified Laplacian, as the CS348b assignment of 2015 asks for.

    Raises
    ------
    NoContrast
        When nothing in the zones tells sharp from blurred.
    """
    return _by("laplacian", "sum_modified_laplacian", task)


def _by(method: str, measure: str, task: Task) -> FocusReport:
    looks = task.looks(MEASURES[measure])
    peak, zone = greatest_contrast(looks, task.policy, task.near_place(looks))
    state = looks.state_of(peak.place)
    sure = within(task.probe.depth_of_focus / 4, peak.error) if peak.inside else 0.0  # at the far end of the reach
    return task.report(method, state, task.zones[zone], peak.error, sure, looks.records(zone))
