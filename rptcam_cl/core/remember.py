"""Long work remembered by all that it follows from, in memory and on disk between runs.

What is on disk may be lost at any time and can never break a run: what cannot be read or written, or is damaged, is as
if it had not been kept. Its name is a hash of all that it follows from, the code of this package among it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
import json
import math
import os
import pickle
import platform
import secrets
import shutil
import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import field
from functools import lru_cache, wraps
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, TypeVar
from weakref import WeakSet

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.files import cache_dir, kernels_dir, package_dir

if TYPE_CHECKING:
    from numpy.typing import NDArray


Arguments = ParamSpec("Arguments")
Value = TypeVar("Value")

_MISSING: Any = object()


class Memory(Generic[Value]):
    """The values that were used last, by their keys; threads may share it.

    Parameters
    ----------
    most
        How many there are at most.
    most_bytes
        What all of them take at most, by ``nbytes`` of each; one that is larger alone is not taken.
    """

    def __init__(self, most: float = math.inf, most_bytes: float = math.inf) -> None:
        self.most, self.most_bytes = most, most_bytes
        self._values: OrderedDict[Hashable, Value] = OrderedDict()  # what was used last comes last
        self._lock = Lock()

    def __contains__(self, key: Hashable) -> bool:
        return key in self._values

    def values(self) -> list[Value]:
        """Return all values, the one that was used last at the end."""
        with self._lock:
            return list(self._values.values())

    def find(self, key: Hashable, default: Any = None) -> Any:
        """Return the value of a key, which counts as used, or a default."""
        with self._lock:
            if key not in self._values:
                return default
            self._values.move_to_end(key)
            return self._values[key]

    def add(self, key: Hashable, value: Value) -> None:
        """Add a value; those that have not been used for longest make room."""
        with self._lock:
            if self._bytes([value]) > self.most_bytes:
                return
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > self.most or self._bytes(self._values.values()) > self.most_bytes:
                self._values.popitem(last=False)

    def make_room(self) -> None:
        """Forget what has not been used for longest, so that one more value fits: before it takes memory."""
        with self._lock:
            while self._values and len(self._values) >= self.most:
                self._values.popitem(last=False)

    def find_or_make(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the value of a key, made where there is none. It is shared, so nobody may change it.

        Two threads that want the same value at the same time make it both.
        """
        value: Value = self.find(key, _MISSING)
        if value is _MISSING:
            value = make()
            self.add(key, value)
        return value

    def clear(self) -> None:
        """Forget all values."""
        with self._lock:
            self._values.clear()

    def _bytes(self, values: Iterable[Any]) -> int:
        return 0 if self.most_bytes == math.inf else sum(value.nbytes for value in values)


_memories: WeakSet[Memory[Any]] = WeakSet()  # of remembered functions


def remember(
    *, most: int, by: Callable[..., Hashable] | None = None, disk: Disk | None = None
) -> Callable[[Callable[Arguments, Value]], Callable[Arguments, Value]]:
    """Make a function remember what it returned, which is shared, so that nobody may change it.

    Parameters
    ----------
    most
        How many values are kept in memory; the least recently used makes room.
    by
        Returns the key of a call, equal where the results are the same: content, no identities. Without it, the
        arguments are the key.
    disk
        Where values are kept from one run to the next as well; keys are then such that `content_name` takes them.
    """

    def decorate(function: Callable[Arguments, Value]) -> Callable[Arguments, Value]:
        memory: Memory[Value] = Memory(most)
        _memories.add(memory)
        name = f"{function.__module__}.{function.__qualname__}" if disk else ""

        @wraps(function)
        def remembered(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
            key = (args, *sorted(kwargs.items())) if by is None else by(*args, **kwargs)

            def make() -> Value:
                if disk is None:
                    return function(*args, **kwargs)
                return disk.find_or_make((name, key), lambda: function(*args, **kwargs))

            return memory.find_or_make(key, make)

        return remembered

    return decorate


def forget(*kinds: str) -> None:
    """Forget what functions remember in memory, and what is on disk of some kinds."""
    for memory in list(_memories):
        memory.clear()
    for kind in kinds:
        shutil.rmtree(cache_dir(kind), ignore_errors=True)


# On disk: arrays and what JSON holds, behind their hash, in a file that is the old one or the whole new one.

MOST_BYTES = 256 << 20  # of each kind
_HASH_BYTES = 32
_STRAY_S = 3600  # after which a file that is still being written has been left behind

Arrays = dict[str, "NDArray[Any]"]
Facts = dict[str, Any]


def _pack_plain(value: Any) -> tuple[Arrays, Facts]:
    return {}, {"value": value}


def _unpack_plain(_: Arrays, facts: Facts) -> Any:
    return facts["value"]


@dataclass(frozen=True)
class Disk:
    """Values of one kind that are kept on disk from one run to the next; the least recently used makes room.

    Parameters
    ----------
    kind
        Folder of the cache.
    rooms, kernels
        Whose code decides the values: folders of the package, and of the kernels. Without rooms, the keys say it.
    pack
        Returns the arrays that a value consists of, and the rest as JSON holds it. Without it, JSON holds the value.
    unpack
        The way back.
    most_bytes
        Of all files of the kind; what is larger alone is not kept.
    """

    kind: str
    rooms: tuple[str, ...] = ()
    kernels: tuple[str, ...] = ()
    pack: Callable[[Any], tuple[Mapping[str, NDArray[Any]], Mapping[str, Any]]] = _pack_plain
    unpack: Callable[[Arrays, Facts], Any] = _unpack_plain
    most_bytes: int | None = None

    def find(self, key: object, default: Any = None) -> Any:
        """Return the value of a key, which counts as used; the default where there is none, or a damaged one."""
        path = self._path(key)
        try:
            content = path.read_bytes()
        except OSError:
            return default
        if hashlib.sha256(memoryview(content)[_HASH_BYTES:]).digest() != content[:_HASH_BYTES]:
            return default
        with contextlib.suppress(OSError):
            os.utime(path)
        return self.unpack(*_read_content(content))

    def add(self, key: object, value: Any) -> None:
        """Keep a value, whole or not at all; now and then what has not been used for longest makes room."""
        path, most = self._path(key), MOST_BYTES if self.most_bytes is None else self.most_bytes
        pieces = _content_pieces(*self.pack(value))
        size = sum(len(piece) for piece in pieces)
        if size > most:
            return
        temporary = path.with_name(f".{path.name}-{secrets.token_hex(4)}.tmp")
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                with temporary.open("xb") as file:
                    file.writelines(pieces)
                temporary.replace(path)
            finally:
                temporary.unlink(missing_ok=True)
            if path.name.startswith("0") or size > most // 256:  # small things: one in sixteen looks at all
                _make_room(path.parent, most)

    def find_or_make(self, key: object, make: Callable[[], Value]) -> Value:
        """Return the value of a key; where there is none, it is made and kept."""
        value: Value = self.find(key, _MISSING)
        if value is _MISSING:
            value = make()
            self.add(key, value)
        return value

    def _path(self, key: object) -> Path:
        code = identity_of_code(self.rooms, self.kernels) if self.rooms else ""
        return cache_dir(self.kind) / content_name(code, key)


def _content_pieces(arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> list[bytes | memoryview]:
    """Lay out a file: its hash, a line of JSON, and the numbers of all arrays."""
    import numpy as np  # late, as help texts need none of it

    whole = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    shapes = [[name, array.dtype.str, array.shape] for name, array in whole.items()]
    head = json.dumps({"arrays": shapes, "facts": dict(facts)}).encode() + b"\n"
    pieces: list[bytes | memoryview] = [head]
    pieces += [array.reshape(-1).view(np.uint8).data for array in whole.values()]
    digest = hashlib.sha256()
    for piece in pieces:
        digest.update(piece)
    return [digest.digest(), *pieces]


def _read_content(content: bytes) -> tuple[Arrays, Facts]:
    place = content.index(b"\n", _HASH_BYTES) + 1
    head = json.loads(content[_HASH_BYTES:place])
    arrays = {}
    for name, dtype, shape in head["arrays"]:
        import numpy as np

        array = np.frombuffer(content, dtype, math.prod(shape), place).reshape(shape).copy()
        arrays[name] = array
        place += array.nbytes
    return arrays, head["facts"]


def _make_room(folder: Path, most_bytes: int) -> None:
    """Remove what has not been used for longest until the rest is small enough, and the remains of killed runs."""
    for stray in folder.glob(".*.tmp"):
        if stray.stat().st_mtime < time.time() - _STRAY_S:
            stray.unlink(missing_ok=True)
    files = sorted((path.stat().st_mtime, path.stat().st_size, path) for path in folder.iterdir())
    excess = sum(size for _, size, _ in files) - most_bytes
    for _, size, path in files:
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= size


class _ContentPickler(pickle.Pickler):
    """Writes equal values alike, be they one object or several, and of dataclasses the fields alone."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, protocol=5)
        self.fast = True  # without references to what came before

    def reducer_override(self, value: Any) -> Any:
        """Return how a dataclass is written; others as usual."""
        if isinstance(value, type) or not dataclasses.is_dataclass(value):
            return NotImplemented
        return type(value), tuple(getattr(value, each.name) for each in dataclasses.fields(value))


def content_name(*parts: object) -> str:
    """Return a name, 64 letters, of plain values, arrays and dataclasses; it differs where a bit of them does."""
    content = io.BytesIO()
    _ContentPickler(content).dump(parts)
    return hashlib.sha256(content.getbuffer()).hexdigest()


#
# The code that something was made by: what changes with it must not be taken for what it would make now.

STARTED = time.time()  # when this process had read hardly more than this
CODE = (".py", ".h", ".cl", ".csv", ".jsonl")  # what the files that decide a picture end in: code, and tables in it

Maker = dict[str, str]
"""What made a file: digest of the ``code``, versions of ``numpy`` and of the ``driver``."""
UNKNOWN: Maker = {"code": "unknown", "numpy": "unknown", "driver": "unknown"}


@lru_cache(maxsize=16)
def identity_of_code(rooms: tuple[str, ...], kernels: tuple[str, ...] = ()) -> str:
    """Name this machine, its numpy and the code of some rooms and folders of kernels, as they are now.

    What is kept under it is what would be computed anew, bit by bit.
    """
    import numpy as np

    folders = [package_dir() / room for room in rooms]
    assert all(map(Path.is_dir, folders)), rooms
    files = [path for folder in folders for path in folder.rglob("*.py")]
    files += [path for folder in kernels for path in (kernels_dir() / folder).iterdir()]
    stats = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(files)]
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    return content_name(np.__version__, simd, platform.node(), platform.machine(), stats)


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Digest the files of the package and its kernels: the same wherever the same files lie.

    Of files that have changed since this process began it is one that no other has: what runs is not what lies there.
    """
    files = code_files()
    stats = [(path, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns) for _, path, stat in files]
    digest = Disk("code").find_or_make(stats, lambda: _digest([each[:2] for each in files]))
    changed = any(stat.st_mtime > STARTED for _, _, stat in files)
    return content_name(digest, STARTED, platform.node(), os.getpid())[:16] if changed else digest


def code_files() -> list[tuple[str, str, os.stat_result]]:
    """List the files that decide a picture: their names, their paths, and what the system says of them."""
    return sorted([*_code(package_dir(), ""), *_code(kernels_dir(), "kernels/")])


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
    """Describe this program, with its drivers, for a file that it makes."""
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
        claims = makers if isinstance(makers, list) else [makers]
        for maker in [each if is_maker(each) else UNKNOWN for each in claims] or [UNKNOWN]:
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


# Long work that can be given up: whoever does it for somebody asks at each step whether it is still wanted.

_CHECK: ContextVar[Callable[[], None] | None] = ContextVar("whether work is still wanted", default=None)


class CancelledError(Exception):
    """Nobody wants the work any more."""


def checkpoint() -> None:
    """Raise what ends the work under way, or wait, where `cancellable` says so; nothing otherwise."""
    check = _CHECK.get()
    if check is not None:
        check()


def is_cancellable() -> bool:
    """Whether somebody is asked at checkpoints, so that the device's queue is to be kept short between them."""
    return _CHECK.get() is not None


@contextlib.contextmanager
def cancellable(check: Callable[[], None]) -> Iterator[None]:
    """Have ``check`` called at every checkpoint that this thread comes to; it may wait, or raise a CancelledError."""
    token = _CHECK.set(check)
    try:
        yield
    finally:
        _CHECK.reset(token)
