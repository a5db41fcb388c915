"""A process that stays after a command runs the next ones, which notice nothing: by a light one, and as a whole."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core import resident
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import example_scenes

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="is for Linux alone")

BY_ITSELF = 99
TIMEOUT_S = 60.0
# A light resident process; what it runs is Python, the first word of the command.
RESIDENT = """\
from rptcam_cl.core.resident import Resident
import sys, tool
resident = Resident()
resident.serve(float(sys.argv[1]))
exec(sys.argv[1])
"""
COMMAND = f"""\
import sys
from rptcam_cl.core.resident import Command
command = Command.begun()
code = None if command is None else command.run_there()
sys.exit({BY_ITSELF} if code is None else code)
"""


def wait_until(holds: Callable[[], Any]) -> None:
    end = time.monotonic() + TIMEOUT_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def state_of(process: int) -> str:
    """The letter of a process's state; nothing where there is none any more."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0].replace("Z", "")
    except FileNotFoundError:
        return ""


@dataclass
class Place:
    """Where a resident process is started, and commands for it."""

    folder: Path
    environment: dict[str, str]

    @property
    def sockets(self) -> list[Path]:
        return [path for path in self.folder.glob("rptcam-*/*") if "." not in path.name]

    def start(self, minutes: float = 1.0) -> int:
        program = [sys.executable, str(self.folder / "resident.py"), str(minutes)]
        nothing = subprocess.DEVNULL
        started = subprocess.Popen(program, env=self.environment, start_new_session=True, stdin=nothing, stdout=nothing)
        wait_until(lambda: self.sockets or started.poll() is not None)
        return started.pid

    def command(self, code: str, *words: str, prefix: tuple[str, ...] = (), **options: Any) -> subprocess.Popen[str]:
        """Begin a command; it is no leader of a session, which could not be stopped."""
        pipe = subprocess.PIPE
        options = {"stdin": pipe, "stdout": pipe, "stderr": pipe, "env": self.environment} | options
        program = [*prefix, sys.executable, str(self.folder / "command.py"), code, *words]
        return subprocess.Popen(program, text=True, process_group=0, **options)


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Place]:
    (tmp_path / "resident.py").write_text(RESIDENT)
    (tmp_path / "command.py").write_text(COMMAND)
    (tmp_path / "tool.py").write_text("")
    for path in tmp_path.iterdir():
        os.utime(path, (1e9, 1e9))  # long before the process that reads it
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    checkout = str(Path(resident.__file__).parents[2])
    own = {"PYTHONPATH": checkout, "PYTHONDONTWRITEBYTECODE": "1", resident.VARIABLE: "1"}
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # tests in the background of a shell ignore it
    yield Place(tmp_path, os.environ | own)
    signal.signal(signal.SIGINT, before)
    for process in resident.residents():
        os.kill(process, signal.SIGKILL)


def test_command_has_its_words_variables_folder_mask_and_streams(place: Place, tmp_path: Path) -> None:
    code = (
        "import os, json; print(json.dumps([sys.argv[2:], os.environ.get('OWN'), os.environ.get('OTHERS'), os.getcwd(),"
        " os.umask(0), sys.stdin.read(), sys.stdout.line_buffering])); print('said', file=sys.stderr); sys.exit(7)"
    )
    place.environment["OTHERS"] = "1"
    place.start()
    del place.environment["OTHERS"]
    place.environment["OWN"] = "ä\udcff\n"
    (tmp_path / "there").mkdir()
    with (tmp_path / "out").open("w") as out:
        out.write("before\n")
        out.flush()
        words = "", "two words", "--set=x=ü"
        run = place.command(code, *words, stdout=out, cwd=tmp_path / "there", umask=0o027)
        _, said = run.communicate("given")
    assert (run.returncode, said) == (7, "said\n")
    before, found = (tmp_path / "out").read_text().splitlines()
    assert before == "before"
    assert json.loads(found) == [list(words), "ä\udcff\n", None, str(tmp_path / "there"), 0o027, "given", False]


def test_commands_run_side_by_side(place: Place) -> None:
    place.start()
    first, second = (place.command("print(1); sys.stdout.flush(); print(sys.stdin.read())") for _ in range(2))
    for run in (first, second):
        assert run.stdout is not None and run.stdout.readline() == "1\n"
    for run in (second, first):
        assert run.communicate("end")[0] == "end\n"
        assert run.returncode == 0


def test_death_by_a_signal_is_that_of_the_command(place: Place) -> None:
    place.start()
    assert place.command("import os; os.kill(os.getpid(), 11)").wait(TIMEOUT_S) == -signal.SIGSEGV


WAIT = "import os, time; print(os.getpid(), flush=True); time.sleep(100)"


def begun(run: subprocess.Popen[str]) -> int:
    """The number of the process that runs a command which says it."""
    assert run.stdout is not None
    return int(run.stdout.readline())


@pytest.mark.parametrize(
    ("code", "number", "ends"),
    [
        (f"try:\n {WAIT}\nexcept KeyboardInterrupt:\n sys.exit(130)", signal.SIGINT, 130),
        (WAIT, signal.SIGTERM, -signal.SIGTERM),
        (WAIT, signal.SIGKILL, -signal.SIGKILL),
    ],
)
def test_signals_of_the_command_reach_the_one_that_runs(place: Place, code: str, number: int, ends: int) -> None:
    place.start()
    run = place.command(code)
    process = begun(run)
    run.send_signal(number)
    assert run.wait(TIMEOUT_S) == ends
    wait_until(lambda: not state_of(process))


def test_closed_terminal_is_noticed(place: Place) -> None:
    import pty  # Windows has none

    place.start()
    code = f"import signal; signal.signal(signal.SIGHUP, lambda *_: sys.exit(9)); {WAIT}"
    shell, terminal = pty.fork()  # the command leads the session of the terminal
    if shell == 0:
        os.execve(sys.executable, [sys.executable, str(place.folder / "command.py"), code], place.environment)
    with os.fdopen(terminal) as said:
        process = int(said.readline())
    assert os.waitstatus_to_exitcode(os.waitpid(shell, 0)[1]) == 9
    wait_until(lambda: not state_of(process))


def test_ignored_signal_stays_ignored(place: Place) -> None:
    place.start()
    code = "import signal; print(signal.getsignal(signal.SIGHUP) == signal.SIG_IGN)"
    assert place.command(code, prefix=("nohup",)).communicate()[0] == "True\n"


def test_stopped_command_stands_still_until_it_goes_on(place: Place) -> None:
    place.start()
    run = place.command("import os; print(os.getpid(), flush=True); sys.stdin.read()")
    process = begun(run)
    for number, states in ((signal.SIGTSTP, ("T", "T")), (signal.SIGCONT, ("S", "S")), (signal.SIGTSTP, ("T", "T"))):
        run.send_signal(number)
        wait_until(lambda states=states: (state_of(run.pid), state_of(process)) == states)  # type: ignore[misc]
    run.send_signal(signal.SIGCONT)
    run.communicate("")
    assert run.returncode == 0


def test_reader_that_leaves_is_noticed(place: Place) -> None:
    place.start()
    run = place.command("import os\ntry:\n while True: os.write(1, b'line\\n')\nexcept BrokenPipeError:\n sys.exit(8)")
    assert run.stdout is not None and run.stdout.readline() == "line\n"
    run.stdout.close()
    assert run.wait(TIMEOUT_S) == 8


def test_files_that_a_shell_has_opened_have_their_numbers(place: Place) -> None:
    place.start()
    reading, writing = os.pipe()
    with os.fdopen(reading) as file:
        run = place.command(f"open('/dev/fd/{writing}', 'w').write('there')", pass_fds=[writing])
        os.close(writing)
        assert file.read() == "there"  # and no process keeps it open
    assert run.wait(TIMEOUT_S) == 0


def test_command_outlives_the_resident_process(place: Place) -> None:
    process = place.start()
    run = place.command("import os; print(os.getpid(), flush=True); sys.exit(len(sys.stdin.read()))")
    begun(run)
    os.kill(process, signal.SIGKILL)
    run.communicate("six...")
    assert run.returncode == 6
    assert place.command("").wait(TIMEOUT_S) == BY_ITSELF
    assert list(resident.residents()) == []
    assert place.sockets == []  # what it has left is gone


@pytest.mark.parametrize(
    ("variables", "prefix"), [({"LC_ALL": "C"}, ()), ({"PYTHONHASHSEED": "1"}, ()), ({}, ("nice",))]
)
def test_what_a_new_python_would_notice_runs_by_itself(
    place: Place, variables: dict[str, str], prefix: tuple[str, ...]
) -> None:
    place.start()
    assert place.command("", prefix=prefix, env=place.environment | variables).wait(TIMEOUT_S) == BY_ITSELF
    assert place.command("").wait(TIMEOUT_S) == 0


def test_changed_code_ends_it(place: Place, tmp_path: Path) -> None:
    process = place.start()
    assert place.command("").wait(TIMEOUT_S) == 0
    (tmp_path / "tool.py").write_text("new = True\n")
    assert place.command("").wait(TIMEOUT_S) == BY_ITSELF
    wait_until(lambda: not state_of(process))
    assert place.sockets == []


def test_folder_that_others_may_enter_is_refused(place: Place, tmp_path: Path) -> None:
    place.start()
    [folder] = tmp_path.glob("rptcam-*")
    for barred in (lambda: folder.chmod(0o755), lambda: os.chown(folder, 1, -1)):
        if os.geteuid() != 0 and folder.stat().st_mode & 0o077:
            continue  # nobody else can give a folder away
        barred()
        run = place.command("")
        assert "another user may enter it" in run.communicate()[1]
        assert run.returncode == BY_ITSELF
        os.chown(folder, os.geteuid(), -1)
        folder.chmod(0o700)
    assert place.command("").wait(TIMEOUT_S) == 0


def test_it_leaves_when_no_command_comes(place: Place) -> None:
    process = place.start(minutes=0.005)
    wait_until(lambda: not state_of(process))
    assert place.sockets == []


def test_there_is_one_of_a_kind(place: Place) -> None:
    process = place.start()
    second = place.start()
    wait_until(lambda: not state_of(second))
    assert list(resident.residents()) == [process]


@pytest.mark.parametrize(("said", "minutes"), [("15", 15.0), ("", 0.0), ("0", 0.0), ("yes", None), ("-1", None)])
def test_variable_holds_minutes(monkeypatch: pytest.MonkeyPatch, said: str, minutes: float | None) -> None:
    monkeypatch.setenv(resident.VARIABLE, said)
    if minutes is None:
        with pytest.raises(InputError, match=f"RPTCAM_RESIDENT: got {said}.*as 15"):
            resident.minutes_to_stay()
    else:
        assert resident.minutes_to_stay() == minutes


@pytest.mark.slow
def test_second_render_is_by_the_resident_process_and_gives_the_same_bits(place: Place, tmp_path: Path) -> None:
    def rptcam(*words: str) -> subprocess.CompletedProcess[str]:
        program = [sys.executable, "-m", "rptcam_cl", *words]
        return subprocess.run(program, env=place.environment, capture_output=True, text=True, check=False)

    scene = str(example_scenes()["first_light"])
    pictures = [tmp_path / f"{name}.png" for name in ("alone", "there")]
    for picture in pictures:
        run = rptcam("render", scene, "--spp", "1", "--size", "64x36", "-o", str(picture))
        assert run.returncode == 0, run.stderr
        assert f"wrote {picture}" in run.stderr
        wait_until(lambda: place.sockets)
    assert pictures[0].read_bytes() == pictures[1].read_bytes()
    [process] = resident.residents()
    long = ["render", scene, "--spp", "100000", "--size", "64x36", "--preview", "0.1"]
    for name, number in (("typed", signal.SIGINT), ("closed", signal.SIGHUP)):  # Ctrl-C, and the terminal
        picture = tmp_path / f"{name}.png"
        program = [sys.executable, "-m", "rptcam_cl", *long, "-o", str(picture)]
        begun = subprocess.Popen(program, env=place.environment, stderr=subprocess.PIPE, text=True)
        wait_until(picture.exists)
        begun.send_signal(number)
        assert "--resume goes on from it" in begun.communicate()[1]
        assert (begun.returncode, picture.with_suffix(".rpck").exists()) == (130, True)
    assert f"process {process} stays: " in rptcam("resident").stdout
    for words, code, said in ((["--version"], 0, "rptcam "), (["render", "none.yaml", "-o", "a.png"], 2, "none.yaml")):
        run = rptcam(*words)
        assert (run.returncode, said in run.stdout + run.stderr) == (code, True)
    assert f"process {process} ended: " in rptcam("resident", "--stop").stdout
    wait_until(lambda: not state_of(process))


@pytest.mark.slow
def test_all_variables_that_imports_read_are_compared() -> None:
    program = (
        "import os; read = set(); get = os._Environ.__getitem__\n"
        "def note(self, name): read.add(name); return get(self, name)\n"
        "os._Environ.__getitem__ = note\n"
        "import rptcam_cl.cli.render, rptcam_cl.api.job, rptcam_cl.cli.lens, rptcam_cl.cli.frames\n"
        "from rptcam_cl.device.drivers import import_binding; import_binding()\n"
        "from rptcam_cl.core.resident import _READ_EARLY\n"
        "print(len(read), [name for name in read if not name.startswith(_READ_EARLY)])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    count, left = done.stdout.split(maxsplit=1)
    assert int(count) > 3
    assert left.strip() == "[]"
