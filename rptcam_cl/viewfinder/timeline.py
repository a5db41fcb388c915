"""Time in the viewfinder: frames of a scene's sequence, keys that a hand sets, and what it records while they play."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.exposure import MOST_FRAMES, FrameSequence, value_at
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.dials import as_paths, turn_focus, zoom_kind, zoom_range, zoomed_mm
from rptcam_cl.viewfinder.lens_panel import nearest_focus_m, perspective
from rptcam_cl.viewfinder.panel import Clock, Panel, f_number_of_camera, f_numbers, film_mm

# What may be keyed by name, and the key paths of the scene that it is. Poses are keyframes of `camera.motion`, as what
# moves blurs; all else are keys of `sequence`, which hold still within a frame (docs/motion.md).

POSE = ("camera.eye", "camera.target", "camera.up")
CHANNELS: dict[str, tuple[str, tuple[str, ...]]] = {
    "camera": ("Camera", POSE),
    "focus": ("Focus", ("camera.focus.distance_m", "camera.focus_distance_m")),
    "f_number": ("f-number", ("camera.f_number",)),
    "zoom": ("Zoom", ("camera.focal_length_mm", "camera.fov_degrees", "camera.width_m", "film.size_mm")),
    "exposure": ("Exposure", ("exposure.ev", "exposure.iso", "shutter.time_s")),
}
_RECORDED = {path for _, paths in CHANNELS.values() for path in paths}
_DIFFERENCES = ("exposure.ev",)  # what is moved by its difference; all else that is above 0 by its ratio
Keys = dict[str, list[dict[str, Any]]]
"""Keyframes as a scene file has them, by key path."""


def sequence_of(scene: Scene) -> FrameSequence:
    """The sequence of a scene, or that of scenes without one."""
    return scene.sequence or FrameSequence()


def _time_of(scene: Scene, clock: Clock) -> float:
    """When the shutter of the frame that is shown opens [s]."""
    return sequence_of(scene).open_s(clock.first_s, max(clock.frame, 1))


def at_frame(scene: Scene, clock: Clock, frame: int) -> tuple[dict[str, Any], Clock]:
    """Return the changes that show a frame as ``rptcam render --frames`` renders it, and the clock then.

    Raises
    ------
    InputError
        There cannot be such a frame.
    """
    changes = sequence_of(scene).changes(clock.first_s, frame)
    del changes["sequence"]
    return changes, replace(clock, frame=frame, frames=max(clock.frames, frame))


def as_file(scene: Scene, clock: Clock) -> Scene:
    """Return a scene as it is saved: as it stands in its first frame."""
    if clock.frame <= 1:
        return scene
    changes, _ = at_frame(scene, clock, 1)
    if not clock.first_s:  # as where nothing says when the shutter opens
        gone = "shutter" if set(scene.made_of.get("shutter") or ()) <= {"open_s"} else "shutter.open_s"
        changes = {key: value for key, value in changes.items() if key != "shutter.open_s"} | {gone: None}
    return set_keys(scene, changes)


def overlaid(scene: Scene) -> set[str]:
    """The key paths that go by the frame."""
    return {"shutter.open_s", *sequence_of(scene).keys}


# Changes by hand of what has keys: they set a key, or carry all keys along.


class Recorder:
    """Makes changes of keys out of those of values; only the engine's thread uses it.

    Attributes
    ----------
    is_on : bool
        Whether what is turned sets keys in the frame that is shown; otherwise it carries all keys along.
    is_playing : bool
        Whether frames follow one another; what is held then is recorded in each.
    """

    def __init__(self) -> None:
        self.is_on = self.is_playing = False
        self._held: set[str] = set()  # key paths that a hand holds while it plays

    def rewrite(self, panel: Panel, changes: Mapping[str, Any], *, transient: bool) -> dict[str, Any]:
        """Return changes of a scene with those of its keys that belong to them."""
        scene, flat = panel.scene, _leaves(changes)
        if scene.sequence is None and not scene.camera.motion and not self.is_on:
            return dict(changes)
        keys = _keys_of(scene)
        before = {name: list(frames) for name, frames in keys.items()}
        stays: dict[str, Any] = {}  # keys of the exposure, which dials write as a whole
        for path in [each for each in keys if each not in flat and _is_replaced(each, changes)]:
            if path.startswith("camera."):  # another lens, or another way to focus
                del keys[path]
            else:
                stays[path] = value_at(sequence_of(scene).keys[path], _time_of(scene, panel.dials.clock))
        for path, value in flat.items():
            if path in keys or (self.is_on and path in _RECORDED and path not in POSE):
                self._set(panel, keys, path, value, transient)
        self._held = self._held & set(keys) if transient else self._held - set(flat)
        found = _without_pose(changes) | stays | self._pose(panel, flat)
        return found if keys == before else found | _written(scene, keys)

    def _set(self, panel: Panel, keys: Keys, path: str, value: Any, transient: bool) -> None:
        if value is None:
            keys.pop(path, None)
            return
        scene, clock = panel.scene, panel.dials.clock
        now = _time_of(scene, clock)
        if not self.is_on:
            old = value_at(sequence_of(scene).keys[path], now)
            keys[path] = [each | {"value": _carry(panel, path, each["value"], old, value)} for each in keys[path]]
            return
        if path not in keys and value == _stood(panel, path):
            return
        if (self.is_playing and path not in self._held) or path not in keys:
            self._begin(panel, keys, path)
        keys[path] = _put(keys[path], now, value)
        if self.is_playing and transient:
            self._held.add(path)

    def _begin(self, panel: Panel, keys: Keys, path: str) -> None:
        """Keep what was there before a key: up to the frame before while it plays, else from the first frame on."""
        scene, clock = panel.scene, panel.dials.clock
        if clock.frame <= 1:
            keys.setdefault(path, [])
            return
        sequence = sequence_of(scene)
        begin_s = sequence.open_s(clock.first_s, clock.frame - 1 if self.is_playing else 1)
        if path in keys:
            keys[path] = _put(keys[path], begin_s, value_at(sequence.keys[path], begin_s))
        else:
            stood = _stood(panel, path)
            keys[path] = [] if stood is None else [{"time_s": begin_s, "value": stood}]

    def _pose(self, panel: Panel, flat: Mapping[str, Any]) -> dict[str, Any]:
        """Return the changes of the camera's place, and of its keyframes."""
        scene, clock = panel.scene, panel.dials.clock
        new = {path.split(".")[1]: flat[path] for path in POSE if flat.get(path) is not None}
        plain = {f"camera.{name}": value for name, value in new.items()}
        if not new or not (scene.camera.motion or self.is_on):
            return plain
        now = _time_of(scene, clock)
        here = dict(zip(("eye", "target", "up"), scene.camera.pose_at(now).tolist(), strict=True))
        frames = _motion_of(scene)
        if self.is_on:
            if not frames and clock.frame > 1:
                frames = [{"time_s": sequence_of(scene).open_s(clock.first_s, 1), **here}]
            return {"camera.motion": _put(frames, now, here | new)}
        shifts = {name: np.subtract(value, here[name]) for name, value in new.items()}
        own = {f"camera.{name}": (np.array(getattr(scene.camera, name)) + by).tolist() for name, by in shifts.items()}
        for frame in frames:
            frame |= {name: (np.array(frame[name]) + by).tolist() for name, by in shifts.items() if name in frame}
        return own | {"camera.motion": frames}

    def go(self, panel: Panel, frame: int) -> tuple[dict[str, Any], Clock]:
        """Return the changes that show another frame, in which what is held stays as it is, and the clock then."""
        scene, clock = panel.scene, panel.dials.clock
        changes, later = at_frame(scene, clock, frame)
        if not (self._held and self.is_on and self.is_playing and frame > clock.frame):
            self._held = set()
            return changes, later
        begin_s, end_s, keys = _time_of(scene, clock), _time_of(scene, later), _keys_of(scene)
        for path in self._held & set(keys):
            value = value_at(sequence_of(scene).keys[path], begin_s)
            left = [each for each in keys[path] if not begin_s < each["time_s"] < end_s]
            keys[path], changes[path] = _put(left, end_s, value), value
        return changes | _written(scene, keys), later


def is_keyed(scene: Scene, name: str) -> bool:
    """Whether something has keys."""
    return any(path in sequence_of(scene).keys for path in CHANNELS[name][1])


def key_changes(panel: Panel, name: str, do: str) -> dict[str, Any]:
    """Return the changes that set a key here (``key``), delete it (``unkey``), or all of its kind (``clear``).

    Raises
    ------
    InputError
        There is nothing to key, or no key here.
    """
    scene, now = panel.scene, _time_of(panel.scene, panel.dials.clock)
    label, paths = CHANNELS[name]
    if name == "camera":
        frames = _motion_of(scene)
        here = dict(zip(("eye", "target", "up"), scene.camera.pose_at(now).tolist(), strict=True))
        if do == "key":
            return {"camera.motion": _put(frames, now, here)}
        left = [] if do == "clear" else _remove_key(frames, now, label)
        stays = {} if left else {f"camera.{key}": value for key, value in here.items()}
        return stays | {"camera.motion": left or None}
    keys = _keys_of(scene)
    if do == "key":
        values = _values_now(panel, name)
        for path, value in values.items():
            keys[path] = _put(keys.get(path, []), now, value)
        return values | _written(scene, keys)
    own = [path for path in paths if path in keys]
    if not own:
        raise InputError(f"{label}: has no keys to delete")
    stays = {path: value_at(sequence_of(scene).keys[path], now) for path in own}
    for path in own:
        left = [] if do == "clear" else _remove_key(keys[path], now, label)
        if left:
            keys[path] = left
            stays[path] = value_at(_sequence_of_keys(keys)[path], now)
        else:
            del keys[path]
    return stays | _written(scene, keys)


def rack_changes(panel: Panel, from_m: float, to_m: float, seconds: float) -> tuple[dict[str, Any], Clock]:
    """Return the changes that pull the focus from one distance to another [m], beginning in the frame that is shown.

    It eases in and out (3 s² - 2 s³) and is even in 1 / distance, as the scale of a lens is.

    Raises
    ------
    InputError
        The camera has no focus.
    """
    scene, clock = panel.scene, panel.dials.clock
    _values_now(panel, "focus")  # refuses where there is none
    sequence, first = sequence_of(scene), max(clock.frame, 1)
    count = min(max(round(seconds * sequence.frames_per_second), 1), MOST_FRAMES - first)
    flat = [_focus_at(panel, metres) for metres in (from_m, to_m)]
    path = next(iter(flat[0]))
    near, far = (1 / each[path] for each in flat)
    moments = [sequence.open_s(clock.first_s, first + step) for step in range(count + 1)]
    shares = [(3 - 2 * step / count) * (step / count) ** 2 for step in range(count + 1)]
    pulled = [
        {"time_s": t, "value": 1 / (near + share * (far - near))} for t, share in zip(moments, shares, strict=True)
    ]
    keys = _keys_of(scene)
    before = [each for each in keys.get(path, []) if each["time_s"] < moments[0]]
    after = [each for each in keys.get(path, []) if each["time_s"] > moments[-1]]
    keys[path] = [*before, *pulled, *after]
    return {path: pulled[0]["value"]} | _written(scene, keys), replace(clock, frames=max(clock.frames, first + count))


def _values_now(panel: Panel, name: str) -> dict[str, Any]:
    """Return the values of what may be keyed, by key path, as they stand.

    Raises
    ------
    InputError
        The camera does not have it.
    """
    scene = panel.scene
    found: Mapping[str, Any] | None = None
    if name == "focus":
        given = getattr(getattr(scene.camera, "focus", None), "distance_m", None)
        view = perspective(panel.view)
        metres = (
            given or getattr(scene.camera, "focus_distance_m", None) or (None if view is None else view.focus_mm / 1e3)
        )
        found = (
            _focus_at(panel, metres) if scene.camera.focuses and metres is not None and math.isfinite(metres) else None
        )
    elif name == "f_number":
        f_number = f_number_of_camera(panel.view)
        found = None if f_number is None else as_paths(scene.camera.f_number_keys(f_number) or {})
    elif name == "zoom":
        found = _zoom_now(panel)
    elif name == "exposure":
        found = {"exposure.ev": scene.exposure.ev}
        if scene.exposure.mode == "physical":
            found |= {"exposure.iso": scene.exposure.iso, "shutter.time_s": scene.shutter.time_s}
    if not found:
        raise InputError(f"{CHANNELS[name][0]}: this camera has none to set keys of")
    return {path: value for path, value in found.items() if value is not None}


def _stood(panel: Panel, path: str) -> Any:
    """The value of a key path that is recorded, before a change; None where the camera has none."""
    name = next(name for name, (_, paths) in CHANNELS.items() if path in paths)
    return _values_now(panel, name).get(path)


def _focus_at(panel: Panel, metres: float) -> dict[str, Any]:
    flat = _leaves(turn_focus(panel, metres).changes)
    return {path: value for path, value in flat.items() if path in CHANNELS["focus"][1]}


def _zoom_now(panel: Panel) -> dict[str, Any] | None:
    here, kind = zoomed_mm(panel), zoom_kind(panel.scene)
    if here is None or kind == "none":
        return None
    if kind == "zoom":
        return {"camera.focal_length_mm": here}
    return (
        {"film.size_mm": list(film_mm(panel.scene))}
        if kind == "crop"
        else as_paths(panel.scene.camera.zoom_keys(here, here) or {})
    )


# What clients hear of it.


def time_message(panel: Panel, recorder: Recorder) -> dict[str, Any]:
    """Where it stands in time, and the frames that have keys."""
    scene, clock = panel.scene, panel.dials.clock
    sequence = sequence_of(scene)

    def frames(moments: Iterable[float]) -> list[float]:
        return sorted({round(1 + (each - clock.first_s) * sequence.frames_per_second, 6) for each in moments})

    camera = [frame.time_s for frame in scene.camera.motion]
    channels = [{"name": "camera", "label": "Camera", "keys": frames(camera)}]
    for name, (label, paths) in [*CHANNELS.items()][1:]:
        own = [frame.time_s for path in paths for frame in sequence.keys.get(path, ())]
        channels.append({"name": name, "label": label, "keys": frames(own)})
    things = [frame.time_s for each in scene.objects for frame in each.motion]
    others = [frame.time_s for path, own in sequence.keys.items() if path not in _RECORDED for frame in own]
    return {
        "frame": clock.frame, "frames": clock.frames, "frames_per_second": sequence.frames_per_second,
        "record": recorder.is_on, "channels": channels, "others": frames([*things, *others]),
    }  # fmt: skip


def follows_anew(panel: Panel) -> list[str]:
    """Sentences on what the frame that is shown has not, and ``--frames`` finds for each frame."""
    if panel.dials.clock.frame <= 1 or sequence_of(panel.scene).exposure_time_constant_s is None:
        return []
    return ["The exposure is that of this frame alone: rptcam render --frames lets it follow the light slowly"]


# Keyframes as a scene file has them.


def _leaves(changes: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """The values of changes by full key path."""
    found: dict[str, Any] = {}
    for name, value in changes.items():
        path = f"{prefix}{name}"
        found |= _leaves(value, f"{path}.") if isinstance(value, Mapping) else {path: value}
    return found


def _is_replaced(path: str, changes: Mapping[str, Any]) -> bool:
    return any(path.startswith(f"{key}.") for key in changes)


def _without_pose(changes: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in changes.items() if key not in POSE}


def _sequence_of_keys(keys: Keys) -> Mapping[str, Any]:
    """Keyframes as the scene's model has them."""
    return FrameSequence.model_validate({"keys": keys}).keys


def _keys_of(scene: Scene) -> Keys:
    return {name: [each.model_dump() for each in frames] for name, frames in sequence_of(scene).keys.items()}


def _motion_of(scene: Scene) -> list[dict[str, Any]]:
    return [frame.model_dump(mode="json", exclude_none=True) for frame in scene.camera.motion]


def _written(scene: Scene, keys: Keys) -> dict[str, Any]:
    """The change of a scene that gives its sequence other keys."""
    kept = (
        {} if scene.sequence is None else scene.sequence.model_dump(mode="json", exclude_unset=True, exclude={"keys"})
    )
    return {"sequence": (kept | ({"keys": keys} if keys else {})) or None}


def _put(frames: list[dict[str, Any]], now: float, what: Any) -> list[dict[str, Any]]:
    """Return keyframes with one at a moment, in place of what was there."""
    here = {"time_s": now} | (dict(what) if isinstance(what, Mapping) else {"value": what})
    return sorted([*(each for each in frames if each["time_s"] != now), here], key=lambda each: float(each["time_s"]))


def _remove_key(frames: list[dict[str, Any]], now: float, label: str) -> list[dict[str, Any]]:
    left = [each for each in frames if abs(each["time_s"] - now) > 1e-9]
    if len(left) == len(frames):
        raise InputError(f"{label}: has no key in this frame")
    return left


def _carry(panel: Panel, path: str, value: Any, old: Any, new: Any) -> Any:
    """A keyframe's value after what is shown has gone from one value to another."""
    if isinstance(value, list | tuple) and isinstance(old, list | tuple) and isinstance(new, list | tuple):
        return [_carry(panel, path, *each) for each in zip(value, old, new, strict=True)]
    if any(isinstance(each, bool) or not isinstance(each, int | float) for each in (value, old, new)):
        return new
    by_ratio = path not in _DIFFERENCES and old > 0 and new > 0
    moved = new if value == old else value * (new / old) if by_ratio else value + (new - old)
    low, high = _ends(panel, path)
    return min(max(moved, low), high)


def _ends(panel: Panel, path: str) -> tuple[float, float]:
    if path == "camera.f_number":
        return f_numbers(panel.view)
    if path in CHANNELS["focus"][1]:
        return nearest_focus_m(panel.view) or 0.0, math.inf
    if path == "camera.focal_length_mm" and zoom_kind(panel.scene) == "zoom":
        return zoom_range(panel) or (0.0, math.inf)
    return -math.inf, math.inf
