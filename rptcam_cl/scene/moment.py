"""A scene as it stands at moments of its exposure: when the shutter opens, and in the steps of keys that move then."""

from __future__ import annotations

from typing import Any

import numpy as np

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.camera import LensCamera, ThinLensCamera
from rptcam_cl.scene.focus import Focus
from rptcam_cl.scene.motion import Vector, moments
from rptcam_cl.scene.pose import Pose
from rptcam_cl.scene.scene import Scene
from rptcam_cl.scene.sequence import value_at
from rptcam_cl.scene.set_keys import set_keys


def at_opening(scene: Scene) -> Scene:
    """Return a scene whose camera stands and is focused as it is when the shutter opens, as are keys of the shutter.

    It is the scene itself where none of these moves or follows. The lens is set there and stays as it is.

    Raises
    ------
    InputError
        When the object that the focus follows is not in front of the camera.
    """
    scene = at_rest(scene)
    if scene.camera.motion:
        scene = scene.model_copy(update={"camera": _moved(scene.camera, scene.shutter.open_s)})
    return _following(scene)


def camera_changes(scene: Scene) -> bool:
    """Return whether the camera is not the same all the time that the shutter is open: by its motion, or by keys."""
    span = scene.shutter.span_s
    first, *poses = (scene.camera.pose_at(time_s) for time_s in moments(scene.camera.motion, *span))
    if any(not np.array_equal(pose, first) for pose in poses):
        return True
    for name, frames in scene.shutter.keys.items():
        begin, *values = (value_at(frames, time_s) for time_s in moments(frames, *span))
        if name.startswith("camera") and any(value != begin for value in values):
            return True
    return False


def at_rest(scene: Scene) -> Scene:
    """Return a scene whose keys of the shutter stay as they are when it opens; itself without such keys."""
    if not scene.shutter.keys:
        return scene
    return _at_keys(scene, scene.shutter.open_s, {"shutter.keys": None, "shutter.steps": None})


def exposure_steps(scene: Scene) -> list[Scene]:
    """Return the scene in the steps of its exposure, one after the other; none where no key moves.

    Each is exposed for its part of the time, with the light of the whole, so that the picture is their mean.

    Raises
    ------
    InputError
        When a key leads nowhere, or out of its range.
    """
    shutter, found = scene.shutter, []
    if not shutter.keys:
        return []
    share_s = shutter.time_s / shutter.steps
    for step in range(shutter.steps):
        begin_s = shutter.open_s + step * share_s
        own = {"shutter.open_s": begin_s, "shutter.time_s": share_s, "shutter.keys": None, "shutter.steps": None}
        still = _at_keys(scene, begin_s + share_s / 2, own)
        if still.exposure.mode == "physical":
            gained = still.exposure.model_copy(update={"ev": still.exposure.ev + float(np.log2(shutter.steps))})
            still = still.model_copy(update={"exposure": gained})
        found.append(still)
    return found


def _at_keys(scene: Scene, time_s: float, own: dict[str, Any]) -> Scene:
    """Return a scene with its keys of the shutter as they are at a moment, and some keys of its own."""
    values = {name: value_at(frames, time_s) for name, frames in scene.shutter.keys.items()}
    try:
        return set_keys(scene, values | own)
    except InputError as problem:
        raise InputError(f"shutter.keys: at {time_s:g} s: {problem}") from None


def _following(scene: Scene) -> Scene:
    """Return a scene whose focus is at the plane of the object that it follows; itself where it follows none."""
    camera = scene.camera
    if not isinstance(camera, LensCamera | ThinLensCamera) or camera.focus is None or camera.focus.object is None:
        return scene
    middle = _middle_of(scene, camera.focus.object)
    ahead = float(np.dot(np.subtract(camera.eye, middle), camera.world_from_camera()[:3, 2]))
    if not ahead > 0:
        raise InputError(
            f"camera.focus.object: {camera.focus.object} does not lie in front of the camera at"
            f" {scene.shutter.open_s:g} s (allowed: an object on the side that the camera looks to)"
        )
    if isinstance(camera, LensCamera):
        point = (float(middle[0]), float(middle[1]), float(middle[2]))
        changes: dict[str, Any] = {"focus": Focus(point=point, method=camera.focus.method, field=camera.focus.field)}
    else:
        changes = {"focus": None, "focus_distance_m": ahead * scene.metres_per_unit}
    return scene.model_copy(update={"camera": camera.model_copy(update=changes)})


def _middle_of(scene: Scene, name: str) -> Vector:
    """Return the middle of the box round an object, the first of that name, when the shutter opens [scene units]."""
    index = [item.name for item in scene.objects].index(name)
    low, high = scene.solids()[index].bounds()
    matrix = scene.objects[index].placed_at(scene.shutter.open_s)
    return np.asarray(matrix[:3, :3] @ ((low + high) / 2) + matrix[:3, 3])


def _moved(camera: Pose, time_s: float) -> Pose:
    """Return a camera at the place that it has at a moment, on the same way."""
    given = {"eye": camera.eye, "target": camera.target, "up": camera.up}
    frames = tuple(
        frame.model_copy(update={key: value for key, value in given.items() if getattr(frame, key) is None})
        for frame in camera.motion
    )
    eye, target, up = (tuple(row.tolist()) for row in camera.pose_at(time_s))
    return camera.model_copy(update={"eye": eye, "target": target, "up": up, "motion": frames})
