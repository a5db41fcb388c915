"""What a render session hands out: frames, and what a change came to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering import FilmRun

Kind = Literal["none", "picture", "camera", "scene", "program"]

QUEUE_SECONDS = 0.012  # of work that is enqueued before the device is waited for
FIRST_SLOTS = 1 << 14  # of the first wave, whose time is not known


@dataclass(frozen=True)
class Change:
    """What a change of a session's scene came to.

    Attributes
    ----------
    kind : str
        The dearest that it took. ``none``: nothing has changed. ``picture``: the film stays, it is developed in another
        way. ``camera``: records of the camera. ``scene``: other records too, or another film. ``program``: kernels.
    keys : tuple of str
        The parts of the scene that are others now.
    ready : bool
        False while kernels are compiled in the background and the session still shows the scene before.
    """

    kind: Kind
    keys: tuple[str, ...]
    ready: bool = True


@dataclass(frozen=True, eq=False)
class Frame:
    """A picture of a session.

    Attributes
    ----------
    pixels : (height, width, 3) float32 array
        Linear film; each pixel is the mean of its samples.
    spp : int
        Samples that every pixel has.
    complete : bool
        False where `RenderSession.cancel` left it within a sample.
    seconds : float
        What it took [s].
    noise : float or None
        Relative standard error of the whole picture, estimated when the samples last doubled and scaled to their
        number; None for less than two, and for glances.
    scale : float
        Share of the film's resolution.
    generation : int
        Counts the changes that are shown.
    """

    pixels: NDArray[np.float32]
    spp: int
    complete: bool
    seconds: float
    noise: float | None
    scale: float
    generation: int


class NoiseAtHand:
    """The noise of one film: estimated whenever its samples have doubled, as that takes long, and scaled between."""

    def __init__(self) -> None:
        self._samples = 1  # at which it was estimated
        self._noise: float | None = None

    def of(self, run: FilmRun, sums: NDArray[np.float32]) -> float | None:
        """Return the relative standard error of a film with these sums; None for less than two samples."""
        if run.is_whole and run.done >= 2 * self._samples:
            achieved = run.watch.achieved(run.done, sums)
            self._noise = None if achieved is None else achieved.picture
            self._samples = 1 if achieved is None else run.done
        return None if self._noise is None else float(self._noise * np.sqrt(self._samples / run.done))


class Pace:
    """Keeps the queue of a device so short that work is given up at once when it is cancelled.

    Parameters
    ----------
    finish
        Waits for the device.
    """

    def __init__(self, cancelled: threading.Event) -> None:
        self._cancelled = cancelled
        self._rate: float | None = None  # slots per second
        self._pending, self._since = 0, 0.0

    @property
    def slots(self) -> int:
        """Most of a wave."""
        return FIRST_SLOTS if self._rate is None else max(int(self._rate * QUEUE_SECONDS), 1)

    def enqueued(self, finish: Callable[[], None]) -> Callable[[int], bool]:
        """Return what counts waves of so many slots, and says whether to give up; ``finish`` waits for the device."""
        self._pending, self._since = 0, time.perf_counter()

        def count(slots: int) -> bool:
            self._pending += slots
            if self._pending >= self.slots:
                finish()
                now = time.perf_counter()
                self._rate = self._pending / max(now - self._since, 1e-6)
                self._pending, self._since = 0, now
            return self._cancelled.is_set()

        return count
