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

    def undisturbed(self, device_type: str) -> float:
        """Return the time that the work takes with the device to itself [s].

        On a processor that other work shares, the CPU time divided by the cores; on a GPU, the wall time.
        """
        return self.cpu / cores() if device_type == "cpu" else self.wall


def timed(work: Callable[[], Any]) -> Times:
    """Return the times of one call."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Times(time.perf_counter() - wall, time.process_time() - cpu)


def timed_picture(make: Callable[[], Any], request: dict[str, Any]) -> dict[str, Any]:
    """Return what a worker answers to ``render``: times and mean colour of a picture (rows, columns, 3).

    It is saved where the request says so.
    """
    pictures: list[Any] = []
    times = timed(lambda: pictures.append(make()))
    if "save" in request:
        import numpy as np

        np.save(request["save"], pictures[0])
    return {"wall": times.wall, "cpu": times.cpu, "mean": pictures[0].mean(axis=(0, 1), dtype=float).tolist()}


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
