"""The OpenCL devices there are, whether their drivers work, and the one that a user chooses."""

from __future__ import annotations

import contextlib
import difflib
import hashlib
import json
import os
import pickle
import platform
import re
import select
import signal
import struct
import subprocess
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path
from typing import IO, Any, NoReturn

from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.files import cache_dir
from rptcam_cl.core.remember import Disk
from rptcam_cl.device import drivers
from rptcam_cl.device.drivers import end_work, leave_work

#
# Another process, which carries out orders one at a time.
#
# To start Python and import what a driver takes costs a fifth of a second. A process that is forked before anything
# began has it all. Later, threads and drivers are at work here, which a fork would lack: then a new Python is started.

_STANDARD_ERROR = 2
IDLE = 20.0  # [s] after which a forked process ends: it holds what the driver has read
_SECONDS_TO_END = 0.2  # that a process which was started has to end by itself
_ANSWER = b"\n\x02answer "  # before the answer; a driver may print anything else
_SERVER = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from rptcam_cl.device import devices; devices.serve(0, 1)"
)

_Child = tuple["subprocess.Popen[bytes] | int", IO[bytes], IO[bytes]]
"""A process, or the number of one that was forked; where it reads orders, and where it answers."""


class ServerEndedError(Exception):
    """It came to an end: with which exit code, a negative signal as of `subprocess`, and what it had printed."""

    def __init__(self, code: int, said: str) -> None:
        super().__init__(code, said)
        self.code, self.said = code, said


class CompileServer:
    """A process that carries out orders; it ends with this one.

    Parameters
    ----------
    child
        That of `start_fork_server`, which also ends when it is idle. Without it, a new Python is started at the first
        order, and again after one that failed.

    Attributes
    ----------
    is_closed : bool
        Whether it carries out nothing more.
    """

    def __init__(self, child: _Child | None = None) -> None:
        self._child, self._is_forked = child, child is not None
        self._asking, self._changing = threading.Lock(), threading.Lock()
        self.is_closed = False

    @property
    def is_there(self) -> bool:
        """Whether there is a process that has not come to an end."""
        return self._child is not None

    def ask(self, function: Callable[..., Any], *arguments: Any, timeout_s: float | None = None) -> Any:
        """Call a function of a module there; it returns what JSON holds.

        Raises
        ------
        ServerEndedError
            It has ended, perhaps by an error of the function.
        TimeoutError
            It did not answer in time [s], and was ended.
        """
        return self._carry_out(pickle.dumps((function, arguments)), timeout_s)

    def compile(self, order: bytes) -> bool:
        """Call a pickled function with its arguments there; return whether that has worked.

        The process may fail, crash or be closed.
        """
        try:
            self._carry_out(order, None)
        except ServerEndedError:
            return False
        return True

    def close(self) -> None:
        """End the process, whatever a started one does; no other begins."""
        self.is_closed = True
        child = self._child
        self._end()
        if child is not None:
            with self._asking:  # who still reads its answers comes to their end
                child[2].close()

    def _carry_out(self, order: bytes, timeout_s: float | None) -> Any:
        with self._asking:
            child = self._running()
            if child is None:
                raise ServerEndedError(0, "")
            _, orders, answers = child
            said, end = b"", time.monotonic() + (timeout_s or 0.0)
            with contextlib.suppress(OSError, ValueError):  # how it has ended is found below
                orders.write(struct.pack("<Q", len(order)) + order)
                orders.flush()
            while not (said.endswith(b"\n") and _ANSWER in said):
                if timeout_s is not None and not select.select([answers], [], [], max(end - time.monotonic(), 0.0))[0]:
                    self._end(at_once=True)
                    answers.close()
                    raise TimeoutError
                piece = os.read(answers.fileno(), 1 << 16)
                if not piece:
                    answers.close()
                    raise ServerEndedError(self._end(), said.decode(errors="replace"))
                said += piece
            return json.loads(said.split(_ANSWER)[1])

    def _running(self) -> _Child | None:
        with self._changing, contextlib.suppress(OSError):  # no process can be started
            if self._child is None and not self._is_forked and not self.is_closed and sys.executable:
                self._child = _start_python()
        return self._child

    def _end(self, *, at_once: bool = False) -> int:
        """End the process and return its exit code."""
        with self._changing:
            child, self._child = self._child, None
        if child is None:
            return 0
        process, orders, _ = child
        with contextlib.suppress(OSError):
            orders.close()  # it ends by itself if it has nothing to do
        if isinstance(process, int):
            if at_once:
                os.kill(process, signal.SIGKILL)
            return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        try:
            return process.wait(0.0 if at_once else _SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()


def _start_python() -> _Child:
    process = subprocess.Popen(
        [sys.executable, "-c", _SERVER, json.dumps(sys.path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, start_new_session=True,  # Ctrl-C is for the parent, which ends this one
    )  # fmt: skip
    assert process.stdin is not None and process.stdout is not None
    return process, process.stdin, process.stdout


def start_fork_server() -> CompileServer | None:
    """Fork a process like this one that carries out orders; None where that is unsafe.

    It is safe before other threads and drivers begin, as those would be missing in it.
    """
    if not sys.platform.startswith("linux") or threading.active_count() > 1:
        return None
    with contextlib.suppress(OSError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numpy's threads end before a fork and begin again when they are wanted
        pipes = orders, to_orders, answers, to_answers = *os.pipe(), *os.pipe()
        if min(pipes) <= _STANDARD_ERROR:  # one of the standard streams is closed, whose place it would take there
            for each in pipes:
                os.close(each)
            return None
        process = os.fork()
        if process == 0:
            os.close(to_orders)
            os.close(answers)
            leave_work()
            serve(orders, to_answers, IDLE)
        os.close(orders)
        os.close(to_answers)
        return CompileServer((process, os.fdopen(to_orders, "wb"), os.fdopen(answers, "rb")))
    return None


def serve(orders: int, answers: int, idle_s: float | None = None) -> NoReturn:
    """Carry out orders in another process, one at a time, until none comes any more or for so long; then end it."""
    code = 1
    try:
        nothing, pickled = os.open(os.devnull, os.O_RDWR), os.fdopen(os.dup(orders), "rb")
        for to, place in ((nothing, 0), (answers, 1), (answers, 2)):
            os.dup2(to, place)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        while idle_s is None or select.select([pickled], [], [], idle_s)[0]:
            if len(head := pickled.read(8)) < 8:
                break
            function, arguments = pickle.loads(pickled.read(struct.unpack("<Q", head)[0]))
            answer = function(*arguments)
            sys.stdout.flush()
            sys.stderr.flush()
            os.write(1, _ANSWER + json.dumps(answer).encode() + b"\n")
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        end_work()
        sys.stderr.flush()
        os._exit(code)  # a driver may never come back from tidying up


#
# Whether a device builds a trivial kernel: what has to be known before it is chosen, and before kernels are written.
#
# A driver may fail, crash or never come back. So it is tried in a process of its own, which costs half a second; what
# that one showed of a driver that works is kept, and costs the next run nothing. One that does not come back is tried
# once more: of thousands of trials of a sound driver, one has hung.
#
# In a process that builds programs, PoCL reads its library of built-in functions first, for 0.4 s. Where the process
# of the first trial has done so, it builds for this one, too, which finds the programs in PoCL's cache.

AVX512_ARCH = "skylake-avx512"
_AVX2_ARCH = "haswell"
TRIAL_TIMEOUT_S = 60  # [s] for a trivial kernel; a busy processor takes ten
TRIES = 2
_BUILD_TIMEOUT_S = 600  # [s] for one to be built
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from rptcam_cl.device import devices; "
    "devices.print_trial(int(sys.argv[2]), int(sys.argv[3]))"
)

# What a ray does to a device: it reads at places that it cannot foresee, and computes in between.
_WALK = """
__kernel void walk(__global float *table, uint last, uint steps)
{
    uint at = (uint)get_global_id(0) * 2654435761u;
    float x = 1.0f;
    for (uint i = 0; i < steps; ++i) {
        float y = table[at & last];
        for (int k = 0; k < 32; ++k)
            x = x * 0.5f + y;
        at = at * 1664525u + (uint)x + 1013904223u;
    }
    if (x < 0.0f)
        table[at & last] = x;
}
"""
_WALKERS = 1 << 17
_WALK_WORDS = 1 << 20
_WALK_SECONDS = 0.02
MOST_STEPS = 1 << 16

_fork_server: list[CompileServer] = []  # one at most
_tried_there: set[tuple[int, int]] = set()  # places of devices


@dataclass(frozen=True)
class Trial:
    """What the trial of a device showed.

    ``problem`` is why it cannot be used, None where it can. ``library_arch`` is the processor that PoCL's built-ins
    were compiled for, where kernels must match it. ``renamed`` holds the processor's name by PoCL and the one
    that it was given in its place, see `rptcam_cl.device.drivers`. ``speed`` is how many steps of a walk through
    memory it takes in a second; None of processors, which are not ranked by it.
    """

    problem: str | None = None
    library_arch: str | None = None
    renamed: tuple[str, str] | None = None
    speed: float | None = None


KEPT = "devices"  # folder of the cache on disk
_REFUSALS = Disk(KEPT)
_TRIALS = Disk(KEPT, pack=lambda trial: ({}, asdict(trial)), unpack=lambda _, facts: _trial_of(facts))


@lru_cache(maxsize=64)
def try_device(handle: Any) -> Trial:
    """Try a trivial kernel on the pyopencl device ``handle``; where PoCL needs help, after helping."""
    try:
        key = "trial", driver_name(handle)
    except Exception as error:  # a driver may raise anything
        return Trial(problem=f"its driver does not describe it: {error}")
    kept: Trial | None = _TRIALS.find(key)
    if kept is not None and _rename_processor(handle, kept):
        return kept
    trial = _try_apart(handle)
    if trial.problem is None and _place(handle) is not None:
        _TRIALS.add(key, trial)
        if not _rename_processor(handle, trial):
            return Trial(problem="PoCL's record of the device is not as it was in another process")
    return trial


def first_error(log: str) -> str:
    """Return the first line of a compiler's log that speaks of an error, else its first line."""
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line.lower()), lines[0] if lines else "no message")


def driver_name(handle: Any) -> str:
    """Return a name for all that a trial depends on: driver with its settings, device, processor and this package."""
    driver = [handle.platform.name, handle.platform.version, handle.name, handle.driver_version]
    settings = [f"{name}={os.environ.get(name)}" for name in drivers.AS_BEFORE_POCL_7]
    system = platform.uname()  # `platform.platform` starts a process for it, and takes 10 ms
    facts = [__version__, system.system, system.release, system.version, system.machine, *driver, *settings]
    facts += sorted(drivers.processor_flags())
    code = Path(__file__).read_bytes() + Path(__file__).with_name("drivers.py").read_bytes()
    return hashlib.sha256("\n".join(facts).encode() + code).hexdigest()


def _keep_refusal(handle: Any, why: str) -> None:
    """Keep why a device that builds kernels cannot be used."""
    _REFUSALS.add(("refusal", driver_name(handle)), why)


def refusal(handle: Any) -> str | None:
    """Read the refusal that `_keep_refusal` has kept of a device; None where there is none."""
    why: str | None = _REFUSALS.find(("refusal", driver_name(handle)))
    return why


def _rename_processor(handle: Any, trial: Trial) -> bool:
    """Rename the processor here as in the trial; return whether that succeeded or was not needed."""
    return trial.renamed is None or drivers.rename_as_before(handle, *trial.renamed)


def _try_apart(handle: Any) -> Trial:
    """Return the trial of a device in a process of its own."""
    place = _place(handle)
    if place is None or not sys.executable:  # a part of a device, or Python within another program
        return try_here(handle)
    tries = TRIES
    if _fork_server and _fork_server[0].is_there:
        try:
            trial = _trial_of(_fork_server[0].ask(_try_there, *place, timeout_s=TRIAL_TIMEOUT_S))
        except ServerEndedError as ended:
            if ended.code != 0:  # else it has waited too long
                return Trial(problem=_ending(ended.code, ended.said))
        except TimeoutError:
            tries -= 1
        else:
            _tried_there.add(place)
            return trial
    try:
        done = _run_trial(place, tries)
    except OSError:  # no process can be started
        return try_here(handle)
    if done is None:
        return Trial(
            problem=f"error: the driver did not build a trivial kernel within {TRIAL_TIMEOUT_S} s, {TRIES} times"
        )
    try:
        return _trial_of(json.loads(done.stdout.splitlines()[-1]))
    except (ValueError, IndexError):
        return Trial(problem=_ending(done.returncode, done.stderr.decode(errors="replace")))


def _trial_of(answer: dict[str, Any]) -> Trial:
    renamed = answer.pop("renamed")
    return Trial(**answer, renamed=None if renamed is None else (renamed[0], renamed[1]))


def prepare_trial() -> None:
    """Make a process for the first trial, where none is kept; to be called before drivers and threads begin."""
    drivers.load_opencl()
    has_begun = _fork_server or try_device.cache_info().currsize
    if not has_begun and not any(cache_dir(KEPT).glob("*")):
        made = start_fork_server()
        _fork_server.extend([] if made is None else [made])


def end_trials() -> None:
    """Have the process of the first trial end, where there is one."""
    while _fork_server:
        _fork_server.pop().close()


def builds_apart(handle: Any) -> bool:
    """Return whether the process of its trial builds programs for a pyopencl device."""
    return bool(_fork_server) and _fork_server[0].is_there and _place(handle) in _tried_there


def build_apart(handle: Any, source: str, options: Sequence[str]) -> None:
    """Have a program built into PoCL's cache; what fails there does so again here."""
    if builds_apart(handle):
        with contextlib.suppress(ServerEndedError, TimeoutError):
            _fork_server[0].ask(_build_there, *(_place(handle) or ()), source, *options, timeout_s=_BUILD_TIMEOUT_S)


def _try_there(platform_number: int, device_number: int) -> dict[str, Any]:
    """Try a device in the process that was made for it."""
    handle = drivers.load_opencl().get_platforms()[platform_number].get_devices()[device_number]
    drivers.make_pocl_cache_usable()  # with a mark of its own
    return asdict(try_here(handle))


def _build_there(platform_number: int, device_number: int, source: str, *options: str) -> Any:
    """Build a program in the process of the trial."""
    handle = drivers.load_opencl().get_platforms()[platform_number].get_devices()[device_number]
    return _build(handle, source, options)


def _run_trial(place: tuple[int, int], tries: int) -> subprocess.CompletedProcess[bytes] | None:
    """Return the process of a trial after its end; None where it does not come to one."""
    command = [sys.executable, "-c", _CHILD, json.dumps(sys.path), *map(str, place)]
    for _ in range(tries):
        with contextlib.suppress(subprocess.TimeoutExpired):
            return subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, timeout=TRIAL_TIMEOUT_S, check=False
            )
    return None


def _ending(code: int, said: str) -> str:
    """Return how the process of a trial ended that printed no result."""
    if full := drivers.lack_of_room():  # which ends PoCL
        return f"error: {full}"
    if code < 0:
        name = signal.Signals(-code).name if -code in signal.valid_signals() else f"signal {-code}"
        return f"error: the driver crashed on a trivial kernel ({name})"
    last = next((line for line in reversed(said.splitlines()) if line.strip()), "")
    return f"error: the driver ended the process on a trivial kernel (exit code {code:#x}) {last}".rstrip()


def _place(handle: Any) -> tuple[int, int] | None:
    """Return the numbers of a device's platform and of the device among its own."""
    for p, each in enumerate(drivers.load_opencl().get_platforms()):
        if each == handle.platform:
            return next(((p, d) for d, device in enumerate(each.get_devices()) if device == handle), None)
    return None


def print_trial(platform_number: int, device_number: int) -> None:
    """Try a device in this process, print what it showed as a line of JSON, and end the process."""
    handle = drivers.load_opencl().get_platforms()[platform_number].get_devices()[device_number]
    print("\n" + json.dumps(asdict(try_here(handle))), flush=True)
    end_work()
    os._exit(0)  # a driver may never come back from tidying up


def try_here(handle: Any) -> Trial:
    """Try a trivial kernel on the pyopencl device ``handle`` in this process."""
    if not is_pocl(handle):
        problem = _build(handle, _source(None, ""))
        is_gpu = problem is None and handle.type & drivers.load_opencl().device_type.GPU
        return Trial(problem=problem, speed=measure_speed(handle) if is_gpu else None)
    arch = pocl_library_arch()
    # The name is part of the text: PoCL's cache must not return what was compiled under another name.
    own = drivers.own_name(handle)
    log = _build(handle, _source(arch, own))
    if log is None:
        return Trial(library_arch=arch)
    renamed = drivers.rename_processor(handle, log)
    if renamed is not None and _build(handle, _source(arch, renamed[1])) is None:
        return Trial(library_arch=arch, renamed=renamed)
    if arch is not None and _build(handle, _source(None, own)) is None:
        return Trial()  # built-ins are called and not inlined: right, but slow
    return Trial(problem=log)


def measure_speed(handle: Any) -> float | None:
    """Return how many steps of `_WALK` a device takes in a second; None where its driver cannot run it.

    The work grows until the driver's own time for a launch is small beside it.
    """
    import numpy as np

    cl = drivers.load_opencl()
    try:
        context = cl.Context([handle])
        queue = cl.CommandQueue(context, handle)
        table = cl.Buffer(context, cl.mem_flags.READ_WRITE, 4 * _WALK_WORDS)
        cl.enqueue_fill_buffer(queue, table, np.ones(1, np.float32), 0, 4 * _WALK_WORDS)
        kernel = cl.Program(context, _WALK).build(options=["-w"], devices=[handle]).walk
        steps, seconds = 1, 0.0
        while seconds < _WALK_SECONDS and steps < MOST_STEPS:
            steps *= 2
            kernel(queue, (_WALKERS,), None, table, np.uint32(_WALK_WORDS - 1), np.uint32(steps)).wait()  # made ready
            begun = time.perf_counter()
            kernel(queue, (_WALKERS,), None, table, np.uint32(_WALK_WORDS - 1), np.uint32(steps)).wait()
            seconds = time.perf_counter() - begun
        return _WALKERS * steps / seconds
    except Exception:  # a driver may raise anything
        return None


def is_pocl(handle: Any) -> bool:
    """Return whether a device belongs to PoCL on this very processor."""
    return "portable computing language" in handle.platform.name.lower() and handle.name.startswith(("pthread", "cpu"))


def is_proven(handle: Any) -> bool:
    """Return whether a device is PoCL 3.0 as pip brings it, with which all pictures of the tests are rendered.

    Its kernels are compiled for one of two kinds of x86-64, whatever the processor, see `pocl_library_arch`.
    """
    version = handle.platform.version
    return is_pocl(handle) and "PoCL 3.0" in version and "LLVM 14." in version and pocl_library_arch() is not None


def pocl_library_arch() -> str | None:
    """Return the processor that PoCL's library of built-ins was compiled for, where kernels must match it.

    That is so on x86-64 with AVX2: "haswell", or "skylake-avx512" with AVX-512. None elsewhere.
    """
    flags = drivers.processor_flags()
    if platform.machine() not in ("x86_64", "AMD64"):
        return None
    if flags >= drivers.AVX512 | drivers.AVX2:
        return AVX512_ARCH
    return _AVX2_ARCH if flags >= drivers.AVX2 and "avx512f" not in flags else None


def target_pragma(arch: str | None) -> str:
    """Return the line that lets PoCL's built-ins be inlined into all functions that follow; see `assemble`."""
    if arch is None:
        return ""
    return f'#pragma clang attribute push(__attribute__((target("arch={arch}"))), apply_to=function)\n'


# What the trial's kernel calls, for PoCL 3.0, which else reads 18,500 lines before it: a third of the trial's time.
_OWN_HEADER = "#ifdef _OPENCL_H_\n"
_DECLARATION = f"{_OWN_HEADER}{{0}} __attribute__((overloadable, const)) fmax({{0}}, float);\n#endif\n"


def _source(arch: str | None, name: str) -> str:
    wide = "float16" if arch == AVX512_ARCH else "float8"
    return (
        f"/* for the processor named {name} */\n{_DECLARATION.format(wide)}{target_pragma(arch)}"
        f"static {wide} at_least_one({wide} x) {{ return fmax(x, 1.0f); }}\n"
        "__kernel void trial(__global float *out) { out[0] = at_least_one(out[0]).s0; }\n"
        + ("#pragma clang attribute pop\n" if arch else "")
    )


def _build(handle: Any, source: str, options: Sequence[str] = ("-cl-std=CL1.2", "-w")) -> str | None:
    """Build a program; return the compiler's log where that fails, None when it builds."""
    cl = drivers.load_opencl()
    try:
        declared = ["-D_OPENCL_H_"] if _OWN_HEADER in source and "PoCL 3.0" in handle.platform.version else []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            cl.Program(cl.Context([handle]), source).build(options=[*options, *declared], devices=[handle])
    except Exception as error:  # a driver may raise anything
        return str(error) or type(error).__name__
    return None


# The OpenCL devices there are, and what their drivers say of them.


@dataclass(frozen=True)
class DeviceInfo:
    """One OpenCL device; ``id`` is ``platform:device`` as used by ``--device``.

    ``failure`` is the error of its driver when it was queried. Most other members are then unknown, and ``handle`` is
    None where there is only a driver. ``driver`` is what tells versions of it apart.
    """

    id: str
    name: str
    platform: str
    type: str
    compute_units: int
    memory_bytes: int
    fp64: bool
    handle: Any
    failure: str | None = None
    driver: str = ""


def problem_of(device: DeviceInfo) -> str | None:
    """Return in a line why a device cannot be used, None where it builds a trivial kernel. Tried once per process.

    One that `refuse` has refused for its pictures cannot be used before its driver is another one.
    """
    if device.failure is not None:
        return device.failure
    problem = try_device(device.handle).problem
    return refusal(device.handle) if problem is None else f"it builds no kernel: {first_error(problem)}"


def speed_of(device: DeviceInfo) -> float:
    """Return how fast a GPU is, see `Trial`; nothing of one that cannot be used."""
    return 0.0 if problem_of(device) is not None else try_device(device.handle).speed or 0.0


def refuse(device: DeviceInfo, why: str) -> str:
    """Have a device not be used from now on, in other processes too; return what an error says of it."""
    _keep_refusal(device.handle, why)
    return f"device {device.id} {device.name} cannot be used: {why}; {drivers.instead()}"


def list_devices() -> list[DeviceInfo]:
    """Return every OpenCL device of every platform, in the order of their ids; drivers that fail are among them.

    Raises
    ------
    DeviceError
        When there is no OpenCL platform at all.
    """
    cl = drivers.load_opencl()
    drivers.begin()
    try:
        platforms = cl.get_platforms()
    except Exception as error:
        raise DeviceError(f"no OpenCL platform was found ({error}); {drivers.to_install()}") from error
    devices = []
    for p, each in enumerate(platforms):
        devices += _devices_of(cl, p, each)
    if not devices:
        raise DeviceError(f"no OpenCL device was found; {drivers.to_install()}")
    return devices


def devices() -> list[dict[str, Any]]:
    """Return every OpenCL device as a mapping of id, name, platform, type, compute_units, memory_bytes, fp64,
    problem and default.

    ``problem`` is why it cannot be used, None where it can; ``default`` marks the one that ``auto`` chooses.
    """
    listed = list_devices()
    problems = {device.id: problem_of(device) for device in listed}
    chosen = None if all(problems.values()) else choose_device("auto").id
    names = ("id", "name", "platform", "type", "compute_units", "memory_bytes", "fp64")
    return [
        {name: getattr(device, name) for name in names}
        | {"problem": problems[device.id], "default": device.id == chosen}
        for device in listed
    ]


def _devices_of(cl: Any, index: int, platform: Any) -> list[DeviceInfo]:
    """Return the devices of a platform, or one without a handle that says how its driver failed."""
    try:
        devices = platform.get_devices()
    except Exception as error:  # whatever a driver does, the others can be used
        if "DEVICE_NOT_FOUND" in str(error):  # how a platform without devices says so
            return []
        return [_unknown_device(f"{index}:0", platform, None, f"its driver lists no devices: {error}")]
    return [_describe(cl, f"{index}:{d}", platform, device) for d, device in enumerate(devices)]


def _describe(cl: Any, identity: str, platform: Any, device: Any) -> DeviceInfo:
    try:
        return DeviceInfo(
            id=identity,
            name=device.name.strip(),
            platform=platform.name.strip(),
            type="gpu" if device.type & cl.device_type.GPU else "cpu",
            compute_units=int(device.max_compute_units),
            memory_bytes=int(device.global_mem_size),
            fp64="cl_khr_fp64" in device.extensions.split(),
            handle=device,
            driver=" ".join(f"{platform.version} {device.driver_version}".split()),
        )
    except Exception as error:
        return _unknown_device(identity, platform, device, f"its driver does not describe it: {error}")


def _unknown_device(identity: str, platform: Any, handle: Any, failure: str) -> DeviceInfo:
    try:
        name = str(platform.name).strip()
    except Exception:
        name = "unknown platform"
    return DeviceInfo(identity, "unknown device", name, "cpu", 0, 0, False, handle, " ".join(failure.split()))


def device_details(info: DeviceInfo) -> dict[str, Any]:
    """Return everything about a device that its drivers report and that matters here.

    ``problem`` is why it cannot be used, if so. ``renamed`` holds the processor's name by PoCL and the one that it
    got in its place (see `rptcam_cl.device.drivers`). ``kernel_target`` is the processor that PoCL's kernels
    are compiled for, so that its built-ins can be inlined (see `rptcam_cl.device.programs`); None where the compiler
    needs no such help. What a driver does not report is None.
    """
    trial = Trial() if info.failure else try_device(info.handle)
    return {
        "id": info.id,
        "name": info.name,
        "type": info.type,
        "platform": info.platform,
        "platform_version": read_or_none(lambda: info.handle.platform.version.strip()),
        "driver_version": read_or_none(lambda: info.handle.driver_version.strip()),
        "opencl_c": read_or_none(lambda: info.handle.opencl_c_version.strip()),
        "compute_units": info.compute_units,
        "clock_mhz": read_or_none(lambda: int(info.handle.max_clock_frequency)),
        "memory_bytes": info.memory_bytes,
        "largest_buffer_bytes": read_or_none(lambda: int(info.handle.max_mem_alloc_size)),
        "fp64": info.fp64,
        "problem": problem_of(info),
        "kernel_target": trial.library_arch,
        "renamed": trial.renamed,
    }


def read_or_none(read: Callable[[], Any]) -> Any:
    """What a driver answers; None where it raises."""
    try:
        return read()
    except Exception:  # a driver may raise anything; what is wrong with it is said in ``problem``
        return None


_PRIVATE = re.compile("PCI|UUID|LUID|TOPOLOGY|OFFSET")  # where a card sits; when the machine started


def driver_answers(info: DeviceInfo) -> dict[str, Any]:
    """Everything that a driver answers about a device in numbers and words, those of its makers' own questions, too."""
    queries = drivers.load_opencl().device_info
    names = [name for name in vars(queries) if name.isupper() and not _PRIVATE.search(name)]
    answers = {name.lower(): read_or_none(partial(info.handle.get_info, getattr(queries, name))) for name in names}
    return {name: answer for name, answer in answers.items() if _is_plain(answer)}


def _is_plain(answer: Any) -> bool:
    return all(map(_is_plain, answer)) if isinstance(answer, list) else isinstance(answer, int | str)


def opencl_version() -> str | None:
    """Return the version of the binding to OpenCL; None where it is not installed."""
    try:
        return str(drivers.load_opencl().VERSION_TEXT)
    except DeviceError:
        return None


# The devices that a user chooses by a word, a list as ``0:0,1:0`` or the environment. There is no prompt.

KINDS = ("cpu", "gpu")
ALL = "all"
_REMEDY = {
    "gpu": "install the OpenCL driver of your GPU, or leave the option out to render on what there is",
    "cpu": 'pip install "rptcam_cl[pocl]" brings one for the processor',
}
_INDEX = re.compile(r"\d+(:\d+)?")


def default_device(devices: list[DeviceInfo]) -> DeviceInfo:
    """Return the device that ``auto`` means, of those that build a trivial kernel.

    That is the GPU that its trial found to be the fastest, else PoCL's processor, which is the fastest way to run on
    one, else the first one. Units do not tell how fast GPUs are: those of one maker do ten times the work of another's.
    No more devices are tried than it takes.

    Raises
    ------
    DeviceError
        When none builds; the message has the reason of each.
    """
    several = sum(device.type == "gpu" for device in devices) > 1
    ordered = sorted(devices, key=lambda device: _rank(device, several))
    chosen = next((device for device in ordered if problem_of(device) is None), None)
    if chosen is None:
        reasons = "; ".join(f"{device.id} {device.name}: {problem_of(device)}" for device in devices)
        raise DeviceError(f"no OpenCL device can be used ({reasons}); {drivers.instead()}")
    return chosen


def _rank(device: DeviceInfo, several: bool) -> tuple[int, float]:
    if device.type == "gpu":
        return 0, -speed_of(device) if several else 0.0
    return (1 if "portable computing language" in device.platform.lower() else 2), 0


def choose_device(spec: str | None = None) -> DeviceInfo:
    """Return the device that ``spec`` names, else ``RPTCAM_DEVICE``, else ``PYOPENCL_CTX``, else ``auto``.

    Parameters
    ----------
    spec
        An index such as ``0:0``, a part of a device or platform name in any case, ``cpu``, ``gpu`` or ``auto``. Where
        it fits several devices, `default_device` of those is meant.

    Raises
    ------
    DeviceError
        When there is no device, or none that fits, or none of those that fit can be used; the message lists those
        there are, or the reasons.
    """
    devices = list_devices()
    fitting, source = fitting_devices(devices, spec)
    if source is None:
        return default_device(fitting)
    try:
        return default_device(fitting)
    except DeviceError as error:
        others = [device for device in devices if device not in fitting and problem_of(device) is None]
        hint = f"; these can: {_listing(others)}" if others else ""
        raise DeviceError(f"{source}: {error}{hint}") from None


def fitting_devices(devices: list[DeviceInfo], spec: str | None = None) -> tuple[list[DeviceInfo], str | None]:
    """Return which of ``devices`` a ``spec`` of `choose_device` fits, usable or not, and in words where it was given.

    Raises
    ------
    DeviceError
        When it fits none; the message lists ``devices``.
    """
    for source, value in (
        ("--device", spec),
        ("RPTCAM_DEVICE", _first_device(os.environ.get("RPTCAM_DEVICE"))),
        ("PYOPENCL_CTX", os.environ.get("PYOPENCL_CTX")),
    ):
        if value is not None and value.strip():
            return _match(devices, value.strip(), source), f"{source} {value.strip()!r}"
    return devices, None


def _match(devices: list[DeviceInfo], spec: str, source: str) -> list[DeviceInfo]:
    wanted = spec.lower()
    if wanted == "auto":
        return devices
    if wanted in KINDS:
        fitting = [device for device in devices if device.type == wanted]
    elif _INDEX.fullmatch(wanted):
        identity = wanted if ":" in wanted else f"{wanted}:0"
        fitting = [device for device in devices if device.id == identity]
    else:
        fitting = [device for device in devices if wanted in device.name.lower() or wanted in device.platform.lower()]
    if fitting:
        return fitting
    if wanted in KINDS:
        raise DeviceError(
            f"{source} {spec!r}: this machine has no {wanted.upper()} that OpenCL finds; "
            f"there are: {_listing(devices)}; {_REMEDY[wanted]}"
        )
    near = difflib.get_close_matches(spec, [*(device.name for device in devices), *KINDS, "auto"], 1)
    hint = f" (did you mean {near[0]!r}?)" if near and near[0] != wanted else ""
    raise DeviceError(f"{source} {spec!r} fits no OpenCL device{hint}; there are: {_listing(devices)}")


def _listing(devices: list[DeviceInfo]) -> str:
    return "; ".join(f"{device.id} {device.name} [{device.type}]" for device in devices)


def parse_devices(spec: str) -> list[str]:
    """Return the devices that ``spec`` lists: indices with commas between them, else the one that it is."""
    words = [word.strip() for word in spec.split(",")]
    return words if all(_INDEX.fullmatch(word) for word in words) else [spec.strip()]


def several_of_environment() -> list[str] | None:
    """Return the devices that ``RPTCAM_DEVICE`` lists, where they are several or "all"; else None."""
    words = parse_devices(os.environ.get("RPTCAM_DEVICE", ""))
    return words if len(words) > 1 or words == [ALL] else None


def _first_device(spec: str | None) -> str | None:
    """Return the device that a command takes that takes one: the first of a list, the best of all."""
    if spec is None:
        return None
    first = parse_devices(spec)[0]
    return "auto" if first.lower() == ALL else first
