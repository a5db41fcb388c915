"""Whether what a zone shows lies within the reach of the focus."""

from __future__ import annotations

import numpy as np

from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.looks import Task
from rptcam_cl.focusing.probe import Zone, chosen
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import OutOfReach

LEAST_SHARE = 0.25  # of a zone whose rays must meet something


def state_within_reach(probe: ProbeRenderer, distance_m: float, zone: Zone) -> float:
    """Return the state that makes a plane sharpest in a zone.

    Raises
    ------
    OutOfReach
        When there is none, in the words of the lens.
    InputError
        When the lens cannot tell.
    """
    low, high = probe.limits
    far, near = sorted(probe.limits, key=lambda end: probe.nearer * probe.coordinate(end))
    try:
        state = probe.state_for(distance_m, zone)
    except InputError as problem:
        nearest, farthest = (probe.object_distance(end, zone) for end in (near, far))
        if nearest is not None and distance_m < nearest:
            raise OutOfReach(str(problem), near, zone) from None
        if farthest is not None and distance_m > farthest:
            raise OutOfReach(str(problem), far, zone) from None
        raise
    if low <= state <= high:
        return state
    ends = [probe.object_distance(end, zone) for end in (near, far)]
    known = ", ".join(f"{distance:.4g} m" for distance in ends if distance is not None)
    words = f"what the zone shows is {distance_m:.4g} m away, out of reach of the focus (ends at {known})"
    raise OutOfReach(words, min(max(state, low), high), zone)


def check_reach(task: Task, state: float) -> None:
    """Measure by rays how far away the zones are, for methods that see only how sharp they are.

    Raises
    ------
    OutOfReach
        When what decides is nearer than the camera can focus, or farther.
    """
    depths = task.probe.depths(state, task.zones, task.seed)
    met = {k: depth[np.isfinite(depth)] for k, depth in enumerate(depths) if np.isfinite(depth).mean() >= LEAST_SHARE}
    if not met:
        return
    medians = {k: float(np.median(depth)) for k, depth in met.items()}
    zone = chosen(task.policy, task.zones, {k: -median for k, median in medians.items()})
    try:
        state_within_reach(task.probe, medians[zone], task.zones[zone])
    except OutOfReach:
        raise
    except InputError:  # no light there: nothing is known of the reach
        return
