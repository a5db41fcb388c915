"""A session that follows Blender's scene: what differs from the last export is changed, the rest stays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import rptcam_cl
from rptcam_cl import RenderSession

from .apart import SessionApart

WHOLE = ("camera", "environment")  # sections that are set as a whole: a key that is gone takes its default then


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Changes, as `RenderSession.change` takes them, that make one scene of the other.

    Lists of one length and mappings of the same names are compared item by item, so that one object that moves is one
    change.
    """
    changes: dict[str, Any] = {}
    for name in [*after, *(name for name in before if name not in after)]:
        one, other = before.get(name), after.get(name)
        if is_same(one, other):
            continue
        if name in WHOLE or one is None or other is None:
            changes[name] = other
        elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
            pairs = zip(one, other, strict=True)
            changes |= {f"{name}.{i}": item for i, (was, item) in enumerate(pairs) if not is_same(was, item)}
        elif isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
            changes |= {f"{name}.{key}": item for key, item in other.items() if not is_same(one[key], item)}
        else:
            changes[name] = other
    return changes


def is_same(one: Any, other: Any) -> bool:
    """Whether two parts of a scene are equal, arrays in them by content."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and np.array_equal(one, other)
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(is_same(value, other[key]) for key, value in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(is_same(*pair) for pair in zip(one, other, strict=True))
    return bool(one == other)


class LiveScene:
    """A session and the export that it shows."""

    def __init__(self) -> None:
        self._device: str | None = None
        self._is_apart = False
        self._keys: dict[str, Any] = {}
        self.session: RenderSession | SessionApart | None = None

    def use(self, device: str, *, apart: bool = False) -> None:
        """Render on a device, as `RenderSession` names it, empty for the fastest; in a process of its own if wanted."""
        if ((device or None), apart) != (self._device, self._is_apart):
            self.close()
            self._device, self._is_apart = device or None, apart

    def show(self, keys: dict[str, Any]) -> RenderSession | SessionApart:
        """Make the session show an export."""
        if isinstance(self.session, SessionApart) and self.session.has_ended:
            self.session = None
        if self.session is None:
            self.session = (SessionApart if self._is_apart else RenderSession)(keys, device=self._device)
        else:
            changes = differences(self._keys, keys)
            if changes:
                self.session.change(changes)
        self._keys = keys
        return self.session

    def render(self, keys: dict[str, Any], **options: Any) -> Any:
        """Render another scene, where this one is rendered."""
        if isinstance(self.session, SessionApart):
            return self.session.call("render", keys, options | {"device": self._device})
        return rptcam_cl.render(keys, **options, device=None if self.session is None else self.session.device)

    def close(self) -> None:
        """Let go of the device."""
        if self.session is not None:
            self.session.close()
            self.session = None


def focused(keys: dict[str, Any], method: str, point: tuple[float, float] | None = None, *, apart: bool) -> Any:
    """What autofocus finds at a point of the picture, else in its middle; in a process of its own if wanted."""
    if not apart:
        return rptcam_cl.autofocus(keys, method, point=point)
    session = SessionApart(None, None)
    try:
        return session.call("autofocus", keys, {"method": method, "point": point})
    finally:
        session.close()
