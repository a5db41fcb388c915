"""What moves when a camera focuses: a lens as a whole, its focusing group, or the plane of focus of a thin lens."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import beams, best_focus, surface
from rptcam_cl.optics.lens import (
    Lens,
    film_behind,
    film_distance,
    focused_by_group,
    limiting_surface,
    move_group,
    object_distance,
    shift_of,
    travel_mm,
)
from rptcam_cl.rendering.cameras import film_pupil, model, setting
from rptcam_cl.rendering.cameras.chief_rays import CameraRays
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.scene.camera import LensCamera, ThinLensCamera, kinds_where
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.probe import Zone, circle_of_confusion


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
    def sharp_mm(self) -> float:
        """2 N c at the film [mm]."""

    @property
    @abstractmethod
    def focal_length_mm(self) -> float:
        """Focal length [mm]."""

    @property
    def motor(self) -> surface.FocusMotor | None:
        """What drives it; None where nothing is known of that."""
        return None

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
    def camera(self, scene: Scene, state: float, stop: float, zones: Sequence[Zone]) -> model.CameraModel:
        """Return the camera in a state for the device; it need not see more than the zones."""

    @abstractmethod
    def image_scale(self, state: float, reference: float) -> float:
        """Return how large a state draws what is sharp in the state of reference, against that one."""

    @abstractmethod
    def rays(self, scene: Scene, state: float, stop: float, places: NDArray[np.float64]) -> film_pupil.PupilRays:
        """Return the rays of places (m, 2) of the picture [pixels], in float64."""

    @abstractmethod
    def chief_rays(self, scene: Scene, state: float) -> CameraRays:
        """Return the chief rays in a state, in float64."""

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


# Drives of cameras with a lens prescription: focusing moves the film, or a group of the lens.

_BEYOND_INFINITY = 0.06  # focal lengths that the film may go nearer than for infinity: curved fields focus there
_LEAST_DISTANCE = 0.02  # of the back focal distance, that the film keeps from the lens
_INVERSIONS = 12  # most rounds of the search for the object of a state
FAR_FOCAL_LENGTHS = 100.0  # where it begins when first-order optics has none
NEAR_ENOUGH = 0.01  # depths of focus, within which a search for the least spot ends
INVERTED = 1e-2  # of a distance, between two rounds: what the last one corrects changes by as little then


def _stop_down(lens: Lens, share: float) -> Lens:
    """Return a lens with its opening closed to a share of its diameter, by its stop or else by the narrowest rim.

    What obstructs its middle, where a small opening lies, is left out then.
    """
    if share == 1.0:
        return lens
    lens = beams.without_obstructions(lens)
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
    def own_camera(self) -> LensCamera:
        """The scene's camera."""
        return setting.lens_camera(self.scene)

    @property
    def motor(self) -> surface.FocusMotor | None:
        """What drives it, as its lens file says."""
        return self.lens.motor

    @property
    def focal_length_mm(self) -> float:
        """Focal length [mm]."""
        return abs(self.lens.first_order(self.own_camera.wavelength_nm).focal_length_mm)

    @abstractmethod
    def lens_at(self, state: float) -> tuple[Lens, float]:
        """Return the lens in a state, and the distance from its last vertex to the film [mm]."""

    @property
    def sharp_mm(self) -> float:
        """2 N c at the film [mm]."""
        f_number = self.lens.first_order(self.own_camera.wavelength_nm).f_number
        if not np.isfinite(f_number):
            raise InputError(f"camera.lens: {self.lens.name}: is afocal, so it has no focus to find")
        return 2 * f_number * circle_of_confusion(self.scene)

    def camera(self, scene: Scene, state: float, stop: float, zones: Sequence[Zone]) -> model.CameraModel:
        """Return the camera in a state for the device."""
        windows = [self._window(scene, zone) for zone in zones]
        return camera_of(scene, self._setting(state, stop)).model(windows=windows)

    def rays(self, scene: Scene, state: float, stop: float, places: NDArray[np.float64]) -> film_pupil.PupilRays:
        """Return the rays of places of the picture."""
        return camera_of(scene, self._setting(state, stop)).pupil_rays(places)

    def chief_rays(self, scene: Scene, state: float) -> CameraRays:
        """Return the chief rays in a state."""
        return camera_of(scene, self._setting(state)).chief_rays()

    def _setting(self, state: float, stop: float = 1.0) -> setting.LensSetting:
        """Return the lens as it is used in a state, its opening closed to a share."""
        lens, film_distance_mm = self.lens_at(state)
        return setting.LensSetting(_stop_down(lens, stop), film_distance_mm, None, self.own_camera)

    def _window(self, scene: Scene, zone: Zone) -> tuple[float, float, float, float]:
        """Return the part of the film that a zone needs [mm]: itself and what the filter reaches."""
        across, down = ((1 + scene.film.filter.radius) / pixels for pixels in scene.film.resolution)
        sides = (zone.left - across, zone.right + across), (zone.top - down, zone.bottom + down)
        corners = [setting.film_point(scene, self.own_camera, right, below) for right in sides[0] for below in sides[1]]
        x, y, _ = np.array(corners).T.tolist()
        return min(x), max(x), min(y), max(y)

    def image_scale(self, state: float, reference: float) -> float:
        """Return how large a state draws what is sharp in the state of reference, against that one, by chief rays."""
        sharp = self._first_order_distance(*self.lens_at(reference))
        scales = [self._chief_ray_scale(*self.lens_at(at), sharp) for at in (state, reference)]
        scale = scales[0] / scales[1]
        return scale if np.isfinite(scale) and scale > 0 else 1.0

    def _chief_ray_scale(self, lens: Lens, film_distance_mm: float, distance_mm: float | None) -> float:
        """Return image size over object size, but for a factor where the object is infinitely far away.

        A chief ray leaves the exit pupil as steeply as it enters the entrance pupil, times the ratio of their sizes.
        """
        first = lens.first_order(self.own_camera.wavelength_nm)
        ratio = first.entrance_pupil.diameter_mm / first.exit_pupil.diameter_mm
        image = ratio * (film_distance_mm - first.exit_pupil.distance_mm)
        if distance_mm is None or np.isinf(distance_mm):
            return image
        return image / (distance_mm - lens.length - lens.sense * film_distance_mm + first.entrance_pupil.distance_mm)

    def film_distance(self, state: float) -> float:
        """Return the distance from the last vertex to the film [mm]."""
        return self.lens_at(state)[1]

    def object_distance(self, state: float, zone: Zone | None = None) -> float | None:
        """Return the distance from the plane that is sharpest in a zone, by default on the axis, to the film [m]."""
        lens, film_distance_mm = self.lens_at(state)
        distance_mm = self._distances_mm.get(zone) or self._first_order_distance(lens, film_distance_mm) or math.inf
        if math.isinf(distance_mm):
            distance_mm = FAR_FOCAL_LENGTHS * lens.first_order(self.own_camera.wavelength_nm).focal_length_mm
        for _ in range(_INVERSIONS):
            # by how much the sharpest place differs from that of first-order optics changes slowly with the distance
            new = self._first_order_distance(lens, film_distance_mm - self._beyond_first_order(lens, distance_mm, zone))
            if new is None or np.isinf(new) or abs(new - distance_mm) < INVERTED * new:
                return None if new is None else new * 1e-3
            distance_mm = new
        return distance_mm * 1e-3

    @cached_property
    def _distances_mm(self) -> dict[Zone | None, float]:
        """The distance for which the state of a zone was found last, near which further ones lie."""
        return {}

    @cached_property
    def _sharpest_films(self) -> dict[tuple[Lens, float, Zone | None], float]:
        """What `sharpest_film` has found, as exact rays take their time."""
        return {}

    def _beyond_first_order(self, lens: Lens, distance_mm: float, zone: Zone | None) -> float:
        """Return by how much the sharpest film distance of a plane exceeds that of first-order optics [mm]."""
        thick = film_distance(lens, distance_mm, wavelength_nm=self.own_camera.wavelength_nm)
        try:
            return self.sharpest_film(lens, distance_mm, zone) - thick
        except InputError:  # no light there
            return 0.0

    def first_order_distance(self, state: float) -> float | None:
        """Return the distance from the plane in focus to the film by first-order optics [m]; None where none is."""
        distance_mm = self._first_order_distance(*self.lens_at(state))
        return None if distance_mm is None else distance_mm * 1e-3

    def first_order_vergence(self, state: float) -> float:
        """Return 1 over that distance [1/m], by Newton's formula; below 0 nearer to the lens than for infinity."""
        lens, film_distance_mm = self.lens_at(state)
        first = lens.first_order(self.own_camera.wavelength_nm)
        extension = film_distance_mm - first.back_focal_distance_mm
        to_front = lens.length + lens.sense * film_distance_mm - first.front_focal_distance_mm
        return 1e3 * extension / (first.focal_length_mm * first.front_focal_length_mm + extension * to_front)

    def _first_order_distance(self, lens: Lens, film_distance_mm: float) -> float | None:
        try:
            return object_distance(lens, film_distance_mm, self.own_camera.wavelength_nm)
        except InputError:
            return None

    def sharpest_film(self, lens: Lens, distance_mm: float, zone: Zone | None) -> float:
        """Return the film distance that makes a plane sharpest in a zone, or on the axis, while the lens stays [mm].

        That of the least spot of exact rays; of a thick lens by first-order optics.

        Parameters
        ----------
        distance_mm
            From the plane to the film's centre.
        """
        key = (lens, distance_mm, zone)
        if key not in self._sharpest_films:
            self._sharpest_films[key] = self._find_sharpest_film(lens, distance_mm, zone)
        return self._sharpest_films[key]

    def _find_sharpest_film(self, lens: Lens, distance_mm: float, zone: Zone | None) -> float:
        wavelength = self.own_camera.wavelength_nm
        x, y, depth = (0.0, 0.0, 0.0) if zone is None else setting.film_point(self.scene, self.own_camera, *zone.centre)
        distance_mm += depth  # to the film in the zone
        if self.own_camera.traced_camera is None:
            return film_distance(lens, distance_mm, wavelength_nm=wavelength) - depth
        thick = film_distance(lens, distance_mm, wavelength_nm=wavelength)
        within, start = NEAR_ENOUGH * self.sharp_mm, thick + self._beyond_thick.get(zone, 0.0)
        if not (x or y) and lens.is_rotational:
            found = best_focus.best_film_distance(
                lens, distance_mm, wavelengths_nm=(wavelength,), within_mm=within, start_mm=start
            )
        else:
            found = best_focus.best_film_distance_at(
                lens, (x, y), distance_mm, wavelength_nm=wavelength, within_mm=within, start_mm=start
            )
        self._beyond_thick[zone] = found - thick
        return found - depth

    @cached_property
    def _beyond_thick(self) -> dict[Zone | None, float]:
        """By how much the least spot of a zone lay behind the place by first-order optics last, near which it does."""
        return {}


class WholeLens(LensDrive):
    """A lens that is focused as a whole: the state is the film distance [mm]."""

    nearer = 1

    def lens_at(self, state: float) -> tuple[Lens, float]:
        """Return the lens and the distance from its last vertex to the film [mm]."""
        return self.lens, state

    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the film distance that makes a plane sharpest in a zone [mm]."""
        found = self.sharpest_film(self.lens, distance_m * 1e3, zone)
        self._distances_mm[zone] = distance_m * 1e3
        return found

    @cached_property
    def depth_of_focus(self) -> float:
        """2 N c [mm]."""
        return self.sharp_mm

    @cached_property
    def limits(self) -> tuple[float, float]:
        """From a little beyond infinity to natural size."""
        wavelength = self.own_camera.wavelength_nm
        infinity = film_distance(self.lens, np.inf, wavelength_nm=wavelength)
        focal_length = self.lens.first_order(wavelength).focal_length_mm
        least = min(infinity, best_focus.best_film_distance(self.lens, np.inf, wavelengths_nm=(wavelength,)))
        low = least - max(_BEYOND_INFINITY * focal_length, 4 * self.depth_of_focus)
        return max(low, _LEAST_DISTANCE * infinity), infinity + focal_length

    @cached_property
    def start(self) -> float:
        """Where the scene has it, or for infinity where autofocus is to find it."""
        if self.own_camera.focus.auto is not None:
            return film_distance(self.lens, np.inf, wavelength_nm=self.own_camera.wavelength_nm)
        return setting.lens_setting(self.scene).film_distance_mm

    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
        return {"focus": {"film_distance_mm": state}}


ROUNDS = 12  # of the secant search, which needs three
CONVERGED = 1e-4  # of the depth of focus


class GroupDrive(LensDrive):
    """A lens with a group that focuses: the state is its shift towards the film [mm]."""

    @cached_property
    def _film_mm(self) -> float:
        return setting.film_for_infinity(self.scene, self.own_camera)

    def lens_at(self, state: float) -> tuple[Lens, float]:
        """Return the lens with its group shifted, and the distance from its last vertex to the film [mm]."""
        return move_group(self.lens, state), film_behind(self.lens, state, self._film_mm)

    def state_for(self, distance_m: float, zone: Zone) -> float:
        """Return the shift that makes a plane sharpest in a zone [mm]: a secant search from that of first-order optics.

        Raises
        ------
        InputError
            When the plane is out of the group's reach.
        """
        distance_mm, wavelength = distance_m * 1e3, self.own_camera.wavelength_nm
        start = shift_of(self.lens, focused_by_group(self.lens, distance_mm, self._film_mm, wavelength)[0])

        def miss(shift: float) -> float:
            lens, film_distance_mm = self.lens_at(shift)
            return self.sharpest_film(lens, distance_mm, zone) - film_distance_mm

        before, shift = start, start + self.depth_of_focus
        missed_before, missed = miss(before), miss(shift)
        for _ in range(ROUNDS):
            if missed == missed_before or abs(missed) < CONVERGED * self.sharp_mm:
                break
            before, shift = shift, shift - missed * (shift - before) / (missed - missed_before)
            missed_before, missed = missed, miss(shift)
        within = float(np.clip(shift, *self.limits))
        if abs(shift - within) > self.depth_of_focus:
            end = self.object_distance(within, zone)
            words = "" if end is None else f"; the end of its travel is sharp at {end * 1e3:.6g} mm"
            raise InputError(f"{self.lens.name}: its group cannot focus at {distance_mm:.6g} mm from the film{words}")
        self._distances_mm[zone] = distance_mm
        return within

    @cached_property
    def limits(self) -> tuple[float, float]:
        """The travel of the group."""
        return travel_mm(self.lens)

    @cached_property
    def depth_of_focus(self) -> float:
        """2 N c over how far the image of infinity moves, per shift, against the film [mm]."""
        low, high = self.limits
        ends = [self._image_behind_film(state) for state in (low, high)]
        return self.sharp_mm * (high - low) / abs(ends[1] - ends[0])

    @cached_property
    def nearer(self) -> int:
        """The sense in which the image of infinity moves towards the lens."""
        low, high = (self._image_behind_film(state) for state in self.limits)
        return 1 if high < low else -1

    def _image_behind_film(self, state: float) -> float:
        lens, back = self.lens_at(state)
        return lens.first_order(self.own_camera.wavelength_nm).back_focal_distance_mm - back

    @cached_property
    def start(self) -> float:
        """Where the scene has it, or as in the lens file where autofocus is to find it."""
        if self.own_camera.focus.auto is not None:
            return 0.0
        return shift_of(self.lens, setting.lens_setting(self.scene).lens)

    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
        return {"focus": {"group_shift_mm": state}}


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
        camera = self.scene.camera.ideal_lens
        assert camera is not None
        return camera

    @cached_property
    def focal_length_mm(self) -> float:
        """Focal length, or for a field of view the film distance: its focal length at infinity [mm]."""
        far = self._camera.model_copy(update={"focus_distance_m": FARTHEST_M, "focus": None})
        focal_length_mm = camera_of(self.scene.model_copy(update={"camera": far})).focal_length_mm()
        assert focal_length_mm is not None
        return focal_length_mm

    def _is_fixed(self) -> bool:
        return self._camera.focal_length_mm is not None

    def coordinate(self, state: float) -> float:
        """Return the image distance of a plane [mm]."""
        focal, far = self.focal_length_mm, state * 1e3
        return 1 / (1 / focal - 1 / far) if self._is_fixed() else focal + focal**2 / far

    def state_at(self, coordinate: float) -> float:
        """Return the plane of an image distance [m], at most the farthest."""
        focal = self.focal_length_mm
        vergence = 1 / focal - 1 / coordinate if self._is_fixed() else (coordinate - focal) / focal**2
        return min(1e-3 / max(vergence, 1e-30), FARTHEST_M)

    @cached_property
    def limits(self) -> tuple[float, float]:
        """From natural size to the farthest."""
        return self.state_at(2 * self.focal_length_mm), FARTHEST_M

    @cached_property
    def start(self) -> float:
        """Where the scene has it, or far away where autofocus is to find it."""
        return FARTHEST_M if self._camera.focus_distance_m is None else self._camera.focus_distance_m

    @property
    def sharp_mm(self) -> float:
        """2 N c at the film [mm]."""
        return self.depth_of_focus

    @cached_property
    def depth_of_focus(self) -> float:
        """2 N c [mm]."""
        radius = self._camera.aperture_radius_m
        f_number = self._camera.f_number
        if f_number is None:
            assert radius is not None
            if radius == 0:
                raise InputError("camera.aperture_radius_m: 0 makes everything sharp, so there is no focus to find")
            f_number = self.focal_length_mm / (2e3 * radius)
        return 2 * f_number * circle_of_confusion(self.scene)

    def camera(self, scene: Scene, state: float, stop: float, zones: Sequence[Zone]) -> model.CameraModel:
        """Return the camera in a state for the device."""
        return camera_of(self._set(scene, state, stop)).model()

    def rays(self, scene: Scene, state: float, stop: float, places: NDArray[np.float64]) -> film_pupil.PupilRays:
        """Return the rays of places of the picture."""
        return camera_of(self._set(scene, state, stop)).pupil_rays(places)

    def chief_rays(self, scene: Scene, state: float) -> CameraRays:
        """Return the chief rays in a state."""
        return camera_of(self._set(scene, state, 1.0)).chief_rays()

    def _set(self, scene: Scene, state: float, stop: float) -> Scene:
        camera = self._camera
        opening: dict[str, float | None]
        if camera.f_number is not None:
            opening = {"f_number": camera.f_number / stop}
        else:
            assert camera.aperture_radius_m is not None
            opening = {"aperture_radius_m": camera.aperture_radius_m * stop}
        camera = camera.model_copy(update={"focus_distance_m": state, "focus": None, **opening})
        return scene.model_copy(update={"camera": camera})

    def image_scale(self, state: float, reference: float) -> float:
        """Return how large a state draws what is sharp in the state of reference, against that one."""
        return self.film_distance(state) / self.film_distance(reference)

    def film_distance(self, state: float) -> float:
        """Return the distance from the lens to the film [mm]."""
        return self.coordinate(state) if self._is_fixed() else self.focal_length_mm

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
        return 0.0 if zone is None else setting.film_point(self.scene, self._camera, *zone.centre)[2]

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
        focal = self.focal_length_mm
        vergence = 1e-3 / distance_m
        if self._is_fixed():
            return (1 / (1 / focal - vergence) if vergence < 1 / focal else math.inf) - depth
        return focal + focal**2 * (vergence - 1 / focal + 1 / (focal + depth))

    def camera_keys(self, state: float) -> dict[str, object]:
        """Return the keys of the scene's camera that set the state."""
        return {"focus_distance_m": state, "focus": None}


def focus_drive(scene: Scene) -> Drive:
    """Find what moves when the camera of a scene focuses.

    Raises
    ------
    InputError
        For a camera that has no focus, or whose film moves with it.
    """
    if scene.camera.stands_by_pupil:
        raise InputError(
            "camera.stands_at: entrance_pupil moves the film, which autofocus has in its place (allowed: film)"
        )
    if scene.camera.ideal_lens is not None:
        return ThinDrive(scene)
    if (camera := scene.camera.lens_camera) is not None:
        lens = setting.lens_to_focus(scene, camera)
        return GroupDrive(scene, lens) if lens.focuses_by_group else WholeLens(scene, lens)
    if scene.camera.focuses:
        raise scene.camera.lacks("what moves when it focuses (rptcam_cl/studies/focus/drives.py)")
    raise InputError(
        f"camera.kind: {scene.camera.kind}: everything it sees is sharp, so there is no focus to find"
        f" (allowed: {', '.join(kinds_where(lambda kind: kind.focuses))})"
    )
