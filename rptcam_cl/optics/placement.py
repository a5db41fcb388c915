"""Decentre and tilt of a surface against its nominal place in the lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SurfacePose:
    """Where a surface is: vertex moved by `offset` [mm], axes turned by `rotation` (rows of a matrix).

    A point p of the nominal vertex frame has the coordinates rotation^T (p - offset) in the frame of the surface.
    """

    offset: tuple[float, float, float]
    rotation: tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

    @staticmethod
    def of(decentre: tuple[float, float, float], tilt_degrees: tuple[float, float, float]) -> SurfacePose:
        """Return the pose of a decentre [mm] and of tilts about the x, then y, then z axis [degrees]."""
        return SurfacePose._from(np.asarray(decentre, dtype=np.float64), rotation_matrix(tilt_degrees))

    @staticmethod
    def _from(offset: Array, rotation: Array) -> SurfacePose:
        rows = [tuple(float(value) for value in row) for row in rotation]
        return SurfacePose(tuple(float(value) for value in offset), tuple(rows))  # type: ignore[arg-type]

    def matrix(self) -> Array:
        """Return the rotation as an array (3, 3)."""
        return np.array(self.rotation)

    def carried_by(self, group: SurfacePose, from_pivot: float) -> SurfacePose:
        """Return this pose after a group turned and moved it, whose pivot lies `from_pivot` [mm] before this vertex."""
        turn = group.matrix()
        place = np.array([0.0, 0.0, from_pivot])
        offset = turn @ (place + np.array(self.offset)) - place + np.array(group.offset)
        return SurfacePose._from(offset, turn @ self.matrix())

    def inward(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Return points and directions (3, n) of the nominal frame in the frame of the surface."""
        back = self.matrix().T
        return back @ (points - np.array(self.offset)[:, None]), back @ directions

    def outward(self, points: Array, directions: Array) -> tuple[Array, Array]:
        """Return points and directions (3, n) of the frame of the surface in the nominal frame."""
        turn = self.matrix()
        return turn @ points + np.array(self.offset)[:, None], turn @ directions


IN_PLACE = SurfacePose((0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


def rotation_matrix(tilt_degrees: tuple[float, float, float]) -> Array:
    """Return the matrix of turns about the x, then y, then z axis [degrees], right handed."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(tilt_degrees)), np.sin(np.radians(tilt_degrees))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, dtype=np.float64)
