"""What clients may say: each message is checked whole before anything is done."""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue, TypeAdapter, ValidationError, model_validator

from rptcam_cl.core.errors import InputError

VERSION = 1
MOST_BYTES = 64 << 10  # of one message
MOST_CHANGES = 32  # keys of one message
Share = Annotated[float, Field(ge=0, le=1)]
Step = Annotated[float, Field(ge=-10, le=10)]
Count = Annotated[int, Field(ge=0, le=2**53)]  # what a number of JavaScript holds
Key = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[A-Za-z0-9_ .\[\]-]+$")]
Changes = Annotated[dict[Key, JsonValue], Field(max_length=MOST_CHANGES)]
SlotName = Literal["A", "B"]

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


class View(Message):
    """How a client wants its pictures; what is left out stays."""

    type: Literal["view"]
    width: Annotated[int, Field(ge=16, le=8192)] | None = None
    height: Annotated[int, Field(ge=16, le=8192)] | None = None
    overlays: dict[Literal["zebra", "false_colour", "peaking"], bool] | None = None
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
    slot: SlotName = "A"


class Dial(Message):
    """A dial was turned."""

    type: Literal["dial"]
    name: Annotated[str, Field(pattern=r"^[a-z_]{1,32}$")]
    value: float | Annotated[str, Field(max_length=200)] | bool | None
    transient: bool = False
    slot: SlotName = "A"


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


class Focus(Message):
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
    slot: SlotName = "A"


class SceneText(Message):
    """The scene as YAML."""

    type: Literal["scene"]
    slot: SlotName = "A"


class CommandLine(Message):
    """The command that renders the same."""

    type: Literal["command"]
    slot: SlotName = "A"


class Pause(Message):
    """Render no more."""

    type: Literal["pause"]


class Resume(Message):
    """Render again."""

    type: Literal["resume"]


class Ping(Message):
    """Are you there."""

    type: Literal["ping"]


class SceneRead(Message):
    """Not of a client: the scene file was read again."""

    model_config = ConfigDict(arbitrary_types_allowed=True)
    scene: Any


AnyMessage = (
    Hello | Ack | View | Set | Dial | Move | Reset | Focus | Autofocus | Pointer | Magnify | Compare | Save
    | SceneText | CommandLine | Pause | Resume | Ping
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


class _Numbered(BaseModel):
    model_config: ClassVar[ConfigDict] = ConfigDict(strict=True)
    id: Count | None = None


def _number_of(text: str) -> int | None:
    """Return the number of a message that is wrong in other ways."""
    try:
        return _Numbered.model_validate_json(text).id
    except (ValidationError, ValueError):
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
