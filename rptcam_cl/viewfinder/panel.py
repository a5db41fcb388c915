"""What a dial acts upon: the state of the camera's body, the scene as it is, and what turning the dial comes to."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import field, replace
from pathlib import Path
from typing import Any, Literal

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import remember
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.cameras.model import values_per_irradiance
from rptcam_cl.scene.camera import KEY_GROUPS
from rptcam_cl.scene.changes import at_opening, change_scene
from rptcam_cl.scene.exposure import MOST_FRAMES, Exposure, FrameSequence
from rptcam_cl.scene.lens_settings import ImageAperture
from rptcam_cl.scene.scene import Scene

# Results that depend on a scene's optics alone, kept for the last few of them: most dials leave the lens as it is.

KEPT = 48  # lens states


def optics_key(scene: Scene) -> Hashable:
    """The key of what the optics of a scene depend on; a file counts by its place and the time of its last change."""
    camera = at_opening(scene).camera
    stands = camera.lens_camera is not None and camera.lens_camera.focus.point is not None
    return (
        camera.model_dump_json(exclude=None if stands else KEY_GROUPS["pose"]),
        scene.film.size_m(),
        scene.exposure.f_number,
        scene.metres_per_unit,
        _files(scene),
    )


def _files(scene: Scene) -> Hashable:
    source, aperture = scene.lens_source(), scene.camera.outline
    found = [source] if isinstance(source, Path) else []
    if isinstance(aperture, ImageAperture) and isinstance(content := scene.content_of(aperture), Path):
        found.append(content)
    return tuple((str(path), path.stat().st_mtime_ns) for path in found)


#
# The light at the film: what a lens brings of a scene's radiance, and what of that becomes a film value.
#
# The exposure model is that of `cameras`: a film value is radiance times the irradiance of the film's centre per
# radiance, times what time and ISO make of it (ISO 12232), times compensation and filter.


@remember(most=KEPT, by=optics_key)
def irradiance_per_radiance(scene: Scene) -> float | None:
    """Return the irradiance of the film's centre for radiance 1 everywhere; None where there is no film to speak of.

    Parameters
    ----------
    scene
        In focus.
    """
    return camera_of(scene).irradiance()


def value_per_radiance(resolved: Scene) -> float:
    """Return the film's value for radiance 1 [W/(m² sr)] in the middle of the picture.

    Parameters
    ----------
    resolved
        With its exposure resolved.
    """
    exposure = resolved.exposure
    if exposure.mode not in ("irradiance", "physical"):
        return exposure.factor
    light = irradiance_per_radiance(resolved)
    assert light is not None, "a scene with such an exposure has a film"
    scale = values_per_irradiance(resolved.shutter.time_s, exposure.iso) if exposure.mode == "physical" else 1.0
    return light * scale * exposure.factor


#
# The linked dials of a camera: which of f-number, time and ISO follows when the light or another dial changes.
#
# Exposure here is what the exposure model makes of it: a film value is luminance / 683 times E(N) times 683 t S / 78,
# with E(N) the irradiance of the film's centre per radiance at the f-number N. `wanted` below is what 683 E t S / 78
# has to be.
#
# | mode | stays | follows | with automatic ISO | |---|---|---|---| | M | N, t | nothing | ISO | | A | N | t, at any
# length | t up to the hand-held limit, then ISO | | S | t | N | N down to wide open, then ISO | | P | – | N and t by
# the program | both, then ISO |
#
# The program keeps the lens wide open until the time is as short as hands hold, 1 / (focal length on 36 x 24 mm) s;
# light beyond that is shared between N and t half and half.

Mode = Literal["M", "A", "S", "P", "relative"]
Light = Callable[[float], float]
"""Irradiance of the film's centre per radiance, by f-number."""

_CLAMPED_EV = 1e-3  # beyond which a limit is worth a word
INVERTED = 1e-5  # relative error of the light of an f-number that is sought: 1.4e-5 EV
ROUNDS = 40  # at most; lenses need three


@dataclass(frozen=True)
class Settings:
    """What the three dials stand at."""

    f_number: float
    time_s: float
    iso: float


@dataclass(frozen=True)
class DialLimits:
    """How far the dials go.

    Attributes
    ----------
    f_number, time_s, iso : (least, most)
    auto_iso : (least, most)
        What automatic ISO may choose.
    hand_held_s : float
        Longest time that it and the program choose without need.
    """

    f_number: tuple[float, float]
    time_s: tuple[float, float]
    iso: tuple[float, float]
    auto_iso: tuple[float, float]
    hand_held_s: float


@dataclass(frozen=True)
class Linked:
    """Settings that were found.

    Attributes
    ----------
    settings : Settings
    off_ev : float
        By how much the picture is brighter than wanted, as the dials go no further.
    clamped : tuple of str
        Dials that stand at an end: ``f_number``, ``time_s``, ``iso``.
    """

    settings: Settings
    off_ev: float
    clamped: tuple[str, ...]


def exposure_of(settings: Settings, light: Light) -> float:
    """Return the film's value per radiance at given settings, without filter and compensation."""
    return light(settings.f_number) * values_per_irradiance(settings.time_s, settings.iso)


def linked(mode: Mode, auto_iso: bool, settings: Settings, wanted: float, limits: DialLimits, light: Light) -> Linked:
    """Return the settings that bring an exposure, as far as the dials go.

    Parameters
    ----------
    settings
        Where the dials stand; what is free is found anew.
    wanted
        Film value per radiance.
    """
    if auto_iso:
        settings = replace(settings, iso=settings.iso if mode == "M" else limits.auto_iso[0])
    if mode == "A":
        settings = _by_time(settings, wanted, limits, light, slowest=limits.hand_held_s if auto_iso else None)
    elif mode == "S":
        settings = _by_f_number(settings, wanted, limits, light)
    elif mode == "P":
        settings = _by_program(settings, wanted, limits, light)
    if auto_iso:
        settings = _by_iso(settings, wanted, limits, light)
        if mode in ("A", "P"):  # as a last resort the time goes beyond what hands hold
            settings = _only_longer(settings, wanted, limits, light)
    off = math.log2(exposure_of(settings, light) / wanted)
    if (mode == "M" and not auto_iso) or abs(off) <= _CLAMPED_EV:
        return Linked(settings, off, ())
    return Linked(settings, off, _at_an_end(mode, auto_iso, settings, limits))


def _at_an_end(mode: Mode, auto_iso: bool, settings: Settings, limits: DialLimits) -> tuple[str, ...]:
    free = {"A": ("time_s",), "S": ("f_number",), "P": ("f_number", "time_s")}.get(mode, ())
    names = (*free, "iso") if auto_iso else free
    ends = {name: limits.auto_iso if name == "iso" else getattr(limits, name) for name in names}
    return tuple(name for name, (low, high) in ends.items() if not low < getattr(settings, name) < high)


def _within(value: float, ends: tuple[float, float]) -> float:
    return min(max(value, ends[0]), ends[1])


def _by_time(settings: Settings, wanted: float, limits: DialLimits, light: Light, slowest: float | None) -> Settings:
    low, high = limits.time_s
    time_s = wanted / (light(settings.f_number) * values_per_irradiance(1.0, settings.iso))
    high = high if slowest is None else min(high, max(low, slowest))
    return replace(settings, time_s=_within(time_s, (low, high)))


def _only_longer(settings: Settings, wanted: float, limits: DialLimits, light: Light) -> Settings:
    longer = _by_time(settings, wanted, limits, light, slowest=None)
    return longer if longer.time_s > settings.time_s and exposure_of(settings, light) < wanted else settings


def _by_iso(settings: Settings, wanted: float, limits: DialLimits, light: Light) -> Settings:
    iso = wanted / (light(settings.f_number) * values_per_irradiance(settings.time_s, 1.0))
    return replace(settings, iso=_within(iso, limits.auto_iso))


def _by_f_number(settings: Settings, wanted: float, limits: DialLimits, light: Light) -> Settings:
    bright = wanted / values_per_irradiance(settings.time_s, settings.iso)
    return replace(settings, f_number=f_number_of(bright, settings.f_number, limits.f_number, light))


def f_number_of(bright: float, start: float, ends: tuple[float, float], light: Light) -> float:
    """Return the f-number that lets so much light through, within the ends of the dial.

    The light goes nearly as 1 / N², so that a few rounds from anywhere are exact.
    """
    f_number = _within(start, ends)
    for _ in range(ROUNDS):
        share = light(f_number) / bright
        if abs(share - 1.0) <= INVERTED:
            return f_number
        new = _within(f_number * math.sqrt(share), ends)
        if new == f_number:
            return new
        f_number = new
    return f_number


def _by_program(settings: Settings, wanted: float, limits: DialLimits, light: Light) -> Settings:
    widest = replace(settings, f_number=limits.f_number[0])
    open_s = wanted / (light(widest.f_number) * values_per_irradiance(1.0, settings.iso))
    spare = math.log2(limits.hand_held_s / open_s)
    if spare > 0:
        half = light(widest.f_number) * 2.0 ** (-spare / 2)
        f_number = f_number_of(half, widest.f_number, limits.f_number, light)
        widest = replace(settings, f_number=f_number)
    return _by_time(widest, wanted, limits, light, slowest=None)


#
# The scales engraved on dials: f-numbers, exposure times and ISO in thirds of a stop.
#
# A step is an exact third, 2^(1/6) in f-number and 2^(1/3) in time and ISO, so that steps on two dials cancel to the
# bit of rounding; what is written on it is the rounded number that cameras write (ISO 517, APEX), f/5.6 for 2^2.5.

THIRDS = 3  # steps of a stop
SAME = 1e-6  # relative difference within which a number is the one that is engraved


@dataclass(frozen=True)
class Scale:
    """A dial in thirds of a stop.

    Attributes
    ----------
    per_stop : float
        Stops of light for a factor of two: 2 for f-numbers, 1 for times and ISO.
    origin : float
        Value of step 0.
    first : int
        Step of the first engraving.
    engraved : tuple of str
        What is written on the steps.
    numbers : tuple of float
        The same as numbers.
    prefix, suffix : str
        Around what is written.
    """

    per_stop: float
    origin: float
    first: int
    engraved: tuple[str, ...]
    numbers: tuple[float, ...]
    prefix: str = ""
    suffix: str = ""

    @property
    def last(self) -> int:
        """The last step."""
        return self.first + len(self.engraved) - 1

    def value(self, step: int) -> float:
        """Return the exact value of a step."""
        return float(self.origin * 2.0 ** (step / (THIRDS * self.per_stop)))

    def nearest(self, value: float) -> int:
        """Return the step nearest to a value, on the scale."""
        step = round(THIRDS * self.per_stop * math.log2(value / self.origin))
        return min(max(step, self.first), self.last)

    def exact(self, value: float) -> float:
        """Return the exact value of a step where a value is what is engraved on it, else the value."""
        for place, number in enumerate(self.numbers):
            if math.isclose(value, number, rel_tol=SAME):
                return self.value(self.first + place)
        return value

    def text(self, value: float) -> str:
        """The name of a value: the engraving of its step, or its own digits between and beyond steps."""
        step = self.nearest(value)
        off = THIRDS * self.per_stop * math.log2(value / self.value(step))
        if abs(off) <= 0.51 and step == round(THIRDS * self.per_stop * math.log2(value / self.origin)):
            return f"{self.prefix}{self.engraved[step - self.first]}{self.suffix}"
        return f"{self.prefix}{value:.3g}{self.suffix}"

    def steps(self, low: float, high: float) -> list[float]:
        """Return the exact values of the steps from a value to another, these included."""
        values = [self.value(step) for step in range(self.first, self.last + 1)]
        return [value for value in values if low * (1 - SAME) <= value <= high * (1 + SAME)]


def _engraved_text(text: str) -> tuple[str, ...]:
    return tuple(text.split())


_F = _engraved_text(
    "0.5 0.56 0.63 0.7 0.8 0.9 1 1.1 1.2 1.4 1.6 1.8 2 2.2 2.5 2.8 3.2 3.5 4 4.5 5 5.6 6.3 7.1 8 9 10 11 13 14 16 18 20"
    " 22 25 29 32 36 40 45 51 57 64"
)
_FRACTIONS = _engraved_text(
    "32000 25600 20000 16000 12800 10000 8000 6400 5000 4000 3200 2500 2000 1600 1250 1000 800 640 500 400 320 250 200"
    " 160 125 100 80 60 50 40 30 25 20 15 13 10 8 6 5 4"
)
_SECONDS = _engraved_text("0.3 0.4 0.5 0.6 0.8 1 1.3 1.6 2 2.5 3.2 4 5 6 8 10 13 15 20 25 30 40 50 60")
_SPEEDS = _engraved_text(
    "6 8 10 12 16 20 25 32 40 50 64 80 100 125 160 200 250 320 400 500 640 800 1000 1250 1600 2000 2500 3200 4000 5000"
    " 6400 8000 10000 12800 16000 20000 25600 32000 40000 51200 64000 80000 102400 128000 160000 204800 256000 320000"
    " 409600"
)

F_NUMBERS = Scale(2.0, 1.0, -6, _F, tuple(map(float, _F)), prefix="f/")
TIMES = Scale(
    1.0,
    1.0,
    -45,
    (*(f"1/{text}" for text in _FRACTIONS), *(f"{text} s" for text in _SECONDS)),
    (*(1.0 / float(text) for text in _FRACTIONS), *map(float, _SECONDS)),
)
SPEEDS = Scale(1.0, 100.0, -12, _SPEEDS, tuple(map(float, _SPEEDS)), prefix="ISO ")
EV_STEPS = [step / THIRDS for step in range(-5 * THIRDS, 5 * THIRDS + 1)]


def ev_text(ev: float) -> str:
    """Return exposure compensation as cameras write it, in thirds where it is thirds."""
    thirds = round(ev * THIRDS)
    if abs(ev * THIRDS - thirds) > 1e-9:
        return f"{ev:+.2f} EV"
    sign, (whole, rest) = ("-" if thirds < 0 else "+" if thirds else "±"), divmod(abs(thirds), THIRDS)
    return f"{sign}{whole if whole or not rest else ''}{('', '⅓', '⅔')[rest]} EV"


_AUTO_ISO = (100.0, 102400.0)


@dataclass(frozen=True)
class Body:
    """A camera body by its maker's figures.

    Attributes
    ----------
    label : str
    sensor_mm : (width, height)
        Of the whole picture; of film cameras for motion pictures, of the open gate.
    iso : (least, most)
        Speeds without extension; of cinema cameras the exposure index.
    """

    label: str
    sensor_mm: tuple[float, float]
    iso: tuple[float, float]

    def width_mm(self, resolution: tuple[int, int]) -> float:
        """Return the width of the largest picture of square pixels on the sensor, upright where the resolution is."""
        (width, height), (across, down) = resolution, self.sensor_mm
        if width < height:
            across, down = down, across
        return min(across, down * width / height)


# Sensor sizes and ISO ranges from the makers' specifications.
BODIES: dict[str, Body] = {
    "canon_eos_r5": Body("Canon EOS R5", (36.0, 24.0), (100, 51200)),
    "canon_eos_r7": Body("Canon EOS R7", (22.3, 14.8), (100, 32000)),
    "nikon_d850": Body("Nikon D850", (35.9, 23.9), (64, 25600)),
    "nikon_z6": Body("Nikon Z 6", (35.9, 23.9), (100, 51200)),
    "nikon_d500": Body("Nikon D500", (23.5, 15.7), (100, 51200)),
    "sony_a7_iv": Body("Sony α7 IV", (35.9, 23.9), (100, 51200)),
    "sony_a7s_iii": Body("Sony α7S III", (35.6, 23.8), (80, 102400)),
    "fujifilm_x_t3": Body("Fujifilm X-T3", (23.5, 15.6), (160, 12800)),
    "fujifilm_gfx_100": Body("Fujifilm GFX 100", (43.8, 32.9), (100, 12800)),
    "hasselblad_x1d_ii": Body("Hasselblad X1D II 50C", (43.8, 32.9), (100, 25600)),
    "phase_one_iq4": Body("Phase One IQ4 150MP", (53.4, 40.0), (50, 25600)),
    "panasonic_gh5": Body("Panasonic GH5", (17.3, 13.0), (200, 25600)),
    "arri_alexa_mini": Body("ARRI Alexa Mini, open gate", (28.25, 18.17), (160, 3200)),
    "arri_alexa_lf": Body("ARRI Alexa LF, open gate", (36.70, 25.54), (160, 3200)),
}
# Usual lenses of bodies: those of the library whose image circle covers the sensor.
_USUAL: dict[str, tuple[str, tuple[str, ...]]] = {
    "reportage": ("nikon_z6", ("retrofocus-28mm", "double-gauss-50mm-f1.8", "biotar-58mm", "zoom-70-200mm")),
    "nature": ("canon_eos_r5", ("wide-22mm", "macro-55mm", "telephoto-400mm", "mirror-500mm")),
    "small": ("fujifilm_x_t3", ("wide-22mm", "retrofocus-35mm", "double-gauss-50mm-f1.4")),
    "studio": ("hasselblad_x1d_ii", ("zoom-35-51mm", "tessar-102mm", "double-gauss-100mm-f1.35", "telephoto-250mm")),
    "cinema": ("arri_alexa_mini", ("retrofocus-35mm", "speed-panchro-50mm", "dgauss-100mm")),
}
KITS = {f"{kit}: {lens}": (body, lens) for kit, (body, lenses) in _USUAL.items() for lens in lenses}
"""A body with one of its usual lenses, by the name of the kit and the lens."""

DIAGONAL_35_MM = math.hypot(36.0, 24.0)
_AS_RADIANCE = Exposure()
_OF_NO_LENS = 8.0  # f-number that a camera without an opening is first exposed by


SECONDS = 4.0  # of the bar of time where keys reach no further


@dataclass(frozen=True)
class Clock:
    """Where a viewfinder stands in time.

    Attributes
    ----------
    first_s : float
        When the shutter of frame 1 opens [s].
    frame : int
        That is shown, from 1; 0 for the scene as it stands, where its sequence has keys that may say otherwise.
    frames : int
        How many the bar of time has.
    """

    first_s: float = 0.0
    frame: int = 1
    frames: int = 97

    @classmethod
    def of(cls, scene: Scene) -> Clock:
        """The clock of a scene file that is opened."""
        first_s, sequence = scene.shutter.open_s, scene.sequence or FrameSequence()
        moving = [scene.camera.motion, *(each.motion for each in scene.objects)]
        ends = [
            frames[-1].time_s for frames in (*moving, *sequence.keys.values(), *scene.shutter.keys.values()) if frames
        ]
        rate = sequence.frames_per_second
        last = math.ceil(round((max(ends) - first_s) * rate, 6)) + 1 if ends else 0
        last = last if last > 1 else round(SECONDS * rate) + 1
        return cls(first_s, 0 if sequence.keys else 1, min(max(last, 2), MOST_FRAMES))


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
    clock : Clock
    dark : mapping
        Strengths of lamps that are muted, by key path, as the scene had them.
    mute, solo : frozenset of str
        Lamps that a hand has muted, and those that shine alone.
    body : str or None
        One of `BODIES`, whose speeds limit the ISO.
    mix : mapping
        Factors on the light of groups of lamps, whose light the film keeps apart.
    unmixed : mapping
        What the scene said before its lamps were kept apart, by key path.
    """

    mode: Mode
    auto_iso: bool = False
    ev: float = 0.0
    locked_cd_m2: float | None = None
    target: float = 0.18
    metering: str = "average"
    spot_at: tuple[float, float] = (0.5, 0.5)
    written: Exposure = _AS_RADIANCE
    whole_mm: tuple[float, float] = (36.0, 24.0)
    cropped_mm: tuple[float, float] = (36.0, 24.0)
    clock: Clock = Clock()
    dark: Mapping[str, Any] = field(default_factory=dict)
    mute: frozenset[str] = frozenset()
    solo: frozenset[str] = frozenset()
    body: str | None = None
    mix: Mapping[str, float] = field(default_factory=dict)
    unmixed: Mapping[str, Any] = field(default_factory=dict)

    @property
    def meter(self) -> Exposure:
        """The metering, as `film_reading` takes it."""
        spot = {"spot_at": self.spot_at} if self.metering == "spot" else {}
        return Exposure.model_validate({"mode": "auto", "metering": self.metering} | spot)


@dataclass(frozen=True)
class Turn:
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

    def same(self, *messages: str) -> Turn:
        """Return that nothing changes, and why."""
        return Turn(self.dials, {}, messages)

    @property
    def view(self) -> Scene:
        """The scene whose optics count: in focus, with the requested camera and no cheaper one."""
        return self.resolved if type(self.resolved.camera) is type(self.scene.camera) else self.scene

    @property
    def without_film(self) -> bool:
        """Whether nothing says how much light a film would get: no opening, and no f-number that stands for one."""
        return not self.scene.camera.has_opening and self.scene.exposure.f_number is None

    @property
    def light(self) -> Light:
        """The irradiance of the film's centre by f-number."""

        def light(f_number: float) -> float:
            found = irradiance_per_radiance(_with_f_number(self.view, f_number))
            assert found is not None
            return found

        return light

    @property
    def settings(self) -> Settings:
        """What f-number, time and ISO stand at, the first as an ideal lens's where the camera has none."""
        f_number = f_number_of_camera(self.view) or _OF_NO_LENS
        return Settings(f_number, self.resolved.shutter.time_s, self.resolved.exposure.iso)

    @property
    def speeds(self) -> tuple[float, float] | None:
        """The slowest and the fastest ISO of the body, as the scale has them; None without one."""
        if self.dials.body is None:
            return None
        least, most = map(SPEEDS.exact, BODIES[self.dials.body].iso)
        return least, most

    @property
    def limits(self) -> DialLimits:
        """How far the dials go with this lens."""
        ends = TIMES.value(TIMES.first), TIMES.value(TIMES.last)
        focal_mm = focal_length_mm(self.view)
        hand_held = 1 / 60 if focal_mm is None else self.view.film.diagonal_m() * 1e3 / (focal_mm * DIAGONAL_35_MM)
        return DialLimits(
            f_numbers(self.view),
            ends,
            self.speeds or (SPEEDS.value(SPEEDS.first), SPEEDS.value(SPEEDS.last)),
            self.speeds or _AUTO_ISO,
            min(max(hand_held, ends[0]), ends[1]),
        )


@remember(most=KEPT, by=optics_key)
def f_number_of_camera(scene: Scene) -> float | None:
    """Return the f-number that a camera stands at; that of the ideal lens in its place, None without either."""
    return camera_of(scene).f_number()


@remember(most=KEPT, by=optics_key)
def f_numbers(scene: Scene) -> tuple[float, float]:
    """Return the widest and the narrowest f-number of a camera; equal where its opening cannot be set."""
    return camera_of(scene).f_numbers()


def _with_f_number(scene: Scene, f_number: float) -> Scene:
    """Return a scene at an f-number: of its camera, or of the ideal lens in its place."""
    keys = scene.camera.f_number_keys(f_number)
    if keys is None:
        return scene.model_copy(update={"exposure": Exposure(mode="physical", f_number=f_number)})
    return scene if f_number_of_camera(scene) == f_number else change_scene(scene, camera=keys)


@remember(most=KEPT, by=optics_key)
def focal_length_mm(scene: Scene) -> float | None:
    """Return the focal length of a camera [mm]; of a pinhole, the distance from its film; None for a whole sphere."""
    return camera_of(scene).focal_length_mm()


def read_dials(scene: Scene, before: Dials | None = None) -> Dials:
    """Return the state of the body that a scene stands for.

    Parameters
    ----------
    scene
        As requested.
    before
        The state so far, which stays where the scene's exposure and film are what it wrote.
    """
    size = film_mm(scene)
    whole = before.whole_mm if before is not None and is_same_size(before.cropped_mm, size) else size
    if before is not None and before.written == scene.exposure:
        return replace(before, whole_mm=whole, cropped_mm=size)
    exposure = scene.exposure
    common: dict[str, Any] = {"ev": exposure.ev, "written": exposure, "whole_mm": whole, "cropped_mm": size}
    common["clock"] = Clock.of(scene) if before is None else before.clock
    if before is not None:
        common |= {name: getattr(before, name) for name in ("dark", "mute", "solo", "body", "mix", "unmixed")}
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
