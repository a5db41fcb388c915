"""What moves when a camera focuses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.cameras import CameraModel
from rptcam_cl.cameras.pupil_rays import PupilRays
from rptcam_cl.scene.scene import Scene

CIRCLES_PER_DIAGONAL = 1500  # circle of confusion: 0.029 mm on 36 x 24 mm, the convention of depth-of-field scales


def circle_of_confusion(scene: Scene) -> float:
    """Return the diameter of a blur that counts as sharp [mm]."""
    return scene.film.diagonal_m() * 1e3 / CIRCLES_PER_DIAGONAL


class Drive(ABC):
    """Focus states of one kind of camera; the words are those of `FocusProbe`."""

    limits: tuple[float, float]
    start: float
    depth_of_focus: float
    nearer: int

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
        """Return how large a state draws what is sharp in another one, against that one."""

    @abstractmethod
    def rays(self, scene: Scene, state: float, stop: float, places: NDArray[np.float64]) -> PupilRays:
        """Return the rays of places (m, 2) of the picture [pixels], in float64."""

    @abstractmethod
    def film_distance(self, state: float) -> float:
        """Return the distance to the film [mm]."""

    @abstractmethod
    def object_distance(self, state: float, zone: Zone | None = None) -> float | None:
        """Return the distance of the plane that is sharpest in a zone, by default on the axis [m]."""

    @abstractmethod
    def first_order_distance(self, state: float) -> float | None:
        """Return the distance of the plane in focus by first-order optics [m]; None where none is."""

    @abstractmethod
    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the state that makes a plane sharpest in a zone."""

    @abstractmethod
    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
