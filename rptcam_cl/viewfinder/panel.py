"""What a dial acts upon: the state of the camera's body, the scene as it is, and what turning the dial comes to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any

from rptcam_cl.cameras import camera_model, design_to_focus, lens_setting
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import (
    EnvironmentCamera,
    Exposure,
    LensCamera,
    PinholeCamera,
    Scene,
    ThinLensCamera,
    change_scene,
    unknown_camera,
)
from rptcam_cl.viewfinder.light import irradiance_per_radiance
from rptcam_cl.viewfinder.linked import Light, Limits, Mode, Settings
from rptcam_cl.viewfinder.remembered import by_optics
from rptcam_cl.viewfinder.scales import SPEEDS, TIMES

NARROWEST = 32.0
IDEAL_F_NUMBERS = (0.5, 64.0)
AUTO_ISO = (100.0, 102400.0)
DIAGONAL_35_MM = math.hypot(36.0, 24.0)
AS_RADIANCE = Exposure()
OF_NO_LENS = 8.0  # f-number that a camera without an opening is first exposed by


@dataclass(frozen=True)
class Dials:
    """The state of a camera's body that a scene does not hold.

    Attributes
    ----------
    mode : Mode
        M, A, S or P; ``relative`` where the scene's exposure is no photographer's.
    auto_iso : bool
    ev : float
        Exposure compensation [stops].
    locked_cd_m2 : float or None
        Reading that the exposure is locked to.
    target : float
        Film value that the meter brings its reading to.
    metering : str
    spot_at : (x, y)
    written : Exposure
        What the scene says of the exposure in this state.
    whole_mm : (width, height)
        The film before a prime was cropped to.
    cropped_mm : (width, height)
        What it was cropped to, the same without a crop.
    """

    mode: Mode
    auto_iso: bool = False
    ev: float = 0.0
    locked_cd_m2: float | None = None
    target: float = 0.18
    metering: str = "average"
    spot_at: tuple[float, float] = (0.5, 0.5)
    written: Exposure = AS_RADIANCE
    whole_mm: tuple[float, float] = (36.0, 24.0)
    cropped_mm: tuple[float, float] = (36.0, 24.0)

    @property
    def meter(self) -> Exposure:
        """The metering, as `film_reading` takes it."""
        spot = {"spot_at": self.spot_at} if self.metering == "spot" else {}
        return Exposure.model_validate({"mode": "auto", "metering": self.metering} | spot)


@dataclass(frozen=True)
class Turned:
    """What turning a dial came to.

    Attributes
    ----------
    dials : Dials
    changes : mapping
        Key paths of the scene and their values, for `RenderSession.change`; None removes a key.
    messages : tuple of str
        What the photographer should know: a limit reached, a dial that another one sets.
    """

    dials: Dials
    changes: Mapping[str, Any] = field(default_factory=dict)
    messages: tuple[str, ...] = ()


@dataclass(frozen=True)
class Panel:
    """A camera in use.

    Attributes
    ----------
    dials : Dials
    scene : Scene
        As requested.
    resolved : Scene
        In focus and exposed.
    reading_cd_m2 : float or None
        What the meter reads now.
    """

    dials: Dials
    scene: Scene
    resolved: Scene
    reading_cd_m2: float | None = None

    def same(self, *messages: str) -> Turned:
        """Return that nothing changes, and why."""
        return Turned(self.dials, {}, messages)

    @property
    def view(self) -> Scene:
        """The scene whose optics count: in focus, with the requested camera and no cheaper one."""
        return self.resolved if type(self.resolved.camera) is type(self.scene.camera) else self.scene

    @property
    def without_film(self) -> bool:
        """Whether nothing says how much light a film would get: no opening, and no f-number that stands for one."""
        return not has_opening(self.scene) and self.scene.exposure.f_number is None

    @property
    def light(self) -> Light:
        """The irradiance of the film's centre by f-number."""

        def light(f_number: float) -> float:
            found = irradiance_per_radiance(with_f_number(self.view, f_number))
            assert found is not None
            return found

        return light

    @property
    def settings(self) -> Settings:
        """What f-number, time and ISO stand at, the first as an ideal lens's where the camera has none."""
        f_number = f_number_of_camera(self.view) or OF_NO_LENS
        return Settings(f_number, self.resolved.shutter.time_s, self.resolved.exposure.iso)

    @property
    def limits(self) -> Limits:
        """How far the dials go with this lens."""
        ends = TIMES.value(TIMES.first), TIMES.value(TIMES.last)
        focal_mm = focal_length_mm(self.view)
        hand_held = 1 / 60 if focal_mm is None else self.view.film.diagonal_m() * 1e3 / (focal_mm * DIAGONAL_35_MM)
        return Limits(
            f_numbers(self.view),
            ends,
            (SPEEDS.value(SPEEDS.first), SPEEDS.value(SPEEDS.last)),
            AUTO_ISO,
            min(max(hand_held, ends[0]), ends[1]),
        )


@by_optics
def f_number_of_camera(scene: Scene) -> float | None:
    """Return the f-number that a camera stands at; that of the ideal lens in its place, None without either."""
    camera = scene.camera
    if isinstance(camera, LensCamera):
        if camera.f_number is not None:
            return camera.f_number
        found = design_to_focus(scene, camera).first_order(camera.wavelength_nm).f_number
        return found if math.isfinite(found) else None
    if isinstance(camera, ThinLensCamera):
        if camera.f_number is not None:
            return camera.f_number
        found = float(camera_model(scene).metadata["f_number"])
        return found if math.isfinite(found) else scene.exposure.f_number
    return scene.exposure.f_number


@by_optics
def f_numbers(scene: Scene) -> tuple[float, float]:
    """Return the widest and the narrowest f-number of a camera; equal where its opening cannot be set."""
    camera = scene.camera
    if not isinstance(camera, LensCamera):
        return IDEAL_F_NUMBERS
    lens = design_to_focus(scene, camera.model_copy(update={"f_number": None, "stop_diameter_mm": None}))
    widest = lens.first_order(camera.wavelength_nm).f_number
    if not math.isfinite(widest):
        return IDEAL_F_NUMBERS
    return (widest, widest) if lens.stop is None else (widest, max(NARROWEST, 4 * widest))


def with_f_number(scene: Scene, f_number: float) -> Scene:
    """Return a scene at an f-number: of its camera, or of the ideal lens in its place."""
    camera = scene.camera
    if isinstance(camera, LensCamera):
        if camera.f_number == f_number or f_number_of_camera(scene) == f_number:
            return scene
        return change_scene(scene, camera={"f_number": f_number, "stop_diameter_mm": None})
    if isinstance(camera, ThinLensCamera) and camera.aperture_radius_m != 0:
        return change_scene(scene, camera={"f_number": f_number, "aperture_radius_m": None})
    return scene.model_copy(update={"exposure": Exposure(mode="physical", f_number=f_number)})


@by_optics
def focal_length_mm(scene: Scene) -> float | None:
    """Return the focal length of a camera [mm]; of a pinhole, the distance from its film; None for a whole sphere."""
    camera = scene.camera
    if isinstance(camera, EnvironmentCamera):
        return None
    if isinstance(camera, PinholeCamera):
        width_m, height_m = scene.film.size_m()
        sides = {"horizontal": width_m, "vertical": height_m, "diagonal": scene.film.diagonal_m()}
        return sides[camera.fov_axis] * 1e3 / 2 / math.tan(math.radians(camera.fov_degrees) / 2)
    if isinstance(camera, LensCamera):
        found = lens_setting(scene).lens.first_order(camera.wavelength_nm).focal_length_mm
        return found if math.isfinite(found) else None
    if isinstance(camera, ThinLensCamera):
        return float(camera_model(scene).metadata["focal_length_mm"])
    raise unknown_camera(scene.camera.kind, "its focal length (rptcam_cl/viewfinder/panel.py)")


def has_opening(scene: Scene) -> bool:
    """Return whether a camera has an opening whose light the exposure goes by."""
    camera = scene.camera
    return isinstance(camera, LensCamera) or (isinstance(camera, ThinLensCamera) and camera.aperture_radius_m != 0)


def read_dials(scene: Scene, before: Dials | None = None) -> Dials:
    """Return the state of the body that a scene stands for.

    Parameters
    ----------
    scene
        As requested.
    before
        The state so far, which stays where the scene's exposure and film are what it wrote.

    Raises
    ------
    InputError
        For a kind of camera that the dials do not know.
    """
    if not isinstance(scene.camera, PinholeCamera | EnvironmentCamera | ThinLensCamera | LensCamera):
        raise unknown_camera(scene.camera.kind, "dials in the viewfinder (rptcam_cl/viewfinder/panel.py)")
    size = film_mm(scene)
    whole = before.whole_mm if before is not None and is_same_size(before.cropped_mm, size) else size
    if before is not None and before.written == scene.exposure:
        return replace(before, whole_mm=whole, cropped_mm=size)
    exposure = scene.exposure
    common: dict[str, Any] = {"ev": exposure.ev, "written": exposure, "whole_mm": whole, "cropped_mm": size}
    if exposure.mode == "auto":
        common |= {"target": exposure.target, "metering": exposure.metering, "spot_at": exposure.spot_at}
        common["locked_cd_m2"] = exposure.lock_cd_m2
        automatic = exposure.priority == "shutter"
        return Dials("M" if automatic else "A", auto_iso=automatic, **common)
    return Dials("M" if exposure.mode == "physical" else "relative", **common)


def film_mm(scene: Scene) -> tuple[float, float]:
    """Return width and height of the film [mm]."""
    width, height = scene.film.size_m()
    return width * 1e3, height * 1e3


def is_same_size(first: tuple[float, float], second: tuple[float, float]) -> bool:
    """Return whether two films are of one size but for rounding."""
    return all(math.isclose(a, b, rel_tol=1e-9) for a, b in zip(first, second, strict=True))


def number(name: str, value: Any) -> float:
    """Return a dial's value as a number.

    Raises
    ------
    InputError
        It is none, or not finite.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InputError(f"{name}: must be a finite number (got {str(value)[:40]!r})")
    return float(value)


def word(name: str, value: Any, choices: tuple[str, ...]) -> str:
    """Return a dial's value as one of some words.

    Raises
    ------
    InputError
        It is none of them.
    """
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{name}: is not one of {', '.join(choices)} (got {str(value)[:40]!r})")
    return value


def flag(name: str, value: Any) -> bool:
    """Return a dial's value as true or false.

    Raises
    ------
    InputError
        It is neither.
    """
    if not isinstance(value, bool):
        raise InputError(f"{name}: must be true or false (got {str(value)[:40]!r})")
    return value
