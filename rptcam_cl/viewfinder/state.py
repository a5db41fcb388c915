"""How the camera stands and its dials look, as the page shows them."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from typing import Any

from rptcam_cl.core.constants import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.film import COOLEST, HOTTEST, NO_BALANCE, SIDES_MM, TONES
from rptcam_cl.scene.lens_settings import METHODS, Aperture, CircularAperture
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.dials import (
    BALANCES,
    METERINGS,
    MOST_FILES,
    SHAPES,
    ZOOM_TEXTS,
    current_name,
    files_left_out,
    lens_entries,
    meter_needle,
    stop_is_fixed,
    wheel,
    zoom_kind,
    zoom_range,
    zoomed_mm,
)
from rptcam_cl.viewfinder.instruments import false_colour_legend
from rptcam_cl.viewfinder.lens_panel import INFINITY_M, LensPanel, focus_scale, nearest_focus_m, perspective
from rptcam_cl.viewfinder.messages import FILE_MEDIA, MOST_BYTES, MOST_UNACKNOWLEDGED, VERSION, encode, shrink
from rptcam_cl.viewfinder.moves import field_at_one
from rptcam_cl.viewfinder.panel import EV_STEPS, F_NUMBERS, SPEEDS, TIMES, Dials, Panel, ev_text
from rptcam_cl.viewfinder.studio import Slot, Studio, changes_between
from rptcam_cl.viewfinder.things import fields_of, things_message
from rptcam_cl.viewfinder.timeline import follows_anew, time_message

# The dials as a page draws them: name, kind, value, text, limits or steps, and whether the exposure mode sets them.

Entry = dict[str, Any]

MODE_LABELS = {"M": "manual", "A": "aperture", "S": "shutter", "P": "program", "relative": "scene values"}
LINKED = {
    "f_number": ("S", "P"),
    "shutter_s": ("A", "P"),
}
FOCUS_STEPS = 96
SRGB_KELVIN = 6500.0  # which leaves a picture in sRGB nearly as it is
# Correlated colour temperatures of the lights [K]; CIE 15:2018, tables of illuminants.
KELVIN = {
    "A": 2856, "D50": 5003, "D55": 5503, "D65": 6504, "D75": 7504, "E": 5455, "F2": 4230, "F7": 6500, "F11": 4000,
    "LED-B1": 2733, "LED-B2": 2998, "LED-B3": 4103, "LED-B4": 5109, "LED-B5": 6598,
}  # fmt: skip

# What photographers call lights; shade is bluer than daylight, and fluorescent lamps are those of cool white.
PHOTOGRAPHERS = {
    NO_BALANCE: "as it is", "A": "tungsten", "F2": "fluorescent", "D55": "daylight", "D65": "overcast", "D75": "shade",
}  # fmt: skip


def dial_list(panel: Panel) -> list[Entry]:
    """Return every dial as plain values, in the order of a camera: exposure, optics, development."""
    return [*_exposure(panel), *_optics(panel), *_development(panel)]


def _entry(name: str, label: str, kind: str, value: Any, text: str, **more: Any) -> Entry:
    return {
        "name": name,
        "label": label,
        "kind": kind,
        "value": value,
        "text": text,
        "enabled": True,
        "linked": None,
    } | (more)


def _choice(name: str, label: str, value: Any, choices: dict[Any, str], **more: Any) -> Entry:
    listed = [{"value": key, "label": words} for key, words in choices.items()]
    return _entry(name, label, "choice", value, choices.get(value, str(value)), choices=listed, **more)


def _exposure(panel: Panel) -> list[Entry]:
    dials, settings, limits = panel.dials, panel.settings, panel.limits
    exposes = dials.mode != "relative" and not (panel.without_film and dials.written.mode == "auto")
    follows = dials.mode in ("A", "S", "P") or dials.auto_iso

    def linked(name: str, by_iso: bool = False) -> str | None:
        if by_iso and dials.auto_iso:
            return "computed by automatic ISO"
        return f"computed by exposure mode {dials.mode}" if dials.mode in LINKED.get(name, ()) else None

    widest, narrowest = limits.f_number
    stops = [widest, *(value for value in F_NUMBERS.steps(widest, narrowest) if value > widest * 1.02)]
    fixed = widest == narrowest or panel.without_film
    return [
        _choice("mode", "exposure mode", dials.mode, MODE_LABELS),
        _entry(
            "f_number", "f-number", "number", settings.f_number, F_NUMBERS.text(settings.f_number), unit="",
            min=widest, max=narrowest, steps=stops, linked=linked("f_number"),
            enabled=not fixed and linked("f_number") is None,
        ),
        _entry(
            "shutter_s", "shutter", "number", settings.time_s, TIMES.text(settings.time_s), unit="s",
            min=limits.time_s[0], max=limits.time_s[1], steps=TIMES.steps(*limits.time_s),
            linked=linked("shutter_s"), enabled=linked("shutter_s") is None,
        ),
        _entry(
            "iso", "ISO", "number", settings.iso, SPEEDS.text(settings.iso), unit="", min=limits.iso[0],
            max=limits.iso[1], steps=SPEEDS.steps(*limits.iso), linked=linked("iso", by_iso=True),
            enabled=exposes and not dials.auto_iso,
        ),
        _entry("auto_iso", "automatic ISO", "bool", dials.auto_iso, "on" if dials.auto_iso else "off", enabled=exposes),
        _entry(
            "ev", "compensation", "number", dials.ev, ev_text(dials.ev), unit="EV", min=EV_STEPS[0], max=EV_STEPS[-1],
            steps=EV_STEPS,
        ),
        _entry(
            "lock", "exposure lock", "bool", dials.locked_cd_m2 is not None,
            "" if dials.locked_cd_m2 is None else f"{dials.locked_cd_m2:.3g} cd/m²", enabled=follows,
        ),
        _choice(
            "metering", "metering", dials.metering, {name: name.replace("_", " ") for name in METERINGS},
            enabled=follows,
        ),
    ]  # fmt: skip


def _optics(panel: Panel) -> list[Entry]:
    scene = panel.scene
    entries = lens_entries(scene)
    lenses = {entry.name: entry.title for entry in entries}
    own = current_name(scene)
    if own is not None and own not in lenses:
        lenses = {own: own} | lenses
    film_format = scene.film.format
    formats = {name: name.replace("_", " ") for name in SIDES_MM}
    width, height = (side * 1e3 for side in scene.film.size_m())
    size = f"{width:.4g} × {height:.4g} mm"
    return [
        _choice("lens", "lens", own, lenses if own is not None else {None: "no lens"} | lenses),
        _focus(panel),
        _zoom(panel),
        *_stop(panel),
        _choice("format", "film", film_format, ({} if film_format else {None: size}) | formats, detail=size),
    ]  # fmt: skip


def _focus(panel: Panel) -> Entry:
    camera = panel.scene.camera
    if not camera.focuses:
        return _entry("focus_m", "focus", "number", None, "everything", unit="m", enabled=False)
    view, nearest = perspective(panel.view), nearest_focus_m(panel.view)
    here = None if view is None else min(view.focus_mm * 1e-3, INFINITY_M)
    text = "nowhere" if here is None else "∞" if here >= INFINITY_M / 10 else f"{here:.3g} m"
    least = nearest or 0.01
    steps = [least / (1 - k / FOCUS_STEPS) for k in range(FOCUS_STEPS)] + [INFINITY_M]
    return _entry(
        "focus_m", "focus", "number", here, text, unit="m", min=least, max=INFINITY_M, steps=steps,
        scale=focus_scale(panel.view),
    )  # fmt: skip


def _zoom(panel: Panel) -> Entry:
    ends, here, kind = zoom_range(panel), zoomed_mm(panel), zoom_kind(panel.scene)
    if ends is None or here is None:
        return _entry("zoom", "zoom", "number", None, "", unit="mm", enabled=False, detail=ZOOM_TEXTS[kind])
    text = f"{here:.3g} mm"
    if kind == "crop" and here > ends[0] * (1 + 1e-9):
        text = f"{here / ends[0]:.2f}× crop"
    return _entry(
        "zoom", "zoom", "number", here, text, unit="mm", min=ends[0], max=ends[1], step=(ends[1] - ends[0]) / 100,
        enabled=ends[0] < ends[1], detail=ZOOM_TEXTS[kind],
    )  # fmt: skip


def _stop(panel: Panel) -> list[Entry]:
    aperture: Aperture = getattr(panel.scene.camera, "aperture", CircularAperture())
    fixed = stop_is_fixed(panel.scene)
    shapes = {shape: shape for shape in SHAPES}
    blades = getattr(aperture, "blades", 0)
    return [
        _choice(
            "stop", "stop", aperture.shape, shapes | {aperture.shape: aperture.shape}, enabled=fixed is None,
            detail=fixed,
        ),
        _entry(
            "blades", "blades", "number", blades, str(blades) if blades else "round", unit="", min=0, max=16,
            steps=[0, *range(3, 17)], enabled=fixed is None,
        ),
    ]  # fmt: skip


def _development(panel: Panel) -> list[Entry]:
    picture = panel.scene.picture
    balance = picture.white_balance
    value: str = "none" if balance is None else balance.light or "own"
    words = {name: _light_words(name) for name in sorted(BALANCES, key=_named_first)}
    if value == "own":
        words = {"own": "set by hand"} | words
    kelvin = None if balance is None else balance.temperature_k
    return [
        _choice("white_balance", "white balance", value, words),
        _entry(
            "temperature_k", "temperature", "number", kelvin, "" if kelvin is None else f"{kelvin:.0f} K", unit="K",
            min=COOLEST, max=HOTTEST, step=50, start=KELVIN.get(value, SRGB_KELVIN),
        ),
        _choice("tone", "tone", picture.tone.kind, {name: name for name in TONES}),
    ]  # fmt: skip


def _named_first(light: str) -> tuple[bool, int, str]:
    """The order of lights to choose from: without, those that photographers name by their temperature, and the rest."""
    return light not in PHOTOGRAPHERS, KELVIN.get(light, 0) if light in PHOTOGRAPHERS else 0, light


def _light_words(light: str) -> str:
    kelvin = KELVIN.get(light)
    if kelvin is None:
        return "as it is" if light == NO_BALANCE else light
    rounded = f"{round(kelvin, -2 if light in PHOTOGRAPHERS else 0)} K"
    return f"{PHOTOGRAPHERS[light]}, {rounded} ({light})" if light in PHOTOGRAPHERS else f"{light}, {rounded}"


# How the camera stands, as the page shows it.

MOST_CLIENTS = 4
_FOCUS = ("distance_m", "near_m", "far_m", "hyperfocal_m")


def hello_message(studio: Studio, slot: Slot, client: int) -> dict[str, Any]:
    """The first message to a client."""
    return {
        "type": "hello",
        "version": VERSION,
        "program": f"rptcam {__version__}",
        "client": client,
        "scene": studio.origin.name,
        "size": list(slot.session.resolution),
        "device": slot.session.device.info.name,
        "lenses": [entry.as_dict() for entry in lens_entries(slot.scene)],
        "methods": [{"value": name, "label": name} for name in METHODS],
        "false_colour": false_colour_legend(),
        "limits": {"clients": MOST_CLIENTS, "message_bytes": MOST_BYTES, "unacknowledged": MOST_UNACKNOWLEDGED},
        "dials": _dials_of(studio, slot),
    }


def _dials_of(studio: Studio, slot: Slot) -> list[Entry]:
    """The dials of the camera, and of the thing that is selected."""
    fields = [] if studio.selected is None else fields_of(slot.panel, studio.selected)
    return [*dial_list(slot.panel), *(each.entry for each in fields)]


def _left_out(slot: Slot) -> list[str]:
    """Sentences on lenses that are not offered."""
    sentences = []
    if count := files_left_out(slot.scene):
        sentences.append(
            f"Of the files in the scene's folder {count} are not looked at for lenses (at most {MOST_FILES})"
        )
    return sentences


def details_of(panel: LensPanel, resolved: Scene) -> dict[str, Any]:
    """Trace depth of field and image circle of a camera's state."""
    numbers = panel.numbers(resolved)
    focus = {name: numbers[name] for name in _FOCUS} if numbers.get("distance_m") else None
    return {"focus": focus, "guides": panel.guides(resolved)}


def state_message(studio: Studio, slot: Slot, details: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return how camera, dials and comparison stand; of a camera at rest with its `details_of`."""
    camera, lens = slot.scene.camera, slot.scene.camera.lens_camera
    message: dict[str, Any] = {
        "type": "state",
        "generation": slot.session.generation,
        "dials": _dials_of(studio, slot),
        "camera": {
            "kind": camera.kind,
            "lens": lens.design if lens is not None and isinstance(lens.design, str) else None,
            "eye": list(camera.eye),
            "target": list(camera.target),
            "up": list(camera.up),
            "across_degrees": math.degrees(2 * math.atan(field_at_one(slot.resolved) / 2)),
        },
        "wheel": wheel(slot.scene),
        "compare": studio.compare,
        "changed": list(slot.changes),
        "paused": studio.paused,
        "denoise": studio.denoises,
        "files": [name for name in FILE_MEDIA if name != "dng" or slot.scene.sensor is not None],
        "needle": meter_needle(slot.panel),
        "time": time_message(slot.panel, studio.recorder),
        "things": things_message(slot.panel, studio.selected),
        "messages": [
            *slot.messages,
            *_left_out(slot),
            *follows_anew(slot.panel),
            *(studio.b.messages if studio.b is not None else ()),
        ],
    }
    if studio.b is not None:
        message["dials_b"] = dial_list(studio.b.panel)
    if details is not None:
        message["messages"] = [*slot.scene.warnings, *message["messages"]]
        message |= details
    return message


# The states that were, to go back to: undo, redo, snapshots.

MOST_STATES = 60
MOST_SNAPSHOTS = 12
THUMB = (128, 72)  # pixels, at most


@dataclass(eq=False)
class Past:
    """A state that was.

    Attributes
    ----------
    number : int
    label : str
        What led to it.
    scene, changes, dials, compare
        As of the slot A and the studio then.
    thumb : str or None
        Its picture, a JPEG in base64.
    thumb_scale : float
        Share of the full resolution that was made of.
    """

    number: int
    label: str
    scene: Scene
    changes: Mapping[str, Any]
    dials: Dials
    compare: Mapping[str, Any]
    thumb: str | None = None
    thumb_scale: float = 0.0

    def is_now(self, studio: Studio, slot: Slot) -> bool:
        """Whether it is what is shown."""
        return (self.changes, self.dials, self.compare) == (slot.changes, slot.dials, studio.compare)


class History:
    """The states of the slot A, in order, and the snapshots among them. Only the engine's thread uses it.

    Parameters
    ----------
    studio
        Whose states they are.
    """

    def __init__(self, studio: Studio) -> None:
        self._studio = studio
        self._states: list[Past] = []
        self._at = -1
        self.snapshots: list[Past] = []
        self._number = 0
        self.version = 0  # counts what clients have to hear

    def clear(self) -> None:
        """Forget the states: the file is another. Snapshots stay."""
        self._states, self._at = [], -1

    def note(self, *, acted: bool) -> bool:
        """Note the state that is shown, where it is another; return whether a hand has led to it.

        Parameters
        ----------
        acted
            Whether somebody did something since the last time; otherwise the camera has followed the light by itself.
        """
        slot, studio = self._studio.a, self._studio
        if slot is None or slot.rests_in() > 0:
            return False
        here = self._states[self._at] if self._states else None
        if here is not None and here.is_now(studio, slot):
            self._picture(here, slot)
            return False
        label = "as in the file" if here is None else _label(here, slot, studio)
        self.version += 1
        if here is not None and not acted:
            here.changes, here.dials, here.scene, here.compare = slot.changes, slot.dials, slot.scene, studio.compare
            return False
        self._number += 1
        past = Past(self._number, label, slot.scene, slot.changes, slot.dials, studio.compare)
        self._states = [*self._states[: self._at + 1], past][-MOST_STATES:]
        self._at = len(self._states) - 1
        return True

    def _picture(self, here: Past, slot: Slot) -> None:
        shown = slot.shown
        if shown is None or shown.stale or shown.frame.scale <= here.thumb_scale:
            return
        if shown.frame.generation == slot.session.generation:
            here.thumb = base64.b64encode(encode(shrink(shown.codes[..., :3], *THUMB), "jpeg", 70)).decode()
            here.thumb_scale = shown.frame.scale
            self.version += 1

    def step(self, by: int) -> None:
        """Go back or forward so many states.

        Raises
        ------
        InputError
            There are none.
        """
        if not 0 <= self._at + by < len(self._states):
            raise InputError(f"history: there is nothing to {'undo' if by < 0 else 'do again'}")
        self._go(self._states[self._at + by])
        self._at += by

    def go(self, number: int) -> None:
        """Go to a state or a snapshot; a snapshot becomes the newest state.

        Raises
        ------
        InputError
            There is none of the number, or it cannot be shown any more.
        """
        past = self._find(number)
        self._go(past)
        if past in self._states:
            self._at = self._states.index(past)
        self.version += 1

    def snap(self) -> None:
        """Keep the state that is shown."""
        here = self._states[self._at] if self._states else None
        if here is not None and here not in self.snapshots:
            self.snapshots = [*self.snapshots, here][-MOST_SNAPSHOTS:]
            self.version += 1

    def drop(self, number: int) -> None:
        """Keep a snapshot no longer."""
        self.snapshots = [each for each in self.snapshots if each.number != number]
        self.version += 1

    def compare(self, number: int) -> None:
        """Show a state as B, under a wipe.

        Raises
        ------
        InputError
            There is none of the number, or it cannot be shown any more.
        """
        slot = self._studio.slot("A")
        keys = changes_between(slot.scene, self._find(number).scene)
        self._studio.set_compare({"mode": "wipe", "model": None, "changes": keys, "difference": False})

    def _find(self, number: int) -> Past:
        for each in (*self._states, *self.snapshots):
            if each.number == number:
                return each
        raise InputError(f"history: there is no state {number}")

    def _go(self, past: Past) -> None:
        studio = self._studio
        slot = studio.slot("A")
        keys = changes_between(slot.scene, past.scene)
        if keys:
            studio.change("A", keys, dials=past.dials)
        slot.changes, slot.dials = past.changes, past.dials
        if studio.compare != past.compare:
            studio.set_compare(past.compare)
        slot.follows_light = False
        self.version += 1

    def message(self) -> dict[str, Any]:
        """What clients hear of it."""
        return {
            "type": "history",
            "states": [{"number": each.number, "label": each.label} for each in self._states],
            "at": self._states[self._at].number if self._states else None,
            "snapshots": [{"number": each.number, "label": each.label} for each in self.snapshots],
        }

    def thumbs(self) -> dict[int, str]:
        """The pictures of states and snapshots, by number."""
        return {each.number: each.thumb for each in (*self._states, *self.snapshots) if each.thumb is not None}


def _label(before: Past, slot: Slot, studio: Studio) -> str:
    """What leads from a state to the one that is shown, in words."""
    keys = [key for key in {**before.changes, **slot.changes} if before.changes.get(key) != slot.changes.get(key)]
    names = list(dict.fromkeys(key.split(".")[-1].replace("_", " ") for key in keys))
    if {"eye", "target", "up"} & set(names):
        names = ["camera", *(name for name in names if name not in ("eye", "target", "up"))]
    if len(names) > 1:  # keys beside what they are of, and the frame
        names = [name for name in names if name not in ("sequence", "open s", "motion")] or ["keys"]
    names = ["keys" if name in ("sequence", "motion") else "frame" if name == "open s" else name for name in names]
    if studio.compare != before.compare:
        names.append("comparison")
    if not names:
        names = ["exposure mode"]
    return ", ".join(names[:3])
