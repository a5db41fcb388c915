"""Statements of pbrt files: a directive with its arguments, in the order in which included files bring them."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.references import Folders
from rptcam_cl.importers.pbrt.parameters import Parameters, read_parameters
from rptcam_cl.importers.pbrt.source import Place, read_source
from rptcam_cl.importers.pbrt.tokens import Token, Tokens, number_of

# Numbers after a directive.
NUMBERS = {"LookAt": 9, "Translate": 3, "Scale": 3, "Rotate": 4, "Transform": 16, "ConcatTransform": 16,
           "TransformTimes": 2}  # fmt: skip
BARE = ("WorldBegin", "WorldEnd", "AttributeBegin", "AttributeEnd", "TransformBegin", "TransformEnd", "ObjectEnd",
        "ReverseOrientation", "Identity")  # fmt: skip
# Texts after a directive, and whether parameters follow.
TEXTS = {
    "Include": 1, "Import": 1, "CoordinateSystem": 1, "CoordSysTransform": 1, "NamedMaterial": 1, "ObjectBegin": 1,
    "ObjectInstance": 1, "ColorSpace": 1, "MediumInterface": 2,
}  # fmt: skip
WITH_PARAMETERS = {
    "Camera": 1, "Film": 1, "Sampler": 1, "Integrator": 1, "PixelFilter": 1, "Accelerator": 1, "Material": 1,
    "MakeNamedMaterial": 1, "MakeNamedMedium": 1, "LightSource": 1, "AreaLightSource": 1, "Shape": 1, "Attribute": 1,
    "Texture": 3, "Option": 0, "SurfaceIntegrator": 1, "VolumeIntegrator": 1, "Renderer": 1, "Volume": 1,
}  # fmt: skip
OLDER = ("SearchPath", "Exterior", "Interior")
DIRECTIVES = (*NUMBERS, *BARE, *TEXTS, *WITH_PARAMETERS, "ActiveTransform")

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


@dataclass
class _Open:
    """A file that is being read, by its real path."""

    path: Path
    tokens: Tokens
    imported: Place | None = None


def read_statements(path: Path) -> Iterator[Statement]:
    """Yield the statements of a scene file and of the files that it includes.

    Names of files start at the folder of the scene file, as pbrt has it. An imported file stands between
    ``AttributeBegin`` and ``AttributeEnd``: its state does not reach beyond it.
    """
    stack = [_Open(path.resolve(), Tokens(read_source(path, str(path))))]
    files = 1
    while stack:
        token = stack[-1].tokens.take()
        if token is None:
            if (place := stack.pop().imported) is not None:
                yield Statement("AttributeEnd", place)
            continue
        statement = _statement(token, stack[-1].tokens)
        if statement.directive not in ("Include", "Import"):
            yield statement
            continue
        files += 1
        if files > MOST_FILES:
            raise statement.place.error(f"more than {MOST_FILES} files are included")
        imported = statement.place if statement.directive == "Import" else None
        if imported is not None:
            yield Statement("AttributeBegin", statement.place)
        stack.append(_included(statement, path.parent, stack))
        stack[-1].imported = imported


def _included(statement: Statement, folder: Path, stack: list[_Open]) -> _Open:
    (name,) = statement.texts
    try:
        real = Folders(folder, owner="pbrt scene").find(name)
        if any(level.path == real for level in stack):
            raise InputError(f"{name} includes itself, by way of {len(stack)} files")
        return _Open(real, Tokens(read_source(real, str(folder / name))))
    except RptcamError as problem:
        raise statement.place.error(f"{statement.directive}: {problem}") from None


def _statement(token: Token, tokens: Tokens) -> Statement:
    name = token.text
    if token.kind != "word" or name not in DIRECTIVES:
        raise token.place.error(_no_directive(token))
    if name in NUMBERS:
        return Statement(name, token.place, numbers=_numbers(tokens, token, NUMBERS[name]))
    if name in BARE:
        return Statement(name, token.place)
    if name == "ActiveTransform":
        return Statement(name, token.place, (_active(tokens, token),))
    if name in TEXTS:
        texts = _texts(tokens, token, TEXTS[name])
        return Statement(name, token.place, texts)
    texts = _texts(tokens, token, WITH_PARAMETERS[name])
    what = " ".join([name, *(f'"{text}"' for text in texts)])
    return Statement(name, token.place, texts, parameters=read_parameters(tokens, what, token.place))


def _no_directive(token: Token) -> str:
    if token.text in OLDER:
        return f"{token.text} is a directive of pbrt-v1 or of LuxRender (allowed: scenes of pbrt-v2, v3 and v4)"
    matches = difflib.get_close_matches(token.text, DIRECTIVES, n=1)
    hint = f"; did you mean {matches[0]}?" if matches else " such as Shape or Camera"
    return f"expected a directive (got {token.shown()}){hint}"


def _numbers(tokens: Tokens, directive: Token, count: int) -> NDArray[np.float64]:
    """Take the numbers of a directive, with brackets or without."""
    listed = tokens.numbers_in_brackets()
    if listed is None:
        values: list[float] = []
        while len(values) < count:
            token = tokens.take()
            if token is None:
                raise directive.place.error(f"{directive.text} needs {count} numbers (got {len(values)})")
            if token.kind != "bracket":
                values.append(number_of(token))
            elif token.text == "]" or values:
                raise token.place.error(f"{directive.text} needs {count} numbers (got {len(values)})")
        listed = np.array(values)
        if (token := tokens.peek()) is not None and token.kind == "bracket" and token.text == "]":
            tokens.take()
    if len(listed) != count:
        raise directive.place.error(f"{directive.text} needs {count} numbers (got {len(listed)})")
    return listed


def _texts(tokens: Tokens, directive: Token, count: int) -> tuple[str, ...]:
    """Take the quoted texts of a directive; a MediumInterface may have one instead of two."""
    found: list[str] = []
    while len(found) < count:
        token = tokens.peek()
        if token is None or token.kind != "string":
            if directive.text == "MediumInterface" and found:
                break
            got = "the end of the file" if token is None else token.shown()
            raise directive.place.error(f"{directive.text} needs {count} text{'s' * (count > 1)} in quotes (got {got})")
        tokens.take()
        found.append(token.text)
    return tuple(found)


def _active(tokens: Tokens, directive: Token) -> str:
    token = tokens.take()
    allowed = ("StartTime", "EndTime", "All")
    if token is None or token.text not in allowed:
        got = "the end of the file" if token is None else token.shown()
        raise directive.place.error(f"ActiveTransform needs one of {', '.join(allowed)} (got {got})")
    return token.text
