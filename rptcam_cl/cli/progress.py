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
    if progress.tiles_done is not None:
        shares.append(progress.tiles_done)
    elif progress.spp_target and progress.spp_target > progress.samples_at_start:
        here = progress.samples_done - progress.samples_at_start
        shares.append(here / (progress.spp_target - progress.samples_at_start))
    if time_limit:
        shares.append(progress.seconds / time_limit)
    return min(max(shares), 1.0) if shares else None


def describe(progress: "Progress", time_limit: float | None = None) -> str:
    """The state of a render in one line: samples, speed, time left, share of rays that the lens blocked."""
    if progress.stage != "render":
        return f"{progress.stage} ..."
    target = f"/{progress.spp_target}" if progress.spp_target else ""
    parts = [f"{progress.samples_done}{target} spp"]
    if progress.seconds > 0 and progress.samples_done > 0:
        here = progress.samples_done - progress.samples_at_start
        parts.append(f"{here / progress.seconds:.3g} spp/s")
        parts.append(f"{progress.msamples_per_second:.3g} Msamples/s")
    if progress.tiles_done is not None:
        parts.append(f"{100 * progress.tiles_done:.0f} % of the tiles done")
    done = fraction_done(progress, time_limit)
    if done and progress.tiles_done is None:  # the last tiles may take long
        parts.append(f"{as_duration(progress.seconds * (1 - done) / done)} left")
    if progress.blocked_share is not None:
        parts.append(f"lens blocks {100 * progress.blocked_share:.0f} %")
    return ", ".join(parts)


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

    On a terminal it moves a bar, which goes away at the end; elsewhere it prints a line every ten seconds.

    Parameters
    ----------
    time_limit
        When the render is to end [s], if by time.
    """
    if sys.stderr.isatty():
        with _bar(time_limit) as show:
            yield show
    else:
        yield _lines(sys.stderr, time_limit)
