"""The pinhole camera: perspective without a lens."""

from __future__ import annotations

from rptcam_cl.cameras.geometry import intrinsics
from rptcam_cl.cameras.model import CameraModel, CameraView, camera_record, half_tangents
from rptcam_cl.scene import PinholeCamera, Scene


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device."""
    camera = scene.camera
    assert isinstance(camera, PinholeCamera)
    across, down = half_tangents(camera.fov_degrees, camera.fov_axis, scene.film)
    record = camera_record(
        camera, scene.film, "pinhole", half_width=across, half_height=down, near_distance=camera.near_m
    )
    projection = intrinsics(scene.film, (0.5 / across, 0.5 / down), flip=camera.flip)
    view = CameraView(starts_ahead=True)
    return CameraModel(
        "camera/pinhole.h", record, facts={}, metadata={"camera": "pinhole", "intrinsics": projection}, view=view
    )
