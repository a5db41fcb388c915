"""Objects: a shape, its material and where it is placed."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rptcam_cl.core.vectors import cross
from rptcam_cl.scene.base import refuse
from rptcam_cl.scene.board import Board
from rptcam_cl.scene.mesh import MeshObject
from rptcam_cl.scene.quantities import SMALLEST_LENGTH, Direction, Length, Position
from rptcam_cl.scene.scene_object import Bounds, SceneObject


def _disk_reach(normal: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return how far a disk reaches from its centre along x, y and z."""
    unit = normal / np.linalg.norm(normal)
    return np.asarray(radius * np.sqrt(np.clip(1 - unit**2, 0, 1)))


class Sphere(SceneObject):
    """A sphere; u runs once round its z axis, v from the lowest point (-z) to the highest."""

    shape: Literal["sphere"]
    """Kind of shape."""

    center: Position
    """Centre [scene units]."""

    radius: Length
    """Radius [scene units]."""

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the sphere."""
        center = np.array(self.center)
        return center - self.radius, center + self.radius

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the sphere."""
        return bool(np.linalg.norm(point - self.center) < self.radius)


class Disk(SceneObject):
    """A flat disk; u and v are the in-plane coordinates divided by the radius, -1 to 1."""

    shape: Literal["disk"]
    """Kind of shape."""

    center: Position
    """Centre [scene units]."""

    normal: Direction
    """Direction of the front side; any length."""

    radius: Length
    """Radius [scene units]."""

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the disk."""
        center, reach = np.array(self.center), _disk_reach(np.array(self.normal), self.radius)
        return center - reach, center + reach


class Rectangle(SceneObject):
    """A flat parallelogram; u and v run from 0 to 1 along its edges, the normal is edge_u x edge_v."""

    shape: Literal["rectangle"]
    """Kind of shape."""

    corner: Position
    """The corner where u = v = 0 [scene units]."""

    edge_u: Direction
    """Edge from the corner along u [scene units]."""

    edge_v: Direction
    """Edge from the corner along v [scene units]."""

    @model_validator(mode="after")
    def _check_area(self) -> Self:
        u, v = np.array(self.edge_u), np.array(self.edge_v)
        if np.linalg.norm(cross(u / np.linalg.norm(u), v / np.linalg.norm(v))) < 1e-6:
            raise refuse("is parallel to edge_u, so the rectangle has no area", got=list(self.edge_v), path=("edge_v",))
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the rectangle."""
        corner, u, v = np.array(self.corner), np.array(self.edge_u), np.array(self.edge_v)
        corners = np.array([corner, corner + u, corner + v, corner + u + v])
        return corners.min(axis=0), corners.max(axis=0)


class Box(SceneObject):
    """A box along the axes; u and v run from 0 to 1 over each face, along its two axes in alphabetical order."""

    shape: Literal["box"]
    """Kind of shape."""

    min: Position
    """Corner of lowest coordinates [scene units]."""

    max: Position
    """Corner of highest coordinates [scene units]."""

    @model_validator(mode="after")
    def _check_volume(self) -> Self:
        for index, (low, high) in enumerate(zip(self.min, self.max, strict=True)):
            if high - low < SMALLEST_LENGTH:
                raise refuse("is not above min", got=high, allowed=f"more than {low:g}", path=("max", index))
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the box."""
        return np.array(self.min), np.array(self.max)

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the box."""
        return bool(np.all(point > self.min) and np.all(point < self.max))


class Cylinder(SceneObject):
    """A circular cylinder; u runs once round the axis, v from base to top."""

    shape: Literal["cylinder"]
    """Kind of shape."""

    base: Position
    """Centre of the lower end [scene units]."""

    top: Position
    """Centre of the upper end [scene units]."""

    radius: Length
    """Radius [scene units]."""

    capped: bool = Field(default=True, strict=True)
    """Whether both ends are closed by disks."""

    @model_validator(mode="after")
    def _check_height(self) -> Self:
        _check_apart(self.base, self.top, "top")
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the cylinder."""
        base, top = np.array(self.base), np.array(self.top)
        reach = _disk_reach(top - base, self.radius)
        return np.minimum(base, top) - reach, np.maximum(base, top) + reach

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the closed cylinder."""
        height, distance = _along_axis(point, np.array(self.base), np.array(self.top))
        return self.capped and 0 < height < 1 and distance < self.radius


class Cone(SceneObject):
    """A circular cone; u runs once round the axis, v from base to apex."""

    shape: Literal["cone"]
    """Kind of shape."""

    base: Position
    """Centre of the base [scene units]."""

    apex: Position
    """Tip [scene units]."""

    radius: Length
    """Radius of the base [scene units]."""

    capped: bool = Field(default=True, strict=True)
    """Whether the base is closed by a disk."""

    @model_validator(mode="after")
    def _check_height(self) -> Self:
        _check_apart(self.base, self.apex, "apex")
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the cone."""
        base, apex = np.array(self.base), np.array(self.apex)
        reach = _disk_reach(apex - base, self.radius)
        return np.minimum(base - reach, apex), np.maximum(base + reach, apex)

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point lies inside the closed cone."""
        height, distance = _along_axis(point, np.array(self.base), np.array(self.apex))
        return self.capped and 0 < height < 1 and distance < self.radius * (1 - height)


class Plane(SceneObject):
    """An infinite plane; u and v are scene units along x and y of the frame that turns +z into the normal."""

    shape: Literal["plane"]
    """Kind of shape."""

    point: Position
    """A point of the plane, where u = v = 0 [scene units]."""

    normal: Direction
    """Direction of the front side; any length."""


def _check_apart(base: tuple[float, ...], end: tuple[float, ...], key: str) -> None:
    if np.linalg.norm(np.subtract(end, base)) < SMALLEST_LENGTH:
        raise refuse("equals base, so there is no axis", got=list(end), path=(key,))


def _along_axis(point: NDArray[np.float64], base: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[float, float]:
    """Return the height of a point along an axis as a fraction of it, and its distance from the axis."""
    axis = end - base
    height = float((point - base) @ axis / (axis @ axis))
    return height, float(np.linalg.norm(point - base - height * axis))


Object = Annotated[
    Sphere | Disk | Rectangle | Box | Cylinder | Cone | Plane | MeshObject | Board, Field(discriminator="shape")
]
