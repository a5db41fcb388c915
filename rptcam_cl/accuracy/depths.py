"""How far away what a picture can show is: bounds from the boxes of a scene's objects, without rendering."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene import Scene
from rptcam_cl.scene.mesh_shape import MeshObject
from rptcam_cl.scene.scene_object import PlacedObject
from rptcam_cl.scene.shape import Box, Object, Plane, Rectangle

Array = NDArray[np.float64]

FAR_MM = 1e9  # stands for everything farther
MOMENTS = 9  # at which objects that move are looked at
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))  # of a box's corners


@dataclass(frozen=True)
class View:
    """What a camera may see: a pyramid about its axis, cut off where it starts.

    Attributes
    ----------
    start_mm : float
        Distance ahead of the camera's eye where it starts.
    half_mm : (2,) array
        Half its width and height there.
    slopes : (2,) array
        What they grow by per distance.
    """

    start_mm: float
    half_mm: Array
    slopes: Array

    def sides(self) -> tuple[Array, Array]:
        """Return normals (5, 3) and offsets (5,): points p of the camera's frame with n p + c >= 0 lie within."""
        normals, offsets = [(0.0, 0.0, 1.0)], [-self.start_mm]
        for axis in (0, 1):
            for sign in (1.0, -1.0):
                normals.append((sign * (axis == 0), sign * (axis == 1), float(self.slopes[axis])))
                offsets.append(float(self.half_mm[axis] - self.slopes[axis] * self.start_mm))
        return np.array(normals), np.array(offsets)

    def corners(self) -> tuple[Array, Array]:
        """Return where its edges and its axis start (5, 3), and their directions."""
        signs = np.array([(0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=np.float64)
        starts = np.column_stack([signs * self.half_mm, np.full(5, self.start_mm)])
        return starts, np.column_stack([signs * self.slopes, np.ones(5)])


def depth_range_mm(scene: Scene, view: View) -> tuple[float, float]:
    """Return the least and largest distance ahead of the camera's eye, along its axis, of what it may see [mm].

    Of objects, the parts of their boxes within the view count. Where nothing bounds the view, as under a sky, the far
    end is `FAR_MM`.
    """
    found = [FAR_MM] if scene.environment is not None else []
    from_world = np.linalg.inv(scene.camera.world_from_camera() * _columns(scene))
    from_world[2] *= -1.0  # z ahead
    for item in scene.objects:
        if isinstance(item, MeshObject):
            scene.load_mesh(item)
        for world_from_object in _over_time(scene, item):
            placed = from_world @ world_from_object
            found += _plane_depths(item, placed, view) if isinstance(item, Plane) else _depths(item, placed, view)
    depths = np.clip(found or [FAR_MM], view.start_mm, FAR_MM)
    return float(depths.min()), float(depths.max())


def _columns(scene: Scene) -> Array:
    """Return what makes the lengths of a camera's frame millimetres of the scene's units."""
    per_mm = 1e-3 / scene.metres_per_unit
    return np.array([per_mm, per_mm, per_mm, 1.0])


def _over_time(scene: Scene, item: Object) -> list[Array]:
    """Return the places of an object while the shutter is open."""
    if item.course is None:
        return [item.world_from_object]
    shutter = scene.shutter
    return [item.placed_at(time_s) for time_s in np.linspace(shutter.open_s, shutter.open_s + shutter.time_s, MOMENTS)]


def _depths(item: PlacedObject, placed: Array, view: View) -> list[float]:
    """Return the ends of the distances at which the view cuts the box of an object, nothing where it does not."""
    if isinstance(item, Rectangle):
        corner, u, v = (np.array(edge) for edge in (item.corner, item.edge_u, item.edge_v))
        faces = [np.array([corner, corner + u, corner + u + v, corner + v])]
    else:
        box = np.array(list(product(*zip(*item.bounds(), strict=True))))
        faces = [box[list(face)] for face in FACES]
    seen = [_within(_moved(face, placed), view) for face in faces]
    found = [depth for polygon in seen for depth in polygon[:, 2].tolist()]
    if not isinstance(item, (Rectangle, Box)) and _holds_start(item, placed, view):
        found.append(view.start_mm)
    return found


def _moved(points: Array, matrix: Array) -> Array:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _within(polygon: Array, view: View) -> Array:
    """Return the part of a polygon (n, 3) that lies in the view (Sutherland and Hodgman 1974)."""
    for normal, offset in zip(*view.sides(), strict=True):
        side = polygon @ normal + offset
        following, after = np.roll(polygon, -1, axis=0), np.roll(side, -1)
        crossing = (side < 0) != (after < 0)
        share = np.where(crossing, side / np.where(crossing, side - after, 1.0), 0.0)[:, None]
        both = np.stack([polygon, polygon + share * (following - polygon)], axis=1)
        polygon = both[np.stack([side >= 0, crossing], axis=1)]
        if not len(polygon):
            break
    return np.asarray(polygon)


def _holds_start(item: PlacedObject, placed: Array, view: View) -> bool:
    """Return whether the box of an object holds a corner or the middle of where the view starts."""
    low, high = item.bounds()
    points = _moved(view.corners()[0], np.asarray(np.linalg.inv(placed), dtype=np.float64))
    return bool(np.any(np.all((points >= low) & (points <= high), axis=1)))


def _plane_depths(item: Plane, placed: Array, view: View) -> list[float]:
    """Return the distances at which the edges of the view and its axis meet a plane; the far end beyond the horizon."""
    normal = np.linalg.inv(placed[:3, :3]).T @ np.array(item.normal)
    starts, directions = view.corners()
    height = (_moved(np.array([item.point]), placed) - starts) @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = height / (directions @ normal)
    seen = steps > 0
    ends: list[float] = (view.start_mm + steps[seen]).tolist()
    return ends + ([] if seen.all() or not seen.any() else [FAR_MM])
