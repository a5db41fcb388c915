"""What clients may say and hear: messages checked whole, and what waits to be done and to be sent."""

from __future__ import annotations

import io
import json
import math
import re
import struct
import threading
import zipfile
from collections.abc import Callable, Hashable, Mapping
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from pydantic import BaseModel, ConfigDict, Field, JsonValue, TypeAdapter, ValidationError, model_validator
from pydantic_core import from_json

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import plain, scratch_folder
from rptcam_cl.imaging.development import developed_codes
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.writers import film_part
from rptcam_cl.scene.exposure import MOST_FRAMES
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.instruments import OverlayName

# Films as image data: those of frames, made small enough for the client, and those of files to keep.

Codes = NDArray[np.uint8]
Format = Literal["jpeg", "webp", "png"]
MEDIA = {"jpeg": "image/jpeg", "webp": "image/webp", "png": "image/png"}
FILE_MEDIA = {"png": "image/png", "jpeg": "image/jpeg", "exr": "image/x-exr", "dng": "image/x-adobe-dng"}
ZIP = "application/zip"
NO_RAW = "a DNG holds what a sensor puts out (allowed: scenes with `sensor: {}`)"
_SUFFIXES = {"png": ".png", "jpeg": ".jpg", "exr": ".exr", "dng": ".dng"}
_OPTIONS: dict[str, dict[str, Any]] = {
    "jpeg": {"subsampling": "4:2:0"},
    "webp": {"method": 0},
    "png": {"compress_level": 1},
}


def codes_of(image: Image) -> Codes:
    """Return the developed picture in codes of 8 bits, as PNG files have them."""
    codes = developed_codes(image.seen, image.development, film_part(image.metadata, image.seen), 8)
    return np.asarray(codes, np.uint8)


def shrink(codes: Codes, width: int, height: int) -> Codes:
    """Return codes that are made smaller, by the means of areas, where they have more pixels than they are shown with.

    Parameters
    ----------
    codes
        (height, width, 3 or 4).
    width, height
        What the client shows them with [pixels].
    """
    rows, columns = codes.shape[:2]
    scale = min(width / columns, height / rows)
    if scale >= 1:
        return codes
    size = (max(1, round(columns * scale)), max(1, round(rows * scale)))
    return np.asarray(Pillow.fromarray(codes).resize(size, Pillow.Resampling.BOX))


def encode(codes: Codes, form: Format, quality: int) -> bytes:
    """Return codes, (height, width, 3 or 4), as an image file."""
    stream = io.BytesIO()
    options = _OPTIONS[form] | ({} if form == "png" else {"quality": quality})
    Pillow.fromarray(codes).save(stream, form.upper(), **options)
    return stream.getvalue()


def file_name(name: str, kind: str) -> str:
    """Return the name of the file that a client is offered: the one that it requests, with the suffix of its kind."""
    suffix = _SUFFIXES[kind]
    return name if name.lower().endswith(suffix) else f"{name}{suffix}"


def exposed_longer(image: Image, ev: float) -> Image:
    """Return the picture as of an exposure that lasts longer by some stops, before its sensor."""
    if ev == 0:
        return image
    factor = 2.0**ev
    time_s = image.metadata.get("exposure_time_s")
    timed = {} if time_s is None else {"exposure_time_s": time_s * factor}
    return replace(
        image, pixels=image.pixels * np.float32(factor), metadata=image.metadata | {"bracket_ev": ev} | timed
    )


def zipped(files: Mapping[str, bytes]) -> bytes:
    """Return an archive of files by name, which are compressed already."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return stream.getvalue()


def file_bytes(image: Image, kind: str) -> bytes:
    """Encode the picture as a file.

    Parameters
    ----------
    kind
        One of ``png``, ``jpeg``, ``exr`` and ``dng``.

    Raises
    ------
    InputError
        A raw file is requested, and the scene has no sensor.
    """
    with scratch_folder() as folder:
        path = Path(folder) / f"picture{_SUFFIXES[kind]}"
        if kind == "dng":
            try:
                image.raw().save(path)
            except InputError:
                raise InputError(NO_RAW) from None
        else:
            image.save(path)
        return path.read_bytes()


# What clients may say: each message is checked whole before anything is done.

VERSION = 1
MOST_BYTES = 64 << 10  # of one message
_MOST_CHANGES = 32  # keys of one message
Share = Annotated[float, Field(ge=0, le=1)]
Step = Annotated[float, Field(ge=-10, le=10)]
Count = Annotated[int, Field(ge=0, le=2**53)]  # what a number of JavaScript holds
Key = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[A-Za-z0-9_ .\[\]-]+$")]
Changes = Annotated[dict[Key, JsonValue], Field(max_length=_MOST_CHANGES)]
_SlotName = Literal["A", "B"]

# A string that could name a file: with a separator, or with a suffix; none of the scene's words has either.
_PATH = re.compile(r"[/\\]|\.[A-Za-z][A-Za-z0-9]{0,7}$|^\.|^~")


class Message(BaseModel):
    """One message of a client."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)

    id: Count | None = None
    """The client's number, which the answer repeats."""


class Hello(Message):
    """The first message: who knows the token may come in."""

    type: Literal["hello"]
    token: Annotated[str, Field(max_length=200)]
    version: Literal[1]


class Ack(Message):
    """A frame was drawn."""

    type: Literal["ack"]
    frame: Count


class ViewRequest(Message):
    """How a client wants its pictures; what is left out stays."""

    type: Literal["view"]
    width: Annotated[int, Field(ge=16, le=8192)] | None = None
    height: Annotated[int, Field(ge=16, le=8192)] | None = None
    overlays: dict[OverlayName, bool] | None = None
    zebra_level: Share | None = None
    peaking_level: Share | None = None
    format: Literal["jpeg", "webp", "png"] | None = None
    quality: Annotated[int, Field(ge=1, le=100)] | None = None
    panels: Annotated[list[Literal["histogram", "meter", "lens"]], Field(max_length=3)] | None = None


class Set(Message):
    """Changes of keys of the scene."""

    type: Literal["set"]
    changes: Changes
    transient: bool = False
    slot: _SlotName = "A"


class Dial(Message):
    """A dial was turned."""

    type: Literal["dial"]
    name: Annotated[str, Field(pattern=r"^[a-z_]{1,32}$")]
    value: float | Annotated[str, Field(max_length=200)] | bool | None
    transient: bool = False
    slot: _SlotName = "A"


class Move(Message):
    """The camera was moved."""

    type: Literal["move"]
    kind: Literal["orbit", "pan", "dolly", "walk", "tilt", "roll", "zoom"]
    dx: Step = 0.0
    dy: Step = 0.0
    dz: Step = 0.0
    transient: bool = False


class Reset(Message):
    """Back to the scene file."""

    type: Literal["reset"]
    what: Literal["camera", "all"] = "all"


class FocusRequest(Message):
    """Focus at a point of the picture."""

    type: Literal["focus"]
    x: Share
    y: Share


class Autofocus(Message):
    """Focus by a method, at zones."""

    type: Literal["autofocus"]
    method: Annotated[str, Field(pattern=r"^[a-z]{1,20}$")] | None = None
    zones: Annotated[list[Annotated[list[Share], Field(min_length=4, max_length=4)]], Field(max_length=64)] | None = (
        None
    )


class _Place(Message):
    x: Share | None
    y: Share | None

    @model_validator(mode="after")
    def _check_both(self) -> Self:
        if (self.x is None) != (self.y is None):
            raise ValueError("x and y are both numbers, or both null")
        return self

    @property
    def place(self) -> tuple[float, float] | None:
        """The point, where there is one."""
        return None if self.x is None or self.y is None else (self.x, self.y)


class Pointer(_Place):
    """Where the pointer is."""

    type: Literal["pointer"]


class Magnify(_Place):
    """Where the magnifier is."""

    type: Literal["magnify"]
    width: Annotated[int, Field(ge=4, le=1024)] = 256
    height: Annotated[int, Field(ge=4, le=1024)] = 256


class Compare(Message):
    """A second picture with some things different."""

    type: Literal["compare"]
    mode: Literal["off", "side", "wipe"]
    model: Literal["thin_lens", "thick_lens", "pinhole"] | None = None
    changes: Changes = {}
    difference: bool = False


class Save(Message):
    """A picture of the state shown, as bytes."""

    type: Literal["save"]
    format: Literal["png", "jpeg", "exr", "dng"]
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_ .-]{0,79}$")] = "picture"
    slot: _SlotName = "A"
    ev: Annotated[float, Field(ge=-10, le=10)] = 0.0
    """Stops that it is exposed longer: one of a bracket."""


class Stack(Message):
    """One picture that is sharp from a near to a far distance, or with all that it is made of; without these: none."""

    type: Literal["stack"]
    near_m: Annotated[float, Field(gt=0)] | None = None
    far_m: Annotated[float, Field(gt=0)] | None = None
    steps: Annotated[int, Field(ge=3, le=100)] | None = None
    pictures: bool = False
    format: Literal["png", "jpeg", "exr"] = "png"
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-][A-Za-z0-9_ .-]{0,79}$")] = "picture"


class TextRequest(Message):
    """The scene as YAML, or the command that renders the same."""

    type: Literal["scene", "command"]
    slot: _SlotName = "A"


class Signal(Message):
    """Render no more, render again; or: are you there."""

    type: Literal["pause", "resume", "ping"]


class HistoryRequest(Message):
    """Go back, forward or to a state that was; keep, drop or compare one."""

    type: Literal["history"]
    do: Literal["undo", "redo", "go", "snap", "drop", "compare"]
    number: Count | None = None

    @model_validator(mode="after")
    def _check_number(self) -> Self:
        if (self.number is None) != (self.do in ("undo", "redo", "snap")):
            raise ValueError("go, drop and compare take the number of a state; the others take none")
        return self


class Time(Message):
    """Go to a frame; set and delete keys; record; how long the bar is; a pull of the focus from one mark to another."""

    type: Literal["time"]
    do: Literal["go", "key", "unkey", "clear", "record", "length", "rack"]
    frame: Annotated[int, Field(ge=1, le=MOST_FRAMES)] | None = None
    channel: Literal["camera", "focus", "f_number", "zoom", "exposure"] | None = None
    on: bool | None = None
    playing: bool = False
    transient: bool = False
    from_m: Annotated[float, Field(gt=0)] | None = None
    to_m: Annotated[float, Field(gt=0)] | None = None
    seconds: Annotated[float, Field(gt=0, le=3600)] | None = None

    @model_validator(mode="after")
    def _check_needed(self) -> Self:
        needed = {"go": ("frame",), "length": ("frame",), "record": ("on",), "rack": ("from_m", "to_m", "seconds")}
        for name in needed.get(self.do, ("channel",)):
            if getattr(self, name) is None:
                raise ValueError(f"{self.do} takes {name}")
        return self


class Select(Message):
    """Select what is seen at a point, or a thing by name; nothing without both."""

    type: Literal["select"]
    x: Share | None = None
    y: Share | None = None
    name: Annotated[str, Field(max_length=200)] | None = None


class Lamp(Message):
    """Mute a lamp, or have it shine alone."""

    type: Literal["lamp"]
    name: Annotated[str, Field(max_length=200)]
    mute: bool | None = None
    solo: bool | None = None


class Add(Message):
    """Bring something to the scene, and select it."""

    type: Literal["add"]
    what: Literal["lamp", "card", "backdrop"]


class Denoise(Message):
    """Whether pictures are shown without their noise until they are clean."""

    type: Literal["denoise"]
    on: bool


AnyMessage = (
    Hello | Ack | ViewRequest | Set | Dial | Move | Reset | FocusRequest | Autofocus | Pointer | Magnify | Compare
    | Save | Stack | TextRequest | Signal | Denoise | HistoryRequest | Time | Select | Lamp | Add
)  # fmt: skip
_READER: TypeAdapter[AnyMessage] = TypeAdapter(Annotated[AnyMessage, Field(discriminator="type")])


class BadMessageError(InputError):
    """A message that cannot be read; `id` is its number where that is known."""

    def __init__(self, text: str, number: int | None = None) -> None:
        super().__init__(text)
        self.id = number


def read_message(text: str) -> AnyMessage:
    """Return the message of a text.

    Raises
    ------
    BadMessageError
        It is too long, is not JSON, or says what no message may.
    """
    if len(text) > MOST_BYTES or len(text.encode("utf-8", "surrogatepass")) > MOST_BYTES:
        raise BadMessageError(f"the message is too long (allowed: {MOST_BYTES} bytes)")
    try:
        message = _READER.validate_json(text)
    except ValidationError as problem:
        raise BadMessageError(_first_problem(problem), _number_of(text)) from None
    except ValueError as problem:  # surrogates
        raise BadMessageError(f"the message cannot be read ({problem})") from None
    if isinstance(message, Set | Compare):
        for key, value in message.changes.items():
            _check_value(key, value, message.id)
    return message


def _first_problem(problem: ValidationError) -> str:
    first = problem.errors(include_url=False, include_input=False)[0]
    if first["type"] == "json_invalid":
        return f"the message is not JSON: {first['msg']}"
    place = ".".join(str(part) for part in first["loc"][1:]) or "the message"
    return f"{place}: {first['msg']}"


_NUMBER: TypeAdapter[int | None] = TypeAdapter(Count | None)


def _number_of(text: str) -> int | None:
    """The number of a message that is wrong in other ways."""
    try:
        return _NUMBER.validate_python(from_json(text).get("id"), strict=True)
    except (ValueError, TypeError, AttributeError):  # no JSON, no text, no mapping, or no number
        return None


def _check_value(key: str, value: Any, number: int | None) -> None:
    """Refuse what names a file, at any depth, and numbers that are none."""
    if isinstance(value, dict):
        for name, item in value.items():
            _check_value(f"{key}.{name}", item, number)
    elif isinstance(value, list):
        for item in value:
            _check_value(key, item, number)
    elif isinstance(value, float) and not math.isfinite(value):
        raise BadMessageError(f"{key}: must be a finite number", number)
    elif value is not None and "file" in re.split(r"[._]", key.lower()):
        raise BadMessageError(f"{key}: files are named by the scene file, not from the page", number)
    elif isinstance(value, str) and _PATH.search(value):
        raise BadMessageError(f"{key}: {value[:80]!r} could name a file; files are named by the scene file", number)


# What waits to be sent to one client: answers in their order, and of everything else only the newest.

MOST_UNACKNOWLEDGED = 2  # frames on their way to a client
MOST_ANSWERS = 512  # that a client may leave unread


FrameData = tuple[Mapping[str, Any], bytes]
"""A frame without its number: header and image bytes."""


def _as_text(message: Mapping[str, Any]) -> str:
    """Return a message as JSON text, in which what is not finite is null."""
    return json.dumps(plain(message, json=True), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def as_bytes(header: Mapping[str, Any], data: bytes) -> bytes:
    """Return a binary message: length of the header, header, data."""
    text = _as_text(header).encode()
    return struct.pack("<I", len(text)) + text + data


class Outbox:
    """Messages for one client; any thread may put, one takes.

    Parameters
    ----------
    wake : callable
        Called, from any thread, when there is something to take.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._answers: list[str | bytes] = []
        self._news: dict[Hashable, Mapping[str, Any]] = {}
        self._frames: dict[Hashable, FrameData] = {}
        self._under_way: set[int] = set()
        self._last_number = 0
        self.overflowed = False

    def answer(self, message: Mapping[str, Any], data: bytes | None = None) -> None:
        """Add a message that is sent whatever comes after it."""
        with self._lock:
            if len(self._answers) >= MOST_ANSWERS:
                self.overflowed = True
            else:
                self._answers.append(_as_text(message) if data is None else as_bytes(message, data))
        self._wake()

    def news(self, key: Hashable, message: Mapping[str, Any]) -> None:
        """Add a message that replaces an earlier one of its key."""
        with self._lock:
            self._news[key] = message
        self._wake()

    def frame(self, key: Hashable, frame: FrameData) -> None:
        """Add a frame that replaces an earlier one of its key, and takes its place."""
        with self._lock:
            self._frames[key] = frame
        self._wake()

    def acknowledge(self, number: int) -> None:
        """Note that a frame has arrived."""
        with self._lock:
            self._under_way.discard(number)
        self._wake()

    @property
    def has_room(self) -> bool:
        """Whether a frame that is made now could leave."""
        return len(self._under_way) + len(self._frames) < MOST_UNACKNOWLEDGED

    @property
    def is_clear(self) -> bool:
        """Whether the client has all frames that were made for it."""
        return not (self._under_way or self._frames)

    def take(self) -> list[str | bytes]:
        """Take what can be sent now."""
        with self._lock:
            found: list[str | bytes] = list(self._answers)
            found += [_as_text(message) for message in self._news.values()]
            self._answers.clear()
            self._news.clear()
            while self._frames and len(self._under_way) < MOST_UNACKNOWLEDGED:
                header, data = self._frames.pop(next(iter(self._frames)))
                self._last_number += 1
                self._under_way.add(self._last_number)
                found.append(as_bytes({**header, "frame": self._last_number}, data))
            return found


# One page that looks through the viewfinder: what it wants to see, and what waits for it.


@dataclass(frozen=True)
class ClientSettings:
    """How a client wants its pictures; see `ViewRequest`."""

    width: int = 1920
    height: int = 1080
    overlays: Mapping[OverlayName, bool] = field(default_factory=dict)
    zebra_level: float = 0.95
    peaking_level: float = 0.5
    format: Format = "jpeg"
    quality: int = 85
    panels: tuple[str, ...] = ()

    def changed(self, view: ViewRequest) -> ClientSettings:
        """Return the settings with those that a message gives."""
        given = view.model_dump(exclude_none=True, exclude={"type", "id"})
        if "panels" in given:
            given["panels"] = tuple(given["panels"])
        if "overlays" in given:
            given["overlays"] = {**self.overlays, **given["overlays"]}
        return replace(self, **given)

    def overlays_on(self) -> tuple[OverlayName, ...]:
        """Return the names of the overlays that are wanted."""
        return tuple(name for name, wanted in self.overlays.items() if wanted)


class Client:
    """A page, its settings and its outbox.

    Parameters
    ----------
    number
        Of the client, from 1.
    wake
        Called, from any thread, when there is something to send.
    token
        What it is to come back with; None where it knows that.
    """

    def __init__(self, number: int, wake: Callable[[], None], token: str | None = None) -> None:
        self.token = token
        self.number = number
        self.outbox = Outbox(wake)
        self.settings = ClientSettings()
        self.busy: list[str] = []  # what runs, as it knows
        self.pointer: tuple[float, float] | None = None
        self.magnifier: Magnify | None = None
        self.shown: dict[str, int] = {}  # by slot: number of the picture that was sent last
        self.covered: dict[str, int] = {}  # of the one whose overlays were sent last
        self.counted: dict[str, int] = {}  # and of the one whose histogram was
        self.answers: int | None = None  # the change of this client that is in force
        self.lens_at: tuple[tuple[float, float] | None, int] | None = None  # pointer and generation of the last panel
        self.lens_shown: int | None = None  # generation of the section that it has
        self.pointed_at: tuple[tuple[float, float] | None, int | None] | None = None  # and the picture under it
        self.was_greeted = False
        self.history = -1  # the version of it that was sent
        self.thumbs: dict[int, str] = {}  # that were sent

    def forget_picture(self, slot: str) -> None:
        """Take the next picture of a slot for new."""
        for sent in (self.shown, self.covered, self.counted):
            sent.pop(slot, None)

    def forget_pictures(self) -> None:
        """Take whatever comes next for new."""
        for sent in (self.shown, self.covered, self.counted):
            sent.clear()
        self.lens_at = self.pointed_at = self.lens_shown = None

    def done(self, number: int | None, generation: int, **more: Any) -> None:
        """Say that a request is in force."""
        if number is not None:
            self.outbox.answer({"type": "done", "id": number, "generation": generation, **more})

    def error(self, message: str, number: int | None, source: str, where: str | None = None) -> None:
        """Say what is wrong."""
        self.outbox.answer({"type": "error", "id": number, "message": message, "where": where, "source": source})


# What clients ask of the engine: newer requests replace older ones that they make needless.

_MOST_WAITING = 256


Request = tuple[Client, AnyMessage]
"""A message, and before it the client that sent it."""


def _key(request: Request) -> Hashable:
    """The key that a request shares with those that it replaces; None where it replaces none."""
    client, message = request
    if isinstance(message, Dial):
        return ("dial", message.slot, message.name)
    if isinstance(message, Set):
        return ("set", message.slot, frozenset(message.changes))
    if isinstance(message, Move):
        return ("move", message.kind)
    if isinstance(message, Time) and message.do == "go":
        return ("time", client)
    if isinstance(message, Pointer | Magnify):
        return (message.type, client)
    return None


def _join(older: Request | Scene, newer: Request | Scene) -> Request | Scene:
    """Make one of two requests of one key: the newer, and of moves both."""
    if isinstance(older, Scene) or isinstance(newer, Scene) or not isinstance(newer[1], Move):
        return newer
    before, (client, after) = older[1], newer
    steps = {name: getattr(before, name) + getattr(after, name) for name in ("dx", "dy", "dz")}
    return client, after.model_copy(update=steps)


class Inbox:
    """Requests, and the scene as its files are now, in their order; any thread puts, the engine takes."""

    def __init__(self) -> None:
        self._requests: dict[Hashable, Request | Scene] = {}
        self._changed = threading.Condition()
        self._woken = False
        self._count = 0

    def put(self, request: Request | Scene) -> Request | Scene | None:
        """Add a request; return the one that it replaces.

        Raises
        ------
        OverflowError
            Too many wait; a scene comes in all the same.
        """
        with self._changed:
            key = None if isinstance(request, Scene) else _key(request)
            if key is None:
                self._count += 1
                key = self._count
            older = self._requests.pop(key, None)
            if older is None and len(self._requests) >= _MOST_WAITING and not isinstance(request, Scene):
                raise OverflowError
            self._requests[key] = request if older is None else _join(older, request)
            self._woken = True
            self._changed.notify()
            return older

    def wake(self) -> None:
        """Let the engine look around."""
        with self._changed:
            self._woken = True
            self._changed.notify()

    def take(self, timeout_s: float | None) -> list[Request | Scene]:
        """Return all requests, once there is one, the engine is woken, or the time is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._woken, timeout_s)
            self._woken = False
            found = list(self._requests.values())
            self._requests.clear()
            return found

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits."""
        return not self._requests
