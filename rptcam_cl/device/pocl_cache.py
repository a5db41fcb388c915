"""PoCL's cache of compiled kernels, made safe: a folder that can be written, and no file in it that was cut short.

PoCL offers no device at all where it cannot make the folder, and brings the process down when it maps a kernel that a
full disk or a crash has cut short. Thousands of programs take seconds to look through. So that is done only where
something may have been cut short: after a process that did not end well (`rptcam_cl.device.at_work`), what was written
since that one began; after a new start of the system, or a day, everything.

Nobody but PoCL can find a program's code in its cache. So a note is put into a folder there for each program whose code
was generated: who deletes the cache deletes the notes.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import io
import os
import shutil
import struct
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path

from rptcam_cl.core.atomic import scratch_folder
from rptcam_cl.core.resources import cache_dir
from rptcam_cl.device.at_work import left_behind, mark_work

VARIABLE = "POCL_CACHE_DIR"
ROOM = 8 << 20  # bytes: the kernels of a scene with everything
WRITING = 1.0  # seconds that pass, at most, while a process writes a file
CLOCKS_APART = 300.0  # seconds, at most, between those of the file systems of the cache and of the marks
SOUND_FOR = 86400.0  # seconds after which all files are looked through again
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
    barred = _barred(folder)
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
    barred = _barred(folder)
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
    damaged = sum(map(_removed, _damaged(folder, since)))
    if damaged:
        shutil.rmtree(folder / _NOTES, ignore_errors=True)
        warnings.warn(f"{folder}: damaged kernels ({damaged}) are compiled anew", stacklevel=1)


def _is_known_sound(marks: Path) -> bool:
    """Return whether all files were looked through lately, and since the system was started."""
    try:
        with (marks / _SOUND).open("rb") as file:
            return file.read() == _BOOT.read_bytes() and abs(time.time() - os.fstat(file.fileno()).st_mtime) < SOUND_FOR
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
        return min(mark.stat().st_mtime for mark in left) - CLOCKS_APART
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


def _barred(folder: Path) -> str | None:
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


def _removed(path: Path) -> bool:
    """Remove what PoCL keeps of the program that a damaged file belongs to; tell whether that could be done."""
    folder = path.parent if path.name == "program.bc" else path.parents[2]
    with contextlib.suppress(OSError):
        shutil.rmtree(folder)
        return True
    return False


def _damaged(folder: Path, since: float) -> list[Path]:
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
