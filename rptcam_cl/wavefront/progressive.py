"""Progressive rendering: waves until the samples, the time or the patience run out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.wavefront.tracer import Wavefront

REPORT_INTERVAL = 0.2  # seconds of work that may be enqueued before a report and a chance to stop


@dataclass(frozen=True)
class Progress:
    """How far a render is.

    Attributes
    ----------
    stage : "compile" or "render"
    samples_done : int
        Samples per pixel done.
    spp_target : int or None
        Samples per pixel asked for; None when only time ends the render.
    seconds : float
        Time spent rendering [s].
    msamples_per_second : float
        Camera samples per second, in millions.
    blocked_share : float or None
        Share of the camera rays that the lens blocked; None without a lens.
    """

    stage: str
    samples_done: int
    spp_target: int | None
    seconds: float
    msamples_per_second: float
    blocked_share: float | None


@dataclass(frozen=True)
class Rendering:
    """The result of a render: the film's mean, the samples in it, how it went, and the layers by name."""

    pixels: NDArray[np.float32]
    spp: int
    seconds: float
    interrupted: bool
    layers: dict[str, NDArray[Any]]


def render_plan(
    wavefront: Wavefront,
    *,
    spp: int | None,
    seconds: float | None,
    has_lens: bool,
    on_progress: Callable[[Progress], Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Rendering:
    """Render until every pixel has ``spp`` samples, or ``seconds`` have passed, or ``should_stop`` says so.

    It always ends after whole samples: every pixel has the same number of them, at least one.
    """
    clock = _Clock(wavefront, spp, has_lens, on_progress)
    done = 0
    stopped = False
    most = wavefront.samples_per_wave
    while spp is None or done < spp:
        # By time, the first picture comes after one sample per pixel; later waves hold at most as many as are done.
        count = min(most, spp - done if spp is not None else most, most if seconds is None else max(done, 1))
        for wave in wavefront.waves(done, count):
            wavefront.enqueue(*wave)
            clock.count(wave[1] * wave[3], done)
        done += count
        if seconds is not None or should_stop is not None:
            stopped = should_stop is not None and should_stop()
            if stopped or (seconds is not None and clock.out_of_time(seconds, done)):
                break
    wavefront.finish()
    clock.report(done)
    return Rendering(wavefront.picture(done), done, clock.elapsed, stopped, wavefront.layers())


class _Clock:
    """Keeps the queue short enough for reports, from the speed seen so far."""

    def __init__(
        self, wavefront: Wavefront, spp: int | None, has_lens: bool, on_progress: Callable[[Progress], Any] | None
    ) -> None:
        self._wavefront = wavefront
        self._spp = spp
        self._has_lens = has_lens
        self._on_progress = on_progress
        self._start = time.perf_counter()
        self._last = self._start
        self._pending = 0
        self._batch = 1  # slots to enqueue before waiting

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._start

    def count(self, slots: int, done: int) -> None:
        """Note enqueued slots; wait and report when enough are under way."""
        self._pending += slots
        if self._pending >= self._batch:
            self._wait(done)

    def _wait(self, done: int) -> None:
        self._wavefront.finish()
        now = time.perf_counter()
        rate = self._pending / max(now - self._last, 1e-6)
        self._batch = max(int(rate * REPORT_INTERVAL), 1)
        self._pending, self._last = 0, now
        self.report(done)

    def out_of_time(self, seconds: float, done: int) -> bool:
        """Whether another sample per pixel would end nearer to ``seconds`` after it than before."""
        self._wait(done)
        per_sample = self.elapsed / done
        return self.elapsed + 0.5 * per_sample >= seconds

    def report(self, done: int) -> None:
        """Tell the listener how far the render is."""
        if self._on_progress is None:
            return
        blocked = None
        if self._has_lens:
            outcomes = self._wavefront.outcomes()
            total = sum(outcomes.values())
            blocked = 1 - outcomes["passed"] / total if total else 0.0
        elapsed = self.elapsed
        rate = done * self._wavefront.layout.samples_per_spp / max(elapsed, 1e-9) / 1e6
        self._on_progress(Progress("render", done, self._spp, elapsed, rate, blocked))
