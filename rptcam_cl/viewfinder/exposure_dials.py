"""The dials of exposure: mode, f-number, time, ISO, compensation, lock and metering, linked as on a camera.

What the scene can say itself, it says: A is `exposure: auto` by aperture, M with automatic ISO the same by shutter, so
that a render meters as the viewfinder does. S and P, and what limits hold back, become `exposure: physical` with the
settings that were found.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, get_args

from rptcam_cl.cameras import values_per_irradiance
from rptcam_cl.colour import LUMENS_PER_WATT
from rptcam_cl.scene import LEAST_CD_M2, MOST_CD_M2, MOST_STOPS, Exposure, LensCamera
from rptcam_cl.viewfinder.light import value_per_radiance
from rptcam_cl.viewfinder.linked import Linked, Mode, Settings, exposure_of, linked
from rptcam_cl.viewfinder.panel import Panel, Turned, flag, has_opening, number, word
from rptcam_cl.viewfinder.scales import F_NUMBERS, SPEEDS, TIMES

MODES: tuple[Mode, ...] = get_args(Mode)
METERINGS = ("average", "centre_weighted", "spot")
STEADY_EV = 0.02  # change of the light that nothing follows
MOST_EV = 5.0
NO_FILM = "the camera has no lens opening: choose M, A, S or P first, and it is exposed as behind an ideal lens"


def turn_mode(panel: Panel, value: Any) -> Turned:
    """Choose M, A, S, P, or the scene's own scale of values; the picture stays as bright as it is, or is metered."""
    mode: Mode = next(known for known in MODES if known == word("mode", value, MODES))
    dials = panel.dials
    if mode == dials.mode:
        return panel.same()
    if mode == "relative":
        return _as_values(panel)
    settings, pushed = panel.settings, 0.0
    words = f"the camera has no lens opening: it is exposed as behind an ideal lens at f/{settings.f_number:g}"
    messages = (words,) if panel.without_film else ()
    if dials.mode == "relative" or panel.without_film:
        settings, dials = _as_bright(panel, settings), replace(dials, ev=0.0)
    elif dials.mode == "M" and not dials.auto_iso:
        pushed = dials.ev
    if mode == "M" and not dials.auto_iso:  # the settings hold what the meter and the compensation had brought
        dials = replace(dials, ev=0.0, locked_cd_m2=None)
    new = replace(panel, dials=replace(dials, mode=mode))
    turned = _relinked(new, settings, standing=settings, ev_change=pushed)
    return replace(turned, messages=(*messages, *turned.messages))


def _as_values(panel: Panel) -> Turned:
    """Return the scene with values that stand for radiance, as bright as it is."""
    ev = math.log2(value_per_radiance(panel.resolved))
    exposure = Exposure(mode="relative", ev=min(max(ev, -MOST_STOPS), MOST_STOPS))
    dials = replace(panel.dials, mode="relative", auto_iso=False, ev=exposure.ev, locked_cd_m2=None, written=exposure)
    return Turned(dials, {"exposure": _said(exposure)})


def _as_bright(panel: Panel, settings: Settings) -> Settings:
    """Return settings that make a picture as bright as the scene's own scale: by the time, then by the ISO."""
    wanted = value_per_radiance(panel.resolved) * 2.0**panel.resolved.exposure.neutral_density_stops
    low, high = panel.limits.time_s
    light = panel.light(settings.f_number)
    time_s = min(max(wanted / (light * values_per_irradiance(1.0, settings.iso)), low), high)
    if low < time_s < high:
        return replace(settings, time_s=time_s)
    return replace(settings, time_s=time_s, iso=wanted / (light * values_per_irradiance(time_s, 1.0)))


def turn_f_number(panel: Panel, value: Any) -> Turned:
    """Set the f-number, in M and A."""
    wanted = F_NUMBERS.exact(number("f_number", value))
    if panel.dials.mode in ("S", "P"):
        return panel.same(f"the f-number follows in {panel.dials.mode}")
    if panel.without_film:
        return panel.same(NO_FILM)
    low, high = panel.limits.f_number
    f_number = min(max(wanted, low), high)
    messages = () if f_number == wanted else (f"the lens goes from f/{low:.3g} to f/{high:.3g}",)
    settings = replace(panel.settings, f_number=f_number)
    turned = _relinked(panel, settings)
    return replace(turned, messages=(*messages, *turned.messages))


def turn_time(panel: Panel, value: Any) -> Turned:
    """Set the exposure time, in M and S; where values stand for radiance it only smears what moves."""
    wanted = TIMES.exact(number("shutter_s", value))
    if panel.dials.mode in ("A", "P"):
        return panel.same(f"the time follows in {panel.dials.mode}")
    low, high = panel.limits.time_s
    time_s = min(max(wanted, low), high)
    messages = () if time_s == wanted else (f"the shutter goes from {TIMES.text(low)} to {TIMES.text(high)}",)
    if panel.dials.mode == "relative":
        words = "values stand for radiance, whatever the time: choose M, A, S or P to expose"
        return Turned(panel.dials, {"shutter.time_s": time_s}, (*messages, words))
    turned = _relinked(panel, replace(panel.settings, time_s=time_s))
    return replace(turned, messages=(*messages, *turned.messages))


def turn_iso(panel: Panel, value: Any) -> Turned:
    """Set the ISO."""
    wanted = SPEEDS.exact(number("iso", value))
    if panel.dials.mode == "relative":
        return panel.same("values stand for radiance, whatever the ISO: choose M, A, S or P to expose")
    if panel.dials.auto_iso:
        return panel.same("the ISO is automatic")
    low, high = panel.limits.iso
    iso = min(max(wanted, low), high)
    messages = () if iso == wanted else (f"the ISO goes from {low:.3g} to {high:.6g}",)
    turned = _relinked(panel, replace(panel.settings, iso=iso))
    return replace(turned, messages=(*messages, *turned.messages))


def turn_auto_iso(panel: Panel, value: Any) -> Turned:
    """Leave the ISO to the meter, or keep what it has found."""
    on = flag("auto_iso", value)
    if panel.dials.mode == "relative":
        return panel.same("values stand for radiance, whatever the ISO: choose M, A, S or P to expose")
    if on == panel.dials.auto_iso:
        return panel.same()
    dials, pushed = replace(panel.dials, auto_iso=on), 0.0
    if panel.dials.mode == "M":
        pushed = panel.dials.ev if on else 0.0
        dials = dials if on else replace(dials, ev=0.0, locked_cd_m2=None)  # the ISO that was found holds it
    return _relinked(replace(panel, dials=dials), panel.settings, ev_change=pushed)


def turn_ev(panel: Panel, value: Any) -> Turned:
    """Set the compensation: what is free follows; in M, and where values stand for radiance, it scales the film."""
    wanted = number("ev", value)
    ev = min(max(wanted, -MOST_EV), MOST_EV)
    messages = () if ev == wanted else (f"compensation goes from -{MOST_EV:g} to +{MOST_EV:g} EV",)
    new = replace(panel, dials=replace(panel.dials, ev=ev))
    turned = _relinked(new, panel.settings, ev_change=ev - panel.dials.ev)
    return replace(turned, messages=(*messages, *turned.messages))


def turn_lock(panel: Panel, value: Any) -> Turned:
    """Hold the reading of the meter, or let it go."""
    on = flag("lock", value)
    dials = panel.dials
    if not _follows(panel):
        return panel.same("nothing follows the meter, so there is nothing to lock") if on else panel.same()
    stands = panel.reading_cd_m2 or _standing_reading(panel)
    reading = min(max(stands, LEAST_CD_M2), MOST_CD_M2) if on else None
    return _relinked(replace(panel, dials=replace(dials, locked_cd_m2=reading)), panel.settings)


def turn_metering(panel: Panel, value: Any) -> Turned:
    """Choose what the meter weighs: the frame, its middle, or a spot."""
    metering = word("metering", value, METERINGS)
    dials = replace(panel.dials, metering=metering)
    if metering != "spot":
        dials = replace(dials, spot_at=(0.5, 0.5))
    return _written(replace(panel, dials=dials), Linked(panel.settings, 0.0, ()))


def follow_light(panel: Panel) -> Turned:
    """Return what follows when the meter reads something new; nothing where the scene's own metering follows.

    Parameters
    ----------
    panel
        With the new reading.
    """
    if panel.reading_cd_m2 is None or panel.dials.locked_cd_m2 is not None or not _follows(panel):
        return panel.same()
    if panel.without_film:
        return panel.same()
    turned = _relinked(panel, panel.settings)
    if panel.dials.written.mode == "physical" and turned.dials.written.mode == "physical":
        wanted = _wanted(panel, panel.settings, 0.0)
        off = abs(math.log2(exposure_of(panel.settings, panel.light) / wanted))
        if off < STEADY_EV:
            return replace(panel.same(), messages=turned.messages)
    return turned


def meter_needle(panel: Panel) -> float | None:
    """Return how much brighter the settings make the metered part than its target [EV]; None without a reading."""
    reading = panel.dials.locked_cd_m2 or panel.reading_cd_m2
    if reading is None or panel.resolved.exposure.mode == "auto":
        return None
    value = reading / LUMENS_PER_WATT * value_per_radiance(panel.resolved)
    return math.log2(value / panel.dials.target)


def _follows(panel: Panel) -> bool:
    return panel.dials.mode in ("A", "S", "P") or (panel.dials.mode == "M" and panel.dials.auto_iso)


def _standing_reading(panel: Panel) -> float:
    """Return the reading for which the settings as they stand would be right [cd/m²]."""
    dials, exposure = panel.dials, panel.resolved.exposure
    lets = exposure_of(panel.settings, panel.light) * 2.0**-exposure.neutral_density_stops
    return float(dials.target * 2.0**dials.ev / lets * LUMENS_PER_WATT)


def _wanted(panel: Panel, standing: Settings, ev_change: float) -> float:
    """Return the film value per radiance that the meter asks for, before the filter takes its part.

    Without a reading, that of the settings as they stood, and the change of compensation.
    """
    dials = panel.dials
    reading = dials.locked_cd_m2 or panel.reading_cd_m2
    if reading is None:
        return float(exposure_of(standing, panel.light) * 2.0**ev_change)
    stops = dials.ev + panel.resolved.exposure.neutral_density_stops
    return float(dials.target * 2.0**stops / reading * LUMENS_PER_WATT)


def _relinked(panel: Panel, settings: Settings, standing: Settings | None = None, ev_change: float = 0.0) -> Turned:
    """Return the settings with what is free found anew, and written into the scene."""
    dials = panel.dials
    if not _follows(panel) or _is_metered_by_scene_alone(panel):
        return _written(panel, Linked(settings, 0.0, ()))
    wanted = _wanted(panel, standing or panel.settings, ev_change)
    return _written(panel, linked(dials.mode, dials.auto_iso, settings, wanted, panel.limits, panel.light))


def _is_metered_by_scene_alone(panel: Panel) -> bool:
    """Return whether the exposure is `auto` of a camera without a film: compensation is the only dial that counts."""
    return panel.without_film and panel.scene.exposure.mode == "auto" and panel.dials.mode == "A"


def _written(panel: Panel, found: Linked) -> Turned:
    """Return the changes of the scene that settings stand for, and the limits that hold them back."""
    dials, settings, scene = panel.dials, found.settings, panel.scene
    exposure = _exposure(panel, found)
    changes: dict[str, Any] = {}
    if has_opening(scene) and settings.f_number != panel.settings.f_number:
        changes["camera.f_number"] = settings.f_number
    if (exposure.mode == "physical" or dials.auto_iso) and settings.time_s != scene.shutter.time_s:
        changes["shutter.time_s"] = settings.time_s
    if exposure != scene.exposure:
        changes["exposure"] = _said(exposure)
    return Turned(replace(dials, written=exposure), changes, _words(panel, found))


def _exposure(panel: Panel, found: Linked) -> Exposure:
    """Return the exposure of a scene that stands for the state of the body."""
    dials, scene, settings = panel.dials, panel.scene, found.settings
    old = scene.exposure
    f_number = None if has_opening(scene) else settings.f_number
    if dials.mode == "relative":
        return old.model_copy(update={"ev": dials.ev})
    kept: dict[str, Any] = {"neutral_density_stops": old.neutral_density_stops, "iso": settings.iso}
    if _is_metered_by_scene_alone(panel):
        update = {
            "ev": dials.ev,
            "metering": dials.metering,
            "spot_at": dials.spot_at,
            "lock_cd_m2": dials.locked_cd_m2,
        }
        return old.model_copy(update=update)
    if f_number is not None:
        kept["f_number"] = f_number
    automatic = (dials.mode == "A" and not dials.auto_iso) or (dials.mode == "M" and dials.auto_iso)
    if automatic and not found.clamped:
        spot = {"spot_at": dials.spot_at} if dials.metering == "spot" else {}
        priority = "aperture" if dials.mode == "A" else "shutter"
        kept |= {"target": dials.target, "metering": dials.metering, "lock_cd_m2": dials.locked_cd_m2} | spot
        return Exposure.model_validate({"mode": "auto", "ev": dials.ev, "priority": priority} | kept)
    ev = dials.ev if dials.mode == "M" and not dials.auto_iso else 0.0
    return Exposure.model_validate({"mode": "physical", "ev": ev} | kept)


def _said(exposure: Exposure) -> dict[str, Any]:
    """Return an exposure as a scene file says it, without what is so by default."""
    names = [name for name in type(exposure).model_fields if name == "mode" or exposure.says(name)]
    plain = exposure.model_dump(mode="json")
    return {name: plain[name] for name in names}


def _words(panel: Panel, found: Linked) -> tuple[str, ...]:
    if not found.clamped:
        return ()
    settings = found.settings
    texts = {
        "f_number": F_NUMBERS.text(settings.f_number),
        "time_s": TIMES.text(settings.time_s),
        "iso": SPEEDS.text(settings.iso),
    }
    lens = " of the lens" if isinstance(panel.scene.camera, LensCamera) and found.clamped == ("f_number",) else ""
    ends = " and ".join(texts[name] for name in found.clamped)
    how = "bright" if found.off_ev > 0 else "dark"
    return (f"{ends} is the limit{lens}: the picture is {abs(found.off_ev):.1f} EV too {how}",)
