"""The Python interface of autofocus."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rptcam_cl.autofocus.controller import find_focus, focus_settings
from rptcam_cl.autofocus.looks import Look
from rptcam_cl.autofocus.report import FocusReport
from rptcam_cl.device import Session, open_session
from rptcam_cl.scene import Scene, change_scene, load_scene


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
    on_look: Callable[[Look], Any] | None = None,
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
    on_look
        Called with every look.

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
    return find_focus(scene, session, settings, near=near, on_look=on_look)
