"""What the commands print: JSON that every reader accepts, and numbers for people."""

import json
import math
from typing import Any


def _plain(value: Any) -> Any:
    """The value with what JSON cannot say (infinity, not-a-number) as null and NumPy scalars as Python's."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def as_json(value: Any) -> str:
    """The value as indented JSON text."""
    return json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def as_bytes(count: float) -> str:
    """A number of bytes for people, as ``15.6 GiB``."""
    for unit in ("B", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.4g} {unit}"
        count /= 1024
    return f"{count:.4g} GiB"
