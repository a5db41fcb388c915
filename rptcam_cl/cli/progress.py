"""How a render is coming along: a bar where somebody watches, a line now and then where the text is kept."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rptcam_cl.api import Progress

Show = Callable[["Progress"], None]

_LINE_INTERVAL = 10.0  # [s]
_LAST = 0.02  # share of the tiles of a render with a noise target, whose time is reported at its end
_WORTH = 0.1  # share of the time from which on it is
_LONG = 10.0  # [s], of the whole render


def as_duration(seconds: float) -> str:
    """A time for people, as ``4.2 s``, ``42 s`` or ``1 h 02 min``."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def fraction_done(progress: "Progress", time_limit: float | None) -> float | None:
    """Share of the work that is done, 0..1, by the nearer of the two ends; nothing when there is no end.

    Parameters
    ----------
    progress
        How far the render is.
    time_limit
        When it is to end, however many samples are done [s].
    """
    shares = []
    if progress.tiles_left is not None:
        shares.append(progress.seconds / (progress.seconds + progress.tiles_left.seconds))
    elif progress.tiles_done is not None:
        shares.append(progress.tiles_done)
    elif progress.spp_target and progress.spp_target > progress.samples_at_start:
        here = progress.samples_done - progress.samples_at_start
        shares.append(here / (progress.spp_target - progress.samples_at_start))
    if time_limit:
        shares.append(progress.seconds / time_limit)
    return min(max(shares), 1.0) if shares else None


def describe(progress: "Progress", time_limit: float | None = None) -> str:
    """The state of a render in one line: samples, speed, time left, share of rays that the lens blocked.

    With a noise target its tiles and their time come first: a terminal of 80 columns cuts off the rest.
    """
    if progress.stage != "render":
        return f"{progress.stage} ..."
    target = f"/{progress.spp_target}" if progress.spp_target else ""
    samples = [f"{progress.samples_done}{target} spp"]
    if progress.seconds > 0 and progress.samples_done > 0:
        here = progress.samples_done - progress.samples_at_start
        samples.append(f"{here / progress.seconds:.3g} spp/s")
        samples.append(f"{progress.msamples_per_second:.3g} Msamples/s")
    done = fraction_done(progress, time_limit)
    left = [] if not done else [f"{as_duration(progress.seconds * (1 - done) / done)} left"]
    if progress.tiles_done is None:
        parts = samples + left
    else:
        parts = [f"{100 * progress.tiles_done:.0f} % of the tiles done"]
        if (tiles := progress.tiles_left) is not None:
            parts += [f"about {text}" for text in left]
            if tiles.few:
                noise, wanted = 100 * tiles.worst, 100 * tiles.target
                parts.append(f"{tiles.count} have up to {noise:.2g} % noise for {wanted:.2g} %")
        parts += samples
    if progress.blocked_share is not None:
        parts.append(f"lens blocks {100 * progress.blocked_share:.0f} %")
    return ", ".join(parts)


class LastTiles:
    """How long the last 2 % of the tiles of a render with a noise target take, and why."""

    def __init__(self) -> None:
        self._began = 0.0  # [s], when no more than these were left
        self._left: tuple[int, float, float] | None = None  # how many they were, their worst noise, and the target
        self._seconds = 0.0

    def note(self, progress: "Progress") -> None:
        """Take a report."""
        if progress.tiles_done is None:
            return
        self._seconds = progress.seconds
        left = progress.tiles_left
        if self._left is None and left is not None and progress.tiles_done >= 1 - _LAST:
            self._began, self._left = progress.seconds, (left.count, left.worst, left.target)

    def said(self) -> str | None:
        """What to say at the end; None where it is not worth it."""
        if self._left is None or self._seconds < _LONG:
            return None
        share = 1 - self._began / self._seconds
        if share < _WORTH:
            return None
        count, worst, target = self._left
        return (
            f"the last {count} tiles took {100 * share:.0f} % of the time: they had up to {100 * worst:.2g} % noise"
            f" when all others met {100 * target:.2g} % (--spp limits the samples of a pixel)"
        )


@contextlib.contextmanager
def _bar(time_limit: float | None) -> Iterator[Show]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (BarColumn(bar_width=None), TextColumn("{task.description}", markup=False))
    with Bar(*columns, console=Console(stderr=True), transient=True, expand=True, refresh_per_second=5) as bar:
        task = bar.add_task("start ...", total=None)

        def show(progress: "Progress") -> None:
            bar.update(task, description=describe(progress, time_limit))
            done = fraction_done(progress, time_limit)
            if progress.stage == "render" and done is not None:
                bar.update(task, total=1.0, completed=done)

        yield show


def _lines(stream: TextIO, time_limit: float | None, clock: Callable[[], float] = time.monotonic) -> Show:
    last = clock()

    def show(progress: "Progress") -> None:
        nonlocal last
        if clock() - last >= _LINE_INTERVAL:
            last = clock()
            print(describe(progress, time_limit), file=stream, flush=True)

    return show


@contextlib.contextmanager
def progress_on_stderr(time_limit: float | None = None) -> Iterator[Show]:
    """A function that shows each report it is given.

    On a terminal it moves a bar, which goes away at the end; elsewhere it prints a line every ten seconds. At the end
    it says why the last tiles of a noise target took long, if they did.

    Parameters
    ----------
    time_limit
        When the render is to end [s], if by time.
    """
    last = LastTiles()
    with _bar(time_limit) if sys.stderr.isatty() else contextlib.nullcontext(_lines(sys.stderr, time_limit)) as show:

        def note(progress: "Progress") -> None:
            last.note(progress)
            show(progress)

        yield note
    if text := last.said():
        print(text, file=sys.stderr)
