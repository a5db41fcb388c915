"""Rays at the meshes of scene C: from the camera, diffuse bounces in order and shuffled, and towards the lamp."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]
Nearest = Callable[["Rays"], tuple[NDArray[np.float32], NDArray[np.int32]]]
TILE = 4  # pixels of a tile's side; camera rays go tile by tile, as in the renderer
OFFSET = 1e-4  # of the distance: how far from the surface bounces start, so that no renderer meets it again
MULTIPLE = 64  # of rays in a set
FAR = 1e30  # farther than anything, yet finite


@dataclass(frozen=True)
class Rays:
    """Rays in the frame of the scene on the device, the eye at the origin.

    Attributes
    ----------
    rows : (7, n) float32 array
        Origin, unit direction, and how far anything counts.
    shadow : bool
        Whether it matters only if there is anything.
    """

    name: str
    rows: NDArray[np.float32]
    shadow: bool = False

    @property
    def count(self) -> int:
        """Number of rays."""
        return self.rows.shape[1]


def _rays(name: str, origins: Array, directions: Array, reach: Array | float = FAR, *, shadow: bool = False) -> Rays:
    count = len(directions) // MULTIPLE * MULTIPLE
    rows = np.empty((7, count), np.float32)
    rows[:3], rows[3:6] = np.broadcast_to(origins, directions.shape)[:count].T, directions[:count].T
    rows[6] = reach if np.isscalar(reach) else np.asarray(reach)[:count]
    return Rays(name, rows, shadow)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def camera_rays(scene: Scene, width: int, height: int) -> Rays:
    """Return one jittered ray per pixel through a pinhole, tile by tile."""
    camera = scene.camera
    assert camera.kind == "pinhole" and camera.fov_axis == "horizontal"
    y, x = (index.ravel() for index in np.mgrid[:height, :width])
    order = np.lexsort((x % TILE, y % TILE, x // TILE, y // TILE))
    jitter = np.random.default_rng(1).random((2, len(order)))
    half = np.tan(np.radians(camera.fov_degrees) / 2)
    across = (2 * (x[order] + jitter[0]) / width - 1) * half
    up = (1 - 2 * (y[order] + jitter[1]) / height) * half * height / width
    directions = np.stack([across, up, np.full(len(order), -1.0)], axis=1)
    return _rays("primary", np.zeros(3), _unit(directions @ camera.world_from_camera()[:3, :3].T))


def ray_sets(
    scene: Scene, size: tuple[int, int], vertices: NDArray[np.float32], triangles: NDArray[np.int32], nearest: Nearest
) -> list[Rays]:
    """Return the sets of rays.

    Parameters
    ----------
    size
        Camera rays across and down.
    vertices, triangles
        The meshes in the frame of the device.
    nearest
        Returns distance and triangle (-1: none) of what rays meet first.
    """
    primary = camera_rays(scene, *size)
    t, triangle = nearest(primary)
    met = triangle >= 0
    directions = primary.rows[3:6, met].T.astype(np.float64)
    a, b, c = (vertices[triangles[triangle[met], corner], :3].astype(np.float64) for corner in range(3))
    normals = _unit(np.cross(b - a, c - a))
    normals *= -np.sign((normals * directions).sum(axis=1, keepdims=True))
    points = directions * t[met, None] + normals * OFFSET * t[met, None]
    random = np.random.default_rng(2)
    bounces = _unit(normals + _unit(random.standard_normal(points.shape)))
    shuffle = random.permutation(len(points))
    to_lamp = _lamp_points(scene, len(points), random) - points
    above = (to_lamp * normals).sum(axis=1) > 0
    to_lamp, distance = _unit(to_lamp[above]), np.linalg.norm(to_lamp[above], axis=1)
    return [
        primary,
        _rays("diffuse bounce", points, bounces),
        _rays("the same, shuffled", points[shuffle], bounces[shuffle]),
        _rays("shadow", points[above], to_lamp, (1 - OFFSET) * distance, shadow=True),
    ]


def _lamp_points(scene: Scene, count: int, random: np.random.Generator) -> Array:
    lamp = next(item for item in scene.objects if getattr(item.material, "kind", None) == "emissive")
    assert lamp.shape == "rectangle"
    u, v = random.random((2, count, 1))
    return np.asarray(np.array(lamp.corner) + u * np.array(lamp.edge_u) + v * np.array(lamp.edge_v) - scene.camera.eye)
