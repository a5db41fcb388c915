"""The scene at the moment when the shutter opens."""

from __future__ import annotations

from rptcam_cl.scene.change import change_scene
from rptcam_cl.scene.scene import Scene


def at_opening(scene: Scene) -> Scene:
    """Return a scene whose camera stands where it is when the shutter opens; itself where the camera has no keyframes.

    The lens is set there and stays as it is.
    """
    camera = scene.camera
    if not camera.motion:
        return scene
    names = ("eye", "target", "up")
    places = [frame.time_s for frame in camera.motion]
    frames = [{"time_s": time} | dict(zip(names, camera.pose_at(time).tolist(), strict=True)) for time in places]
    pose = dict(zip(names, camera.pose_at(scene.shutter.open_s).tolist(), strict=True))
    return change_scene(scene, camera=pose | {"motion": frames})
