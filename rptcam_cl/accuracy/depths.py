"""How far away what a picture can show is: bounds from the boxes of a scene's objects, without rendering."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene import Scene
from rptcam_cl.scene.checks import to_world, world_corners
from rptcam_cl.scene.mesh_shape import MeshObject
from rptcam_cl.scene.shape import Plane

Array = NDArray[np.float64]

NEAREST_MM = 1.0  # ahead of the film: what lies nearer is inside the camera
FAR_MM = 1e9  # stands for everything farther


def depth_range_mm(scene: Scene, half_tangents: tuple[float, float]) -> tuple[float, float]:
    """Return the least and largest distance ahead of the camera's eye, along its axis, of what it may see [mm].

    Boxes that lie wholly behind the eye do not count; of a plane, the points that the corners and the middle of the
    picture see. Where nothing bounds the view, as under a sky, the far end is `FAR_MM`.

    Parameters
    ----------
    half_tangents
        Of half the field of view across and down.
    """
    matrix = scene.camera.world_from_camera()
    to_mm = scene.metres_per_unit * 1e3
    found = [np.array([FAR_MM])] if scene.environment is not None else []
    for item in scene.objects:
        if isinstance(item, Plane):
            found.append(_plane_depths(item, matrix, half_tangents) * to_mm)
            continue
        if isinstance(item, MeshObject):
            scene.load_mesh(item)
        corners = world_corners(item)
        depths = (matrix[:3, 3] - corners) @ matrix[:3, 2] * to_mm
        if depths.max() > NEAREST_MM:
            found.append(np.array([depths.min(), depths.max()]))
    depths = np.concatenate(found) if found else np.array([FAR_MM])
    depths = np.clip(depths, NEAREST_MM, FAR_MM)
    return float(depths.min()), float(depths.max())


def _plane_depths(item: Plane, matrix: Array, half_tangents: tuple[float, float]) -> Array:
    """Return the distances along the axis at which the corners and the middle of the picture see a plane."""
    normal = np.linalg.inv(item.world_from_object[:3, :3]).T @ np.array(item.normal)
    height = (to_world(item, np.array([item.point]))[0] - matrix[:3, 3]) @ normal
    across, down = half_tangents
    aims = np.array([(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0)]) * (across, down)
    rays = aims[:, :1] * matrix[:3, 0] + aims[:, 1:] * matrix[:3, 1] - matrix[:3, 2]
    with np.errstate(divide="ignore"):
        depths = height / (rays @ normal)
    seen = depths > 0
    return np.append(depths[seen], [] if seen.all() else np.inf)
