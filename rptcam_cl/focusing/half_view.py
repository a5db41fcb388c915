"""What the halves of a pupil do to the picture of a plane at any distance, by exact rays."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import PupilLine, PupilRays, Split, pupil_line
from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]

STEP = 12.0  # pixels to the places round the middle of a zone that tell the plane's scale


def places_round(middle: tuple[float, float]) -> Array:
    """Return the places (5, 2) [pixels] whose rays a view needs: its middle, right, left, below, above."""
    return np.array(middle) + STEP * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])


@dataclass(frozen=True)
class HalfView:
    """Two halves of the pupil, seen from the middle of a zone in one focus state.

    Attributes
    ----------
    rays : PupilRays
        Of the places of `places_round`.
    line : PupilLine
        Between the halves.
    split : "x" or "y"
    """

    rays: PupilRays
    line: PupilLine
    split: Split

    @classmethod
    def of(cls, rays: PupilRays, split: Split) -> HalfView:
        """Return the view of the halves of equal light."""
        return cls(rays, pupil_line(rays, split), split)

    @property
    def axis(self) -> int:
        """Along which the halves lie apart: 0 across, 1 down."""
        return 0 if self.split == "x" else 1

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array, Array]:
        """Constant and slope, over the vergence, of where rays meet a plane (n, 2) and of its scale (2, 2)."""
        at, along = self.rays.seen(0.0), self.rays.seen(1.0)
        means = [np.einsum("mn,mnk->mk", self.rays.weights, places) for places in (at, along - at)]
        scales = [np.stack([mean[1] - mean[2], mean[3] - mean[4]], axis=1) / (2 * STEP) for mean in means]
        open_ = self.rays.weights[0] > 0
        return (at[0] - means[0][0])[open_], (along[0] - at[0] - means[1][0])[open_], *scales

    @cached_property
    def shares(self) -> Array:
        """The weights (2, n) of the rays of the half before the line and of that beyond it; each sums to 1."""
        beyond = self.line.beyond(self.rays)[0]
        weights = (self.rays.weights[0] * np.stack([1 - beyond, beyond]))[:, self.rays.weights[0] > 0]
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def offsets(self, vergence: float) -> Array:
        """Return x (n, 2) of the rays that pass [pixels], for the plane at 1 / vergence [m] from the eye."""
        at, along, scale, scale_along = self._lines
        return np.asarray((at + vergence * along) @ np.linalg.inv(scale + vergence * scale_along).T)

    def displacement(self, vergence: float) -> float:
        """Return how far the picture beyond the line lies from that before it, along the split [pixels]."""
        before, beyond = self.shares @ self.offsets(vergence)
        return float((before - beyond)[self.axis])

    @property
    def nearest(self) -> float:
        """The vergence of planes that lie safely in front of the lens [1/m]."""
        ahead = -float(self.rays.origins[..., 2].min())
        return 0.8 / ahead if ahead > 0 else np.inf

    def sharpest(self) -> float:
        """Return the vergence at which the rays of the whole pupil spread least over a plane [1/m]."""
        at, along = self._lines[:2]
        weights = self.rays.weights[0][self.rays.weights[0] > 0][:, None]
        return -float(np.sum(weights * at * along) / np.sum(weights * along * along))

    def sharpest_along(self) -> tuple[float, float]:
        """Return the vergences at which the rays spread least across and least down [1/m]: apart by astigmatism."""
        at, along = self._lines[:2]
        weights = self.rays.weights[0][self.rays.weights[0] > 0][:, None]
        across, down = -np.sum(weights * at * along, axis=0) / np.sum(weights * along * along, axis=0)
        return float(across), float(down)
