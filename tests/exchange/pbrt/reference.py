"""pbrt's own conventions in float64, written from its book: matrices, screen and raster, and which ray a pixel sees."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def translate(*by: float) -> Array:
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


def scale(*factors: float) -> Array:
    return np.diag([*factors, 1.0])


def rotate_x(degrees: float) -> Array:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def rotate_y(degrees: float) -> Array:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])


def rotate_z(degrees: float) -> Array:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def look_at(eye: ArrayLike, target: ArrayLike, up: ArrayLike) -> Array:
    """Camera from world: the camera's x is up x direction, its z the direction."""
    z = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
    x = np.cross(np.asarray(up) / np.linalg.norm(up), z)
    x /= np.linalg.norm(x)
    world_from_camera = np.eye(4)
    world_from_camera[:3] = np.stack([x, np.cross(z, x), z, np.asarray(eye, float)], axis=1)
    return np.linalg.inv(world_from_camera)


def raster_of(
    camera_from_world: Array, points: ArrayLike, fov: float, size: tuple[int, int], window: Any = None
) -> Array:
    """Pixel coordinates (x right, y down) of world points: fov spans the shorter side of the film."""
    width, height = size
    aspect = width / height
    x0, x1, y0, y1 = window or ((-aspect, aspect, -1, 1) if aspect > 1 else (-1, 1, -1 / aspect, 1 / aspect))
    p = np.asarray(points) @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    screen = p[:, :2] / p[:, 2:] / math.tan(math.radians(fov) / 2)
    return np.stack(
        [(screen[:, 0] - x0) / (x1 - x0) * width, (y1 - screen[:, 1]) / (y1 - y0) * height],
        axis=1,
    )
