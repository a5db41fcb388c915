"""Clear regions beyond the circular rim: a rectangle or a half plane, and what lies outside of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Region:
    """Part of a surface's vertex plane, within its rim.

    Attributes
    ----------
    half_width, half_height : float
        The rectangle |x| <= half_width, |y| <= half_height [mm].
    normal_degrees : float or None
        Of a half plane: direction from the axis into it, from +x towards +y.
    edge : float
        Of a half plane: distance of its edge from the axis along that direction [mm].
    blocks : bool
        True: rays outside are clipped. False: there is nothing outside, and rays go straight on; so half a lens before
        another one makes a split dioptre. Every surface of such a half lens carries the same region, and the medium
        on its two sides is the same.
    inverted : bool
        Whether the clear area is what lies outside of the rectangle or half plane.
    """

    half_width: float = np.inf
    half_height: float = np.inf
    normal_degrees: float | None = None
    edge: float = 0.0
    blocks: bool = True
    inverted: bool = False

    def holds(self, x: Array, y: Array) -> Mask:
        """Return which points lie inside."""
        inside = (np.abs(x) <= self.half_width) & (np.abs(y) <= self.half_height)
        if self.normal_degrees is not None:
            angle = np.radians(self.normal_degrees)
            inside &= x * np.cos(angle) + y * np.sin(angle) >= self.edge
        return np.asarray(inside != self.inverted)


def sides(region: Region | None, previous: Region | None, x: Array, y: Array, beside: Mask) -> tuple[Mask, Mask]:
    """Return which rays pass beside the glass of a half lens, and which do not run into its cut face.

    Parameters
    ----------
    region, previous
        Of the surface at hand and of the one before it in the order of travel; equal ones are one half lens.
    x, y
        Where rays meet the surface.
    beside
        Which rays passed beside the surface before.
    """
    if region is None or region.blocks:
        return np.zeros_like(beside), np.ones_like(beside)
    out = ~region.holds(x, y)
    return (beside, out == beside) if region == previous else (out, np.ones_like(beside))
