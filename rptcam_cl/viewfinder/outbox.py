"""What waits to be sent to one client: answers in their order, and of everything else only the newest."""

from __future__ import annotations

import json
import math
import struct
import threading
from collections.abc import Callable, Hashable, Mapping
from dataclasses import asdict, is_dataclass
from typing import Any

from rptcam_cl.core.dataclass import dataclass

MOST_UNACKNOWLEDGED = 2  # frames on their way to a client
MOST_ANSWERS = 512  # that a client may leave unread


@dataclass(frozen=True)
class FrameData:
    """A frame without its number: header and image bytes."""

    header: Mapping[str, Any]
    data: bytes


def plain(value: Any) -> Any:
    """Return a value as JSON can say it: arrays are lists, records mappings, and what is not finite is None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, list | tuple):
        return plain(value._asdict()) if hasattr(value, "_asdict") else [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_text(message: Mapping[str, Any]) -> str:
    """Return a message as JSON text, in which what is not finite is null."""
    return json.dumps(plain(message), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def as_bytes(header: Mapping[str, Any], data: bytes) -> bytes:
    """Return a binary message: length of the header, header, data."""
    text = as_text(header).encode()
    return struct.pack("<I", len(text)) + text + data


class Outbox:
    """Messages for one client; any thread may put, one takes.

    Parameters
    ----------
    wake : callable
        Called, from any thread, when there is something to take.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._answers: list[str | bytes] = []
        self._news: dict[Hashable, Mapping[str, Any]] = {}
        self._frames: dict[Hashable, FrameData] = {}
        self._under_way: set[int] = set()
        self._last_number = 0
        self.overflowed = False

    def answer(self, message: Mapping[str, Any], data: bytes | None = None) -> None:
        """Add a message that is sent whatever comes after it."""
        with self._lock:
            if len(self._answers) >= MOST_ANSWERS:
                self.overflowed = True
            else:
                self._answers.append(as_text(message) if data is None else as_bytes(message, data))
        self._wake()

    def news(self, key: Hashable, message: Mapping[str, Any]) -> None:
        """Add a message that replaces an earlier one of its key."""
        with self._lock:
            self._news[key] = message
        self._wake()

    def frame(self, key: Hashable, frame: FrameData) -> None:
        """Add a frame that replaces an earlier one of its key, and takes its place."""
        with self._lock:
            self._frames[key] = frame
        self._wake()

    def acknowledged(self, number: int) -> None:
        """Note that a frame has arrived."""
        with self._lock:
            self._under_way.discard(number)
        self._wake()

    @property
    def has_room(self) -> bool:
        """Whether a frame that is made now could leave."""
        return len(self._under_way) + len(self._frames) < MOST_UNACKNOWLEDGED

    @property
    def is_clear(self) -> bool:
        """Whether the client has all frames that were made for it."""
        return not (self._under_way or self._frames)

    def take(self) -> list[str | bytes]:
        """Return what can be sent now."""
        with self._lock:
            found: list[str | bytes] = list(self._answers)
            found += [as_text(message) for message in self._news.values()]
            self._answers.clear()
            self._news.clear()
            while self._frames and len(self._under_way) < MOST_UNACKNOWLEDGED:
                frame = self._frames.pop(next(iter(self._frames)))
                self._last_number += 1
                self._under_way.add(self._last_number)
                found.append(as_bytes({**frame.header, "frame": self._last_number}, frame.data))
            return found
