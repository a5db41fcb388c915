"""Focus by distance: rays tell how far away the zone is, and the lens says where its film has to be.

Rays go through a pinhole in the place of the stop, so that the zone's distances are known before anything is sharp. The
state is that of the least spot of exact rays in the middle of the zone (`optics/best_focus.py`). No contrast is
needed, but the distance is that of the first surface: of a mirror or a pane of glass, not of what is seen in it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.focusing.looks import Task
from rptcam_cl.focusing.probe import chosen
from rptcam_cl.focusing.reach import LEAST_SHARE, state_within_reach
from rptcam_cl.focusing.report import FocusReport, NoContrast, ProbeRecord

MOST_LOOKS = 10
SETTLED = 0.1  # depths of focus between two looks


def focus_by_depth(task: Task) -> FocusReport:
    """Return the focus on what the rays of the zones meet: each zone counts by the median of its distances.

    As the picture grows when the film goes back, a zone then shows another part of what is near: it is looked at again
    until that changes no more.

    Raises
    ------
    NoContrast
        When the rays of every zone go past everything.
    OutOfReach
        When what they meet is nearer than the lens can focus, or farther.
    """
    probe = task.probe
    state = probe.state if task.near is None else task.near
    zones = dict(enumerate(task.zones))
    records: list[ProbeRecord] = []
    for number in range(MOST_LOOKS):
        samples, seconds = probe.samples, probe.seconds
        depths = probe.depths(state, list(zones.values()), task.seed)
        met = {k: depth for k, depth in zip(zones, depths, strict=True) if np.isfinite(depth).mean() >= LEAST_SHARE}
        if not met:
            raise NoContrast("nothing in the zone: its rays meet no surface; the focus stays as it was")
        medians = {k: float(np.median(depth[np.isfinite(depth)])) for k, depth in met.items()}
        zone = chosen(task.policy, task.zones, {k: -median for k, median in medians.items()})
        before = probe.coordinate(state)
        state = state_within_reach(probe, medians[zone], task.zones[zone])
        zones = {zone: task.zones[zone]}
        film = probe.film_distance(state)
        taken = (probe.samples - samples, probe.seconds - seconds)
        records.append(ProbeRecord(state, film, medians[zone], _spread(met[zone]), 0.0, *taken, "distance"))
        if number and abs(probe.coordinate(state) - before) < SETTLED * probe.depth_of_focus:
            break
    share = _within_depth_of_field(task, state, met[zone])
    return task.report("depth", state, task.zones[zone], 0.0, share, records)


def _spread(depth: NDArray[np.float64]) -> float:
    """Return half of the middle half of the distances [m]."""
    low, high = np.percentile(depth[np.isfinite(depth)], [25, 75])
    return float(high - low) / 2


def _within_depth_of_field(task: Task, state: float, depth: NDArray[np.float64]) -> float:
    """Return the share of what is met in a zone that a state shows sharply."""
    probe, place = task.probe, task.probe.coordinate(state)
    ends = [probe.state_at(place + side * probe.depth_of_focus / 2) for side in (-1, 1)]
    low, high = probe.limits
    distances = [probe.drive.first_order_distance(min(max(end, low), high)) for end in ends]
    here = probe.drive.first_order_distance(state)
    if here is None:
        return 0.0
    near, far = sorted((np.inf if distance is None else distance) / here for distance in distances)
    met = depth[np.isfinite(depth)]
    median = np.median(met)
    return float(np.mean((met >= near * median) & (met <= far * median)))
