"""Changes to a scene that is loaded already, among them the moment when the shutter opens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from rptcam_cl.scene.base import SceneModel
from rptcam_cl.scene.camera import Pose
from rptcam_cl.scene.problems import input_error
from rptcam_cl.scene.scene import Scene


def at_opening(scene: Scene) -> Scene:
    """Return a scene whose camera stands where it is when the shutter opens; itself where the camera has no keyframes.

    The lens is set there and stays as it is.
    """
    if not scene.camera.motion:
        return scene
    return scene.model_copy(update={"camera": _moved(scene.camera, scene.shutter.open_s)})


def _moved(camera: Pose, time_s: float) -> Pose:
    """Return a camera at the place that it has at a moment, on the same way."""
    given = {"eye": camera.eye, "target": camera.target, "up": camera.up}
    frames = tuple(
        frame.model_copy(update={key: value for key, value in given.items() if getattr(frame, key) is None})
        for frame in camera.motion
    )
    eye, target, up = (tuple(row.tolist()) for row in camera.pose_at(time_s))
    return camera.model_copy(update={"eye": eye, "target": target, "up": up, "motion": frames})


def change_scene(scene: Scene, **parts: Mapping[str, Any]) -> Scene:
    """Return a copy of a scene with some keys of its parts changed, checked anew.

    ``change_scene(scene, render={"spp": 16}, film={"resolution": (320, 180)})``. Objects and materials stay the
    same instances.

    Parameters
    ----------
    scene : Scene
        The scene, which stays as it is.
    **parts : mapping
        New values of keys, by the name of the part that has them: `film`, `render`, `picture` or `camera`.

    Raises
    ------
    InputError
        When the changed scene is not valid.
    """
    data = _fields(scene)
    for name, changes in parts.items():
        data[name] = _fields(getattr(scene, name)) | dict(changes)
    return _checked(scene, data)


def with_camera(scene: Scene, keys: Mapping[str, Any]) -> Scene:
    """Return a copy of a scene with another camera, given by its keys, checked as `change_scene` does.

    Raises
    ------
    InputError
        When the camera is not valid, or does not fit the scene.
    """
    return _checked(scene, _fields(scene) | {"camera": dict(keys)})


def _checked(scene: Scene, data: dict[str, Any]) -> Scene:
    try:
        changed = Scene.model_validate(data, context={"folders": scene._folders})
    except ValidationError as problem:
        raise input_error(problem, data, lambda path, at_key: "") from None
    changed._folders = scene._folders
    changed._library = scene._library
    changed._stand_ins = scene._stand_ins
    return changed


def _fields(part: SceneModel) -> dict[str, Any]:
    """Return the keys that were given to a part of a scene."""
    return {name: getattr(part, name) for name in part.model_fields_set}
