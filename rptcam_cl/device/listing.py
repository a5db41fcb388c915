"""Lists of devices in one word: ``0:0,1:0``, as in ``RPTCAM_DEVICE``."""

from __future__ import annotations

import os
import re

_INDEX = re.compile(r"\d+(:\d+)?")
ALL = "all"


def listed(spec: str) -> list[str]:
    """Return the devices that ``spec`` lists: indices with commas between them, else the one that it is."""
    words = [word.strip() for word in spec.split(",")]
    return words if all(_INDEX.fullmatch(word) for word in words) else [spec.strip()]


def several_of_environment() -> list[str] | None:
    """Return the devices that ``RPTCAM_DEVICE`` lists, where they are several or "all"; else None."""
    words = listed(os.environ.get("RPTCAM_DEVICE", ""))
    return words if len(words) > 1 or words == [ALL] else None


def first_listed(spec: str | None) -> str | None:
    """Return the device that a command takes that takes one: the first of a list, the best of all."""
    if spec is None:
        return None
    first = listed(spec)[0]
    return "auto" if first.lower() == ALL else first
