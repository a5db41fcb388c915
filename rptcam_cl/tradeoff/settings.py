"""How a configuration is asked for: what to set in a scene."""

from __future__ import annotations

import json
from typing import Any

from rptcam_cl.scene import Scene

PARTS = ("film", "camera", "exposure", "shutter", "spectrum", "render")
NOT_SAID = ("spp", "layers")  # of `render`: what a render is asked for besides


def settings(scene: Scene, wanted: Scene) -> tuple[str, ...]:
    """Return what ``rptcam render --set`` takes to turn one scene into another that differs by such keys only."""
    return tuple(text for part in PARTS for text in _of_part(part, getattr(scene, part), getattr(wanted, part)))


def _of_part(part: str, own: Any, wanted: Any) -> list[str]:
    values = wanted.model_dump(mode="json", exclude_none=True)
    if type(own) is type(wanted):
        apart = [name for name in type(own).model_fields if getattr(own, name) != getattr(wanted, name)]
        return [_said(f"{part}.{name}", values.get(name)) for name in apart if name not in NOT_SAID]
    given = {name: values[name] for name in values if name in wanted.model_fields_set | {"kind"}}
    gone = [f"{part}.{name}=null" for name in own.model_fields_set if name not in given]
    apart = [name for name in given if getattr(own, name, None) != getattr(wanted, name)]
    by_key = [*gone, *(_said(f"{part}.{name}", given[name]) for name in apart)]
    return min(by_key, [_said(part, given)], key=lambda texts: len(" ".join(texts)))


def _said(path: str, value: Any) -> str:
    return f"{path}={value if isinstance(value, str) else json.dumps(value)}"
