"""Small things kept on disk between runs: trials and programs of drivers, tables of lenses, small trees.

They may be lost at any time and can never break a run: what cannot be read or written is as if it had not been kept.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import platform
import secrets
import shutil
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.resources import cache_dir, kernels_dir, package_dir

MOST_BYTES = 256 << 20  # of each kind
HASH_BYTES = 32


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
    """Keep something under a name, whole or not at all; now and then the least recently used makes room."""
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
        if name.startswith("0") or len(content) > MOST_BYTES // 256:  # small things: one in sixteen looks at all
            _make_room(folder)


def _make_room(folder: Path) -> None:
    found = sorted((path.stat().st_mtime, path.stat().st_size, path) for path in folder.iterdir())
    excess = sum(size for _, size, _ in found) - MOST_BYTES
    for _, size, path in found:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size


def forget(kind: str) -> None:
    """Delete all that is kept of a kind."""
    shutil.rmtree(cache_dir(kind), ignore_errors=True)


def name_of(*parts: object) -> str:
    """Return the name of what follows from some parts, which their texts tell apart."""
    return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()


def keep_arrays(kind: str, name: str, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> None:
    """Keep arrays of numbers, and what JSON holds, under a name."""
    shapes = [[key, array.dtype.str, array.shape] for key, array in arrays.items()]
    head = json.dumps({"arrays": shapes, "facts": dict(facts)}).encode()
    content = b"".join([head, b"\n", *(array.tobytes() for array in arrays.values())])
    keep_bytes(kind, name, hashlib.sha256(content).digest() + content)


def kept_arrays(kind: str, name: str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]] | None:
    """Return the arrays kept under a name and what was kept with them; None where there are none, or damaged ones."""
    kept = kept_bytes(kind, name) or b""
    content = kept[HASH_BYTES:]
    if hashlib.sha256(content).digest() != kept[:HASH_BYTES]:
        return None
    head, _, numbers = content.partition(b"\n")
    found = json.loads(head)
    arrays, place = {}, 0
    for key, dtype, shape in found["arrays"]:
        count = math.prod(shape)
        arrays[key] = np.frombuffer(numbers, dtype, count, place).reshape(shape).copy()
        place += arrays[key].nbytes
    return arrays, found["facts"]


def kept_or_found(kind: str, name: str, find: Callable[[], Any]) -> Any:
    """Return what is kept under a name, else what ``find`` returns, which is kept: what JSON holds, with all bits."""
    kept = kept_arrays(kind, name)
    if kept is not None:
        return kept[1]["found"]
    found = find()
    keep_arrays(kind, name, {}, {"found": found})
    return found


@lru_cache(maxsize=16)
def identity_of_code(rooms: tuple[str, ...], kernels: tuple[str, ...] = ()) -> str:
    """Return what changes with this machine, its numpy and the code of some rooms, and of some folders of kernels.

    What is kept under it is what would be computed anew, bit by bit.
    """
    files = [path for room in rooms for path in (package_dir() / room).rglob("*.py")]
    files += [path for folder in kernels for path in (kernels_dir() / folder).iterdir()]
    stats = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(files)]
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    return name_of(np.__version__, simd, platform.node(), platform.machine(), stats)
