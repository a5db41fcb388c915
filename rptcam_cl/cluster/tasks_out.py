"""Tasks that are out on a cluster: sent again when their worker is lost, given back as they come."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from typing import Any

from rptcam_cl.cluster.parcel import Parcel
from rptcam_cl.cluster.tasks import Job
from rptcam_cl.core.errors import DeviceError, InputError, StateError

COUNT_WORKERS_S = 2.0  # how often
SEND_AGAIN_S = 0.5  # after which the scene is sent again
SILENCE_S = 15.0  # after which a scheduler that does not answer is given up
MOST_LOSSES = 3  # times that a part may exhaust the patience of the scheduler, which is four workers each


class TasksOut:
    """Tasks under way with the scene that they need, which goes to each worker once."""

    def __init__(self, client: Any, parcel: Parcel) -> None:
        self._client, self._parcel = client, parcel
        self._scene: Any = None
        self._tasks: dict[Any, tuple[Callable[..., Any], tuple[Any, ...]]] = {}
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._losses: dict[tuple[Any, ...], int] = {}
        self._counted, self._workers = 0.0, 1
        self._heard = time.monotonic()

    @property
    def under_way(self) -> int:
        """Tasks that have not come back."""
        return len(self._tasks)

    @property
    def workers(self) -> int:
        """How many there are now; some may join, others leave."""
        if time.monotonic() - self._counted > COUNT_WORKERS_S and self._client.status == "running":
            self._counted, self._workers = time.monotonic(), max(len(self._client.nthreads()), 1)
        return self._workers

    @property
    def silent(self) -> bool:
        """Whether the scheduler has been out of reach for so long that it is given up."""
        if self._client.status == "running":
            self._heard = time.monotonic()
        return self._client.status == "closed" or time.monotonic() - self._heard > SILENCE_S

    def submit_to_all(self, function: Callable[..., Any], job: Job) -> None:
        """Send the same task to each worker; the worker's loss ends it."""
        for worker in list(self._client.nthreads()) or [None]:
            self._submit(function, job, (), None if worker is None else [worker])

    def submit(self, function: Callable[..., Any], job: Job, *words: Any) -> None:
        """Send a task out."""
        self._submit(function, job, words, None)

    def _submit(
        self, function: Callable[..., Any], job: Job, words: tuple[Any, ...], workers: list[str] | None
    ) -> None:
        if self._scene is None or self._scene.status != "finished":
            self._scene = self._send_scene()
        task = self._client.submit(
            function, self._scene, job, *words, pure=False, workers=workers, allow_other_workers=workers is not None
        )
        self._tasks[task] = function, (job, *words)
        task.add_done_callback(self._done.put)

    def _send_scene(self) -> Any:
        """Send the scene to all workers, again where one is lost on the way, which ends the sending with an OSError."""
        end = time.monotonic() + SILENCE_S
        while True:
            try:
                return self._client.scatter(self._parcel, broadcast=True)
            except OSError as problem:  # of the connection, or no worker is there in time
                if time.monotonic() > end:
                    raise DeviceError(
                        f"cluster: no worker takes the scene ({problem}); what is done is kept (--resume goes on)"
                    ) from None
                time.sleep(SEND_AGAIN_S)

    def next(self) -> tuple[str, Any] | None:
        """Return what has come back, with the worker that made it; None where nothing has for a while."""
        from distributed import KilledWorker

        try:
            task = self._done.get(timeout=0.2)
        except queue.Empty:
            return None
        function, words = self._tasks.pop(task)
        if task.status == "finished":
            who = next(iter(self._client.who_has([task]).values()), ())
            return (who[0] if who else "a worker that has left"), task.result()
        if task.status == "error":
            problem = task.exception()
            if not isinstance(problem, KilledWorker):
                raise _from_worker(problem)
            self._count_loss(words, problem)
        self._scene = None  # cancelled: it may have gone with all workers that held it
        self.submit(function, *words)
        return None

    def _count_loss(self, words: tuple[Any, ...], problem: Exception) -> None:
        key = tuple(map(repr, words))
        self._losses[key] = self._losses.get(key, 0) + 1
        if self._losses[key] >= MOST_LOSSES:
            raise DeviceError(f"cluster: one part has ended its workers again and again ({problem})")

    def cancel(self) -> None:
        """Take all tasks back that have not begun."""
        self._client.cancel(list(self._tasks), force=True)
        self._tasks.clear()


def _from_worker(problem: BaseException) -> BaseException:
    """Return an error of a worker as one of this program."""
    if isinstance(problem, (InputError, DeviceError, StateError)):
        return problem
    return DeviceError(f"cluster: a worker failed: {type(problem).__name__}: {problem}")
