"""Freed memory goes back to the system."""

import ctypes
import os
import sys
from pathlib import Path

import pytest

from rptcam_cl.core.files import give_back

BLOCK, COUNT = 64 << 10, 1024  # below what the C library maps on its own


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text("ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems are left alone")
def test_memory_freed_below_what_is_in_use_is_given_back() -> None:
    if not give_back():
        pytest.skip("the C library has no malloc_trim")
    libc = ctypes.CDLL(None)
    libc.malloc.restype, libc.malloc.argtypes = ctypes.c_void_p, (ctypes.c_size_t,)
    libc.free.argtypes = (ctypes.c_void_p,)
    blocks = [libc.malloc(BLOCK) for _ in range(COUNT)]
    for block in blocks:
        ctypes.memset(block, 1, BLOCK)
    for block in blocks[:-1]:  # the last one holds the end of the heap where it is
        libc.free(block)
    before = resident_bytes()
    give_back()
    after = resident_bytes()
    libc.free(blocks[-1])
    assert before - after > 0.9 * BLOCK * COUNT
