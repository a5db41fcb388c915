"""Text of pbrt files: tokens, statements and parameter lists."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Sequence
from dataclasses import field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.files import Folders
from rptcam_cl.exchange.conversion import Place, Source, read_limited

# What one file may hold, unpacked: far more than the largest published scenes have in one text file.
_MAX_BYTES = 1 << 30


def _read_source(path: Path, name: str) -> Source:
    """Return the text of a pbrt file; one that ends in .gz is unpacked.

    Raises
    ------
    InputError
        When it is missing, not a regular file, too large or no text.
    StateError
        When it cannot be read.
    """
    raw = read_limited(path, name, _MAX_BYTES)
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"{name}:1:1: is UTF-16 text; save it as UTF-8")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")  # comments of old exporters; names of files stay what the bytes say
    if (index := text.find("\0")) >= 0:
        raise Place(Source(name, text, path), index).error("contains a NUL byte; this is not a text file")
    return Source(name, text.replace("\r\n", "\n").replace("\r", "\n"), path)


# TokenStream of a pbrt file: words, quoted strings, brackets; comments begin with #.

_TOKEN = re.compile(
    r"""(?P<blank>\s+|\#[^\n]*) | (?P<string>"(?:[^"\\\n]|\\.)*") | (?P<bracket>[\[\]]) | (?P<word>[^\s"\[\]#]+)""",
    re.VERBOSE,
)
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_ESCAPES = {"b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t", "\\": "\\", "'": "'", '"': '"'}
_LONGEST_SHOWN = 60


@dataclass(frozen=True)
class Token:
    """A token: ``kind`` is string, bracket or word; ``text`` that of a string is without quotes and escapes."""

    kind: str
    text: str
    place: Place

    def shown(self) -> str:
        """Return the token as an error quotes it."""
        text = f'"{self.text}"' if self.kind == "string" else self.text
        return text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "…"


class TokenStream:
    """The tokens of one file, one after another."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self._offset = 0
        self._ahead: Token | None = None

    def peek(self) -> Token | None:
        """Return the next token without taking it; None at the end of the file."""
        if self._ahead is None:
            self._ahead = self._read()
        return self._ahead

    def take(self) -> Token | None:
        """Return the next token; None at the end of the file."""
        token, self._ahead = self.peek(), None
        return token

    def numbers_in_brackets(self) -> NDArray[np.float64] | None:
        """Take a bracketed list that holds nothing but numbers at once; None, taking nothing, when it holds more.

        The long lists of meshes are read here, at the speed of ``str.split``.
        """
        opening = self.peek()
        if opening is None or opening.text != "[" or opening.kind != "bracket":
            return None
        text, start = self.source.text, opening.place.offset + 1
        end = text.find("]", start)
        if end < 0:
            raise opening.place.error("this [ is never closed")
        inside = text[start:end]
        if any(mark in inside for mark in '"#[_') or "n" in inside.lower():
            return None
        try:
            numbers = np.array(inside.split(), np.float64)
        except ValueError:
            return None
        if not np.isfinite(numbers).all():
            return None
        self._ahead, self._offset = None, end + 1
        return numbers

    def _read(self) -> Token | None:
        text = self.source.text
        while self._offset < len(text):
            place = Place(self.source, self._offset)
            match = _TOKEN.match(text, self._offset)
            if match is None:  # only a quotation mark begins no token
                raise place.error('this " has no partner on its line')
            self._offset = match.end()
            if match.lastgroup == "string":
                return Token("string", _unescape(match[0][1:-1], place), place)
            if match.lastgroup != "blank":
                return Token(str(match.lastgroup), match[0], place)
        return None


def _number_of(token: Token) -> float:
    """Return the number that a word says."""
    if token.kind != "word" or not _NUMBER.fullmatch(token.text):
        raise token.place.error(f"expected a number (got {token.shown()})")
    number = float(token.text)
    if abs(number) == float("inf"):
        raise token.place.error(f"{token.shown()} is beyond the range of numbers (about 1.8e308)")
    return number


def _unescape(text: str, place: Place) -> str:
    if "\\" not in text:
        return text

    def replaced(match: re.Match[str]) -> str:
        if match[1] not in _ESCAPES:
            known = " ".join(f"\\{mark}" for mark in _ESCAPES)
            raise place.error(f"unknown escape \\{match[1]} in a string (allowed: {known}; folders end in /)")
        return _ESCAPES[match[1]]

    return re.sub(r"\\(.)", replaced, text)


# Parameter lists of pbrt directives: read, looked up by name; those that were never looked up are reported.

Values = NDArray[np.float64] | tuple[str, ...] | tuple[bool, ...]

# Numbers in one value of each type; "" for types whose values are words.
_SIZES = {
    "float": 1, "integer": 1, "point": 3, "point2": 2, "point3": 3, "vector": 3, "vector2": 2, "vector3": 3,
    "normal": 3, "normal3": 3, "rgb": 3, "color": 3, "xyz": 3, "blackbody": 1, "spectrum": 1,
}  # fmt: skip
_WORDS = ("string", "texture", "spectrum")
_TYPES = (*_SIZES, "bool", "string", "texture")
_BOOLS = {"true": True, "false": False}


@dataclass(frozen=True, eq=False)
class Parameter:
    """One parameter, such as ``"rgb Kd" [.5 .4 .3]``.

    Attributes
    ----------
    kind : str
        Its type, a key of `_SIZES` or one of `_WORDS` or ``bool``.
    values : array of float64, or tuple of str or of bool
    place : Place
    """

    kind: str
    name: str
    values: Values
    place: Place


@dataclass(eq=False)
class Parameters:
    """The parameters of one directive.

    Attributes
    ----------
    what : str
        The directive, for messages.
    place : Place
        Where the directive stands.
    items : dict of str to Parameter
        By name; of a name that is given more than once the last.
    used : set of str
        Names that were looked up.
    repeated : list of Parameter
        Those in whose place a later one of the same name came.
    """

    what: str
    place: Place
    items: dict[str, Parameter] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    repeated: list[Parameter] = field(default_factory=list)

    def get(self, name: str, *kinds: str) -> Parameter | None:
        """Return a parameter of one of some types, None when there is none of the name.

        One of another type is none, as in pbrt, which looks parameters up by name and type: it stays unused, and is
        reported.
        """
        item = self.items.get(name)
        if item is None or (kinds and item.kind not in kinds):
            return None
        self.used.add(name)
        return item

    def numbers(self, name: str, *kinds: str) -> NDArray[np.float64] | None:
        """Return the numbers of a parameter, None when it is absent."""
        item = self.get(name, *(kinds or ("float",)))
        return None if item is None else np.asarray(item.values, np.float64)

    def number(self, name: str, default: float, *kinds: str) -> float:
        """Return a single number."""
        values = self.numbers(name, *kinds)
        return default if values is None else float(self._single(name, list(values)))

    def integer(self, name: str, default: int) -> int:
        """Return a single whole number."""
        value = self.number(name, default, "integer", "float")
        if value != int(value):
            raise self.error(name, f"must be a whole number (got {value:g})")
        return int(value)

    def boolean(self, name: str, default: bool) -> bool:
        """Return a truth value; pbrt-v3 writes it as text."""
        item = self.get(name, "bool", "string")
        if item is None:
            return default
        value = self._single(name, list(item.values))
        if isinstance(value, str):
            if value not in _BOOLS:
                raise self.error(name, f'must be true or false (got "{value}")')
            return _BOOLS[value]
        return bool(value)

    def text(self, name: str, default: str) -> str:
        """Return a single text."""
        item = self.get(name, "string")
        return default if item is None else str(self._single(name, list(item.values)))

    def vector(self, name: str, default: Sequence[float]) -> NDArray[np.float64]:
        """Return a point, vector or normal, shape (3,)."""
        values = self.numbers(name, "point", "point3", "vector", "vector3", "normal", "normal3")
        if values is None:
            return np.asarray(default, np.float64)
        if len(values) != 3:
            raise self.error(name, f"needs 3 numbers (got {len(values)})")
        return values

    def rows(self, name: str, width: int, *kinds: str) -> NDArray[np.float64] | None:
        """Return a list of points or vectors, shape (n, width)."""
        values = self.numbers(name, *kinds)
        if values is None:
            return None
        if len(values) % width:
            raise self.error(name, f"holds {len(values)} numbers, not a multiple of {width}")
        return values.reshape(-1, width)

    def has(self, name: str) -> bool:
        """Return whether there is a parameter of a name; asking does not use it up."""
        return name in self.items

    def skip(self, *names: str) -> None:
        """Use up parameters that change speed, noise or naming only."""
        self.used.update(names)

    def skip_all(self) -> None:
        """Use up all parameters, where what they say is reported as a whole."""
        self.used.update(self.items)

    def error(self, name: str, problem: str) -> InputError:
        """Return the error of a parameter, at its place."""
        return self.items[name].place.error(f'{self.what}: "{name}" {problem}')

    def unused(self) -> Iterator[Parameter]:
        """Yield the parameters that were never looked up."""
        return (item for name, item in self.items.items() if name not in self.used)

    def _single(self, name: str, values: list[float] | list[str] | list[bool]) -> float | str | bool:
        if len(values) != 1:
            raise self.error(name, f"needs one value (got {len(values)})")
        return values[0]


def _read_parameters(tokens: TokenStream, what: str, place: Place) -> Parameters:
    """Take the parameters that follow in a file, up to the next directive."""
    parameters = Parameters(what, place)
    while (token := tokens.peek()) is not None and token.kind == "string":
        tokens.take()
        kind, name = _declaration(token, what)
        if name in parameters.items:
            parameters.repeated.append(parameters.items.pop(name))
        parameters.items[name] = Parameter(kind, name, _values(tokens, token, kind), token.place)
    return parameters


def _declaration(token: Token, what: str) -> tuple[str, str]:
    words = token.text.split()
    if len(words) != 2:
        raise token.place.error(f'{what}: expected a parameter such as "float fov" (got {token.shown()})')
    kind, name = words
    if kind not in _TYPES:
        raise token.place.error(f"{what}: unknown type {kind} of parameter {name} (allowed: {', '.join(_TYPES)})")
    return kind, name


def _values(tokens: TokenStream, declared: Token, kind: str) -> Values:
    values: Values | None = tokens.numbers_in_brackets()
    if values is None:
        values = _of_words(_take_values(tokens, declared), declared)
    is_text = isinstance(values, tuple) and all(isinstance(value, str) for value in values)
    name = declared.shown()
    if isinstance(values, tuple) and not is_text and kind != "bool":
        raise declared.place.error(f"{name} must hold numbers or text, not true or false")
    if kind == "bool" and isinstance(values, np.ndarray) and len(values):
        raise declared.place.error(f"{name} must hold true or false")
    if is_text and values and kind not in (*_WORDS, "bool"):
        raise declared.place.error(f"{name} must hold numbers, not text")
    if kind in ("string", "texture") and isinstance(values, np.ndarray):
        raise declared.place.error(f"{name} must hold text in quotes")
    if isinstance(values, np.ndarray) and len(values) % _SIZES.get(kind, 1):
        raise declared.place.error(f"{name} holds {len(values)} numbers, not a multiple of {_SIZES[kind]}")
    return values


def _take_values(tokens: TokenStream, declared: Token) -> list[Token]:
    """Take the value, or the values in brackets, of a parameter."""
    token = tokens.take()
    if token is None:
        raise declared.place.error(f"{declared.shown()} has no value: the file ends here")
    if token.kind != "bracket":
        return [token]
    if token.text == "]":
        raise token.place.error(f"expected the value of {declared.shown()} (got ])")
    values = []
    while (item := tokens.take()) is not None:
        if item.kind != "bracket":
            values.append(item)
        elif item.text == "]":
            return values
        else:
            raise item.place.error(f"a second [ in the values of {declared.shown()}")
    raise token.place.error("this [ is never closed")


def _of_words(tokens: list[Token], declared: Token) -> Values:
    if tokens and tokens[0].kind == "string":
        for token in tokens:
            if token.kind != "string":
                raise token.place.error(f"{declared.shown()} mixes text with other values (got {token.shown()})")
        return tuple(token.text for token in tokens)
    if tokens and tokens[0].text in _BOOLS:
        for token in tokens:
            if token.text not in _BOOLS or token.kind != "word":
                raise token.place.error(f"expected true or false (got {token.shown()})")
        return tuple(_BOOLS[token.text] for token in tokens)
    if tokens and re.match(r"[A-Z]", tokens[0].text):
        raise declared.place.error(f"{declared.shown()} has no value; {tokens[0].shown()} follows")
    return np.array([_number_of(token) for token in tokens], np.float64)


# Statements of pbrt files: a directive with its arguments, in the order in which included files bring them.

# Numbers after a directive.
NUMBERS = {"LookAt": 9, "Translate": 3, "Scale": 3, "Rotate": 4, "Transform": 16, "ConcatTransform": 16,
           "TransformTimes": 2}  # fmt: skip
_BARE = ("WorldBegin", "WorldEnd", "AttributeBegin", "AttributeEnd", "TransformBegin", "TransformEnd", "ObjectEnd",
        "ReverseOrientation", "Identity")  # fmt: skip
# Texts after a directive, and whether parameters follow.
_TEXTS = {
    "Include": 1, "Import": 1, "CoordinateSystem": 1, "CoordSysTransform": 1, "NamedMaterial": 1, "ObjectBegin": 1,
    "ObjectInstance": 1, "ColorSpace": 1, "MediumInterface": 2,
}  # fmt: skip
_WITH_PARAMETERS = {
    "Camera": 1, "Film": 1, "Sampler": 1, "Integrator": 1, "PixelFilter": 1, "Accelerator": 1, "Material": 1,
    "MakeNamedMaterial": 1, "MakeNamedMedium": 1, "LightSource": 1, "AreaLightSource": 1, "Shape": 1, "Attribute": 1,
    "Texture": 3, "Option": 0, "SurfaceIntegrator": 1, "VolumeIntegrator": 1, "Renderer": 1, "Volume": 1,
}  # fmt: skip
_OLDER = ("SearchPath", "Exterior", "Interior")
_DIRECTIVES = (*NUMBERS, *_BARE, *_TEXTS, *_WITH_PARAMETERS, "ActiveTransform")

# Files that one scene may include, counted each time; the largest published scene has some thousand.
MOST_FILES = 20_000


@dataclass(frozen=True, eq=False)
class Statement:
    """A directive with what follows it.

    Attributes
    ----------
    texts : tuple of str
        Its words and quoted texts.
    numbers : float64 array
    """

    directive: str
    place: Place
    texts: tuple[str, ...] = ()
    numbers: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    parameters: Parameters | None = None

    def with_parameters(self) -> Parameters:
        """Return the parameters of a directive that takes some."""
        assert self.parameters is not None
        return self.parameters

    def described(self) -> str:
        """Return directive and type, as messages name them."""
        return " ".join([self.directive, *(f'"{text}"' for text in self.texts)])


def read_statements(path: Path, folders: Folders | None = None) -> Iterator[Statement]:
    """Yield the statements of a scene file and of the files that it includes.

    Names of files start at the folder of the scene file, as pbrt has it. An imported file stands between
    ``AttributeBegin`` and ``AttributeEnd``: its state does not reach beyond it.

    Parameters
    ----------
    folders
        Where included files may lie; by default the folder of the scene file and those below it.
    """
    folders = folders or Folders(path.parent, owner="pbrt scene")
    # files that are being read: their real paths, and where they are imported
    stack: list[tuple[Path, TokenStream, Place | None]] = [
        (path.resolve(), TokenStream(_read_source(path, str(path))), None)
    ]
    files = 1
    while stack:
        _, tokens, imported = stack[-1]
        token = tokens.take()
        if token is None:
            stack.pop()
            if imported is not None:
                yield Statement("AttributeEnd", imported)
            continue
        statement = _statement(token, tokens)
        if statement.directive not in ("Include", "Import"):
            yield statement
            continue
        files += 1
        if files > MOST_FILES:
            raise statement.place.error(f"more than {MOST_FILES} files are included")
        imported = statement.place if statement.directive == "Import" else None
        if imported is not None:
            yield Statement("AttributeBegin", statement.place)
        real, tokens = _open_included(statement, folders, [level[0] for level in stack])
        stack.append((real, tokens, imported))


def _open_included(statement: Statement, folders: Folders, including: list[Path]) -> tuple[Path, TokenStream]:
    """Return the real path of a file that a statement of others includes, and its tokens."""
    (name,) = statement.texts
    try:
        real = folders.find(name)
        if real in including:
            raise InputError(f"{name} includes itself, by way of {len(including)} files")
        return real, TokenStream(_read_source(real, str(folders.base / name)))
    except RptcamError as problem:
        raise statement.place.error(f"{statement.directive}: {problem}") from None


def _statement(token: Token, tokens: TokenStream) -> Statement:
    name = token.text
    if token.kind != "word" or name not in _DIRECTIVES:
        raise token.place.error(_no_directive(token))
    if name in NUMBERS:
        return Statement(name, token.place, numbers=_numbers(tokens, token, NUMBERS[name]))
    if name in _BARE:
        return Statement(name, token.place)
    if name == "ActiveTransform":
        return Statement(name, token.place, (_active(tokens, token),))
    if name in _TEXTS:
        texts = _texts(tokens, token, _TEXTS[name])
        return Statement(name, token.place, texts)
    texts = _texts(tokens, token, _WITH_PARAMETERS[name])
    what = " ".join([name, *(f'"{text}"' for text in texts)])
    return Statement(name, token.place, texts, parameters=_read_parameters(tokens, what, token.place))


def _no_directive(token: Token) -> str:
    if token.text in _OLDER:
        return f"{token.text} is a directive of pbrt-v1 or of LuxRender (allowed: scenes of pbrt-v2, v3 and v4)"
    matches = difflib.get_close_matches(token.text, _DIRECTIVES, n=1)
    hint = f"; did you mean {matches[0]}?" if matches else " such as Shape or Camera"
    return f"expected a directive (got {token.shown()}){hint}"


def _numbers(tokens: TokenStream, directive: Token, count: int) -> NDArray[np.float64]:
    """Take the numbers of a directive, with brackets or without."""
    listed = tokens.numbers_in_brackets()
    if listed is None:
        values: list[float] = []
        while len(values) < count:
            token = tokens.take()
            if token is None:
                raise directive.place.error(f"{directive.text} needs {count} numbers (got {len(values)})")
            if token.kind != "bracket":
                values.append(_number_of(token))
            elif token.text == "]" or values:
                raise token.place.error(f"{directive.text} needs {count} numbers (got {len(values)})")
        listed = np.array(values)
        if (token := tokens.peek()) is not None and token.kind == "bracket" and token.text == "]":
            tokens.take()
    if len(listed) != count:
        raise directive.place.error(f"{directive.text} needs {count} numbers (got {len(listed)})")
    return listed


def _texts(tokens: TokenStream, directive: Token, count: int) -> tuple[str, ...]:
    """Take the quoted texts of a directive; a MediumInterface may have one instead of two."""
    texts: list[str] = []
    while len(texts) < count:
        token = tokens.peek()
        if token is None or token.kind != "string":
            if directive.text == "MediumInterface" and texts:
                break
            got = "the end of the file" if token is None else token.shown()
            raise directive.place.error(f"{directive.text} needs {count} text{'s' * (count > 1)} in quotes (got {got})")
        tokens.take()
        texts.append(token.text)
    return tuple(texts)


def _active(tokens: TokenStream, directive: Token) -> str:
    token = tokens.take()
    allowed = ("StartTime", "EndTime", "All")
    if token is None or token.text not in allowed:
        got = "the end of the file" if token is None else token.shown()
        raise directive.place.error(f"ActiveTransform needs one of {', '.join(allowed)} (got {got})")
    return token.text
