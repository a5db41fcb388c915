"""Optical flow: where the picture shows at another moment what it shows now, in float64.

A pixel's moment is the middle of its own exposure. A point keeps its coordinates in the frame of its object, so flow
follows what moves, camera and object alike, whether the point is seen at the other moment or hidden.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraRays, chief_rays, exposure_timing, seen_places
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.plan import object_frame
from rptcam_cl.scene import Scene, pose_matrix

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

ROLLING_ROUNDS = 8  # in which a point is found on a rolling film, whose moment follows from the place
SAME_PLACE = 1e-7  # pixels, where that search ends


@dataclass(frozen=True)
class Moments:
    """A scene, in focus, whose camera and objects are known at every moment."""

    scene: Scene

    @cached_property
    def chief(self) -> CameraRays:
        """The chief rays of its camera."""
        return chief_rays(self.scene)

    @property
    def rolls(self) -> bool:
        """Whether pixels have moments of their own."""
        return self.scene.shutter.kind == "rolling"

    def middles(self, places: Array) -> Array:
        """Return the middle of the exposure (n,) of places (n, 2) of the film, on the clock of keyframes [s]."""
        open_s, start, per_column, per_row = exposure_timing(self.scene.shutter, self.scene.film.resolution)
        columns, rows = np.clip(np.nan_to_num(places), 0.5, np.array(self.scene.film.resolution) - 0.5).T - 0.5
        middle = self.scene.shutter.open_s + start + open_s / 2
        return np.asarray(middle + per_column * columns + per_row * rows)

    def poses(self, times: Array) -> Array:
        """Return the matrices (n, 4, 4) of the camera [m] at moments (n,)."""
        return _at_moments(times, self._pose)

    def _pose(self, time_s: float) -> Array:
        matrix = pose_matrix(self.scene.camera.pose_at(time_s))
        matrix[:3, 3] *= self.scene.metres_per_unit
        return matrix

    def frames(self, objects: Indices, times: Array) -> Array:
        """Return the matrices (n, 4, 4) of the frames of objects [scene units] at moments (n,); unity for none."""
        found = np.tile(np.eye(4), (len(objects), 1, 1))
        for index in np.unique(objects[objects >= 0]).tolist():
            mine, item = objects == index, self.scene.objects[index]
            if item.motion:
                found[mine] = _at_moments(times[mine], partial(object_frame, item))
            else:
                found[mine] = object_frame(item, 0.0)
        return found

    def kind_of(self, index: int) -> str | None:
        """Return the shape of an object; None where there is no such object."""
        return self.scene.objects[index].shape if index < len(self.scene.objects) else None


def _at_moments(times: Array, matrix: Callable[[float], Array]) -> Array:
    unique, place = np.unique(times, return_inverse=True)
    found: Array = np.stack([matrix(time) for time in unique.tolist()]) if len(unique) else np.zeros((0, 4, 4))
    return found[place.reshape(-1)]


@dataclass(frozen=True)
class SeenPoints:
    """Points that a picture shows.

    Attributes
    ----------
    moments : Moments
        Of the picture.
    places : (n, 2) array
        Where it shows them [pixels].
    times : (n,) array
        When [s].
    points : (n, 4) array
        Homogeneous, in the scene [m]; of what is infinitely far away its direction and 0.
    objects : (n,) array
        What they belong to; -1 for nothing.
    """

    moments: Moments
    places: Array
    times: Array
    points: Array
    objects: Indices

    def at_times(self, times: Array) -> Array:
        """Return where the same picture would show the points at moments (n,) [pixels]."""
        return self._seen(self.moments, times, self.places)

    def flow_to(self, other: Moments) -> Array:
        """Return the way (n, 2) of the points, right and down, to where another picture shows them [pixels].

        nan where it does not: behind the camera, beside the field of its lens, or of an object that is not there.
        """
        places = self._seen(other, other.middles(self.places), self.places)
        for _ in range(ROLLING_ROUNDS if other.rolls else 0):
            before = places
            places = self._seen(other, other.middles(before), np.where(np.isfinite(before), before, self.places))
            if np.nanmax(np.abs(places - before), initial=0.0) < SAME_PLACE:
                break
        return self._way(places)

    def _way(self, places: Array) -> Array:
        way = places - self.places
        if self.moments.chief.wraps:
            width = self.moments.scene.film.resolution[0]
            way[:, 0] -= width * np.round(way[:, 0] / width)
        return way

    def _seen(self, other: Moments, times: Array, guess: Array) -> Array:
        unit, there = self.moments.scene.metres_per_unit, other.scene.metres_per_unit
        points = self.points.copy()
        on = self.objects >= 0
        lost = np.isin(self.objects, [k for k in np.unique(self.objects[on]).tolist() if not self._is_in(other, k)])
        on &= ~lost
        objects = self.objects[on]
        own = np.linalg.inv(self.moments.frames(objects, self.times[on]))
        scaled = points[on] * np.array([1 / unit, 1 / unit, 1 / unit, 1.0])
        new = np.einsum("nij,njk,nk->ni", other.frames(objects, times[on]), own, scaled)
        points[on] = new * np.array([there, there, there, 1.0])
        in_camera = np.einsum("nij,nj->ni", np.linalg.inv(other.poses(times)), points)
        places = seen_places(other.chief, in_camera, guess)
        places[lost] = np.nan
        return places

    def _is_in(self, other: Moments, index: int) -> bool:
        return self.moments.kind_of(index) == other.kind_of(index)

    def over_shutter(self) -> tuple[Array, Array]:
        """Return the ways of the points to the opening and to the closing of the shutter of their own pixels."""
        half = self.moments.scene.shutter.time_s / 2
        return self._way(self.at_times(self.times - half)), self._way(self.at_times(self.times + half))
