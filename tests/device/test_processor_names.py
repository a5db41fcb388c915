"""A processor that the compiler of PoCL does not know is given a name that it does; tried on any processor."""

import ctypes
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from rptcam_cl.device import devices, drivers
from rptcam_cl.device.devices import Trial, is_pocl, try_here
from rptcam_cl.device.drivers import AVX2, AVX512, known_processor, rename_as_before, rename_processor
from tests.device.probes import open_session
from tests.support.cases import slow

UNKNOWN = """
import ctypes, sys
from rptcam_cl.device.devices import list_devices
from rptcam_cl.device.session import Session
from rptcam_cl.device.drivers import _point, processor_field, processor_name
from rptcam_cl.device.devices import try_here
info = next(device for device in list_devices() if "portable" in device.platform.lower())
place = processor_field(info.handle.int_ptr)
_point(place, "generic")
trial = try_here(info.handle)
assert trial.problem is None, trial
assert trial.renamed == ("generic", processor_name(place)), trial
"""
RENDER = """
import rptcam_cl
from rptcam_cl.device import devices, session
for module in (devices, session):
    module.try_device = lambda handle: trial
import numpy
mean = numpy.asarray(rptcam_cl.render("examples/first_light.yaml", size=(32, 18), spp=1, device=info.id)).mean()
assert 0 < mean < 100
"""


def on_pocl():
    return is_pocl(open_session().info.handle)


@pytest.mark.slow
@pytest.mark.parametrize("more", ["", slow(RENDER)], ids=["trial", "picture"])
def test_unknown_processor_is_renamed_and_kernels_build(tmp_path, more):
    if not on_pocl():
        pytest.skip("the device is not PoCL's")
    environment = os.environ | {"POCL_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", UNKNOWN + more], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr in ("", "1 error generated.\n")  # of PoCL's compiler, in this very process


@pytest.mark.parametrize("calls_build", [True, False])
def test_built_ins_are_called_where_none_of_their_names_lets_them_be_inlined(monkeypatch, calls_build):
    handle, tried = object(), []

    def build(device, source):
        assert device is handle
        tried.append("pragma clang attribute" in source)
        return None if calls_build and not tried[-1] else "inlining failed"

    monkeypatch.setattr(devices, "is_pocl", lambda _: True)
    monkeypatch.setattr(devices, "pocl_library_arch", lambda: "x86-64")
    monkeypatch.setattr(drivers, "own_name", lambda _: "mine")
    monkeypatch.setattr(drivers, "rename_processor", lambda *_: None)
    monkeypatch.setattr(devices, "_build", build)
    assert try_here(handle) == (Trial() if calls_build else Trial(problem="inlining failed"))
    assert tried == [True, False]


@pytest.mark.parametrize(("version", "options"), [("PoCL 3.0-rc2  Linux", ["-D_OPENCL_H_"]), ("PoCL 6.0  Linux", [])])
def test_trial_of_pocl_3_reads_no_header(monkeypatch, version, options):
    cl, given = drivers.load_opencl(), []
    program = SimpleNamespace(build=lambda options, devices: given.append(options))
    monkeypatch.setattr(cl, "Context", lambda _: None)
    monkeypatch.setattr(cl, "Program", lambda *_: program)
    handle = SimpleNamespace(platform=SimpleNamespace(version=f"OpenCL 3.0 {version}"))
    assert devices._build(handle, devices._source(None, "")) is None
    assert devices._build(handle, "") is None
    usual = ["-cl-std=CL1.2", "-w"]
    assert given == [usual + options, usual]


def test_what_the_trial_declares_is_as_in_the_header():
    declares = devices._source(None, "").replace("#ifdef _OPENCL_H_", "#if 1")
    assert devices._build(open_session().info.handle, declares) is None  # with the header before it


def test_name_is_the_best_that_the_features_allow():
    assert known_processor(AVX512 | AVX2) == "skylake-avx512"
    assert known_processor(AVX2 | {"avx512f"}) == "haswell"
    assert known_processor(frozenset({"sse2"})) == "x86-64"


def test_nothing_is_touched_for_another_error(monkeypatch):
    monkeypatch.setattr(drivers, "processor_field", lambda _: pytest.fail("the record was read"))
    assert rename_processor(None, "error: use of undeclared identifier") is None


def test_renaming_is_repeated_only_where_the_name_is_as_it_was():
    words, kept = record(b"pthread", b"x86_64-unknown-linux-gnu", b"generic")
    device = SimpleNamespace(int_ptr=ctypes.addressof(words))
    assert not rename_as_before(device, "znver9", "haswell")
    assert words[3] == ctypes.addressof(kept[2])
    assert rename_as_before(device, "generic", "haswell")
    assert ctypes.string_at(words[3]) == b"haswell"
    assert rename_as_before(device, "generic", "haswell")


def record(*texts):
    """Return a block of memory as a device's record: a pointer to each text, and what keeps them alive."""
    kept = [ctypes.create_string_buffer(text) for text in texts]
    return (ctypes.c_uint64 * 300)(7, *(ctypes.addressof(text) for text in kept)), kept


@pytest.mark.parametrize(
    ("texts", "found"),
    [
        ((b"pthread", b"x86_64-unknown-linux-gnu", b"generic"), 3),
        ((b"x86_64-pc-linux", b"znver3", b"x86_64-unknown-linux-gnu", b"generic"), None),
        ((b"pthread", b"x86_64-unknown-linux-gnu", b"Not a name"), None),
        ((b"pthread", b"generic"), None),
    ],
    ids=["as in PoCL 3.0", "two triples", "no name behind the triple", "no triple"],
)
def test_field_is_found_only_where_the_record_is_as_expected(texts, found):
    words, _kept = record(*texts)
    place = drivers.processor_field(ctypes.addressof(words))
    assert place == (None if found is None else ctypes.addressof(words) + 8 * found)


def test_what_lies_behind_the_record_is_not_read():
    # PoCL 3.0 allocates 1024 bytes and a little: a copy of the triple behind them once hid the record's own.
    words, kept = record(b"pthread", b"x86_64-unknown-linux-gnu", b"generic")
    for left in range(128, 299, 9):
        words[left], words[left + 1] = ctypes.addressof(kept[1]), ctypes.addressof(kept[2])
        assert drivers.processor_field(ctypes.addressof(words)) == ctypes.addressof(words) + 24
        words[left] = words[left + 1] = 0
