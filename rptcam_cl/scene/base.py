"""Base of the scene model: frozen models closed to unknown keys, how a value is refused, and parts that name a file."""

from __future__ import annotations

import ast
import hashlib
import inspect
import io
import math
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from numbers import Real
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    model_validator,
)
from pydantic.functional_validators import ModelWrapValidatorHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from rptcam_cl.core.errors import near_name
from rptcam_cl.core.files import Folders, digest

# Base of the scene model: frozen models closed to unknown keys, finite numbers, and how a value is refused.

REFUSED = "refused"

_UNSET = object()


def refuse(
    problem: str, *, got: Any = _UNSET, allowed: str = "", path: tuple[str | int, ...] = ()
) -> PydanticCustomError:
    """Return the error to raise for a value that the scene model does not take.

    Parameters
    ----------
    problem : str
        What is wrong, as a sentence without its subject: ``must not be zero``.
    got : optional
        The offending value, when it is not the one that the validator was given.
    allowed : str
        What would be right.
    path : tuple of str or int
        Keys that lead from the validated value to the offending one.
    """
    context: dict[str, Any] = {"problem": problem, "allowed": allowed, "path": path}
    if got is not _UNSET:
        context["got"] = got
    return PydanticCustomError(REFUSED, "{problem}", context)


def listed(names: Sequence[str], most: int = 24) -> str:
    """Return names separated by commas, cut short when there are many."""
    shown = ", ".join(names[:most])
    return f"{shown}, … ({len(names)} in all)" if len(names) > most else shown


def unknown_name(
    problem: str,
    name: object,
    known: Iterable[str],
    *,
    otherwise: str = "",
    without: str = "",
    path: tuple[str | int, ...] = (),
) -> PydanticCustomError:
    """The error for a name that is none of those known; it suggests the one that was probably meant.

    Parameters
    ----------
    problem : str
        What is wrong, as ``names no material``.
    otherwise : str
        What is allowed beside the known names, appended to them.
    without : str
        What is allowed where no names are known.
    """
    names = list(known)
    allowed = listed(names) + otherwise if names else without
    return refuse(f"{problem}{near_name(name, names)}", got=name, allowed=allowed, path=path)


def word_for(
    key: str,
    words: Sequence[str],
    *,
    problem: str = "is not a known choice",
    otherwise: str = ", or a mapping",
    nothing: str | None = None,
) -> BeforeValidator:
    """A validator by which a word stands for a mapping of one key to it; the word `nothing` stands for None."""

    def read(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if value not in words:
            raise unknown_name(problem, value, words, otherwise=otherwise)
        return None if value == nothing else {key: value}

    return BeforeValidator(read)


FLOAT32_MAX = 3.4028234663852886e38
FLOAT32_MIN_NORMAL = 1.1754943508222875e-38

_ALMOST_NUMERIC = re.compile(r"[-+]?[0-9.][0-9_.,:eExXoOa-fA-F+-]*")


def read_number(value: Any) -> float:
    """Return a finite float that float32 can hold."""
    if isinstance(value, str):
        hint = "is text, not a number"
        if _ALMOST_NUMERIC.fullmatch(value):
            hint += " (write plain decimal digits without quotes, colons or underscores)"
        elif value.strip().lower().lstrip("+-.") in ("inf", "infinity"):
            hint = "must be finite (for infinity write a length far beyond the scene, as 1e6)"
        raise refuse(hint, allowed="a number")
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Real):
        raise refuse("must be a number", allowed="a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise refuse("must be finite", allowed="a finite number")
    if abs(number) > FLOAT32_MAX:
        raise refuse("is beyond the range of float32", allowed=f"at most {FLOAT32_MAX:.3g}")
    if 0 < abs(number) < FLOAT32_MIN_NORMAL:
        raise refuse("is below the range of float32", allowed=f"0, or at least {FLOAT32_MIN_NORMAL:.3g} in size")
    return number


# pydantic asks for it for each of the 444 fields that are checked so, and else finds it anew
read_number.__signature__ = inspect.signature(read_number)  # type: ignore[attr-defined]


def number_at(value: Any, path: tuple[int, ...]) -> float:
    """Return a finite float that float32 can hold, from the given place inside a value."""
    try:
        return read_number(value)
    except PydanticCustomError as problem:
        context = dict(problem.context or {})
        raise refuse(context["problem"], got=value, allowed=context["allowed"], path=path) from None


class Alternatives(NamedTuple):
    """Keys of one mapping of which at most one may be set.

    Attributes
    ----------
    keys : tuple of str
        The keys that exclude each other.
    required : bool
        Whether one of them must be there.
    """

    keys: tuple[str, ...]
    required: bool


def read_switch(value: Any) -> Any:
    """Return `on` and `off` for true and false, as which loaders of YAML 1.1 take these words."""
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else value


class AlsoAccepts:
    """Adds to a field's JSON schema a form that its validator turns into the declared one.

    Parameters
    ----------
    form : dict, optional
        Its JSON schema; by default that of an item of the list that is declared.
    """

    def __init__(self, form: dict[str, Any] | None = None) -> None:
        self.form = form

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The JSON schema of either form."""
        declared = handler(schema)
        return {"anyOf": [declared["items"] if self.form is None else self.form, declared]}


class SceneModel(BaseModel):
    """A part of a scene. Its fields are the keys of the YAML mapping; instances do not change."""

    # Schemas are built and descriptions read when they are needed: a command starts in two thirds of the time.
    model_config = ConfigDict(frozen=True, extra="forbid", hide_input_in_errors=True, defer_build=True)

    alternatives: ClassVar[tuple[Alternatives, ...]] = ()

    def __eq__(self, other: object) -> bool:
        """Whether the keys say the same, and what came with them; matrices that follow from them do not count."""
        if type(self) is not type(other):
            return NotImplemented
        return self is other or (
            all(self.__dict__[name] == other.__dict__[name] for name in type(self).model_fields)
            and self.__pydantic_private__ == other.__pydantic_private__
        )

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        if isinstance(data, SceneModel):
            return data
        names = list(cls.model_fields)
        if not isinstance(data, dict):
            raise refuse("must be a mapping", allowed=f"a mapping with the keys {listed(names)}")
        for key in data:
            if key not in cls.model_fields:
                hint = _owners(cls, key) or near_name(key, names)
                raise refuse(f"unknown key{hint}", got=key, allowed=listed(names), path=(key,))
        for group in cls.alternatives:
            _check_alternatives(group, data)
        return data

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Return the JSON schema with the keys' descriptions and the rule on excluding keys added."""
        described = handler(schema)
        target = handler.resolve_ref_schema(described)
        for name, text in _descriptions(cls).items():
            value = target.get("properties", {}).get(name)
            if value is not None and handler.resolve_ref_schema(value).get("description") != text:
                value["description"] = text
        rules = [_alternatives_schema(group) for group in cls.alternatives]
        if rules:
            target["allOf"] = rules
        return described


@lru_cache(maxsize=256)
def _descriptions(model: type[SceneModel]) -> dict[str, str]:
    """Return the text below each field of a model and of its bases, by the field's name."""
    texts: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not issubclass(base, BaseModel) or base is BaseModel:
            continue
        for field, text in pairwise(_classes(inspect.getfile(base))[base.__name__].body):
            if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
                continue
            if (
                isinstance(text, ast.Expr)
                and isinstance(text.value, ast.Constant)
                and isinstance(text.value.value, str)
            ):
                texts[field.target.id] = inspect.cleandoc(text.value.value)
    return texts


@lru_cache(maxsize=64)
def _classes(file: str) -> dict[str, ast.ClassDef]:
    """Return the classes of a module by name; `inspect.getsource` would parse it anew for each."""
    tree = ast.parse(Path(file).read_text("utf-8"))
    return {node.name: node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def _check_alternatives(group: Alternatives, data: dict[str, Any]) -> None:
    present = [key for key in group.keys if data.get(key) is not None]
    choice = " | ".join(group.keys)
    if len(present) > 1:
        raise refuse(
            f"cannot be given together with {present[0]}",
            allowed=f"{'exactly' if group.required else 'at most'} one of {choice}",
            path=(present[-1],),
        )
    if group.required and not present:
        raise refuse(f"needs one of {choice}", allowed=f"exactly one of {choice}")


def _alternatives_schema(group: Alternatives) -> dict[str, Any]:
    """Return the JSON schema rule: one of the keys, or none where that is allowed."""
    one_each: list[dict[str, Any]] = [{"required": [key]} for key in group.keys]
    if not group.required:
        one_each.append({"not": {"anyOf": [{"required": [key]} for key in group.keys]}})
    return {"oneOf": one_each}


def _owners(model: type[SceneModel], key: str) -> str:
    """Return ``; kind a has it`` where a key that one kind of a part does not know belongs to others, or nothing."""
    root = [base for base in model.__mro__ if issubclass(base, SceneModel) and base is not SceneModel][-1]
    kin = [root]
    for each in kin:
        kin += [heir for heir in each.__subclasses__() if heir not in kin]
    kinds = [
        get_args(each.model_fields["kind"].annotation)[0] for each in kin if {key, "kind"} <= set(each.model_fields)
    ]
    if not kinds:
        return ""
    return f"; kind {kinds[0]} has it" if len(kinds) == 1 else f"; kinds {', '.join(kinds)} have it"


# Parts of a scene that name a file: found once all is validated, so that errors can name the place in the scene.


def one_pixel(red: int, green: int, blue: int) -> bytes:
    """Return the PNG file of a single pixel, 8 bits a channel (PNG specification, sections 5 and 11)."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    header = (1).to_bytes(4, "big") * 2 + bytes([8, 2, 0, 0, 0])
    row = zlib.compress(bytes([0, red, green, blue]))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", row) + chunk(b"IEND", b"")


GREY = one_pixel(188, 188, 188)  # 0.503 once decoded from sRGB
LARGEST_FILE = 2 << 30  # bytes, of a picture, the largest kind of file that parts of a scene name
_PLAIN = {str, int, float, bool}
_ARRAY = "an array"  # name of what is no file
FileName = Annotated[str, Field(min_length=1, max_length=1000)]


class FileReference(SceneModel):
    """A part of a scene whose content is in a file of the scene's folder, or was taken out of another file."""

    stand_in: ClassVar[bytes | None] = None
    """Content that takes the place of a missing file, where a scene may go on without it."""

    file: FileName
    """File in the scene's folder."""

    _data: bytes | None = PrivateAttr(None)
    """Content of the file, where it comes from inside another file; `file` is a name for the reader then."""

    _digest: str | None = PrivateAttr(None)
    """SHA-256 of that content, once it is known."""

    _place: str = PrivateAttr("")
    """Where the scene names the file, ``scene.yaml:3:9: materials.wood.reflectance.file: ``; for errors."""

    @model_validator(mode="wrap")
    @classmethod
    def _take_array(cls, data: Any, validate: ModelWrapValidatorHandler[Self]) -> Self:
        """Hold an array that stands in place of the file's name, as the content of a NumPy file."""
        array = data.get("file") if isinstance(data, Mapping) else None
        if not isinstance(array, np.ndarray):
            return validate(data)
        stream = io.BytesIO()
        np.save(stream, array, allow_pickle=False)
        made = validate({**data, "file": _ARRAY})
        made.hold(stream.getvalue())
        return made

    @property
    def place(self) -> str:
        """What an error about the file begins with."""
        return self._place or f"{self.file}: "

    def locate(self, place: str) -> None:
        """Say where the scene names the file, unless that is known."""
        self._place = self._place or place

    def hold(self, content: bytes) -> None:
        """Take content in place of the file's."""
        self._data, self._digest = content, None

    def source(self, folders: Folders) -> Path | bytes:
        """Return the real path of the file, or its content where that is known.

        Raises
        ------
        InputError
            When the file is missing, not a regular file, or not in a folder where the scene may read.
        """
        return self._data if self._data is not None else folders.find(self.file)

    def content_digest(self, folders: Folders) -> str:
        """Return the SHA-256 of the content."""
        source = self.source(folders)
        if not isinstance(source, bytes):
            return digest(source, LARGEST_FILE)
        self._digest = self._digest or hashlib.sha256(source).hexdigest()
        return self._digest


def describe(value: SceneModel, folders: Folders) -> dict[str, Any]:
    """Return a part of a scene as plain data in which files stand by their content."""
    content = value.model_dump(mode="json")
    for path, reference in file_references(value):
        part: Any = content
        for step in path:
            part = part[step]
        part["file"] = reference.content_digest(folders)
    return content


def file_references(
    value: Any, path: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], FileReference]]:
    """Yield every part below a value that names a file, with the keys that lead to it."""
    if isinstance(value, SceneModel):
        if isinstance(value, FileReference):
            yield path, value
        items: Iterable[tuple[str | int, Any]] = [
            (name, getattr(value, name)) for name in _fields_with_files(type(value))
        ]
    elif isinstance(value, tuple):
        items = enumerate(value)
    elif isinstance(value, Mapping):
        items = value.items()
    else:
        return
    for key, item in items:
        if item is not None and type(item) not in _PLAIN:
            yield from file_references(item, (*path, key))


@lru_cache(maxsize=256)
def _fields_with_files(model: type[SceneModel]) -> tuple[str, ...]:
    """Return the fields of a model below which its types allow a part that names a file."""
    return tuple(name for name, parts in _parts_of(model).items() if _may_name_files(parts))


def _may_name_files(parts: frozenset[Any]) -> bool:
    """Return whether parts, or what is below them, name a file or may be anything."""
    ahead, seen = set(parts), set()
    while ahead:
        if Any in ahead or any(issubclass(part, FileReference) for part in ahead):
            return True
        seen |= ahead
        ahead = set().union(*(below for part in ahead for below in _parts_of(part).values())) - seen
    return False


@lru_cache(maxsize=256)
def _parts_of(model: type[SceneModel]) -> dict[str, frozenset[Any]]:
    """Return the models that the type of each field has in it, and Any where it has that."""

    def parts(annotation: Any) -> Iterator[Any]:
        if annotation is Any or (isinstance(annotation, type) and issubclass(annotation, SceneModel)):
            yield annotation
        for part in get_args(annotation):
            yield from parts(part)

    return {name: frozenset(parts(field.annotation)) for name, field in model.model_fields.items()}
