"""Small things kept on disk between runs: what a driver's trial showed, and programs of drivers that keep none.

They may be lost at any time and can never break a run: what cannot be read or written is as if it had not been kept.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from pathlib import Path

from rptcam_cl.core.resources import cache_dir

MOST_BYTES = 256 << 20  # of each kind


def kept_bytes(kind: str, name: str) -> bytes | None:
    """Return what is kept under a name, and mark it as used; None where there is nothing."""
    path = cache_dir(kind) / name
    try:
        content = path.read_bytes()
    except OSError:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return content


def keep_bytes(kind: str, name: str, content: bytes) -> None:
    """Keep something under a name, whole or not at all; the least recently used makes room for it."""
    folder = cache_dir(kind)
    temporary = folder / f".{name}-{secrets.token_hex(4)}.tmp"
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with temporary.open("xb") as file:
                file.write(content)
            temporary.replace(folder / name)
        finally:
            temporary.unlink(missing_ok=True)
        _make_room(folder)


def _make_room(folder: Path) -> None:
    found = sorted((path.stat().st_mtime, path.stat().st_size, path) for path in folder.iterdir())
    excess = sum(size for _, size, _ in found) - MOST_BYTES
    for _, size, path in found:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size
