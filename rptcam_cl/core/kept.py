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
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.resources import cache_dir, kernels_dir, package_dir

if TYPE_CHECKING:
    from numpy.typing import NDArray

STARTED = time.time()  # when this process had read hardly more than this
MOST_BYTES = 256 << 20  # of each kind
HASH_BYTES = 32
CODE = (".py", ".h", ".cl", ".csv", ".jsonl")  # what the files that decide a picture end in: code, and tables in it

Maker = dict[str, str]
"""What made a file: digest of the ``code``, versions of ``numpy`` and of the ``driver``."""
UNKNOWN: Maker = {"code": "unknown", "numpy": "unknown", "driver": "unknown"}


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
    import numpy as np  # late, as help texts need none of it

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
    import numpy as np

    files = [path for room in rooms for path in (package_dir() / room).rglob("*.py")]
    files += [path for folder in kernels for path in (kernels_dir() / folder).iterdir()]
    stats = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(files)]
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    return name_of(np.__version__, simd, platform.node(), platform.machine(), stats)


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Return what changes with a file of the package or of its kernels, and is the same wherever the same files lie.

    Of files that have changed since this process began it is one that no other has: what runs is not what lies there.
    """
    files = sorted([*_code(package_dir(), ""), *_code(kernels_dir(), "kernels/")])
    stats = [(path, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns) for _, path, stat in files]
    found = str(kept_or_found("code", name_of(stats), lambda: _digest([each[:2] for each in files])))
    changed = any(stat.st_mtime > STARTED for _, _, stat in files)
    return name_of(found, STARTED, platform.node(), os.getpid())[:16] if changed else found


def _code(folder: str | Path, place: str) -> Iterator[tuple[str, str, os.stat_result]]:
    """Yield the files of code below a folder: their names from ``place`` on, their paths, and what the system says."""
    for entry in os.scandir(folder):
        if entry.is_dir():
            if entry.name not in ("_data", "__pycache__"):
                yield from _code(entry.path, f"{place}{entry.name}/")
        elif entry.name.endswith(CODE):
            yield place + entry.name, entry.path, entry.stat()


def _digest(files: Sequence[tuple[str, str]]) -> str:
    """Return 16 letters of the SHA-256 of names and contents of files; how lines end in them does not count."""
    digest = hashlib.sha256()
    for name, path in files:
        content = Path(path).read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:16]


def made_by(drivers: Iterable[str]) -> Maker:
    """Return what a file says of the program that makes it, on devices with some drivers."""
    import numpy as np

    return {"code": code_digest(), "numpy": np.__version__, "driver": " + ".join(sorted(set(drivers)))}


def is_maker(data: Any) -> bool:
    """Return whether data are a `Maker`."""
    return isinstance(data, dict) and data.keys() == UNKNOWN.keys() and all(type(each) is str for each in data.values())


@dataclass
class OneMaker:
    """What becomes one thing is made by one program on one driver, unless others are allowed; these are named.

    Parameters
    ----------
    allow_mixed
        Whether others are joined all the same, with a warning.

    Attributes
    ----------
    makers : list of Maker
        All so far.
    first : str
        What the first of them made.
    """

    allow_mixed: bool = False
    makers: list[Maker] = field(default_factory=list)
    first: str = ""

    def add(self, name: str, makers: Any) -> None:
        """Join something of this name with what there is; ``makers`` is what it says of its makers, if it does.

        Raises
        ------
        StateError
            It is of another maker, or does not say of which, and that is not allowed.
        """
        found = makers if isinstance(makers, list) else [makers]
        for maker in [each if is_maker(each) else UNKNOWN for each in found] or [UNKNOWN]:
            if not self.makers:
                self.first = name
            elif maker == UNKNOWN or maker not in self.makers:
                text = f"{name}: {self._differs(maker)}"
                if not self.allow_mixed:
                    raise StateError(f"{text} (make both by one program on one driver, or join them by --allow-mixed)")
                warnings.warn(f"{text}; they are joined all the same", UserWarning, stacklevel=3)
            if maker not in self.makers:
                self.makers.append(maker)

    def _differs(self, maker: Maker) -> str:
        if maker == UNKNOWN:
            return f"says nothing of the code that made it, unlike {self.first}"
        known = self.makers[0]
        words = [
            f"its {name} is {value}, and that of {self.first} {known[name]}"
            for name, value in maker.items()
            if known[name] != value
        ]
        return "; ".join(words) or f"is made by several programs, unlike {self.first}"
