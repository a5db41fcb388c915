"""The film and the counters of its rays on the device, and their way to the host and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.records import RayStatus
from rptcam_cl.device import Session
from rptcam_cl.rendering.film import PLANES, FilmLayout


class FilmBuffers:
    """Sums per pixel and counters of rays.

    Parameters
    ----------
    session, layout
        The device, and the film.
    clamped
        Whether the samples have a limit: one plane more adds up what it removes.

    Attributes
    ----------
    sums, counters : buffers
        As the kernels take them.
    pixels : int
        Pixels of the buffer.
    counts : (statuses + 1,) array
        Rays by status, then samples that were not finite, up to the last `finish`.
    rays : int
        Camera rays of the picture, up to the last `finish`.
    """

    def __init__(self, session: Session, layout: FilmLayout, *, clamped: bool) -> None:
        self._session, self.pixels = session, layout.pixels
        self._planes = planes_of(clamped)
        self.sums = session.allocate(self._bytes, zeroed=True)
        self.counts = np.zeros(len(RayStatus) + 1, np.uint64)
        self.counters = session.allocate(4 * len(self.counts), zeroed=True)
        self.rays, self._enqueued = 0, 0

    @property
    def _bytes(self) -> int:
        return 4 * self._planes * self.pixels

    def clear(self) -> None:
        """Empty the film and every counter."""
        self._session.fill_zero(self.sums, self._bytes)
        self._session.fill_zero(self.counters, 4 * len(self.counts))
        self.clear_counts()
        self._enqueued = 0

    def clear_counts(self) -> None:
        """Count from 0 on."""
        self.counts[:] = 0
        self.rays = 0

    def expect(self, rays: int) -> None:
        """Take note of camera rays that have been enqueued."""
        self._enqueued += rays

    def finish(self) -> None:
        """Take over the counters of everything enqueued, which has come to its end."""
        self.rays += self._enqueued
        self._enqueued = 0
        self.counts += self._session.read(self.counters, np.uint32, len(self.counts))  # 32 bits would wrap
        self._session.fill_zero(self.counters, 4 * len(self.counts))

    def planes(self) -> NDArray[np.float32]:
        """Return the sums, their compensations and, with a limit of the samples, what it has removed."""
        read = self._session.read(self.sums, np.float32, self._planes * self.pixels)
        return read.reshape(self._planes, -1)

    def all_counts(self) -> NDArray[np.uint64]:
        """Return ``counts`` with the camera rays behind them."""
        return np.append(self.counts, np.uint64(self.rays))

    def restore(self, planes: NDArray[Any], counts: NDArray[Any]) -> None:
        """Put back what `planes` and `all_counts` returned."""
        self._session.write(self.sums, np.ascontiguousarray(planes, np.float32))
        self.counts[:], self.rays = counts[:-1], int(counts[-1])


def planes_of(clamped: bool) -> int:
    """Return how many planes a film has, with a limit of the samples or without."""
    return PLANES + int(clamped)


def outcomes_of(counts: NDArray[np.uint64]) -> dict[str, int]:
    """Return how many camera rays passed the lens, and how many failed and why, of `FilmBuffers.all_counts`."""
    stopped = {status.name.lower(): int(counts[status]) for status in list(RayStatus)[1:]}
    return {"passed": int(counts[-1]) - sum(stopped.values()), **stopped}


def share_removed(planes: NDArray[np.float32]) -> float:
    """Return the share of the light of a whole film that the limit of the samples has removed."""
    exact = planes.astype(np.float64)
    removed, kept = exact[PLANES:].sum(), np.abs(exact[:3] - exact[3:PLANES]).sum() / 3
    return float(removed / (removed + kept)) if removed else 0.0
