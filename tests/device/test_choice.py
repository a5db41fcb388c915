"""Which device is meant: flag, then RPTCAM_DEVICE, then PYOPENCL_CTX, then the best there is. Never a prompt."""

import json
import sys
from types import SimpleNamespace

import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device import devices as choose
from rptcam_cl.device import drivers
from rptcam_cl.device.devices import DeviceInfo, choose_device, device_details, list_devices
from rptcam_cl.device.drivers import load_opencl
from rptcam_cl.device.session import Session


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


SPEEDS = {"1:0": 2e9, "1:1": 9e9}


@pytest.fixture
def four(monkeypatch):
    monkeypatch.setattr(choose, "list_devices", lambda: DEVICES)
    monkeypatch.setattr(choose, "problem_of", lambda device: None)
    monkeypatch.setattr(choose, "speed_of", lambda device: SPEEDS[device.id])


@pytest.fixture
def broken(monkeypatch, four):
    """Names the devices that build nothing; returns those that were tried."""

    def broken(*ids):
        tried = []

        def problem(device):
            tried.append(device.id)
            return "it builds no kernel: error: unknown target CPU" if device.id in ids else None

        monkeypatch.setattr(choose, "problem_of", problem)
        return tried

    return broken


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
    with pytest.raises(DeviceError, match=r"'gpu': this machine has no GPU that OpenCL finds; there are: 0:0 pth"):
        choose_device("gpu")
    with pytest.raises(DeviceError) as error:
        choose_device("GPU")
    assert "did you mean" not in str(error.value)


@pytest.mark.parametrize(
    ("spec", "barred", "chosen"),
    [
        (None, ("1:1",), "1:0"),
        (None, ("1:1", "1:0"), "0:0"),
        ("auto", ("1:1", "1:0", "0:0"), "2:0"),
        ("gpu", ("1:1",), "1:0"),
        ("cpu", ("0:0",), "2:0"),
        ("graphics", ("1:1",), "1:0"),
    ],
)
def test_device_that_builds_nothing_is_passed_over(broken, spec, barred, chosen):
    broken(*barred)
    assert choose_device(spec).id == chosen


def test_no_more_devices_are_tried_than_it_takes(broken):
    tried = broken("1:1")
    choose_device()
    assert tried == ["1:1", "1:0"]


def test_device_that_is_named_and_builds_nothing_is_refused_with_reason_remedy_and_others(broken):
    broken("0:0", "1:0")
    reason = r"0:0 pthread-AMD EPYC: it builds no kernel: error: unknown target CPU"
    with pytest.raises(DeviceError, match=rf"--device '0:0': .*{reason}.*install .*; these can: 1:1 .*; 2:0 "):
        choose_device("0:0")


def test_where_no_device_builds_the_reasons_and_a_remedy_are_told(broken):
    broken(*(device.id for device in DEVICES))
    with pytest.raises(DeviceError, match=r"0:0 pthread.*unknown target CPU.*2:0 Other CPU.*install "):
        choose_device()


def test_the_faster_gpu_is_chosen_and_not_that_of_more_units(monkeypatch, four):
    gpus = [device("0:0", "Iris Xe", "gpu", 96), device("1:0", "RTX 4060 Laptop", "gpu", 24)]
    monkeypatch.setattr(choose, "list_devices", lambda: gpus)
    monkeypatch.setattr(choose, "speed_of", lambda gpu: {"0:0": 2e9, "1:0": 1.1e10}[gpu.id])
    assert choose_device().id == choose_device("gpu").id == "1:0"


def test_a_gpu_alone_is_chosen_without_a_look_at_its_speed(monkeypatch, four):
    monkeypatch.setattr(choose, "list_devices", lambda: DEVICES[:2])
    monkeypatch.setattr(choose, "speed_of", lambda gpu: pytest.fail("looked at"))
    assert choose_device().id == "1:0"


def test_processors_of_pocl_go_before_others(monkeypatch, four):
    monkeypatch.setattr(choose, "list_devices", lambda: [DEVICES[3], DEVICES[0]])
    assert choose_device().id == "0:0"


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
    monkeypatch.setattr(drivers, "load_opencl", lambda: opencl(raising(error)))
    with pytest.raises(DeviceError, match="no OpenCL platform was found.*PLATFORM_NOT_FOUND_KHR.*" + REMEDY):
        choose_device()


@pytest.mark.parametrize(
    "platforms",
    [[], [SimpleNamespace(name="Empty", get_devices=raising(_FakeError("DEVICE_NOT_FOUND")))]],
    ids=["no platform", "platform without devices"],
)
def test_no_device_gives_the_remedy(monkeypatch, platforms):
    monkeypatch.setattr(drivers, "load_opencl", lambda: opencl(lambda: platforms))
    with pytest.raises(DeviceError, match="no OpenCL device was found.*" + REMEDY):
        list_devices()


def test_missing_pyopencl_gives_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyopencl", None)
    monkeypatch.setattr(drivers, "load_opencl", load_opencl.__wrapped__)
    with pytest.raises(DeviceError, match="pyopencl cannot be imported.*" + REMEDY):
        choose_device()


class _Bad:
    """A device whose driver raises what it likes, at every question."""

    def __getattr__(self, name):
        raise OSError("driver is\nconfused")


def test_drivers_that_fail_are_listed_with_their_reason(monkeypatch):
    cl = opencl(
        lambda: [
            SimpleNamespace(name="Liar", get_devices=raising(ValueError("no idea"))),
            SimpleNamespace(name="Confused", get_devices=lambda: [_Bad()]),
        ]
    )
    monkeypatch.setattr(drivers, "load_opencl", lambda: cl)
    first, second = list_devices()
    assert (first.id, first.platform) == ("0:0", "Liar")
    assert choose.problem_of(first) == "its driver lists no devices: no idea"
    assert (second.id, second.platform) == ("1:0", "Confused")
    assert choose.problem_of(second) == "its driver does not describe it: driver is confused"
    told = device_details(second)
    assert told["problem"] == choose.problem_of(second)
    assert told["driver_version"] is None
    with pytest.raises(DeviceError, match=r"no OpenCL device can be used .*no idea.*confused"):
        choose_device()
    with pytest.raises(DeviceError, match="1:0 unknown device cannot be used: its driver does not describe it"):
        Session(second)


def test_device_that_cannot_be_used_is_told_by_the_commands(monkeypatch, capsys, tmp_path):
    def problem(device):
        return "it builds no kernel: error: unknown target CPU 'generic'"

    monkeypatch.setattr("rptcam_cl.device.devices.problem_of", problem)
    assert main(["devices"]) == 0
    assert "cannot be used: it builds no kernel: error: unknown target CPU 'generic'" in capsys.readouterr().out
    assert main(["devices", "--json"]) == 0
    assert {entry["problem"] for entry in json.loads(capsys.readouterr().out)} == {problem(None)}
    assert main(["doctor", "--numerics"]) == 3
    streams = capsys.readouterr()
    assert "CANNOT BE USED: it builds no kernel" in streams.out
    assert streams.err.count("\n") == 1
    assert main(["render", "examples/first_light.yaml", "-o", str(tmp_path / "x.png")]) == 3
    said = capsys.readouterr().err
    assert said.startswith("error: no OpenCL device can be used (0:0 ")
    assert "install " in said
    assert said.count("\n") == 1


def test_real_devices_are_described():
    for info in list_devices():
        assert info.type in ("cpu", "gpu")
        assert info.compute_units > 0
        assert info.memory_bytes > 0
        assert info.name == info.name.strip() != ""
        assert choose_device(info.id).handle == info.handle


def test_device_errors_exit_with_3():
    assert DeviceError("").exit_code == 3
