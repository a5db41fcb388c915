"""Coordinate breaks of sequential lens files, followed along the axis and turned into the pose of each surface."""

from __future__ import annotations

import numpy as np

from rptcam_cl.optics.placement import rotation_matrix


class AxisFrame:
    """The local frame that decentres, tilts and thicknesses carry along.

    Parameters
    ----------
    senses
        Of positive tilts about x, y and z: 1 right handed, -1 left handed.
    """

    def __init__(self, senses: tuple[float, float, float]) -> None:
        self.senses = senses
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

    def bend(
        self,
        decentre: tuple[float, float, float],
        tilt_degrees: tuple[float, float, float],
        tilt_first: bool = False,
    ) -> None:
        """Decentre, then tilt about x, the new y and the new z; or tilt about z, y and x, and then decentre."""
        x, y, z = (sense * angle for sense, angle in zip(self.senses, tilt_degrees, strict=True))
        turns = [rotation_matrix(angles) for angles in ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))]
        if not tilt_first:
            self.place = self.place + self.turn @ np.array(decentre)
        for turn in reversed(turns) if tilt_first else turns:
            self.turn = self.turn @ turn
        if tilt_first:
            self.place = self.place + self.turn @ np.array(decentre)

    def unbend(self, decentre: tuple[float, float, float], tilt_degrees: tuple[float, float, float]) -> None:
        """Undo a tilt, and then a decentre, as REV of CODE V does behind a surface."""
        bent = AxisFrame(self.senses)
        bent.bend((0.0, 0.0, 0.0), tilt_degrees)
        self.turn = self.turn @ bent.turn.T
        self.place = self.place - self.turn @ np.array(decentre)

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
