"""How much memory the host has free, and giving back what a process no longer uses."""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path


def free_host_bytes() -> int | None:
    """Return how many bytes programs can still take without swapping; None where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    kilobytes = [int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    return 1024 * kilobytes[0] if kilobytes else None


def give_back() -> bool:
    """Give the system the memory that was freed but is kept for later; return whether the C library can do so.

    glibc keeps what is freed between pieces that are still in use (malloc_trim(3)). Other libraries are left alone.
    """
    trim = _trim()
    if trim is not None:
        trim(0)
    return trim is not None


@lru_cache(maxsize=1)
def _trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    with contextlib.suppress(OSError, AttributeError, TypeError):
        found = ctypes.CDLL(None).malloc_trim
        found.argtypes, found.restype = (ctypes.c_size_t,), ctypes.c_int
        return found
    return None
