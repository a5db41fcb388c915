"""Names of the parameters of kernels, read from the source text of a program, so that arguments are bound by name.

A parameter may depend on the facts of the program, and lists of them are macros (``SCENE_PARAMETERS`` of
``kernels/common/scene.h``). So conditions and macros are resolved here as a C preprocessor does it, as far as the heads
of kernels need it. OpenCL can report the names, too, but not every driver does, and none of a program that it has kept.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

Macros = dict[str, tuple[tuple[str, ...] | None, str]]  # parameters, None for a macro without, and body

_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*|\\\n", re.DOTALL)
_DIRECTIVE = re.compile(r"\s*#\s*(define|undef|ifdef|ifndef|if|elif|else|endif)\b\s*(.*)")
_DEFINITION = re.compile(r"(\w+)(?:\(([^)]*)\))?\s*(.*)")
_DEFINED = re.compile(r"\bdefined\s*\(?\s*(\w+)\s*\)?")
_KERNEL = re.compile(r"__kernel\s+void\s+(\w+)\s*\((.*)\)\s*\{")
_WORD = re.compile(r"\b[A-Za-z_]\w*")


def kernel_parameters(source: str) -> dict[str, tuple[str, ...]]:
    """Return the names of the parameters of every kernel of a program, in their order."""
    macros: Macros = {}
    found: dict[str, tuple[str, ...]] = {}
    head = ""
    for line in _active_lines(_COMMENT.sub(" ", source), macros):
        if head or line.lstrip().startswith("__kernel"):
            head += f" {line}"
            if "{" in line:
                kernel = _KERNEL.match(_expanded(head.lstrip(), macros))
                assert kernel is not None, head
                found[kernel[1]] = tuple(_WORD.findall(each)[-1] for each in kernel[2].split(","))
                head = ""
    return found


def _active_lines(text: str, macros: Macros) -> Iterator[str]:
    """Yield the lines that conditions leave; keep ``macros`` as they are at each of them."""
    taken: list[tuple[bool, bool]] = []  # of each open condition: whether its branch at hand is in, and any before it
    active = True  # all of them are in
    for line in text.splitlines():
        directive = _DIRECTIVE.match(line) if "#" in line else None  # most lines have none, and a look costs less
        if directive is None:
            if active:
                yield line
            continue
        word, rest = directive.groups()
        if word in ("if", "ifdef", "ifndef"):
            holds = active and _holds(rest if word == "if" else f"{'!' * (word == 'ifndef')}defined({rest})", macros)
            taken.append((holds, holds))
            active = holds
        elif word in ("elif", "else"):
            _, before = taken.pop()
            outside = all(branch for branch, _ in taken)
            active = outside and not before and (word == "else" or _holds(rest, macros))
            taken.append((active, before or active))
        elif word == "endif":
            taken.pop()
            active = all(branch for branch, _ in taken)
        elif active and word == "undef":
            macros.pop(rest.strip(), None)
        elif active:
            _define(rest, macros)


def _define(rest: str, macros: Macros) -> None:
    match = _DEFINITION.match(rest)
    assert match is not None
    name, parameters, body = match.groups()
    macros[name] = (None if parameters is None else tuple(each.strip() for each in parameters.split(",")), body)


def _holds(condition: str, macros: Macros) -> bool:
    """Return whether the condition of an ``#if`` holds; a name that is no macro counts as 0."""
    text = _DEFINED.sub(lambda match: str(int(match[1] in macros)), condition)
    text = _WORD.sub("0", _expanded(text, macros))
    text = re.sub(r"(?<=\d)[uUlL]+\b", "", text).replace("&&", " and ").replace("||", " or ")
    return bool(eval(re.sub(r"!(?!=)", " not ", text), {"__builtins__": {}}))  # digits and operators of our own kernels


def _expanded(text: str, macros: Macros, within: frozenset[str] = frozenset()) -> str:
    """Return a text with its macros in place, but those ``within`` whose expansion it stands."""
    out, position = "", 0
    while match := _WORD.search(text, position):
        name = match[0]
        out += text[position : match.start()]
        position = match.end()
        if name not in macros or name in within:
            out += name
            continue
        parameters, body = macros[name]
        if parameters is not None:
            given, position = _arguments(text, position)
            values = dict(zip(parameters, given, strict=True))
            body = _WORD.sub(lambda word, values=values: values.get(word[0], word[0]), body)  # type: ignore[misc]
        out += _expanded(body, macros, within | {name})
    return out + text[position:]


def _arguments(text: str, position: int) -> tuple[list[str], int]:
    """Return the arguments of a macro from its opening bracket on, and where the text goes on behind them."""
    depth, begin, found = 0, text.index("(", position) + 1, []
    for place in range(begin - 1, len(text)):
        depth += {"(": 1, ")": -1}.get(text[place], 0)
        if depth == 0 or (depth == 1 and text[place] == ","):
            found.append(text[begin:place].strip())
            begin = place + 1
        if depth == 0:
            return found, begin
    raise AssertionError(f"brackets do not close: {text}")
