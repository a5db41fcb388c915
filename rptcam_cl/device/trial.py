"""Whether a device builds a trivial kernel: what has to be known before it is chosen, and before kernels are written.

The trial is made once for each device in a process. PoCL keeps what it built, so that a later one costs no compilation.
"""

from __future__ import annotations

import os
import platform
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from rptcam_cl.device.pocl_processor import AVX2, AVX512, processor_flags, rename_processor

AVX512_ARCH = "skylake-avx512"
AVX2_ARCH = "haswell"


@dataclass(frozen=True)
class Trial:
    """What the trial of a device showed.

    ``problem`` is why it cannot be used, None where it can. ``library_arch`` is the processor that PoCL's built-ins
    were compiled for, where kernels must be told to match it. ``renamed`` holds the processor's name by PoCL and the
    one that it was given in its place, see `rptcam_cl.device.pocl_processor`.
    """

    problem: str | None = None
    library_arch: str | None = None
    renamed: tuple[str, str] | None = None


@lru_cache(maxsize=64)
def try_device(handle: Any) -> Trial:
    """Return what a trivial kernel shows on the pyopencl device ``handle``; where PoCL needs help, after helping."""
    if not is_pocl(handle):
        return Trial(problem=_build(handle, _source(None, "")))
    arch = pocl_library_arch()
    # The name is part of the text: PoCL's cache must not answer for a compiler that was told another one.
    log = _build(handle, _source(arch, "PoCL's own"))
    if log is None:
        return Trial(library_arch=arch)
    renamed = rename_processor(handle, log)
    if renamed is not None and _build(handle, _source(arch, renamed[1])) is None:
        return Trial(library_arch=arch, renamed=renamed)
    if arch is not None and _build(handle, _source(None, "PoCL's own")) is None:
        return Trial()  # built-ins are called and not inlined: right, but slow
    return Trial(problem=log)


def is_pocl(handle: Any) -> bool:
    """Tell whether a device belongs to PoCL on this very processor."""
    return "portable computing language" in handle.platform.name.lower() and handle.name.startswith(("pthread", "cpu"))


def pocl_library_arch() -> str | None:
    """Return the processor that PoCL's library of built-ins was compiled for, where kernels must be told to match it.

    That is so on x86-64 with AVX2: "haswell", or "skylake-avx512" with AVX-512. None elsewhere.
    """
    flags = processor_flags()
    if platform.machine() not in ("x86_64", "AMD64"):
        return None
    if flags >= AVX512 | AVX2:
        return AVX512_ARCH
    return AVX2_ARCH if flags >= AVX2 and "avx512f" not in flags else None


def target_pragma(arch: str | None) -> str:
    """Return the line that lets PoCL's built-ins be inlined into all functions that follow; see `assemble`."""
    if arch is None:
        return ""
    return f'#pragma clang attribute push(__attribute__((target("arch={arch}"))), apply_to=function)\n'


def _source(arch: str | None, name: str) -> str:
    wide = "float16" if arch == AVX512_ARCH else "float8"
    return (
        f"/* for the processor by {name} name */\n{target_pragma(arch)}"
        f"static {wide} at_least_one({wide} x) {{ return fmax(x, 1.0f); }}\n"
        "__kernel void trial(__global float *out) { out[0] = at_least_one(out[0]).s0; }\n"
        + ("#pragma clang attribute pop\n" if arch else "")
    )


def _build(handle: Any, source: str) -> str | None:
    """Return what the compiler says of a program that fails; None when it builds."""
    import pyopencl as cl

    try:
        with warnings.catch_warnings(), _quiet():
            warnings.simplefilter("ignore")
            cl.Program(cl.Context([handle]), source).build(options=["-cl-std=CL1.2", "-w"], devices=[handle])
    except cl.Error as error:
        return str(error)
    return None


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep from standard error what a compiler inside this process writes there ("1 error generated.")."""
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as sink:
        os.dup2(sink.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
