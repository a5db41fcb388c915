"""One refracting surface or stop of a lens: its shape about the vertex, its clear region and the medium behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.optics.glass import AIR, Medium


@dataclass(frozen=True)
class Surface:
    """An interface between two media, in the frame of its vertex (+z towards the film).

    Attributes
    ----------
    curvature : float
        1 / radius [1/mm], positive when the centre lies on the film side; 0 is a plane.
    thickness : float
        Distance to the vertex of the next surface [mm]; 0 on the last one, whose distance to the film is the focus.
    glass : Medium
        Medium behind the surface, on the film side.
    semi_diameter : float
        Clear radius [mm]: rays that meet the surface farther from the axis are clipped.
    is_stop : bool
        Whether this is the aperture stop.
    """

    curvature: float = 0.0
    thickness: float = 0.0
    glass: Medium = AIR
    semi_diameter: float = np.inf
    is_stop: bool = False

    @property
    def radius(self) -> float:
        """Radius of curvature [mm], infinite for a plane."""
        return 1.0 / self.curvature if self.curvature else np.inf

    def sag(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return z of the surface above points of its vertex plane [mm]; NaN where it does not reach."""
        square = x * x + y * y
        with np.errstate(invalid="ignore"):
            root = np.sqrt(1.0 - self.curvature * self.curvature * square)
        return np.asarray(self.curvature * square / (1.0 + root), dtype=np.float64)

    def rim_sag(self, height: float | None = None) -> float:
        """Return the sag [mm] at a height from the axis, by default at the rim."""
        y = np.array(self.semi_diameter if height is None else height)
        return float(self.sag(np.zeros(()), y))
