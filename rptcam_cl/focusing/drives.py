"""The drive of a scene's camera; that of a thin lens moves its plane of focus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel, PupilRays, film_point, lens_to_focus, thin_lens, thin_lens_rays
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.focusing.lens_drive import GroupDrive, WholeLens
from rptcam_cl.focusing.probe import Drive, Zone, circle_of_confusion
from rptcam_cl.scene import EnvironmentCamera, LensCamera, PinholeCamera, Scene, ThinLensCamera, unknown_camera

FARTHEST_M = 1e6


@dataclass(frozen=True)
class ThinDrive(Drive):
    """The state is the distance of the plane of focus from the lens [m].

    The coordinate is the distance of the image of that plane from the lens. A lens that is given by its field of view
    keeps its film and changes its focal length; its coordinate is f + v^2 / s all the same, v being the film distance.
    """

    scene: Scene

    nearer = 1

    @cached_property
    def _camera(self) -> ThinLensCamera:
        assert isinstance(self.scene.camera, ThinLensCamera)
        return self.scene.camera

    @cached_property
    def _focal_length_mm(self) -> float:
        """Focal length, or for a field of view the film distance: its focal length at infinity [mm]."""
        far = self._camera.model_copy(update={"focus_distance_m": FARTHEST_M})
        return thin_lens.optics_of(far, self.scene.film)[2] * 1e3

    def _is_fixed(self) -> bool:
        return self._camera.focal_length_mm is not None

    def coordinate(self, state: float) -> float:
        """Return the image distance of a plane [mm]."""
        focal, far = self._focal_length_mm, state * 1e3
        return 1 / (1 / focal - 1 / far) if self._is_fixed() else focal + focal**2 / far

    def state_at(self, coordinate: float) -> float:
        """Return the plane of an image distance [m], at most the farthest."""
        focal = self._focal_length_mm
        vergence = 1 / focal - 1 / coordinate if self._is_fixed() else (coordinate - focal) / focal**2
        return min(1e-3 / max(vergence, 1e-30), FARTHEST_M)

    @cached_property
    def limits(self) -> tuple[float, float]:
        """From natural size to the farthest."""
        return self.state_at(2 * self._focal_length_mm), FARTHEST_M

    @cached_property
    def start(self) -> float:
        """Where the scene has it, or far away where autofocus is to find it."""
        return FARTHEST_M if self._camera.focus_distance_m is None else self._camera.focus_distance_m

    @cached_property
    def depth_of_focus(self) -> float:
        """2 N c [mm]."""
        radius = self._camera.aperture_radius_m
        f_number = self._camera.f_number
        if f_number is None:
            assert radius is not None
            if radius == 0:
                raise InputError("camera.aperture_radius_m: 0 makes everything sharp, so there is no focus to find")
            f_number = self._focal_length_mm / (2e3 * radius)
        return 2 * f_number * circle_of_confusion(self.scene)

    def camera(self, scene: Scene, state: float, stop: float, zones: Sequence[Zone]) -> CameraModel:
        """Return the camera in a state for the device."""
        return thin_lens.model_of(scene, self._set(state, stop))

    def rays(self, scene: Scene, state: float, stop: float, places: NDArray[np.float64]) -> PupilRays:
        """Return the rays of places of the picture."""
        return thin_lens_rays(scene, self._set(state, stop), places)

    def _set(self, state: float, stop: float) -> ThinLensCamera:
        camera = self._camera
        opening: dict[str, float | None]
        if camera.f_number is not None:
            opening = {"f_number": camera.f_number / stop}
        else:
            assert camera.aperture_radius_m is not None
            opening = {"aperture_radius_m": camera.aperture_radius_m * stop}
        return camera.model_copy(update={"focus_distance_m": state, **opening})

    def image_scale(self, state: float, reference: float) -> float:
        """Return how large a state draws what is sharp in the state of reference, against that one."""
        return self.film_distance(state) / self.film_distance(reference)

    def film_distance(self, state: float) -> float:
        """Return the distance from the lens to the film [mm]."""
        return self.coordinate(state) if self._is_fixed() else self._focal_length_mm

    def object_distance(self, state: float, zone: Zone | None = None) -> float | None:
        """Return the distance from the lens of what is sharp in a zone, by default of the plane in focus [m]."""
        depth = self._depth(zone)
        if depth == 0:
            return state
        film = self.film_distance(state)
        vergence = 1 / state + 1e3 / film - 1e3 / (film + depth)
        return 1 / vergence if vergence > 0 else None

    def _depth(self, zone: Zone | None) -> float:
        """Return how far behind its centre the film lies in a zone [mm]."""
        return 0.0 if zone is None else film_point(self.scene, self._camera, *zone.centre)[2]

    def first_order_distance(self, state: float) -> float | None:
        """Return the distance of the plane in focus from the lens [m]."""
        return state

    def first_order_vergence(self, state: float) -> float:
        """Return 1 over that distance [1/m]."""
        return 1 / state

    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the state that makes a plane sharp in a zone: its distance, unless the film is tilted.

        Raises
        ------
        InputError
            When the film would have to stand farther back than for natural size, or nearer than for infinity.
        """
        low, high = self.limits
        place = self._place_for(distance_m, self._depth(zone))
        nearest, farthest = self.coordinate(low), self.coordinate(high)
        if place > nearest * (1 + 1e-9) or place < farthest - self.depth_of_focus:
            end, word = (low, "nearest") if place > nearest else (high, "farthest")
            reach = self.object_distance(end, zone)
            words = "" if reach is None else f"; the {word} possible is {reach * 1e3:.6g} mm"
            raise InputError(f"camera: cannot focus at {distance_m * 1e3:.6g} mm from the lens{words}")
        return min(max(distance_m if self._depth(zone) == 0 else self.state_at(place), low), high)

    def _place_for(self, distance_m: float, depth: float) -> float:
        """Return the coordinate that makes a plane sharp on the film so far behind its centre [mm]."""
        focal = self._focal_length_mm
        vergence = 1e-3 / distance_m
        if self._is_fixed():
            return (1 / (1 / focal - vergence) if vergence < 1 / focal else math.inf) - depth
        return focal + focal**2 * (vergence - 1 / focal + 1 / (focal + depth))

    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
        return {"focus_distance_m": state, "focus": None}


def focus_drive(scene: Scene) -> Drive:
    """Return what moves when the camera of a scene focuses.

    Raises
    ------
    InputError
        For a camera that has no focus.
    """
    if isinstance(scene.camera, ThinLensCamera):
        return ThinDrive(scene)
    if isinstance(scene.camera, LensCamera):
        lens = lens_to_focus(scene, scene.camera)
        return GroupDrive(scene, lens) if lens.focuses_by_group else WholeLens(scene, lens)
    if not isinstance(scene.camera, PinholeCamera | EnvironmentCamera):
        raise unknown_camera(scene.camera.kind, "what moves when it focuses (rptcam_cl/focusing/drives.py)")
    raise InputError(
        f"camera.kind: {scene.camera.kind}: everything it sees is sharp, so there is no focus to find"
        " (allowed: thin_lens, thick_lens, realistic)"
    )
