"""How far away what a picture can show is: bounds from the boxes of a scene's objects, without rendering."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.accuracy.view import View, triangle_depths, within
from rptcam_cl.mesh_files.contents import PlacedMesh
from rptcam_cl.scene import Scene
from rptcam_cl.scene.mesh_shape import MeshObject
from rptcam_cl.scene.scene_object import PlacedObject
from rptcam_cl.scene.shape import Box, Object, Plane, Rectangle

Array = NDArray[np.float64]

FAR_MM = 1e9  # stands for everything farther
MOMENTS = 9  # at which objects that move are looked at
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))  # of a box's corners


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
    """Return the ends of the distances at which the view cuts an object, nothing where it does not."""
    if isinstance(item, Rectangle):
        corner, u, v = (np.array(edge) for edge in (item.corner, item.edge_u, item.edge_v))
        return _faces([_moved(np.array([corner, corner + u, corner + u + v, corner + v]), placed)], view)
    if isinstance(item, MeshObject):
        return [depth for part in item.loaded.contents.parts for depth in _part_depths(part, placed, view)]
    box = _moved(np.array(list(product(*zip(*item.bounds(), strict=True)))), placed)
    around = not isinstance(item, Box) and _holds_start(box, view)
    return _box_faces(box, view) + [view.start_mm] * around


def _part_depths(part: PlacedMesh, placed: Array, view: View) -> list[float]:
    """Return the same for a part of a mesh: by its box, or by its triangles where the view starts within."""
    box = _moved(part.corners(), placed)
    if not _holds_start(box, view):
        return _box_faces(box, view)
    vertices = _moved(part.mesh.positions + part.mesh.origin, placed @ part.placement)
    return triangle_depths(vertices[part.mesh.faces], view)


def _box_faces(box: Array, view: View) -> list[float]:
    return _faces([box[list(face)] for face in FACES], view)


def _faces(faces: list[Array], view: View) -> list[float]:
    return [depth for face in faces for depth in within(face, view)[:, 2].tolist()]


def _holds_start(box: Array, view: View) -> bool:
    """Return whether a box of eight corners holds a corner or the middle of where the view starts."""
    edges = box[[4, 2, 1]] - box[0]
    if not np.all(np.any(edges, axis=1)):
        return False  # flat
    shares = (view.corners()[0] - box[0]) @ np.linalg.inv(edges)
    return bool(np.any(np.all((shares >= 0) & (shares <= 1), axis=1)))


def _moved(points: Array, matrix: Array) -> Array:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


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
