"""Where the camera stands, and which way round the world of ours is.

pbrt's world is left-handed: the same numbers in our right-handed one would show everything in a mirror, unless the
file begins with ``Scale -1 1 1`` as those do that come from right-handed programs. So the x axis is reversed if, and
only if, a picture would be mirrored otherwise; scenes of right-handed programs keep their coordinates.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.state import Entity
from rptcam_cl.importers.pbrt.transforms import Matrix, apply, is_invertible, mean_scale, tidy

Array = NDArray[np.float64]

# Scales that are 1 but for the digits of a matrix that was written out.
ROUNDING = 1e-4

MILLIMETRE = 1e-3  # metres

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])

# What each axis of pbrt's camera is in the picture: right, up and the middle of what is seen.
AXES = {
    "perspective": np.eye(3),
    # phi of its picture runs from +x over +z: the middle column looks to -x, what lies right of it to -z
    "environment": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
}


@dataclass(frozen=True, eq=False)
class Frame:
    """The camera's place, in the world of ours.

    Attributes
    ----------
    world : (4, 4) array
        Maps pbrt's world to ours: the identity, or `MIRROR`.
    eye, forward, up : (3,) arrays
    metres_per_unit : float
        Length of a unit of the world, when one unit of the camera's space is a metre, as pbrt has it for lenses (or a
        millimetre, see `in_millimetres`).
    stretch : (2,) array
        Factors that uneven scaling puts on the width and height of what is seen; 1 for nearly every scene.
    """

    world: Matrix
    eye: Array
    forward: Array
    up: Array
    metres_per_unit: float
    stretch: Array

    def pose(self) -> dict[str, Any]:
        """Return the keys of a camera's pose; the target lies one unit before the eye."""
        return {
            "eye": tidy(self.eye),
            "target": tidy(self.eye + self.forward),
            "up": tidy(self.up),
        }


def in_millimetres(camera: Entity) -> bool:
    """Return whether a unit of the camera's space is a millimetre: for the lens camera that plugs into pbrt-v2.

    It is that of the course assignments (Stanford CS 348b, HW3), whose lens files and film are in millimetres.
    """
    return camera.kind == "realistic" and camera.parameters.has("specfile")


def frame_of(camera: Entity) -> Frame:
    """Return the frame of a camera.

    Raises
    ------
    InputError
        When its transform cannot be inverted.
    """
    if not is_invertible(camera.world_from_object):
        raise camera.place.error(f"{camera.what}: the transform before it cannot be inverted")
    world_from_camera = np.asarray(np.linalg.inv(camera.world_from_object), np.float64)
    whole = camera.kind in ("environment", "spherical")
    axes = AXES["environment" if whole else "perspective"]
    right, up, forward = (world_from_camera[:3, :3] @ axes.T).T
    world = MIRROR if right @ np.cross(forward, up) < 0 else np.eye(4)
    eye = apply(world, world_from_camera[None, :3, 3])[0]
    lengths = np.linalg.norm(world_from_camera[:3, :3], axis=0)
    stretch = lengths[:2] / lengths[2]
    if np.allclose(stretch, 1, rtol=0, atol=ROUNDING):
        stretch = np.ones(2)
    unit = mean_scale(camera.world_from_object) * (MILLIMETRE if in_millimetres(camera) else 1.0)
    forward, up = (world[:3, :3] @ (axis / np.linalg.norm(axis)) for axis in (forward, up))
    reach = max(1.0, float(np.abs(eye).max()) * 1e-3)  # so that eye + forward keeps its digits
    return Frame(world, eye, forward * reach, up, 1.0 if abs(unit - 1) < ROUNDING else unit, stretch)
