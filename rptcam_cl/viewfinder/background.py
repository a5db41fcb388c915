"""Long work of the viewfinder off the thread of frames: searches, diffraction and ghosts, files, lens panel.

Who owns what:

- The engine's thread alone uses the studio, its slots and their sessions with their queue and their film. It starts
  tasks, ends them, and takes over what they found.
- A `BackgroundThread` gets what cannot change (scenes, films that were read, pixels), works on a queue and on buffers
  of its own (`Session.beside`), and hands what it finds back by `Background.post`: the engine calls that between two
  frames. So there is no lock but those of the two lists that threads share, and none is held while a kernel runs.
- A task is ended by a flag that the engine sets. The thread looks at it at every checkpoint (`core/remember.py`);
  what it has posted by then is dropped, as the engine looks at the flag before it takes anything over. So a result can
  never belong to another state than the one that the task was started for, however late it comes.
- While a hand moves something, workers wait at their checkpoints (`hold`): the device and the interpreter are left to
  the frames. Whoever waits holds nothing.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Hashable
from typing import Any

from rptcam_cl.core.remember import CancelledError, cancellable


def _raise(problem: Exception) -> None:
    """Let the engine meet a problem of a thread as its own."""
    raise problem


class BackgroundTask:
    """One piece of work.

    Parameters
    ----------
    text
        What runs, for the busy sign; empty where that is not worth a word.
    work
        Does it, in a thread of its own; it gets the task, to post by it.
    done
        Called by the engine with the result.
    failed
        Called by the engine with an exception, of the work or of ``done``, which it takes for its own by default.
    key
        A task that is started ends those of its key; None ends none.
    ended
        Called where the task is ended before it is done, to tell who waits for it.
    """

    def __init__(
        self,
        text: str,
        work: Callable[[BackgroundTask], Any],
        done: Callable[[Any], None],
        failed: Callable[[Exception], None] = _raise,
        key: Hashable = None,
        ended: Callable[[], None] = lambda: None,
    ) -> None:
        self.text, self.work, self.done, self.failed, self.key, self.ended = text, work, done, failed, key, ended
        self.is_ended = False
        self._background: Background | None = None

    def post(self, call: Callable[[], None]) -> None:
        """Have the engine call something between two frames, unless the task is ended by then; the worker's thread."""
        assert self._background is not None, "a task posts while it runs"
        self._background.post(lambda: None if self.is_ended else call())


class BackgroundThread:
    """A thread that does one task after the other; the engine's thread starts and ends them."""

    def __init__(self, name: str, background: Background) -> None:
        self._name, self._background = name, background
        self._queue: queue.SimpleQueue[BackgroundTask | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self.tasks: list[BackgroundTask] = []  # neither done nor ended

    def start(self, task: BackgroundTask) -> None:
        """Do a task once those before it are done."""
        task._background = self._background
        if task.key is not None:
            self.end(task.key)
        self.tasks.append(task)
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name=f"rptcam-view-{self._name}", daemon=True)
            self._thread.start()
        self._queue.put(task)

    def end(self, key: Hashable = None) -> None:
        """End all tasks, or those of a key."""
        ending = [task for task in self.tasks if key is None or task.key == key]
        self.tasks = [task for task in self.tasks if task not in ending]
        for task in ending:
            task.is_ended = True
            task.ended()

    def close(self) -> None:
        """End all tasks, and the thread after the one under way."""
        self.end()
        self._queue.put(None)

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread to end; return whether it has."""
        if self._thread is not None:
            self._thread.join(timeout_s)
        return self._thread is None or not self._thread.is_alive()

    def _run(self) -> None:
        while (task := self._queue.get()) is not None:
            if not task.is_ended:
                self._do(task)

    def _do(self, task: BackgroundTask) -> None:
        def check() -> None:
            self._background.free.wait()
            if task.is_ended:
                raise CancelledError

        result, failure = None, None
        try:
            with cancellable(check):
                check()
                result = task.work(task)
        except CancelledError:
            return
        except Exception as problem:
            failure = problem
        self._background.post(lambda: self._take(task, result, failure))

    def _take(self, task: BackgroundTask, result: Any, failure: Exception | None) -> None:
        if task.is_ended:
            return
        self.tasks.remove(task)
        if failure is None:
            try:
                task.done(result)
            except Exception as problem:  # who waits for the result is to hear of it as well
                failure = problem
        if failure is not None:
            task.failed(failure)


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
        self._workers: dict[str, BackgroundThread] = {}
        self.free = threading.Event()
        self.free.set()

    def worker(self, name: str) -> BackgroundThread:
        """The worker of a name; the engine's thread."""
        if name not in self._workers:
            self._workers[name] = BackgroundThread(name, self)
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
        texts = [task.text for worker in self._workers.values() for task in worker.tasks]
        return list(dict.fromkeys(text for text in texts if text))

    def end(self) -> None:
        """End all tasks."""
        for worker in self._workers.values():
            worker.end()

    def close(self, timeout_s: float) -> bool:
        """End all tasks and threads; return whether they have ended in time."""
        for worker in self._workers.values():
            worker.close()
        self.free.set()
        end = time.monotonic() + timeout_s
        ended = [worker.join(max(end - time.monotonic(), 0.0)) for worker in self._workers.values()]
        return all(ended)
