"""The way to a cluster: a scheduler that runs already, or processes of this machine; who may be talked to, and how."""

from __future__ import annotations

import contextlib
import ipaddress
import logging
import os
import re
import signal
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, wait
from multiprocessing import resource_tracker
from typing import Any, Literal

from rptcam_cl._version import __version__
from rptcam_cl.cluster.tasks import survey
from rptcam_cl.cluster.tasks_out import ask
from rptcam_cl.core.atomic import scratch_folder
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError, InputError, StateError
from rptcam_cl.core.kept import OneMaker, is_maker, made_by

WAIT_S = 10.0  # for a scheduler, and for its first worker
STARTS = 3  # of workers of this machine, while one is lost before it has begun
SURVEYS = 3  # of workers, while all are lost before they say anything
SURVEY_S = 120.0  # for the first one to say what it is
LATER_S = 10.0  # for the others, after that
CLOSE_S = 15.0  # for the end of a client
MOST_WORKERS = 256  # of this machine
# By default an engine looks 100 times a second at what its worker does, and 50 times whether its loop turns: 9 % of a
# core that renders, in each worker.
LEAN = {
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
    """Refuse what leads to no cluster, or to one that others could reach.

    Raises
    ------
    InputError
    """
    if (cluster is None) == (workers is None):
        raise InputError("cluster: give the address of a scheduler or a number of workers (allowed: one of the two)")
    if workers is not None:
        if not 1 <= workers <= MOST_WORKERS:
            raise InputError(f"workers: is out of range (got {workers}; allowed: 1 to {MOST_WORKERS})")
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
def connected(
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
        ask(client.close).result(CLOSE_S)


def workers_here(workers: int, threads: int, folder: str | None = None) -> Any:
    """Return a scheduler with workers of this machine, each of which renders by so many threads.

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
            return _started(workers, threads, folder)
        except RuntimeError as failure:  # distributed ends the others
            problem = _reason(failure)
    raise DeviceError(f"cluster: the workers of this machine do not start ({problem})")


def _started(workers: int, threads: int, folder: str | None) -> Any:
    import dask
    from distributed import LocalCluster, Security

    try:
        security = Security.temporary()  # by which these processes alone know each other
    except ImportError:
        raise InputError("workers: need cryptography (install rptcam_cl[cluster])") from None
    place = {} if folder is None else {"temporary-directory": folder}
    with dask.config.set(LEAN | place), _interrupts_held_back():  # the workers inherit both
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
    """Refuse a cluster whose workers cannot render, before any work; return the addresses of those that can."""
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
    for worker, found in sorted(seen.items()):
        if found["version"] != __version__:
            raise StateError(
                f"cluster: the worker {worker} has version {found['version']}, and this is {__version__} (allowed: the"
                " same everywhere)"
            )
        if "problem" in found:
            raise DeviceError(f"cluster: the worker {worker} cannot render: {found['problem']}")
    same, makers = OneMaker(allow_mixed), {worker: found.get("made_by") for worker, found in sorted(seen.items())}
    drivers = [str(maker["driver"]) for maker in makers.values() if maker is not None and is_maker(maker)]
    same.add("this program", made_by(drivers[:1]))  # the devices are theirs alone
    for worker, maker in makers.items():
        same.add(f"cluster: the worker {worker}", maker)
    return sorted(seen)


def _surveys(client: Any, device: str | None) -> dict[str, dict[str, Any]]:
    """Return what each worker says of itself, once there is one; those that are lost meanwhile say nothing.

    Neither do those that answer much later than the first one, as a frozen one: they may still join in.
    """
    found: dict[str, Any] = {}
    for _ in range(SURVEYS):
        client.wait_for_workers(1, timeout=WAIT_S)
        surveys = [
            ask(client.run, survey, device, workers=[worker], on_error="return") for worker in client.nthreads()
        ]
        wait(surveys, SURVEY_S, FIRST_COMPLETED)
        done = wait(surveys, LATER_S).done
        if not done:
            raise DeviceError(f"cluster: no worker has answered in {SURVEY_S + LATER_S:g} s")
        seen = {worker: said for answer in done for worker, said in answer.result().items()}
        found = {worker: said for worker, said in seen.items() if not isinstance(said, OSError)}
        for problem in found.values():
            if isinstance(problem, BaseException):
                raise problem
        if found:
            break
    return found


def _reason(problem: Exception) -> str:
    return str(problem).splitlines()[0] if str(problem) else type(problem).__name__
