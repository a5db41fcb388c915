"""The geometry of a camera for programs that measure in its pictures: pose, film and intrinsics."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from rptcam_cl.cameras.movements import film_frame, half_film_mm
from rptcam_cl.scene import Scene, pose_matrix


def intrinsics(
    scene: Scene,
    per_tangent: tuple[float, float],
    *,
    distortion: Literal["none", "traced lens"] = "none",
    lever: float = 1.0,
) -> dict[str, Any]:
    """Return what projects a point (x, y, z) of the camera's frame on the picture, in pixels of the whole film.

    The point is seen at column ``cx + fx x / -z`` and row ``cy - fy y / -z``; pixel (0, 0) covers 0 to 1. A film
    that is tilted or swung has a ``matrix`` by rows in their place: it takes (x, y, -z) to a multiple of (column, row,
    1).

    Parameters
    ----------
    per_tangent
        Widths and heights of the whole film per unit of the tangent, across and down.
    lever
        By how much more than by its depth over the focal length in pixels a film point farther back sees less: 1 where
        the pupils are as large as each other.
    distortion
        ``traced lens``: the true projection bends away from this one as the lens does.
    """
    width, height = scene.film.resolution
    sign = 1.0 if scene.camera.flip else -1.0
    focal = sign * per_tangent[0] * width, sign * per_tangent[1] * height
    frame = film_frame(scene.camera)
    if frame.is_flat:
        per_mm = [sign * pixels / (2 * half) for pixels, half in zip((width, height), half_film_mm(scene), strict=True)]
        cx, cy = width / 2 + frame.centre[0] * per_mm[0], height / 2 - frame.centre[1] * per_mm[1]
        return {"fx": focal[0], "fy": focal[1], "cx": cx, "cy": cy, "distortion": distortion}
    return {"matrix": _homography(scene, per_tangent, lever), "distortion": distortion}


def _homography(scene: Scene, per_tangent: tuple[float, float], lever: float) -> list[list[float]]:
    """Return the 3x3 matrix by rows from tangents in the scene to columns and rows of a film that is turned."""
    frame, half = film_frame(scene.camera), np.array(half_film_mm(scene))
    distance = 2 * half[0] * per_tangent[0]  # of an equivalent pinhole, turned with the film
    # a point of the film, in sides of the picture from its centre, lies at centre - x across - y up behind the pinhole
    sides = [-np.array(side) * length for side, length in zip((frame.across, frame.up), half, strict=True)]
    columns = np.stack([*sides, np.array([*frame.centre, distance])], axis=1)
    columns[2, :2] *= lever
    to_picture = np.linalg.inv(columns) @ np.diag([-1.0, -1.0, 1.0])
    (width, height), sign = scene.film.resolution, 1.0 if scene.camera.flip else -1.0
    pixels = np.array([[sign * width / 2, 0, width / 2], [0, -sign * height / 2, height / 2], [0, 0, 1]])
    rows: list[list[float]] = (pixels @ to_picture * distance).tolist()
    return rows


def camera_geometry(scene: Scene) -> dict[str, Any]:
    """Return pose [m], resolution and size of the film, and the nearest distance seen by a pinhole.

    ``world_from_camera`` is the 4x4 matrix by rows whose columns are right, up, back and eye, in the axes of the scene;
    of a moving camera when the shutter opens, and ``world_from_camera_at_close`` when the last light falls on the film.
    """
    camera, (opens, closes) = scene.camera, scene.shutter.span_s
    last = {"world_from_camera_at_close": _matrix(scene, closes)} if camera.motion else {}
    moves = camera.motion or any(item.motion for item in scene.objects)
    sliced = None if scene.shutter.keys else {"keys", "steps"}
    width, height = scene.film.size_m()
    near_m = getattr(scene.camera, "near_m", None)
    return {
        "world_from_camera": _matrix(scene, opens),
        **last,
        **({"shutter": scene.shutter.model_dump(exclude_none=True, exclude=sliced)} if moves else {}),
        "resolution": list(scene.film.resolution),
        "film_size_mm": [width * 1e3, height * 1e3],
        **({"near_m": near_m} if near_m else {}),
    }


def _matrix(scene: Scene, time_s: float) -> list[list[float]]:
    """Return the rows of the pose at a moment [m]."""
    matrix = pose_matrix(scene.camera.pose_at(time_s))
    matrix[:3, 3] *= scene.metres_per_unit
    rows: list[list[float]] = matrix.tolist()
    return rows
