"""Focus by variance: the walk of the rptcam paper, kept for comparison.

It walks along the object distance in steps while the variance of the picture's luminance grows; where it does not, it
halves the step and turns; it stops when the step is small. Known weaknesses: the variance of a whole zone changes by
less than a percent over a wide range (docs/autofocus.md), noise adds to it, a walk ends in the first local maximum, and
it takes many probes. Nothing here makes up for them: there is no bracketing, no correction of the noise, and no
refusal.
"""

from __future__ import annotations

import math

from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.measures import MEASURES, Probe
from rptcam_cl.focusing.probe import Zone
from rptcam_cl.focusing.report import FocusReport
from rptcam_cl.focusing.search import Probes, Task, requested_autofocus

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
    probes = task.probes(MEASURES["variance"])
    zone = task.zones[0]
    start, why = _start(task, probes)
    distance, step = start, FIRST_STEP / START * start
    here = _probe(probes, distance, zone)
    assert here is not None
    notes = {"start_m": distance, "step_m": step, "started": why}
    for _ in range(MOST_STEPS):
        if abs(step) < LAST_STEP * distance:
            break
        there = _probe(probes, distance + step, zone)
        if there is not None and there.found[0].value > here.found[0].value:
            distance, here = distance + step, there
        else:
            step = -step / 2
    state = probes.state_of(here.place)
    report = task.report("variance", state, zone, math.inf, 0.0, probes.records(0))
    report.notes.update(notes)
    return report


def _start(task: Task, probes: Probes) -> tuple[float, str]:
    """Return the object distance at which the walk starts [m], and why there."""
    scene, zone = task.renderer.scene, task.zones[0]
    far = FARTHEST_FOCAL_LENGTHS * task.drive.film_distance(task.renderer.state) * 1e-3
    if task.near is None and requested_autofocus(scene) is not None:
        printed = f"d = {START:g}, s = {FIRST_STEP:g} scene units, as the paper prints it"
        if _state(probes, START * scene.metres_per_unit, zone) is None:
            return far, f"far away, as {printed}, is out of reach"
        return START * scene.metres_per_unit, printed
    distance = task.drive.object_distance(task.renderer.state if task.near is None else task.near, zone)
    if distance is None or math.isinf(distance) or _state(probes, distance, zone) is None:
        return far, "far away, where the camera was focused"
    return distance, "where the camera was focused"


def _state(probes: Probes, distance_m: float, zone: Zone) -> float | None:
    """Return the focus state of a distance; None beyond the reach of the camera."""
    low, high = probes.drive.limits
    try:
        state = probes.drive.state_for(distance_m, zone)
    except InputError:
        return None
    return state if low <= state <= high else None


def _probe(probes: Probes, distance_m: float, zone: Zone) -> Probe | None:
    state = _state(probes, distance_m, zone)
    return None if state is None else probes.at(probes.place_of(state), SAMPLES)
