"""The process that is forked for the first trial of a driver and builds programs then: never in the way."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.files import CACHE_VARIABLE
from tests.support.cases import slow

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="it is made on Linux alone")

# Tries the first device after a change of the modules, and more; prints what was found, and how many processes were
# started.
TRIAL = """\
import json, os, subprocess, sys, time
from dataclasses import asdict
from rptcam_cl.device import devices, drivers
from rptcam_cl.device.drivers import load_opencl
started = []
run = subprocess.run
subprocess.run = lambda words, **named: started.extend(w for w in words if w == sys.executable) or run(words, **named)
{change}
devices.prepare_trial()
waiting = len(devices._fork_server)
handle = load_opencl().get_platforms()[0].get_devices()[0]
found = devices.try_device(handle)
{more}
marks = [mark for mark in drivers._of_this_process if mark.exists()]
print(json.dumps([asdict(found), len(started), waiting, len(marks)]))
"""
# Counts the programs in PoCL's cache before and after another is built, in the process that was made and here.
BUILD = """
from pathlib import Path
SOURCE = "__kernel void two(__global float *out) {{ out[0] = 2.0f; }}"
def built():
    return len(list(Path(os.environ["POCL_CACHE_DIR"]).rglob("program.bc")))
counts = [built()]
{before}
assert devices.builds_apart(handle) == {apart}
devices.build_apart(handle, SOURCE, ["-cl-std=CL1.2", "-w"])
counts.append(built())
devices._build(handle, SOURCE)
counts.append(built())
devices.end_trials()
print(counts)
"""
# It waits no time for orders, and is given the time to end.
GONE = """\
from rptcam_cl.device import devices
devices.IDLE = 0.0
prepare = devices.prepare_trial
def prepare_and_wait():
    prepare()
    os.waitid(os.P_PID, devices._fork_server[0]._child[0], os.WEXITED | os.WNOWAIT)
devices.prepare_trial = prepare_and_wait
"""
CRASH = "devices.try_here = lambda handle: os.abort()"
HANG = """\
ask = devices.CompileServer.ask
devices.CompileServer.ask = lambda self, *order, timeout_s: ask(self, *order, timeout_s=0.5)
devices.try_here = lambda handle: time.sleep(60)
"""


def ran(cache: Path, script: str) -> list[Any]:
    environment = os.environ | {CACHE_VARIABLE: str(cache), "POCL_CACHE_DIR": str(cache / "pocl")}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return [json.loads(line) for line in done.stdout.splitlines()]


def tried(cache: Path, change: str = "", more: str = "") -> Any:
    return ran(cache, TRIAL.format(change=change, more=more))[-1]


def marks(cache: Path) -> list[Path]:
    return list(cache.rglob("*.at-work"))


def test_first_trial_starts_no_process_and_later_ones_make_none(tmp_path: Path) -> None:
    found, started, waiting, own = tried(tmp_path, more="devices.end_trials()")
    assert found["problem"] is None and (started, waiting, own) == (0, 1, 1)
    assert tried(tmp_path) == [found, 0, 0, 1]  # which is kept
    assert not marks(tmp_path)


def test_driver_that_crashes_is_told_and_leaves_its_mark(tmp_path: Path) -> None:
    found, started, _, own = tried(tmp_path, CRASH)
    assert found["problem"] == "error: the driver crashed on a trivial kernel (SIGABRT)" and (started, own) == (0, 1)
    assert len(marks(tmp_path)) == 1  # so that the next process looks through what it was writing


def test_driver_that_ends_it_is_told(tmp_path: Path) -> None:
    found, *_ = tried(tmp_path, "devices.try_here = lambda handle: sys.exit('LLVM is angry')")
    assert "LLVM is angry" in found["problem"]


@pytest.mark.slow
def test_driver_that_hangs_is_tried_again_in_a_process_that_is_started(tmp_path: Path) -> None:
    found, started, *_ = tried(tmp_path / "twice", HANG)
    assert found["problem"] is None and started == 1
    found, started, *_ = tried(tmp_path / "once", f"{HANG}devices.TRIES = 1\n")
    assert "did not build a trivial kernel" in found["problem"] and started == 0


@pytest.mark.slow
def test_one_that_has_waited_too_long_is_not_missed(tmp_path: Path) -> None:
    found, started, *_ = tried(tmp_path, GONE)
    assert found["problem"] is None and started == 1


@pytest.mark.slow
@pytest.mark.parametrize("closed", [*(slow(f"os.close({n})") for n in (0, 2)), "os.close(0); os.close(2)"])
def test_standard_streams_may_be_closed(tmp_path: Path, closed: str) -> None:
    found, started, waiting, _ = tried(tmp_path, closed)
    assert found["problem"] is None and started + waiting == 1


def test_programs_come_out_of_the_cache_that_it_has_built(tmp_path: Path) -> None:
    before, apart, here = ran(tmp_path, TRIAL.format(change="", more=BUILD.format(before="", apart=True)))[0]
    assert apart == before + 1 == here


KILLED = """\
child = devices._fork_server[0]._child[0]
os.kill(child, 9)
os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)
"""


@pytest.mark.slow
@pytest.mark.parametrize("end", [KILLED, slow("devices.end_trials()")])
def test_programs_are_built_here_where_it_has_ended(tmp_path: Path, end: str) -> None:
    more = BUILD.format(before=end, apart="devices.builds_apart(handle)")
    before, apart, here = ran(tmp_path, TRIAL.format(change="", more=more))[0]
    assert (apart, here) == (before, before + 1)


@pytest.mark.slow
def test_it_builds_nothing_for_a_device_that_it_has_not_tried(tmp_path: Path) -> None:
    more = BUILD.format(before="devices._tried_there.clear()", apart=False)
    before, apart, here = ran(tmp_path, TRIAL.format(change="", more=more))[0]
    assert (apart, here) == (before, before + 1)


def test_a_process_that_nobody_asks_ends_with_its_maker(tmp_path: Path) -> None:
    script = "from rptcam_cl.device import devices; devices.prepare_trial(); print(devices._fork_server[0]._child[0])"
    (process,) = ran(tmp_path, script)
    state = Path("/proc") / str(process) / "stat"
    end = time.monotonic() + 60
    while time.monotonic() < end:
        try:
            if state.read_text().split(") ")[1][0] == "Z":
                return
        except (FileNotFoundError, ProcessLookupError):
            return
        time.sleep(0.005)
    pytest.fail("it goes on")
