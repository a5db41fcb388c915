"""What a key of a lens file is: its meaning and the JSON schema of its value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rptcam_cl.core.dataclass import dataclass


@dataclass(frozen=True)
class Key:
    """A key: its meaning in one line, and the JSON schema of its value."""

    text: str
    schema: Mapping[str, Any]


def numbers(least: int, most: int | None = None) -> dict[str, Any]:
    """Return the schema of a list of numbers."""
    return {"type": "array", "items": NUMBER, "minItems": least} | ({} if most is None else {"maxItems": most})


def by_number(value: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return the schema of a mapping whose keys are whole numbers."""
    return {"type": "object", "patternProperties": {r"^[0-9]+$": value}, "additionalProperties": False, **more}


NUMBER = {"type": "number"}
POSITIVE = {"type": "number", "exclusiveMinimum": 0}
TEXT = {"type": "string"}


def mapping(keys: Mapping[str, Key], required: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    """Return the schema of a mapping with these keys and no others."""
    properties = {name: {"description": key.text, **key.schema} for name, key in keys.items()}
    entry: dict[str, Any] = {"type": "object", "additionalProperties": False, "properties": properties}
    return entry | ({"required": list(required)} if required else {}) | more
