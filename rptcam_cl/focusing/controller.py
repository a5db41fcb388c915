"""Autofocus of a scene, from its settings to a camera in focus."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from rptcam_cl.core.errors import InputError
from rptcam_cl.device import Session, open_session
from rptcam_cl.focusing.contrast import focus_by_contrast, focus_by_laplacian, focus_by_variance
from rptcam_cl.focusing.distance import check_reach, focus_by_depth
from rptcam_cl.focusing.doubts import judged
from rptcam_cl.focusing.drives import focus_drive
from rptcam_cl.focusing.hybrid import focus_by_hybrid
from rptcam_cl.focusing.measures import Probe
from rptcam_cl.focusing.phase import focus_by_phase
from rptcam_cl.focusing.probe import Drive, Policy, Zone
from rptcam_cl.focusing.renderer import ProbeRenderer
from rptcam_cl.focusing.report import FocusReport, NoContrast, OutOfReach
from rptcam_cl.focusing.search import Task
from rptcam_cl.imaging import MARKED
from rptcam_cl.scene import AutoFocus, Scene, change_scene, input_error, listed, load_scene, near_name, read_zones

LEAST_HALF = 0.01  # of the picture's shorter side: half a side of the smallest zone


def zone_of_object(renderer: ProbeRenderer, name: str) -> Zone:
    """Return the largest square that fits into what is seen of an object, the first of that name.

    Raises
    ------
    InputError
        When no object has that name, or none of it is seen.
    """
    names = [item.name for item in renderer.scene.objects]
    if name not in names:
        known = [item for item in names if item]
        raise InputError(
            f"camera.focus.auto.object: no object has this name{near_name(name, known)} (got {name};"
            f" allowed: {listed(known) or 'a name, once an object has one'})"
        )
    seen = renderer.objects() == names.index(name)
    if not seen.any():
        raise InputError(f"camera.focus.auto.object: {name} is not in the picture")
    row, column, half = _deepest(seen)
    height, width = seen.shape
    size = max(half, LEAST_HALF * min(height, width))
    left, top = max((column + 0.5 - size) / width, 0.0), max((row + 0.5 - size) / height, 0.0)
    return Zone(left, min((column + 0.5 + size) / width, 1.0), top, min((row + 0.5 + size) / height, 1.0))


def _deepest(seen: NDArray[np.bool_]) -> tuple[int, int, float]:
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
    "contrast": focus_by_contrast,
    "laplacian": focus_by_laplacian,
    "variance": focus_by_variance,
    "depth": focus_by_depth,
    "phase": focus_by_phase,
    "hybrid": focus_by_hybrid,
}
MIDDLE = Zone(0.45, 0.55, 0.43, 0.57)  # 1.4 % of the picture
PLACES = ("zones", "zones_from", "point", "object")
POINT_SIZE = 0.05  # of the diagonal: the side of the zone round a point


def focus_settings(scene: Scene, manner: Mapping[str, Any], where: Mapping[str, Any]) -> AutoFocus:
    """Return the autofocus settings of a scene, or the default ones, with some keys replaced.

    Parameters
    ----------
    manner
        `method` and `policy`, as far as given.
    where
        Ways to say what to focus on, as far as given; one replaces that of the scene.

    Raises
    ------
    InputError
        When the result is not valid.
    """
    given = scene.requested_autofocus or AutoFocus()
    known = {name: getattr(given, name) for name in given.model_fields_set}
    places = {key: value for key, value in where.items() if value is not None}
    if places:
        known = {key: value for key, value in known.items() if key not in PLACES}
    data = known | {key: value for key, value in manner.items() if value is not None} | places
    try:
        return AutoFocus.model_validate(data)
    except ValidationError as problem:
        raise input_error(problem, data, lambda path, at_key: "") from None


def zones_of(scene: Scene, settings: AutoFocus) -> tuple[Zone, ...]:
    """Return the zones that settings name; the zone of an object is found by a probe instead (`zone_of_object`)."""
    if settings.zones is not None:
        return tuple(Zone(*zone) for zone in settings.zones)
    if settings.zones_from is not None:
        content = scene.content_of(settings.zones_from)
        return tuple(Zone(*zone) for zone in read_zones(content, settings.zones_from.place.rstrip(": ")))
    if settings.point is not None:
        return (zone_at(scene, *settings.point),)
    return (MIDDLE,)


def zone_at(scene: Scene, right: float, down: float) -> Zone:
    """Return a square zone round a point of the picture, moved inside where it would reach over the edge."""
    width, height = scene.film.size_m()
    side = POINT_SIZE * scene.film.diagonal_m()
    across, tall = min(side / width, 1.0), min(side / height, 1.0)
    left = min(max(right - across / 2, 0.0), 1.0 - across)
    top = min(max(down - tall / 2, 0.0), 1.0 - tall)
    return Zone(left, left + across, top, top + tall)


def find_focus(
    scene: Scene,
    session: Session,
    settings: AutoFocus,
    *,
    zones: Sequence[Zone] | None = None,
    near: float | None = None,
    on_probe: Callable[[Probe], None] | None = None,
) -> FocusReport:
    """Return the focus of a scene's camera.

    Parameters
    ----------
    settings
        Method, zones and policy.
    zones
        In place of those of the settings.
    near
        State near which the focus is expected; by default it is sought over the whole reach.
    on_probe
        Called with every probe.

    Raises
    ------
    NoContrast
        When there is nothing to focus on.
    OutOfReach
        When what the zone shows is nearer than the camera can focus, or farther.
    InputError
        When the camera has no focus, or a zone or object is not there.
    """
    renderer = ProbeRenderer(scene, session)
    if zones is None and settings.object is not None:
        zones = [zone_of_object(renderer, settings.object)]
    task = Task(
        renderer,
        tuple(zones) if zones is not None else zones_of(scene, settings),
        Policy(settings.policy),
        scene.render.seed,
        near,
        on_probe,
    )
    try:
        report = METHODS[settings.method](task)
    except NoContrast:
        check_reach(task, renderer.state if near is None else near)
        raise
    return judged(task, report)


def focused_scene(scene: Scene, report: FocusReport) -> Scene:
    """Return a scene with its camera in the state that was found."""
    return change_scene(scene, camera=focus_drive(scene).camera_keys(report.state))


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
                found = find_focus(scene, session, settings, near=None if last is None else last.state)
            except NoContrast:
                if last is None:
                    raise
                found = find_focus(scene, session, settings)
        except (NoContrast, OutOfReach) as problem:
            if last is None:
                raise
            found = last.kept(problem)
        last = found
        yield found


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
        known = _found(scene, session, settings)
    return change_scene(scene, camera=known["camera"]), known


def _found(scene: Scene, session: Session, settings: AutoFocus) -> dict[str, Any]:
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
        method=settings.method,
        state=problem.state,
        film_distance_mm=drive.film_distance(problem.state),
        focus_distance_m=drive.object_distance(problem.state, problem.zone),
        confidence=0.0,
        error=math.inf,
        depth_of_focus_mm=drive.depth_of_focus,
        zone=problem.zone,
        zones=(problem.zone,),
        failure=f"{problem}; the focus stands at its end",
    )


def autofocus(
    scene: Scene | str | Path | Mapping[str, Any],
    method: str | None = None,
    *,
    zones: Sequence[Sequence[float]] | None = None,
    point: tuple[float, float] | None = None,
    object: str | None = None,
    policy: str | None = None,
    near: float | None = None,
    seed: int | None = None,
    device: str | Session | None = None,
    on_probe: Callable[[Probe], Any] | None = None,
) -> FocusReport:
    """Return the focus that the camera of a scene finds; the scene stays as it is, see `focused_scene`.

    What is not given is as in the scene's ``camera.focus.auto``, or else by contrast in a zone in the middle.

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
    policy
        Which of several zones decides: ``closest``, ``farthest``, ``centre`` or ``weighted``.
    near
        Focus state near which the focus is expected, as `FocusReport.state` of a picture just before.
    seed
        In place of the scene's.
    device
        As for `render`.
    on_probe
        Called with every probe.

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
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    if seed is not None:
        scene = change_scene(scene, render={"seed": seed})
    where = {"zones": zones, "point": point, "object": object}
    settings = focus_settings(scene, {"method": method, "policy": policy}, where)
    session = device if isinstance(device, Session) else open_session(device)
    return find_focus(scene, session, settings, near=near, on_probe=on_probe)
