"""PoCL's cache of kernels: where it cannot be written another place is taken, and what is damaged goes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rptcam_cl.device import pocl_cache
from rptcam_cl.device.pocl_cache import VARIABLE, make_pocl_cache_usable, pocl_cache_folder
from rptcam_cl.device.trial import is_pocl
from tests.device.probes import open_session

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="PoCL's cache is looked after on Linux")


@pytest.fixture(autouse=True)
def environment(monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kcache"))
    monkeypatch.setattr(pocl_cache, "WRITING", 0.0)


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
    monkeypatch.setattr(pocl_cache.shutil, "disk_usage", lambda _: usage._replace(free=1000))
    with pytest.warns(UserWarning, match="the disk is full; compiled kernels are not kept"):
        make_pocl_cache_usable()


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
            os.utime(file, (1e9, 1e9))
        assert "are compiled anew" in rendered(tmp_path)


def rendered(folder):
    command = [sys.executable, "-m", "rptcam_cl", "render", str(folder / "scene.yaml"), "-o", str(folder / "x.npy")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stderr
