"""What moves when a camera focuses: the film behind a lens, a group inside it, or the plane of a thin lens."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.cameras import CameraModel, realistic, thick_lens
from rptcam_cl.cameras.focusing import focused
from rptcam_cl.cameras.lens_setting import LensSetting, film_point, lens_setting, lens_to_focus
from rptcam_cl.errors import InputError
from rptcam_cl.optics import Lens
from rptcam_cl.optics.best_focus import best_film_distance
from rptcam_cl.optics.first_order import limiting_surface
from rptcam_cl.optics.focus import film_distance, object_distance
from rptcam_cl.optics.variable import film_behind, moved, shift_of
from rptcam_cl.scene import LensCamera, RealisticCamera, ThickLensCamera
from rptcam_cl.scene.scene import Scene

CIRCLES_PER_DIAGONAL = 1500  # circle of confusion: 0.029 mm on 36 x 24 mm, the convention of depth-of-field scales
BEYOND_INFINITY = 0.06  # focal lengths that the film may go nearer than for infinity: curved fields focus there
LEAST_DISTANCE = 0.02  # of the back focal distance, that the film keeps from the lens
INVERSIONS = 12  # most rounds of the search for the object of a state
FAR_FOCAL_LENGTHS = 100.0  # where it begins
INVERTED = 1e-4  # of a distance, between two rounds


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
    def film_distance(self, state: float) -> float:
        """Return the distance to the film [mm]."""

    @abstractmethod
    def object_distance(self, state: float, zone: Zone | None = None) -> float | None:
        """Return the distance of the plane that is sharpest in a zone, by default on the axis [m]."""

    @abstractmethod
    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the state that makes a plane sharpest in a zone."""

    @abstractmethod
    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""


def stopped(lens: Lens, share: float) -> Lens:
    """Return a lens with its opening closed to a share of its diameter, by its stop or else by the narrowest rim."""
    if share == 1.0:
        return lens
    index = lens.stop_index if lens.stop_index is not None else limiting_surface(lens)
    surfaces = list(lens.surfaces)
    surfaces[index] = replace(surfaces[index], semi_diameter=share * surfaces[index].semi_diameter)
    return replace(lens, surfaces=tuple(surfaces), stop_index=index)


@dataclass(frozen=True)
class LensDrive(Drive):
    """A lens of surfaces, at its working aperture.

    Attributes
    ----------
    scene : Scene
    lens : Lens
        With its group, if it has one, where the table has it.
    """

    scene: Scene
    lens: Lens

    @property
    def _camera(self) -> LensCamera:
        assert isinstance(self.scene.camera, LensCamera)
        return self.scene.camera

    @abstractmethod
    def lens_at(self, state: float) -> tuple[Lens, float]:
        """Return the lens in a state, and the distance from its last vertex to the film [mm]."""

    @property
    def _is_thick(self) -> bool:
        return isinstance(self._camera, ThickLensCamera)

    @property
    def _sharp_mm(self) -> float:
        f_number = self.lens.first_order(self._camera.wavelength_nm).f_number
        if not np.isfinite(f_number):
            raise InputError(f"camera.lens: {self.lens.name}: is afocal, so it has no focus to find")
        return 2 * f_number * circle_of_confusion(self.scene)

    def camera(self, scene: Scene, state: float, stop: float, zones: Sequence[Zone]) -> CameraModel:
        """Return the camera in a state for the device."""
        lens, back_mm = self.lens_at(state)
        setting = LensSetting(stopped(lens, stop), back_mm, None, self._camera)
        if not isinstance(self._camera, RealisticCamera):
            return thick_lens.model_of(scene, setting)
        return realistic.model_of(scene, setting, [self._window(scene, zone) for zone in zones])

    def _window(self, scene: Scene, zone: Zone) -> tuple[float, float, float, float]:
        """Return the part of the film that a zone needs [mm]: itself and what the filter reaches."""
        across, down = ((1 + scene.film.filter.radius) / pixels for pixels in scene.film.resolution)
        corners = (zone.left - across, zone.top - down), (zone.right + across, zone.bottom + down)
        (x0, y0), (x1, y1) = (film_point(scene, self._camera, *corner) for corner in corners)
        return min(x0, x1), max(x0, x1), min(y0, y1), max(y0, y1)

    def film_distance(self, state: float) -> float:
        """Return the distance from the last vertex to the film [mm]."""
        return self.lens_at(state)[1]

    def object_distance(self, state: float, zone: Zone | None = None) -> float | None:
        """Return the distance from the plane that is sharpest in a zone, by default on the axis, to the film [m]."""
        place = zone or Zone(0.5, 0.5, 0.5, 0.5)
        focal_length = self.lens.first_order(self._camera.wavelength_nm).focal_length_mm
        if self._is_thick:
            return self.first_order_distance(state)
        found = FAR_FOCAL_LENGTHS * focal_length * 1e-3
        for _ in range(INVERSIONS):
            # by how much the sharpest state differs from that of first-order optics changes slowly with the distance
            new = self.first_order_distance(state - self._beyond_first_order(found, place))
            if new is None or np.isinf(new) or abs(new - found) < INVERTED * new:
                return new
            found = new
        return found

    def _beyond_first_order(self, distance_m: float, zone: Zone) -> float:
        """Return by how much the state that makes a plane sharpest in a zone exceeds that of first-order optics."""
        wavelength = self._camera.wavelength_nm
        thick = self._state_of(*focused(self.lens, distance_m * 1e3, "film", "thick", wavelength))
        try:
            return self.state_for(distance_m, zone) - thick
        except InputError:  # no light there, or beyond the reach of a group
            return 0.0

    def first_order_distance(self, state: float) -> float | None:
        """Return the distance from the plane in focus to the film by first-order optics [m]; None where none is."""
        try:
            return object_distance(*self.lens_at(state), self._camera.wavelength_nm) * 1e-3
        except InputError:
            return None

    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the state that makes a plane sharpest in a zone: least spot, or first order for a thick lens."""
        place = film_point(self.scene, self._camera, *zone.centre)
        on_axis = not any(place) or self._is_thick
        lens, back_mm = focused(
            self.lens,
            distance_m * 1e3,
            "film",
            "thick" if self._is_thick else "spot",
            self._camera.wavelength_nm,
            None if on_axis else place,
        )
        return self._state_of(lens, back_mm)

    @abstractmethod
    def _state_of(self, lens: Lens, back_mm: float) -> float:
        """Return the state of a lens that has been focused."""


class WholeLens(LensDrive):
    """A lens that is focused as a whole: the state is the film distance [mm]."""

    nearer = 1

    def lens_at(self, state: float) -> tuple[Lens, float]:
        """Return the lens and the distance from its last vertex to the film [mm]."""
        return self.lens, state

    def _state_of(self, lens: Lens, back_mm: float) -> float:
        return back_mm

    @cached_property
    def depth_of_focus(self) -> float:  # type: ignore[override]
        """2 N c [mm]."""
        return self._sharp_mm

    @cached_property
    def limits(self) -> tuple[float, float]:  # type: ignore[override]
        """From a little beyond infinity to natural size."""
        wavelength = self._camera.wavelength_nm
        infinity = film_distance(self.lens, np.inf, wavelength_nm=wavelength)
        focal_length = self.lens.first_order(wavelength).focal_length_mm
        least = min(infinity, best_film_distance(self.lens, np.inf, wavelengths_nm=(wavelength,)))
        low = least - max(BEYOND_INFINITY * focal_length, 4 * self.depth_of_focus)
        return max(low, LEAST_DISTANCE * infinity), infinity + focal_length

    @cached_property
    def start(self) -> float:  # type: ignore[override]
        """Where the scene has it."""
        return lens_setting(self.scene).film_distance_mm

    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
        return {"focus": {"film_distance_mm": state}}


class FocusingGroupDrive(LensDrive):
    """A lens with a group that focuses: the state is its shift towards the film [mm]."""

    @cached_property
    def _film_mm(self) -> float:
        return film_distance(self.lens, np.inf, wavelength_nm=self._camera.wavelength_nm)

    def lens_at(self, state: float) -> tuple[Lens, float]:
        """Return the lens with its group shifted, and the distance from its last vertex to the film [mm]."""
        return moved(self.lens, state), film_behind(self.lens, state, self._film_mm)

    def _state_of(self, lens: Lens, back_mm: float) -> float:
        return shift_of(self.lens, lens)

    @cached_property
    def limits(self) -> tuple[float, float]:  # type: ignore[override]
        """The travel of the group."""
        assert self.lens.focusing is not None
        return self.lens.focusing.travel_mm

    @cached_property
    def depth_of_focus(self) -> float:  # type: ignore[override]
        """2 N c over how far the image of infinity moves, per shift, against the film [mm]."""
        low, high = self.limits
        ends = [self._image_behind_film(state) for state in (low, high)]
        return self._sharp_mm * (high - low) / abs(ends[1] - ends[0])

    @cached_property
    def nearer(self) -> int:  # type: ignore[override]
        """The sense in which the image of infinity moves towards the lens."""
        low, high = (self._image_behind_film(state) for state in self.limits)
        return 1 if high < low else -1

    def _image_behind_film(self, state: float) -> float:
        lens, back = self.lens_at(state)
        return lens.first_order(self._camera.wavelength_nm).back_focal_distance_mm - back

    @cached_property
    def start(self) -> float:  # type: ignore[override]
        """Where the scene has it."""
        return shift_of(self.lens, lens_setting(self.scene).lens)

    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
        return {"focus": {"group_shift_mm": state}}


def lens_drive(scene: Scene) -> LensDrive:
    """Return the drive of a scene's lens camera."""
    assert isinstance(scene.camera, LensCamera)
    lens = lens_to_focus(scene, scene.camera)
    kind = WholeLens if lens.focusing is None else FocusingGroupDrive
    return kind(scene, lens)
