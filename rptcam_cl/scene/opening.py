"""The scene at the moment when the shutter opens."""

from __future__ import annotations

from rptcam_cl.scene.camera import Pose
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
