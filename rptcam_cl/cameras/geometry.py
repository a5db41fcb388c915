"""The geometry of a camera for programs that measure in its pictures: pose, film and intrinsics."""

from __future__ import annotations

from typing import Any, Literal

from rptcam_cl.scene import Film, Scene, pose_matrix


def intrinsics(
    film: Film, per_tangent: tuple[float, float], *, flip: bool, distortion: Literal["none", "traced lens"] = "none"
) -> dict[str, Any]:
    """Return what projects a point (x, y, z) of the camera's frame on the picture, in pixels of the whole film.

    The point is seen at column ``cx + fx x / -z`` and row ``cy - fy y / -z``; pixel (0, 0) covers 0 to 1.

    Parameters
    ----------
    per_tangent
        Widths and heights of the whole film per unit of the tangent, across and down.
    flip
        Whether the picture is upright; otherwise ``fx`` and ``fy`` are negative.
    distortion
        ``traced lens``: the true projection bends away from this one as the lens does.
    """
    width, height = film.resolution
    sign = 1.0 if flip else -1.0
    return {
        "fx": sign * per_tangent[0] * width,
        "fy": sign * per_tangent[1] * height,
        "cx": width / 2,
        "cy": height / 2,
        "distortion": distortion,
    }


def camera_geometry(scene: Scene) -> dict[str, Any]:
    """Return pose [m], resolution and size of the film, and the nearest distance seen by a pinhole.

    ``world_from_camera`` is the 4x4 matrix by rows whose columns are right, up, back and eye, in the axes of the scene;
    of a moving camera when the shutter opens, and ``world_from_camera_at_close`` when the last light falls on the film.
    """
    camera, (opens, closes) = scene.camera, scene.shutter.span_s
    last = {"world_from_camera_at_close": _matrix(scene, closes)} if camera.motion else {}
    moves = camera.motion or any(item.motion for item in scene.objects)
    width, height = scene.film.size_m()
    near_m = getattr(scene.camera, "near_m", None)
    return {
        "world_from_camera": _matrix(scene, opens),
        **last,
        **({"shutter": scene.shutter.model_dump(exclude_none=True)} if moves else {}),
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
