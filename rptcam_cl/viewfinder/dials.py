"""The dials of the viewfinder by name: what turning one changes in the scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import Scene, listed, near_name
from rptcam_cl.viewfinder import exposure_dials, optics_dials, picture_dials
from rptcam_cl.viewfinder.panel import Dials, Panel, Turned, read_dials

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
    "white_balance": picture_dials.turn_white_balance,
    "temperature_k": picture_dials.turn_temperature,
    "tone": picture_dials.turn_tone,
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
