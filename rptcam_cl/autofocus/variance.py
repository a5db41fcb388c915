"""The autofocus of the rptcam paper (Kumar, Kumar, Meng, Yu 2024), kept for comparison.

Walk along the object distance in steps while the variance of the picture's luminance grows; where it does not, halve
the step and turn; stop when the step is small. Known weaknesses: the variance of a whole zone changes by less than a
percent over a wide range (docs/autofocus.md), noise adds to it, a walk ends in the first hollow, and it takes many
looks. Nothing here makes up for them: there is no bracketing, no correction of the noise, and no refusal.
"""

from __future__ import annotations

import math

from rptcam_cl.autofocus.looks import Look, Looks
from rptcam_cl.autofocus.measures import MEASURES
from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.autofocus.report import FocusReport
from rptcam_cl.autofocus.task import Task, wanted
from rptcam_cl.errors import InputError

START, FIRST_STEP = 50.0, 5.0  # scene units, as the paper prints them: d = 50, s = 5
LAST_STEP = 0.01  # of the distance
SAMPLES = 128  # per pixel, as in the paper's pictures
FARTHEST_FOCAL_LENGTHS = 100.0  # where it starts when that is out of reach, or the camera is focused at infinity
MOST_STEPS = 38


def focus_by_variance(task: Task) -> FocusReport:
    """Return the focus at which the walk of the paper ends; its confidence is not known, hence 0.

    It starts at 50 scene units with steps of 5, as the paper prints it; where a camera is focused already, from there
    with steps of a tenth. The notes of the report say which.
    """
    looks = task.looks(MEASURES["variance"])
    zone = task.zones[0]
    start, why = _start(task, looks)
    distance, step = start, FIRST_STEP / START * start
    here = _look(looks, distance, zone)
    assert here is not None
    notes = {"start_m": distance, "step_m": step, "started": why}
    for _ in range(MOST_STEPS):
        if abs(step) < LAST_STEP * distance:
            break
        there = _look(looks, distance + step, zone)
        if there is not None and there.found[0].value > here.found[0].value:
            distance, here = distance + step, there
        else:
            step = -step / 2
    state = looks.state_of(here.place)
    report = task.report("variance", state, zone, math.inf, 0.0, looks.records(0))
    report.notes.update(notes)
    return report


def _start(task: Task, looks: Looks) -> tuple[float, str]:
    """Return the object distance at which the walk starts [m], and why there."""
    scene, zone = task.probe.scene, task.zones[0]
    far = FARTHEST_FOCAL_LENGTHS * task.probe.film_distance(task.probe.state) * 1e-3
    if task.near is None and wanted(scene) is not None:
        printed = f"d = {START:g}, s = {FIRST_STEP:g} scene units, as the paper prints it"
        if _state(looks, START * scene.metres_per_unit, zone) is None:
            return far, f"far away, as {printed}, is out of reach"
        return START * scene.metres_per_unit, printed
    distance = task.probe.object_distance(task.probe.state if task.near is None else task.near, zone)
    if distance is None or math.isinf(distance) or _state(looks, distance, zone) is None:
        return far, "far away, where the camera was focused"
    return distance, "where the camera was focused"


def _state(looks: Looks, distance_m: float, zone: Zone) -> float | None:
    """Return the focus state of a distance; None beyond the reach of the camera."""
    low, high = looks.probe.limits
    try:
        state = looks.probe.state_for(distance_m, zone)
    except InputError:
        return None
    return state if low <= state <= high else None


def _look(looks: Looks, distance_m: float, zone: Zone) -> Look | None:
    state = _state(looks, distance_m, zone)
    return None if state is None else looks.at(looks.place_of(state), SAMPLES)
