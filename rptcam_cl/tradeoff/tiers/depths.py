"""How far away what a picture can show is: bounds from the boxes of objects in view, without rendering."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes import MeshPlacement
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import Box, Emissive, LoadedMesh, Material, Matte, Mix, Object, Plane, Rectangle, Scene, Solid

Array = NDArray[np.float64]

MOST_CUT = 200  # triangles that are cut to the view; of more, which then are small, all corners count


@dataclass(frozen=True)
class VisibleWorld:
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


def within(polygon: Array, view: VisibleWorld) -> Array:
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


def triangle_depths(triangles: Array, view: VisibleWorld) -> list[float]:
    """Return the ends of the distances at which a view shows triangles (n, 3, 3); nothing where it does not."""
    normals, offsets = view.sides()
    inside = triangles @ normals.T + offsets >= 0
    whole = np.all(inside, axis=(1, 2))
    cut = triangles[np.all(np.any(inside, axis=1), axis=1) & ~whole]  # the others lie wholly beyond one side
    pieces = [within(triangle, view) for triangle in cut] if len(cut) <= MOST_CUT else [cut.reshape(-1, 3)]
    seen = np.concatenate([triangles[whole].reshape(-1, 3), *pieces])
    return [float(seen[:, 2].min()), float(seen[:, 2].max())] if len(seen) else []


FAR_MM = 1e9  # stands for everything farther
MOMENTS = 9  # at which objects that move are looked at
FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))  # of a box's corners


def depth_range_mm(scene: Scene, view: VisibleWorld) -> tuple[float, float]:
    """Return the least and largest distance ahead of the camera's eye, along its axis, of what it may see [mm].

    Of objects, the parts of their boxes within the view count. Where nothing bounds the view, as under a sky, the far
    end is `FAR_MM`; so it is where something in view reflects or refracts, whose images lie farther back than itself.
    """
    found = [FAR_MM] if scene.environment is not None else []
    from_world = np.linalg.inv(scene.camera.world_from_camera() * _columns(scene))
    from_world[2] *= -1.0  # z ahead
    for item, solid in zip(scene.objects, scene.solids(), strict=True):
        seen: list[float] = []
        for world_from_object in _over_time(scene, item):
            placed = from_world @ world_from_object
            seen += _plane_depths(item, placed, view) if isinstance(item, Plane) else _depths(solid, placed, view)
        found += seen
        if seen and any(map(_shows_images, solid.shown_materials())):
            found.append(FAR_MM)
    depths = np.clip(found or [FAR_MM], view.start_mm, FAR_MM)
    return float(depths.min()), float(depths.max())


def _shows_images(material: Material) -> bool:
    """Return whether a surface may show more than itself: all but matte ones and lamps."""
    if isinstance(material, Mix):
        return any(map(_shows_images, material.materials))
    return not isinstance(material, Matte | Emissive)


def _columns(scene: Scene) -> Array:
    """Return what makes the lengths of a camera's frame millimetres of the scene's units."""
    per_mm = 1e-3 / scene.metres_per_unit
    return np.array([per_mm, per_mm, per_mm, 1.0])


def _over_time(scene: Scene, item: Object) -> list[Array]:
    """Return the places of an object while the shutter is open."""
    if item.trajectory is None:
        return [item.world_from_object]
    shutter = scene.shutter
    return [item.placed_at(time_s) for time_s in np.linspace(shutter.open_s, shutter.open_s + shutter.time_s, MOMENTS)]


def _depths(item: Solid, placed: Array, view: VisibleWorld) -> list[float]:
    """Return the ends of the distances at which the view cuts an object, nothing where it does not."""
    if isinstance(item, Rectangle):
        corner, u, v = (np.array(edge) for edge in (item.corner, item.edge_u, item.edge_v))
        return _faces([_moved(np.array([corner, corner + u, corner + u + v, corner + v]), placed)], view)
    if isinstance(item, LoadedMesh):
        return [depth for part in item.contents.parts for depth in _part_depths(part, placed, view)]
    box = _moved(np.array(list(product(*zip(*item.bounds(), strict=True)))), placed)
    around = not isinstance(item, Box) and _holds_start(box, view)
    return _box_faces(box, view) + [view.start_mm] * around


def _part_depths(part: MeshPlacement, placed: Array, view: VisibleWorld) -> list[float]:
    """Return the same for a part of a mesh: by its box, or by its triangles where the view starts within."""
    box = _moved(part.corners(), placed)
    if not _holds_start(box, view):
        return _box_faces(box, view)
    vertices = _moved(part.mesh.positions + part.mesh.origin, placed @ part.placement)
    return triangle_depths(vertices[part.mesh.faces], view)


def _box_faces(box: Array, view: VisibleWorld) -> list[float]:
    return _faces([box[list(face)] for face in FACES], view)


def _faces(faces: list[Array], view: VisibleWorld) -> list[float]:
    return [depth for face in faces for depth in within(face, view)[:, 2].tolist()]


def _holds_start(box: Array, view: VisibleWorld) -> bool:
    """Return whether a box of eight corners holds a corner or the middle of where the view starts."""
    edges = box[[4, 2, 1]] - box[0]
    if not np.all(np.any(edges, axis=1)):
        return False  # flat
    shares = (view.corners()[0] - box[0]) @ np.linalg.inv(edges)
    return bool(np.any(np.all((shares >= 0) & (shares <= 1), axis=1)))


def _moved(points: Array, matrix: Array) -> Array:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _plane_depths(item: Plane, placed: Array, view: VisibleWorld) -> list[float]:
    """Return the distances at which the edges of the view and its axis meet a plane; the far end beyond the horizon."""
    normal = np.linalg.inv(placed[:3, :3]).T @ np.array(item.normal)
    starts, directions = view.corners()
    height = (_moved(np.array([item.point]), placed) - starts) @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = height / (directions @ normal)
    seen = steps > 0
    ends: list[float] = (view.start_mm + steps[seen]).tolist()
    return ends + ([] if seen.all() or not seen.any() else [FAR_MM])
