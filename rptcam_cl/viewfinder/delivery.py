"""What clients are sent: frames and figures of the picture, how camera and dials stand, and what has changed of it."""

from __future__ import annotations

import math
import operator
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from rptcam_cl.core import __version__
from rptcam_cl.scene.film import COOLEST, HOTTEST, NO_BALANCE, SIDES_MM, TONES
from rptcam_cl.scene.lens_settings import METHODS, Aperture, CircularAperture
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder import dials as all_dials
from rptcam_cl.viewfinder import instruments, messages
from rptcam_cl.viewfinder.background import BackgroundTask, BackgroundThread
from rptcam_cl.viewfinder.lens_panel import INFINITY_M, LensPanel, focus_scale, nearest_focus_m, perspective
from rptcam_cl.viewfinder.panel import BODIES, EV_STEPS, F_NUMBERS, KITS, SPEEDS, TIMES, Panel, ev_text
from rptcam_cl.viewfinder.slot import Shown, Slot
from rptcam_cl.viewfinder.studio import Studio
from rptcam_cl.viewfinder.things import field_at_one, fields_of, mix_entries, things_message
from rptcam_cl.viewfinder.timeline import follows_anew, time_message

# Frames of the picture, and what lies over it.

_COUNT_S = 0.2  # between two histograms of a picture that moves


class Delivery:
    """Makes frames of what slots show; only the engine's thread uses it.

    Parameters
    ----------
    hurries
        Tells whether somebody waits for another picture, so that what goes with one of full scale is left for later.
    """

    def __init__(self, hurries: Callable[[], bool]) -> None:
        self._hurries = hurries
        self._made: dict[str, tuple[int, dict[Any, Any]]] = {}  # by slot: picture, and what was made of it
        self._last_count = 0.0

    def deliver(self, slot: Slot, clients: Iterable[messages.Client]) -> bool:
        """Put what a slot shows into the outboxes of those clients that have not had it and have room; tell if any."""
        shown = slot.shown
        if shown is None:
            return False
        lacking = [each for each in clients if each.shown.get(slot.name, 0) < shown.number and each.outbox.has_room]
        for client in lacking:
            client.shown[slot.name] = shown.number
            settings = client.settings
            key = ("picture", settings.width, settings.height, settings.format, settings.quality)
            size, data = self._make_once(slot, shown, key, lambda: _picture(shown.codes, *key[1:]))  # noqa: B023 -- at once
            header = self._header(slot, shown, client, size) | {"media": messages.MEDIA[settings.format]}
            client.outbox.frame((slot.name, "picture"), (header, data))
        self.cover(slot, clients)
        return bool(lacking)

    def cover(self, slot: Slot, clients: Iterable[messages.Client]) -> None:
        """Send what lies over the picture that clients were sent, or beside it; later, where somebody waits."""
        shown = slot.shown
        if shown is None:
            return
        for client in clients:
            if client.covered.get(slot.name, 0) < shown.number == client.shown.get(slot.name):
                if not self._cover(slot, shown, client):
                    return
                client.covered[slot.name] = shown.number

    def _cover(self, slot: Slot, shown: Shown, client: messages.Client) -> bool:
        """Send all that lies over a picture; False where it was left within it."""
        settings, header = client.settings, self._header(slot, shown, client, (0, 0))
        for name in settings.overlays_on():
            if shown.frame.scale == 1 and self._hurries():
                return False
            level = {"zebra": settings.zebra_level, "peaking": settings.peaking_level}.get(name, 0.0)
            wanted = ("overlay", name, level, settings.width, settings.height)
            size, data = self._make_once(slot, shown, wanted, lambda: _overlay(shown, *wanted[1:]))  # noqa: B023 -- called at once
            client.outbox.frame((slot.name, "overlay", name), _png_frame(header, "overlay", size, data, overlay=name))
        if client.magnifier is not None and client.magnifier.place is not None and shown.frame.scale == 1:
            size, data = _magnify(shown.codes, client.magnifier)
            place = {"x": client.magnifier.x, "y": client.magnifier.y}
            client.outbox.frame((slot.name, "magnifier"), _png_frame(header, "magnifier", size, data, **place))
        return True

    def count(self, slot: Slot, clients: Iterable[messages.Client]) -> None:
        """Tell clients the histograms of the picture that they have been sent, which pages paint first."""
        shown = slot.shown
        if shown is None:
            return
        waiting = [
            client
            for client in clients
            if client.counted.get(slot.name, 0) < shown.number == client.shown.get(slot.name)
            and "histogram" in client.settings.panels
        ]
        if not waiting or not self._may_count(shown):
            return
        counts = self._make_once(slot, shown, ("histogram",), lambda: _counts(slot, shown))
        message = {"type": "histogram", "generation": shown.frame.generation, "slot": slot.name, **counts}
        for client in waiting:
            client.counted[slot.name] = shown.number
            client.outbox.news(("histogram", slot.name), message)

    def _may_count(self, shown: Shown) -> bool:
        """Return whether figures of all pixels are due: of a picture that moves, several times a second."""
        now = time.monotonic()
        if shown.moving and now < self._last_count + _COUNT_S:
            return False
        self._last_count = now
        return True

    def meter(self, slot: Slot, client: messages.Client) -> None:
        """Tell a client what lies under its pointer."""
        shown = slot.shown
        if shown is None or shown.stale or client.pointer is None or "meter" not in client.settings.panels:
            return
        reading = instruments.spot_meter(shown.frame.pixels, slot.resolved, *client.pointer)
        client.outbox.news("meter", {"type": "meter", "generation": shown.frame.generation, **reading})

    def difference(self, a: Slot, b: Slot, clients: Iterable[messages.Client]) -> None:
        """Send how far two pictures lie apart, to those that have room; pictures of other sizes or samples wait."""
        first, second = a.shown, b.shown
        if first is None or second is None or first.frame.pixels.shape != second.frame.pixels.shape:
            return
        if first.frame.spp != second.frame.spp or first.stale or second.stale:
            return
        number = first.number + second.number
        lacking = [each for each in clients if each.shown.get("difference", 0) < number and each.outbox.has_room]
        if not lacking:
            return
        stops, numbers = instruments.difference(first.frame.pixels, second.frame.pixels)
        for client in lacking:
            client.shown["difference"] = number
            size, data = _picture(
                instruments.difference_rgb(stops), client.settings.width, client.settings.height, "png", 100
            )
            header = self._header(b, second, client, size)
            frame = _png_frame(header, "difference", size, data, numbers=numbers, legend=instruments.LEGEND)
            client.outbox.frame("difference", frame)

    def _make_once(self, slot: Slot, shown: Shown, key: Any, make: Any) -> Any:
        """Make something of a picture once, for all clients with the same settings."""
        number, made = self._made.get(slot.name, (0, {}))
        if number != shown.number:
            made = {}
            self._made[slot.name] = shown.number, made
        if key not in made:
            made[key] = make()
        return made[key]

    @staticmethod
    def _header(slot: Slot, shown: Shown, client: messages.Client, size: tuple[int, ...]) -> dict[str, Any]:
        frame = shown.frame
        return {
            "type": "frame",
            "generation": frame.generation,
            "slot": slot.name,
            "kind": "picture",
            "width": size[0],
            "height": size[1],
            "full": list(slot.session.resolution),
            "scale": frame.scale,
            "spp": min(frame.spp, max(slot.session.spp, 1)),
            "target_spp": slot.target_spp,
            "ms": round(frame.seconds * 1e3, 2),
            "noise": frame.noise,
            "moving": shown.moving,
            "stale": shown.stale,
            "lacks": list(shown.lacks),
            "denoised": shown.clean is not None,
            "clean_at": slot.clean_at(frame),
            "answers": shown.answers.get(client.number),
        }


def _picture(codes: messages.Codes, width: int, height: int, form: Any, quality: int) -> tuple[tuple[int, int], bytes]:
    small = messages.shrink(codes, width, height)
    return (small.shape[1], small.shape[0]), messages.encode(small, form, quality)


def _png_frame(
    header: dict[str, Any], kind: str, size: tuple[int, int], data: bytes, **more: Any
) -> messages.FrameData:
    own = {"kind": kind, "width": size[0], "height": size[1], "media": messages.MEDIA["png"]}
    return header | own | more, data


def _overlay(
    shown: Shown, name: instruments.OverlayName, level: float, width: int, height: int
) -> tuple[tuple[int, int], bytes]:
    return _picture(instruments.OVERLAYS[name](shown.pixels, level, shown.frame.noise), width, height, "png", 100)


def _magnify(codes: messages.Codes, wanted: messages.Magnify) -> tuple[tuple[int, int], bytes]:
    assert wanted.x is not None and wanted.y is not None
    crop, _ = instruments.magnifier(codes, wanted.x, wanted.y, wanted.width, wanted.height)
    return (crop.shape[1], crop.shape[0]), messages.encode(np.ascontiguousarray(crop), "png", 100)


def _counts(slot: Slot, shown: Shown) -> dict[str, Any]:
    """Make the histograms of a picture; of the sensor's numbers once they are there, and None where there is none."""
    pixels = shown.pixels
    counts = instruments.histogram(shown.codes, pixels) | {"stops": instruments.stop_histogram(pixels)}
    if shown.raw is not None:
        return counts | {"raw": instruments.raw_histogram(shown.raw)}
    return counts | ({"raw": None} if slot.scene.sensor is None else {})


# The dials as a page draws them: name, kind, value, text, limits or steps, and whether the exposure mode sets them.

Entry = dict[str, Any]

_MODE_LABELS = {"M": "manual", "A": "aperture", "S": "shutter", "P": "program", "relative": "scene values"}
_LINKED = {"f_number": ("S", "P"), "shutter_s": ("A", "P")}
_FOCUS_STEPS = 96
_SRGB_KELVIN = 6500.0  # which leaves a picture in sRGB nearly as it is
# Correlated colour temperatures of the lights [K]; CIE 15:2018, tables of illuminants.
KELVIN = {
    "A": 2856, "D50": 5003, "D55": 5503, "D65": 6504, "D75": 7504, "E": 5455, "F2": 4230, "F7": 6500, "F11": 4000,
    "LED-B1": 2733, "LED-B2": 2998, "LED-B3": 4103, "LED-B4": 5109, "LED-B5": 6598,
}  # fmt: skip

# What photographers call lights; shade is bluer than daylight, and fluorescent lamps are those of cool white.
_PHOTOGRAPHERS = {
    NO_BALANCE: "as it is", "A": "tungsten", "F2": "fluorescent", "D55": "daylight", "D65": "overcast", "D75": "shade",
}  # fmt: skip


def dial_list(panel: Panel) -> list[Entry]:
    """Return every dial as plain values, in the order of a camera: exposure, optics, development."""
    return [*_exposure(panel), *_optics(panel), *_development(panel)]


def _entry(name: str, label: str, kind: str, value: Any, text: str, **more: Any) -> Entry:
    said = {"name": name, "label": label, "kind": kind, "value": value, "text": text}
    return said | {"enabled": True, "linked": None} | more


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
        return f"computed by exposure mode {dials.mode}" if dials.mode in _LINKED.get(name, ()) else None

    widest, narrowest = limits.f_number
    stops = [widest, *(value for value in F_NUMBERS.steps(widest, narrowest) if value > widest * 1.02)]
    fixed = widest == narrowest or panel.without_film
    return [
        _choice("mode", "exposure mode", dials.mode, _MODE_LABELS),
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
            "metering", "metering", dials.metering, {name: name.replace("_", " ") for name in all_dials.METERINGS},
            enabled=follows,
        ),
    ]  # fmt: skip


def _optics(panel: Panel) -> list[Entry]:
    scene = panel.scene
    entries = all_dials.lens_entries(scene)
    lenses = {entry.name: entry.title for entry in entries}
    own = all_dials.current_name(scene)
    if own is not None and own not in lenses:
        lenses = {own: own} | lenses
    film_format = scene.film.format
    kits = {name: f"{name.split(':')[0]}: {BODIES[body].label}, {lens}" for name, (body, lens) in KITS.items()}
    kit = next((name for name, each in KITS.items() if each == (panel.dials.body, own)), None)
    formats = {name: name.replace("_", " ") for name in SIDES_MM}
    width, height = (side * 1e3 for side in scene.film.size_m())
    size = f"{width:.4g} × {height:.4g} mm"
    return [
        _choice("lens", "lens", own, lenses if own is not None else {None: "no lens"} | lenses),
        _focus(panel),
        _zoom(panel),
        *_stop(panel),
        _choice("body", "body", panel.dials.body, {None: "any"} | {name: each.label for name, each in BODIES.items()}),
        _choice("kit", "kit", kit, {None: "none"} | kits),
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
    steps = [least / (1 - k / _FOCUS_STEPS) for k in range(_FOCUS_STEPS)] + [INFINITY_M]
    return _entry(
        "focus_m", "focus", "number", here, text, unit="m", min=least, max=INFINITY_M, steps=steps,
        scale=focus_scale(panel.view),
    )  # fmt: skip


def _zoom(panel: Panel) -> Entry:
    ends, here, kind = all_dials.zoom_range(panel), all_dials.zoomed_mm(panel), all_dials.zoom_kind(panel.scene)
    if ends is None or here is None:
        return _entry("zoom", "zoom", "number", None, "", unit="mm", enabled=False, detail=all_dials.ZOOM_TEXTS[kind])
    text = f"{here:.3g} mm"
    if kind == "crop" and here > ends[0] * (1 + 1e-9):
        text = f"{here / ends[0]:.2f}× crop"
    return _entry(
        "zoom", "zoom", "number", here, text, unit="mm", min=ends[0], max=ends[1], step=(ends[1] - ends[0]) / 100,
        enabled=ends[0] < ends[1], detail=all_dials.ZOOM_TEXTS[kind],
    )  # fmt: skip


def _stop(panel: Panel) -> list[Entry]:
    aperture: Aperture = getattr(panel.scene.camera, "aperture", CircularAperture())
    fixed = all_dials.stop_is_fixed(panel.scene)
    shapes = {shape: shape for shape in all_dials.SHAPES}
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
    words = {name: _light_words(name) for name in sorted(all_dials.BALANCES, key=_named_first)}
    if value == "own":
        words = {"own": "set by hand"} | words
    kelvin = None if balance is None else balance.temperature_k
    tables = all_dials.tables_of(panel.scene)
    tone: str = picture.tone.kind
    tones = {name: name for name in TONES}
    if picture.ocio is not None:  # until another is chosen
        tone, tones = "ocio", {"ocio": f"OpenColorIO: {picture.ocio.loaded.view}"} | tones
    return [
        _choice("white_balance", "white balance", value, words),
        _entry(
            "temperature_k", "temperature", "number", kelvin, "" if kelvin is None else f"{kelvin:.0f} K", unit="K",
            min=COOLEST, max=HOTTEST, step=50, start=KELVIN.get(value, _SRGB_KELVIN),
        ),
        _choice("tone", "tone", tone, tones),
        _choice("lut", "LUT", picture.lut, {None: "none"} | {name: name for name in tables}, enabled=bool(tables)),
    ]  # fmt: skip


def _named_first(light: str) -> tuple[bool, int, str]:
    """The order of lights to choose from: without, those that photographers name by their temperature, and the rest."""
    return light not in _PHOTOGRAPHERS, KELVIN.get(light, 0) if light in _PHOTOGRAPHERS else 0, light


def _light_words(light: str) -> str:
    kelvin = KELVIN.get(light)
    if kelvin is None:
        return "as it is" if light == NO_BALANCE else light
    rounded = f"{round(kelvin, -2 if light in _PHOTOGRAPHERS else 0)} K"
    return f"{_PHOTOGRAPHERS[light]}, {rounded} ({light})" if light in _PHOTOGRAPHERS else f"{light}, {rounded}"


# How the camera stands, as the page shows it.

MOST_CLIENTS = 4
_FOCUS = ("distance_m", "near_m", "far_m", "hyperfocal_m")


def _hello_message(studio: Studio, slot: Slot, client: int) -> dict[str, Any]:
    """The first message to a client."""
    return {
        "type": "hello",
        "version": messages.VERSION,
        "program": f"rptcam {__version__}",
        "client": client,
        "scene": studio.origin.name,
        "size": list(slot.session.resolution),
        "device": slot.session.device.info.name,
        "lenses": all_dials.lens_entries(slot.scene),
        "methods": [{"value": name, "label": name} for name in METHODS],
        "false_colour": instruments.FALSE_COLOUR,
        "limits": {
            "clients": MOST_CLIENTS,
            "message_bytes": messages.MOST_BYTES,
            "unacknowledged": messages.MOST_UNACKNOWLEDGED,
        },
        "dials": _dials_of(studio, slot),
    }


def _dials_of(studio: Studio, slot: Slot) -> list[Entry]:
    """The dials of the camera, and of the thing that is selected."""
    fields = [] if studio.selected is None else fields_of(slot.panel, studio.selected)
    mix = mix_entries(slot.panel, slot.session.light_groups)
    return [*dial_list(slot.panel), *(each.entry for each in fields), *mix]


def _left_out(slot: Slot) -> list[str]:
    """Sentences on lenses that are not offered."""
    sentences = []
    if count := all_dials.files_left_out(slot.scene):
        sentences.append(
            f"Of the files in the scene's folder {count} are not looked at for lenses (at most {all_dials.MOST_FILES})"
        )
    return sentences


def _traced_of(slot: Slot) -> tuple[Scene, ...]:
    """What its details are traced of."""
    return slot.scene, slot.resolved


def _details_of(panel: LensPanel, scene: Scene, resolved: Scene) -> dict[str, Any]:
    """Trace depth of field and image circle of a camera's state; with them, the warnings of the scene as requested."""
    numbers = panel.numbers(resolved)
    focus = {name: numbers[name] for name in _FOCUS} if numbers.get("distance_m") else None
    return {"focus": focus, "guides": panel.guides(resolved), "messages": scene.warnings}


def state_message(studio: Studio, slot: Slot, details: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return how camera, dials and comparison stand; of a camera at rest with its `_details_of`."""
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
        "wheel": all_dials.wheel(slot.scene),
        "compare": studio.compare,
        "changed": list(slot.changes),
        "paused": studio.paused,
        "denoise": studio.denoises,
        "files": [name for name in messages.FILE_MEDIA if name != "dng" or slot.scene.sensor is not None],
        "needle": all_dials.meter_needle(slot.panel),
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
        message |= details | {"messages": [*details["messages"], *message["messages"]]}
    return message


# What the engine says to clients without a request: how the camera stands, and what lies under the pointer.

_STATE_S = 0.3  # between two states of a camera that moves; finding the depth of field takes longer than a glance
_PANEL_S = 0.1  # between two traces of the rays under the pointer while it moves


class Reports:
    """Reports to clients what has changed; only the engine's thread uses it.

    Parameters
    ----------
    studio
        What the reports are about.
    delivery
        Makes the figures of the picture.
    lens
        The worker that the lens panel belongs to.
    """

    def __init__(self, studio: Studio, delivery: Delivery, lens: BackgroundThread) -> None:
        self._studio, self._delivery, self._tracing = studio, delivery, lens
        self._reported: tuple[Any, ...] = ()
        self._details: tuple[tuple[Scene | None, ...], dict[str, Any]] = (None, None), {}  # the last, and of what
        self._is_prepared = False
        self._last_panel = self._last_state = 0.0

    def inform(self, clients: list[messages.Client]) -> None:
        """Tell clients how the camera stands, where that has changed, and what lies under their pointers."""
        slot = self._studio.a
        if slot is not None:
            self._state(slot, clients)
            self._point(slot, clients)
        for each in self._studio.slots:
            self._delivery.cover(each, clients)
            self._delivery.count(each, clients)

    def _state(self, slot: Slot, clients: list[messages.Client]) -> None:
        resting = slot.rests_in() <= 0
        if not resting and time.monotonic() < self._last_state + _STATE_S:
            return
        answers = tuple((client.number, client.answers) for client in clients)
        studio = self._studio
        here = (slot.session.generation, slot.dials, slot.messages, studio.recorder.is_on, studio.selected)
        reported = (*here, studio.paused, studio.denoises, resting, *self._compare_state(), answers)
        if reported != self._reported and not slot.wants_glance:
            self._reported, self._last_state = reported, time.monotonic()
            of, details = self._details
            known = details if all(map(operator.is_, of, _traced_of(slot))) else None
            message = state_message(self._studio, slot, known)
            for client in clients:
                client.outbox.news("state", message | {"answers": client.answers})
            if resting and known is None:
                self._trace_details(slot, clients)

    def _trace_details(self, slot: Slot, clients: list[messages.Client]) -> None:
        """Say what has to be traced of the camera once that is done."""
        panel, of = self._studio.panel, _traced_of(slot)
        if panel is None:
            return

        def done(details: dict[str, Any]) -> None:  # sent between two pictures, and not before one that is waited for
            self._details, self._reported = (of, details), ()

        self._tracing.start(
            BackgroundTask("lens panel", lambda task: _details_of(panel, *of), done, key=("details", len(clients) > 0))
        )

    def prepare(self) -> None:
        """Find what the first client will want to know, while it is still on its way."""
        studio = self._studio
        if studio.a is not None and not self._is_prepared:
            self._is_prepared = True
            _hello_message(studio, studio.a, 0)
            state_message(studio, studio.a)
            self._trace_details(studio.a, [])

    def greet(self, client: messages.Client) -> None:
        """Tell a new client what there is and how the camera stands."""
        studio = self._studio
        if studio.a is None or client.was_greeted:
            return
        token = {} if client.token is None else {"token": client.token}
        client.outbox.answer(_hello_message(studio, studio.a, client.number) | token)
        client.outbox.news("state", state_message(studio, studio.a))
        self._reported = ()  # it hears the details as soon as they are traced
        client.was_greeted = studio.was_seen = True
        if studio.file_error is not None:
            client.outbox.answer(studio.file_error)

    def _compare_state(self) -> tuple[Any, ...]:
        compare = self._studio.compare
        return (compare["mode"], compare["model"], repr(compare["changes"]), compare["difference"])

    def _point(self, slot: Slot, clients: list[messages.Client]) -> None:
        """Meter and trace at the pointers that have moved, or under which the picture has changed."""
        shown = slot.shown
        for client in clients:
            place = (client.pointer, None if shown is None else shown.number)
            if place != client.pointed_at:
                self._delivery.meter(slot, client)
                self._lens(slot, client)
                client.pointed_at = place

    def _lens(self, slot: Slot, client: messages.Client) -> None:
        panel, resolved, pointer = self._studio.panel, slot.resolved, client.pointer
        if panel is None or "lens" not in client.settings.panels:
            return
        at = (pointer, slot.session.generation)
        now = time.monotonic()
        if at == client.lens_at or (slot.rests_in() > 0 and now - self._last_panel < _PANEL_S):
            return
        self._last_panel = now
        is_known = client.lens_shown == at[1]

        def trace(task: BackgroundTask) -> dict[str, Any]:
            own = {} if is_known else {"section": panel.section(resolved), "numbers": panel.numbers(resolved)}
            rays = None if pointer is None else panel.pointer(resolved, *pointer)
            return {"type": "lens", "generation": at[1], "pointer": rays} | own

        def done(message: dict[str, Any]) -> None:
            if "section" in message:
                client.lens_shown = at[1]
            client.outbox.news("lens" if "section" not in message else "lens with section", message)

        client.lens_at = at
        self._tracing.start(BackgroundTask("lens panel", trace, done, key=("lens", client.number)))
