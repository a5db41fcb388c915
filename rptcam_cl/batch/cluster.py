"""The way to a cluster: a scene as bytes, what workers do, their tasks, and who may be trusted."""

from __future__ import annotations

import contextlib
import hashlib
import ipaddress
import json
import logging
import os
import queue
import re
import signal
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import field, replace
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Literal

from rptcam_cl.api.job import RenderJob
from rptcam_cl.api.options import RenderOptions
from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError, InputError, RptcamError, StateError, out_of_range
from rptcam_cl.core.files import named_files, read_whole, scratch_folder
from rptcam_cl.core.remember import Maker, Memory, OneMaker, is_maker, made_by
from rptcam_cl.device.devices import choose_device
from rptcam_cl.rendering.several import FilmPart
from rptcam_cl.scene.base import LARGEST_FILE
from rptcam_cl.scene.load import load_scene, plain_data
from rptcam_cl.scene.scene import Scene

# A scene with all its files as bytes, so that a machine that has none of them can render it.


@dataclass(frozen=True)
class Parcel:
    """A scene and its files.

    Attributes
    ----------
    scene : dict
        The data of the scene.
    files : dict
        Contents, by path in the scene's folder, with ``/`` between its parts.
    content_hash : str
        Of the scene as it was packed.
    """

    scene: dict[str, Any]
    files: dict[str, bytes]
    content_hash: str

    @property
    def digest(self) -> str:
        """The SHA-256 of all that it holds."""
        whole = hashlib.sha256(self.content_hash.encode())
        for name, content in sorted(self.files.items()):
            whole.update(f"\0{name}\0".encode() + hashlib.sha256(content).digest())
        return whole.hexdigest()

    def unpacked(self, folder: Path) -> Scene:
        """Write the files into a folder, and return the scene that reads them there.

        Raises
        ------
        StateError
            It is not the scene that was packed.
        """
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        scene = load_scene(self.scene, base_dir=folder)
        _check_content(scene, self.content_hash)
        return scene


def _check_content(scene: Scene, content_hash: str) -> None:
    if scene.content_hash() != content_hash:
        raise StateError("the scene is not the one that was sent: a file has changed, or a link leads elsewhere")


def pack_scene(scene: Scene, *others: Scene) -> Parcel:
    """Return a scene with all the files that it names, directly or by a file of its own, and those of other scenes.

    These are in the same folder. Where they name the files that the scene names, these are not read again.

    Raises
    ------
    InputError
        A file is missing, or lies outside the scene's folder.
    StateError
        One cannot be read.
    """
    if scene.stand_ins:
        raise InputError("the scene lacks files, and a cluster renders whole scenes (allowed: without --missing grey)")
    data = plain_data(scene)
    base = scene.base_dir.resolve()
    with named_files() as named:
        again = load_scene(data, base_dir=base)
        again.solids()
        digest = again.content_hash()
        for other in _with_other_words(data, others):
            other.solids()
            other.content_hash()
    files = {}
    for path in sorted(named):
        if not path.is_relative_to(base):
            raise InputError(f"{path}: lies outside the scene's folder (allowed: files in {base}, which are sent)")
        files[path.relative_to(base).as_posix()] = read_whole(path, LARGEST_FILE)
    parcel = Parcel(data, files, digest)
    if digest != scene.content_hash():
        raise StateError("the scene's files have changed since it was loaded (load it again)")
    return parcel


def _with_other_words(data: Any, others: Iterable[Scene]) -> Iterator[Scene]:
    """Yield scenes, loaded anew, that have other words than the data and than those before: names of files, perhaps."""
    known = {_words(data)}
    for other in others:
        own = plain_data(other)
        if (words := _words(own)) not in known:
            known.add(words)
            yield load_scene(own, base_dir=other.base_dir)


def _words(data: Any) -> tuple[str, ...]:
    """Return all texts among data."""
    if isinstance(data, Mapping):
        return tuple(word for value in data.values() for word in _words(value))
    if isinstance(data, list | tuple):
        return tuple(word for value in data for word in _words(value))
    return (data,) if isinstance(data, str) else ()


_MOST_KEPT = 3  # scenes, where as many clients have the same workers
_unpacked: Memory[tuple[Any, Scene]] = Memory(_MOST_KEPT)  # folders and scenes of parcels, by their digests
_ONE = threading.Lock()


def _keep_scene(parcel: Parcel) -> None:
    """Unpack a parcel, once in this process; its folder goes with the process, or with others after it."""

    def unpack() -> tuple[Any, Scene]:
        folder = scratch_folder()
        return folder, parcel.unpacked(Path(folder.name))

    with _ONE:
        _unpacked.find_or_make(parcel.digest, unpack)


def scene_of(digest: str) -> Scene:
    """Return the scene of a parcel that is unpacked in this process."""
    scene: Scene = _unpacked.find(digest)[1]
    return scene


# What a worker does: survey itself, open a render, render one part of it; one render at a time is kept open.


@dataclass(frozen=True)
class Job:
    """A render, as every worker gets it beside the parcel.

    Attributes
    ----------
    settings : dict
        Keyword arguments of `rptcam_cl.render` that replace keys of the scene.
    device : str or None
        The device of each worker.
    findings : dict or None
        Focus and exposure as `RenderJob.findings` has them, once they are known.
    count : int
        Parts of the film.
    version, code
        Of the client's program.
    allow_mixed : bool
        Whether a worker may have other code.
    """

    settings: dict[str, Any]
    device: str | None = None
    findings: dict[str, Any] | None = None
    count: int = 1
    version: str = field(default=__version__)
    code: Maker = field(default_factory=lambda: made_by(()))
    allow_mixed: bool = False

    @property
    def options(self) -> RenderOptions:
        """Those of each worker."""
        return RenderOptions(**self.settings, device=self.device)


@dataclass(frozen=True)
class RenderedPart:
    """A part: its number, the content of its file, the device, how long it took there [s], and what made it."""

    number: int
    content: bytes
    device: str
    seconds: float
    made_by: Maker


_SHORT_MEASURE_S = 0.2  # by which parts are made: parts of half or twice the time are no worse
_TASKS_ONE = threading.Lock()  # a worker with several threads has one device all the same
_OPEN: dict[tuple[Any, ...], RenderJob] = {}


def survey(device: str | None = None) -> dict[str, Any]:
    """Return the version of a worker's program, what it is, and its device, or under ``problem`` why it has none."""
    try:
        info = choose_device(device)
        return {"version": __version__, "device": info.name, "made_by": made_by([info.driver])}
    except RptcamError as problem:
        return {"version": __version__, "problem": str(problem)}


def _at_worker(function: Callable[..., Any], digest: str, parcel: Parcel | None, *words: Any) -> tuple[str, Any]:
    """Return the address of this worker, and what a function returns for a scene; None where it is not here.

    A worker keeps the scenes of the last parcels, so that no task waits for another worker to send one.
    """
    from distributed import get_worker

    if parcel is not None:
        _keep_scene(parcel)
    return get_worker().address, function(digest, *words) if digest in _unpacked else None


def hold_scene(digest: str) -> str:
    """Do nothing: what is to be done is that the scene is there."""
    return digest


def open_render(digest: str, job: Job) -> tuple[dict[str, Any], float, Maker]:
    """Prepare a render: focus and exposure for all, how long the film would take this worker [s], and what it is."""
    with _TASKS_ONE:
        render = _open(digest, job)
        measured = render.forecast(_SHORT_MEASURE_S)
        assert measured is not None, "parts end by samples"
        return render.findings, measured.seconds, _maker(render)


def render_part(digest: str, job: Job, number: int) -> RenderedPart:
    """Render one part."""
    with _TASKS_ONE:
        return _part(_open(digest, job), number, job.count)


def render_scene(digest: str, job: Job, number: int, data: dict[str, Any], content_hash: str) -> RenderedPart:
    """Render a whole picture of a scene whose files are in the parcel, and that has this content hash."""
    with _TASKS_ONE:
        _check_version(job)
        scene = load_scene(data, base_dir=scene_of(digest).base_dir)
        _check_content(scene, content_hash)
        render = RenderJob.prepare_parts(scene, job.options)
        return replace(_part(render, 1, 1), number=number)


def _part(render: RenderJob, number: int, count: int) -> RenderedPart:
    content, seconds = render.part(FilmPart(number, count))
    return RenderedPart(number, content, render.wavefront.session.info.name, seconds, _maker(render))


def _maker(render: RenderJob) -> Maker:
    """The identity of this program, as the parts of a render say it."""
    assert render.saver is not None, "parts are saved"
    return render.saver.makers[0]


def _check_version(job: Job) -> None:
    if job.version != __version__:
        raise StateError(f"a worker runs version {__version__}, and the client {job.version} (allowed: the same)")
    if job.code != made_by(()) and not job.allow_mixed:
        same = OneMaker()
        same.add("the client", job.code)
        same.add("cluster: a worker", made_by(()))


def _open(digest: str, job: Job) -> RenderJob:
    """The render of a job: prepared once, unless another worker has found other focus or light."""
    _check_version(job)
    key = (digest, repr(replace(job, findings=None, count=1)))
    render = _OPEN.get(key)
    if render is None or (job.findings is not None and not is_same_findings(job.findings, render.findings)):
        _OPEN.clear()
        _OPEN[key] = render = RenderJob.prepare_parts(scene_of(digest), job.options, job.findings)
    return render


def is_same_findings(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether another worker, or the same earlier, has found the same; what it could not measure is nan."""
    texts = {json.dumps(findings, sort_keys=True, default=str) for findings in (one, other)}
    return len(texts) == 1


# Tasks that are out on a cluster: sent again when their worker is lost or does not answer, given back as they come.

AHEAD = 2  # tasks with each worker: the one that it does, and the next
COUNT_WORKERS_S = 2.0  # how often
SEND_AGAIN_S = 0.5  # after which the engine is asked again
SILENCE_S = 30.0  # after which a scheduler that does not answer is given up, and a cluster without a worker
_MOST_LOSSES = 3  # times that a part may be given up by the scheduler, after four workers each
_SCENE_S = 1e-6  # for each byte of the scene that is sent [s]
LATE = 2.0  # times as long as the slowest task so far, after which one is sent to another worker as well
LATE_S = 1.0  # and so much longer


def ask(call: Callable[..., Any], *words: Any, **more: Any) -> Future[Any]:
    """Call the engine in a thread of its own, as it may wait for a process that never answers."""
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
    should_stop
        Called several times a second; True takes all tasks back and raises `InterruptedError`.
    stopped
        What that error says.
    """

    def __init__(
        self,
        client: Any,
        parcel: Parcel,
        workers: Sequence[str],
        kept: str = "",
        should_stop: Callable[[], bool] | None = None,
        stopped: str = "",
    ) -> None:
        self._client, self._parcel, self._kept = client, parcel, kept
        self._should_stop, self._stopped = should_stop, stopped
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

    def first(self, function: Callable[..., Any], words: tuple[Any, ...] = ()) -> Any:
        """Send the scene and a task to all workers at once, and return what the first one returns."""
        scene = self._reach(self._scatter_scene, limit=self._scene_s)
        for number, worker in enumerate(self._came):
            self._tasks[number] = function, words
            self._send(number, worker, scene)
        while True:
            self._check()
            if (came := self.next()) is not None:
                self._opening = list(self._out)
                self._out.clear()
                self._tasks.clear()
                return came[1]

    def results(self, function: Callable[..., Any], todo: Iterable[tuple[Any, ...]]) -> Iterator[tuple[str, Any]]:
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
            self._check()
            if not more:
                self._send_late_again()
            if (came := self.next()) is not None:
                yield came

    def _check(self) -> None:
        if self._should_stop is not None and self._should_stop():
            for task in self._out:
                task.release()
            self._out.clear()
            self._tasks.clear()
            raise InterruptedError(self._stopped)
        self.check_reached()

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
        """The next result, with the worker that made it; None where none has come for a while."""
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
        """The worker and the result of a task; None where it has to be done again."""
        from distributed import KilledWorker

        if task.status == "error":
            problem = ask(task.exception).result(SILENCE_S)
            if not isinstance(problem, KilledWorker):
                raise _from_worker(problem)
            self._losses[number] = self._losses.get(number, 0) + 1
            if self._losses[number] >= _MOST_LOSSES:
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
            self._client.submit, _at_worker, function, self._digest, scene, *words,
            key=f"{function.__name__}-{uuid.uuid4().hex}",
            workers=None if worker is None else [worker], allow_other_workers=worker is not None,
        )  # fmt: skip
        self._out[task] = number, time.monotonic()
        task.add_done_callback(self._done.put)

    def _send_with_scene(self, number: int, worker: str) -> None:
        """Send a task with the scene to a worker that lacks it; to any other where that one is lost meanwhile."""
        try:
            scene = ask(self._scatter_scene, [worker]).result(self._scene_s)
        except Exception:  # of many kinds
            self._send(number)
        else:
            self._send(number, worker, scene)

    @property
    def _scene_s(self) -> float:
        return SILENCE_S + _SCENE_S * sum(map(len, self._parcel.files.values()))

    def _scatter_scene(self, workers: Sequence[str] = ()) -> Any:
        """Return the scene as the engine has it: with these workers, or with all that have answered and are there."""
        there = set(self._client.nthreads())
        some = list(workers) or [worker for worker in self._came if worker in there]
        return self._client.scatter(self._parcel, broadcast=True, workers=some or None, timeout=COUNT_WORKERS_S)

    def _reach(self, call: Callable[..., Any], *words: Any, limit: float = SILENCE_S, **more: Any) -> Any:
        """Call the engine, again and again until it answers, or the scheduler or its workers are given up."""
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
        """The workers that have returned a result, the last one first."""
        return sorted((worker for worker, came in self._came.items() if came), key=self._came.__getitem__, reverse=True)


def _from_worker(problem: BaseException) -> BaseException:
    """The error of a worker as one of this program."""
    if isinstance(problem, (InputError, DeviceError, StateError)):
        return problem
    return DeviceError(f"cluster: a worker failed: {type(problem).__name__}: {problem}")


# The way to a cluster: a scheduler that runs already, or processes of this machine; who may be talked to, and how.

WAIT_S = 10.0  # for a scheduler, and for its first worker
STARTS = 3  # of workers of this machine, while one is lost before it has begun
_SURVEYS = 3  # of workers, while all are lost before they say anything
_SURVEY_S = 120.0  # for the first one to say what it is
_LATER_S = 10.0  # for the others, after that
_CLOSE_S = 15.0  # for the end of a client
_MOST_WORKERS = 256  # of this machine
# By default an engine looks 100 times a second at what its worker does, and 50 times whether its loop turns: 9 % of a
# core that renders, in each worker.
_LEAN = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.scheduler.http.routes": [],  # pages about the work at hand, which anybody could read
    "distributed.worker.http.routes": [],
}


@dataclass(frozen=True)
class TLS:
    """Files (PEM) by which client, scheduler and workers know each other: certificate authority, certificate, key."""

    authority: str
    certificate: str
    key: str


Credentials = TLS | Literal[False] | None
"""Certificates; None: those that the address needs; False: none, where all users of this machine are trusted."""


def check_cluster(cluster: str | None, workers: int | None, tls: Credentials) -> None:
    """Raise `InputError` for an address of no cluster, or of one that others could reach.

    Raises
    ------
    InputError
    """
    if (cluster is None) == (workers is None):
        raise InputError("cluster: give the address of a scheduler or a number of workers (allowed: one of the two)")
    if workers is not None:
        if not 1 <= workers <= _MOST_WORKERS:
            raise out_of_range("workers", workers, f"1 to {_MOST_WORKERS}")
        if tls is not None:
            raise InputError("tls: workers of this machine make their own (allowed: with a scheduler's address)")
        return
    assert cluster is not None
    match = re.fullmatch(r"(tcp|tls)://(\[[0-9a-fA-F:]+\]|[^:/\[\]]+):(\d{1,5})", cluster)
    if match is None or not 0 < int(match[3]) < 65536:
        raise InputError(f"cluster: is no address (got {cluster}; allowed: as tcp://127.0.0.1:8786 or tls://host:8786)")
    if match[1] == "tls" and not tls:
        raise InputError(f"cluster: {cluster} needs certificates (allowed: with --tls CA.pem,CERT.pem,KEY.pem)")
    if match[1] == "tcp" and tls:
        raise InputError(f"tls: {cluster} is not encrypted (allowed: an address that begins with tls://)")
    if match[1] == "tcp" and not _is_loopback(match[2].strip("[]")):
        raise InputError(
            f"cluster: {cluster} is open to the network, and whoever reaches a scheduler runs programs on its workers"
            " (allowed: tls:// with certificates, or tcp:// on this machine)"
        )
    if match[1] == "tcp" and tls is None:
        raise InputError(
            f"cluster: {cluster} asks for no credentials, and every user of this machine can run programs as you by it"
            " (allowed: tls:// with certificates, or --tls none where all of them are trusted)"
        )
    for name in (tls.authority, tls.certificate, tls.key) if tls else ():
        if not os.path.isfile(name):  # noqa: PTH113 -- a name as it was given
            raise InputError(f"tls: {name}: no such file (allowed: PEM files of authority, certificate and key)")


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


@contextlib.contextmanager
def connect(
    cluster: str | None, workers: int | None, tls: Credentials, device: str | None, *, allow_mixed: bool = False
) -> Iterator[tuple[Any, list[str]]]:
    """A client of a scheduler, or of workers of this machine, with the addresses of those that say they can render.

    Raises
    ------
    InputError
        dask.distributed is missing.
    DeviceError
        Nobody answers, there is no worker, or one has no device.
    StateError
        A worker has another version, other code or another driver.
    """
    try:
        import distributed
    except ImportError:
        raise InputError("cluster: needs dask.distributed (install rptcam_cl[cluster])") from None
    _silence_engine()
    with contextlib.ExitStack() as stack:
        address: Any = cluster
        if workers is not None:
            folder = stack.enter_context(scratch_folder())
            address = stack.enter_context(workers_here(workers, max((os.cpu_count() or 1) // workers, 1), folder))
        security = None
        if tls:
            security = distributed.Security(
                tls_ca_file=tls.authority, tls_client_cert=tls.certificate, tls_client_key=tls.key,
                require_encryption=True,
            )  # fmt: skip
        try:
            client = distributed.Client(address, security=security, timeout=WAIT_S, set_as_default=False)
        except (OSError, ValueError) as problem:
            raise DeviceError(f"cluster: no scheduler answers at {cluster} ({_reason(problem)})") from None
        stack.callback(_close, client)
        yield client, _check_workers(client, cluster, device, allow_mixed)


def _silence_engine() -> None:
    """Let this program say what goes wrong, and not the engine, nor asyncio where it speaks of the engine."""
    loggers = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] in ("distributed", "tornado")]
    for name in ("distributed", *loggers):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    logging.getLogger("asyncio").addFilter(_is_of_others)


def _is_of_others(record: logging.LogRecord) -> bool:
    said = logging.Formatter().format(record)
    return "distributed" not in said and "tornado" not in said


def _close(client: Any) -> None:
    """End a client, which waits for its scheduler, and that may be frozen."""
    with contextlib.suppress(Exception):  # of many kinds, where the scheduler is lost
        ask(client.close).result(_CLOSE_S)


def workers_here(workers: int, threads: int, folder: str | None = None) -> Any:
    """Start a scheduler with workers of this machine, each of which renders by so many threads.

    They talk by TLS with credentials that nobody else has. Their own files are in the folder.

    Raises
    ------
    InputError
        cryptography is missing.
    DeviceError
        When they do not start.
    """
    problem = ""
    for _ in range(STARTS):
        try:
            return _start_workers(workers, threads, folder)
        except RuntimeError as failure:  # distributed ends the others
            problem = _reason(failure)
    raise DeviceError(f"cluster: the workers of this machine do not start ({problem})")


def _start_workers(workers: int, threads: int, folder: str | None) -> Any:
    import dask
    from distributed import LocalCluster, Security

    try:
        security = Security.temporary()  # by which these processes alone know each other
    except ImportError:
        raise InputError("workers: need cryptography (install rptcam_cl[cluster])") from None
    place = {} if folder is None else {"temporary-directory": folder}
    with dask.config.set(_LEAN | place), _interrupts_held_back():  # the workers inherit both
        return LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, security=security, host="127.0.0.1",
            dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False}, memory_limit=0,
            silence_logs=logging.CRITICAL,
            env={"POCL_MAX_PTHREAD_COUNT": str(threads), "POCL_CPU_MAX_CU_COUNT": str(threads)},
        )  # fmt: skip


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Threads and processes that begin meanwhile never hear of Ctrl-C, which a terminal sends to all.

    It is for the client, which hears of it afterwards.
    """
    if not hasattr(signal, "pthread_sigmask"):  # as on Windows
        yield
        return
    resource_tracker.ensure_running()  # where it begins later, it lets interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _check_workers(client: Any, cluster: str | None, device: str | None, allow_mixed: bool = False) -> list[str]:
    """Check before any work that workers can render; return the addresses of those that can."""
    from distributed import TimeoutError as TooLate

    name = cluster or "this machine"
    try:
        seen = _surveys(client, device)
    except TooLate:
        raise DeviceError(f"cluster: {name} has no worker (start one: dask worker {name} --nthreads 1)") from None
    except ModuleNotFoundError as missing:
        raise DeviceError(f"cluster: {name}: a worker lacks {missing.name} (install rptcam_cl there)") from None
    except (AttributeError, ImportError) as problem:
        raise StateError(f"cluster: {name}: a worker has another version than {__version__} ({problem})") from None
    for worker, answer in sorted(seen.items()):
        if answer["version"] != __version__:
            raise StateError(
                f"cluster: the worker {worker} has version {answer['version']}, and this is {__version__} (allowed: the"
                " same everywhere)"
            )
        if "problem" in answer:
            raise DeviceError(f"cluster: the worker {worker} cannot render: {answer['problem']}")
    same, makers = OneMaker(allow_mixed), {worker: answer.get("made_by") for worker, answer in sorted(seen.items())}
    drivers = [str(maker["driver"]) for maker in makers.values() if maker is not None and is_maker(maker)]
    same.add("this program", made_by(drivers[:1]))  # the devices are theirs alone
    for worker, maker in makers.items():
        same.add(f"cluster: the worker {worker}", maker)
    return sorted(seen)


def _surveys(client: Any, device: str | None) -> dict[str, dict[str, Any]]:
    """The surveys of all workers by address, once there is one; those that are lost meanwhile give none.

    Neither do those that answer much later than the first one, as a frozen one: they may still join in.
    """
    answers: dict[str, Any] = {}
    for _ in range(_SURVEYS):
        client.wait_for_workers(1, timeout=WAIT_S)
        surveys = [ask(client.run, survey, device, workers=[worker], on_error="return") for worker in client.nthreads()]
        wait(surveys, _SURVEY_S, FIRST_COMPLETED)
        done = wait(surveys, _LATER_S).done
        if not done:
            raise DeviceError(f"cluster: no worker has answered in {_SURVEY_S + _LATER_S:g} s")
        seen = {worker: said for answer in done for worker, said in answer.result().items()}
        answers = {worker: said for worker, said in seen.items() if not isinstance(said, OSError)}
        for problem in answers.values():
            if isinstance(problem, BaseException):
                raise problem
        if answers:
            break
    return answers


def _reason(problem: Exception) -> str:
    return str(problem).splitlines()[0] if str(problem) else type(problem).__name__
