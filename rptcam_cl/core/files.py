"""Files: the package's, those that other files name, and whole or not at all."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import hashlib
import io
import math
import os
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, MissingFileError, OutsideFolderError, RptcamError, StateError

if TYPE_CHECKING:
    import tempfile


# Where the package's data lie, inside an installed package or beside it in a checkout; and where caches are kept.

CACHE_VARIABLE = "RPTCAM_CACHE_DIR"
EXAMPLES = ("first_light", "colour_chart", "sunny_sixteen")  # those that the README renders; each is one file
# Scenes that come with the package: the files of each below the folder of examples, the scene file first.
_SINGLE = (
    "portrait", "materials", "daylight", "reading_room", "propeller", "panning", "prism", "lamps", "lamps_f16",
    "mirror_telephoto", "night_street", "lamp_rings", "sharpness", "sun_ghosts",
)  # fmt: skip
_TEA_TABLE = (
    "tea_table.yaml", "bouquet.glb", "cloth.ply", "flask.ply", "knot.ply", "linen.jpg", "room.hdr", "stone.ply",
    "tea_set.glb", "vase.ply", "wood.jpg",
)  # fmt: skip
_EVENING = (
    "evening.yaml", "bouquet.glb", "candle.ply", "candlestick.ply", "cloth.ply", "flask.ply", "goblet.ply", "knot.ply",
    "linen.jpg", "tea_set.glb", "vase.ply", "wine.ply", "wood.jpg",
)  # fmt: skip
SCENES = {name: (f"{name}.yaml",) for name in (*EXAMPLES, *_SINGLE)} | {
    "tea_table": tuple(f"studio/{name}" for name in _TEA_TABLE),
    "evening": tuple(f"studio/{name}" for name in _EVENING),
}
_PACKAGE = Path(__file__).resolve().parents[1]


@lru_cache(maxsize=8)
def _folder(name: str) -> Path:
    candidates = (_PACKAGE / "_data" / name, _PACKAGE.parent / name)
    for folder in candidates:
        if folder.is_dir():
            return folder
    places = " or ".join(str(folder) for folder in candidates)
    raise StateError(f"the installation is incomplete: no folder {places}; reinstall rptcam_cl")


def package_dir() -> Path:
    """Folder of the program."""
    return _PACKAGE


def kernels_dir() -> Path:
    """Folder of the OpenCL sources."""
    return _folder("kernels")


def reference_dir() -> Path:
    """Folder of the reference scenes."""
    return _folder("tests/data/reference")


def lenses_dir() -> Path:
    """Folder of the lens files that come with the package."""
    return _folder("lenses")


def example_scenes() -> dict[str, Path]:
    """Return the scene files that come with the package, by name; the first is the one of the first picture."""
    folder = _folder("examples")
    return {name: folder / files[0] for name, files in SCENES.items()}


def example_files(name: str) -> tuple[Path, ...]:
    """Return the files of a scene that comes with the package, the scene file first; they lie in one folder."""
    folder = _folder("examples")
    return tuple(folder / file for file in SCENES[name])


def spectra_dir() -> Path:
    """Folder of the tables of spectra."""
    return _PACKAGE / "core" / "spectra"


def response_curves_dir() -> Path:
    """Folder of the response curves of cameras."""
    return _PACKAGE / "core" / "response_curves"


def glass_catalogues_dir() -> Path:
    """Folder of the glasses of the makers."""
    return _PACKAGE / "optics" / "catalogues"


def cache_dir(kind: str) -> Path:
    """Return the folder of one kind of cache: in ``RPTCAM_CACHE_DIR``, else where the system keeps caches.

    It need not exist, and it may be impossible to make it.
    """
    named = os.environ.get(CACHE_VARIABLE)
    return (Path(named) if named else _system_cache() / "rptcam_cl") / kind


@contextlib.contextmanager
def fresh_cache() -> Iterator[None]:
    """Keep caches in an empty folder while the block runs, which is removed then."""
    before = os.environ.get(CACHE_VARIABLE)
    with scratch_folder() as folder:
        os.environ[CACHE_VARIABLE] = folder
        try:
            yield
        finally:
            os.environ.pop(CACHE_VARIABLE)
            if before is not None:
                os.environ[CACHE_VARIABLE] = before


def _system_cache() -> Path:
    home = Path(os.path.expanduser("~"))  # noqa: PTH111 -- Path.home() raises where there is no home
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    if sys.platform == "darwin":
        return home / "Library" / "Caches"
    named = os.environ.get("XDG_CACHE_HOME", "")
    return Path(named) if os.path.isabs(named) else home / ".cache"  # noqa: PTH117 -- the standard ignores other paths


#
# Files that other files name: looked for inside allowed folders only, and read only if regular and of bearable size.
#
# A scene or a lens may come from a stranger. What it names must therefore lie in the folder that it came in, also
# behind symbolic links; a pipe that never ends or a device that holds the whole of memory is refused before it is
# read.

_NAMED: ContextVar[set[Path] | None] = ContextVar("files that were named", default=None)
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)


@dataclass(frozen=True)
class Folders:
    """Where files may lie that another file names.

    Attributes
    ----------
    base : Path
        Folder where relative paths start, and inside which files may lie.
    allowed : tuple of Path
        Further folders inside which files may lie.
    owner : str
        What errors call the file that names others.
    """

    base: Path = dataclasses.field(default_factory=Path.cwd)
    allowed: tuple[Path, ...] = ()
    owner: str = "scene"

    def find(self, reference: str) -> Path:
        """Return the real path of a file that is named.

        Raises
        ------
        InputError
            When it lies elsewhere (also by a symbolic link), does not exist or is not a regular file.
        """
        try:
            path = (self.base / reference).resolve()
            roots = [root.resolve() for root in (self.base, *self.allowed)]
            inside = any(path.is_relative_to(root) for root in roots)
            regular, exists = path.is_file(), path.exists()
        except (OSError, ValueError, RuntimeError) as problem:
            raise InputError(f"is not a usable path ({problem})") from None
        if inside and (named := _NAMED.get()) is not None:
            named.add(path)
        if not inside:
            allowed = ", ".join(dict.fromkeys(map(str, roots)))
            said = f"lies outside the {self.owner}'s folder (got {path}; allowed: files in {allowed})"
            raise OutsideFolderError(said)
        if not exists:
            raise MissingFileError(f"no such file (got {path})")
        if not regular:
            raise InputError(f"is not a regular file (got {path})")
        return path

    def find_beside(self, path: Path) -> Callable[[Path], Path]:
        """Return the references that resolve what a file names relative to itself."""
        return lambda reference: self.find(str(path.parent / reference))

    def beside(self, path: Path) -> Folders:
        """Return where files may lie that a file in these folders names, relative to itself."""
        return Folders(path.parent, (self.base, *self.allowed), self.owner)


class References:
    """Reads the files that one file names, and keeps account of what they said.

    Parameters
    ----------
    folders : Folders
        Where they may lie; the working folder for data that no file holds.
    """

    def __init__(self, folders: Folders | None = None) -> None:
        self._folders = folders
        self._read: dict[str, str] = {}

    def read(self, reference: str, most: int) -> tuple[Path, bytes]:
        """Return the path and the content of a file that is named.

        Raises
        ------
        InputError
            When it may not be read, does not exist, is not a regular file, or has more than ``most`` bytes.
        StateError
            When it cannot be read.
        """
        path = (self._folders or Folders()).find(reference)
        content = read_whole(path, most)
        self._read[reference] = hashlib.sha256(content).hexdigest()
        return path, content

    def digests(self) -> dict[str, str]:
        """Return the SHA-256 of each file that was read, by the name in the request."""
        return dict(sorted(self._read.items()))


@contextmanager
def name_errors(place: object) -> Iterator[None]:
    """Within the block errors that are reported in one line begin with a place: ``bunny.ply: is too large``."""
    try:
        yield
    except RptcamError as problem:
        problem.args = (f"{place}: {problem}",)
        raise


@contextmanager
def named_files() -> Iterator[set[Path]]:
    """A set that takes the real path of every file that is named while the block runs, found or missing."""
    named: set[Path] = set()
    token = _NAMED.set(named)
    try:
        yield named
    finally:
        _NAMED.reset(token)


def open_regular(path: Path, most: int) -> io.BufferedReader:
    """Return a file opened for reading in binary; it is a regular one, of at most ``most`` bytes.

    Raises
    ------
    InputError
        When it is not; the message says why, not which file.
    StateError
        When it cannot be opened.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | _WITHOUT_WAITING)
    except FileNotFoundError:
        raise InputError("no such file") from None
    except ValueError as problem:  # a NUL byte in the name
        raise InputError(f"is not a usable path ({problem})") from None
    except OSError as problem:
        raise StateError(f"cannot be read ({problem.strerror})") from None
    state = os.fstat(descriptor)
    if stat.S_ISREG(state.st_mode) and state.st_size <= most:
        return os.fdopen(descriptor, "rb")
    os.close(descriptor)
    if not stat.S_ISREG(state.st_mode):
        raise InputError("is not a regular file")
    raise InputError(f"is too large (got {state.st_size} bytes; allowed: at most {most})")


def read_whole(source: Path | bytes, most: int) -> bytes:
    """Return the content of a regular file of at most ``most`` bytes, or what is known of it.

    Raises
    ------
    InputError
        When it is not one, or grew beyond that; the message says why, not which file.
    StateError
        When it cannot be read.
    """
    if isinstance(source, bytes):
        content = source
    else:
        with open_regular(source, most) as file:
            try:
                content = file.read(most + 1)
            except OSError as problem:
                raise StateError(f"cannot be read ({problem.strerror})") from None
    if len(content) > most:
        raise InputError(f"is too large (got {len(content)} bytes or more; allowed: at most {most})")
    return content


def digest(path: Path, most: int) -> str:
    """Return the SHA-256 of the content of a regular file of at most ``most`` bytes.

    Raises
    ------
    InputError
        When it is not one; the message names the file.
    StateError
        When it cannot be read.
    """
    try:
        with name_errors(path), open_regular(path, most) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as problem:
        raise StateError(f"{path}: cannot be read ({problem.strerror})") from None


# Files that are either the old one or the whole new one, whatever happens while they are written.

_STRAY_SECONDS = 7 * 24 * 3600  # after which a file that is still being written has been left behind


def _process_space() -> str:
    """Identify the scope of process numbers: a boot of a system, a container; empty if unknown.

    Host names do not: two containers with one name have processes of the same numbers.
    """
    try:
        start = Path("/proc/sys/kernel/random/boot_id").read_text("ascii").strip()
        space = os.stat("/proc/self/ns/pid").st_ino  # noqa: PTH116 -- the link's own target cannot be opened
    except (OSError, ValueError):
        return ""
    return hashlib.sha256(f"{start} {space}".encode()).hexdigest()[:16]


_SPACE = _process_space()


def _name_of_process() -> str:
    return f".rptcam-{_SPACE or 'unknown'}-{os.getpid()}-"


def _temporary_name() -> str:
    return f"{_name_of_process()}{secrets.token_hex(4)}.tmp"


def scratch_folder() -> tempfile.TemporaryDirectory[str]:
    """A folder among the system's temporary ones; where the process is killed, it goes with the next such folder."""
    import tempfile

    remove_strays(Path(tempfile.gettempdir()))
    return tempfile.TemporaryDirectory(prefix=_name_of_process(), suffix=".tmp", ignore_cleanup_errors=True)


@contextlib.contextmanager
def utf8_name(path: str | os.PathLike[str]) -> Iterator[str]:
    """A name of a file for libraries that take UTF-8 alone: its own, or else a link to it."""
    try:
        name = os.fspath(path)
        name.encode()
    except UnicodeEncodeError:
        with scratch_folder() as folder:
            link = os.path.join(folder, f"link{Path(path).suffix}")  # noqa: PTH118
            os.symlink(os.path.abspath(path), link)  # noqa: PTH100, PTH211
            yield link
    else:
        yield name


def _is_alive(pid: int) -> bool:
    if os.name != "posix":
        return True  # signal 0 is a query on POSIX only; elsewhere it would be sent
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def remove_strays(folder: Path) -> None:
    """Remove temporary files and folders that killed runs left: those of this system and container, or a week old."""
    for stray in folder.glob(".rptcam-*-*.tmp"):
        space, pid = stray.name.split("-")[1:3]
        with contextlib.suppress(OSError):
            is_here = bool(_SPACE) and space == _SPACE and pid.isdecimal()
            is_dead = is_here and not _is_alive(int(pid))
            is_old = stray.lstat().st_mtime < time.time() - _STRAY_SECONDS
            if stray.is_dir() and not stray.is_symlink():
                if is_dead or (is_old and not is_here):
                    shutil.rmtree(stray, ignore_errors=True)
            elif is_dead or is_old:
                stray.unlink()


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside ``path``; what is written there takes its place when the block ends without an error.

    The new file is on the disk before it takes the name, so that a reader, a crash or a full disk never meets half a
    file. A symbolic link keeps pointing where it did, and its target is replaced.
    """
    target = Path(os.path.realpath(path))
    temporary = target.parent / _temporary_name()
    try:
        remove_strays(target.parent)
        yield temporary
        _sync(temporary, os.O_RDWR)
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o7777)
        temporary.replace(target)
        if os.name == "posix":
            _sync(target.parent, os.O_RDONLY)  # the new name, too, has to survive a power cut
    except (OSError, RuntimeError) as error:
        raise StateError(f"{path}: cannot be written: {_reason(error)}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def resolve_links(path: Path) -> Path:
    """Return the path of a file in a folder that the program fills; a symbolic link in its place is removed.

    Links that a user names as an output are written through. In such a folder they would lead files out of it.

    Raises
    ------
    StateError
        It cannot be removed.
    """
    try:
        if path.is_symlink():
            path.unlink()
    except OSError as error:
        raise StateError(f"{path}: is a link, and cannot be replaced: {_reason(error)}") from error
    return path


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error)


def make_folder(path: Path) -> Path:
    """Make a folder where there is none, with those above it.

    Raises
    ------
    StateError
        It cannot be made, or a file has its name.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        why = "is a file, not a folder" if path.is_file() else f"cannot be made: {_reason(problem)}"
        raise StateError(f"{path}: {why}") from None
    return path


# What pictures are written as: `imaging/writers.py` writes them, raw files `imaging/formats.py`.
DEVELOPED_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
FILM_SUFFIXES, LAYER_SUFFIXES = (".exr", ".npy", ".npz"), (".exr", ".npz")
RAW_SUFFIXES = (".dng", ".tif", ".tiff", ".npy")


def listed(suffixes: Iterable[str], conjunction: str = "or") -> str:
    """Suffixes in a sentence, as ``.png, .jpg or .tif``, without their second spellings."""
    *others, last = (suffix for suffix in suffixes if suffix not in (".jpeg", ".tiff"))
    return f"{', '.join(others)} {conjunction} {last}"


def known_suffix(path: str | os.PathLike[str], suffixes: Iterable[str], problem: str, hint: str = "") -> str:
    """Return the suffix of a file in small letters; raise an error that states a problem where none such is allowed."""
    suffix = Path(path).suffix.lower()
    if suffix not in suffixes:
        allowed = ", ".join(dict.fromkeys(suffixes))
        raise InputError(f"{path}: {problem} (got {suffix or 'no suffix'}; allowed: {allowed}){hint}")
    return suffix


def check_writable(path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an error when a file could not be written at ``path``. Nothing is left behind.

    Parameters
    ----------
    path
        Where the file is to go.
    inputs
        Files that it must not overwrite.

    Raises
    ------
    InputError
        The file is one of the inputs.
    StateError
        There is no folder, or no permission, or something else in the way.
    """
    target = Path(os.path.realpath(path))
    if any(target == Path(os.path.realpath(source)) for source in inputs):
        raise InputError(f"{path}: is an input; choose another name")
    if target.is_symlink():
        raise StateError(f"{path}: is a symbolic link that leads back to itself; remove it or choose another name")
    if target.is_dir():
        raise StateError(f"{path}: is a folder; name a file in it")
    if target.exists() and not target.is_file():
        raise StateError(f"{path}: is not a regular file")
    if not target.parent.is_dir():
        raise StateError(f"{path}: there is no folder {target.parent}; make it first")
    if target.exists() and not os.access(target, os.W_OK):
        raise StateError(f"{path}: exists and may not be overwritten")
    probe = target.parent / _temporary_name()
    try:
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as error:
        raise StateError(f"{path}: cannot be written: {_reason(error)}") from error


# How much memory the host has free, and giving back what a process no longer uses.


def free_host_bytes() -> int | None:
    """Return how many bytes programs can still take without swapping; None where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return None
    kilobytes = [int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    return 1024 * kilobytes[0] if kilobytes else None


def give_back() -> bool:
    """Give the system the memory that was freed but is kept for later; return whether the C library can do so.

    glibc keeps what is freed between pieces that are still in use (malloc_trim(3)). Other libraries are left alone.
    """
    trim = _trim()
    if trim is not None:
        trim(0)
    return trim is not None


@lru_cache(maxsize=1)
def _trim() -> Callable[[int], int] | None:
    if not sys.platform.startswith("linux"):
        return None
    with contextlib.suppress(OSError, AttributeError, TypeError):
        malloc_trim = ctypes.CDLL(None).malloc_trim
        malloc_trim.argtypes, malloc_trim.restype = (ctypes.c_size_t,), ctypes.c_int
        return malloc_trim
    return None


# Whether a file is another than before.

FileState = tuple[int, int, int] | None


def file_state(path: Path) -> FileState:
    """The time of change, size and inode of a file; None where there is none."""
    try:
        state = path.stat()
    except OSError:
        return None
    return state.st_mtime_ns, state.st_size, state.st_ino


# Values that files can hold.


def plain(value: Any, *, json: bool = False) -> Any:
    """Copy a value as mappings, lists and Python's scalars, no two parts of which are the same list.

    Parameters
    ----------
    json
        Records are mappings, and numbers that are not finite, which JSON cannot say, are None.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item, json=json) for key, item in value.items()}
    if json and dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain(dataclasses.asdict(value), json=True)
    if json and hasattr(value, "_asdict"):
        return plain(value._asdict(), json=True)
    if isinstance(value, list | tuple):
        return [plain(item, json=json) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist(), json=json)
    return None if json and isinstance(value, float) and not math.isfinite(value) else value
