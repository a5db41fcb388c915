"""The trial of a driver: in a process of its own, so that it may crash or hang; kept when the driver works."""

import json
import os
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest

from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.device import devices, drivers
from rptcam_cl.device.devices import Trial, first_error, try_device
from rptcam_cl.device.drivers import load_opencl
from rptcam_cl.device.programs import BUILD_OPTIONS, options_of
from tests.device.probes import open_session


@pytest.fixture
def handle(monkeypatch, tmp_path):
    found = open_session().info.handle  # tried and kept where all other tests have it
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    # A trial with a cache of its own looks through all that PoCL has kept, which may be gigabytes of a cold disk.
    monkeypatch.setenv(drivers.VARIABLE, str(tmp_path / "kernels"))
    return found


def fresh(handle):
    return try_device.__wrapped__(handle)


def child(monkeypatch, text):
    monkeypatch.setattr(devices, "_CHILD", text)


def test_trial_is_kept_and_the_next_run_starts_no_process(handle, monkeypatch, tmp_path):
    first = fresh(handle)
    assert first.problem is None
    (kept,) = (tmp_path / "devices").iterdir()
    child(monkeypatch, "raise SystemExit(1)")
    assert fresh(handle) == first
    for damaged in ("", "[]", '{"library_arch": "vax", "renamed": null}', '{"library_arch": null}', "\0"):
        kept.write_text(damaged)
        assert fresh(handle).problem is not None  # tried anew, in vain


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
def test_driver_that_crashes_is_told_and_tried_again(handle, monkeypatch, tmp_path):
    child(monkeypatch, "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    assert fresh(handle).problem == "error: the driver crashed on a trivial kernel (SIGSEGV)"
    child(monkeypatch, "import os; os.abort()")
    assert "SIGABRT" in fresh(handle).problem
    assert not (tmp_path / "devices").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
def test_full_folder_of_kernels_is_told_and_no_crash_of_the_driver(handle, monkeypatch):
    usage = shutil.disk_usage("/")
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage._replace(free=1000))
    child(monkeypatch, "import os; os.abort()")
    problem = fresh(handle).problem
    assert re.search(r"the disk is full, and compiled kernels take 8 MiB .*set TMPDIR or POCL_CACHE_DIR", problem)
    assert "crash" not in problem


def test_driver_that_ends_the_process_is_told(handle, monkeypatch):
    child(monkeypatch, "import sys; sys.exit('LLVM is angry')")
    assert "LLVM is angry" in fresh(handle).problem


def test_driver_that_hangs_is_given_up(handle, monkeypatch):
    monkeypatch.setattr(devices, "TRIAL_TIMEOUT_S", 0.2)
    child(monkeypatch, "import time; time.sleep(60)")
    assert "within 0.2 s, 2 times" in fresh(handle).problem


def test_driver_that_hangs_once_is_tried_again(handle, monkeypatch):
    run, limits = subprocess.run, iter([0.2])
    monkeypatch.setattr(
        subprocess, "run", lambda *words, timeout, **more: run(*words, timeout=next(limits, timeout), **more)
    )
    told = json.dumps({"problem": None, "library_arch": None, "renamed": None})
    child(monkeypatch, f"import time; time.sleep(0.3); print({told!r})")
    assert fresh(handle) == Trial()


def test_trial_ends_its_process_without_the_driver(monkeypatch, handle):
    # What a driver does at the end of a process, here what Python does, may hang.
    child(monkeypatch, "import atexit, time; atexit.register(time.sleep, 3600); " + devices._CHILD)
    assert fresh(handle).problem is None


def test_problem_of_the_trial_comes_through(handle, monkeypatch, tmp_path):
    told = {"problem": "Build failed\nerror: no such thing", "library_arch": None, "renamed": None}
    child(monkeypatch, f"print(); print({json.dumps(told)!r})")
    assert fresh(handle) == Trial(problem=told["problem"])
    assert first_error(told["problem"]) == "error: no such thing"
    assert not (tmp_path / "devices").exists()


def test_nothing_is_kept_where_nothing_can_be(handle, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "file"))
    assert fresh(handle).problem is None


def test_driver_that_describes_nothing_is_told():
    class Bad:
        def __getattr__(self, name):
            raise RuntimeError("confused")

    assert "confused" in fresh(Bad()).problem


def test_standard_error_may_be_closed(handle):
    kept = os.dup(2)
    os.close(2)
    try:
        assert fresh(handle).problem is None
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def test_speed_of_a_gpu_is_measured_in_its_trial(handle, monkeypatch):
    cl = load_opencl()
    seeming = SimpleNamespace(device_type=SimpleNamespace(GPU=handle.type), Context=cl.Context, Program=cl.Program)
    for name in ("CommandQueue", "Buffer", "mem_flags", "enqueue_fill_buffer"):
        setattr(seeming, name, getattr(cl, name))
    assert devices.try_here(handle).speed is None
    monkeypatch.setattr(drivers, "load_opencl", lambda: seeming)
    monkeypatch.setattr(devices, "is_pocl", lambda handle: False)
    assert 1e6 < devices.try_here(handle).speed < 1e12  # 33 reads, sums and products a step


def test_speed_of_a_gpu_is_kept(handle, monkeypatch, tmp_path):
    known = {"problem": None, "library_arch": None, "renamed": None, "speed": 1.25e10}
    child(monkeypatch, f"print(); print({json.dumps(known)!r})")
    assert fresh(handle).speed == 1.25e10
    child(monkeypatch, "raise SystemExit(1)")
    assert fresh(handle).speed == 1.25e10


def test_pocl_7_compiles_as_its_earlier_versions_and_its_cache_tells_settings_apart(monkeypatch):
    # It reads memory anew where it needs a value that it had read before: camera rays were garbage, pictures black.
    names = ("POCL_FORCE_PARALLEL_OUTER_LOOP", "POCL_PREGION_VALUE_REMAT")
    load_opencl()
    assert all(os.environ[name] == "0" for name in names)

    def options(version):
        return options_of(SimpleNamespace(platform=SimpleNamespace(version=version)), "")

    sound = options("OpenCL 3.0 PoCL 7.1+debian  Linux")
    monkeypatch.setenv(names[1], "1")
    assert options("OpenCL 3.0 PoCL 7.1+debian  Linux") != sound
    assert options("OpenCL 3.0 PoCL 6.0+debian  Linux") == options("OpenCL 3.0 PoCL 3.0-rc2  Linux") == BUILD_OPTIONS


def test_part_of_a_device_leaves_no_record_for_the_whole(handle, tmp_path):
    cl = pytest.importorskip("pyopencl")
    if handle.max_compute_units < 2:
        pytest.skip("one processor has no parts")
    part, *_ = handle.create_sub_devices([cl.device_partition_property.BY_COUNTS, 1])
    assert fresh(part).problem is None
    assert not (tmp_path / "devices").exists()
