"""YAML read strictly: scalars as YAML 1.2 (core schema) has them; no tags, anchors or duplicate keys; bounded size.

PyYAML alone follows YAML 1.1: it reads ``1e-3`` as a string, ``010`` as eight, ``2:8`` as 128 and ``on`` as true.
Every value keeps the line and column where it stood, so that later checks can point at it.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import References, name_errors, read_whole

MAX_BYTES = 4_000_000
MAX_DEPTH = 32
_MAX_NODES = 50_000
_MAX_DIGITS = 40

KeyPath = tuple[str | int, ...]
Position = tuple[int, int]

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_INTEGER = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"[-+]?\.(inf|Inf|INF)")
_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}


@dataclass(frozen=True)
class Document:
    """Plain data of one YAML document, and where each part of it stood.

    Attributes
    ----------
    data : mapping, list or scalar
        Dictionaries, lists, strings, numbers, booleans and None.
    name : str
        File name used in messages.
    files : References
        Reads the files that the document names; by default those of the working folder.
    """

    data: Any
    name: str
    _values: dict[KeyPath, Position] = field(repr=False)
    _keys: dict[KeyPath, Position] = field(repr=False)
    files: References = field(default_factory=References, repr=False, compare=False)

    def mark(self, path: KeyPath) -> Position:
        """Return (line, column), from 1, of the value at a key path, or of its nearest enclosing value."""
        return self._nearest(self._values, path)

    def key_mark(self, path: KeyPath) -> Position:
        """Return (line, column), from 1, of the key that ends a path, or of the nearest enclosing value."""
        return self._keys.get(path) or self.mark(path)

    def where(self, path: KeyPath, at_key: bool = False) -> str:
        """Return ``FILE:LINE:COL`` of the value or the key at a path; only the name for data that no file holds."""
        if not self._values:
            return self.name
        line, column = self.key_mark(path) if at_key else self.mark(path)
        return f"{self.name}:{line}:{column}"

    @staticmethod
    def _nearest(marks: dict[KeyPath, Position], path: KeyPath) -> Position:
        for length in range(len(path), -1, -1):
            if path[:length] in marks:
                return marks[path[:length]]
        return (1, 1)


def dotted(path: KeyPath) -> str:
    """Return a key path as text: ``surfaces[3].radius``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}"
    return text.removeprefix(".")


def read_yaml(
    source: str | bytes | Path, name: str | None = None, *, most_bytes: int = MAX_BYTES, most_values: int = _MAX_NODES
) -> Document:
    """Return the one document of a YAML text or file.

    Parameters
    ----------
    source : str, bytes or Path
        A `Path` is a file to read; a string or bytes are the text itself.
    name : str, optional
        File name for messages; the path's own by default.
    most_bytes, most_values : int
        How large it may be.

    Raises
    ------
    InputError
        ``NAME:LINE:COL: problem`` for whatever is not strict YAML.
    StateError
        When the file cannot be read.
    """
    label = name or (str(source) if isinstance(source, Path) else "<text>")
    raw = _read_file(source, label, most_bytes) if isinstance(source, Path) else source
    text = _decode(raw if isinstance(raw, bytes) else raw.encode("utf-8", "surrogatepass"), label, most_bytes)
    return _Builder(label, most_values).build(text)


def parse_scalar(text: str) -> Any:
    """Return the value of a plain (unquoted) scalar by the core schema of YAML 1.2."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        if len(text) > _MAX_DIGITS:
            raise ValueError(f"a number of {len(text)} digits (at most {_MAX_DIGITS})")
        return int(text, 10)
    if _OCTAL.fullmatch(text) or _HEXADECIMAL.fullmatch(text):
        if len(text) > _MAX_DIGITS:
            raise ValueError(f"a number of {len(text)} digits (at most {_MAX_DIGITS})")
        return int(text, 0)
    if _FLOAT.fullmatch(text):
        return _finite(text)
    if _INFINITY.fullmatch(text):
        return float(text.replace(".", ""))
    return text


def _finite(text: str) -> float:
    value = float(text)
    if value in (float("inf"), float("-inf")):
        raise ValueError(f"{text[:_MAX_DIGITS]} is beyond the range of numbers (about 1.8e308)")
    return value


def _read_file(path: Path, label: str, most_bytes: int) -> bytes:
    with name_errors(label):
        return read_whole(path, most_bytes)


def _decode(raw: bytes, label: str, most_bytes: int) -> str:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"{label}:1:1: is UTF-16 text; save it as UTF-8")
    if len(raw) > most_bytes:
        most = f"at most {most_bytes}; put meshes and pictures in files of their own"
        raise InputError(f"{label}: has {len(raw)} bytes ({most})")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = raw.count(b"\n", 0, problem.start) + 1
        column = problem.start - raw.rfind(b"\n", 0, problem.start)
        raise InputError(f"{label}:{line}:{column}: invalid UTF-8 at byte {problem.start}") from None
    if (index := text.find("\0")) >= 0:
        line, column = text.count("\n", 0, index) + 1, index - text.rfind("\n", 0, index)
        raise InputError(f"{label}:{line}:{column}: contains a NUL byte; this is not a text file")
    return text


def _position(mark: Any) -> Position:
    return (mark.line + 1, mark.column + 1)


@dataclass
class _Open:
    """A mapping or list that is being filled."""

    path: KeyPath
    value: dict[Any, Any] | list[Any]
    key: Any = None
    has_key: bool = False


class _Builder:
    """Turns the events of PyYAML's parser into plain data, without recursion that deep nesting could overflow."""

    def __init__(self, name: str, most_values: int) -> None:
        self.name = name
        self.most_values = most_values
        self.stack: list[_Open] = []
        self.values: dict[KeyPath, Position] = {}
        self.keys: dict[KeyPath, Position] = {}
        self.nodes = 0
        self.documents = 0
        self.root: Any = None

    def build(self, text: str) -> Document:
        try:
            for event in yaml.parse(text, Loader=_Loader):
                self._take(event)
        except yaml.MarkedYAMLError as problem:
            raise self._syntax_error(problem, text) from None
        except yaml.YAMLError as problem:
            raise InputError(f"{self.name}:1:1: not valid YAML ({str(problem).splitlines()[0]})") from None
        if self.documents == 0:
            raise InputError(f"{self.name}:1:1: is empty")
        return Document(self.root, self.name, self.values, self.keys)

    def _fail(self, mark: Any, problem: str) -> InputError:
        return self._fail_at(*_position(mark), problem)

    def _fail_at(self, line: int, column: int, problem: str) -> InputError:
        return InputError(f"{self.name}:{line}:{column}: {problem}")

    def _syntax_error(self, problem: yaml.MarkedYAMLError, text: str) -> InputError:
        mark = problem.problem_mark or problem.context_mark
        if mark is None:
            return InputError(f"{self.name}:1:1: not valid YAML ({problem.problem})")
        if "nesting depth" in (problem.problem or ""):  # PyYAML from 6.0.4 on reads ahead, to a limit of its own
            return self._fail(mark, f"nested deeper than {MAX_DEPTH} levels")
        lines = text.splitlines()
        line = lines[mark.line] if mark.line < len(lines) else ""
        if "\t" in line[: mark.column + 1]:
            return self._fail_at(mark.line + 1, line.index("\t") + 1, "a tab where only spaces may indent")
        return self._fail(mark, f"not valid YAML: {problem.problem or problem.context}")

    def _take(self, event: Any) -> None:
        handler: Callable[[Any], None] | None = {
            "DocumentStartEvent": self._document,
            "AliasEvent": self._alias,
            "ScalarEvent": self._scalar,
            "MappingStartEvent": self._mapping,
            "SequenceStartEvent": self._sequence,
            "MappingEndEvent": self._close,
            "SequenceEndEvent": self._close,
        }.get(type(event).__name__)
        if handler is not None:
            handler(event)

    def _document(self, event: Any) -> None:
        self.documents += 1
        if self.documents > 1:
            raise self._fail(event.start_mark, "a second document begins here; one file holds one document")

    def _alias(self, event: Any) -> None:
        raise self._fail(event.start_mark, f"aliases are not allowed (got *{event.anchor})")

    def _check_node(self, event: Any) -> None:
        self.nodes += 1
        if self.nodes > self.most_values:
            problem = f"more than {self.most_values} values (put meshes and places in files of their own)"
            raise self._fail(event.start_mark, problem)
        if event.anchor:
            raise self._fail(event.start_mark, f"anchors are not allowed (got &{event.anchor})")
        if event.tag:
            raise self._fail(event.start_mark, f"tags are not allowed (got {event.tag})")

    def _scalar(self, event: Any) -> None:
        self._check_node(event)
        try:
            value = parse_scalar(event.value) if event.implicit[0] else event.value
        except ValueError as problem:
            raise self._fail(event.start_mark, str(problem)) from None
        top = self.stack[-1] if self.stack else None
        if top is not None and isinstance(top.value, dict) and not top.has_key:
            self._key(top, value, event)
        else:
            self._place(value, event)

    def _key(self, top: _Open, key: Any, event: Any) -> None:
        if key == "<<" and event.implicit[0]:
            raise self._fail(event.start_mark, "merge keys (<<) are not allowed")
        path = (*top.path, key)
        if path in self.keys:
            lines = f"first on line {self.keys[path][0]}, again on line {event.start_mark.line + 1}"
            raise self._fail(event.start_mark, f"{dotted(path)}: duplicate key ({lines})")
        self.keys[path] = _position(event.start_mark)
        top.key, top.has_key = key, True

    def _mapping(self, event: Any) -> None:
        self._open(event, {})

    def _sequence(self, event: Any) -> None:
        self._open(event, [])

    def _open(self, event: Any, value: dict[Any, Any] | list[Any]) -> None:
        self._check_node(event)
        if len(self.stack) >= MAX_DEPTH:
            raise self._fail(event.start_mark, f"nested deeper than {MAX_DEPTH} levels")
        if self.stack and isinstance(self.stack[-1].value, dict) and not self.stack[-1].has_key:
            raise self._fail(event.start_mark, "a key must be a word or a number, not a list or mapping")
        self.stack.append(_Open(self._place(value, event), value))

    def _close(self, _: Any) -> None:
        self.stack.pop()

    def _place(self, value: Any, event: Any) -> KeyPath:
        if not self.stack:
            self.root = value
            path: KeyPath = ()
        else:
            top = self.stack[-1]
            if isinstance(top.value, list):
                path = (*top.path, len(top.value))
                top.value.append(value)
            else:
                path = (*top.path, top.key)
                top.value[top.key] = value
                top.has_key = False
        self.values[path] = _position(event.start_mark)
        return path


# Checked access to the mappings of a lens file: every problem names the file, the key and what would be right.

# What a key of a lens file is: its meaning and the JSON schema of its value.


@dataclass(frozen=True)
class Key:
    """A key: its meaning in one line, and the JSON schema of its value."""

    text: str
    schema: Mapping[str, Any]


def numbers(least: int, most: int | None = None) -> dict[str, Any]:
    """Return the schema of a list of numbers."""
    return {"type": "array", "items": NUMBER, "minItems": least} | ({} if most is None else {"maxItems": most})


def by_number(value: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return the schema of a mapping whose keys are whole numbers."""
    return {"type": "object", "patternProperties": {r"^[0-9]+$": value}, "additionalProperties": False, **more}


NUMBER = {"type": "number"}
POSITIVE = {"type": "number", "exclusiveMinimum": 0}
TEXT = {"type": "string"}


def mapping(keys: Mapping[str, Key], required: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    """Return the schema of a mapping with these keys and no others."""
    properties = {name: {"description": key.text, **key.schema} for name, key in keys.items()}
    entry: dict[str, Any] = {"type": "object", "additionalProperties": False, "properties": properties}
    return entry | ({"required": list(required)} if required else {}) | more


class FieldError(InputError):
    """A value of a lens file that cannot be used: ``FILE:LINE:COL: key.path: text (got ...)``.

    Attributes
    ----------
    path : tuple of str or int
        Keys that lead to the value.
    text : str
        What is wrong, or what would be right.
    """

    def __init__(self, where: str, path: KeyPath, text: str, got: Any = None) -> None:
        shown = "" if got is None else f" (got {_short(got)})"
        key = f"{dotted(path)}: " if path else ""
        super().__init__(f"{where}: {key}{text}{shown}")
        self.path = path
        self.text = text


class Fields:
    """One mapping of a lens file, whose keys are taken one by one."""

    def __init__(self, document: Document, path: KeyPath, allowed: Iterable[str]) -> None:
        self.document = document
        self.path = path
        value = value_at(document, path)
        if not isinstance(value, dict):
            raise problem(document, path, "expected a mapping of keys to values", value)
        self.value: Mapping[Any, Any] = value
        names = sorted(allowed)
        for key in value:
            if key not in names:
                near = difflib.get_close_matches(str(key), names, n=1)
                hint = f"did you mean {near[0]}?" if near else f"allowed: {', '.join(names)}"
                line, column = document.key_mark((*path, key))
                raise FieldError(f"{document.name}:{line}:{column}", (*path, key), f"unknown key ({hint})")

    def __contains__(self, key: str) -> bool:
        return key in self.value

    def get(self, key: str) -> Any:
        """Return the raw value of a key, None when absent."""
        return self.value.get(key)

    def fail(self, key: str | None, text: str) -> FieldError:
        """Return the error for a key, or for the mapping itself."""
        path = self.path if key is None else (*self.path, key)
        return problem(self.document, path, text, self.value.get(key) if key is not None else None)

    def text(self, key: str, default: str = "") -> str:
        """Return a string."""
        value = self.value.get(key, default)
        if not isinstance(value, str):
            raise self.fail(key, "expected text")
        return value

    def flag(self, key: str) -> bool:
        """Return a truth value, False when absent."""
        value = self.value.get(key, False)
        if not isinstance(value, bool):
            raise self.fail(key, "expected true or false")
        return value

    def number(self, key: str, default: float | None = None, infinite: bool = False) -> float:
        """Return a number; without a default the key is required."""
        if key not in self.value:
            if default is None:
                raise self.fail(None, f"{key} is missing")
            return default
        return as_number(self.document, (*self.path, key), infinite)

    def positive(self, key: str, default: float | None = None) -> float:
        """Return a number above 0."""
        value = self.number(key, default)
        if not value > 0:
            raise self.fail(key, "must be above 0")
        return value

    def numbers(self, key: str) -> tuple[float, ...]:
        """Return a list of numbers."""
        value = self.value.get(key)
        if not isinstance(value, list) or not value:
            raise self.fail(key, "expected a list of numbers")
        return tuple(as_number(self.document, (*self.path, key, i)) for i in range(len(value)))

    def span(self, key: str, count: int) -> tuple[int, int]:
        """Return the first and last of neighbours, counted from 0, of which there are `count`."""
        span = self.numbers(key)
        if len(span) != 2 or any(part % 1 for part in span) or not 0 <= span[0] <= span[1] < count:
            raise self.fail(key, f"expected [first, last], two numbers from 0 to {count - 1}")
        return int(span[0]), int(span[1])

    def paths_by_number(self, key: str, least: int, most: int, fault: str) -> list[tuple[int, KeyPath]]:
        """Return the keys of a mapping, whole numbers from least to most, and the paths of their values."""
        numbers = []
        for name in self.value[key]:
            number = int(name) if isinstance(name, int) or (isinstance(name, str) and name.isdigit()) else least - 1
            path = (*self.path, key, name)
            if isinstance(name, bool) or not least <= number <= most:
                raise problem(self.document, path, fault, name)
            numbers.append((number, path))
        return numbers

    def inner(self, key: str, allowed: Iterable[str]) -> Fields:
        """Return the mapping that a key leads to."""
        return Fields(self.document, (*self.path, key), allowed)

    def rows(self, key: str, allowed: Iterable[str], example: str) -> list[Fields]:
        """Return the mappings of a list, none when it is absent."""
        rows = self.value.get(key) or []
        if not isinstance(rows, list):
            raise self.fail(key, f"expected a list such as {example}")
        return [Fields(self.document, (*self.path, key, i), allowed) for i in range(len(rows))]


def as_number(document: Document, path: KeyPath, infinite: bool = False) -> float:
    """Return the number at a key path."""
    value = value_at(document, path)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise problem(document, path, "expected a number", value)
    if not math.isfinite(value) and not (infinite and math.isinf(value)):
        raise problem(document, path, "must be finite", value)
    return float(value)


def problem(document: Document, path: KeyPath, text: str, got: Any = None) -> FieldError:
    """Return the error for the value at a key path."""
    return FieldError(document.where(path), path, text, got)


def value_at(document: Document, path: KeyPath) -> Any:
    """Return the value at a key path."""
    value = document.data
    for part in path:
        value = value[part]
    return value


def rises(wavelengths: tuple[float, ...]) -> bool:
    """Return whether wavelengths are above 0, each longer than the one before."""
    return wavelengths[0] > 0 and all(a < b for a, b in pairwise(wavelengths))


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
