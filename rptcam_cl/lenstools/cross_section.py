"""The outline of a lens in its y-z or x-z section: surfaces by their sag, glass between them, the stop as two blades.

Points are (z, height) in millimetres of the frame of the lens.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens

Array = NDArray[np.float64]

SAMPLES = 97
BLADE = 0.35  # length of a stop's blade over its semi-diameter, where no neighbour's rim says more


def profile(lens: Lens, k: int, section: str) -> Array:
    """Return points (m, 2) of a surface from its lower to its upper rim."""
    surface = lens.surfaces[k]
    widest = max((s.semi_diameter for s in lens.surfaces if np.isfinite(s.semi_diameter)), default=1.0)
    reach = min(surface.semi_diameter, 1.2 * widest) * (1 - 1e-12)
    heights = np.linspace(-reach, reach, SAMPLES)
    zero = np.zeros_like(heights)
    x, y = (zero, heights) if section == "y" else (heights, zero)
    sag = surface.sag(x, y)
    good = np.isfinite(sag) & surface.clears(x, y) & (surface.region is None or surface.region.holds(x, y))
    points = np.stack([x, y, sag])[:, good]
    if surface.pose:
        points, _ = surface.pose.outward(points, points)
    return np.stack([points[2] + lens.vertices[k], points[1 if section == "y" else 0]], axis=1)


def lines(lens: Lens, k: int, section: str) -> list[Array]:
    """Return the pieces (m, 2) of a surface as drawn: both halves of a ring."""
    points = profile(lens, k, section)
    if not lens.surfaces[k].inner_semi_diameter:
        return [points]
    return [points[: len(points) // 2], points[len(points) // 2 :]]


def obstruction(lens: Lens, k: int, section: str) -> Array | None:
    """Return the ends (2, 2) of what stands in the middle of a ring in air, None where it is but a hole."""
    surface, before = lens.surfaces[k], lens.media[k]
    if not surface.inner_semi_diameter or surface.is_mirror or surface.glass != before:
        return None
    halves = lines(lens, k, section)
    return np.array([halves[0][-1], halves[1][0]])


def glass(lens: Lens, section: str, wavelength_nm: float) -> list[tuple[float, Array]]:
    """Return the index and the outline (m, 2) of the medium behind each surface where it is not air."""
    indices = lens.indices(wavelength_nm)
    outlines = []
    for k in range(len(lens.surfaces) - 1):
        if abs(indices[k + 1] - 1.0) > 1e-6:
            front, rear = profile(lens, k, section), profile(lens, k + 1, section)
            if len(front) > 1 and len(rear) > 1:
                outlines.append((float(indices[k + 1]), _joined(front, rear)))
    return outlines


def medium_behind(lens: Lens, section: str, wavelength_nm: float, film_z: float) -> tuple[float, Array] | None:
    """Return index and outline of what fills the space up to the film, None for air."""
    index = float(lens.indices(wavelength_nm)[-1])
    if abs(index - 1.0) <= 1e-6:
        return None
    rear = profile(lens, len(lens.surfaces) - 1, section)
    return index, np.concatenate([rear, [[film_z, rear[-1, 1]], [film_z, rear[0, 1]]]])


def blades(lens: Lens, section: str) -> list[Array]:
    """Return the two blades (2, 2) of the stop, from its edge outwards."""
    if lens.stop_index is None:
        return []
    k = lens.stop_index
    edge = profile(lens, k, section)
    semi = lens.surfaces[k].semi_diameter
    near = [lens.surfaces[i].semi_diameter for i in (k - 1, k + 1) if 0 <= i < len(lens.surfaces)]
    length = max(BLADE * semi, 1.1 * max(filter(np.isfinite, near), default=0.0) - semi)
    return [
        np.array([edge[0], edge[0] - [0.0, length]]),
        np.array([edge[-1], edge[-1] + [0.0, length]]),
    ]


def _joined(front: Array, rear: Array) -> Array:
    """Return the outline of the glass between two surfaces: rims join by an edge at the height of the wider one."""
    upper = _edge(front[-1], rear[-1])
    lower = _edge(rear[0], front[0])
    return np.concatenate([front, upper, rear[::-1], lower])


def _edge(start: Array, end: Array) -> Array:
    """Return the corners between two rims; a straight line when a ledge would cut through the other surface."""
    height = start[1] if abs(start[1]) > abs(end[1]) else end[1]
    ledge = np.array([[start[0], height], [end[0], height]])
    return np.empty((0, 2)) if (start[0] - end[0]) * np.sign(height) > 0 else ledge
