"""How much of the world the picture shows, as far as moving the camera needs it."""

from __future__ import annotations

import math

from rptcam_cl.scene import LensCamera, PinholeCamera, Scene, ThinLensCamera

_WIDE = 1.0  # width at distance 1 where no field angle says: of cameras that see all around


def field_at_one(scene: Scene) -> float:
    """Return the width of what the picture shows at distance 1, first-order, of a scene in focus."""
    camera = scene.camera
    width, height = scene.film.size_m()
    if isinstance(camera, PinholeCamera | ThinLensCamera) and camera.fov_degrees is not None:
        across = 2 * math.tan(math.radians(camera.fov_degrees) / 2)
        sides = {"horizontal": width, "vertical": height, "diagonal": math.hypot(width, height)}
        return across * width / sides[camera.fov_axis]
    if isinstance(camera, ThinLensCamera) and camera.focal_length_mm is not None:
        return width / (camera.focal_length_mm * 1e-3)
    if isinstance(camera, LensCamera):
        focal_length_mm = camera.focal_length_mm or scene.load_lens().first_order().focal_length_mm
        return width / abs(focal_length_mm * 1e-3)
    return _WIDE


def distance_in_focus(scene: Scene) -> float | None:
    """Return how far in front of the eye the plane in focus lies [scene units]; None where that is not known."""
    camera = scene.camera
    if isinstance(camera, ThinLensCamera) and camera.focus_distance_m is not None:
        return camera.focus_distance_m / scene.metres_per_unit
    if isinstance(camera, LensCamera):
        if camera.focus.point is not None:
            return camera.ahead(camera.focus.point)
        distance_m = camera.focus.distance_m or camera.focus.front_distance_m
        return None if distance_m is None else distance_m / scene.metres_per_unit
    return None
