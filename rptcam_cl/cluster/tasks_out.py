"""Tasks that are out on a cluster: sent again when their worker is lost or does not answer, given back as they come."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from typing import Any

from rptcam_cl.cluster.parcel import Parcel
from rptcam_cl.cluster.tasks import at_worker
from rptcam_cl.core.errors import DeviceError, InputError, StateError

AHEAD = 2  # tasks with each worker: the one that it does, and the next
COUNT_WORKERS_S = 2.0  # how often
SEND_AGAIN_S = 0.5  # after which the engine is asked again
SILENCE_S = 30.0  # after which a scheduler that does not answer is given up, and a cluster without a worker
MOST_LOSSES = 3  # times that a part may exhaust the patience of the scheduler, which is four workers each
SCENE_S = 1e-6  # for each byte of the scene that is sent [s]
LATE = 2.0  # times as long as the slowest task so far, after which one is sent to another worker as well
LATE_S = 1.0  # and so much longer


def ask(call: Callable[..., Any], *words: Any, **more: Any) -> Future[Any]:
    """Return the answer to come of a call of the engine, which may wait for a process that never answers."""
    answer: Future[Any] = Future()

    def run() -> None:
        try:
            answer.set_result(call(*words, **more))
        except BaseException as problem:
            answer.set_exception(problem)

    threading.Thread(target=run, daemon=True).start()
    return answer


class TasksOut:
    """Tasks under way with the scene that they need, which each worker keeps.

    Parameters
    ----------
    client
        Of dask.distributed.
    parcel
        The scene.
    workers
        Addresses of those that have answered.
    kept
        What an error says of what is done.
    """

    def __init__(self, client: Any, parcel: Parcel, workers: Sequence[str], kept: str = "") -> None:
        self._client, self._parcel, self._kept = client, parcel, kept
        self._digest = parcel.digest
        self._opening: list[Any] = []  # what is not to be taken back
        self._tasks: dict[int, tuple[Callable[..., Any], tuple[Any, ...]]] = {}  # by number
        self._out: dict[Any, tuple[int, float]] = {}  # number of each that was sent, and when; one may be out twice
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._losses: dict[int, int] = {}
        self._count, self._counted = 1, 0.0
        self._reached = self._staffed = time.monotonic()  # when the scheduler answered last, and had a worker
        self._longest, self._again = 0.0, -1
        self._came = dict.fromkeys(workers, 0.0)  # when something came from each worker

    def first(self, function: Callable[..., Any], words: tuple[Any, ...], check: Callable[[], None]) -> Any:
        """Send the scene and a task to all workers at once, and return what the first one returns."""
        scene = self._reach(self._scattered, limit=self._scene_s)
        for number, worker in enumerate(self._came):
            self._tasks[number] = function, words
            self._send(number, worker, scene)
        while True:
            check()
            self.check_reached()
            if (came := self.next()) is not None:
                self._opening = list(self._out)
                self._out.clear()
                self._tasks.clear()
                return came[1]

    def results(
        self, function: Callable[..., Any], todo: Iterable[tuple[Any, ...]], check: Callable[[], None]
    ) -> Iterator[tuple[str, Any]]:
        """Yield what a function returns for each of the words, with the worker, as they come.

        At the end those that are late are sent to a second worker, and what comes first counts.
        """
        rest, more = enumerate(todo), True
        while True:
            while more and len(self._tasks) < AHEAD * self._count:
                number, words = next(rest, (0, None))
                if words is None:
                    more = False
                    break
                self._tasks[number] = function, words
                self._send(number)
            if not more and not self._tasks:
                return
            check()
            self.check_reached()
            if not more:
                self._send_late_again()
            if (came := self.next()) is not None:
                yield came

    def check_reached(self) -> None:
        """Count the workers.

        Raises
        ------
        StateError
            The scheduler has been out of reach, or without a worker, for too long.
        """
        now = time.monotonic()
        if now - self._counted > COUNT_WORKERS_S and self._client.status == "running":
            with contextlib.suppress(Exception):  # of many kinds, where the scheduler is lost at that moment
                self._count = len(ask(self._client.nthreads).result(SILENCE_S))
                self._reached = self._counted = time.monotonic()
                if self._count:
                    self._staffed = self._reached
        now = time.monotonic()
        if self._client.status == "closed" or now - self._reached > SILENCE_S:
            raise StateError(f"cluster: the scheduler is gone{self._kept}")
        if now - self._staffed > SILENCE_S:
            raise StateError(f"cluster: all workers are gone{self._kept}")

    def next(self) -> tuple[str, Any] | None:
        """Return what has come back, with the worker that made it; None where nothing has for a while."""
        try:
            task = self._done.get(timeout=0.2)
        except queue.Empty:
            return None
        number, sent = self._out.pop(task, (None, 0.0))
        if number is None:
            return None
        answer = self._answer(task, number)
        if answer is None:
            if not any(other == number for other, _ in self._out.values()):
                self._send(number, next(iter(self._last_heard()), None))
            return None
        if answer[1] is None:
            self._send_with_scene(number, answer[0])
            return None
        now = time.monotonic()
        self._longest, self._came[answer[0]] = max(self._longest, now - sent), now
        del self._tasks[number]
        for other in [other for other, (same, _) in self._out.items() if same == number]:
            del self._out[other]
            other.release()
        return answer

    def _answer(self, task: Any, number: int) -> tuple[str, Any] | None:
        """Return what a task has come to; None where it has to be done again."""
        from distributed import KilledWorker

        if task.status == "error":
            problem = ask(task.exception).result(SILENCE_S)
            if not isinstance(problem, KilledWorker):
                raise _from_worker(problem)
            self._losses[number] = self._losses.get(number, 0) + 1
            if self._losses[number] >= MOST_LOSSES:
                raise DeviceError(f"cluster: one part has ended its workers again and again ({problem})")
        elif task.status == "finished":
            with contextlib.suppress(Exception):  # its worker, or the scheduler, is lost before it is fetched
                worker, result = ask(task.result).result(SILENCE_S)
                return worker, result
        return None

    def _send(self, number: int, worker: str | None = None, scene: Any = None) -> None:
        """Send a task out, to this worker if it is there still."""
        function, words = self._tasks[number]
        task = self._reach(
            self._client.submit, at_worker, function, self._digest, scene, *words,
            key=f"{function.__name__}-{uuid.uuid4().hex}",
            workers=None if worker is None else [worker], allow_other_workers=worker is not None,
        )  # fmt: skip
        self._out[task] = number, time.monotonic()
        task.add_done_callback(self._done.put)

    def _send_with_scene(self, number: int, worker: str) -> None:
        """Send a task with the scene to a worker that lacks it; to any other where that one is lost meanwhile."""
        try:
            scene = ask(self._scattered, [worker]).result(self._scene_s)
        except Exception:  # of many kinds
            self._send(number)
        else:
            self._send(number, worker, scene)

    @property
    def _scene_s(self) -> float:
        return SILENCE_S + SCENE_S * sum(map(len, self._parcel.files.values()))

    def _scattered(self, workers: Sequence[str] = ()) -> Any:
        """Return the scene as the engine has it: with these workers, or with all that have answered and are there."""
        there = set(self._client.nthreads())
        some = list(workers) or [worker for worker in self._came if worker in there]
        return self._client.scatter(self._parcel, broadcast=True, workers=some or None, timeout=COUNT_WORKERS_S)

    def _reach(self, call: Callable[..., Any], *words: Any, limit: float = SILENCE_S, **more: Any) -> Any:
        """Return what a call of the engine returns; it is repeated until the scheduler or its workers are given up."""
        end = time.monotonic() + SILENCE_S
        while True:
            try:
                return ask(call, *words, **more).result(limit)
            except Exception as problem:  # of many kinds, where the scheduler or a worker is lost at that moment
                self.check_reached()
                if time.monotonic() > end:
                    reason = str(problem).partition("\n")[0] or type(problem).__name__
                    raise StateError(f"cluster: the scheduler cannot be used ({reason}){self._kept}") from None
                time.sleep(SEND_AGAIN_S)

    def _send_late_again(self) -> None:
        """Send what is late to another worker as well: each time to the next of those that were heard of last."""
        now, heard = time.monotonic(), self._last_heard()
        for number, sent in dict(self._out.values()).items():  # the last time that each was sent
            if heard and self._longest and now - sent > LATE * self._longest + LATE_S:
                self._again += 1
                self._send(number, heard[self._again % len(heard)])

    def _last_heard(self) -> list[str]:
        """Return the workers that something has come from, the last one first."""
        return sorted((worker for worker, came in self._came.items() if came), key=self._came.__getitem__, reverse=True)

    def cancel(self) -> None:
        """Take all tasks back that have not begun."""
        for task in self._out:
            task.release()
        self._out.clear()
        self._tasks.clear()


def _from_worker(problem: BaseException) -> BaseException:
    """Return an error of a worker as one of this program."""
    if isinstance(problem, (InputError, DeviceError, StateError)):
        return problem
    return DeviceError(f"cluster: a worker failed: {type(problem).__name__}: {problem}")
