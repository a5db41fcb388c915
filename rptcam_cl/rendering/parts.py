"""The record of which device took which samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Part = dict[str, Any]
"""``samples``: first and end; ``split``: shares by device, as ``--split`` takes them; ``dropped``: devices and why."""


def split_text(shares: Mapping[str, float]) -> str:
    """Return shares by device as ``--split`` takes them."""
    return ",".join(f"{identity}={share:.15g}" for identity, share in shares.items())


def split_of(text: str) -> dict[str, float]:
    """Return shares by device of what `split_text` returned."""
    return {identity: float(share) for identity, _, share in (part.rpartition("=") for part in text.split(","))}


def begun(parts: Sequence[Part], first: int, split: str, dropped: Mapping[str, str] | None = None) -> list[Part]:
    """Return the parts with one more, from sample ``first`` on; what was recorded of later samples gives way."""
    gone: dict[str, str] = {}
    for part in parts:
        if part["samples"][0] >= first:
            gone |= part.get("dropped", {})
    gone |= dropped or {}
    kept = [part for part in parts if part["samples"][0] < first]
    return [*kept, {"samples": [first, first], "split": split} | ({"dropped": gone} if gone else {})]


def ended(parts: Sequence[Part], done: int) -> list[Part]:
    """Return the parts of which each ends where the next begins, the last after ``done`` samples."""
    ends = [*(part["samples"][0] for part in parts[1:]), done][: len(parts)]
    found = [part | {"samples": [part["samples"][0], end]} for part, end in zip(parts, ends, strict=True)]
    return [part for part in found if part["samples"][1] > part["samples"][0]]


def joined(earlier: Sequence[Part], later: Sequence[Part]) -> list[Part]:
    """Return the parts of a render before and after it was interrupted; those with the same shares as one."""
    if not earlier or not later or {"dropped"} & (earlier[-1].keys() | later[0].keys()):
        return [*earlier, *later]
    if earlier[-1]["split"] != later[0]["split"]:
        return [*earlier, *later]
    both = later[0] | {"samples": [earlier[-1]["samples"][0], later[0]["samples"][1]]}
    return [*earlier[:-1], both, *later[1:]]


def is_shared(parts: Sequence[Part]) -> bool:
    """Return whether more than one device took part."""
    return (
        any("dropped" in part for part in parts)
        or len({device for part in parts for device in split_of(part["split"])}) > 1
    )
