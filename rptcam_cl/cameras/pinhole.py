"""The pinhole camera: perspective without a lens."""

from __future__ import annotations

from rptcam_cl.cameras.model import CameraModel, CameraView, camera_record, half_tangents
from rptcam_cl.scene.camera import PinholeCamera
from rptcam_cl.scene.scene import Scene


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device."""
    camera = scene.camera
    assert isinstance(camera, PinholeCamera)
    record = camera_record(camera, scene.film)
    record["a"][0, :3] = (*half_tangents(camera.fov_degrees, camera.fov_axis, scene.film), camera.near_m)
    view = CameraView(starts_ahead=True)
    return CameraModel("camera/pinhole.h", record, facts={}, metadata={"camera": "pinhole"}, view=view)
