"""What nobody foresaw ends in two lines and a file; interrupts and full disks end in one."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl import cli
from rptcam_cl.device.programs import _build_failure
from rptcam_cl.imaging.image import read_film
from tests.support.cases import slow


def broken(arguments: object) -> int:
    raise ZeroDivisionError("never thought of")


def test_unexpected_error_names_a_file_and_asks_to_report(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(cli, "_run", broken)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cli.main(["devices"]) == cli.FAULT
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "error: unexpected ZeroDivisionError: never thought of"
    log = Path(re.fullmatch(r"this is a bug in rptcam; please report it, with the file (.*)", said[1])[1])  # type: ignore[index]
    assert "Traceback" in log.read_text()
    assert log.stat().st_mode & 0o077 == 0
    with pytest.raises(ZeroDivisionError):
        cli.main(["--debug", "devices"])


def test_memory_that_is_used_up_is_said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def hungry(arguments: object) -> int:
        raise MemoryError

    monkeypatch.setattr(cli, "_run", hungry)
    assert cli.main([]) == 4
    assert capsys.readouterr().err == "error: not enough memory (it is used up)\n"


def test_command_runs_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "rptcam_cl", "--version"], capture_output=True, text=True, check=False)
    assert done.stdout.startswith("rptcam ")
    assert done.returncode == 0


def test_interrupt_at_any_moment_of_the_start_shows_no_traceback() -> None:
    for delay in (0.03, 0.1, 0.3):
        process = subprocess.Popen(
            [sys.executable, "-m", "rptcam_cl", "lens", "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
        # Until the package itself is found, the interpreter speaks.
        assert "Traceback" not in said or "rptcam_cl/cli" not in said, said
        assert process.returncode in (0, 1, 130, -signal.SIGINT)


def test_file_that_may_not_grow_is_not_called_standard_output(tmp_path: Path) -> None:
    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    words = ["lens", "draw", "dgauss-50mm", "--device", "none", "-o", str(tmp_path / "a.svg")]
    done = subprocess.run(
        [sys.executable, "-m", "rptcam_cl", *words], capture_output=True, text=True, check=False, preexec_fn=small,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},  # its modules would be cut off, for others too
    )  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert "File too large" in done.stderr
    assert "standard output" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_error_without_a_file_is_blamed_on_standard_output_only_where_it_is_full(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(arguments: object) -> int:
        raise OSError(27, os.strerror(27))

    monkeypatch.setattr(cli, "_run", full)
    assert cli.main([]) == 4
    assert capsys.readouterr().err == "error: a file could not be read or written: File too large\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_full_standard_output_is_named() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "rptcam_cl", "schema", "--lens"], stdout=full, stderr=subprocess.PIPE, text=True,
            check=False,
        )  # fmt: skip
    assert done.returncode == 4
    assert done.stderr == "error: standard output: No space left on device\n"


SCENE = """
film: {resolution: [8, 6]}
camera: {kind: pinhole, eye: [0, 0, 3], target: [0, 0, 0], fov_degrees: 30}
environment: {kind: constant, radiance: 1}
sensor: {}
"""


def in_shell(line: str, folder: Path) -> subprocess.CompletedProcess[bytes]:
    line = line.replace("rptcam", f"{sys.executable} -m rptcam_cl", 1)
    return subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("streams", ["<&- >&- 2>&-", *(slow(one) for one in ("2>/dev/full", "2>&-", "2> >(true)"))])
def test_closed_streams_hold_no_picture_up_and_nothing_is_written_into_it(streams: str, tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE, "utf-8")
    done = in_shell(f"rptcam render scene.yaml --spp 1 -o a.png -o a.exr {streams}", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.png", "scene.yaml"]
    assert read_film(tmp_path / "a.exr").pixels.shape == (6, 8, 3)


@pytest.mark.parametrize(
    ("line", "code", "said"),
    [
        slow("rptcam schema --lens >&-", 4, b"error: standard output: Bad file descriptor\n"),
        ("rptcam --help >&-", 4, b"error: standard output: Bad file descriptor\n"),
        slow("rptcam schema --lens >&- 2>&-", 4, b""),
        slow("rptcam render no.yaml -o a.png 2>&-", 2, b""),
        ("rptcam render no.yaml -o a.png 2>&1 | true; exit ${PIPESTATUS[0]}", 2, b""),
    ],
)
def test_closed_streams_end_in_the_right_code_and_no_traceback(
    line: str, code: int, said: bytes, tmp_path: Path
) -> None:
    done = in_shell(line, tmp_path)
    assert (done.returncode, done.stderr) == (code, said)


def test_pictures_go_into_folders_whose_name_is_no_utf_8(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE, "utf-8")
    odd = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9")
    Path(odd).mkdir()
    names = [f"{odd}/a.{suffix}" for suffix in ("exr", "npz", "png", "jpg", "tif", "npy")]
    outputs = [word for name in names for word in ("-o", name)]
    words = ["render", str(tmp_path / "scene.yaml"), "--spp", "1", *outputs, "--raw", f"{odd}/a.dng"]
    assert cli.main([*words, "--stats", f"{odd}/stats.json", "--quiet"]) == 0
    film = read_film(f"{odd}/a.exr")
    np.testing.assert_array_equal(film.pixels, read_film(f"{odd}/a.npz").pixels)
    assert cli.main(["develop", f"{odd}/a.exr", "-o", f"{odd}/again.png", "--quiet"]) == 0


def test_picture_that_a_library_refuses_to_write_is_kept_elsewhere(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from rptcam_cl.imaging import writers

    def refuses(*words: object) -> None:
        raise ValueError("never thought of")

    for suffix in (".png", ".exr"):
        monkeypatch.setitem(writers._WRITERS, suffix, refuses)
    (tmp_path / "scene.yaml").write_text(SCENE, "utf-8")
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    words = ["render", str(tmp_path / "scene.yaml"), "--spp", "1", "-o", str(tmp_path / "a.png"), "--quiet"]
    assert cli.main(words) == cli.FAULT
    said = capsys.readouterr().err
    kept = re.search(r"the film is kept in (\S+\.npz), for rptcam develop", said)
    assert kept is not None, said
    assert read_film(kept[1]).pixels.shape == (6, 8, 3)


def test_log_of_a_compiler_has_a_name_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    for _ in range(2):
        assert "error: x" in _build_failure("source", "error: x", "0" * 64)
    logs = list(tmp_path.iterdir())
    assert len(logs) == 2
    assert all("error: x" in log.read_text() and log.stat().st_mode & 0o077 == 0 for log in logs)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    assert "its log could not be written" in _build_failure("source", "error: x", "0" * 64)


@pytest.mark.parametrize(("words", "code"), [slow(["devices", "--json"], 0), (["render", "no.yaml", "-o", "a.png"], 2)])
def test_process_does_what_is_left_to_do_and_ends_without_taking_itself_apart(words: list[str], code: int) -> None:
    program = (
        "import atexit, sys; from rptcam_cl.__main__ import run\n"
        "class Held:\n    def __del__(self): print('taken apart', flush=True)\n"
        "sys.held = Held(); sys.argv[0] = 'rptcam'; found = run()\n"
        "atexit.register(print, 'left to do'); sys.exit(found)"
    )
    done = subprocess.run([sys.executable, "-c", program, *words], stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == code
    assert done.stdout.endswith("left to do\n")


def test_nothing_that_takes_long_is_imported_before_an_interrupt_ends_the_process_in_silence() -> None:
    program = "import sys; before = set(sys.modules); import rptcam_cl.__main__; print(*set(sys.modules) - before)"
    imported = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, check=True).stdout
    assert "signal" in imported.split()
    assert not {"argparse", "contextlib", "numpy", "re", "typing"} & set(imported.split())


def test_what_an_encoding_lacks_is_written_as_json_has_it() -> None:
    """As where the locale has no degrees and dots."""
    words = [sys.executable, "-m", "rptcam_cl", "schema"]
    said = [
        subprocess.run(words, env=os.environ | {"PYTHONIOENCODING": name}, capture_output=True, check=True).stdout
        for name in ("ascii", "utf-8")
    ]
    assert b"\\u2026" in said[0]
    assert json.loads(said[0]) == json.loads(said[1])
