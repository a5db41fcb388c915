"""The pinhole camera: perspective without a lens."""

from __future__ import annotations

from rptcam_cl.cameras.entrance_pupil import EntrancePupil
from rptcam_cl.cameras.geometry import intrinsics
from rptcam_cl.cameras.model import CameraModel, CameraView, camera_record, half_tangents
from rptcam_cl.cameras.movements import movements_metadata, place_film
from rptcam_cl.scene import PinholeCamera, Scene


def build(scene: Scene) -> CameraModel:
    """Return the camera for the device."""
    camera = scene.camera
    assert isinstance(camera, PinholeCamera)
    across, down = half_tangents(camera.fov_degrees, camera.fov_axis, scene.film)
    record = camera_record(
        camera, scene.film, "pinhole", half_width=across, half_height=down, near_distance=camera.near_m
    )
    moved = place_film(record, scene, scene.film.size_m()[0] * 500.0 / across)
    projection = intrinsics(scene, (0.5 / across, 0.5 / down))
    metadata = movements_metadata(camera) | {"camera": "pinhole", "intrinsics": projection}
    metadata["entrance_pupil"] = EntrancePupil().described()
    return CameraModel("camera/pinhole.h", record, moved, metadata=metadata, view=CameraView(starts_ahead=True))
