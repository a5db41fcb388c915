"""Wall time and CPU time of a piece of work."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Times:
    """What a piece of work took: wall time [s], and CPU time summed over all threads of the process [s]."""

    wall: float
    cpu: float


def timed(work: Callable[[], Any]) -> Times:
    """Return the times of one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Times(time.perf_counter() - wall, time.process_time() - cpu)


def fastest(work: Callable[[], Any], times: int, before: Callable[[], Any] | None = None) -> Times:
    """Return the least wall time and the least CPU time of several calls: what the work takes undisturbed.

    Parameters
    ----------
    before
        Called before each call, untimed.
    """
    seen = []
    for _ in range(times):
        if before is not None:
            before()
        seen.append(timed(work))
    return Times(min(each.wall for each in seen), min(each.cpu for each in seen))


def cores() -> int:
    """Return how many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
