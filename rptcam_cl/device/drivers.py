"""OpenCL on this system: the binding, the drivers that it is shown, PoCL's processor and cache, marks of processes."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import hashlib
import io
import os
import platform
import re
import secrets
import shutil
import struct
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.files import cache_dir, scratch_folder

#
# The processor that PoCL compiles for: named anew where PoCL's own name for it makes its compiler fail.
#
# PoCL 3.0, the one that pip installs, carries LLVM 14. On a processor that is newer than that, it tells its own clang
# either ``generic``, which clang refuses on x86-64, so that nothing compiles at all, or the name of an older relative
# without AVX-512, while its library of built-ins is the one for AVX-512, so that vectors of 16 do not compile (Zen 4
# is taken for ``znver3``). See pocl issues 512 and 1049. PoCL 3.0 has no option for it. Its record of the device
# holds a pointer to the name, next to the one to the target triple; here it is set to a name that LLVM 14 knows.
#
# Delete this part when the oldest PoCL that pip may bring is 5.0 or newer.

AVX512 = frozenset({"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"})  # what Skylake-X has
AVX2 = frozenset({"avx2", "fma", "bmi1", "bmi2", "f16c", "movbe"})
_SYMPTOMS = ("unknown target CPU 'generic'", "without 'avx512f' enabled changes the ABI")
_RECORD_BYTES = 1024  # no more than the wheel's PoCL allocates: behind it lies what others left, triples among it
_TRIPLE = re.compile(rb"x86_64-[\w-]+")
_NAME = re.compile(rb"[a-z0-9][a-z0-9_.-]{2,30}")
_kept: list[Any] = []  # the names' memory: the records point to it until the process ends


def processor_flags() -> frozenset[str]:
    """Return the features of the processor that the system reports; none where it reports nothing."""
    try:
        return frozenset(Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").split())
    except OSError:
        return frozenset()


def known_processor(flags: frozenset[str]) -> str:
    """Return the best processor that LLVM 14 knows and that has no feature beyond ``flags``."""
    if flags >= AVX512 | AVX2:
        return "skylake-avx512"
    return "haswell" if flags >= AVX2 else "x86-64"


def rename_processor(device: Any, log: str) -> tuple[str, str] | None:
    """Give the record of a PoCL device a name that its compiler knows; return the old name and the new one.

    Parameters
    ----------
    device
        The pyopencl device.
    log
        What PoCL's compiler said of a program that should build. Nothing is touched unless it is one of `_SYMPTOMS`.

    Returns
    -------
    tuple of str, or None
        None where nothing was changed: another message, another system, or a record that is not as expected.
    """
    if not any(symptom in log for symptom in _SYMPTOMS):
        return None
    place = processor_field(device.int_ptr)
    if place is None:
        return None
    old = processor_name(place)
    new = known_processor(processor_flags())
    if old == new:
        return None
    _point(place, new)
    return old, new


def rename_as_before(device: Any, old: str, new: str) -> bool:
    """Repeat in this process what `rename_processor` did in another; return whether the name is now the new one.

    Nothing is touched unless the processor has the old name here too.
    """
    place = processor_field(device.int_ptr)
    if place is None:
        return False
    if processor_name(place) == old:
        _point(place, new)
    return processor_name(place) == new


def own_name(device: Any) -> str:
    """Return the name of the processor in a PoCL device's record as it is now, "" where it cannot be found."""
    place = processor_field(device.int_ptr)
    return "" if place is None else processor_name(place)


def processor_name(place: int) -> str:
    """Return the name that the pointer at ``place`` points to."""
    return ctypes.string_at(ctypes.c_uint64.from_address(place).value).decode("ascii")


def _point(place: int, name: str) -> None:
    memory = ctypes.create_string_buffer(name.encode("ascii"))
    _kept.append(memory)
    ctypes.c_uint64.from_address(place).value = ctypes.addressof(memory)


def processor_field(record: int) -> int | None:
    """Return the address of the pointer to the processor's name in a device's record; None unless there is just one.

    It is the field behind the only pointer to a target triple. The map of the process's memory is read anew, as the
    record may lie in memory that did not exist when the platforms were listed.
    """
    regions = _readable()
    size = _within(regions, record, _RECORD_BYTES)
    words = struct.unpack(f"={size // 8}Q", ctypes.string_at(record, size // 8 * 8))
    triples = [i for i, word in enumerate(words[:-1]) if _TRIPLE.fullmatch(_text(regions, word))]
    if len(triples) != 1 or not _NAME.fullmatch(_text(regions, words[triples[0] + 1])):
        return None
    return record + 8 * (triples[0] + 1)


def _readable() -> list[tuple[int, int]]:
    """Return the regions of memory that this process may read."""
    try:
        lines = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    parts = [line.split(maxsplit=2) for line in lines]
    bounds = [part[0].split("-") for part in parts if part[1].startswith("r") and "[v" not in part[-1]]
    return [(int(low, 16), int(high, 16)) for low, high in bounds]


def _within(regions: list[tuple[int, int]], address: int, size: int) -> int:
    """Return how many of ``size`` bytes from ``address`` on can be read."""
    return next((min(size, high - address) for low, high in regions if low <= address < high), 0)


def _text(regions: list[tuple[int, int]], address: int) -> bytes:
    """Return the bytes up to the zero byte, 64 at most; nothing where there is no such text."""
    text, zero, _ = ctypes.string_at(address, _within(regions, address, 64)).partition(b"\0")
    return text if zero else b""


#
# Marks of the processes at work in a folder, by which a later one sees that an earlier one has not ended well.
#
# Each process keeps a file and a lock on it, which the system takes back however the process ends. At its end it
# removes the file. So a file without a lock was left by a process that was killed, or crashed, and may have cut short
# what it was writing.

_SUFFIX = ".at-work"
_of_this_process: dict[Path, tuple[int, BinaryIO, Callable[[], bool]]] = {}
_unfinished: list[None] = []  # one for each piece of work that the end of the process would cut short


def left_behind(folder: Path) -> list[Path]:
    """Return the marks in a folder whose processes have not ended well; none where there is no folder."""
    try:
        marks = [path for path in folder.iterdir() if path.suffix == _SUFFIX]
    except OSError:
        return []
    return [mark for mark in marks if _is_left(mark)]


def _is_left(mark: Path) -> bool:
    import fcntl  # systems of the Unix kind alone have it

    with contextlib.suppress(OSError), mark.open("rb") as file:  # it may just have been removed
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        return True
    return False


def mark_work(folder: Path, *, ended_well: Callable[[], bool]) -> None:
    """Put the mark of this process into a folder, until it ends.

    Parameters
    ----------
    folder
        Made if need be.
    ended_well
        Called at the end: the mark stays where it returns False.

    Raises
    ------
    OSError
        When the folder cannot be written.
    """
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    hidden = folder / f"{os.getpid()}-{secrets.token_hex(4)}.new"
    file = hidden.open("xb")
    fcntl.flock(file, fcntl.LOCK_EX)
    mark = hidden.with_suffix(_SUFFIX)
    hidden.rename(mark)  # locked already: nobody takes it for one left behind
    _of_this_process[mark] = os.getpid(), file, ended_well
    atexit.register(end_work)


def leave_work() -> None:
    """Leave the marks to the process that this one was forked from."""
    for _, file, _ in _of_this_process.values():
        file.close()
    _of_this_process.clear()


def end_work() -> None:
    """Remove the marks of this process, which will do no more work; for those that end without Python's own end."""
    while _of_this_process:
        mark, (owner, _, ended_well) = _of_this_process.popitem()
        if os.getpid() == owner and not _unfinished and ended_well():  # not at the end of a child with the same memory
            mark.unlink(missing_ok=True)


@contextlib.contextmanager
def unfinished_work() -> Iterator[None]:
    """Work of a thread that is not waited for: a process that ends meanwhile has not ended well."""
    _unfinished.append(None)
    try:
        yield
    finally:
        _unfinished.pop()


#
# PoCL's cache of compiled kernels, made safe: a folder that can be written, and no file in it that was cut short.
#
# PoCL offers no device at all where it cannot make the folder, and brings the process down when it maps a kernel that
# a full disk or a crash has cut short. Thousands of programs take seconds to look through. So that is done only where
# something may have been cut short: after a process that did not end well, what was
# written since that one began; after a new start of the system, or a day, everything.
#
# Nobody but PoCL can find a program's code in its cache. So a note is put into a folder there for each program whose
# code was generated: who deletes the cache deletes the notes.

VARIABLE = "POCL_CACHE_DIR"
ROOM = 8 << 20  # bytes: the kernels of a scene with everything
WRITING = 1.0  # seconds that pass, at most, while a process writes a file
_CLOCKS_APART = 300.0  # seconds, at most, between those of the file systems of the cache and of the marks
_SOUND_FOR = 86400.0  # seconds after which all files are looked through again
_SOUND = "sound"  # name of the file that says when they were, and since which start of the system
_NOTES = "rptcam_cl"  # name of the folder of notes
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_ELF, _BITCODE = b"\x7fELF\x02\x01", b"BC\xc0\xde"


def pocl_cache_folder() -> Path:
    """Return where PoCL keeps compiled kernels."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 -- as PoCL itself does
    return Path(base) / "pocl" / "kcache"


def make_pocl_cache_usable() -> None:
    """Name a temporary folder for PoCL's cache if its own cannot be written; remove damaged files otherwise."""
    folder = pocl_cache_folder()
    barred = _why_unwritable(folder)
    if barred is None:
        marks = cache_dir("pocl") / hashlib.sha256(str(folder.absolute()).encode()).hexdigest()[:16]
        left = left_behind(marks)
        with contextlib.suppress(OSError):  # marks cannot be kept: the next process looks through all files again
            mark_work(marks, ended_well=lambda: _has_room(folder))
        if not _is_known_sound(marks):
            _mend(folder)
            _call_sound(marks, left)
        elif left:
            _mend(folder, since=_began(left))
            _forget(left)
        return
    try:
        place = scratch_folder()
    except OSError:
        return  # PoCL says what is wrong
    atexit.register(place.cleanup)
    os.environ[VARIABLE] = place.name
    warnings.warn(f"{folder}: {barred}; compiled kernels are not kept", stacklevel=1)


def lack_of_room() -> str | None:
    """Return why PoCL finds no place for what it compiles, in its cache or among temporary files; else None."""
    folder = pocl_cache_folder()
    barred = _why_unwritable(folder)
    if barred is None:
        return None
    place = f"{folder}: {barred}, and compiled kernels take {ROOM >> 20} MiB"
    return f"{place} (make room there, or set TMPDIR or {VARIABLE} to another folder)"


def is_code_noted(name: str) -> bool:
    """Return whether PoCL has the code of a program in its cache, by what `note_code` has put down."""
    return (pocl_cache_folder() / _NOTES / name).exists()


def note_code(name: str) -> None:
    """Put down that PoCL has generated the code of a program."""
    with contextlib.suppress(OSError):  # without a note it is only taken for missing
        note = pocl_cache_folder() / _NOTES / name
        note.parent.mkdir(exist_ok=True)
        note.touch()


def _mend(folder: Path, since: float = 0.0) -> None:
    """Remove damaged files that were written since a time [s], and the notes of what there is."""
    damaged = sum(map(_remove_program, _damaged_files(folder, since)))
    if damaged:
        shutil.rmtree(folder / _NOTES, ignore_errors=True)
        warnings.warn(f"{folder}: damaged kernels ({damaged}) are compiled anew", stacklevel=1)


def _is_known_sound(marks: Path) -> bool:
    """Return whether all files were looked through lately, and since the system was started."""
    try:
        with (marks / _SOUND).open("rb") as file:
            return (
                file.read() == _BOOT.read_bytes() and abs(time.time() - os.fstat(file.fileno()).st_mtime) < _SOUND_FOR
            )
    except OSError:
        return False


def _call_sound(marks: Path, left: list[Path]) -> None:
    """Write down that all files have been looked through; forget the processes that were a reason."""
    with contextlib.suppress(OSError):
        (marks / _SOUND).write_bytes(_BOOT.read_bytes())
        _forget(left)


def _began(left: list[Path]) -> float:
    """Return when the first of some processes may have begun to write, by their marks [s]."""
    with contextlib.suppress(OSError):  # another process has just looked: all is looked through then
        return min(mark.stat().st_mtime for mark in left) - _CLOCKS_APART
    return 0.0


def _forget(left: list[Path]) -> None:
    with contextlib.suppress(OSError):
        for mark in left:
            mark.unlink(missing_ok=True)


def _has_room(folder: Path) -> bool:
    """Return whether the disk of a folder has room for the kernels of a scene."""
    try:
        return shutil.disk_usage(folder).free >= ROOM
    except OSError:
        return False


def _why_unwritable(folder: Path) -> str | None:
    """Return why nothing can be kept in a folder, None where it can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"\0")
        if shutil.disk_usage(folder).free < ROOM:
            return "the disk is full"
    except OSError as error:
        return (error.strerror or str(error)).lower()
    return None


def _remove_program(path: Path) -> bool:
    """Remove what PoCL keeps of the program that a damaged file belongs to; tell whether that could be done."""
    folder = path.parent if path.name == "program.bc" else path.parents[2]
    with contextlib.suppress(OSError):
        shutil.rmtree(folder)
        return True
    return False


def _damaged_files(folder: Path, since: float) -> list[Path]:
    """Return the files of PoCL's cache, written since a time [s], that are not whole."""
    suspects = [path for path in _files(folder, since) if not _is_whole(path)]
    if suspects:
        time.sleep(WRITING)  # another process may just be writing them
    return [path for path in suspects if not _is_whole(path) and _age(path) >= WRITING]


def _age(path: Path) -> float:
    """Return how long ago a file was written [s]; nothing for one that is gone."""
    try:
        return time.time() - path.stat().st_mtime
    except OSError:
        return 0.0


def _files(folder: Path, since: float) -> Iterator[Path]:
    folders = [str(folder)]
    while folders:
        try:
            with os.scandir(folders.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        folders.append(entry.path)
                    elif entry.name.endswith((".so", "program.bc")) and entry.stat().st_mtime >= since:
                        yield Path(entry.path)
        except OSError:  # another process is at work
            continue


def _is_whole(path: Path) -> bool:
    try:
        with path.open("rb", buffering=0) as file:
            head = file.read(64)
            size = os.fstat(file.fileno()).st_size
            return _whole_library(head, size) if path.suffix == ".so" else _whole_bitcode(file, head, size)
    except OSError:  # it has just been replaced, or is not for us to judge
        return True


def _whole_library(head: bytes, size: int) -> bool:
    """Return whether a shared library ends where its section headers, which a linker puts last, say."""
    if not head.startswith(_ELF) or len(head) < 64:
        return False
    offset, entry, count = struct.unpack_from("<Q10xHH", head, 40)
    return bool(offset + entry * count <= size)


def _whole_bitcode(file: io.FileIO, head: bytes, size: int) -> bool:
    """Return whether the top-level blocks of LLVM's bitcode fill the file to its end (LLVM Bitcode File Format)."""
    if not head.startswith(_BITCODE):
        return False
    place = 4
    while place + 8 <= size:
        block, words = struct.unpack("<II", os.pread(file.fileno(), 8, place))
        if block & 3 != 1:  # ENTER_SUBBLOCK: nothing else stands at top level
            return False
        place += 8 + 4 * words
    return place == size > 4


#
# OpenCL on this system: the binding, the drivers that it must be shown, and what to install where none can be used.
#
# Intel's OpenCL for processors, as pip installs it, has to be shown to the loader of OpenCL drivers. Its ``.icd``
# file, which should name the driver's library, names a path of the machine that built the wheel; and no loader looks
# into an environment of Python. The libraries lie in the environment's ``lib``, where they find each other. On
# Windows the wheels are found without help.
#
# ocl-icd, the loader in pyopencl's wheels, takes one folder of ``.icd`` files, besides what pyopencl brings itself.
# So the drivers of the system are named anew in a temporary folder, together with Intel's.

PACKAGE = "intel-opencl-rt"
LIBRARY = "libintelocl.so"
VARIABLES = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH", "OCL_ICD_FILENAMES")  # a user who sets one knows better
SYSTEM = Path("/etc/OpenCL/vendors")
# PoCL 7 cuts a kernel at its loops into regions, as if there were barriers, and reads memory anew in a later region
# where it needs a value of an earlier one: also where that memory has been written in between, so that camera rays were
# garbage. PoCL mends the second by "WorkitemLoops: do not rematerialize mutable loads" (July 2026, not in 7.2-RC1).
# Without the first, kernels without barriers are one region, and compile in three quarters of the time.
AS_BEFORE_POCL_7 = ("POCL_FORCE_PARALLEL_OUTER_LOOP", "POCL_PREGION_VALUE_REMAT")


@lru_cache(maxsize=1)
def load_opencl() -> Any:
    """Return the module ``pyopencl``.

    Before it loads, and so before the drivers do, the environment of this process is put right:

    - pyopencl's own caches are off. One is a database that stops everything when it cannot be written or is damaged,
      and saves nothing that can be measured; the other is replaced by `rptcam_cl.device.programs`.
    - PoCL's cache lies where it can be written, and holds no damaged files.
    - PoCL 7 compiles kernels without barriers as its earlier versions do, see `AS_BEFORE_POCL_7`.
    - Intel's runtime is found where pip has put it.

    Raises
    ------
    DeviceError
        When it cannot be imported.
    """
    for name in AS_BEFORE_POCL_7:
        os.environ.setdefault(name, "0")
    if sys.platform.startswith("linux"):
        make_pocl_cache_usable()
        _show_intel_runtime()
    return import_binding()


_began_in: list[int] = []  # number of the process that asked drivers first


def begin() -> None:
    """Note that drivers are used from here on, which a process that is forked from this one cannot do.

    Raises
    ------
    DeviceError
        In such a process: the threads of its drivers are not there, and it would wait for them for ever.
    """
    if not _began_in:
        _began_in.append(os.getpid())
    if _began_in[0] != os.getpid():
        raise DeviceError(
            "this process was forked from one that had used OpenCL, whose drivers do not live on in it; allowed: "
            "processes that start anew, as of multiprocessing.get_context('spawn'), or forks before the first device"
        )


def import_binding() -> Any:
    """Return the module ``pyopencl``, without a look at drivers; only to be imported by a process that forks others.

    Raises
    ------
    DeviceError
        When it cannot be imported.
    """
    os.environ.setdefault("PYOPENCL_NO_CACHE", "1")
    try:
        import pyopencl
        import pyopencl.characterize  # wanted by the first build
    except Exception as error:  # a missing library, or a cache folder that a user has set
        raise DeviceError(f"pyopencl cannot be imported ({error}); {to_install()}") from error
    return pyopencl


def _show_intel_runtime() -> None:
    """Name a folder of drivers to the loader if pip has installed Intel's runtime and the user names no drivers."""
    if any(os.environ.get(name) for name in VARIABLES):
        return
    library = _intel_library()
    if library is None:
        return
    with contextlib.suppress(OSError):
        place = scratch_folder()
        atexit.register(place.cleanup)
        folder = Path(place.name)
        for driver in sorted(SYSTEM.glob("*.icd")):
            if LIBRARY not in driver.read_text(errors="replace"):  # the same driver, installed twice
                shutil.copyfile(driver, folder / driver.name)
        (folder / "intel-from-pip.icd").write_text(f"{library}\n")
        os.environ["OCL_ICD_VENDORS"] = str(folder)


def _intel_library() -> Path | None:
    """Return the library of Intel's runtime in this environment of Python; None where it is not installed."""
    try:
        files = metadata.files(PACKAGE) or []
    except metadata.PackageNotFoundError:
        return None
    paths = (Path(str(file.locate())) for file in files if file.name == LIBRARY)
    return next((path.resolve() for path in paths if path.is_file()), None)


def to_install() -> str:
    """Advise how to get an OpenCL device on this system."""
    on_x86 = platform.machine().lower() in ("x86_64", "amd64")
    if sys.platform.startswith("linux") and on_x86:
        return "install PoCL with \"pip install 'rptcam_cl[pocl]'\" or the OpenCL driver of your GPU"
    if sys.platform == "win32" and on_x86:
        return 'install Intel\'s OpenCL with "pip install rptcam_cl[pocl]" or the OpenCL driver of your GPU'
    if sys.platform == "darwin":
        return "macOS brings an OpenCL of its own; does it run in a sandbox or a virtual machine?"
    return "install PoCL from your distribution (Debian, Ubuntu: apt install pocl-opencl-icd) or the driver of your GPU"


def instead() -> str:
    """Advise what to install in place of drivers that cannot compile."""
    if platform.machine().lower() not in ("x86_64", "amd64") or sys.platform == "darwin":
        return "install another OpenCL, as of your distribution or of your GPU"
    ways = ["Intel's OpenCL for any x86-64 processor with \"pip install 'rptcam_cl[intel]'\""]
    if sys.platform.startswith("linux"):
        ways.append("your distribution's PoCL (Debian, Ubuntu: apt install pocl-opencl-icd)")
    return f"install {', '.join(ways)} or the OpenCL driver of your GPU"
