"""A process that stays after a command, where the user asks for it, and runs the next ones, whose imports it has.

It never runs a command itself and opens no device, as threads and drivers do not live through a fork. For each command
it forks a keeper, which forks the worker. The worker takes over the command's words, environment, folder and open
files, and goes on as a process that has just imported all modules. The keeper hands signals to it, kills it where the
command's process is gone, and tells that one how it has ended. So neither needs the resident process any more.

A command is run there only if nothing differs that is fixed when Python begins (`_facts`) and no code has changed
since; else it runs by itself, as without all this. Sockets lie in a folder that this user alone can enter.

Modules that take long to import are imported where they are used: of this file, most commands need little.
"""

from __future__ import annotations

import os
import signal
import sys

from rptcam_cl.core import __version__
from rptcam_cl.core.errors import InputError

TYPE_CHECKING = False  # as of `typing`, which takes long to import
if TYPE_CHECKING:
    import socket
    from collections.abc import Iterable, Iterator
    from typing import NoReturn

VARIABLE = "RPTCAM_RESIDENT"
_FOLDER = "XDG_RUNTIME_DIR"  # environment variable: the system's folder for sockets of this user
_FILES = "/proc/self/fd"
_TIMEOUT_S = 2.0  # for an answer, after which a command runs by itself
_BEGUN = b"b"
_MOST_FILES = 200  # that are open when a command begins; a message takes 253
_SIGNALS = "SIGHUP", "SIGINT", "SIGQUIT", "SIGTERM", "SIGUSR1", "SIGUSR2", "SIGTSTP", "SIGCONT"
_PASSED_ON = tuple(getattr(signal, name) for name in _SIGNALS if hasattr(signal, name))
_BY_TERMINALS = {"SIGINT", "SIGQUIT", "SIGTSTP", "SIGCONT"}  # which send them to all processes of a command
_KILL_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl
# Variables that are read when Python or a library begins, by how they begin; all others are read when they are used.
_READ_EARLY = (
    "BLIS_", "GLIBC_", "GOTO", "HOME", "LANG", "LC_", "LD_", "MALLOC_", "MKL_", "NPY_", "NUMPY_", "OMP_", "OPENBLAS_",
    "PILLOW_", "PYDANTIC_", "PYOPENCL_", "PYTHON", "TZ", "_PYTHON",
)  # fmt: skip
_OF_STATUS = "Uid:", "Gid:", "Groups:", "SigBlk:", "Cap", "NoNewPrivs:", "Seccomp", "Cpus_allowed:", "Mems_allowed:"


def minutes_to_stay() -> float:
    """Return for how many minutes without a command the process stays; 0 where it is not wanted.

    Raises
    ------
    InputError
        When the variable holds something else.
    """
    said = os.environ.get(VARIABLE, "") or "0"
    try:
        minutes = float(said)
    except ValueError:
        minutes = -1.0
    if not 0.0 <= minutes <= 1e5:
        allowed = "minutes that a process stays after a command, as 15; 0 or no variable: none stays"
        raise InputError(f"{VARIABLE}: got {said} (allowed: {allowed})")
    return minutes


def _facts() -> bytes:
    """Return all that is fixed when Python begins and that a command could notice."""

    def read(name: str) -> list[str]:
        with open(f"/proc/self/{name}", encoding="utf-8", errors="replace") as file:
            return file.read().splitlines()

    root = os.stat("/")
    return repr(
        (
            (__version__, __file__, sys.version, sys.executable, sys.path),
            sorted((name, value) for name, value in os.environ.items() if name.startswith(_READ_EARLY)),
            [line for line in read("status") if line.startswith(_OF_STATUS)],
            [read(name) for name in ("limits", "cgroup", "oom_score_adj")],
            [os.readlink(f"/proc/self/ns/{name}") for name in sorted(os.listdir("/proc/self/ns"))],
            (root.st_dev, root.st_ino, os.getpriority(os.PRIO_PROCESS, 0), os.sched_getscheduler(0)),
        )
    ).encode(errors="backslashreplace")


def _open_folder() -> int:
    """Open the folder of the sockets, made if need be.

    Raises
    ------
    OSError
        When it cannot be, or another user may enter it.
    """
    path = os.path.join(os.environ.get(_FOLDER) or "/tmp", f"rptcam-{os.geteuid()}")
    try:
        os.mkdir(path, 0o700)
    except FileExistsError:
        pass
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    state = os.fstat(folder)
    if state.st_uid == os.geteuid() and state.st_mode & 0o077 == 0:
        return folder
    os.close(folder)
    raise PermissionError(f"{path}: another user may enter it (allowed: a folder of your own, of mode 700)")


def _socket_of(facts: bytes) -> str:
    """The name of the socket for a kind of command."""
    import binascii

    return f"{binascii.crc32(facts):08x}"


def _connect(folder: int, name: str) -> tuple[socket.socket, int]:
    """Connect to the process that listens at a socket of the folder, if it is this user's; return its number as well.

    Raises
    ------
    OSError
        When nobody listens there, or another user.
    """
    import socket

    link = socket.socket(socket.AF_UNIX)
    link.settimeout(_TIMEOUT_S)
    link.connect(f"{_FILES}/{folder}/{name}")  # whatever stands at the folder's path by now
    return link, _peer(link)


def _peer(link: socket.socket) -> int:
    """Return the number of the process at the other end, which is of this user."""
    import socket

    credentials = link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)
    process, user = (int.from_bytes(credentials[at : at + 4], sys.byteorder) for at in (0, 4))
    if user != os.geteuid():
        raise PermissionError
    return process


def residents() -> Iterator[int]:
    """Yield the numbers of the resident processes of this user; remove what those that were killed have left.

    Raises
    ------
    OSError
        As of the folder.
    """
    folder = _open_folder()
    for name in os.listdir(folder):
        try:
            yield _connect(folder, name)[1]
        except ConnectionRefusedError:
            os.unlink(name, dir_fd=folder)
    os.close(folder)


class Command:
    """A command as it was begun, before its process has changed anything of itself."""

    def __init__(self, minutes: float) -> None:
        self._minutes, self._path = minutes, list(sys.path)
        self._environment, self._facts = dict(os.environb), _facts()
        self._umask = os.umask(0o077)
        os.umask(self._umask)
        self._ignored = [number for number in _PASSED_ON if signal.getsignal(number) == signal.SIG_IGN]
        self._files = [int(name) for name in os.listdir(_FILES) if os.path.exists(f"{_FILES}/{name}")]

    @classmethod
    def begun(cls) -> Command | None:
        """Return the command of this process; None where it has to run by itself.

        Python may have options of its own or look for modules where the command is; numpy's threads do not live
        through a fork; or the system does not tell what has to be known.

        Raises
        ------
        InputError
            As of `minutes_to_stay`.
        """
        minutes, option = minutes_to_stay(), sys.orig_argv[1]
        if minutes and sys.platform != "linux":
            print(f"warning: {VARIABLE}: is for Linux alone; the command runs by itself", file=sys.stderr)
            return None
        has_options = option != "-m" and option.startswith("-")
        has_threads = os.environ.get("OPENBLAS_NUM_THREADS", "1") != "1"
        if not minutes or has_options or has_threads or not all(path.startswith("/") for path in sys.path):
            return None
        try:
            return cls(minutes)
        except OSError:
            return None

    def run_there(self) -> int | None:
        """Have the resident process run the command, and return its exit code; None where nothing was begun."""
        try:
            folder = _open_folder()
        except OSError as problem:
            print(f"warning: {VARIABLE}: {problem}; the command runs by itself", file=sys.stderr)
            return None
        try:
            link, _ = _connect(folder, _socket_of(self._facts))
            self._send(link)
            has_begun = link.recv(1) == _BEGUN
        except OSError:
            return None
        finally:
            os.close(folder)
        return self._wait(link) if has_begun else None

    def _send(self, link: socket.socket) -> None:
        import socket

        if len(self._files) > _MOST_FILES or max(self._files) + _MOST_FILES > os.sysconf("SC_OPEN_MAX"):
            raise OSError("too many open files")
        numbers = [[self._umask, *self._files], self._ignored]
        words = [os.fsencode(word) for word in sys.argv]
        variables = [name + b"=" + value for name, value in self._environment.items()]
        head = [self._facts, *(b" ".join(b"%d" % each for each in row) for row in numbers), b"%d" % len(words)]
        text = b"\0".join([*head, *words, *variables])
        message = len(text).to_bytes(8, "little") + text
        folder = os.open(".", os.O_PATH | os.O_DIRECTORY)
        sent = socket.send_fds(link, [message], [*self._files, folder])
        link.sendall(message[sent:])
        os.close(folder)

    def _wait(self, link: socket.socket) -> int:
        """Hand signals on until the command has ended, and end as it has."""
        import select

        # Signals are read from a pipe: one that comes just before a blocking call would wait for that call's end.
        caught, catching = os.pipe()
        os.set_blocking(catching, False)
        signal.set_wakeup_fd(catching)
        for number in _PASSED_ON:
            if number not in self._ignored:
                signal.signal(number, _go_on)
        link.settimeout(None)
        while caught in select.select([link.fileno(), caught], [], [])[0]:
            for number in os.read(caught, 64):
                _hand_on(link, number)
        try:
            said = link.recv(4)
        except OSError:
            said = b""
        if len(said) < 4:
            print("error: the process that ran the command was killed", file=sys.stderr)
            return 1
        code = os.waitstatus_to_exitcode(int.from_bytes(said, "little"))
        if code < 0:
            if -code != signal.SIGKILL:
                signal.signal(-code, signal.SIG_DFL)
            os.kill(os.getpid(), -code)
        return code

    def leave_resident(self) -> None:
        """Leave a process behind that runs later commands of this kind; what hinders it is no matter."""
        import subprocess

        program = "import sys; sys.path[:] = {!r}; import rptcam_cl.__main__ as main; sys.exit(main.stay({}))"
        nothing = subprocess.DEVNULL
        try:
            self._left = subprocess.Popen(
                [sys.executable, "-c", program.format(self._path, self._minutes)], env=self._environment, cwd="/",
                stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True,
            )  # fmt: skip
        except OSError:
            pass


def _go_on(number: int, frame: object) -> None:
    """Heed a signal, so that it stands in the pipe of `signal.set_wakeup_fd`, and do nothing else."""


def _hand_on(link: socket.socket, number: int) -> None:
    """Send a signal to the process that runs the command, and stop with it where it is to stop."""
    try:
        link.send(bytes([number]))
    except OSError:  # it has just ended
        pass
    if number == signal.SIGTSTP:
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
        signal.signal(number, _go_on)


class Resident:
    """The resident process, which is made before it imports anything that commands need."""

    def __init__(self) -> None:
        import time

        self._facts, self._begun, self._folder = _facts(), time.time(), _open_folder()
        self._name, self._environment = _socket_of(self._facts), dict(os.environb)
        self._leave_to_another()

    def _leave_to_another(self) -> None:
        """End where there is such a process already."""
        try:
            _connect(self._folder, self._name)
        except OSError:
            return
        os._exit(0)

    def serve(self, minutes: float) -> None:
        """Come back in a new process for each command that is to be run; else end when none has come for long."""
        import gc
        import socket

        self._code = _states(_files_of_code())
        if len(os.listdir("/proc/self/task")) > 1 or any(state[0] > self._begun for state in self._code.values()):
            os._exit(1)
        set_by_imports = dict(os.environb.items() - self._environment.items())  # pyopencl crashes without
        gc.freeze()
        listening, own, place = socket.socket(socket.AF_UNIX), f"{self._name}.{os.getpid()}", f"{_FILES}/{self._folder}"
        listening.bind(f"{place}/{own}")
        listening.listen(64)
        self._leave_to_another()
        os.replace(f"{place}/{own}", f"{place}/{self._name}")
        self._socket = os.stat(f"{place}/{self._name}").st_ino
        signal.signal(signal.SIGTERM, lambda *_: self._leave())
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the system buries keepers
        listening.settimeout(minutes * 60.0)
        resident = os.getpid()
        while True:
            try:
                link, _ = listening.accept()
            except TimeoutError:
                self._leave()
            if os.fork() == 0:
                listening.close()
                _take_over(*self._keep(link, resident))
                os.environb.update(set_by_imports)
                return
            link.close()

    def _leave(self) -> NoReturn:
        try:
            if os.stat(self._name, dir_fd=self._folder).st_ino == self._socket:
                os.unlink(self._name, dir_fd=self._folder)
        finally:
            os._exit(0)

    def _keep(self, link: socket.socket, resident: int) -> tuple[list[bytes], list[int]]:
        """Keep a worker until its end, which is that of this process too; in the worker, return what it is to be."""
        os.close(self._folder)
        os.setsid()
        for number in (*_PASSED_ON, signal.SIGCHLD):
            signal.signal(number, signal.SIG_DFL)
        try:
            if self._code != _states(self._code) and os.getppid() == resident:
                os.kill(resident, signal.SIGTERM)
                os._exit(0)
            text, files = _receive(link)
            if text[0] != self._facts:
                os._exit(0)
            link.send(_BEGUN)
            _fork_worker(link)
        except (OSError, ValueError, IndexError):  # the command is gone, or none of ours
            os._exit(0)
        return text, files


def _receive(link: socket.socket) -> tuple[list[bytes], list[int]]:
    """Return the parts of what a command says, and the files that it has open."""
    import socket

    link.settimeout(_TIMEOUT_S)
    _peer(link)
    text, files, _, _ = socket.recv_fds(link, 1 << 16, 253)
    while len(text) < 8 or len(text) < 8 + int.from_bytes(text[:8], "little"):
        piece = link.recv(1 << 16)
        if not piece:
            raise OSError("the command is gone")
        text += piece
    return text[8:].split(b"\0"), files


def _fork_worker(link: socket.socket) -> None:
    """Return in a worker; in the keeper, wait for its end or that of the command's process, and end."""
    import ctypes
    import select

    ended, ending = os.pipe()
    os.set_blocking(ending, False)
    signal.set_wakeup_fd(ending)
    signal.signal(signal.SIGCHLD, _go_on)
    keeper, worker = os.getpid(), os.fork()
    if worker == 0:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        ctypes.CDLL(None).prctl(_KILL_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
        os.setpgid(0, 0)
        if os.getppid() != keeper:
            os._exit(1)
        link.detach()
        return
    os.setpgid(worker, worker)
    while True:
        if select.select([link.fileno(), ended], [], [])[0] != [link.fileno()]:
            os.read(ended, 64)
            process, status = os.waitpid(worker, os.WNOHANG)  # it may just have stopped
            if process:
                link.send(status.to_bytes(4, "little"))
                os._exit(0)
            continue
        for number in link.recv(64) or [signal.SIGKILL]:  # killed like the command's process, whose end this is
            send = os.killpg if signal.Signals(number).name in _BY_TERMINALS else os.kill
            send(worker, number)


def _take_over(text: list[bytes], files: list[int]) -> None:
    """Let this process be the one of a command."""
    import fcntl

    (umask, *numbers), ignored = ([int(each) for each in row.split()] for row in text[1:3])
    end = 4 + int(text[3])
    *held, folder = (fcntl.fcntl(number, fcntl.F_DUPFD, max(numbers) + 1) for number in files)
    os.fchdir(folder)
    os.umask(umask)
    for number, target in zip(held, numbers, strict=True):
        os.dup2(number, target)
    for number in map(int, os.listdir(_FILES)):
        if number not in numbers and os.path.exists(f"{_FILES}/{number}"):
            os.close(number)
    os.environ.clear()
    for variable in text[end:]:
        name, _, value = variable.partition(b"=")
        os.environb[name] = value
    sys.argv[:] = map(os.fsdecode, text[4:end])
    sys.stdout.reconfigure(line_buffering=os.isatty(1))  # type: ignore[union-attr]
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


def _files_of_code() -> list[str]:
    """List the files that this process has imported or that decide a picture, and the folders of what is installed."""
    from rptcam_cl.core.remember import code_files

    paths = [path for _, path, _ in code_files()]
    paths += [path for module in list(sys.modules.values()) if (path := getattr(module, "__file__", None))]
    return paths + [path for path in sys.path if path.endswith("-packages")]


def _states(paths: Iterable[str]) -> dict[str, tuple[float, int, int]]:
    """Return when each file was changed, its size and its number; zeros where there is none."""
    states = {}
    for path in paths:
        try:
            stat = os.stat(path)
        except OSError:
            states[path] = (0.0, 0, 0)
        else:
            states[path] = (stat.st_mtime, stat.st_size, stat.st_ino)
    return states
