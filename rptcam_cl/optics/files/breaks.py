"""Coordinate breaks of sequential lens files, followed along the axis and turned into the pose of each surface."""

from __future__ import annotations

import numpy as np

from rptcam_cl.optics.placement import rotation_matrix


class Frame:
    """The local frame that decentres, tilts and thicknesses carry along.

    Tilts follow CODE V's and Zemax's sign: about x and y left handed, about z right handed.
    """

    def __init__(self) -> None:
        self.place = np.zeros(3)
        self.turn = np.eye(3)
        self.nominal = 0.0

    @property
    def is_nominal(self) -> bool:
        """Whether the frame stands on the axis of the lens, untilted."""
        return bool(np.allclose(self.place, (0, 0, self.nominal)) and np.allclose(self.turn, np.eye(3)))

    def advance(self, thickness: float) -> None:
        """Go on to the next surface."""
        self.place = self.place + self.turn @ np.array([0.0, 0.0, thickness])
        self.nominal += thickness

    def bend(self, decentre: tuple[float, float, float], tilt_degrees: tuple[float, float, float]) -> None:
        """Decentre, then tilt about x, the new y and the new z."""
        self.place = self.place + self.turn @ np.array(decentre)
        about_x, about_y, about_z = tilt_degrees
        for angles in ((-about_x, 0.0, 0.0), (0.0, -about_y, 0.0), (0.0, 0.0, about_z)):
            self.turn = self.turn @ rotation_matrix(angles)

    def keys(self) -> dict[str, list[float]]:
        """Return the decentre and tilt keys of a surface that stands here; empty on the axis."""
        if self.is_nominal:
            return {}
        offset = self.place - (0.0, 0.0, self.nominal)
        return {"decentre": [float(v) for v in offset], "tilt_degrees": [float(v) for v in self._angles()]}

    def _angles(self) -> tuple[float, float, float]:
        """Return the turns about x, then y, then z that make up the rotation [degrees]."""
        r = self.turn
        y = np.arcsin(np.clip(-r[2, 0], -1.0, 1.0))
        x, z = np.arctan2(r[2, 1], r[2, 2]), np.arctan2(r[1, 0], r[0, 0])
        return float(np.degrees(x)), float(np.degrees(y)), float(np.degrees(z))
