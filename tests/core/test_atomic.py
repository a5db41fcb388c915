import errno
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rptcam_cl.core import files
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.files import check_writable, replacing


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_new_content_takes_the_place_of_the_old(tmp_path: Path) -> None:
    target = tmp_path / "file.json"
    target.write_text("old")
    target.chmod(0o640)
    with replacing(target) as temporary:
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert target.stat().st_mode & 0o777 == 0o640
    assert names(tmp_path) == ["file.json"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_failure_keeps_the_old_file_and_leaves_no_temporary(tmp_path: Path, error: type[BaseException]) -> None:
    target = tmp_path / "file.json"
    target.write_text("old")
    with pytest.raises(error), replacing(target) as temporary:
        temporary.write_text("half")
        raise error
    assert target.read_text() == "old"
    assert names(tmp_path) == ["file.json"]


def test_full_disk_is_reported_and_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    target = tmp_path / "file.json"
    target.write_text("old")
    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(StateError, match="No space left"), replacing(target) as temporary:
        temporary.write_text("new")
    assert target.read_text() == "old"
    assert names(tmp_path) == ["file.json"]


def test_link_keeps_pointing_at_the_replaced_file(tmp_path: Path) -> None:
    target = tmp_path / "target.json"
    target.write_text("old")
    link = tmp_path / "link.json"
    link.symlink_to(target)
    with replacing(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_strays_of_dead_runs_go_and_those_of_living_ones_stay(tmp_path: Path) -> None:
    killed = (
        "import os, signal, sys; from rptcam_cl.core.files import replacing\n"
        "with replacing(sys.argv[1]) as temporary:\n"
        "    temporary.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)"
    )
    target = tmp_path / "file.json"
    subprocess.run([sys.executable, "-c", killed, str(target)], check=False)
    assert len(names(tmp_path)) == 1  # the stray
    living = tmp_path / f".rptcam-{files._SPACE}-{os.getppid()}-0.tmp"
    living.touch()
    with replacing(target) as temporary:
        temporary.write_text("whole")
    assert names(tmp_path) == [living.name, "file.json"]


def test_files_of_another_container_stay_for_a_week(tmp_path: Path) -> None:
    free = 4_194_303  # the highest number of a process, which hardly any has
    other = tmp_path / f".rptcam-{'0' * 16}-{free}-0.tmp"
    unknown = tmp_path / f".rptcam-unknown-{free}-0.tmp"
    old = tmp_path / f".rptcam-{'0' * 16}-1-1.tmp"
    for path in (other, unknown, old):
        path.touch()
    os.utime(old, (0, 0))
    with replacing(tmp_path / "file.json") as temporary:
        temporary.write_text("whole")
    assert names(tmp_path) == sorted([other.name, unknown.name, "file.json"])


@pytest.mark.skipif(not Path("/proc/self/ns/pid").exists(), reason="a system without spaces of process numbers")
def test_name_of_the_host_does_not_tell_whose_a_file_is(monkeypatch: pytest.MonkeyPatch) -> None:
    space = files._process_space()
    monkeypatch.setattr("socket.gethostname", lambda: "other")
    assert files._process_space() == space != ""
    stat = os.stat

    def elsewhere(path: object) -> object:
        return SimpleNamespace(st_ino=1) if path == "/proc/self/ns/pid" else stat(str(path))

    monkeypatch.setattr(files.os, "stat", elsewhere)
    assert files._process_space() != space


def test_link_that_leads_to_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop.png").symlink_to("loop.png")
    with pytest.raises(StateError, match="leads back to itself"):
        check_writable(tmp_path / "loop.png")


def test_read_only_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "file.json"
    target.write_text("old")
    monkeypatch.setattr(files.os, "access", lambda path, mode: False)  # as root, nothing is read-only
    with pytest.raises(StateError, match="may not be overwritten"):
        check_writable(target)


def test_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(StateError, match="not a regular file"):
        check_writable(tmp_path / "pipe.json")
