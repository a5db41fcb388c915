"""How the film of a camera stands behind its lens: straight across the axis, or moved, tilted and swung.

Film points have two names. *On the film*: millimetres along its own sides from its centre, as the lens draws them, so
that what is right in an upright picture is left on the film. *In the frame of the lens*: x to the right, y up, and how
much deeper than the film distance the point lies. A film that is not moved has the same x and y in both.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class FilmFrame:
    """Where the film stands; without arguments where its lens expects it.

    Attributes
    ----------
    centre : (x, y)
        Of the film, in the frame of the lens [mm]. It lies at the film distance.
    across, up : (x, y, depth)
        Unit vectors along the film's sides, right and up in the frame of the lens where it is not turned.
    """

    centre: tuple[float, float] = (0.0, 0.0)
    across: Triple = (1.0, 0.0, 0.0)
    up: Triple = (0.0, 1.0, 0.0)

    @property
    def is_flat(self) -> bool:
        """Whether the film stands across the axis, so that all of it lies at the film distance."""
        return self.across[2] == 0.0 and self.up[2] == 0.0

    @property
    def is_moved(self) -> bool:
        """Whether it stands in another way than its lens expects."""
        return self != UNMOVED

    @cached_property
    def normal(self) -> Triple:
        """Unit vector across the film, away from the lens."""
        x, y, z = np.cross(self.across, self.up).tolist()
        return x, y, z

    @cached_property
    def slopes(self) -> tuple[float, float]:
        """How much deeper the film lies per millimetre to the right and up."""
        x, y, z = self.normal
        return -x / z, -y / z

    def depth(self, points: Array) -> Array:
        """Return how far behind the film distance points (..., 2) of the film lie, x and y in the frame of the lens."""
        away = points - np.array(self.centre)
        return np.asarray(away[..., 0] * self.slopes[0] + away[..., 1] * self.slopes[1])

    def points(self, film: Array) -> Array:
        """Return points (..., 2) on the film in the frame of the lens, (..., 3) with their depths [mm]."""
        film = np.asarray(film, dtype=np.float64)
        along = film[..., :1] * np.array(self.across) + film[..., 1:] * np.array(self.up)
        return np.asarray(along + np.array([*self.centre, 0.0]))

    def on_film(self, points: Array) -> Array:
        """Return points (..., 2) of the frame of the lens that lie in the film's plane as points on the film."""
        columns = np.array([self.across[:2], self.up[:2]]).T
        return np.asarray((points - np.array(self.centre)) @ np.linalg.inv(columns).T)

    def corners(self, half_mm: tuple[float, float]) -> Array:
        """Return the corners (4, 3) of a film of such half sides, in order round it."""
        return self.points(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(half_mm))

    def bounds(self, half_mm: tuple[float, float]) -> tuple[float, float]:
        """Return half the sides of the rectangle about the axis that holds the film, across the axis [mm]."""
        if not self.is_moved:
            return half_mm
        x, y = np.abs(self.corners(half_mm)[:, :2]).max(axis=0).tolist()
        return x, y

    def grid(self, half_mm: tuple[float, float], count: int) -> Array:
        """Return points (count, count, 2) from edge to edge of the film, rows upwards, x and y in the lens's frame."""
        x, y = (np.linspace(-half, half, count) for half in half_mm)
        return self.points(np.stack(np.meshgrid(x, y), axis=-1))[..., :2]

    def reach(self, half_mm: tuple[float, float], directions: Array) -> Array:
        """Return how far from the axis the film goes in directions (n, 2), 0 where it is not [mm]."""
        corners = self.corners(half_mm)[:, :2]
        sides = np.roll(corners, -1, axis=0) - corners
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = directions[:, :1] * sides[:, 1] - directions[:, 1:] * sides[:, 0]
            out = (corners[:, 0] * sides[:, 1] - corners[:, 1] * sides[:, 0]) / turn
            along = (corners[:, 0] * directions[:, 1:] - corners[:, 1] * directions[:, :1]) / turn
        slack = 1e-12
        meets = (turn != 0) & (out > 0) & (along >= -slack) & (along <= 1 + slack)
        return np.asarray(np.where(meets, out, 0.0).max(axis=1))


UNMOVED = FilmFrame()
