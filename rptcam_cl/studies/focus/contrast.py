"""Focus by contrast, the state in which a zone shows most detail, and by distance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.studies.focus.drives import Drive
from rptcam_cl.studies.focus.probe import (
    BEST,
    MEASURES,
    FocusReport,
    NoContrast,
    OutOfReach,
    Peak,
    Policy,
    Probe,
    ProbeRecord,
    Zone,
    ZoneImage,
    choose_zone,
    peak_of,
    rich_part,
)
from rptcam_cl.studies.focus.renderer import (
    HOPELESS,
    MOST_SAMPLES,
    PRECISE,
    SIGHT_ACROSS,
    Probes,
    Task,
    probability_within,
)

#
# Focus by distance: rays tell how far away the zone is, and the lens says where its film has to be.
#
# Rays go through a pinhole in the place of the stop, so that the zone's distances are known before anything is sharp.
# The state is that of the least spot of exact rays in the middle of the zone (`optics/best_focus.py`). No contrast is
# needed, but the distance is that of the first surface: of a mirror or a pane of glass, not of what is seen in it.

_LEAST_MET, LEAST_SHARE = (
    0.05,
    0.25,
)  # of a zone: whose rays must meet something, and what counts though others fill more


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
        met = _subjects(task, state, dict(enumerate(task.zones)))
    except InputError:  # no light there: nothing is known of the reach
        return
    if not met:
        return
    zone = choose_zone(task.policy, task.zones, {k: -subject.middle for k, subject in met.items()})
    try:
        state_within_reach(task.drive, met[zone].middle, task.zones[zone])
    except OutOfReach:
        raise
    except InputError:  # no light there: nothing is known of the reach
        return


@dataclass(frozen=True)
class ZoneSubject:
    """What a zone is focused on.

    Attributes
    ----------
    distances : (n,) array
        How far its places lie from the film along the axis [m].
    mask : (SIGHT_ACROSS, SIGHT_ACROSS) bool array
        Which places of the zone show it.
    """

    distances: NDArray[np.float64]
    mask: NDArray[np.bool_]

    @property
    def middle(self) -> float:
        """The median of its distances [m]."""
        return float(np.median(self.distances))


APART = 1.0  # depths of focus between two things that one state does not show sharply
MOST_LAMPS = 0.5  # share of what a zone shows, from which its lamps are what is focused on


def _subject_of(task: Task, state: float, zone: Zone) -> ZoneSubject | None:
    """Find what a zone is focused on: of several distances the nearest that fills a quarter of it, else the most.

    None where hardly any of it shows anything.
    """
    sight = task.renderer.sight(state, zone)
    met = np.isfinite(sight.depths) & (sight.depths > 0)
    if met.mean() < _LEAST_MET:
        return None
    lamps = met & sight.lamps
    own = np.flatnonzero(met & ~lamps if lamps.sum() < MOST_LAMPS * met.sum() else met)
    own = own[np.argsort(-1 / sight.depths[own])]  # from near to far
    gaps = np.diff(1 / sight.depths[own]) < -APART * task.drive.sharp_vergence(state)
    groups = np.split(own, np.flatnonzero(gaps) + 1)
    large = [group for group in groups if len(group) >= LEAST_SHARE * len(met)]
    chosen = large[0] if large else max(groups, key=len)
    mask = np.zeros(len(met), np.bool_)
    mask[chosen] = True
    return ZoneSubject(sight.depths[chosen], mask.reshape(SIGHT_ACROSS, -1))


def _subjects(task: Task, state: float, zones: Mapping[int, Zone]) -> dict[int, ZoneSubject]:
    """Find what some zones are focused on, of those that show enough."""
    found = {k: _subject_of(task, state, zone) for k, zone in zones.items()}
    return {k: subject for k, subject in found.items() if subject is not None}


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
        before = drive.coordinate(state)
        zone, subject, state = _state_by_rays(task, state, zones)
        zones, middle, met = {zone: task.zones[zone]}, subject.middle, subject.distances
        task.note_state(state)
        film = drive.film_distance(state)
        taken = (renderer.samples - samples, renderer.seconds - seconds)
        records.append(ProbeRecord(state, film, middle, _spread(met), 0.0, *taken, "distance"))
        if number and abs(drive.coordinate(state) - before) < CONVERGED * drive.depth_of_focus:
            break
    share = _within_depth_of_field(task, state, task.zones[zone], middle)
    distance = middle if drive.limits[0] < state < drive.limits[1] else None
    return task.report("depth", state, task.zones[zone], 0.0, share, records, distance)


def _state_by_rays(task: Task, state: float, zones: Mapping[int, Zone]) -> tuple[int, ZoneSubject, float]:
    """Return which of some zones decides by what its rays lead to, what that is, and the state for it.

    Raises
    ------
    NoContrast, OutOfReach
        As `focus_by_depth`.
    """
    met = _subjects(task, state, zones)
    if not met:
        raise NoContrast("nothing in the zone: its rays meet no surface; the focus stays as it was")
    zone = choose_zone(task.policy, task.zones, {k: -subject.middle for k, subject in met.items()})
    return zone, met[zone], state_within_reach(task.drive, met[zone].middle, task.zones[zone])


FAR_M = 1e6  # of what lies behind everything
_BREATHING = 0.05  # by how much the image may grow on the way before the rays of a zone meet something else
_BESIDE = 2.25  # depths of focus between zones that are searched together


@dataclass(frozen=True)
class Aim:
    """Where rays tell a search to begin.

    Attributes
    ----------
    state : float
        That of the distance of the zone that decides.
    parts : tuple of Zone
        Of every zone the part that shows what its rays lead to.
    zones : tuple of int
        Which of them lead there: a search near the state says nothing of the others.
    """

    state: float
    parts: tuple[Zone, ...]
    zones: tuple[int, ...]


def aim(task: Task) -> Aim | None:
    """Return where rays tell a search to begin; None where they lead to what is out of reach.

    Where they lead to nothing at all that is the far end of the focus, as of a sky.
    """
    state, zones = task.renderer.state, dict(enumerate(task.zones))
    try:
        if all(np.isposinf(task.renderer.sight(state, zone).depths).all() for zone in task.zones):
            return Aim(state_within_reach(task.drive, FAR_M, task.zones[0]), task.zones, tuple(zones))
        decides, _, aimed = _state_by_rays(task, state, zones)
        if abs(task.drive.image_scale(aimed, state) - 1) > _BREATHING:
            decides, _, aimed = _state_by_rays(task, aimed, zones)
    except InputError:
        return None
    task.note_state(aimed)
    subjects = _subjects(task, aimed, zones)
    parts = tuple(_narrow_zone(zone, subjects[k]) if k in subjects else zone for k, zone in zones.items())
    near = {k: 1 / subject.middle for k, subject in subjects.items()}
    width = _BESIDE * task.drive.sharp_vergence(aimed)
    leading = (k for k in zones if k == decides or (k in near and abs(near[k] - near.get(decides, math.inf)) <= width))
    return Aim(aimed, parts, tuple(leading))


def _spread(depth: NDArray[np.float64]) -> float:
    """Return half of the middle half of the distances [m]."""
    low, high = np.percentile(depth[np.isfinite(depth)], [25, 75])
    return float(high - low) / 2


def _within_depth_of_field(task: Task, state: float, zone: Zone, middle: float) -> float:
    """Return the share of what a zone shows that a state shows sharply, if it shows a distance so.

    Its width is that of first-order optics, its place that of exact rays. The places may differ by more than the width.
    """
    depth = task.renderer.sight(state, zone).depths
    vergence = 1 / depth[np.isfinite(depth)]
    return (
        float(np.mean(np.abs(vergence - 1 / middle) <= task.drive.sharp_vergence(state) / 2)) if len(vergence) else 0.0
    )


_NARROWED = 0.9  # share of a zone from which on what it is focused on is the zone


def _narrow_zone(zone: Zone, subject: ZoneSubject) -> Zone:
    """Return the part of a zone that shows what it is focused on: the largest rectangle, clear of what is beside it."""
    mask = subject.mask
    if mask.mean() >= _NARROWED:
        return zone
    edges = np.pad(mask, 1, mode="edge")
    clear = mask & edges[:-2, 1:-1] & edges[2:, 1:-1] & edges[1:-1, :-2] & edges[1:-1, 2:]
    top, bottom, left, right = _largest_rectangle(clear if clear.any() else mask)
    across, down = (zone.right - zone.left) / mask.shape[1], (zone.bottom - zone.top) / mask.shape[0]
    return Zone(
        zone.left + left * across, zone.left + right * across, zone.top + top * down, zone.top + bottom * down
    )  # fmt: skip


def _largest_rectangle(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Return the first row, that behind the last, and the same of columns, of the largest rectangle within a mask."""
    best, place = 0, (0, 1, 0, 1)
    for top in range(len(mask)):
        free = np.ones(mask.shape[1], np.bool_)
        for bottom in range(top + 1, len(mask) + 1):
            free &= mask[bottom - 1]
            ends = np.flatnonzero(np.diff(np.concatenate([[0], free.astype(np.int8), [0]])))
            for left, right in ends.reshape(-1, 2).tolist():
                if (size := (right - left) * (bottom - top)) > best:
                    best, place = size, (top, bottom, left, right)
    return place


#
# Contrast detection: the state in which a zone shows most detail, found in few probes.
#
# At full aperture a lens of 50 mm at f/2 has some 450 depths of focus between infinity and natural size, and more
# than a few of them away from the focus nothing is left of a texture. Stopped down the same texture shows over a good
# part of the reach. So the first probes go through a small opening, whose depth of focus spans the steps between
# them. Each further round opens the stop by up to five and probes around the place where the last one found the top.
# The last round is made at the aperture of the picture, because spherical aberration moves the focus as a lens is
# stopped down.
#
# The walk of the rptcam paper, by variance, stands at the end for comparison.

STEP = 8.0  # depths of focus between the probes of the first round: half of a texture's contrast remains that far away
FIRST_PROBES = 5
OPENING = 5.2  # most by which a round opens the stop
_STRIDE = 1.5  # by which steps grow when the top lies beyond the places of a round
SHARE = 0.6  # of the half width: steps of the last round, whose outer probes then see three quarters of the contrast
WIDEST = 6.0  # depths of focus at the stop of a round: its widest step
_OFF_MIDDLE = 0.45  # of a step: how far the top may lie from the middle one of three probes
CLEAR = 4.0  # standard errors by which a top must rise above the rest
FINE = 0.05  # relative standard error of the measure that rounds aim at; `_refine` sees to the place
MOST_MORE = 16.0  # times the samples of a round that the next one takes at most
_AIM = 0.06  # depths of focus that it is to err by where samples are not too many; four pictures tell it roughly
_FIRST_SAMPLES = 64  # per pixel
NEAR_SAMPLES = 16  # of a search near a place, whose probes are sharp enough to tell more from fewer
_MOST_NEAR = 512  # of it, where nothing is seen: it may be elsewhere
_LUCK = 1.0  # standard errors that what is seen may lie below what there is


def no_contrast(why: str, *, is_flat: bool = False) -> NoContrast:
    """Return the refusal of a zone; of one that is flat where rays say that something stands."""
    words = f"no contrast in the zone: {why}; the focus stays as it was (aim at something with texture)"
    return NoContrast(words, is_flat=is_flat)


def first_stop(probes: Probes) -> float:
    """Return the share of the opening at which the steps of the first round are `STEP` depths of focus."""
    low, high = probes.ends
    return min(1.0, STEP * (FIRST_PROBES - 1) * probes.drive.depth_of_focus / (high - low))


def greatest_contrast(probes: Probes, policy: Policy, start: tuple[float, float] | None = None) -> tuple[Peak, int]:
    """Return the top of the contrast at full aperture, and the zone that was chosen.

    Parameters
    ----------
    probes
        The camera.
    policy
        Which zone is chosen when they differ.
    start : (place, reach) or None
        Where to search and how far to either side [mm]; over the whole reach of the lens by default.

    Raises
    ------
    NoContrast
        When sharp and blurred cannot be distinguished in any zone.
    """
    stop = first_stop(probes)
    low, high = probes.ends
    if start is not None:
        place, reach = start
        low, high = max(place - reach, low), min(place + reach, high)
        stop = min(1.0, STEP * 2 * probes.drive.depth_of_focus / (high - low))
    count = FIRST_PROBES if start is None else 3
    step = (high - low) / (count - 1)
    zones = list(range(len(probes.task.zones)))
    places = [low + k * step for k in range(count)]
    reference = None if start is None else start[0]
    first = _FIRST_SAMPLES if start is None else NEAR_SAMPLES
    made, samples = _round(probes, places, stop, first, zones, reference)
    peaks = _widen(probes, made, zones, step, samples)
    rounds = math.ceil(math.log(1 / stop) / math.log(OPENING) - 1e-9)
    if start is not None:  # once more about the top, as the curve of an aberrated lens is lopsided
        rounds = max(rounds, 1)
    factor = stop ** (-1 / rounds) if rounds else 1.0
    for number in range(rounds):
        stop = 1.0 if number == rounds - 1 else stop * factor
        zones = _leave_out_others(probes, _still_possible(policy, probes, peaks, zones, step))
        before, step = step, _next_step(probes, peaks, zones, stop, factor)
        if start is not None:  # a lopsided curve pulls the top of wide steps to a side
            step = min(step, WIDEST / 2 * probes.drive.depth_of_focus)
        more = _for_measure(made, zones) if start is None else _for_place(probes, peaks, zones, before, step)
        wanted = max(int(more * samples), _FIRST_SAMPLES if start is None else 2 * NEAR_SAMPLES)
        if wanted > first:
            _narrow_zones(probes, made, zones)
        if start is not None:
            wanted = min(wanted, max(probes.enough, 2 * NEAR_SAMPLES))
        samples = max(min(wanted, probes.most, probes.affordable), samples)
        centre = _centre(peaks, zones)
        made, samples = _round(probes, _three_places(probes, centre, step), stop, samples, zones, centre)
        peaks = _widen(probes, made, zones, step, samples)
    zone = choose_zone(policy, probes.task.zones, {k: peaks[k].place for k in zones})
    peak = _refine(probes, made, zone, peaks[zone], samples)
    if rounds:  # the curve is no parabola: by a quarter of what the last round moved its top it may be off still
        peak = replace(peak, spread=math.hypot(peak.uncertainty, abs(peak.place - centre) / 4))
    if start is not None and not peak.inside and abs(peak.place - probes.ends[0]) > 1e-9 * abs(peak.place):
        raise no_contrast("it still gets sharper where it was searched")
    if peak.place >= probes.ends[1] - 1e-9 * abs(probes.ends[1]):
        raise NoContrast("what the zone shows is too near: it still gets sharper where the focus ends; that stays")
    return peak, zone


def _round(
    probes: Probes,
    places: Sequence[float],
    stop: float,
    samples: int,
    zones: list[int],
    reference: float | None = None,
) -> tuple[list[Probe], int]:
    """Probe at some places, again with more samples where noise hides what so many would show; return how many."""
    most = min(probes.most, probes.affordable)
    middle = sum(places) / len(places)  # first, as the first probe shows which samples to limit
    places = sorted(places, key=lambda place: abs(place - middle))
    while True:
        made = [probes.at(place, samples, stop, reference) for place in places]
        seen = [zone for zone in zones if _contrast(probes, made, zone)]
        if seen or samples >= most or all(_is_surely_flat(probes, made, zone) for zone in zones):
            break
        if samples * (CLEAR / (_significance(made, zones) + _LUCK)) ** 2 > most:  # as noise falls by the root of them
            break
        _narrow_zones(probes, made, zones)
        samples = min(4 * samples, most)
    if not seen:
        raise no_contrast(_why_unseen(probes, made, zones, samples), is_flat=True)
    zones[:] = _leave_out_others(probes, seen)
    return made, samples


def _for_measure(made: Sequence[Probe], zones: list[int]) -> float:
    """Return how many times the samples of a round its measure needs."""
    return min((min(_noise(made, zone) for zone in zones) / FINE) ** 2, MOST_MORE)


def _for_place(probes: Probes, peaks: dict[int, Peak], zones: list[int], before: float, step: float) -> float:
    """Return how many times the samples of a round the next one needs, whose steps are others, for its top's place.

    With the measure 1 / (1 + q^2) at q half widths from the top, and noise that is everywhere the same, the error of a
    top by three probes q apart is as (1 + q^2)^2 / q, least at q = 0.58.
    """
    target, worst = _AIM * probes.drive.depth_of_focus, 0.0
    for zone in zones:
        ratio, width = 1.0, peaks[zone].width
        if math.isfinite(width):
            there, here = (min(each / width, 1.0) for each in (step, before))
            ratio = (1 + there**2) ** 2 / there / ((1 + here**2) ** 2 / here)
        worst = max(worst, ratio * peaks[zone].error / target)
    return min(worst**2, MOST_MORE)


def _significance(made: Sequence[Probe], zones: list[int]) -> float:
    """Return by how many standard errors the clearest measure of some zones exceeds 0."""
    measures = [probe.measures[zone] for probe in made for zone in zones]
    return max((one.value / one.error if one.error > 0 else math.inf for one in measures if one.value > 0), default=0.0)


def _top(made: Sequence[Probe], zone: int) -> Probe:
    return max(made, key=lambda probe: probe.measures[zone].value)


def _noise(made: Sequence[Probe], zone: int) -> float:
    top = _top(made, zone).measures[zone]
    return top.error / top.value if top.value > 0 else math.inf


def _contrast(probes: Probes, made: Sequence[Probe], zone: int) -> bool:
    """Return whether any probe shows contrast; the top itself may be noisy where hardly any rays pass a small stop."""
    measures = [probe.measures[zone] for probe in made]
    return any(one.value > probes.measure.least and one.value > CLEAR * one.error for one in measures)


def _why_unseen(probes: Probes, made: Sequence[Probe], zones: list[int], samples: int) -> str:
    """Say why zones show too little to focus on, by their measures."""
    top = max((_top(made, zone).measures[zone] for zone in zones), key=lambda measure: measure.value)
    if top.value > CLEAR * top.error:
        least = probes.measure.least
        return f"its details are faint: their measure is {top.value:.2g} at most, and more than {least:.2g} is needed"
    clear = max(top.value, 0.0) / top.error if top.error > 0 else 0.0
    return (
        f"its details come to {clear:.1f} standard errors of the noise at {samples} samples per pixel,"
        f" and {CLEAR:g} are needed"
    )


def _same_everywhere(peak: Peak) -> NoContrast:
    return no_contrast(
        "it looks the same in and out of focus: from the least sharp probe to the sharpest its measure rises by"
        f" {peak.rise:.1f} standard errors, and {CLEAR:g} are needed"
    )


def _is_surely_flat(probes: Probes, made: Sequence[Probe], zone: int) -> bool:
    top = _top(made, zone).measures[zone]
    return top.value + CLEAR * top.error < probes.measure.least


def _widen(probes: Probes, made: list[Probe], zones: list[int], step: float, samples: int) -> dict[int, Peak]:
    """Return the tops of the zones; probe farther where a top lies at the end of what was probed."""
    low, high = probes.ends
    for _ in range(FIRST_PROBES):
        peaks = {zone: peak_of(made, zone) for zone in zones}
        places = [probe.place for probe in made]
        first, last = min(places), max(places)
        tops = [_top(made, zone).place for zone in zones if peaks[zone].rise > CLEAR]
        if first in tops and first > low:
            made.append(probes.at(max(first - step, low), samples, made[0].stop, made[0].reference))
        elif last in tops and last < high:
            made.append(probes.at(min(last + step, high), samples, made[0].stop, made[0].reference))
        else:
            break
        step *= _STRIDE
    return {zone: peak_of(made, zone) for zone in zones}


def _still_possible(policy: Policy, probes: Probes, peaks: dict[int, Peak], zones: list[int], step: float) -> list[int]:
    """Return the zones that may decide in the end: those whose tops lie within a step of the one chosen by now."""
    zone = choose_zone(policy, probes.task.zones, {k: peaks[k].place for k in zones})
    if policy.by_place:
        return [k for k in zones if abs(peaks[k].place - peaks[zone].place) <= step / 2]
    return [zone]


def _narrow_zones(probes: Probes, made: Sequence[Probe], zones: list[int]) -> None:
    """Have the probes to come show of some zones only where the sharpest one shows most detail, near the focus."""
    if probes.task.near is None:
        return
    parts = list(probes.task.zones)
    for zone in zones:
        top = _top(made, zone)
        image, before = top.images[zone], top.measures[zone]
        part = rich_part(image.luminance)
        if part is None:
            continue
        left, right, above, below = part
        shown = image.parts[:, above:below, left:right]
        after = probes.measure.of(ZoneImage(shown, image.samples))
        if after.value > max(before.value, probes.measure.least):  # to this measure, too
            parts[zone] = probes.task.renderer.part_of(parts[zone], part)
    probes.task = replace(probes.task, zones=tuple(parts))


def _leave_out_others(probes: Probes, zones: list[int]) -> list[int]:
    """Return some zones, and have the probes to come show these alone: they get all samples that are left."""
    parts = probes.task.zones
    if len(zones) < len(parts):
        left = tuple(part if k in zones else parts[zones[0]] for k, part in enumerate(parts))
        probes.task = replace(probes.task, zones=left)
    return zones


def _centre(peaks: dict[int, Peak], zones: list[int]) -> float:
    places = [peaks[zone].place for zone in zones]
    return (min(places) + max(places)) / 2


def _three_places(probes: Probes, centre: float, step: float) -> list[float]:
    """Return three places a step apart, about a place where the reach of the lens has room for them."""
    low, high = probes.ends
    centre = min(max(centre, low + step), high - step)
    return [centre - step, centre, centre + step]


def _next_step(probes: Probes, peaks: dict[int, Peak], zones: list[int], stop: float, opened: float) -> float:
    """Return the step of a round: a share of the half width, which shrinks as the stop opens."""
    sharp = probes.drive.depth_of_focus / stop
    width = min((peaks[zone].width for zone in zones), default=math.inf) / opened
    return min(max(SHARE * width, STEP / 4 * sharp), WIDEST * sharp)


def _refine(probes: Probes, made: list[Probe], zone: int, peak: Peak, samples: int) -> Peak:
    """Return the top from probes that lie evenly about it, with as many samples as its error requires.

    Where that is more than a probe may take, the top is as uncertain as its error says.
    """
    sharp, most = probes.drive.depth_of_focus, probes.affordable
    low, high = probes.ends
    reference, widest = made[0].reference, WIDEST * sharp
    for _ in range(4):
        if peak.rise < CLEAR and samples >= most:
            raise _same_everywhere(peak)
        is_hopeless = peak.error * math.sqrt(samples / most) > HOPELESS * sharp
        is_converged = peak.rise >= CLEAR and (peak.error < probes.enough_error or samples >= most or is_hopeless)
        if is_converged and _is_even(made, zone, peak, (low, high), widest):
            return peak
        step = min(max(SHARE * peak.width, sharp), widest / 2 if is_converged else widest)
        if not is_converged:
            widest *= 2  # so coarse a texture, or so blurred a picture, tells little nearer by
            more = 4.0 if peak.rise < CLEAR else float(np.clip(1.5 * (PRECISE * peak.error / sharp) ** 2, 1.5, 16))
            _narrow_zones(probes, made, [zone])
            samples, made, reference = min(int(more * samples), most), [], peak.place
        for place in _three_places(probes, peak.place, step):
            if not any(abs(probe.place - place) < 0.25 * step for probe in made):
                made.append(probes.at(place, samples, reference=reference))
        peak = peak_of(made, zone)
    if peak.rise < CLEAR:
        raise _same_everywhere(peak)
    return peak


def _is_even(made: Sequence[Probe], zone: int, peak: Peak, ends: tuple[float, float], widest: float) -> bool:
    """Whether the top lies in the middle of near neighbours, so that a lopsided curve does not pull it to a side."""
    places = sorted(probe.place for probe in made)
    if not peak.inside:
        return min(abs(peak.place - end) for end in ends) < 1e-9 * abs(peak.place)
    k = places.index(_top(made, zone).place)
    left, right = places[k] - places[k - 1], places[k + 1] - places[k]
    return max(left, right) <= widest and abs(peak.place - places[k]) <= _OFF_MIDDLE * min(left, right)


def focus_by_contrast(task: Task) -> FocusReport:
    """Return the focus of greatest contrast by the best of the measures.

    Raises
    ------
    NoContrast
        When sharp and blurred cannot be distinguished in any zone.
    """
    return _focus_by_measure("contrast", BEST, task)


def focus_by_laplacian(task: Task) -> FocusReport:
    """Return the focus of the greatest sum-modified Laplacian, as the CS348b assignment of 2015 requests.

    Raises
    ------
    NoContrast
        When sharp and blurred cannot be distinguished in any zone.
    """
    return _focus_by_measure("laplacian", "sum_modified_laplacian", task)


def _focus_by_measure(method: str, measure: str, task: Task) -> FocusReport:
    probes = task.probes(MEASURES[measure])
    probes.most = MOST_SAMPLES if task.near is None else _MOST_NEAR
    probes.budget *= len(task.zones)
    peak, zone = greatest_contrast(probes, task.policy, task.near_place(probes))
    task.note_state(probes.state_of(peak.place))
    state = probes.state_of(peak.place)
    sure = (
        probability_within(task.drive.depth_of_focus / 4, peak.uncertainty) if peak.inside else 0.0
    )  # at the far end of the reach
    return task.report(method, state, task.zones[zone], peak.uncertainty, sure, probes.records(zone))


_WALK_START, _WALK_STEP = 50.0, 5.0  # scene units, as the paper prints them: d = 50, s = 5
_WALK_END = 0.01  # of the distance
_WALK_SAMPLES = 128  # per pixel, as in the paper's pictures
_FARTHEST_FOCAL_LENGTHS = 100.0  # where it starts when that is out of reach, or the camera is focused at infinity
MOST_STEPS = 38


def focus_by_variance(task: Task) -> FocusReport:
    """Return the focus at which the walk of the rptcam paper ends, kept for comparison; its confidence is unknown: 0.

    It walks along the object distance in steps while the variance of the picture's luminance grows; where it does not,
    it halves the step and turns; it stops when the step is small. Known weaknesses: the variance of a whole zone
    changes by less than a percent over a wide range (docs/autofocus.md), noise adds to it, a walk ends in the first
    local maximum, and it takes many probes. Nothing here makes up for them: there is no bracketing, no correction of
    the noise, and no refusal.

    It starts at 50 scene units with steps of 5, as the paper prints it; where a camera is focused already, from there
    with steps of a tenth. The notes of the report say which.
    """
    probes = task.probes(MEASURES["variance"])
    zone = task.zones[0]
    start, why = _walk_start(task, probes)
    distance, step = start, _WALK_STEP / _WALK_START * start
    here = _probe_at(probes, distance, zone)
    assert here is not None
    notes = {"start_m": distance, "step_m": step, "started": why}
    for _ in range(MOST_STEPS):
        if abs(step) < _WALK_END * distance:
            break
        there = _probe_at(probes, distance + step, zone)
        if there is not None and there.measures[0].value > here.measures[0].value:
            distance, here = distance + step, there
        else:
            step = -step / 2
    state = probes.state_of(here.place)
    report = task.report("variance", state, zone, math.inf, 0.0, probes.records(0))
    report.notes.update(notes)
    return report


def _walk_start(task: Task, probes: Probes) -> tuple[float, str]:
    """Return the object distance at which the walk starts [m], and why there."""
    scene, zone = task.renderer.scene, task.zones[0]
    far = _FARTHEST_FOCAL_LENGTHS * task.drive.film_distance(task.renderer.state) * 1e-3
    if task.near is None and scene.requested_autofocus is not None:
        printed = f"d = {_WALK_START:g}, s = {_WALK_STEP:g} scene units, as the paper prints it"
        if _state_within_reach(probes, _WALK_START * scene.metres_per_unit, zone) is None:
            return far, f"far away, as {printed}, is out of reach"
        return _WALK_START * scene.metres_per_unit, printed
    distance = task.drive.object_distance(task.renderer.state if task.near is None else task.near, zone)
    if distance is None or math.isinf(distance) or _state_within_reach(probes, distance, zone) is None:
        return far, "far away, where the camera was focused"
    return distance, "where the camera was focused"


def _state_within_reach(probes: Probes, distance_m: float, zone: Zone) -> float | None:
    """Return the focus state of a distance; None beyond the reach of the camera."""
    try:
        return state_within_reach(probes.drive, distance_m, zone)
    except InputError:
        return None


def _probe_at(probes: Probes, distance_m: float, zone: Zone) -> Probe | None:
    state = _state_within_reach(probes, distance_m, zone)
    return None if state is None else probes.at(probes.place_of(state), _WALK_SAMPLES)
