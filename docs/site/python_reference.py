"""The Python interface, written from signatures and docstrings, with the examples of docs/python-examples.md."""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from functools import cache, cached_property
from types import ModuleType
from typing import Any

from pydantic import BaseModel

from docs.site.contents import ROOT, linked
from docs.site.docstrings import as_markdown

# Rooms and modules that programs may import; the others serve them and may change without notice.
ROOMS = (
    "", "optics", "optics.spots", "scene", "core.colour", "imaging", "studies.focus",
    "studies.tiers", "rendering.tolerance_run", "batch", "viewfinder",
)  # fmt: skip
PROPERTIES = (property, cached_property)
EXAMPLES = "docs/python-examples.md"
FOLDER = "reference/python"  # of these pages in the site


def module_of(room: str) -> ModuleType:
    """The module of a room; that of the empty name is ``rptcam_cl`` itself."""
    return importlib.import_module(f"rptcam_cl.{room}".rstrip("."))


def room_page(room: str) -> str:
    """The page of a room: what it is for, an example, and each public name."""
    module = module_of(room)
    text = f"# {module.__name__}\n\n{as_markdown(inspect.getdoc(module) or '')}\n"
    if example := examples().get(module.__name__):
        text += f"\nAn example:\n\n{example}\n"
    if not room:
        return text + "".join(entry(module, name) for name in sorted(module.__all__, key=str.lower))
    for each in modules_of(module):
        text += "" if each is module else f"\n## {each.__name__}\n\n{as_markdown(inspect.getdoc(each) or '')}\n"
        text += "".join(entry(each, name) for name in public_names(each))
    return text


def modules_of(module: ModuleType) -> list[ModuleType]:
    """A module, or the modules of a package: not those of the packages within, nor those with pages of their own."""
    if not hasattr(module, "__path__"):
        return [module]
    names = [f"{module.__name__}.{each.name}" for each in pkgutil.iter_modules(module.__path__) if not each.ispkg]
    return [importlib.import_module(name) for name in names if name.partition(".")[2] not in ROOMS]


def public_names(module: ModuleType) -> list[str]:
    """Classes and functions that a module defines, without those that are private, by name."""
    values = vars(module).items()
    named = [name for name, value in values if getattr(value, "__module__", "") == module.__name__]
    return sorted((name for name in named if not name.startswith("_")), key=str.lower)


@cache
def examples() -> dict[str, str]:
    """Examples by the heading that they stand under."""
    text = linked(EXAMPLES, (ROOT / EXAMPLES).read_text("utf-8"), FOLDER)
    sections = re.split(r"^##(#?) (.+)\n", text, flags=re.MULTILINE)
    found = zip(sections[1::3], sections[2::3], sections[3::3], strict=True)
    return {name: text.strip() for deep, names, text in found if deep for name in names.split(", ")}


def entry(module: ModuleType, name: str) -> str:
    """The section of one public name."""
    value = getattr(module, name)
    text = f"\n## {name}\n\n"
    if not (inspect.isclass(value) or inspect.isfunction(value)):
        return text + constant(name, value)
    text += f"```python\n{signature(name, value)}\n```\n\n{as_markdown(inspect.getdoc(value) or '')}\n"
    if inspect.isclass(value) and not issubclass(value, BaseException):
        text += "".join(members(value))
    if not module.__name__.partition(".")[2] and name in examples():
        text += f"\nAn example:\n\n{examples()[name]}\n"
    return text


def constant(name: str, value: Any) -> str:
    """A value, where it is short, or what it is."""
    shown = repr(value)
    if len(shown) > 200 or "0x" in shown:
        shown = f"{type(value).__name__} of {len(value)}" if hasattr(value, "__len__") else type(value).__name__
    return f"`{shown}`\n"


def signature(name: str, value: Any) -> str:
    """How something is called, one argument a line where there are many."""
    try:
        found = inspect.signature(value)
    except ValueError:
        return f"class {name}"
    if inspect.isclass(value) and issubclass(value, BaseModel):
        return f"class {name}  # its attributes are keys of a file"
    parts = list(parameters(found))
    has_result = not inspect.isclass(value) and found.return_annotation is not found.empty
    result = f" -> {inspect.formatannotation(found.return_annotation)}".replace("'", "") if has_result else ""
    line = f"{name}({', '.join(parts)}){result}"
    return line if len(line) <= 100 else f"{name}(\n    " + ",\n    ".join(parts) + f",\n){result}"


STARS = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}


def parameters(found: inspect.Signature) -> Iterator[str]:
    """Each argument as it is written, with the star before those that go by name alone."""
    starred = False
    for parameter in found.parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            yield "*"
        starred = starred or parameter.kind in (parameter.KEYWORD_ONLY, parameter.VAR_POSITIONAL)
        text = STARS.get(parameter.kind, "") + parameter.name
        if parameter.annotation is not parameter.empty:
            text += f": {inspect.formatannotation(parameter.annotation)}".replace("'", "")
        if parameter.default is not parameter.empty:
            default = repr(parameter.default)
            text += f" = {'…' if '<' in default or len(default) > 60 else default}"
        yield text


def members(value: type) -> list[str]:
    """Methods and properties that a class has of its own, with their docstrings."""
    texts = []
    for name, member in list(vars(value).items()):
        plain = getattr(member, "__func__", member)
        if name.startswith("_") or not (isinstance(member, PROPERTIES) or inspect.isfunction(plain)):
            continue
        if not (doc := inspect.getdoc(member)):
            continue
        shown = name if isinstance(member, PROPERTIES) else signature(name, plain)
        texts.append(f"\n### {value.__name__}.{name}\n\n```python\n{shown}\n```\n\n{as_markdown(doc)}\n")
    return texts
