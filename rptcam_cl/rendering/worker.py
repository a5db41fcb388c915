"""One of several devices that share a render: the tiles that are its own, and what it has done."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.film import TILE_PIXELS
from rptcam_cl.rendering.tracer import Wavefront

QUEUE_SECONDS = 0.2  # of work that a device is given before it is waited for


@dataclass(frozen=True)
class Job:
    """What a device has to do.

    Attributes
    ----------
    ranges : list
        Tiles, their first sample and how many, one after the other.
    taken_over : array
        Tiles that were another device's until now.
    base : dict
        What those held; nothing where they were empty.
    """

    ranges: list[tuple[NDArray[np.uint32], int, int]]
    taken_over: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp))
    base: Mapping[str, NDArray[Any]] = field(default_factory=dict)


@dataclass
class Worker:
    """A device at work.

    Attributes
    ----------
    share : float
        Of the picture.
    owned : (tiles,) array of bool
        The tiles that are its own.
    kept : int
        Camera rays that are safe on the host.
    made, seconds : int, float
        Camera rays made in all, and the time that took.
    dropped : str or None
        Why it no longer works.
    """

    wavefront: Wavefront
    share: float = 0.0
    owned: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    kept: int = 0
    made: int = 0
    seconds: float = 0.0
    dropped: str | None = None

    @property
    def id(self) -> str:
        """Of the device."""
        return self.wavefront.session.info.id

    def run(self, job: Job, halt: threading.Event) -> None:
        """Do a job and wait for it; leave early once ``halt`` is set."""
        begun, before = time.perf_counter(), self.wavefront.camera_rays
        if len(job.taken_over):
            self._take_over(job.taken_over, job.base)
        for tiles, first, samples in job.ranges:
            self._render(tiles, first, samples, halt)
        self.made += self.wavefront.camera_rays - before
        self.seconds += time.perf_counter() - begun

    def _render(self, tiles: NDArray[np.uint32], first: int, samples: int, halt: threading.Event) -> None:
        wavefront, pending = self.wavefront, 0
        wavefront.choose_tiles(tiles)
        for wave in wavefront.waves(first, samples):
            wavefront.enqueue(*wave)
            pending += wave[1] * wave[3]
            if pending > self.made / max(self.seconds, 1e-9) * QUEUE_SECONDS:
                wavefront.finish()
                pending = 0
                if halt.is_set():
                    return
        wavefront.finish()

    def _take_over(self, tiles: NDArray[np.intp], base: Mapping[str, NDArray[Any]]) -> None:
        arrays = self.wavefront.state()
        for name in arrays.keys() & {"film", "layers"}:
            by_tile(arrays[name])[:, tiles] = by_tile(base[name])[:, tiles] if base else 0.0
        self.wavefront.restore(arrays)

    def keep(self) -> None:
        """Take all that the device has made for safe."""
        self.kept += self.wavefront.camera_rays
        self.wavefront.clear_counts()

    def described(self) -> dict[str, Any]:
        """Return what it has done."""
        working = self.dropped is None
        return {
            "id": self.id,
            "name": self.wavefront.session.info.name,
            "share": self.share if working else 0.0,
            "samples": self.kept + (self.wavefront.camera_rays if working else 0),
            "seconds": self.seconds,
            "msamples_per_second": self.made / max(self.seconds, 1e-9) / 1e6,
            **({} if working else {"dropped": self.dropped}),
        }


def by_tile(planes: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a view of planes (planes, tiles, pixels of a tile)."""
    return planes.reshape(len(planes), -1, TILE_PIXELS)
