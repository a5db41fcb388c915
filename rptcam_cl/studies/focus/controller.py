"""Autofocus of a scene, from its settings to a camera in focus."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rptcam_cl.core.dataclass import dataclass, takes_options
from rptcam_cl.core.errors import InputError, StateError, near_name
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.imaging.writers import MARKED
from rptcam_cl.rendering.cameras import chief_rays
from rptcam_cl.rendering.layers import Moments
from rptcam_cl.scene import base, changes, load
from rptcam_cl.scene.assets.pictures import bright_pixels
from rptcam_cl.scene.lens_settings import AutoFocus
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus import contrast
from rptcam_cl.studies.focus.drives import Drive, focus_drive
from rptcam_cl.studies.focus.phase import clearest_beside, focus_by_hybrid, focus_by_phase, half_view
from rptcam_cl.studies.focus.probe import FocusReport, NoContrast, OutOfReach, Policy, Probe, Zone
from rptcam_cl.studies.focus.renderer import MOST_OF_SEARCH, SIGHT_ACROSS, ProbeRenderer, Task

# What can be wrong with a focus that was found: too uncertain, one of two distances, or one of two line focuses.

SURE = 2 / 3  # confidence below which a focus counts as not found: that of an error of a quarter of a depth of focus
_SHARP_SHARE = 0.05  # of what the zone shows, that depth requires within the depth of field
_AT_AN_END = 1.0  # depths of focus from the end of the reach, where the target may lie beyond
APART = 4.0  # depths of focus between two distances, or two line focuses, that are worth a word
LEAST_SHARE = 0.2  # of a zone that shows another distance
MOSTLY = 0.5  # of a zone that shows something through glass or in a mirror
FAR_M = 1e6
BY_DETAILS = ("contrast", "laplacian", "variance")  # which seek the clearest details, not the least spot


def with_warnings(task: Task, report: FocusReport) -> FocusReport:
    """Return a report with what speaks against it.

    Raises
    ------
    OutOfReach
        When the zone shows what is nearer than the camera can focus, or farther.
    """
    failure = _failure(report)
    if failure is not None or _is_at_an_end(task, report.state):
        contrast.check_reach(task, report.state)
    failure = failure or _nothing_sharp(task, report)
    state, zone = report.state, report.zone
    words = (_other_distance(task, report), _astigmatism(task, state, zone), _passage(task, state, zone))
    if failure is not None and report.method in AIMED and (cause := _why_unseen(task, state, zone)) is not None:
        failure = f"{failure}; {cause}"
    remarks = tuple(remark for remark in words if remark and remark not in (failure or ""))
    return replace(report, failure=failure, remarks=remarks)


def _nothing_sharp(task: Task, report: FocusReport) -> str | None:
    """Describe a focus on nothing that the zone shows: rays, which need no light, tell where that lies."""
    drive, zone = task.drive, report.zone
    try:
        depth = task.renderer.sight(report.state, zone).depths
    except InputError:  # no light there
        return None
    shown = 1 / depth[depth > 0]
    if len(shown) < _SHARP_SHARE * depth.size:
        return None if task.renderer.scene.environment is not None else "the zone shows nothing"
    distance = report.focus_distance_m
    expected = drive.first_order_vergence(report.state) if distance is None else 1 / distance
    sharp = drive.sharp_vergence(report.state)
    nearest = float(shown[np.argmin(np.abs(shown - expected))])
    try:
        best = drive.state_for(min(1 / max(nearest, 1e-12), FAR_M), zone)
    except InputError:  # out of reach
        return None
    off = drive.nearer * (drive.coordinate(report.state) - drive.coordinate(best)) / drive.depth_of_focus
    away = np.abs(off - (shown - nearest) / sharp)
    slack = 0.5 + abs(report.notes.get("beyond_spot", 0.0))
    if float(np.mean(away <= slack)) < _SHARP_SHARE and report.method in BY_DETAILS:
        slack += clearest_beside(task.renderer, best, zone)
    if (share := float(np.mean(away <= slack))) >= _SHARP_SHARE:
        return None
    if share:  # of a slanted zone, that shows far more distances than are sharp
        return f"{share:.1%} of what the zone shows is sharp (allowed: {_SHARP_SHARE:.0%})"
    where = "beyond infinity" if distance is None else f"at {distance:.4g} m"
    lies = f"{1 / nearest:.4g} m away" if nearest > 0 else "infinitely far away"
    return (
        f"nothing that the zone shows is sharp: the nearest to it lies {lies}, the focus {where},"
        f" {away.min():.2g} depths of focus off"
    )


def _passage(task: Task, state: float, zone: Zone) -> str | None:
    """Say that the zone shows what is behind glass, or in a mirror."""
    try:
        sight = task.renderer.sight(state, zone)
    except InputError:  # no light there
        return None
    for through, word in ((sight.mirrors, "in a mirror"), (sight.panes, "through glass")):
        if through.mean() >= MOSTLY:
            first = np.bincount(sight.first_objects[through & (sight.first_objects >= 0)]).argmax()
            name = task.renderer.scene.objects[int(first)].name
            return f"what the zone shows is seen {word}{f' ({name})' if name else ''}"
    return None


def _why_unseen(task: Task, state: float, zone: Zone) -> str | None:
    """Say what about a zone misleads or defeats methods that need contrast: its exposure, or what its rays lead to."""
    if task.renderer.fault is not None:
        return task.renderer.fault
    across, down = (zone.right - zone.left) / 2, (zone.bottom - zone.top) / 2
    about = Zone(
        max(zone.left - across, 0), min(zone.right + across, 1), max(zone.top - down, 0), min(zone.bottom + down, 1)
    )  # fmt: skip
    try:
        sights = {"in": task.renderer.sight(state, zone), "beside": task.renderer.sight(state, about)}
    except InputError:  # no light there
        return "no light reaches it"
    for word, sight in sights.items():
        if sight.lamps.any():
            return f"a lamp shines {word} the zone"
    if not np.isfinite(sights["in"].depths).any():
        return "its rays meet no surface"
    return _passage(task, state, zone) or _astigmatism(task, state, zone)


def _failure(report: FocusReport) -> str | None:
    if report.method == "variance":
        return "variance tells nothing of its own error: the walk of the paper ends somewhere, in focus or not"
    if report.method == "depth":
        if report.confidence >= _SHARP_SHARE:
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
    return min(abs(place - drive.coordinate(end)) for end in drive.limits) <= _AT_AN_END * drive.depth_of_focus


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
    here = _distances_shown(task, report.state, zone, APART * sharp)
    if not here:
        return None
    # what the focus is on: by the distances of the zone, as astigmatism and curved fields move that of the lens
    large = [vergence for vergence, share in here if share >= LEAST_SHARE] or [max(here, key=lambda group: group[1])[0]]
    own = min(large, key=lambda vergence: abs(vergence - expected))
    probes = [here]
    if task.near is None and abs(drive.image_scale(*drive.limits) - 1) > 0.02:
        probes += [_distances_shown(task, state, zone, APART * sharp) for state in drive.limits]
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
            seen = [share for shown, share in _distances_shown(task, there, zone, APART * sharp)
                    if abs(shown - vergence) < APART / 2 * sharp]  # fmt: skip
            if sum(seen) >= LEAST_SHARE:
                return (
                    f"the zone shows two distances: the focus is on what is {1 / own:.4g} m away, and what is"
                    f" {1 / vergence:.4g} m away fills {sum(seen):.0%} of the zone when the focus is there"
                )
    return None


def _distances_shown(task: Task, state: float, zone: Zone, gap: float) -> list[tuple[float, float]]:
    """Return the distances that a zone shows in a state, as vergences [1/m], and the share of the zone of each.

    Two are distinguished by a gap between them that nothing in the zone fills.
    """
    try:
        depth = task.renderer.sight(state, zone).depths
    except InputError:  # no light there
        return []
    met: NDArray[np.float64] = np.sort(1 / depth[np.isfinite(depth) & (depth > 0)])
    groups = np.split(met, np.flatnonzero(np.diff(met) > gap) + 1)
    return [(float(np.median(group)), len(group) / depth.size) for group in groups if len(group)]


def _astigmatism(task: Task, state: float, zone: Zone) -> str | None:
    """Describe where lines across and lines down have focuses of their own."""
    sharp = task.drive.sharp_vergence(state)
    try:
        across, down = half_view(task.renderer, state, zone, "x").sharpest_along()
    except InputError:  # no light there
        return None
    if abs(across - down) < APART * sharp or min(across, down) <= 0:
        return None
    return (
        f"the lens is astigmatic in the zone: upright lines are sharp at {1 / across:.4g} m, level ones at"
        f" {1 / down:.4g} m, {abs(across - down) / sharp:.2g} depths of focus apart"
    )


_LEAST_HALF = 0.01  # of the picture's shorter side: half a side of the smallest zone


def zone_of_object(renderer: ProbeRenderer, name: str) -> Zone:
    """Return the largest square that fits into what is seen of an object, the first of that name.

    Clear glass and mirrors are not seen themselves: of these it fits into where they stand.

    Raises
    ------
    InputError
        When no object has that name, or none of it is seen.
    """
    index = _index_of(renderer.scene, name)
    shown, first = renderer.objects()
    seen = shown == index if np.any(shown == index) else first == index
    if not seen.any():
        raise InputError(f"camera.focus.auto.object: {name} is not in the picture")
    return _zone_within(seen)


def _index_of(scene: Scene, name: str) -> int:
    names = [item.name for item in scene.objects]
    if name in names:
        return names.index(name)
    known = [item for item in names if item]
    raise InputError(
        f"camera.focus.auto.object: no object has this name{near_name(name, known)} (got {name};"
        f" allowed: {base.listed(known) or 'a name, once an object has one'})"
    )


def _zone_within(seen: NDArray[np.bool_]) -> Zone:
    """Return the largest square that fits into a shape of the picture (height, width)."""
    row, column, half = _find_deepest(seen)
    height, width = seen.shape
    size = max(half, _LEAST_HALF * min(height, width))
    left, top = max((column + 0.5 - size) / width, 0.0), max((row + 0.5 - size) / height, 0.0)
    return Zone(left, min((column + 0.5 + size) / width, 1.0), top, min((row + 0.5 + size) / height, 1.0))


HIDDEN = 0.03  # of the distance of a point, by which what hides it is nearer at least
_HALVED = 0.5  # side of the zone round a point of the scene, in those of a point of the picture
_POINT_ROUNDS = 3  # in which focus and exposure of the place of a point follow from that place
STAYS = 0.05  # of the zone's side, by which the place moves when they do


def _zone_of_point(renderer: ProbeRenderer, at: Sequence[float], name: str | None) -> Zone:
    """Return a zone round a point, and put the focus where the point is seen from.

    Parameters
    ----------
    at
        In the scene, or in the coordinates of the object of some name [scene units].

    Raises
    ------
    InputError
        When it is not in the picture, or something hides it.
    """
    scene, drive, where = renderer.scene, renderer.drive, "camera.focus.auto.at"
    moments, size, zone = Moments(scene), np.array(scene.film.resolution), MIDDLE
    index = None if name is None else _index_of(scene, name)
    for _ in range(_POINT_ROUNDS):
        time = moments.middles(np.array([zone.centre]) * size)
        placed = np.eye(4) if index is None else scene.objects[index].places(scene.folders, float(time[0]))[0]
        world = np.append((placed @ [*at, 1.0])[:3] * scene.metres_per_unit, 1.0)
        seen = np.linalg.solve(moments.poses(time)[0], world)
        distance = -float(seen[2])
        place = chief_rays.seen_places(drive.chief_rays(scene, renderer.state), seen[None])[0] / size
        if not (np.all(place > 0) and np.all(place < 1)):
            raise InputError(f"{where}: the point is not in the picture")
        before, (x, y) = zone, place.tolist()
        zone = zone_at(scene, x, y, _HALVED)
        if math.dist(zone.centre, before.centre) < STAYS * (zone.right - zone.left):
            break
        with suppress(InputError):  # out of reach, which the search will say
            renderer.state = drive.state_for(distance, zone)
    sight = renderer.sight(renderer.state, zone_at(scene, x, y, _HALVED / SIGHT_ACROSS))
    if not np.any(sight.depths >= (1 - HIDDEN) * distance):
        first = int(np.bincount(sight.first_objects[sight.first_objects >= 0], minlength=1).argmax())
        named = scene.objects[first].name if len(scene.objects) else None
        raise InputError(f"{where}: the point is hidden{f' by {named}' if named else ''}")
    return zone


_MASK_ACROSS = 240  # cells of a mask
_LEAST_PART = 5e-4  # of the picture: bright parts of a mask that are smaller are left out, but the largest
_MOST_PARTS = 50


def zones_of_mask(bright: NDArray[np.bool_]) -> tuple[Zone, ...]:
    """Return the largest square within each part of a mask (height, width), from the largest part on."""
    step = -(-max(bright.shape) // _MASK_ACROSS)
    rows, columns = (-(-side // step) for side in bright.shape)
    padded = np.pad(bright, [(0, rows * step - bright.shape[0]), (0, columns * step - bright.shape[1])])
    left = padded.reshape(rows, step, columns, step).mean(axis=(1, 3)) >= 0.5
    left = left if left.any() else padded.reshape(rows, step, columns, step).any(axis=(1, 3))
    parts: list[NDArray[np.bool_]] = []
    while left.any() and len(parts) < _MOST_PARTS:
        part = np.zeros_like(left)
        part.flat[np.argmax(left)] = True
        size = 0
        while size < (count := np.count_nonzero(part)):
            size, grown = int(count), np.pad(part, 1)
            part = left & (grown[:-2, 1:-1] | grown[2:, 1:-1] | grown[1:-1, :-2] | grown[1:-1, 2:] | part)
        parts.append(part)
        left = left & ~part
    parts.sort(key=np.count_nonzero, reverse=True)
    return tuple(_zone_within(part) for k, part in enumerate(parts) if not k or part.mean() >= _LEAST_PART)


def _find_deepest(seen: NDArray[np.bool_]) -> tuple[int, int, float]:
    """Return row and column of a pixel farthest from the edge of a shape, and how far that is."""
    depth, shape = 0, np.pad(seen, 1)
    while True:
        smaller = shape.copy()
        for axis in (0, 1):
            smaller &= np.roll(shape, 1, axis) & np.roll(shape, -1, axis)
        if not smaller.any():
            break
        shape, depth = smaller, depth + 1
    places = np.argwhere(shape) - 1
    middle = places[np.argmin(np.abs(places - places.mean(axis=0)).sum(axis=1))]
    return int(middle[0]), int(middle[1]), (depth + 0.5) / np.sqrt(2)


METHODS: dict[str, Callable[[Task], FocusReport]] = {
    "contrast": contrast.focus_by_contrast,
    "laplacian": contrast.focus_by_laplacian,
    "variance": contrast.focus_by_variance,
    "depth": contrast.focus_by_depth,
    "phase": focus_by_phase,
    "hybrid": focus_by_hybrid,
}
MIDDLE = Zone(0.45, 0.55, 0.43, 0.57)  # 1.4 % of the picture
PLACES = ("zones", "zones_from", "mask", "point", "object", "at")
_POINT_SIZE = 0.05  # of the diagonal: the side of the zone round a point


@dataclass(frozen=True)
class FocusOptions:
    """The keyword arguments of `autofocus`, which has them from here (`takes_options`).

    Parameters
    ----------
    method
        ``contrast``, ``laplacian``, ``variance``, ``depth``, ``phase`` or ``hybrid``; see docs/autofocus.md.
    zones
        Rectangles [x0, x1, y0, y1] of the picture to focus on, in fractions from its left and top edges.
    point
        A point [x, y] to focus on, in the same fractions.
    object
        Name of an object to focus on.
    at
        A point [x, y, z] to focus on, of the scene, or of `object` in its own coordinates [scene units].
    mask
        Picture (height, width) above 0 where to focus, as large as the whole picture in any resolution.
    policy
        Which of several zones decides: ``closest``, ``farthest``, ``centre`` or ``weighted``.
    criterion
        What `depth` and `phase` call sharpest: ``spot``, ``pixel``, or ``mtf@30`` with line pairs per mm of the film.
    adjustment
        How far the focus is set beside what is found [depths of focus]; above 0 farther away.
    sensor
        Whether probes have the noise and the white of the scene's sensor, in the exposure of the picture.
    near
        Focus state near which the focus is expected, as `FocusReport.state` of a picture just before.
    seed
        In place of the scene's.
    device
        As for `render`.
    on_probe
        Called with every probe.
    on_state
        Called with every state that the focus is taken to be in by now, first that of the distance by rays.
    """

    method: str | None = None
    _: KW_ONLY
    zones: Sequence[Sequence[float]] | None = None
    point: tuple[float, float] | None = None
    object: str | None = None
    at: tuple[float, float, float] | None = None
    mask: NDArray[Any] | None = None
    policy: str | None = None
    criterion: str | None = None
    adjustment: float | None = None
    sensor: bool | None = None
    near: float | None = None
    seed: int | None = None
    device: str | Session | None = None
    on_probe: Callable[[Probe], Any] | None = None
    on_state: Callable[[float], Any] | None = None

    @property
    def keys(self) -> dict[str, Any]:
        """The keys of ``camera.focus.auto`` that they replace."""
        given = {name: getattr(self, name, None) for name in AutoFocus.model_fields}
        given["mask"] = None if self.mask is None else {"file": np.asarray(self.mask)}
        return {name: value for name, value in given.items() if value is not None}

    def settings_of(self, scene: Scene) -> AutoFocus:
        """The autofocus settings of a scene, or the default ones, with these keys; a place replaces that of the scene.

        Raises
        ------
        InputError
            When the result is not valid.
        """
        given, keys = scene.requested_autofocus or AutoFocus(), self.keys
        replaced = PLACES if keys.keys() & set(PLACES) else ()
        known = {name: getattr(given, name) for name in given.model_fields_set if name not in replaced}
        data = known | keys
        try:
            return AutoFocus.model_validate(data)
        except ValidationError as problem:
            raise load.input_error(problem, data, lambda path, at_key: "") from None


def zones_of(scene: Scene, settings: AutoFocus) -> tuple[Zone, ...]:
    """Return the zones that settings name; those of an object and of a point of the scene are found by probes."""
    if settings.zones is not None:
        return tuple(Zone(*zone) for zone in settings.zones)
    if settings.zones_from is not None:
        content = scene.content_of(settings.zones_from)
        return tuple(Zone(*zone) for zone in read_zones(content, settings.zones_from.place.rstrip(": ")))
    if settings.mask is not None:
        return zones_of_mask(bright_pixels(scene.content_of(settings.mask), settings.mask.place.rstrip(": ")))
    if settings.point is not None:
        return (zone_at(scene, *settings.point),)
    return (MIDDLE,)


def zone_at(scene: Scene, right: float, down: float, share: float = 1.0) -> Zone:
    """Return a square zone round a point of the picture, moved inside where it would reach over the edge."""
    width, height = scene.film.size_m()
    side = share * _POINT_SIZE * scene.film.diagonal_m()
    across, tall = min(side / width, 1.0), min(side / height, 1.0)
    left = min(max(right - across / 2, 0.0), 1.0 - across)
    top = min(max(down - tall / 2, 0.0), 1.0 - tall)
    return Zone(left, left + across, top, top + tall)


def find_focus(
    scene: Scene,
    session: Session,
    settings: AutoFocus,
    *,
    near: float | None = None,
    on_probe: Callable[[Probe], None] | None = None,
    on_state: Callable[[float], None] | None = None,
) -> FocusReport:
    """Return the focus of a scene's camera.

    Parameters
    ----------
    settings
        Method, zones and policy.
    near
        State near which the focus is expected; by default it is sought over the whole reach.
    on_probe
        Called with every probe.
    on_state
        Called with every state that the focus is taken to be in by now, first that of the distance by rays.

    Raises
    ------
    NoContrast
        When there is nothing to focus on.
    OutOfReach
        When what the zone shows is nearer than the camera can focus, or farther.
    InputError
        When the camera has no focus, or a zone or object is not there.
    """
    if settings.sensor and scene.sensor is None:
        raise InputError("camera.focus.auto.sensor: the scene has none (allowed: sensor: {} in the scene, or without)")
    renderer = ProbeRenderer(scene, session, sensor=settings.sensor)
    zones: tuple[Zone, ...]
    if settings.at is not None:
        zones = (_zone_of_point(renderer, settings.at, settings.object),)
    elif settings.object is not None:
        zones = (zone_of_object(renderer, settings.object),)
    else:
        zones = zones_of(scene, settings)
    task = Task(
        renderer, zones, Policy(settings.policy), scene.render.seed, near, on_probe=on_probe, on_state=on_state,
        criterion=settings.criterion,
    )  # fmt: skip
    report = focus_of(task, settings.method)
    return _adjust(task, report, settings.adjustment) if settings.adjustment else report


def _adjust(task: Task, report: FocusReport, farther: float) -> FocusReport:
    """Return a report with the focus so many depths of focus farther away, as far as it goes."""
    state = _state_beside(task.drive, report.state, farther)
    return replace(
        report, state=state, film_distance_mm=task.drive.film_distance(state),
        focus_distance_m=task.drive.object_distance(state, report.zone), notes={**report.notes, "adjustment": farther},
    )  # fmt: skip


def _state_beside(drive: Drive, state: float, farther: float) -> float:
    """The state so many depths of focus farther away than another, as far as it goes."""
    low, high = drive.limits
    beside = drive.state_at(drive.coordinate(state) - drive.nearer * farther * drive.depth_of_focus)
    return min(max(beside, low), high)


def focus_of(task: Task, method: str) -> FocusReport:
    """Return the focus by a method, with what speaks against it.

    Raises
    ------
    NoContrast, OutOfReach
        As `find_focus`.
    """
    try:
        report = search(task, method)
    except NoContrast as problem:
        state = task.renderer.state if task.near is None else task.near
        contrast.check_reach(task, state)
        causes = [_why_unseen(task, state, zone) for zone in task.zones]
        if (cause := next(filter(None, causes), None)) is None or cause in str(problem):
            raise
        raise NoContrast(f"{problem}; {cause}") from None
    return with_warnings(task, report if task.criterion is None else _by_criterion(task, report))


_WHEN_STOPPED = 0.5  # of the opening: two stops, after which the focus shift is reported


def _by_criterion(task: Task, report: FocusReport) -> FocusReport:
    """Return a report of the least spot with its state moved to where the criterion of the task is met best.

    By exact rays of the middle of the zone, in the geometric limit: their modulation, averaged over lines across and
    down, is greatest at a plane beside that of the least spot, and the focus goes the other way.
    """
    drive, renderer, zone = task.drive, task.renderer, report.zone
    assert task.criterion is not None
    view, sharp = half_view(renderer, report.state, zone, "x"), drive.sharp_vergence(report.state)
    off = 0.0
    if task.criterion != "spot":
        off = (view.clearest(_cycles(renderer, task.criterion)) - view.sharpest()) / sharp
    stopped = half_view(renderer, report.state, zone, "x", _WHEN_STOPPED)
    notes = {
        "criterion": task.criterion,
        "beyond_spot": -off,  # depths of focus, towards nearer objects
        "shift_when_stopped": (stopped.sharpest() - view.sharpest()) / sharp,
    }
    state = _state_beside(drive, report.state, off)
    film = drive.film_distance(state)
    distance = drive.object_distance(state, zone) if off else report.focus_distance_m
    return replace(
        report, state=state, film_distance_mm=film, focus_distance_m=distance, notes={**report.notes, **notes}
    )


def _cycles(renderer: ProbeRenderer, criterion: str) -> float:
    """Return the cycles per pixel of a probe that a criterion is about."""
    width_mm, probe = renderer.scene.film.size_m()[0] * 1e3, renderer.view.resolution[0]
    if criterion == "pixel":
        return renderer.scene.film.resolution[0] / (4.0 * probe)
    return float(criterion.removeprefix("mtf@")) * width_mm / probe


AIMED = ("contrast", "laplacian", "phase", "hybrid")
_AIMED_REACH = 4.5  # depths of focus


def search(task: Task, method: str) -> FocusReport:
    """Return the focus by a method; one that looks for what is sharp begins where rays tell that something is.

    Where nothing gets sharp there, as in front of a mirror or a window, it searches as the task says. Zones that are
    flat there are left out, and the others decide.

    Raises
    ------
    NoContrast, OutOfReach
        As the method does.
    """
    zones, problem, most = task.zones, None, MOST_OF_SEARCH * len(task.zones)
    while zones:
        sought = replace(task, zones=zones)
        aim = contrast.aim(sought) if method in AIMED else None
        try:
            report = METHODS[method](sought) if aim is None else _search_aimed(sought, method, aim)
        except NoContrast as failure:
            problem = problem or failure
            if aim is None or not failure.is_flat or task.renderer.samples > most:
                break
            zones = tuple(zone for k, zone in enumerate(zones) if k not in aim.zones)
        else:
            return replace(report, zones=task.zones)
    raise problem or NoContrast


def _search_aimed(task: Task, method: str, aim: contrast.Aim) -> FocusReport:
    """Return the focus near where rays lead, or else within the whole reach."""
    before, leading = task.renderer.samples, tuple(task.zones[k] for k in aim.zones)
    parts = tuple(aim.parts[k] for k in aim.zones)
    nearby, failure = replace(task, zones=parts, near=aim.state, reach=_AIMED_REACH), None
    # Of what is even only its edge can be sharp, which parts of zones leave out.
    attempts = [(nearby, leading)] + [(replace(nearby, zones=leading), leading)] * (parts != leading)
    for attempt, zones in (*attempts, (replace(task, zones=aim.parts), task.zones)):
        is_dear = task.renderer.samples - before > MOST_OF_SEARCH
        if failure is not None and attempt.near != aim.state and (failure.is_flat or is_dear):
            break  # rays through all glass and by all mirrors lead there: elsewhere it is no sharper
        try:
            report = METHODS[method](attempt)
        except NoContrast as problem:
            failure = failure if failure is not None and failure.is_flat else problem
            continue
        notes = {**report.notes, "part": list(astuple(report.zone))}  # of the zone, that shows what rays lead to
        return replace(report, zone=zones[attempt.zones.index(report.zone)], notes=notes)
    raise failure or NoContrast


def focused_scene(scene: Scene, report: FocusReport) -> Scene:
    """Return a scene with its camera in the state that was found."""
    return changes.change_scene(scene, camera=focus_drive(scene).camera_keys(report.state))


def follow_focus(scenes: Iterable[Scene], session: Session, settings: AutoFocus) -> Iterator[FocusReport]:
    """Yield the focus of one frame after the other (AF-C), each sought near the last one first.

    Where there is nothing near it any more, the whole reach is searched; a frame without contrast, or with what is out
    of reach, keeps the focus, with a confidence of 0 and the reason as its failure.

    Raises
    ------
    NoContrast
        When the first frame has nothing to focus on.
    """
    last: FocusReport | None = None
    for scene in scenes:
        try:
            try:
                report = find_focus(scene, session, settings, near=None if last is None else last.state)
            except NoContrast:
                if last is None:
                    raise
                report = find_focus(scene, session, settings)
        except (NoContrast, OutOfReach) as problem:
            if last is None:
                raise
            report = last.keep_for_next_frame(problem)
        last = report
        yield report


def in_focus(
    scene: Scene, session: Session, known: dict[str, Any] | None = None
) -> tuple[Scene, dict[str, Any] | None]:
    """Return a scene whose camera is in focus, and how that came about; unchanged where it has no autofocus.

    Parameters
    ----------
    known
        How it came about the last time, to do without autofocus: `camera`, the keys of the camera that set its focus,
        and `metadata` for the picture.

    Raises
    ------
    InputError
        When there is nothing to focus on.
    """
    settings = scene.requested_autofocus
    if settings is None:
        return scene, None
    if known is None:
        known = _find_keys(scene, session, settings)
    return changes.change_scene(scene, camera=known["camera"]), known


def _find_keys(scene: Scene, session: Session, settings: AutoFocus) -> dict[str, Any]:
    """Return the keys of the camera in focus, and metadata; the end of the reach where the target lies beyond it."""
    drive = focus_drive(scene)
    try:
        report = find_focus(scene, session, settings)
    except NoContrast as problem:
        raise InputError(f"camera.focus.auto: {problem}") from None
    except OutOfReach as problem:
        report = _at_the_end(drive, settings, problem)
    metadata: dict[str, Any] = {"autofocus": report.summary()}
    if report.focus_distance_m is not None:  # by exact rays, where the camera knows it by first-order optics
        metadata["focus_distance_m"] = report.focus_distance_m
    if settings.draw_zones:
        metadata[MARKED] = [list(astuple(zone)) for zone in report.zones]
    return {"camera": drive.camera_keys(report.state), "metadata": metadata}


def _at_the_end(drive: Drive, settings: AutoFocus, problem: OutOfReach) -> FocusReport:
    """Return the report of a focus that went as far as it can."""
    return FocusReport(
        method=settings.method, state=problem.state, film_distance_mm=drive.film_distance(problem.state),
        focus_distance_m=drive.object_distance(problem.state, problem.zone), confidence=0.0, error=math.inf,
        depth_of_focus_mm=drive.depth_of_focus, zone=problem.zone, zones=(problem.zone,),
        failure=f"{problem}; the focus stands at its end",
    )  # fmt: skip


@takes_options(FocusOptions)
def autofocus(scene: Scene | str | Path | Mapping[str, Any], **options: Any) -> FocusReport:
    """Return the focus that the camera of a scene finds; the scene stays as it is, see `focused_scene`.

    What is not given is as in the scene's ``camera.focus.auto``, or else by contrast in a zone in the middle.

    Parameters
    ----------
    **options
        Those of `FocusOptions`.

    Raises
    ------
    NoContrast
        An `InputError`: there is nothing to focus on.
    OutOfReach
        An `InputError`: what the zone shows is nearer than the camera can focus, or farther.
    InputError
        The camera has no focus, or an argument is wrong.
    DeviceError
        No device fits, or a kernel failed.
    """
    given, scene = FocusOptions(**options), scene if isinstance(scene, Scene) else load.load_scene(scene)
    if given.seed is not None:
        scene = changes.change_scene(scene, render={"seed": given.seed})
    settings = given.settings_of(scene)
    session = given.device if isinstance(given.device, Session) else open_session(given.device)
    return find_focus(scene, session, settings, near=given.near, on_probe=given.on_probe, on_state=given.on_state)


# Zones of a file.

_ZoneFractions = tuple[float, float, float, float]
"""Left, right, top and bottom of a zone in fractions of the picture from its left and top edges."""
_LARGEST = 1 << 20  # bytes
_MOST_ZONES = 1000
COLUMNS = 4
_WORD = re.compile("[A-Za-z_]+")


def read_zones(source: Path | bytes, name: str) -> tuple[_ZoneFractions, ...]:
    """Return the zones of a file.

    A line holds xleft, xright, ytop and ybottom as fractions of the picture from its top left corner, separated by
    blanks, tabs or commas. What follows a # is a comment; empty lines and a heading of four words are left out.

    Parameters
    ----------
    source
        The file, or its content.
    name
        What errors call it.

    Raises
    ------
    InputError
        ``NAME:LINE: ...`` when a line is not a zone, or there is none.
    StateError
        When the file cannot be read.
    """
    try:
        if isinstance(source, bytes):
            data = source
        else:
            with source.open("rb") as stream:
                data = stream.read(_LARGEST + 1)  # a byte more than may be read
    except OSError as problem:
        raise StateError(f"{name}: cannot be read ({problem.strerror})") from None
    try:
        text = data[:_LARGEST].decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{name}: is not a text file (allowed: lines of xleft xright ytop ybottom)") from None
    zones: list[_ZoneFractions] = []
    heading = False
    for number, line in enumerate(text.splitlines(), start=1):
        words = re.split(r"[\s,;]+", line.partition("#")[0].strip(" \t,;"))
        if words == [""]:
            continue
        if not (zones or heading) and len(words) == COLUMNS and all(map(_WORD.fullmatch, words)):
            heading = True
            continue
        zones.append(_zone(words, f"{name}:{number}"))
    if not zones:
        raise InputError(f"{name}: holds no zones (allowed: a line each of xleft xright ytop ybottom)")
    if len(zones) > _MOST_ZONES or len(data) > _LARGEST:
        raise InputError(f"{name}: is too long (allowed: up to {_MOST_ZONES} zones)")
    return tuple(zones)


def _zone(words: list[str], place: str) -> _ZoneFractions:
    try:
        left, right, top, bottom = (float(word) for word in words)
    except ValueError:
        raise InputError(
            f"{place}: is not a zone (got {' '.join(words)[:80]}; allowed: four numbers xleft xright ytop ybottom)"
        ) from None
    if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1 and math.isfinite(left + right + top + bottom)):
        raise InputError(
            f"{place}: is not inside the picture (got {' '.join(words)};"
            " allowed: 0 <= xleft < xright <= 1 and 0 <= ytop < ybottom <= 1)"
        )
    return left, right, top, bottom
