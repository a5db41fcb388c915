"""Long work of the viewfinder off the thread of frames: searches, diffraction and ghosts, files, lens panel.

Who owns what:

- The engine's thread alone uses the studio, its slots and their sessions with their queue and their film. It starts
  jobs, ends them, and takes over what they found.
- A `Worker` is one thread. It gets what cannot change (scenes, films that were read, pixels), works on a queue and on
  buffers of its own (`Session.beside`), and hands what it finds back by `Background.post`: the engine calls that
  between two frames. So there is no lock but those of the two lists that threads share, and none is held while a
  kernel runs.
- A job is ended by a flag that the engine sets. The worker looks at it at every checkpoint (`core/remember.py`);
  what it has posted by then is dropped, as the engine looks at the flag before it takes anything over. So a result can
  never belong to another state than the one that the job was started for, however late it comes.
- While a hand moves something, workers wait at their checkpoints (`hold`): the device and the interpreter are left to
  the frames. Whoever waits holds nothing.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Hashable
from typing import Any

from rptcam_cl.core.remember import CancelledError, cancellable

LOG = logging.getLogger("rptcam_cl.viewfinder")


class Job:
    """One piece of work.

    Parameters
    ----------
    text
        What runs, for the busy sign; empty where that is not worth a word.
    work
        Does it, in a thread of its own; it gets the job, to post by it.
    done
        Called by the engine with the result.
    failed
        Called by the engine with an exception.
    key
        A job that is started ends those of its key; None ends none.
    """

    def __init__(
        self,
        text: str,
        work: Callable[[Job], Any],
        done: Callable[[Any], None],
        failed: Callable[[Exception], None],
        key: Hashable = None,
    ) -> None:
        self.text, self.work, self.done, self.failed, self.key = text, work, done, failed, key
        self.is_ended = False
        self._background: Background | None = None

    def post(self, call: Callable[[], None]) -> None:
        """Have the engine call something between two frames, unless the job is ended by then; the worker's thread."""
        assert self._background is not None, "a job posts while it runs"
        self._background.post(lambda: None if self.is_ended else call())


class Worker:
    """A thread that does one job after the other; the engine's thread starts and ends them."""

    def __init__(self, name: str, background: Background) -> None:
        self._name, self._background = name, background
        self._queue: queue.SimpleQueue[Job | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self.jobs: list[Job] = []  # neither done nor ended

    def start(self, job: Job) -> None:
        """Do a job once those before it are done."""
        job._background = self._background
        if job.key is not None:
            self.end(job.key)
        self.jobs.append(job)
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"rptcam-view-{self._name}", daemon=True)
            self._thread.start()
        self._queue.put(job)

    def end(self, key: Hashable = None) -> None:
        """End all jobs, or those of a key."""
        for job in self.jobs:
            job.is_ended = job.is_ended or key is None or job.key == key
        self.jobs = [job for job in self.jobs if not job.is_ended]

    def close(self) -> None:
        """End all jobs, and the thread after the one under way."""
        self.end()
        self._queue.put(None)

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread to end; return whether it has."""
        if self._thread is not None:
            self._thread.join(timeout_s)
        return self._thread is None or not self._thread.is_alive()

    def _run(self) -> None:
        while (job := self._queue.get()) is not None:
            if not job.is_ended:
                self._do(job)

    def _do(self, job: Job) -> None:
        def check() -> None:
            self._background.free.wait()
            if job.is_ended:
                raise CancelledError

        take: Callable[[], None]
        try:
            with cancellable(check):
                check()
                result = job.work(job)
            take = lambda: job.done(result)  # noqa: E731 -- called by the engine
        except CancelledError:
            return
        except Exception as problem:
            failure = problem
            take = lambda: job.failed(failure)  # noqa: E731
        self._background.post(lambda: self._take(job, take))

    def _take(self, job: Job, take: Callable[[], None]) -> None:
        if not job.is_ended:
            self.jobs.remove(job)
            take()


class Background:
    """The workers of a viewfinder, by name.

    Parameters
    ----------
    wake
        Called, from any thread, when there is something for the engine to call.

    Attributes
    ----------
    free : threading.Event
        Set unless workers are to wait.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._workers: dict[str, Worker] = {}
        self.free = threading.Event()
        self.free.set()

    def worker(self, name: str) -> Worker:
        """The worker of a name; the engine's thread."""
        if name not in self._workers:
            self._workers[name] = Worker(name, self)
        return self._workers[name]

    def post(self, call: Callable[[], None]) -> None:
        """Have the engine call something between two frames; any thread."""
        self._calls.put(call)
        self._wake()

    def take(self) -> None:
        """Call what was posted; the engine's thread."""
        while True:
            try:
                call = self._calls.get_nowait()
            except queue.Empty:
                return
            call()

    def hold(self, is_held: bool) -> None:
        """Have workers wait at their next checkpoint, or go on."""
        if is_held:
            self.free.clear()
        else:
            self.free.set()

    @property
    def texts(self) -> list[str]:
        """What runs and waits to run."""
        texts = [job.text for worker in self._workers.values() for job in worker.jobs]
        return list(dict.fromkeys(text for text in texts if text))

    def end(self) -> None:
        """End all jobs."""
        for worker in self._workers.values():
            worker.end()

    def close(self, timeout_s: float) -> bool:
        """End all jobs and threads; return whether they have ended in time."""
        for worker in self._workers.values():
            worker.close()
        self.free.set()
        end = time.monotonic() + timeout_s
        ended = [worker.join(max(end - time.monotonic(), 0.0)) for worker in self._workers.values()]
        return all(ended)
