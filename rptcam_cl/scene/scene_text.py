"""A scene's data as YAML text: sections in their usual order, one object a line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import yaml

from rptcam_cl.core.strict_yaml import parse_scalar
from rptcam_cl.scene.scene import Scene

_LISTS, _NAMED = ("objects", "lights"), ("materials", "meshes")
_LibDumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class _Dumper(_LibDumper):  # type: ignore[misc]
    """Writes text in quotes where YAML 1.2 would read it as something else; PyYAML alone goes by YAML 1.1."""


def _text(dumper: Any, value: str) -> Any:
    try:
        is_text = isinstance(parse_scalar(value), str)
    except ValueError:
        is_text = False
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=None if is_text else '"')


_Dumper.add_representer(str, _text)


def plain(value: Any) -> Any:
    """Return a copy without NumPy's numbers and arrays, no two parts of which are the same list."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return plain(value.tolist()) if isinstance(value, np.ndarray | np.generic) else value


def scene_text(scene: Mapping[str, Any], comments: tuple[str, ...] = ()) -> str:
    """Return the YAML text of a scene's data; comments stand above it."""
    lines = [f"# {line}" for comment in comments for line in comment.splitlines()]
    for name in Scene.model_fields:
        if name in scene:
            lines += _section(name, plain(scene[name]))
    return "\n".join([*lines, ""])


def _section(name: str, value: Any) -> Iterator[str]:
    if name in _LISTS and value:
        yield f"{name}:"
        yield from (f"  - {_flow(item)}" for item in value)
    elif name in _NAMED and value:
        yield f"{name}:"
        yield from (f"  {_flow(key)}: {_flow(item)}" for key, item in value.items())
    else:
        yield f"{name}: {_flow(value)}"


def _flow(value: Any) -> str:
    """Return a value on one line."""
    text: str = yaml.dump(
        value, Dumper=_Dumper, default_flow_style=True, sort_keys=False, width=1 << 30, allow_unicode=True
    )
    return text.removesuffix("...\n").rstrip("\n")
