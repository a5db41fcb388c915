"""What every camera model hands to the device."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.records import CAMERA, SURFACE
from rptcam_cl.scene.camera import Pose
from rptcam_cl.scene.film import Film


@dataclass(frozen=True)
class CameraModel:
    """A camera ready for the device.

    Attributes
    ----------
    kernel : str
        The helper under ``kernels/`` that defines ``camera_ray``.
    record : array of one ``Camera`` record
    tables : float32 array
        What the helper looks up; empty for most.
    surfaces : array of ``Surface`` records
        Of a lens, film side first.
    stop : float32 array
        Shape of its stop.
    facts : dict
        Facts for the compilation of the camera's kernel.
    has_lens : bool
        Whether rays can be blocked.
    metadata : dict
        What the picture's metadata should say about the camera.
    """

    kernel: str
    record: NDArray[np.void]
    facts: dict[str, int]
    tables: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))
    surfaces: NDArray[np.void] = field(default_factory=lambda: SURFACE.zeros(1))
    stop: NDArray[np.float32] = field(default_factory=lambda: np.zeros(1, np.float32))
    has_lens: bool = False
    metadata: dict[str, Any] = field(default_factory=dict)


def camera_record(pose: Pose, film: Film) -> NDArray[np.void]:
    """Return a camera record with pose and resolution in place."""
    record = CAMERA.zeros(1)
    matrix = pose.world_from_camera()
    for index, name in enumerate(("right", "up", "back")):
        record[name][0, :3] = matrix[:3, index]
    width, height = film.resolution
    sign = 1.0 if pose.flip else -1.0
    record["resolution"][0] = (width, height, sign / width, sign / height)
    return record


def half_tangents(
    fov_degrees: float, axis: Literal["horizontal", "vertical", "diagonal"], film: Film
) -> tuple[float, float]:
    """Return the tangents of half the field of view across and down the film."""
    width, height = film.size_m()
    side = {"horizontal": width, "vertical": height, "diagonal": math.hypot(width, height)}[axis]
    tangent = math.tan(math.radians(fov_degrees) / 2)
    return tangent * width / side, tangent * height / side
