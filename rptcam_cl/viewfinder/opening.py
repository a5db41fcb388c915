"""The first picture of a scene, by hand where its camera finds no focus or no light by itself."""

from __future__ import annotations

import math
from typing import Any

from rptcam_cl.api import RenderSession
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import LensCamera, Scene, set_keys

WITHOUT_METER = {"exposure": "relative"}


@dataclass(frozen=True)
class Opened:
    """A session, what was set by hand in the scene for it, and why."""

    session: RenderSession
    by_hand: dict[str, Any]
    problem: InputError | None = None


def open_session(scene: Scene, device: str | None) -> Opened:
    """Return a session of a scene.

    Where autofocus or the exposure meter fails, the focus is set to the target of the camera and the exposure to
    ``relative``, so that there is a picture to aim by.

    Raises
    ------
    InputError, DeviceError
        It cannot be rendered by hand either; the error is that of the scene as it is.
    """
    try:
        return Opened(RenderSession(scene, device=device, wait=False), {})
    except InputError as problem:
        for by_hand in _ways_by_hand(scene):
            try:
                session = RenderSession(set_keys(scene, by_hand), device=device, wait=False)
            except InputError:
                continue
            return Opened(session, by_hand, problem)
        raise


def _ways_by_hand(scene: Scene) -> list[dict[str, Any]]:
    """Return the keys that set what the camera of a scene is to find: the focus, the exposure, both."""
    focus: dict[str, Any] = {}
    exposure: dict[str, Any] = {}
    camera = scene.camera
    if scene.requested_autofocus is not None:
        distance_m = scene.metres_per_unit * math.dist(camera.eye, camera.target)
        focus = {f"camera.focus{'.' if isinstance(camera, LensCamera) else '_'}distance_m": distance_m}
    if scene.exposure.mode == "auto":
        exposure = dict(WITHOUT_METER)
    return [keys for keys in (focus, exposure, {**focus, **exposure} if focus and exposure else {}) if keys]
