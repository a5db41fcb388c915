"""The dials of development: white balance and tone curve."""

from __future__ import annotations

from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import COOLEST, HOTTEST, LIGHTS, NO_BALANCE, TONES
from rptcam_cl.viewfinder.panel import Panel, Turned, number, word

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
