"""Whether a device builds a trivial kernel: what has to be known before it is chosen, and before kernels are written.

A driver may fail, crash or never come back. So it is tried in a process of its own, which costs half a second; what
that one showed of a driver that works is kept, and costs the next run nothing. One that does not come back is tried
once more: of thousands of trials of a sound driver, one has hung.

In a process that builds programs, PoCL reads its library of built-in functions first, for 0.4 s. Where the process of
the first trial has done so, it builds for this one, too, which finds the programs in PoCL's cache.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kept import keep_bytes, kept_bytes
from rptcam_cl.core.resources import cache_dir
from rptcam_cl.device.at_work import end_work
from rptcam_cl.device.likeness import Likeness, LikenessEndedError, fork_likeness
from rptcam_cl.device.opencl import AS_BEFORE_POCL_7, load_opencl
from rptcam_cl.device.pocl_cache import lack_of_room, make_pocl_cache_usable
from rptcam_cl.device.pocl_processor import AVX2, AVX512, own_name, processor_flags, rename_as_before, rename_processor

AVX512_ARCH = "skylake-avx512"
AVX2_ARCH = "haswell"
PATIENCE = 60  # [s] for a trivial kernel; a busy processor takes ten
TRIES = 2
PATIENCE_WITH_PROGRAMS = 600  # [s] for one to be built
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from rptcam_cl.device import trial; "
    "trial.print_trial(int(sys.argv[2]), int(sys.argv[3]))"
)

_REFUSED = ".refused"
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
WALKERS = 1 << 17
WALK_WORDS = 1 << 20
WALK_SECONDS = 0.02
MOST_STEPS = 1 << 16

_likeness: list[Likeness] = []  # one at most
_tried_there: set[tuple[int, int]] = set()  # places of devices


@dataclass(frozen=True)
class Trial:
    """What the trial of a device showed.

    ``problem`` is why it cannot be used, None where it can. ``library_arch`` is the processor that PoCL's built-ins
    were compiled for, where kernels must match it. ``renamed`` holds the processor's name by PoCL and the one
    that it was given in its place, see `rptcam_cl.device.pocl_processor`. ``speed`` is how many steps of a walk through
    memory it takes in a second; None of processors, which are not ranked by it.
    """

    problem: str | None = None
    library_arch: str | None = None
    renamed: tuple[str, str] | None = None
    speed: float | None = None


@lru_cache(maxsize=64)
def try_device(handle: Any) -> Trial:
    """Return what a trivial kernel shows on the pyopencl device ``handle``; where PoCL needs help, after helping."""
    try:
        name = driver_name(handle) + ".json"
    except Exception as error:  # a driver may raise anything
        return Trial(problem=f"its driver does not describe it: {error}")
    kept = _recalled(name)
    if kept is not None and _helped(handle, kept):
        return kept
    trial = _tried_apart(handle)
    if trial.problem is None and _place(handle) is not None:
        keep_bytes("devices", name, json.dumps(asdict(trial)).encode())
        if not _helped(handle, trial):
            return Trial(problem="PoCL's record of the device is not as it was in another process")
    return trial


def first_error(log: str) -> str:
    """Return the first line of a compiler's log that speaks of an error, else its first line."""
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    return next((line for line in lines if "error" in line.lower()), lines[0] if lines else "no message")


def driver_name(handle: Any) -> str:
    """Return a name for all that a trial depends on: driver with its settings, device, processor and this package."""
    driver = [handle.platform.name, handle.platform.version, handle.name, handle.driver_version]
    settings = [f"{name}={os.environ.get(name)}" for name in AS_BEFORE_POCL_7]
    facts = [__version__, platform.platform(), *driver, *settings, *sorted(processor_flags())]
    code = Path(__file__).read_bytes() + Path(__file__).with_name("pocl_processor.py").read_bytes()
    return hashlib.sha256("\n".join(facts).encode() + code).hexdigest()


def keep_refusal(handle: Any, why: str) -> None:
    """Keep why a device that builds kernels cannot be used."""
    keep_bytes("devices", driver_name(handle) + _REFUSED, why.encode())


def refusal(handle: Any) -> str | None:
    """Return what `keep_refusal` has kept of a device; None where there is nothing."""
    kept = kept_bytes("devices", driver_name(handle) + _REFUSED)
    return None if kept is None else kept.decode(errors="replace")


def _recalled(name: str) -> Trial | None:
    """Return what an earlier trial showed of a driver that works; None where nothing sound is kept."""
    try:
        found = json.loads(kept_bytes("devices", name) or b"")
        renamed = found["renamed"]
        arch = found["library_arch"]
        if arch not in (None, AVX2_ARCH, AVX512_ARCH):
            return None
        speed = None if found["speed"] is None else float(found["speed"])
        return Trial(None, arch, None if renamed is None else (str(renamed[0]), str(renamed[1])), speed)
    except (ValueError, KeyError, TypeError, IndexError):
        return None


def _helped(handle: Any, trial: Trial) -> bool:
    """Rename the processor here as in the trial; return whether that succeeded or was not needed."""
    return trial.renamed is None or rename_as_before(handle, *trial.renamed)


def _tried_apart(handle: Any) -> Trial:
    """Return the trial of a device in a process of its own."""
    place = _place(handle)
    if place is None or not sys.executable:  # a part of a device, or Python within another program
        return try_here(handle)
    tries = TRIES
    if _likeness and _likeness[0].is_there:
        try:
            found = _trial_of(_likeness[0].ask("try", *place, patience=PATIENCE))
        except LikenessEndedError as ended:
            if ended.code != 0:  # else it has waited too long
                return Trial(problem=_ending(ended.code, ended.said))
        except TimeoutError:
            tries -= 1
        else:
            _tried_there.add(place)
            return found
    try:
        done = _ended(place, tries)
    except OSError:  # no process can be started
        return try_here(handle)
    if done is None:
        return Trial(problem=f"error: the driver did not build a trivial kernel within {PATIENCE} s, {TRIES} times")
    try:
        return _trial_of(json.loads(done.stdout.splitlines()[-1]))
    except (ValueError, IndexError):
        return Trial(problem=_ending(done.returncode, done.stderr.decode(errors="replace")))


def _trial_of(found: dict[str, Any]) -> Trial:
    renamed = found.pop("renamed")
    return Trial(**found, renamed=None if renamed is None else (renamed[0], renamed[1]))


def prepare_trial() -> None:
    """Make a process for the first trial, where none is kept; to be called before drivers and threads begin."""
    load_opencl()
    has_begun = _likeness or try_device.cache_info().currsize
    if not has_begun and not any(cache_dir("devices").glob("*.json")):
        made = fork_likeness(_carry_out)
        _likeness.extend([] if made is None else [made])


def end_trials() -> None:
    """Have the process of the first trial end, where there is one."""
    while _likeness:
        _likeness.pop().close()


def builds_apart(handle: Any) -> bool:
    """Return whether the process of its trial builds programs for a pyopencl device."""
    return bool(_likeness) and _likeness[0].is_there and _place(handle) in _tried_there


def build_apart(handle: Any, source: str, options: Sequence[str]) -> None:
    """Have a program built into PoCL's cache; what fails there does so again here."""
    if builds_apart(handle):
        with contextlib.suppress(LikenessEndedError, TimeoutError):
            _likeness[0].ask("build", *(_place(handle) or ()), source, *options, patience=PATIENCE_WITH_PROGRAMS)


def _carry_out(what: str, platform_number: int, device_number: int, *order: str) -> Any:
    """Carry out an order in the process that was made for the trial."""
    handle = load_opencl().get_platforms()[platform_number].get_devices()[device_number]
    if what == "try":
        make_pocl_cache_usable()  # with a mark of its own
        return asdict(try_here(handle))
    source, *options = order
    return _build(handle, source, options)


def _ended(place: tuple[int, int], tries: int) -> subprocess.CompletedProcess[bytes] | None:
    """Return the process of a trial after its end; None where it does not come to one."""
    command = [sys.executable, "-c", _CHILD, json.dumps(sys.path), *map(str, place)]
    for _ in range(tries):
        with contextlib.suppress(subprocess.TimeoutExpired):
            return subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PATIENCE, check=False)
    return None


def _ending(code: int, said: str) -> str:
    """Return how the process of a trial ended that printed no result."""
    if full := lack_of_room():  # which ends PoCL
        return f"error: {full}"
    if code < 0:
        name = signal.Signals(-code).name if -code in signal.valid_signals() else f"signal {-code}"
        return f"error: the driver crashed on a trivial kernel ({name})"
    last = next((line for line in reversed(said.splitlines()) if line.strip()), "")
    return f"error: the driver ended the process on a trivial kernel (exit code {code:#x}) {last}".rstrip()


def _place(handle: Any) -> tuple[int, int] | None:
    """Return the numbers of a device's platform and of the device among its own."""
    for p, each in enumerate(load_opencl().get_platforms()):
        if each == handle.platform:
            return next(((p, d) for d, device in enumerate(each.get_devices()) if device == handle), None)
    return None


def print_trial(platform_number: int, device_number: int) -> None:
    """Try a device in this process, print what it showed as a line of JSON, and end the process."""
    handle = load_opencl().get_platforms()[platform_number].get_devices()[device_number]
    print("\n" + json.dumps(asdict(try_here(handle))), flush=True)
    end_work()
    os._exit(0)  # a driver may never come back from tidying up


def try_here(handle: Any) -> Trial:
    """Return what a trivial kernel shows on the pyopencl device ``handle`` in this process."""
    if not is_pocl(handle):
        problem = _build(handle, _source(None, ""))
        is_gpu = problem is None and handle.type & load_opencl().device_type.GPU
        return Trial(problem=problem, speed=measured_speed(handle) if is_gpu else None)
    arch = pocl_library_arch()
    # The name is part of the text: PoCL's cache must not return what was compiled under another name.
    own = own_name(handle)
    log = _build(handle, _source(arch, own))
    if log is None:
        return Trial(library_arch=arch)
    renamed = rename_processor(handle, log)
    if renamed is not None and _build(handle, _source(arch, renamed[1])) is None:
        return Trial(library_arch=arch, renamed=renamed)
    if arch is not None and _build(handle, _source(None, own)) is None:
        return Trial()  # built-ins are called and not inlined: right, but slow
    return Trial(problem=log)


def measured_speed(handle: Any) -> float | None:
    """Return how many steps of `_WALK` a device takes in a second; None where its driver cannot run it.

    The work grows until the driver's own time for a launch is small beside it.
    """
    import numpy as np

    cl = load_opencl()
    try:
        context = cl.Context([handle])
        queue = cl.CommandQueue(context, handle)
        table = cl.Buffer(context, cl.mem_flags.READ_WRITE, 4 * WALK_WORDS)
        cl.enqueue_fill_buffer(queue, table, np.ones(1, np.float32), 0, 4 * WALK_WORDS)
        kernel = cl.Program(context, _WALK).build(options=["-w"], devices=[handle]).walk
        steps, seconds = 1, 0.0
        while seconds < WALK_SECONDS and steps < MOST_STEPS:
            steps *= 2
            kernel(queue, (WALKERS,), None, table, np.uint32(WALK_WORDS - 1), np.uint32(steps)).wait()  # made ready
            begun = time.perf_counter()
            kernel(queue, (WALKERS,), None, table, np.uint32(WALK_WORDS - 1), np.uint32(steps)).wait()
            seconds = time.perf_counter() - begun
        return WALKERS * steps / seconds
    except Exception:  # a driver may raise anything
        return None


def is_pocl(handle: Any) -> bool:
    """Return whether a device belongs to PoCL on this very processor."""
    return "portable computing language" in handle.platform.name.lower() and handle.name.startswith(("pthread", "cpu"))


def pocl_library_arch() -> str | None:
    """Return the processor that PoCL's library of built-ins was compiled for, where kernels must match it.

    That is so on x86-64 with AVX2: "haswell", or "skylake-avx512" with AVX-512. None elsewhere.
    """
    flags = processor_flags()
    if platform.machine() not in ("x86_64", "AMD64"):
        return None
    if flags >= AVX512 | AVX2:
        return AVX512_ARCH
    return AVX2_ARCH if flags >= AVX2 and "avx512f" not in flags else None


def target_pragma(arch: str | None) -> str:
    """Return the line that lets PoCL's built-ins be inlined into all functions that follow; see `assemble`."""
    if arch is None:
        return ""
    return f'#pragma clang attribute push(__attribute__((target("arch={arch}"))), apply_to=function)\n'


def _source(arch: str | None, name: str) -> str:
    wide = "float16" if arch == AVX512_ARCH else "float8"
    return (
        f"/* for the processor named {name} */\n{target_pragma(arch)}"
        f"static {wide} at_least_one({wide} x) {{ return fmax(x, 1.0f); }}\n"
        "__kernel void trial(__global float *out) { out[0] = at_least_one(out[0]).s0; }\n"
        + ("#pragma clang attribute pop\n" if arch else "")
    )


def _build(handle: Any, source: str, options: Sequence[str] = ("-cl-std=CL1.2", "-w")) -> str | None:
    """Return what the compiler says of a program that fails; None when it builds."""
    cl = load_opencl()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            cl.Program(cl.Context([handle]), source).build(options=list(options), devices=[handle])
    except Exception as error:  # a driver may raise anything
        return str(error) or type(error).__name__
    return None
