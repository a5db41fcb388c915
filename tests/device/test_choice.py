"""Which device is meant: flag, then RPTCAM_DEVICE, then PYOPENCL_CTX, then the best there is. Never a prompt."""

import sys
from types import SimpleNamespace

import pytest

from rptcam_cl.device import choose
from rptcam_cl.device.choose import DeviceInfo, choose_device, list_devices
from rptcam_cl.errors import DeviceError


def device(identity, name, kind, units=4, platform="Some Platform"):
    return DeviceInfo(identity, name, platform, kind, units, 1 << 30, True, None)


DEVICES = [
    device("0:0", "pthread-AMD EPYC", "cpu", 2, "Portable Computing Language"),
    device("1:0", "Small Graphics 100", "gpu", 8),
    device("1:1", "Big Graphics 200", "gpu", 64),
    device("2:0", "Other CPU", "cpu", 16),
]


@pytest.fixture(autouse=True)
def no_environment(monkeypatch):
    monkeypatch.delenv("RPTCAM_DEVICE", raising=False)
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)


@pytest.fixture
def four(monkeypatch):
    monkeypatch.setattr(choose, "list_devices", lambda: DEVICES)


@pytest.mark.usefixtures("four")
@pytest.mark.parametrize(
    ("spec", "identity"),
    [
        (None, "1:1"),
        ("auto", "1:1"),
        ("AUTO", "1:1"),
        ("cpu", "0:0"),
        ("gpu", "1:1"),
        ("0", "0:0"),
        ("1", "1:0"),
        ("1:1", "1:1"),
        ("epyc", "0:0"),
        ("  small graphics ", "1:0"),
        ("portable", "0:0"),
        ("Other", "2:0"),
    ],
)
def test_spec_names_a_device(spec, identity):
    assert choose_device(spec).id == identity


@pytest.mark.usefixtures("four")
def test_flag_beats_rptcam_device_beats_pyopencl_ctx(monkeypatch):
    monkeypatch.setenv("PYOPENCL_CTX", "2:0")
    assert choose_device().id == "2:0"
    monkeypatch.setenv("RPTCAM_DEVICE", "1:0")
    assert choose_device().id == "1:0"
    assert choose_device("cpu").id == "0:0"
    monkeypatch.setenv("RPTCAM_DEVICE", " ")
    assert choose_device().id == "2:0"


@pytest.mark.usefixtures("four")
@pytest.mark.parametrize(
    ("spec", "source", "message"),
    [
        ("7:0", "flag", r"--device '7:0' fits no OpenCL device.*0:0 pthread-AMD EPYC \[cpu\]"),
        ("nvidia", "RPTCAM_DEVICE", r"RPTCAM_DEVICE 'nvidia' fits no OpenCL device.*1:1 Big Graphics 200 \[gpu\]"),
        ("9", "PYOPENCL_CTX", r"PYOPENCL_CTX '9' fits no OpenCL device"),
        ("Big Grafics 200", "flag", r"did you mean 'Big Graphics 200'\?"),
        ("gpus", "flag", r"did you mean 'gpu'\?"),
        ("1:x", "flag", r"fits no OpenCL device"),
    ],
)
def test_wrong_spec_is_refused_with_its_source_and_what_there_is(monkeypatch, spec, source, message):
    if source != "flag":
        monkeypatch.setenv(source, spec)
    with pytest.raises(DeviceError, match=message):
        choose_device(spec if source == "flag" else None)


def test_kind_that_is_not_there_is_refused(monkeypatch):
    monkeypatch.setattr(choose, "list_devices", lambda: DEVICES[:1])
    with pytest.raises(DeviceError, match=r"--device 'gpu' fits no OpenCL device"):
        choose_device("gpu")


class _FakeError(Exception):
    pass


def opencl(get_platforms):
    return SimpleNamespace(Error=_FakeError, get_platforms=get_platforms, device_type=SimpleNamespace(GPU=4))


def raising(error):
    def call():
        raise error

    return call


REMEDY = r"install PoCL with \"pip install 'rptcam_cl\[pocl\]'\" or the OpenCL driver of your GPU"


def test_no_platform_gives_the_remedy(monkeypatch):
    error = _FakeError("clGetPlatformIDs failed: PLATFORM_NOT_FOUND_KHR")
    monkeypatch.setattr(choose, "_opencl", lambda: opencl(raising(error)))
    with pytest.raises(DeviceError, match="no OpenCL platform was found.*PLATFORM_NOT_FOUND_KHR.*" + REMEDY):
        choose_device()


@pytest.mark.parametrize(
    "platforms",
    [[], [SimpleNamespace(name="Empty", get_devices=raising(_FakeError("DEVICE_NOT_FOUND")))]],
    ids=["no platform", "platform without devices"],
)
def test_no_device_gives_the_remedy(monkeypatch, platforms):
    monkeypatch.setattr(choose, "_opencl", lambda: opencl(lambda: platforms))
    with pytest.raises(DeviceError, match="no OpenCL device was found.*" + REMEDY):
        list_devices()


def test_missing_pyopencl_gives_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyopencl", None)
    with pytest.raises(DeviceError, match="pyopencl cannot be imported.*" + REMEDY):
        choose_device()


def test_real_devices_are_described():
    for info in list_devices():
        assert info.type in ("cpu", "gpu")
        assert info.compute_units > 0
        assert info.memory_bytes > 0
        assert info.name == info.name.strip() != ""
        assert choose_device(info.id).handle == info.handle


def test_device_errors_exit_with_3():
    assert DeviceError("").exit_code == 3
