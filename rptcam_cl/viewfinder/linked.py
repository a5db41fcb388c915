"""The linked dials of a camera: which of f-number, time and ISO follows when the light or another dial changes.

Exposure here is what the exposure model makes of it: a film value is luminance / 683 times E(N) times 683 t S / 78,
with E(N) the irradiance of the film's centre per radiance at the f-number N. `wanted` below is what 683 E t S / 78 has
to be.

| mode | stays | follows | with automatic ISO |
|---|---|---|---|
| M | N, t | nothing | ISO |
| A | N | t, at any length | t up to the hand-held limit, then ISO |
| S | t | N | N down to wide open, then ISO |
| P | – | N and t by the program | both, then ISO |

The program keeps the lens wide open until the time is as short as hands hold, 1 / (focal length on 36 x 24 mm) s; light
beyond that is shared between N and t half and half.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

from rptcam_cl.cameras import values_per_irradiance
from rptcam_cl.core.dataclass import dataclass

Mode = Literal["M", "A", "S", "P", "relative"]
Light = Callable[[float], float]
"""Irradiance of the film's centre per radiance, by f-number."""

CLAMPED_EV = 1e-3  # beyond which a limit is worth a word
INVERTED = 1e-5  # relative error of the light of an f-number that is sought: 1.4e-5 EV
ROUNDS = 40  # at most; lenses need three


@dataclass(frozen=True)
class Settings:
    """What the three dials stand at."""

    f_number: float
    time_s: float
    iso: float


@dataclass(frozen=True)
class Limits:
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


def exposure_value(settings: Settings, light: Light) -> float:
    """Return the EV at ISO 100: log2(N² / t · 100 / S) with the f-number that the light stands for."""
    square = math.pi / (4.0 * light(settings.f_number))
    return math.log2(square / settings.time_s * 100.0 / settings.iso)


def linked(mode: Mode, auto_iso: bool, settings: Settings, wanted: float, limits: Limits, light: Light) -> Linked:
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
    if (mode == "M" and not auto_iso) or abs(off) <= CLAMPED_EV:
        return Linked(settings, off, ())
    return Linked(settings, off, _at_an_end(mode, auto_iso, settings, limits))


def _at_an_end(mode: Mode, auto_iso: bool, settings: Settings, limits: Limits) -> tuple[str, ...]:
    free = {"A": ("time_s",), "S": ("f_number",), "P": ("f_number", "time_s")}.get(mode, ())
    names = (*free, "iso") if auto_iso else free
    ends = {name: limits.auto_iso if name == "iso" else getattr(limits, name) for name in names}
    return tuple(name for name, (low, high) in ends.items() if not low < getattr(settings, name) < high)


def _within(value: float, ends: tuple[float, float]) -> float:
    return min(max(value, ends[0]), ends[1])


def _by_time(settings: Settings, wanted: float, limits: Limits, light: Light, slowest: float | None) -> Settings:
    low, high = limits.time_s
    time_s = wanted / (light(settings.f_number) * values_per_irradiance(1.0, settings.iso))
    high = high if slowest is None else min(high, max(low, slowest))
    return replace(settings, time_s=_within(time_s, (low, high)))


def _only_longer(settings: Settings, wanted: float, limits: Limits, light: Light) -> Settings:
    longer = _by_time(settings, wanted, limits, light, slowest=None)
    return longer if longer.time_s > settings.time_s and exposure_of(settings, light) < wanted else settings


def _by_iso(settings: Settings, wanted: float, limits: Limits, light: Light) -> Settings:
    iso = wanted / (light(settings.f_number) * values_per_irradiance(settings.time_s, 1.0))
    return replace(settings, iso=_within(iso, limits.auto_iso))


def _by_f_number(settings: Settings, wanted: float, limits: Limits, light: Light) -> Settings:
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


def _by_program(settings: Settings, wanted: float, limits: Limits, light: Light) -> Settings:
    widest = replace(settings, f_number=limits.f_number[0])
    open_s = wanted / (light(widest.f_number) * values_per_irradiance(1.0, settings.iso))
    spare = math.log2(limits.hand_held_s / open_s)
    if spare > 0:
        half = light(widest.f_number) * 2.0 ** (-spare / 2)
        f_number = f_number_of(half, widest.f_number, limits.f_number, light)
        widest = replace(settings, f_number=f_number)
    return _by_time(widest, wanted, limits, light, slowest=None)
