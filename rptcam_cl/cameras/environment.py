"""The environment camera: the whole sphere in longitude and latitude."""

from __future__ import annotations

from rptcam_cl.cameras.model import CameraModel, camera_record
from rptcam_cl.scene import EnvironmentCamera, Scene


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device."""
    camera = scene.camera
    assert isinstance(camera, EnvironmentCamera)
    record = camera_record(camera, scene.film, "environment")
    return CameraModel("camera/environment.h", record, facts={}, metadata={"camera": "environment"})
