"""Where a camera stands and looks, at rest and while it moves."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from pydantic import Field, model_validator

from rptcam_cl.core.vectors import cross
from rptcam_cl.scene.base import SceneModel, refuse
from rptcam_cl.scene.lens_settings import CLEAN, Stop
from rptcam_cl.scene.motion import CameraMotion, Vector, place_between
from rptcam_cl.scene.quantities import SMALLEST_LENGTH, Direction, Position

# Sine of the smallest angle between up and the viewing direction that still fixes the roll in float32.
SMALLEST_ROLL_SINE = 1e-6


class Pose(SceneModel):
    """Where a camera stands and looks. It looks along -z of its own frame, with +y up and +x to the right."""

    eye: Position
    """Where the camera stands [scene units]; with a `lens`, the centre of the film."""

    target: Position
    """A point that the camera looks at [scene units]."""

    up: Direction = (0.0, 1.0, 0.0)
    """Direction that appears upwards; any length, not parallel to the view."""

    flip: bool = Field(default=True, strict=True)
    """Whether the picture is turned upright; false keeps the inverted image as it lies on the film."""

    motion: CameraMotion = ()
    """Where it is over time; without keyframes it stands still."""

    diffraction: Literal["off", "auto", "on"] = "off"
    """Whether the opening diffracts the light; `auto`: where the Airy radius is half a pixel or more."""

    stop: Stop = CLEAN
    """What lies in the plane of the stop."""

    @model_validator(mode="after")
    def _check_stop(self) -> Self:
        if self.stop.dirt is not None and self.diffraction == "off":
            raise refuse(
                "scatters light by diffraction, which is off",
                allowed="with diffraction: on or auto",
                path=("stop", "dirt"),
            )
        return self

    @model_validator(mode="after")
    def _check_pose(self) -> Self:
        forward = np.subtract(self.target, self.eye)
        distance = float(np.linalg.norm(forward))
        if distance < SMALLEST_LENGTH:
            raise refuse("equals the eye, so there is no viewing direction", got=list(self.target), path=("target",))
        roll = cross(forward / distance, np.divide(self.up, np.linalg.norm(self.up)))
        if np.linalg.norm(roll) < SMALLEST_ROLL_SINE:
            raise refuse(
                "is parallel to the viewing direction", got=list(self.up), allowed="any other direction", path=("up",)
            )
        return self

    @model_validator(mode="after")
    def _check_motion(self) -> Self:
        if not self.motion:
            return self
        own = np.array([self.eye, self.target, self.up])
        poses = np.array([self._pose_of(index, own) for index in range(len(self.motion))])
        following = np.concatenate([poses[1:], poses[-1:]])
        for index in np.flatnonzero(~_turns_little(poses, following)).tolist():
            if not _keeps_a_view(poses[index], following[index]):
                raise refuse(
                    "leads to a moment without a viewing direction, or with one parallel to up",
                    got=self.motion[index].time_s,
                    allowed="eye, target and up that give a view at every moment; keyframes in between help",
                    path=("motion", index),
                )
        return self

    def pose_at(self, time_s: float) -> Vector:
        """Return eye, target and up at a moment, (3, 3): each goes straight from keyframe to keyframe."""
        own = np.array([self.eye, self.target, self.up])
        if not self.motion:
            return own
        index, share = place_between(self.motion, time_s)
        first, second = (self._pose_of(place, own) for place in (index, min(index + 1, len(self.motion) - 1)))
        return np.asarray(first + share * (second - first))

    def _pose_of(self, index: int, own: Vector) -> Vector:
        frame = self.motion[index]
        given = (frame.eye, frame.target, frame.up)
        return np.array([row if value is None else value for value, row in zip(given, own, strict=True)])

    def world_from_camera(self) -> NDArray[np.float64]:
        """Return the 4x4 matrix whose columns are right, up, back and eye, in scene units; keyframes do not count."""
        return pose_matrix(np.array([self.eye, self.target, self.up]))


def pose_matrix(pose: Vector) -> Vector:
    """Return the 4x4 matrix whose columns are right, up, back and eye, of eye, target and up (3, 3)."""
    eye, target, up = pose
    back = (eye - target) / np.linalg.norm(eye - target)
    right = cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, cross(back, right), back, eye
    return matrix


def _turns_little(first: Vector, second: Vector) -> NDArray[np.bool_]:
    """Return where (n,) a camera between two poses (n, 3, 3) surely keeps a view, because its turn is small."""
    view, up = first[:, 1] - first[:, 0], first[:, 2]
    view_step, up_step = second[:, 1] - second[:, 0] - view, second[:, 2] - up
    view_length, up_length, view_change, up_change = (
        np.linalg.norm(vectors, axis=1) for vectors in (view, up, view_step, up_step)
    )
    side = np.linalg.norm(np.cross(up, view), axis=1)
    change = up_change * view_length + up_length * view_change + up_change * view_change
    return np.asarray(side - change > 0.01 * view_length * up_length)


def _keeps_a_view(first: Vector, second: Vector) -> bool:
    """Return whether a camera that goes from one pose to another always has a view and an upright."""
    views = [Polynomial([a, b - a]) for a, b in zip(first[1] - first[0], second[1] - second[0], strict=True)]
    ups = [Polynomial([a, b - a]) for a, b in zip(first[2], second[2], strict=True)]
    sides = [ups[k] * views[k - 2] - ups[k - 2] * views[k] for k in (1, 2, 0)]
    side2, view2, up2 = (sum((part * part for part in parts), Polynomial([0.0])) for parts in (sides, views, ups))
    turning = np.real(side2.deriv().roots())
    least = SMALLEST_ROLL_SINE**2 * max(view2(0.0), view2(1.0)) * max(up2(0.0), up2(1.0))
    return all(side2(share) > least for share in (0.0, 1.0, *turning[(turning > 0) & (turning < 1)]))
