"""The processor that PoCL compiles for: named anew where PoCL's own name for it makes its compiler fail.

PoCL 3.0, the one that pip installs, carries LLVM 14. On a processor that is newer than that, it tells its own clang
either ``generic``, which clang refuses on x86-64, so that nothing compiles at all, or the name of an older relative
without AVX-512, while its library of built-ins is the one for AVX-512, so that vectors of 16 do not compile (Zen 4 is
taken for ``znver3``). See pocl issues 512 and 1049. PoCL 3.0 has no option for it. Its record of the device holds a
pointer to the name, next to the one to the target triple; here it is set to a name that LLVM 14 knows.

Delete this file when the oldest PoCL that pip may bring is 5.0 or newer.
"""

from __future__ import annotations

import ctypes
import re
import struct
from pathlib import Path
from typing import Any

AVX512 = frozenset({"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"})  # what Skylake-X has
AVX2 = frozenset({"avx2", "fma", "bmi1", "bmi2", "f16c", "movbe"})
SYMPTOMS = ("unknown target CPU 'generic'", "without 'avx512f' enabled changes the ABI")
_RECORD_BYTES = 1024  # no more than the wheel's PoCL allocates: behind it lies what others left, triples among it
_TRIPLE = re.compile(rb"x86_64-[\w-]+")
_NAME = re.compile(rb"[a-z0-9][a-z0-9_.-]{2,30}")
_kept: list[Any] = []  # the names' memory: the records point to it until the process ends


def processor_flags() -> frozenset[str]:
    """Return the features of the processor that the system reports; none where it reports nothing."""
    try:
        return frozenset(Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").split())
    except OSError:
        return frozenset()


def known_processor(flags: frozenset[str]) -> str:
    """Return the best processor that LLVM 14 knows and that has no feature beyond ``flags``."""
    if flags >= AVX512 | AVX2:
        return "skylake-avx512"
    return "haswell" if flags >= AVX2 else "x86-64"


def rename_processor(device: Any, log: str) -> tuple[str, str] | None:
    """Give the record of a PoCL device a name that its compiler knows; return the old name and the new one.

    Parameters
    ----------
    device
        The pyopencl device.
    log
        What PoCL's compiler said of a program that should build. Nothing is touched unless it is one of `SYMPTOMS`.

    Returns
    -------
    tuple of str, or None
        None where nothing was changed: another message, another system, or a record that is not as expected.
    """
    if not any(symptom in log for symptom in SYMPTOMS):
        return None
    place = processor_field(device.int_ptr)
    if place is None:
        return None
    old = processor_name(place)
    new = known_processor(processor_flags())
    if old == new:
        return None
    _point(place, new)
    return old, new


def rename_as_before(device: Any, old: str, new: str) -> bool:
    """Repeat in this process what `rename_processor` did in another; return whether the name is now the new one.

    Nothing is touched unless the processor has the old name here too.
    """
    place = processor_field(device.int_ptr)
    if place is None:
        return False
    if processor_name(place) == old:
        _point(place, new)
    return processor_name(place) == new


def own_name(device: Any) -> str:
    """Return the name of the processor in a PoCL device's record as it is now, "" where it cannot be found."""
    place = processor_field(device.int_ptr)
    return "" if place is None else processor_name(place)


def processor_name(place: int) -> str:
    """Return the name that the pointer at ``place`` points to."""
    return ctypes.string_at(ctypes.c_uint64.from_address(place).value).decode("ascii")


def _point(place: int, name: str) -> None:
    memory = ctypes.create_string_buffer(name.encode("ascii"))
    _kept.append(memory)
    ctypes.c_uint64.from_address(place).value = ctypes.addressof(memory)


def processor_field(record: int) -> int | None:
    """Return the address of the pointer to the processor's name in a device's record; None unless there is just one.

    It is the field behind the only pointer to a target triple. The map of the process's memory is read anew, as the
    record may lie in memory that did not exist when the platforms were listed.
    """
    regions = _readable()
    size = _within(regions, record, _RECORD_BYTES)
    words = struct.unpack(f"={size // 8}Q", ctypes.string_at(record, size // 8 * 8))
    triples = [i for i, word in enumerate(words[:-1]) if _TRIPLE.fullmatch(_text(regions, word))]
    if len(triples) != 1 or not _NAME.fullmatch(_text(regions, words[triples[0] + 1])):
        return None
    return record + 8 * (triples[0] + 1)


def _readable() -> list[tuple[int, int]]:
    """Return the regions of memory that this process may read."""
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    parts = [line.split(maxsplit=2) for line in lines]
    bounds = [part[0].split("-") for part in parts if part[1].startswith("r") and "[v" not in part[-1]]
    return [(int(low, 16), int(high, 16)) for low, high in bounds]


def _within(regions: list[tuple[int, int]], address: int, size: int) -> int:
    """Return how many of ``size`` bytes from ``address`` on can be read."""
    return next((min(size, high - address) for low, high in regions if low <= address < high), 0)


def _text(regions: list[tuple[int, int]], address: int) -> bytes:
    """Return the bytes up to the zero byte, 64 at most; nothing where there is no such text."""
    text, zero, _ = ctypes.string_at(address, _within(regions, address, 64)).partition(b"\0")
    return text if zero else b""
