"""ST maps: pictures whose values say where each pixel comes from, as compositors bend pictures with them.

The convention is Nuke's: red is u from the left and green is v from the *bottom* edge, as shares of the picture's sides
at the centres of pixels, so that an identity map has u = (column + 0.5) / width. Blue is 1 where the map holds; where
it does not, red and green are -1, which lies outside of every picture.

*Undistort* has a pixel for each of the straight picture, which is larger: it has overscan for all that the lens shows.
*Distort* is the way back; its values are shares of the straight picture.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.calibration.smooth_map import SmoothMap, smooth_map
from rptcam_cl.calibration.view import View
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

Array = NDArray[np.float64]
Pixels = NDArray[np.float32]

WIDEST = math.radians(70.0)  # from the axis, up to which a straight picture has a place for what a lens shows
MOST_PIXELS = 200_000_000  # of a straight picture
EDGE = 257  # places along each edge that say how large the straight picture has to be
NOWHERE = -1.0


@dataclass(frozen=True)
class StMaps:
    """Both maps and the straight picture between them.

    Attributes
    ----------
    undistort : (rows', columns', 3) array
        Where each pixel of the straight picture lies in the lens's.
    distort : (rows, columns, 3) array
        Where each pixel of the lens's picture lies in the straight one.
    focal_px, centre_px : (x, y)
        The pinhole of the straight picture [pixels from its corner].
    offset_px : (x, y)
        Corner of the lens's picture in the straight one, the principal points on each other.
    error_px : float
        How far the maps are from chief rays at most.
    """

    undistort: Pixels
    distort: Pixels
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]
    offset_px: tuple[int, int]
    error_px: float

    def facts(self) -> dict[str, Any]:
        """Return what the files say of the maps."""
        return {
            "straight_size": list(self.undistort.shape[1::-1]),
            "picture_size": list(self.distort.shape[1::-1]),
            "fx": self.focal_px[0],
            "fy": self.focal_px[1],
            "cx": self.centre_px[0],
            "cy": self.centre_px[1],
            "offset": list(self.offset_px),
            "error_px": self.error_px,
        }


def st_maps(view: View) -> StMaps:
    """Return the maps of a view.

    Raises
    ------
    InputError
        When the picture has no light to speak of, or the straight picture would be huge.
    """
    smooth = smooth_map(view)
    focal, centre = _principal(view)
    low, high = _bounds(smooth, view.size, focal)
    offset = tuple(math.ceil(max(0.0, -(centre[k] + low[k]))) for k in (0, 1))
    size = tuple(offset[k] + max(view.size[k], math.ceil(centre[k] + high[k])) for k in (0, 1))
    if size[0] * size[1] > MOST_PIXELS:
        raise InputError(
            f"{view.name}: a straight picture of it would have {size[0]} x {size[1]} pixels"
            f" (allowed: {MOST_PIXELS} in all; a smaller picture or less field)"
        )
    there = np.array(centre) + offset
    undistort = _map(_centres(size), size, view.size, lambda at: _to_lens(smooth, (at - there) / focal))
    distort = _map(_centres(view.size), view.size, size, lambda at: _to_straight(smooth, at, focal, there))
    (fx, fy), (cx, cy) = focal.tolist(), there.tolist()
    return StMaps(undistort, distort, (fx, fy), (cx, cy), (offset[0], offset[1]), smooth.error_px)


def _centres(size: tuple[int, ...]) -> Array:
    """Return the centres of all pixels (n, 2), row by row."""
    x, y = (np.arange(count) + 0.5 for count in size)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _map(at: Array, size: tuple[int, ...], of: tuple[int, ...], sought: Any) -> Pixels:
    """Return a map of some size whose values are shares of a picture of another size."""
    places, known = sought(at)
    values = np.full((len(at), 3), NOWHERE, np.float32)
    values[known, 0] = places[known, 0] / of[0]
    values[known, 1] = 1.0 - places[known, 1] / of[1]
    values[:, 2] = known
    return values.reshape(size[1], size[0], 3)


def _to_lens(smooth: SmoothMap, tangents: Array) -> tuple[Array, NDArray[np.bool_]]:
    length = np.linalg.norm(tangents, axis=1)
    scale = np.where(length > 1e-12, np.arctan(length) / np.maximum(length, 1e-12), 1.0)
    return smooth.places(tangents * scale[:, None])


def _to_straight(smooth: SmoothMap, places: Array, focal: Array, centre: Array) -> tuple[Array, NDArray[np.bool_]]:
    tangents, known = _tangents(smooth.angles(places))
    return tangents * focal + centre, known & (np.linalg.norm(smooth.angles(places), axis=1) <= smooth.widest)


def _tangents(angles: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return tangents (n, 2) of angles along their azimuths, and which are not too far from the axis."""
    length = np.linalg.norm(angles, axis=1)
    near = length <= WIDEST
    scale = np.where(length > 1e-12, np.tan(np.minimum(length, WIDEST)) / np.maximum(length, 1e-12), 1.0)
    return np.asarray(angles * scale[:, None]), near


def _principal(view: View) -> tuple[Array, Array]:
    """Return the focal lengths of the straight picture, those of the lens on its axis, and where the axis lies."""
    near = view.film_points(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))[:, :2]
    centre = np.linalg.solve((near[1:] - near[0]).T, -near[0])
    step = 1.0
    around = centre + np.array([[step, 0], [-step, 0], [0, step], [0, -step]])
    directions, _ = view.directions(around)
    tangents = directions[:, :2] / directions[:, 2:]
    across, down = tangents[0, 0] - tangents[1, 0], tangents[2, 1] - tangents[3, 1]
    if not (np.isfinite(across) and np.isfinite(down) and across > 0 and down > 0):
        raise InputError(f"{view.name}: no chief ray along its axis, so no straight picture of it")
    return np.array([2 * step / across, 2 * step / down]), centre


def _bounds(smooth: SmoothMap, size: tuple[int, int], focal: Array) -> tuple[Array, Array]:
    """Return the box of the straight picture about its principal point [pixels] that holds all that the lens shows."""
    shares = np.linspace(0.0, 1.0, EDGE)
    places = np.stack(np.meshgrid(shares * size[0], shares * size[1]), axis=-1).reshape(-1, 2)
    angles = smooth.angles(places)
    shown = np.linalg.norm(angles, axis=1) <= smooth.widest
    tangents, near = _tangents(angles)
    seen = tangents[shown & near] * focal
    return seen.min(axis=0), seen.max(axis=0)
