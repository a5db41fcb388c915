"""The dials of the viewfinder by name: what turning one changes in the scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import COOLEST, HOTTEST, LIGHTS, NO_BALANCE, TONES, Scene, listed, near_name
from rptcam_cl.viewfinder import exposure_dials, optics_dials
from rptcam_cl.viewfinder.panel import Dials, Panel, Turned, number, read_dials, word

__all__ = [
    "DIALS",
    "Dials",
    "Turned",
    "follow_light",
    "meter_needle",
    "read_dials",
    "turn_dial",
    "wheel",
    "zoom_clicks",
]

BALANCES = (NO_BALANCE, *LIGHTS)


def turn_white_balance(panel: Panel, value: Any) -> Turned:
    """Choose the light that is made grey, by name or as a temperature [K]."""
    if isinstance(value, str):
        return Turned(panel.dials, {"picture.white_balance": word("white_balance", value, BALANCES)})
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"white_balance: must be a light or a temperature in kelvin (got {str(value)[:40]!r})")
    return turn_temperature(panel, value)


def turn_temperature(panel: Panel, value: Any) -> Turned:
    """Choose the colour temperature [K] of the light that is made grey."""
    wanted = number("temperature_k", value)
    kelvin = min(max(wanted, COOLEST), HOTTEST)
    messages = () if kelvin == wanted else (f"temperatures go from {COOLEST:g} to {HOTTEST:g} K",)
    balance = panel.scene.picture.white_balance
    tint = {} if balance is None or balance.tint is None else {"tint": balance.tint}
    return Turned(panel.dials, {"picture.white_balance": {"temperature_k": kelvin} | tint}, messages)


def turn_tone(panel: Panel, value: Any) -> Turned:
    """Choose the tone curve."""
    return Turned(panel.dials, {"picture.tone": word("tone", value, TONES)})


DIALS: dict[str, Callable[[Panel, Any], Turned]] = {
    "mode": exposure_dials.turn_mode,
    "f_number": exposure_dials.turn_f_number,
    "shutter_s": exposure_dials.turn_time,
    "iso": exposure_dials.turn_iso,
    "auto_iso": exposure_dials.turn_auto_iso,
    "ev": exposure_dials.turn_ev,
    "lock": exposure_dials.turn_lock,
    "metering": exposure_dials.turn_metering,
    "focus_m": optics_dials.turn_focus,
    "zoom": optics_dials.turn_zoom,
    "lens": optics_dials.turn_lens,
    "stop": optics_dials.turn_stop,
    "blades": optics_dials.turn_blades,
    "format": optics_dials.turn_format,
    "white_balance": turn_white_balance,
    "temperature_k": turn_temperature,
    "tone": turn_tone,
}


def turn_dial(
    dials: Dials, scene: Scene, resolved: Scene, name: str, value: Any, reading_cd_m2: float | None = None
) -> Turned:
    """Return what turning a dial changes.

    Parameters
    ----------
    dials
        The state of the body.
    scene, resolved
        As requested, and in focus and exposed.
    name, value
        Of the dial, as `dial_list` has them.
    reading_cd_m2
        What the meter reads (`film_reading`); without it, the exposure that stands is kept.

    Raises
    ------
    InputError
        There is no such dial, or the value is not one of its kind; nothing has changed.
    """
    if name not in DIALS:
        raise InputError(f"{name[:40]}: is no dial{near_name(name, list(DIALS))} (allowed: {listed(list(DIALS))})")
    return DIALS[name](Panel(dials, scene, resolved, reading_cd_m2), value)


def follow_light(dials: Dials, scene: Scene, resolved: Scene, reading_cd_m2: float | None) -> Turned:
    """Return what follows a new reading of the meter; no change within 0.02 EV, and where nothing follows."""
    return exposure_dials.follow_light(Panel(dials, scene, resolved, reading_cd_m2))


def meter_needle(dials: Dials, scene: Scene, resolved: Scene, reading_cd_m2: float | None) -> float | None:
    """Return how much brighter the metered part is than the meter's target [EV]; None without a reading."""
    return exposure_dials.meter_needle(Panel(dials, scene, resolved, reading_cd_m2))


def wheel(scene: Scene) -> dict[str, str]:
    """Return what the wheel does with this camera: ``zoom``, ``angle``, ``crop`` or ``none``, and how to say it."""
    does = optics_dials.zoom_kind(scene)
    return {"does": does, "text": optics_dials.ZOOM_TEXTS[does]}


def zoom_clicks(dials: Dials, scene: Scene, resolved: Scene, clicks: float) -> Turned:
    """Return what turning the wheel changes; a click is 3 % of the focal length."""
    return optics_dials.zoom_by(Panel(dials, scene, resolved), clicks)
