"""What can be wrong with a focus that was found: too uncertain, one of two distances, or one of two line focuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.distance import check_reach
from rptcam_cl.focusing.phase import half_view
from rptcam_cl.focusing.probe import Zone
from rptcam_cl.focusing.report import FocusReport
from rptcam_cl.focusing.search import Task

SURE = 0.5  # confidence below which a focus counts as not found
SHARP_SHARE = 0.05  # of what the zone shows, that depth requires within the depth of field
AT_AN_END = 1.0  # depths of focus from the end of the reach, where the target may lie beyond
APART = 4.0  # depths of focus between two distances, or two line focuses, that are worth a word
LEAST_SHARE = 0.2  # of a zone that shows another distance


def judged(task: Task, report: FocusReport) -> FocusReport:
    """Return a report with what speaks against it.

    Raises
    ------
    OutOfReach
        When the zone shows what is nearer than the camera can focus, or farther.
    """
    failure = _failure(report)
    if failure is not None or _is_at_an_end(task, report.state):
        check_reach(task, report.state)
    remarks = [remark for remark in (_other_distance(task, report), _astigmatism(task, report)) if remark]
    return replace(report, failure=failure, remarks=tuple(remarks))


def _failure(report: FocusReport) -> str | None:
    if report.method == "variance":
        return "variance tells nothing of its own error: the walk of the paper ends somewhere, in focus or not"
    if report.method == "depth":
        if report.confidence >= SHARP_SHARE:
            return None
        return f"the depth of field holds {report.confidence:.0%} of what the zone shows"
    if report.confidence >= SURE:
        return None
    error = report.error / report.depth_of_focus_mm
    return (
        f"the focus is uncertain: confidence {report.confidence:.2f}, standard error {error:.2g} depths of focus"
        f" (allowed: a confidence of {SURE:g})"
    )


def _is_at_an_end(task: Task, state: float) -> bool:
    drive = task.drive
    place = drive.coordinate(state)
    return min(abs(place - drive.coordinate(end)) for end in drive.limits) <= AT_AN_END * drive.depth_of_focus


def _other_distance(task: Task, report: FocusReport) -> str | None:
    """Describe another distance that the zone shows once the focus is there.

    The picture grows as the film goes back, so that a zone may show one thing while the focus is far and another while
    it is near, each sharp.
    """
    drive, zone = task.drive, report.zone
    if report.focus_distance_m is None:
        return None
    sharp = drive.sharp_vergence(report.state)
    expected = 1 / report.focus_distance_m
    here = _shown(task, report.state, zone, APART * sharp)
    if not here:
        return None
    # what the focus is on: by the distances of the zone, as astigmatism and curved fields move that of the lens
    large = [vergence for vergence, share in here if share >= LEAST_SHARE] or [max(here, key=lambda group: group[1])[0]]
    own = min(large, key=lambda vergence: abs(vergence - expected))
    probes = [here]
    if task.near is None and abs(drive.image_scale(*drive.limits) - 1) > 0.02:
        probes += [_shown(task, state, zone, APART * sharp) for state in drive.limits]
    tried = [own]
    for probe in probes:
        for vergence, share in probe:
            if share < LEAST_SHARE or any(abs(vergence - other) < APART * sharp for other in tried):
                continue
            tried.append(vergence)
            try:
                there = drive.state_for(1 / vergence, zone)
            except InputError:  # out of reach
                continue
            seen = [share for found, share in _shown(task, there, zone, APART * sharp)
                    if abs(found - vergence) < APART / 2 * sharp]  # fmt: skip
            if sum(seen) >= LEAST_SHARE:
                return (
                    f"the zone shows two distances: the focus is on what is {1 / own:.4g} m away, and what is"
                    f" {1 / vergence:.4g} m away fills {sum(seen):.0%} of the zone when the focus is there"
                )
    return None


def _shown(task: Task, state: float, zone: Zone, gap: float) -> list[tuple[float, float]]:
    """Return the distances that a zone shows in a state, as vergences [1/m], and the share of the zone of each.

    Two are distinguished by a gap between them that nothing in the zone fills.
    """
    try:
        depth = task.renderer.depths(state, [zone], task.seed)[0]
    except InputError:  # no light there
        return []
    met: NDArray[np.float64] = np.sort(1 / depth[np.isfinite(depth) & (depth > 0)])
    groups = np.split(met, np.flatnonzero(np.diff(met) > gap) + 1)
    return [(float(np.median(group)), len(group) / depth.size) for group in groups if len(group)]


def _astigmatism(task: Task, report: FocusReport) -> str | None:
    """Describe where lines across and lines down have focuses of their own."""
    sharp = task.drive.sharp_vergence(report.state)
    try:
        across, down = half_view(task.renderer, report.state, report.zone, "x").sharpest_along()
    except InputError:  # no light there
        return None
    if abs(across - down) < APART * sharp or min(across, down) <= 0:
        return None
    return (
        f"the lens is astigmatic in the zone: upright lines are sharp at {1 / across:.4g} m, level ones at"
        f" {1 / down:.4g} m, {abs(across - down) / sharp:.2g} depths of focus apart"
    )
