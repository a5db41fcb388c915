"""Tasks on a cluster that is a few lines of Python: what is late goes to others, what is lost is said."""

import queue
import time
from types import SimpleNamespace

import distributed
import pytest

from rptcam_cl.batch import cluster
from rptcam_cl.batch.cluster import TasksOut
from rptcam_cl.core.errors import StateError


class Client:
    """Workers that return at once what they are told to; None is never done."""

    status = "running"

    def __init__(self, *answers: tuple[str, str] | None) -> None:
        self.threads = {"a": 1, "b": 1}
        self.sent: list[tuple[list[str] | None, bool]] = []
        self._answers: queue.SimpleQueue[tuple[str, str] | None] = queue.SimpleQueue()
        for answer in answers:
            self._answers.put(answer)

    def nthreads(self) -> dict[str, int]:
        return self.threads

    def submit(self, *_, workers, allow_other_workers, **__) -> "Task":
        self.sent.append((workers, allow_other_workers))
        return Task(self._answers.get())


class Task:
    """Done at once, or never."""

    def __init__(self, answer: tuple[str, str] | None) -> None:
        self._answer, self.status = answer, "finished" if answer else "pending"

    def add_done_callback(self, call) -> None:
        if self._answer:
            call(self)

    def result(self) -> tuple[str, str] | None:
        return self._answer

    def release(self) -> None:
        self.status = "released"


def tasks_out(client: Client) -> TasksOut:
    parcel, end = SimpleNamespace(digest="", files={}), time.monotonic() + 60
    return TasksOut(client, parcel, ["a", "b"], " (3 parts are kept)", lambda: time.monotonic() > end)  # type: ignore[arg-type]


def test_what_is_late_goes_to_one_after_the_other_of_those_that_were_heard_of_last(monkeypatch) -> None:
    monkeypatch.setattr(cluster, "LATE_S", 0.01)
    client = Client(("a", "first"), ("b", "second"), None, None, None, ("a", "third"))
    found = list(tasks_out(client).results(print, [(1,), (2,), (3,)]))
    assert found == [("a", "first"), ("b", "second"), ("a", "third")]
    assert client.sent == [(None, False)] * 3 + [(["b"], True), (["a"], True), (["b"], True)]


def test_nothing_is_sent_again_before_its_time(monkeypatch) -> None:
    monkeypatch.setattr(cluster, "LATE_S", 3600.0)
    client, stops = Client(("a", "first"), None), iter([False] * 4)
    tasks = tasks_out(client)
    tasks._should_stop = lambda: next(stops, True)
    with pytest.raises(InterruptedError):
        list(tasks.results(print, [(1,), (2,)]))
    assert len(client.sent) == 2


@pytest.mark.parametrize(
    ("lost", "says"),
    [({"status": "closed"}, "the scheduler is gone"), ({"threads": {}}, "all workers are gone")],
)
def test_what_is_lost_is_said_with_what_is_kept(lost, says, monkeypatch) -> None:
    client = Client()
    tasks = tasks_out(client)
    monkeypatch.setattr(cluster, "COUNT_WORKERS_S", 0.0)
    tasks.check_reached()
    vars(client).update(lost)
    tasks._staffed -= 2 * cluster.SILENCE_S
    with pytest.raises(StateError, match=rf"{says} \(3 parts are kept\)"):
        tasks.check_reached()
    client.status, client.threads = "running", {"a": 1}
    tasks.check_reached()


def test_a_render_is_not_the_default_cluster_of_its_process(address) -> None:
    with cluster.connect(address, None, False, None), pytest.raises(ValueError, match="No clients found"):
        distributed.default_client()
