"""A scene of ours as YAML text: sections in their usual order, one object a line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import yaml

SECTIONS = (
    "metres_per_unit", "film", "camera", "exposure", "render", "picture", "materials", "meshes", "objects", "lights",
    "environment",
)  # fmt: skip
_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def plain(value: Any) -> Any:
    """Return a copy without NumPy's numbers and arrays, no two parts of which are the same list."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return plain(value.tolist()) if isinstance(value, np.ndarray | np.generic) else value


def scene_text(scene: Mapping[str, Any], comments: tuple[str, ...] = ()) -> str:
    """Return the YAML text of a scene."""
    lines = [f"# {line}" for comment in comments for line in comment.splitlines()]
    for name in SECTIONS:
        if name in scene:
            lines += _section(name, scene[name])
    return "\n".join([*lines, ""])


def _section(name: str, value: Any) -> Iterator[str]:
    if name in ("objects", "lights"):
        yield f"{name}:"
        yield from (f"  - {_flow(item)}" for item in value)
    elif name in ("materials", "meshes"):
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
