"""Rays surface by surface, by whichever tracer: the lens cut off behind each of its surfaces gives the points there.

So every corner of a drawn ray comes from the tracer itself, a device's kernel or the float64 reference, and no second
tracer could hide a fault of the first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.optics import Rays, Status

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens

Array = NDArray[np.float64]

Tracer = Callable[["Lens", Array, Array, float], Rays]
"""Traces rays from the scene, given lens, origins, directions and wavelength [nm]."""


def reference(lens: Lens, origins: Array, directions: Array, wavelength_nm: float) -> Rays:
    """Return rays traced in float64 on the host."""
    from rptcam_cl.optics import trace

    return trace(lens, origins, directions, wavelength_nm, "scene")


@dataclass(frozen=True)
class RayPaths:
    """Rays from the scene through a lens.

    Attributes
    ----------
    points : (surfaces + 1, n, 3) array
        Start of each ray, then its point on each surface; from the surface that stopped a ray on, where it was stopped.
    last : Rays
        What became of them.
    """

    points: Array
    last: Rays

    def corners(self, ray: int) -> Array:
        """Return the points (m, 3) of one ray up to where it left the lens or was stopped."""
        stopped = int(self.last.surface[ray])
        return self.points[: len(self.points) if stopped < 0 else stopped + 2, ray]


def ray_paths(lens: Lens, origins: Array, directions: Array, wavelength_nm: float, tracer: Tracer) -> RayPaths:
    """Return the points of rays from the scene (n, 3) on every surface.

    Rays that miss a surface end where they would cross the plane of its vertex.
    """
    points = [np.array(origins, dtype=np.float64)]
    rays = None
    for count in range(1, len(lens.surfaces) + 1):
        rays = tracer(cut_behind(lens, count), origins, directions, wavelength_nm)
        points.append(rays.origins)
    assert rays is not None
    paths = RayPaths(np.stack(points), rays)
    _extend_misses(lens, paths)
    return paths


def cut_behind(lens: Lens, count: int) -> Lens:
    """Return the lens of the first surfaces alone."""
    if count == len(lens.surfaces):
        return lens
    stop = lens.stop_index if lens.stop_index is not None and lens.stop_index < count else None
    return replace(lens, surfaces=lens.surfaces[:count], stop_index=stop, configurations=(), focusing=None)


def _extend_misses(lens: Lens, paths: RayPaths) -> None:
    for ray in np.flatnonzero(paths.last.status == Status.missed):
        k = int(paths.last.surface[ray])
        direction, start = paths.last.directions[ray], paths.points[k, ray]
        if direction[2] > 0:
            step = (lens.vertices[k] - start[2]) / direction[2]
            paths.points[k + 1 :, ray] = start + max(step, 0.0) * direction
