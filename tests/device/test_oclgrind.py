"""Every kernel in a simulator that watches its memory: no bound crossed, no race, nothing read before it is written."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rptcam_cl.core.files import kernels_dir
from tests.device.every_kernel import RENDERS

WATCH = ("--data-races", "--uninitialized", "--max-errors", "20", "--global-mem-size", "2000000000")
FAULTY = """
import numpy as np, pyopencl as cl
context = cl.create_some_context(False)
queue = cl.CommandQueue(context)
text = "__kernel void faulty(__global int *a, __global int *b) { b[0] = a[%s] + get_global_id(0); }"
kernel = cl.Kernel(cl.Program(context, text).build(["-cl-opt-disable"]), "faulty")
buffers = [cl.Buffer(context, cl.mem_flags.READ_WRITE, 32) for _ in range(2)]
kernel(queue, (4,), (4,), *buffers)
queue.finish()
"""


def watched(folder: Path, *arguments: str) -> tuple[subprocess.CompletedProcess[str], str]:
    """Run Python under Oclgrind; return how it ended and what Oclgrind says of the kernels."""
    oclgrind = shutil.which("oclgrind")
    if oclgrind is None:
        pytest.skip("Oclgrind is not installed (apt-get install oclgrind)")
    log = folder / "oclgrind.log"
    environment = os.environ | {"RPTCAM_CACHE_DIR": str(folder / "cache")}
    environment.pop("RPTCAM_DEVICE", None)
    command = [oclgrind, *WATCH, "--log", str(log), sys.executable, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    return done, log.read_text("utf-8", errors="replace") if log.exists() else ""


def test_renders_name_every_kernel_of_passes_and_builds():
    named = set().union(*(kernels for _, kernels in RENDERS.values()))
    assert named == {path.stem for folder in ("pass", "build") for path in (kernels_dir() / folder).glob("*.cl")}


@pytest.mark.slow
@pytest.mark.parametrize(("place", "said"), [("8", "Invalid read"), ("0", "Uninitialized"), ("0", "race")])
def test_fault_is_found(place, said, tmp_path):
    _, told = watched(tmp_path, "-c", FAULTY % place)
    assert said in told


@pytest.mark.slow
@pytest.mark.parametrize("name", RENDERS)
def test_kernels_touch_only_what_is_theirs_and_written(name, tmp_path, checkout, monkeypatch):
    monkeypatch.chdir(checkout)
    done, told = watched(tmp_path, "-m", "tests.device.every_kernel", name)
    assert done.returncode == 0, done.stderr
    assert told == ""
    found = json.loads(done.stdout)
    assert (found["device"], found["lanes"]) == ("Oclgrind Simulator", 1)
    assert set(found["kernels"]) == RENDERS[name][1]
