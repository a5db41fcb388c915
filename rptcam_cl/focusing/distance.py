"""Focus by distance: rays tell how far away the zone is, and the lens says where its film has to be.

Rays go through a pinhole in the place of the stop, so that the zone's distances are known before anything is sharp. The
state is that of the least spot of exact rays in the middle of the zone (`optics/best_focus.py`). No contrast is
needed, but the distance is that of the first surface: of a mirror or a pane of glass, not of what is seen in it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.probe import Drive, Zone, chosen
from rptcam_cl.focusing.report import FocusReport, NoContrast, OutOfReach, ProbeRecord
from rptcam_cl.focusing.search import Task

LEAST_SHARE = 0.25  # of a zone whose rays must meet something


def state_within_reach(drive: Drive, distance_m: float, zone: Zone) -> float:
    """Return the state that makes a plane sharpest in a zone.

    Raises
    ------
    OutOfReach
        When there is none, in the words of the lens.
    InputError
        When the lens cannot tell.
    """
    low, high = drive.limits
    far, near = sorted(drive.limits, key=lambda end: drive.nearer * drive.coordinate(end))
    try:
        state = drive.state_for(distance_m, zone)
    except InputError as problem:
        nearest, farthest = (drive.object_distance(end, zone) for end in (near, far))
        if nearest is not None and distance_m < nearest:
            raise OutOfReach(str(problem), near, zone) from None
        if farthest is not None and distance_m > farthest:
            raise OutOfReach(str(problem), far, zone) from None
        raise
    if low <= state <= high:
        return state
    ends = [drive.object_distance(end, zone) for end in (near, far)]
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
    try:
        depths = task.renderer.depths(state, task.zones, task.seed)
    except InputError:  # no light there: nothing is known of the reach
        return
    met = {k: depth[np.isfinite(depth)] for k, depth in enumerate(depths) if np.isfinite(depth).mean() >= LEAST_SHARE}
    if not met:
        return
    medians = {k: float(np.median(depth)) for k, depth in met.items()}
    zone = chosen(task.policy, task.zones, {k: -median for k, median in medians.items()})
    try:
        state_within_reach(task.drive, medians[zone], task.zones[zone])
    except OutOfReach:
        raise
    except InputError:  # no light there: nothing is known of the reach
        return


MOST_PROBES = 10
CONVERGED = 0.1  # depths of focus between two probes


def focus_by_depth(task: Task) -> FocusReport:
    """Return the focus on what the rays of the zones meet: each zone counts by the median of its distances.

    As the picture grows when the film goes back, a zone then shows another part of what is near: it is measured again
    until that changes no more.

    Raises
    ------
    NoContrast
        When the rays of every zone go past everything.
    OutOfReach
        When what they meet is nearer than the lens can focus, or farther.
    """
    renderer, drive = task.renderer, task.drive
    state = renderer.state if task.near is None else task.near
    zones = dict(enumerate(task.zones))
    records: list[ProbeRecord] = []
    for number in range(MOST_PROBES):
        samples, seconds = renderer.samples, renderer.seconds
        depths = renderer.depths(state, list(zones.values()), task.seed)
        met = {k: depth for k, depth in zip(zones, depths, strict=True) if np.isfinite(depth).mean() >= LEAST_SHARE}
        if not met:
            raise NoContrast("nothing in the zone: its rays meet no surface; the focus stays as it was")
        medians = {k: float(np.median(depth[np.isfinite(depth)])) for k, depth in met.items()}
        zone = chosen(task.policy, task.zones, {k: -median for k, median in medians.items()})
        before = drive.coordinate(state)
        state = state_within_reach(drive, medians[zone], task.zones[zone])
        zones = {zone: task.zones[zone]}
        film = drive.film_distance(state)
        taken = (renderer.samples - samples, renderer.seconds - seconds)
        records.append(ProbeRecord(state, film, medians[zone], _spread(met[zone]), 0.0, *taken, "distance"))
        if number and abs(drive.coordinate(state) - before) < CONVERGED * drive.depth_of_focus:
            break
    share = _within_depth_of_field(task, state, met[zone])
    return task.report("depth", state, task.zones[zone], 0.0, share, records)


def _spread(depth: NDArray[np.float64]) -> float:
    """Return half of the middle half of the distances [m]."""
    low, high = np.percentile(depth[np.isfinite(depth)], [25, 75])
    return float(high - low) / 2


def _within_depth_of_field(task: Task, state: float, depth: NDArray[np.float64]) -> float:
    """Return the share of what is met in a zone that a state shows sharply, if it shows the median so.

    Its width is that of first-order optics, its place that of exact rays. The places may differ by more than the width.
    """
    vergence = 1 / depth[np.isfinite(depth)]
    away = np.abs(vergence - np.median(vergence))
    return float(np.mean(away <= task.drive.sharp_vergence(state) / 2))
