"""Checkpoints: the state of a render in one file, which is refused unless every byte of it is as it was written.

Magic, version and length of the header (little endian), the header as JSON, the arrays as they lie in memory (little
endian), and the SHA-256 of all that. Nothing in it is executed when it is read.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import StateError
from rptcam_cl.imaging.atomic import replacing

MAGIC = b"RPTCAMCK"
VERSION = 1
SUFFIX = ".rpck"
_START = struct.Struct("<8sII")
_MOST_HEADER = 1 << 16
_TYPES = {"<f4", "<f8", "<u4", "<u8"}
_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class Checkpoint:
    """What a file holds: facts about the render, and arrays by name."""

    facts: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


def write_checkpoint(
    path: str | os.PathLike[str], facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write a checkpoint, whole or not at all.

    Raises
    ------
    StateError
        The file cannot be written; one that was there before is as it was.
    """
    little = {name: np.ascontiguousarray(array, array.dtype.newbyteorder("<")) for name, array in arrays.items()}
    listed = [{"name": name, "type": array.dtype.str, "shape": array.shape} for name, array in little.items()]
    header = json.dumps({"facts": dict(facts), "arrays": listed}, sort_keys=True).encode()
    digest = hashlib.sha256()
    with replacing(path) as temporary, temporary.open("xb") as stream:
        for piece in (
            _START.pack(MAGIC, VERSION, len(header)),
            header,
            *(array.tobytes() for array in little.values()),
        ):
            stream.write(piece)
            digest.update(piece)
        stream.write(digest.digest())


def read_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Return what a checkpoint holds.

    Raises
    ------
    StateError
        The file cannot be read, is something else, damaged, or of a later version.
    """
    try:
        size = Path(path).stat().st_size
        with Path(path).open("rb") as stream:
            start = stream.read(_START.size)
            length = _header_length(path, start)
            header = stream.read(length)
            places = _places(path, header, size - _START.size - length - _DIGEST)
            digest = hashlib.sha256(start + header)
            arrays = {}
            for name, kind, shape in places:
                data = stream.read(math.prod(shape) * np.dtype(kind).itemsize)
                digest.update(data)
                arrays[name] = np.frombuffer(data, kind).reshape(shape) if len(data) else np.zeros(shape, kind)
            facts = json.loads(header)["facts"]
            if not isinstance(facts, dict) or stream.read() != digest.digest():
                raise _damaged(path)
    except OSError as error:
        raise StateError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, MemoryError) as error:
        raise _damaged(path) from error
    return Checkpoint(facts, arrays)


def _damaged(path: str | os.PathLike[str]) -> StateError:
    return StateError(f"{path}: this saved render is damaged (remove it, or render without --resume)")


def _header_length(path: str | os.PathLike[str], start: bytes) -> int:
    if len(start) < _START.size or not start.startswith(MAGIC):
        raise StateError(f"{path}: is not a saved render (remove it, or render without --resume)")
    _, version, length = _START.unpack(start)
    if version > VERSION:
        raise StateError(f"{path}: was saved by a later version (its format is {version}; this one reads {VERSION})")
    if length > _MOST_HEADER:
        raise _damaged(path)
    return int(length)


def _places(path: str | os.PathLike[str], header: bytes, size: int) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return name, type and shape of the arrays; they must fill ``size`` bytes, so that no memory is promised away."""
    found, total = [], 0
    for entry in json.loads(header)["arrays"]:
        kind, shape = entry["type"], tuple(int(length) for length in entry["shape"])
        if kind not in _TYPES or min(shape, default=0) < 0:
            raise _damaged(path)
        found.append((str(entry["name"]), kind, shape))
        total += math.prod(shape) * np.dtype(kind).itemsize
    if total != size:
        raise _damaged(path)
    return found
