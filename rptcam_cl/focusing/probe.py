"""What autofocus requires of a camera: zones of the film, focus states, and what a zone shows in a state.

`Drive` is what moves when a camera focuses; `ProbeRenderer` shows what the zones look like in a state.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel, PupilRays
from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.scene import Scene


@dataclass(frozen=True)
class Zone:
    """A rectangle of the picture, in fractions of its width and height from its left and top edges.

    Attributes
    ----------
    left, right, top, bottom : float
        0 <= left < right <= 1 and 0 <= top < bottom <= 1.
    """

    left: float
    right: float
    top: float
    bottom: float

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the zone, from the left and the top."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2


@dataclass(frozen=True)
class ZoneImage:
    """What a zone shows in one focus state.

    Attributes
    ----------
    parts : (count, height, width, 3) float32 array
        Linear film values, rendered `count` times with independent random numbers.
    samples : int
        Per pixel, of all parts together.
    """

    parts: NDArray[np.float32]
    samples: int

    @property
    def pixels(self) -> NDArray[np.float32]:
        """Mean film values (height, width, 3)."""
        return np.asarray(self.parts.mean(axis=0, dtype=np.float64), np.float32)

    @property
    def luminance(self) -> NDArray[np.float64]:
        """Luminance of each part (count, height, width)."""
        return np.asarray(luminance(self.parts))

    @property
    def variance(self) -> NDArray[np.float64]:
        """Variance of the mean luminance (height, width); each value is rough, their mean over the zone is not."""
        return np.asarray(self.luminance.var(axis=0, ddof=1) / len(self.parts))


CIRCLES_PER_DIAGONAL = 1500  # circle of confusion: 0.029 mm on 36 x 24 mm, the convention of depth-of-field scales


def circle_of_confusion(scene: Scene) -> float:
    """Return the diameter of a blur that counts as sharp [mm]."""
    return scene.film.diagonal_m() * 1e3 / CIRCLES_PER_DIAGONAL


class Drive(ABC):
    """Focus states of one kind of camera.

    A *state* is the film distance [mm] of a lens that is focused as a whole, the shift of its group towards the film
    [mm] where a group focuses, and the distance of the plane of focus [m] of a thin lens. Searches walk along a
    *coordinate* [mm] in which the blur on the film grows evenly with the distance from the focus: the state itself of a
    lens of surfaces, the image distance of a thin lens. It grows as nearer objects become sharp where `nearer` is 1.
    """

    @property
    @abstractmethod
    def limits(self) -> tuple[float, float]:
        """Lowest and highest state."""

    @property
    @abstractmethod
    def start(self) -> float:
        """State in which a search begins: that of the scene, or far away where autofocus is to find it."""

    @property
    @abstractmethod
    def depth_of_focus(self) -> float:
        """2 N c in units of the coordinate: so far apart are the ends of what counts as sharp at full aperture."""

    @property
    @abstractmethod
    def nearer(self) -> int:
        """1 or -1: the sense along the coordinate in which nearer objects become sharp."""

    def coordinate(self, state: float) -> float:
        """Return the coordinate of a state [mm]."""
        return state

    def state_at(self, coordinate: float) -> float:
        """Return the state of a coordinate."""
        return coordinate

    @abstractmethod
    def camera(self, scene: Scene, state: float, stop: float, zones: Sequence[Zone]) -> CameraModel:
        """Return the camera in a state for the device; it need not see more than the zones."""

    @abstractmethod
    def image_scale(self, state: float, reference: float) -> float:
        """Return how large a state draws what is sharp in the state of reference, against that one."""

    @abstractmethod
    def rays(self, scene: Scene, state: float, stop: float, places: NDArray[np.float64]) -> PupilRays:
        """Return the rays of places (m, 2) of the picture [pixels], in float64."""

    @abstractmethod
    def film_distance(self, state: float) -> float:
        """Return the distance from the last vertex to the film, or of a thin lens to the film [mm]."""

    @abstractmethod
    def object_distance(self, state: float, zone: Zone | None = None) -> float | None:
        """Return the distance of the plane that is sharpest in a zone, by default on the axis [m].

        It is measured to the film (thin lens: to the lens); None where no plane is in focus.
        """

    @abstractmethod
    def first_order_distance(self, state: float) -> float | None:
        """Return the distance of the plane in focus by first-order optics [m]; None where none is."""

    @abstractmethod
    def first_order_vergence(self, state: float) -> float:
        """Return 1 over that distance [1/m]; below 0 where the film stands too near for anything to be sharp."""

    def sharp_vergence(self, state: float) -> float:
        """Return how many 1/m a depth of focus is worth."""
        low, high = self.limits
        place = self.coordinate(state)
        ends = [min(max(self.state_at(place + side * self.depth_of_focus), low), high) for side in (-1, 1)]
        one, other = (self.first_order_vergence(end) for end in ends)
        span = abs(self.coordinate(ends[1]) - self.coordinate(ends[0]))
        return abs(other - one) / span * self.depth_of_focus

    @abstractmethod
    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the state that makes a plane sharpest in the middle of a zone, by the lens alone.

        Parameters
        ----------
        distance_m
            From the film (thin lens: from the lens) along the axis.

        Raises
        ------
        InputError
            When the plane is out of reach.
        """

    @abstractmethod
    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""


class Policy(StrEnum):
    """Which zone the focus is set to, of those in which there is something to focus on."""

    CLOSEST = "closest"
    FARTHEST = "farthest"
    CENTRE = "centre"
    WEIGHTED = "weighted"

    @property
    def by_place(self) -> bool:
        """Whether it depends on where the zones have their focus."""
        return self in (Policy.CLOSEST, Policy.FARTHEST, Policy.WEIGHTED)


def chosen(policy: Policy, zones: Sequence[Zone], places: Mapping[int, float]) -> int:
    """Return the zone that decides.

    Parameters
    ----------
    zones
        All of them.
    places
        Where some of them have their focus, rising towards nearer objects.
    """
    match policy:
        case Policy.CLOSEST:
            return max(places, key=lambda zone: places[zone])
        case Policy.FARTHEST:
            return min(places, key=lambda zone: places[zone])
        case Policy.CENTRE:
            return min(places, key=lambda zone: _off_centre(zones[zone]))
        case Policy.WEIGHTED:
            return _weighted_median(zones, places)


def _off_centre(zone: Zone) -> float:
    x, y = zone.centre
    return (x - 0.5) ** 2 + (y - 0.5) ** 2


def _weighted_median(zones: Sequence[Zone], places: Mapping[int, float]) -> int:
    """Return the zone below and above whose focus lie equal weights: area, less towards the corners of the picture."""
    weight = {k: (zones[k].right - zones[k].left) * (zones[k].bottom - zones[k].top) / (1 + 8 * _off_centre(zones[k]))
              for k in places}  # fmt: skip
    half, passed = sum(weight.values()) / 2, 0.0
    ranked = sorted(places, key=lambda zone: places[zone])
    for zone in ranked:
        passed += weight[zone]
        if passed >= half:
            return zone
    return ranked[-1]
