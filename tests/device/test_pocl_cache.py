"""PoCL's cache of kernels: where it cannot be written another place is taken, and what is damaged goes."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.device import drivers
from rptcam_cl.device.devices import is_pocl
from rptcam_cl.device.drivers import VARIABLE, is_code_noted, make_pocl_cache_usable, note_code, pocl_cache_folder
from tests.device.probes import open_session

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="PoCL's cache is looked after on Linux")


@pytest.fixture(autouse=True)
def environment(monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kcache"))
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(drivers, "WRITING", 0.0)


def test_folder_that_can_be_written_is_left(tmp_path):
    make_pocl_cache_usable()
    assert pocl_cache_folder() == tmp_path / "kcache"
    assert list((tmp_path / "kcache").iterdir()) == []


@pytest.mark.parametrize("home", ["file", "missing below a file"])
def test_folder_that_cannot_be_made_gives_way_with_a_word(monkeypatch, tmp_path, home):
    (tmp_path / "file").touch()
    monkeypatch.delenv(VARIABLE)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / ("file" if home == "file" else "file/home")))
    with pytest.warns(UserWarning, match="kcache: not a directory; compiled kernels are not kept"):
        make_pocl_cache_usable()
    assert Path(os.environ[VARIABLE]).is_dir()


def test_full_disk_gives_way_with_a_word(monkeypatch):
    usage = shutil.disk_usage("/")
    monkeypatch.setattr(drivers.shutil, "disk_usage", lambda _: usage._replace(free=1000))
    with pytest.warns(UserWarning, match="the disk is full; compiled kernels are not kept"):
        make_pocl_cache_usable()


def damaged_kernel(folder, *, program="CD", written=1e9):
    """A file that ends too soon, of long ago by default."""
    file = folder / "AB" / program / "program.bc"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.touch()
    os.utime(file, (written, written))
    return file


def in_a_process(code):
    """Run code in a process that uses the cache, however that ends."""
    program = f"import os\nfrom rptcam_cl.device.drivers import make_pocl_cache_usable\n{code}"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, check=False)


@pytest.fixture
def sound(tmp_path):
    """A cache whose files a process has looked through; nothing was amiss, and it ended well."""
    assert in_a_process("make_pocl_cache_usable()").returncode == 0
    return tmp_path / "kcache"


def test_files_are_looked_through_once_while_all_processes_end_well(sound):
    kernel = damaged_kernel(sound)  # by nothing that this program can know of
    assert in_a_process("make_pocl_cache_usable()").returncode == 0
    make_pocl_cache_usable()
    assert kernel.exists()


def test_processes_at_work_are_no_reason_to_look(sound):
    kernel = damaged_kernel(sound)
    done = in_a_process(
        "make_pocl_cache_usable()\nimport subprocess, sys\n"
        "more = 'from rptcam_cl.device.drivers import make_pocl_cache_usable; make_pocl_cache_usable()'\n"
        "sys.exit(subprocess.run([sys.executable, '-c', more]).returncode)"
    )
    assert done.returncode == 0
    assert kernel.exists()


@pytest.mark.parametrize("end", ["os._exit(0)", "os.kill(os.getpid(), 9)"])
def test_files_are_looked_through_after_a_process_that_did_not_end_well(sound, end):
    in_a_process(f"make_pocl_cache_usable()\n{end}")
    kernel = damaged_kernel(sound, written=time.time())
    before = damaged_kernel(sound, program="EF", written=time.time() - 86400)  # that process was not there
    note_code("ab")
    assert is_code_noted("ab")
    with pytest.warns(UserWarning, match=r"damaged kernels \(1\) are compiled anew"):
        make_pocl_cache_usable()
    assert not kernel.exists() and not is_code_noted("ab")
    assert before.exists()
    make_pocl_cache_usable()  # and once is enough
    kernel = damaged_kernel(sound, written=time.time())
    make_pocl_cache_usable()
    assert kernel.exists()


def test_files_are_looked_through_after_a_full_disk(sound):
    in_a_process("import rptcam_cl.device.drivers as c\nmake_pocl_cache_usable()\nc.ROOM = 1 << 62")
    kernel = damaged_kernel(sound, written=time.time())
    with pytest.warns(UserWarning, match="damaged kernels"):
        make_pocl_cache_usable()
    assert not kernel.exists()


@pytest.mark.parametrize("reason", ["a day has passed", "the system was started"])
def test_files_are_looked_through_now_and_then(monkeypatch, tmp_path, sound, reason):
    (note,) = (tmp_path / "cache").rglob("sound")
    if reason == "a day has passed":
        os.utime(note, (1e9, 1e9))
    else:
        note.write_text("another start")
    kernel = damaged_kernel(sound)
    with pytest.warns(UserWarning, match="damaged kernels"):
        make_pocl_cache_usable()
    assert not kernel.exists()


def test_files_are_looked_through_where_no_marks_can_be_kept(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "file"))
    for _ in range(2):
        kernel = damaged_kernel(tmp_path / "kcache")
        with pytest.warns(UserWarning, match="damaged kernels"):
            make_pocl_cache_usable()
        assert not kernel.exists()


SCENE = """\
film: {resolution: [8, 8]}
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}
objects: [{shape: sphere, center: [0, 0, 0], radius: 1, material: {kind: matte, reflectance: 0.5}}]
environment: {kind: constant, radiance: 1}
"""


@pytest.mark.slow  # three renders, each compiled anew
def test_render_goes_on_with_damaged_kernels(tmp_path):
    if not is_pocl(open_session().info.handle):
        pytest.skip("the device is not PoCL's")
    (tmp_path / "scene.yaml").write_text(SCENE)
    first = rendered(tmp_path)
    assert "damaged" not in first
    for pattern, size in (("*.so", 3000), ("program.bc", 0)):
        files = list((tmp_path / "kcache").rglob(pattern))
        assert files
        for file in files:
            os.truncate(file, size)
        in_a_process("make_pocl_cache_usable()\nos._exit(1)")  # as if it had crashed while it wrote them
        assert "are compiled anew" in rendered(tmp_path)


def rendered(folder):
    command = [sys.executable, "-m", "rptcam_cl", "render", str(folder / "scene.yaml"), "-o", str(folder / "x.npy")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_what_links_lead_to_is_left_alone(tmp_path):
    elsewhere, inside = damaged_kernel(tmp_path / "elsewhere"), damaged_kernel(tmp_path / "kcache")
    (tmp_path / "kcache" / "link").symlink_to(tmp_path / "elsewhere")
    make_pocl_cache_usable()
    assert elsewhere.exists()
    assert not inside.exists()
