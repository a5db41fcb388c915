"""What is odd about llvmpipe, the processor as Mesa's rusticl offers it: a loop may end before it is done.

Its compiler takes eight work items together, and counts the steps of all their loops in one counter; when that has
reached 65535, every loop ends after its step, and the kernel goes on with what it has, without an error
(`LP_MAX_TGSI_LOOP_ITERATIONS` in Mesa's `src/gallium/auxiliary/gallivm/lp_bld_limits.h`, "shared between every loop").
Kernels must get their work in pieces small enough.
"""

from __future__ import annotations

from typing import Any

LLVMPIPE_LOOP_LIMIT = 65535


def is_llvmpipe(handle: Any) -> bool:
    """Tell whether a pyopencl device is llvmpipe."""
    return bool(handle.name.startswith("llvmpipe"))
