"""Progressive rendering: waves until the samples, the time or the patience run out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.film import TILE_PIXELS
from rptcam_cl.rendering.film_part import WHOLE, FilmPart
from rptcam_cl.rendering.film_run import FilmRun, SavedState
from rptcam_cl.rendering.noise import AchievedNoise, NoiseReport
from rptcam_cl.rendering.several import AnyWavefront
from rptcam_cl.rendering.time_left import TilesLeft, TimeLeft
from rptcam_cl.scene import SHARP_LAYERS

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
        Samples per pixel requested; None when only time ends the render.
    seconds : float
        Time spent rendering [s].
    msamples_per_second : float
        Camera samples per second, in millions.
    blocked_share : float or None
        Share of the camera rays that the lens blocked; None without a lens.
    samples_at_start : int
        Samples per pixel that a resumed render had already.
    tiles_done : float or None
        Share of the tiles that meet the noise target; None without one.
    tiles_left : TilesLeft or None
        The others, and how long they take; None without a target and before their noise is known.
    film : FilmRun or None
        The film under way; None before there is one.
    image : callable or None
        Of `rptcam_cl.render`: returns the picture so far as an image, while this is the latest progress.
    """

    stage: str
    samples_done: int
    spp_target: int | None
    seconds: float
    msamples_per_second: float
    blocked_share: float | None
    samples_at_start: int = 0
    tiles_done: float | None = None
    tiles_left: TilesLeft | None = None
    film: FilmRun | None = field(default=None, repr=False, compare=False)
    image: Callable[[], Any] | None = field(default=None, repr=False, compare=False)

    def pixels(self) -> NDArray[np.float32] | None:
        """Return the film so far, (height, width, 3), to be called while this is the latest progress; None before any.

        It costs nothing until it is called: then the film is read from the devices.
        """
        return None if self.film is None else self.film.pixels()


@dataclass(frozen=True)
class Rendering:
    """The result of a render.

    Attributes
    ----------
    pixels : (height, width, 3) array
        Mean of the film.
    done : int
        Samples per pixel up to which it was rendered, those of earlier parts included.
    spp : int
        Samples of the pixels that have most.
    samples : (height, width) array
        Samples of each pixel.
    variance : (height, width) array
        Of each pixel's mean luminance; nan unless it is recorded and there are 64 samples to estimate it from.
    noise : NoiseReport or None
        How noisy the tiles are, likewise.
    achieved : AchievedNoise or None
        How noisy the picture is, as far as it is known without a noise target.
    seconds : float
        Time spent rendering [s].
    interrupted : bool
        Whether ``should_stop`` ended the render.
    layers : dict
        Auxiliary layers by name.
    resumed_from : int
        Samples per pixel that it started from.
    new_samples : int
        Samples of all pixels made since.
    state : callable
        Returns what `render_plan` needs to go on.
    """

    pixels: NDArray[np.float32]
    done: int
    spp: int
    samples: NDArray[np.uint32]
    variance: NDArray[np.float32]
    noise: NoiseReport | None
    achieved: AchievedNoise | None
    seconds: float
    interrupted: bool
    layers: dict[str, NDArray[Any]]
    resumed_from: int
    new_samples: int
    state: Callable[[], SavedState]


def render_plan(
    wavefront: AnyWavefront,
    *,
    spp: int | None,
    seconds: float | None,
    has_lens: bool,
    noise: float | None = None,
    part: FilmPart = WHOLE,
    saved: SavedState | None = None,
    save: Callable[[Callable[[], SavedState]], Any] | None = None,
    on_progress: Callable[[Progress], Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Rendering:
    """Render until every pixel has ``spp`` samples, or ``seconds`` have passed, or ``should_stop`` says so.

    It always ends after whole samples: every pixel has the same number of them, at least one. With ``noise``, tiles of
    8 x 8 pixels are left alone once their relative standard error is so small (`NoiseEstimate`).

    Parameters
    ----------
    part
        Which tiles and samples are rendered; its samples end where it says, if it does.
    saved
        What to go on with.
    save
        Called between samples with a function that returns the state.
    """
    run = FilmRun(wavefront, noise, part)
    if saved is not None:
        run.resume(saved)
    start = 0 if saved is None else run.done
    clock = _Clock(run, spp, has_lens, on_progress)
    stopped = False
    most = wavefront.samples_per_wave
    while (spp is None or run.done < spp) and not run.watch.satisfied:
        # By time, the first picture comes after one sample per pixel; later waves hold at most as many as are done.
        rest = most if spp is None else min(most, spp - run.done)
        count = rest if seconds is None else min(rest, max(run.done, 1), clock.fitting(seconds))
        run.add(count, clock.count, last=run.done + count == spp)
        if save is not None:
            save(run.state)
        if seconds is not None or should_stop is not None:
            stopped = should_stop is not None and should_stop()
            if stopped or (seconds is not None and clock.out_of_time(seconds)):
                break
    wavefront.finish()
    clock.report()
    return rendering_of(run, start=start, seconds=clock.elapsed, new_samples=clock.samples, interrupted=stopped)


def render_state(wavefront: AnyWavefront, spp: int, part: FilmPart = WHOLE) -> SavedState:
    """Return the state of a part's film with all its samples; no picture is made of it, which takes the whole film.

    Parameters
    ----------
    wavefront
        Compiled, with an empty film and all tiles.
    spp
        The sample of each pixel to end before.
    part
        Which tiles and samples are rendered.
    """
    run = FilmRun(wavefront, part=part)
    clock, most = _Clock(run, spp, False, None), wavefront.samples_per_wave
    while run.done < spp:
        count = min(most, spp - run.done)
        run.add(count, clock.count, last=run.done + count == spp)
    return run.state()


def rendering_of(run: FilmRun, *, start: int, seconds: float, new_samples: int, interrupted: bool) -> Rendering:
    """Return what a film has come to, of so many samples per pixel at the start and so many of all pixels since."""
    wavefront, watch, done = run.wavefront, run.watch, run.done
    layout = wavefront.layout
    tiles = run.samples_of_tiles()
    in_rows = {"samples": np.repeat(tiles, TILE_PIXELS), "variance": watch.variance()}
    film = {name: np.ascontiguousarray(layout.in_rows(values[None])[0]) for name, values in in_rows.items()}
    sums = wavefront.sums()
    pixels = layout.picture(sums, tiles)
    found = wavefront.layers() | film | {"direct": pixels, "ghosts": np.zeros_like(pixels)}
    return Rendering(
        pixels=pixels,
        done=done,
        spp=int(film["samples"].max()),
        samples=film["samples"],
        variance=film["variance"],
        noise=watch.report(),
        achieved=watch.achieved(done, sums),
        seconds=seconds,
        interrupted=interrupted,
        layers={name: found[name] for name in wavefront.settings.layers if name not in SHARP_LAYERS},
        resumed_from=start,
        new_samples=new_samples,
        state=run.state,
    )


class _Clock:
    """Keeps the queue short enough for reports, from the speed seen so far."""

    def __init__(
        self, run: FilmRun, spp: int | None, has_lens: bool, on_progress: Callable[[Progress], Any] | None
    ) -> None:
        self._run, self._wavefront = run, run.wavefront
        self._spp = spp
        self._first = run.done  # samples per pixel at the start
        self._has_lens = has_lens
        self._on_progress = on_progress
        self._rays = run.wavefront.camera_rays
        self._start = time.perf_counter()
        self._last = self._start
        self._pending = 0
        self._batch = 1  # slots to enqueue before waiting
        self._time_left = TimeLeft()

    @property
    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._start

    @property
    def samples(self) -> int:
        """Samples of all pixels since the start, up to the last time that the device was waited for."""
        return self._wavefront.camera_rays - self._rays

    def count(self, slots: int) -> None:
        """Note enqueued slots; wait and report when enough are under way."""
        self._pending += slots
        if self._pending >= self._batch:
            self._wait()

    def _wait(self) -> None:
        self._wavefront.finish()
        now = time.perf_counter()
        rate = self._pending / max(now - self._last, 1e-6)
        self._batch = max(int(rate * REPORT_INTERVAL), 1)
        self._pending, self._last = 0, now
        self.report()

    def fitting(self, seconds: float) -> int:
        """Return how many samples per pixel fit into what is left of ``seconds``, at the speed so far; at least one."""
        made = self._run.done - self._first
        return max(round((seconds - self.elapsed) / self.elapsed * made), 1) if made else 1

    def out_of_time(self, seconds: float) -> bool:
        """Whether another sample per pixel would end nearer to ``seconds`` after it than before."""
        self._wait()
        per_sample = self.elapsed / (self._run.done - self._first)
        return self.elapsed + 0.5 * per_sample >= seconds

    def report(self) -> None:
        """Report progress to the listener."""
        if self._on_progress is None:
            return
        blocked = None
        if self._has_lens:
            outcomes = self._wavefront.outcomes()
            total = sum(outcomes.values())
            blocked = 1 - outcomes["passed"] / total if total else 0.0
        elapsed = self.elapsed
        rate = self.samples / max(elapsed, 1e-9) / 1e6
        done_share = None
        estimate = self._run.watch.estimate
        if estimate is not None and estimate.target is not None:
            done_share = 1 - len(estimate.tiles) / self._wavefront.layout.tiles
        done = self._run.done
        self._time_left.note(elapsed, self.samples)
        left = self._time_left.tiles_left(estimate, done, self._spp)
        self._on_progress(
            Progress("render", done, self._spp, elapsed, rate, blocked, self._first, done_share, left, self._run)
        )
