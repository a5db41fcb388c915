"""The page's modules and styles as one text each, for notebooks, which take no folder of files."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

_PAGE = Path(__file__).parent / "page"
_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w-]+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.MULTILINE)
_SHEET = re.compile(r'<link rel="stylesheet" href="([\w-]+\.css)">')


def _variable(module: str) -> str:
    return "module_" + module.replace("-", "_")


def _in_order(module: str, found: dict[str, str]) -> None:
    """Add a module and, before it, those that it imports, to the texts by name."""
    if module in found:
        return
    text = (_PAGE / f"{module}.js").read_text("utf-8")
    for needed in _IMPORT.findall(text):
        _in_order(needed[1], found)
    found[module] = text


def _enclosed(module: str, text: str) -> str:
    """Return a module as a function that is called at once, as names of two modules may be the same."""
    exported = ", ".join(_EXPORT.findall(text))
    inside = _EXPORT.sub("", _IMPORT.sub(lambda each: f"const {{{each[1]}}} = {_variable(each[2])};\n", text))
    return f"const {_variable(module)} = (() => {{\n{inside}\nreturn {{ {exported} }};\n}})();\n"


@cache
def module_text() -> str:
    """Return the widget's module with all that it imports, as anywidget takes it."""
    found: dict[str, str] = {}
    _in_order("widget", found)
    parts = [_enclosed(name, text) for name, text in found.items()]
    return "\n".join([*parts, f"export default {{ render: {_variable('widget')}.render }};\n"])


@cache
def style_text() -> str:
    """Return the page's styles in the order in which the page loads them."""
    names = _SHEET.findall((_PAGE / "index.html").read_text("utf-8"))
    return "\n".join((_PAGE / name).read_text("utf-8") for name in names)
