"""What the objects of a scene have in common."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rptcam_cl.scene.base import AlsoAccepts, SceneModel
from rptcam_cl.scene.material import Material
from rptcam_cl.scene.motion import ObjectMotion, Trajectory
from rptcam_cl.scene.transform import Transform, product

Bounds = tuple[NDArray[np.float64], NDArray[np.float64]]

MATERIAL_NAME = AlsoAccepts({"type": "string", "description": "Name of one of `materials`."})


class PlacedObject(SceneModel):
    """What every object has."""

    name: Annotated[str, Field(max_length=200)] | None = None
    """Name of the object, for the reader."""

    label: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    """Class of the object, as chair: of semantic masks and annotations."""

    transform: Transform = ()
    """One step or a list of steps, applied in their order to the shape as described by its own keys."""

    motion: ObjectMotion = ()
    """Where it is over time, after its transform; without keyframes it stands still."""

    @cached_property
    def world_from_object(self) -> NDArray[np.float64]:
        """Return the 4x4 matrix of the transform (read-only); its determinant is negative when it reflects."""
        matrix = product(self.transform)
        matrix.setflags(write=False)
        return matrix

    @property
    def trajectory(self) -> Trajectory | None:
        """Return its way through the keyframes, None where it has none."""
        return Trajectory(self.motion) if self.motion else None

    def placed_at(self, time_s: float) -> NDArray[np.float64]:
        """Return the 4x4 matrix that places the object in the world at a moment: its transform, then its motion."""
        matrix = self.world_from_object
        return matrix if self.trajectory is None else self.trajectory.at(time_s) @ matrix


class Solid(Protocol):
    """What is known of an object once its files are read."""

    def shown_materials(self) -> tuple[Material, ...]:
        """Return the materials that the object shows."""

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the shape before its transform [scene units]."""

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point, in the frame before the transform, lies inside the solid."""


class SceneObject(PlacedObject):
    """An object that has one material, and a shape of a few numbers."""

    material: Annotated[Material, MATERIAL_NAME]
    """Name of one of `materials`, or a material written out as a mapping."""

    def shown_materials(self) -> tuple[Material, ...]:
        """Return the object's material."""
        return (self.material,)

    def bounds(self) -> Bounds:
        """Return the lowest and highest corner of the shape before its transform [scene units]."""
        raise NotImplementedError

    def contains(self, point: NDArray[np.float64]) -> bool:
        """Return whether a point, in the frame before the transform, lies inside the solid."""
        return False
