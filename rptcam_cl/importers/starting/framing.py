"""Where a camera stands so that a subject fills a share of its film, through the lens that it has."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import LensSetting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import crossings

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

FILL = 2 / 3  # of the film's width or height, whichever the subject fills more of
HEIGHTS = 65  # chief rays between the axis and the corner of the film
FEWEST = 4  # of them that must pass the lens
ROUNDS = 60
CLOSE_ENOUGH = 2e-3  # relative, of the share that is filled


@dataclass(frozen=True)
class View:
    """A camera in scene units; `forward`, `right` and `up` are unit vectors at right angles."""

    eye: Array
    forward: Array
    right: Array
    up: Array

    @classmethod
    def towards(cls, target: Array, direction: Array, distance: float, up: Array) -> View:
        """Return the view from a place that lies in a direction from what it looks at."""
        forward = -direction / np.linalg.norm(direction)
        right = np.cross(forward, up)
        right /= np.linalg.norm(right)
        return cls(target - distance * forward, forward, right, np.cross(right, forward))

    def seen(self, points: Array) -> Array:
        """Return points (n, 3) as (right, up, depth) from the eye."""
        return np.asarray((points - self.eye) @ np.stack([self.right, self.up, self.forward], axis=1))


# From a view and the depth of the plane in focus to the lens of the camera there.
SetLens = Callable[[View, float], LensSetting]


class Projection:
    """Where chief rays of a focused lens put points of the scene on its film.

    Rays are traced through a lens that is the same on all sides, so that distortion counts. Others go by first order.

    Parameters
    ----------
    setting : LensSetting
    metres_per_unit : float
    corner_mm : float
        From the middle of the film to its corner.

    Attributes
    ----------
    length_mm : float
        From the first vertex to the film.
    pupils_mm : (2,) array
        From the first vertex to the entrance pupil, across and up.
    scales_mm : (2,) array
        On the film per unit of the tangent from there, on the axis.
    """

    def __init__(self, setting: LensSetting, metres_per_unit: float, corner_mm: float) -> None:
        lens, back = setting.lens, setting.film_distance_mm
        self._unit_mm = metres_per_unit * 1e3
        self.length_mm = lens.length + lens.sense * back  # from the first vertex to the film
        self.pupils_mm, self.scales_mm = np.transpose([_perspective(setting, section) for section in "xy"])
        self._heights = np.linspace(0, 1.2 * corner_mm, HEIGHTS)
        self._rays = _chief_rays(setting, self._heights)

    def film_mm(self, seen: Array) -> Array:
        """Return the places (n, 2) on an upright film [mm] of points as a view sees them; infinite behind the lens."""
        depth = seen[:, 2] * self._unit_mm - self.length_mm
        across = seen[:, :2] * self._unit_mm
        if self._rays is None:
            ahead = depth[:, None] + self.pupils_mm
            with np.errstate(all="ignore"):
                return np.where((ahead > 0).all(axis=1, keepdims=True), across / ahead * self.scales_mm, np.inf)
        radius = np.hypot(across[:, 0], across[:, 1])
        starts, slopes = self._rays
        reached = starts + slopes * depth[:, None]
        cell = np.clip((reached < radius[:, None]).sum(axis=1), 1, len(slopes) - 1)
        rows = np.arange(len(depth))
        low, high = reached[rows, cell - 1], reached[rows, cell]
        height = self._heights[cell - 1] + (radius - low) / (high - low) * self._heights[1]
        height[(depth <= 0) | (radius > high)] = np.inf
        with np.errstate(all="ignore"):
            return np.where(radius[:, None] > 0, across * (height / radius)[:, None], 0.0)


def _perspective(setting: LensSetting, section: str) -> tuple[float, float]:
    """Return how far behind the first vertex the entrance pupil lies, and what a unit of the tangent from there is on
    the film [mm], to first order: chief rays leave the exit pupil flatter by the ratio of the pupils (Lagrange)."""
    lens, back, wavelength = setting.lens, setting.film_distance_mm, setting.camera.wavelength_nm
    first = lens.first_order(wavelength, section)
    entrance, leaving = first.entrance_pupil, first.exit_pupil
    if not np.isfinite(entrance.distance_mm):  # all that is in focus is as large, however far
        return 0.0, first.focal_length_mm + back - first.back_focal_distance_mm
    if not np.isfinite(leaving.distance_mm):  # the entrance pupil is the focus before the lens
        return entrance.distance_mm, first.focal_length_mm
    behind = float(lens.indices(wavelength)[-1])
    scale = abs(back - leaving.distance_mm) * entrance.diameter_mm / leaving.diameter_mm / behind
    return entrance.distance_mm, scale


def _chief_rays(setting: LensSetting, heights: Array) -> tuple[Array, Array] | None:
    """Return distance from the axis at the first vertex [mm] and slope of the rays through the middle of the pupil."""
    lens, wavelength = setting.lens, setting.camera.wavelength_nm
    pupil = lens.first_order(wavelength).exit_pupil.distance_mm
    if not lens.is_rotational or lens.has_mirrors or not np.isfinite(pupil):
        return None
    origins = np.column_stack([heights, 0 * heights, np.full(len(heights), lens.film_z(setting.film_distance_mm))])
    directions = np.array([0, 0, lens.length + pupil]) - origins
    if directions[0, 2] >= 0:
        return None
    rays = crossings(lens, origins, directions, wavelength)
    with np.errstate(all="ignore"):
        slopes = rays.directions[:, 0] / rays.directions[:, 2]
        starts = rays.origins[:, 0] - slopes * rays.origins[:, 2]
        rising = np.diff(slopes) > 0  # also false for what does not pass
    last = len(heights) if rising.all() else 1 + int(rising.argmin())
    return (-starts[:last], slopes[:last]) if last >= FEWEST else None


class Framing:
    """Searches the place of a camera.

    Parameters
    ----------
    points : (n, 3) array
        The subject, in scene units.
    direction : (3,) array
        From the subject to the camera.
    up : (3,) array
    film_mm : (width, height)
    set_lens
        Focuses the lens on the middle of the subject, raises InputError where it cannot.
    metres_per_unit : float

    Attributes
    ----------
    target : (3,) array
        What the camera looks at.
    share : float
        How much of the film's width or height the subject fills, whichever is more.
    """

    def __init__(
        self,
        points: Array,
        direction: Array,
        up: Array,
        film_mm: tuple[float, float],
        set_lens: SetLens,
        metres_per_unit: float,
    ) -> None:
        self._points, self._direction, self._up = points, direction, up
        self._half, self._set_lens, self._unit_mm = np.asarray(film_mm) / 2, set_lens, metres_per_unit * 1e3
        self.target = (points.min(axis=0) + points.max(axis=0)) / 2
        self.share = 0.0

    def view(self) -> View:
        """Return the view that two thirds fill, else the nearest from outside the subject that the lens can focus.

        Raises
        ------
        InputError
            When the lens can focus nowhere.
        """
        radius = float(np.linalg.norm(self._points - self.target, axis=1).max())
        distance, nearest = 4 * radius + 100 / self._unit_mm, radius  # nearer, a wide lens would stand among the parts
        for _ in range(ROUNDS):
            try:
                view, wanted, off = self._tried(distance)
            except InputError:
                if distance > 1e6 * radius + 1e9 / self._unit_mm:
                    raise
                nearest, distance = distance, 1.25 * distance
                continue
            if off < CLOSE_ENOUGH and (abs(self.share / FILL - 1) < CLOSE_ENOUGH or self._is_nearest(wanted, nearest)):
                return view
            distance = max(wanted, nearest * 1.01)
        return view

    def _is_nearest(self, wanted: float, nearest: float) -> bool:
        return self.share < FILL and wanted <= nearest * 1.01

    def _tried(self, distance: float) -> tuple[View, float, float]:
        """Return a view, the distance to go on with, and how far the subject is from the middle of the film."""
        view = View.towards(self.target, self._direction, distance, self._up)
        setting = self._set_lens(view, distance)
        projection = Projection(setting, self._unit_mm * 1e-3, float(np.hypot(*self._half)))
        image = projection.film_mm(view.seen(self._points))
        if not np.isfinite(image).all():
            raise InputError("is wider than the lens sees")
        low, high = image.min(axis=0), image.max(axis=0)
        self.share = float(((high - low) / 2 / self._half).max())
        middle = (low + high) / 2
        before_lens = distance - projection.length_mm / self._unit_mm
        shift = middle / projection.scales_mm * before_lens
        self.target = self.target + shift[0] * view.right + shift[1] * view.up
        wanted = distance - before_lens + before_lens * self.share / FILL
        return view, wanted, float(np.abs(middle / self._half).max())
