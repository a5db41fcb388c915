"""The kinds of camera: what every other part of the program asks of the camera of a scene, whatever its kind."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.lens import ThickLens, thick_lens_of
from rptcam_cl.optics.ray_trace import axial_transmittance
from rptcam_cl.rendering.cameras import film_pupil, lens_records, model
from rptcam_cl.rendering.cameras import setting as settings
from rptcam_cl.rendering.cameras.chief_rays import CameraRays, PerspectiveRays, SphereRays, TracedRays
from rptcam_cl.rendering.cameras.realistic import Window, axis_irradiance, realistic_model
from rptcam_cl.rendering.cameras.setting import CameraMetadata, EntrancePupil, Intrinsics, LensSetting, entrance_pupil
from rptcam_cl.scene import camera as camera_models
from rptcam_cl.scene.changes import at_opening
from rptcam_cl.scene.film import LensColour
from rptcam_cl.scene.scene import Scene

Array = NDArray[np.float64]

Windows = Sequence[Window]

F_NUMBERS = (0.5, 64.0)  # of an ideal lens
_NARROWEST = 32.0  # f-number that a stop closes to, or two stops beyond the widest


@dataclass(frozen=True)
class Perspective:
    """The pupil and the image of a focused lens, to first order [mm].

    Attributes
    ----------
    focus_mm : float
        Plane in focus to the point that distances are counted from: the film of a real lens, the thin lens itself.
    pupil_mm : float
        Entrance pupil ahead of that point.
    diameter_mm : float
        Of the entrance pupil.
    per_tangent_mm : float
        How far the image moves on the film per unit of the tangent from the entrance pupil.
    focal_length_mm : float
    """

    focus_mm: float
    pupil_mm: float
    diameter_mm: float
    per_tangent_mm: float
    focal_length_mm: float

    def field(self, circle_mm: float, opening: float = 1.0) -> tuple[float, float]:
        """Return the near and the far end of what is sharp [mm], the latter perhaps infinite.

        Parameters
        ----------
        circle_mm
            Largest blur on the film that counts as sharp.
        opening
            Share of the pupil's diameter.
        """
        u, reach = self.focus_mm - self.pupil_mm, opening * self.diameter_mm * self.per_tangent_mm
        near = u * reach / (reach + circle_mm * u)
        far = u * reach / (reach - circle_mm * u) if reach > circle_mm * u else math.inf
        return near + self.pupil_mm, far + self.pupil_mm

    def blur(self, pixel_mm: float) -> tuple[float, float]:
        """Return the blur [pixels] of what is 1 / m nearer than the focus, and 1 / the distance of that [1 / m]."""
        reach_mm2 = self.diameter_mm * self.per_tangent_mm
        return 1e-3 * reach_mm2 / pixel_mm, 1e3 / (self.focus_mm - self.pupil_mm)


class CameraOptics(ABC):
    """The camera of a scene when the shutter opens, in focus. A kind overrides what it has; else it says what it lacks.

    Attributes
    ----------
    scene : Scene
    camera : Camera
    """

    camera: camera_models.Camera

    def __init__(self, scene: Scene, setting: LensSetting | None = None) -> None:
        self.scene, self.camera, self._given = scene, scene.camera, setting

    @property
    def setting(self) -> LensSetting | None:
        """The lens of surfaces in use."""
        return None

    @abstractmethod
    def model(self, lens_colour: LensColour = "off", coarse: bool = False, windows: Windows = ()) -> model.CameraModel:
        """Make its record, tables and facts for the device; parameters as in `camera_model` and `realistic_model`."""

    def chief_rays(self) -> CameraRays:
        """Return its chief rays: one for each place of the picture, in float64."""
        raise self.camera.lacks("its chief rays")

    def pupil_rays(self, places: Array) -> film_pupil.PupilRays:
        """Return the rays of places of the picture (m, 2), right and down in pixels.

        Raises
        ------
        InputError
            When it has no opening, or a place receives no light.
        """
        allowed = ", ".join(camera_models.kinds_where(lambda kind: kind.opens))
        raise InputError(f"camera.kind: {self.camera.kind} has no pupil (allowed: {allowed})")

    def film_pupils(self) -> film_pupil.FilmPupils:
        """The opening that points of the film see."""
        allowed = ", ".join(camera_models.kinds_where(lambda kind: kind.opens))
        raise InputError(
            "camera.diffraction: the camera has no opening that diffracts"
            f" (allowed: off, or a camera with an f-number: {allowed})"
        )

    def entrance_pupil(self) -> EntrancePupil:
        """Return its entrance pupil, the centre of its perspective."""
        raise self.camera.lacks("an entrance pupil")

    def intrinsics(self) -> Intrinsics:
        """The projection of points of its frame on the picture, to first order."""
        raise self.camera.lacks("intrinsics")

    def focal_length_mm(self) -> float | None:
        """Return its focal length [mm]; of a pinhole, the distance from its film; None without any."""
        return None

    def f_number(self) -> float | None:
        """Return the f-number that it stands at; that of the ideal lens in its place, None without either."""
        return self.scene.exposure.f_number

    def f_numbers(self) -> tuple[float, float]:
        """Return its widest and its narrowest f-number; equal where its opening cannot be set."""
        return F_NUMBERS

    def irradiance(self) -> float | None:
        """Return the irradiance of the film's centre for radiance 1 everywhere; None where there is no film."""
        return model.camera_irradiance(self.model(), self.scene.exposure)

    def perspective(self) -> Perspective | None:
        """Return its pupil and image to first order; None where no plane is in focus or there is no focus."""
        return None


class _Pinhole(CameraOptics):
    """Perspective without a lens."""

    camera: camera_models.PinholeCamera

    @cached_property
    def _tangents(self) -> tuple[float, float]:
        return model.half_tangents(self.camera.fov_degrees, self.camera.fov_axis, self.scene.film)

    def model(self, lens_colour: LensColour = "off", coarse: bool = False, windows: Windows = ()) -> model.CameraModel:
        camera, (across, down) = self.camera, self._tangents
        record = model.camera_record(
            camera, self.scene.film, "pinhole", half_width=across, half_height=down, near_distance=camera.near_m
        )
        moved = settings.place_film(record, self.scene, self.scene.film.size_m()[0] * 500.0 / across)
        metadata: CameraMetadata = {
            **settings.movements_metadata(camera),
            "camera": "pinhole",
            "intrinsics": self.intrinsics(),
            "entrance_pupil": self.entrance_pupil().described(),
        }
        return model.CameraModel(
            "camera/pinhole.h", record, moved, metadata=metadata, view=model.CameraView(starts_ahead=True)
        )

    def chief_rays(self) -> CameraRays:
        per_mm = self._tangents[0] / settings.half_film_mm(self.scene)[0]
        return PerspectiveRays(self.scene, 0.0, -per_mm, per_mm, 0.0)

    def entrance_pupil(self) -> EntrancePupil:
        return EntrancePupil()

    def intrinsics(self) -> Intrinsics:
        across, down = self._tangents
        return model.intrinsics(self.scene, (0.5 / across, 0.5 / down))

    def focal_length_mm(self) -> float:
        width_m, height_m = self.scene.film.size_m()
        sides = {"horizontal": width_m, "vertical": height_m, "diagonal": self.scene.film.diagonal_m()}
        return sides[self.camera.fov_axis] * 1e3 / 2 / math.tan(math.radians(self.camera.fov_degrees) / 2)


class _Orthographic(CameraOptics):
    """A parallel view."""

    camera: camera_models.OrthographicCamera

    def model(self, lens_colour: LensColour = "off", coarse: bool = False, windows: Windows = ()) -> model.CameraModel:
        camera, (width, height) = self.camera, self.scene.film.size_m()
        half = camera.width_m / 2
        record = model.camera_record(
            camera, self.scene.film, "pinhole",
            half_width=half, half_height=half * height / width, near_distance=camera.near_m,
        )  # fmt: skip
        metadata: CameraMetadata = {"camera": "orthographic"}
        return model.CameraModel(
            "camera/orthographic.h", record, {}, metadata=metadata, view=model.CameraView(starts_ahead=True)
        )

    def chief_rays(self) -> CameraRays:
        return PerspectiveRays(
            self.scene, -self.camera.width_m / 2 / settings.half_film_mm(self.scene)[0], 0.0, 0.0, 0.0
        )


class _Environment(CameraOptics):
    """The whole sphere in longitude and latitude."""

    camera: camera_models.EnvironmentCamera

    def model(self, lens_colour: LensColour = "off", coarse: bool = False, windows: Windows = ()) -> model.CameraModel:
        record = model.camera_record(self.camera, self.scene.film, "environment")
        return model.CameraModel("camera/environment.h", record, {}, metadata={"camera": "environment"})

    def chief_rays(self) -> CameraRays:
        return SphereRays(self.scene)

    def intrinsics(self) -> Intrinsics:
        allowed = ", ".join(camera_models.kinds_where(lambda kind: not kind.sees_all_around))
        raise InputError(
            f"camera.kind: an environment camera sees all around, so it has no intrinsics (allowed: {allowed})"
        )

    def entrance_pupil(self) -> EntrancePupil:
        self.intrinsics()
        return EntrancePupil()


class _ThinLens(CameraOptics):
    """An ideal lens of no thickness with one plane of focus; its film is lit evenly, as on the axis."""

    camera: camera_models.ThinLensCamera

    @cached_property
    def _optics(self) -> tuple[float, float, float]:
        """The tangents of half the field across and down, and the focal length [m].

        The film stands where the plane of focus is sharp, 1/f = 1/focus + 1/film distance; given the field of view
        instead of the focal length, the film distance follows from the film's size.
        """
        camera, (width, height) = self.camera, self.scene.film.size_m()
        if camera.focal_length_mm is not None:
            focal_length = camera.focal_length_mm * 1e-3
            distance = 1 / (1 / focal_length - 1 / camera.plane_m)
            return width / 2 / distance, height / 2 / distance, focal_length
        assert camera.fov_degrees is not None
        across, down = model.half_tangents(camera.fov_degrees, camera.fov_axis, self.scene.film)
        distance = width / 2 / across
        return across, down, 1 / (1 / distance + 1 / camera.plane_m)

    @property
    def _radius_m(self) -> float:
        if self.camera.aperture_radius_m is not None:
            return self.camera.aperture_radius_m
        assert self.camera.f_number is not None
        return self._optics[2] / self.camera.f_number / 2

    @property
    def _film_m(self) -> float:
        return self.scene.film.size_m()[0] / 2 / self._optics[0]

    @property
    def _own_f_number(self) -> float:
        return self._optics[2] / (2 * self._radius_m) if self._radius_m else math.inf

    def model(self, lens_colour: LensColour = "off", coarse: bool = False, windows: Windows = ()) -> model.CameraModel:
        scene, camera, radius, tangents = self.scene, self.camera, self._radius_m, self._optics[:2]
        record = model.camera_record(
            camera, scene.film, "thin_lens",
            half_width=tangents[0], half_height=tangents[1], focus_distance=camera.plane_m, aperture_radius=radius,
        )  # fmt: skip
        tables, facts = lens_records.aperture_tables(scene, camera.aperture)
        shape = lens_records.stop_shape(scene, camera.aperture)
        on_axis = model.opening_irradiance(shape, radius, self._film_m) if radius else None
        facts |= settings.place_film(record, scene, self._film_m * 1e3)
        metadata: CameraMetadata = {
            **settings.movements_metadata(camera),
            "camera": "thin_lens",
            "focal_length_mm": self.focal_length_mm(),
            "f_number": self._own_f_number,
            "focus_distance_m": camera.plane_m,
            "on_axis_irradiance": on_axis,
            "intrinsics": self.intrinsics(),
            "entrance_pupil": self.entrance_pupil().described(),
        }
        columns, rows = scene.film.resolution
        gain = radius * math.sqrt(columns / tangents[0] * rows / tangents[1])  # pixels per vergence
        return model.CameraModel(
            "camera/thin_lens.h",
            record,
            facts=facts,
            tables=tables,
            metadata=metadata,
            view=model.CameraView(
                pupil_radius_m=radius, blur=lambda: model.thin_lens_blur(scene, gain, 1 / camera.plane_m, self._film_m)
            ),
            on_axis_irradiance=on_axis,
            reach=model.thin_lens_reach(radius, camera.plane_m, tangents, shape) if radius else None,
        )

    def chief_rays(self) -> CameraRays:
        per_mm = self._optics[0] / settings.half_film_mm(self.scene)[0]
        return PerspectiveRays(self.scene, 0.0, -per_mm, per_mm, 0.0)

    def pupil_rays(self, places: Array) -> film_pupil.PupilRays:
        shape = lens_records.stop_shape(self.scene, self.camera.aperture)
        return film_pupil.thin_lens_rays(self.scene, places, self._radius_m, self._film_m, self.camera.plane_m, shape)

    def film_pupils(self) -> film_pupil.FilmPupils:
        if not self._radius_m > 0:
            return super().film_pupils()
        slopes = (-1e-3 / self._film_m, self._radius_m / self._film_m)
        radius, film, plane = 1e3 * self._radius_m, 1e3 * self._film_m, 1e3 * self.camera.plane_m

        def scene_side(z: float) -> tuple[float, float]:
            return z / film, radius * (1 + z / plane)  # the scene lies at z < 0

        shape = lens_records.stop_shape(self.scene, self.camera.aperture)
        return film_pupil.flat_pupils(slopes, shape, 1.0, 1.0, radius, (scene_side, -4))

    def entrance_pupil(self) -> EntrancePupil:
        return EntrancePupil(diameter_mm=2e3 * self._radius_m)

    def intrinsics(self) -> Intrinsics:
        across, down, _ = self._optics
        return model.intrinsics(self.scene, (0.5 / across, 0.5 / down))

    def focal_length_mm(self) -> float:
        return self._optics[2] * 1e3

    def f_number(self) -> float | None:
        if self.camera.f_number is not None:
            return self.camera.f_number
        return self._own_f_number if math.isfinite(self._own_f_number) else super().f_number()

    def perspective(self) -> Perspective | None:
        focal, plane = self.focal_length_mm(), self.camera.plane_m * 1e3
        diameter = focal / self._own_f_number
        return Perspective(plane, 0.0, diameter, 1 / (1 / focal - 1 / plane), focal) if diameter else None


class _LensOfSurfaces(CameraOptics):
    """What both cameras with a lens of surfaces have."""

    camera: camera_models.ThickLensCamera | camera_models.RealisticCamera

    @cached_property
    def _in_use(self) -> LensSetting:
        return self._given or settings.lens_setting(self.scene)

    @property
    def setting(self) -> LensSetting:
        return self._in_use

    @cached_property
    def _thick(self) -> ThickLens:
        return thick_lens_of(self.setting.lens, self.setting.film_distance_mm, self.camera.wavelength_nm)

    @property
    def _first_vertex_m(self) -> float:
        return -self.setting.lens.film_z(self.setting.film_distance_mm) * 1e-3

    def focal_length_mm(self) -> float | None:
        focal_length_mm = self.setting.lens.first_order(self.camera.wavelength_nm).focal_length_mm
        return focal_length_mm if math.isfinite(focal_length_mm) else None

    def f_number(self) -> float | None:
        if self.camera.f_number is not None:
            return self.camera.f_number
        f_number = settings.design_to_focus(self.scene, self.camera).first_order(self.camera.wavelength_nm).f_number
        return f_number if math.isfinite(f_number) else None

    def f_numbers(self) -> tuple[float, float]:
        wide_open = self.camera.model_copy(update={"f_number": None, "stop_diameter_mm": None})
        lens = settings.design_to_focus(self.scene, wide_open)
        widest = lens.first_order(self.camera.wavelength_nm).f_number
        if not math.isfinite(widest):
            return F_NUMBERS
        return (widest, widest) if lens.stop is None else (widest, max(_NARROWEST, 4 * widest))

    def perspective(self) -> Perspective | None:
        setting = self.setting
        first = setting.lens.first_order(self.camera.wavelength_nm)
        try:
            thick = self._thick
        except InputError:  # no cardinal points: nothing to say to first order
            return None
        pupil = first.entrance_pupil
        if setting.focus_distance_mm is None or not math.isfinite(pupil.distance_mm):
            return None
        ahead = setting.lens.film_z(setting.film_distance_mm) - pupil.distance_mm
        if not setting.focus_distance_mm > ahead:
            return None
        per_tangent = 1 / abs(thick.slope[0])
        return Perspective(setting.focus_distance_mm, ahead, pupil.diameter_mm, per_tangent, first.focal_length_mm)


class _ThickLens(_LensOfSurfaces):
    """What the cardinal points and the pupils of a lens say, and nothing of its aberrations and rims."""

    camera: camera_models.ThickLensCamera

    def model(self, lens_colour: LensColour = "off", coarse: bool = False, windows: Windows = ()) -> model.CameraModel:
        scene, camera, setting, thick = self.scene, self.camera, self.setting, self._thick
        first_vertex_m, half = self._first_vertex_m, settings.half_film_mm(scene)
        passed = float(axial_transmittance(setting.lens, camera.wavelength_nm, setting.transmission))
        on_axis = setting.gain * passed * thick.axial_cone
        width_m, height_m = scene.film.size_m()
        record = model.camera_record(
            camera, scene.film, "thick_lens",
            film_half_width=width_m / 2 * 1e3, film_half_height=height_m / 2 * 1e3,
            weight=setting.gain * passed * thick.pupil_solid_angle,
            metres_per_mm=1e-3, first_vertex_z=first_vertex_m,
            film_slope_per_film=thick.film_slope[0], film_slope_per_pupil=thick.film_slope[1],
            height_per_film=thick.height[0], height_per_pupil=thick.height[1],
            slope_per_film=thick.slope[0], slope_per_pupil=thick.slope[1],
        )  # fmt: skip
        settings.check_film(setting.lens, setting.film_distance_mm, scene)
        moved = settings.place_film(record, scene)
        metadata: CameraMetadata = {
            "camera": "thick_lens",
            **setting.metadata,
            "on_axis_irradiance": on_axis,
            "intrinsics": self.intrinsics(),
            **settings.movements_metadata(camera),
            "entrance_pupil": self.entrance_pupil().described(),
        }
        if setting.transmission:
            metadata["transmittance"] = passed
        return model.CameraModel(
            "camera/thick_lens.h",
            record,
            facts=moved,
            metadata=metadata,
            view=model.entrance_pupil_view(
                setting.lens.first_order(camera.wavelength_nm),
                first_vertex_m,
                lambda: model.thick_lens_blur(thick, scene, first_vertex_m),
            ),
            on_axis_irradiance=on_axis,
            passed=passed,
            axial_weight=on_axis,
            reach=model.thick_lens_reach(thick.height, thick.slope, first_vertex_m, half),
        )

    def chief_rays(self) -> CameraRays:
        thick, height = self._thick, self._thick.height[0] * 1e-3
        return PerspectiveRays(self.scene, height, thick.slope[0], thick.film_slope[0], self._first_vertex_m)

    def pupil_rays(self, places: Array) -> film_pupil.PupilRays:
        return film_pupil.thick_lens_rays(self.scene, places, self._thick, self._first_vertex_m)

    def film_pupils(self) -> film_pupil.FilmPupils:
        lens = self.setting.lens
        index = float(lens.indices(self.camera.wavelength_nm)[-1])
        stop = lens.stop or lens.surfaces[0]
        thick = self._thick

        def scene_side(z: float) -> tuple[float, float]:
            first, second = (height - z * slope for height, slope in zip(thick.height, thick.slope, strict=True))
            return first, second

        return film_pupil.flat_pupils(thick.film_slope, None, -1.0, index, float(stop.semi_diameter), (scene_side, 0))

    def entrance_pupil(self) -> EntrancePupil:
        return entrance_pupil(self.scene, self.setting, drifts=False)

    def intrinsics(self) -> Intrinsics:
        return model.thick_lens_intrinsics(self.scene, self._thick)


class _TracedLens(_LensOfSurfaces):
    """A real lens: every ray is traced through every surface, or by polynomials fitted to such rays."""

    camera: camera_models.RealisticCamera

    def model(self, lens_colour: LensColour = "off", coarse: bool = False, windows: Windows = ()) -> model.CameraModel:
        return realistic_model(self.scene, self.setting, windows, lens_colour=lens_colour, coarse=coarse)

    def chief_rays(self) -> CameraRays:
        return TracedRays(self.scene, self.setting)

    def pupil_rays(self, places: Array) -> film_pupil.PupilRays:
        return film_pupil.traced_lens_rays(self.scene, self.setting, places)

    def film_pupils(self) -> film_pupil.FilmPupils:
        return film_pupil.traced_pupils(lens_records.shaped(self.scene, self.setting))

    def entrance_pupil(self) -> EntrancePupil:
        return entrance_pupil(self.scene, self.setting, drifts=True)

    def intrinsics(self) -> Intrinsics:
        return model.thick_lens_intrinsics(self.scene, self._thick, "traced lens")

    def irradiance(self) -> float:
        lens, setting = lens_records.shaped(self.scene, self.setting).lens, self.setting
        return axis_irradiance(lens, setting.film_distance_mm, self.camera.wavelength_nm, setting.transmission)


_KINDS: dict[str, type[CameraOptics]] = {
    "pinhole": _Pinhole,
    "orthographic": _Orthographic,
    "environment": _Environment,
    "thin_lens": _ThinLens,
    "thick_lens": _ThickLens,
    "realistic": _TracedLens,
}


def camera_of(scene: Scene, setting: LensSetting | None = None) -> CameraOptics:
    """Return the camera of a scene, where it is when the shutter opens.

    Parameters
    ----------
    setting
        The lens in use, where that is known; the scene is then taken as it is.

    Raises
    ------
    InputError
        When the focus is yet to be found.
    """
    scene = scene if setting is not None else at_opening(settings.on_film(scene))
    if scene.camera.kind not in _KINDS:
        raise scene.camera.lacks("its optics (_KINDS in rptcam_cl/rendering/cameras/kinds.py)")
    return _KINDS[scene.camera.kind](scene, setting)


def camera_model(scene: Scene, lens_colour: LensColour = "off", *, coarse: bool = False) -> model.CameraModel:
    """Make the camera of a scene for the device, where it is when the shutter opens.

    Parameters
    ----------
    lens_colour
        Whether the lens refracts each wavelength separately: only where a picture of this size shows it with ``auto``.
    coarse
        Whether a table of the pupil does that is made faster and holds all but slivers of it.
    """
    camera = camera_of(scene)
    return model.exposed(camera.model(lens_colour, coarse=coarse), camera.scene)
