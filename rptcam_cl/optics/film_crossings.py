"""Where rays from the film cross every surface of a lens whose rims let all of them pass: float64."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics.ray_trace import refract

if TYPE_CHECKING:
    from rptcam_cl.optics.lens import Lens

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Crossings:
    """Rays from the film through a lens without rims, in its frame [mm].

    Attributes
    ----------
    heights : (surfaces, n, 2) array
        x and y on each surface, scene side first; not a number from where a ray misses one or is totally reflected.
    origins, directions : (n, 3) arrays
        Point on the first surface and unit direction before it, towards the scene.
    """

    heights: Array
    origins: Array
    directions: Array

    def within(self, lens: Lens, share: float = 1.0) -> NDArray[np.bool_]:
        """Return which rays stay within ``share`` of every rim, and come out; of a stop, its circle counts."""
        rims = np.array([surface.semi_diameter for surface in lens.surfaces])
        with np.errstate(invalid="ignore"):
            inside = np.hypot(self.heights[..., 0], self.heights[..., 1]) <= share * rims[:, None]
        return np.asarray(inside.all(axis=0) & np.isfinite(self.directions[:, 2]))


def crossings(lens: Lens, origins: Array, directions: Array, wavelength_nm: float) -> Crossings:
    """Return where rays from the film cross a rotationally symmetric lens.

    Parameters
    ----------
    origins, directions : (n, 3) arrays
        In the frame of the lens [mm], z = 0 at its first vertex and +z to the film; directions of any length, to -z.
    """
    p, d = origins.T.astype(np.float64), directions.T / np.linalg.norm(directions, axis=1)
    heights, *out = crossed(lens, range(len(lens.surfaces) - 1, -1, -1), p, d, lens.indices(wavelength_nm))
    return Crossings(heights, *out)


def crossed(
    lens: Lens, order: range, p: Array, d: Array, indices: Array, *, towards_film: bool = False
) -> tuple[Array, Array, Array]:
    """Return where rays cross neighbouring surfaces (surfaces, n, 2), scene side first, and the points (n, 3) and
    directions with which they leave them.

    Parameters
    ----------
    order
        Surfaces in the order in which the rays meet them.
    p, d : (3, n) arrays
        Points [mm] and unit directions in the medium before the first of them.
    """
    sense = 1.0 if towards_film else -1.0
    heights = np.empty((len(lens.surfaces), p.shape[1], 2))
    lost = np.zeros(p.shape[1], dtype=bool)
    with np.errstate(all="ignore"):
        for k in order:
            vertex = np.array([[0.0], [0.0], [lens.vertices[k]]])
            hits = lens.surfaces[k].meet(p - vertex, d)
            lost |= ~(hits.met & np.isfinite(hits.distances) & (d[2] * sense > 0))
            p = hits.points + vertex
            heights[k] = np.where(lost[:, None], np.nan, p[:2].T)
            ratio = indices[k] / indices[k + 1] if towards_film else indices[k + 1] / indices[k]
            if ratio != 1.0:
                d, through = refract(d, hits.normals, hits.cosines, ratio)
                lost |= ~through
    points, directions = (np.where(lost[:, None], np.nan, values.T) for values in (p, d))
    return heights[min(order, default=0) : max(order, default=-1) + 1], points, directions
