"""Which devices share a render, and what is said of a list or a split that cannot be."""

import json

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device import devices
from rptcam_cl.device.devices import Trial, choose_device, try_device
from rptcam_cl.device.session import open_sessions
from rptcam_cl.rendering.several import begin_part, end_parts, is_shared, join_parts, split_of, split_text

SCENE = """\
film: {resolution: [24, 16]}
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}
objects:
  - {shape: sphere, center: [0, 0, 0], radius: 1, material: {kind: matte, reflectance: 0.5}}
environment: {kind: constant, radiance: 1}
render: {spp: 8}
"""

pytestmark = pytest.mark.usefixtures("three")


def ids(wanted, split=None):
    sessions, shares = open_sessions(wanted, split)
    return [session.info.id for session in sessions], shares


@pytest.mark.parametrize(
    ("wanted", "split", "found"),
    [
        ("0:1", None, (["0:1"], None)),
        (["0:1", "0:2"], None, (["0:1", "0:2"], None)),
        ("0:2,0:1", None, (["0:2", "0:1"], None)),
        ("all", None, (["0:0", "0:1", "0:2"], None)),
        (None, "0:1=0.7,0:2=0.3", (["0:1", "0:2"], [0.7, 0.3])),
        (["0:2", "0:1"], "0:1=0.7, 0:2=0.3", (["0:2", "0:1"], [0.3, 0.7])),
        (["cpu", "0:2"], {"0:2": 0.25, "cpu": 0.75}, (["0:0", "0:2"], [0.75, 0.25])),
        ("all", {"0:0": 0.333, "0:1": 0.333, "0:2": 0.333}, (["0:0", "0:1", "0:2"], [0.333, 0.333, 0.333])),
    ],
)
def test_devices_and_shares_that_are_named_are_taken(wanted, split, found):
    assert ids(wanted, split) == found


def test_environment_may_list_devices(monkeypatch):
    monkeypatch.setenv("RPTCAM_DEVICE", "0:2,0:1")
    assert ids(None)[0] == ["0:2", "0:1"]
    assert ids("0:0")[0] == ["0:0"]
    assert choose_device().id == "0:2"  # for commands that take one device
    monkeypatch.setenv("RPTCAM_DEVICE", "all")
    assert ids(None)[0] == ["0:0", "0:1", "0:2"]
    assert choose_device().id == "0:0"


def test_all_leaves_out_what_builds_no_kernel(monkeypatch, infos):
    broken = infos[1].handle
    monkeypatch.setattr(
        devices, "try_device", lambda handle: Trial("error: no") if handle is broken else try_device(handle)
    )
    with pytest.warns(UserWarning, match=r"device 0:1 .* cannot be used: it builds no kernel: error: no; it is left"):
        assert ids("all")[0] == ["0:0", "0:2"]


WRONG = [
    (["0:1", "0:1"], None, r"0:1 .* twice"),
    (["0:0", "cpu"], None, r"0:0 .* twice"),
    (["0:1", "7:0"], None, r"'7:0' fits no OpenCL device"),
    (["all", "0:1"], None, r"'all' stands alone"),
    ([], None, r"no device is named"),
    (["0:1", "0:2"], "0:1=0.7,0:2=0.2", r"the shares add up to 0\.9 \(allowed: 1, as --split 0:0=0\.7,1:0=0\.3\)"),
    (["0:1", "0:2"], "0:1=1.5,0:2=-0.5", r"got 0:1=1\.5; allowed a device and its share, above 0 and up to 1"),
    (["0:1", "0:2"], "0:1=1,0:2=0", r"got 0:2=0; allowed"),
    (["0:1", "0:2"], "0:1=nan,0:2=0.3", r"got 0:1=nan; allowed"),
    (["0:1", "0:2"], "half", r"got half; allowed"),
    (["0:1", "0:2"], "", r"got ; allowed"),
    (["0:1", "0:2"], "0:1=0.5,0:1=0.5", r"0:1 twice"),
    (["0:0", "0:2"], "0:0=0.5,cpu=0.5", r"cpu is 0:0, which has a share already"),
    (["0:1", "0:2"], "0:1=0.5,0:0=0.5", r"0:0 is not among the devices of this render, 0:1, 0:2"),
    (["0:1", "0:2"], "0:1=1", r"no share for device 0:2"),
    (None, "0:1=0.5,9:9=0.5", r"'9:9' fits no OpenCL device"),
]


@pytest.mark.parametrize(("wanted", "split", "message"), WRONG)
def test_wrong_devices_and_splits_are_refused(wanted, split, message):
    with pytest.raises(DeviceError, match=message):
        open_sessions(wanted, split)


@pytest.fixture
def rptcam(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.yaml").write_text(SCENE)

    def run(*words):
        capsys.readouterr()
        return main(["render", "a.yaml", *words]), capsys.readouterr().err

    return run


def test_command_shares_a_render_and_repeats_it(rptcam, tmp_path):
    code, said = rptcam("-o", "a.npy", "--device", "0:1", "--device", "0:2", "--stats", "a.json")
    assert code == 0, said
    stats = json.loads((tmp_path / "a.json").read_text())
    assert [device["id"] for device in stats["devices"]] == ["0:1", "0:2"]
    split = stats["work"][0]["split"]
    assert f"--split {split} repeats it" in said
    code, _ = rptcam("-o", "b.npy", "--split", split, "--stats", "b.json")
    assert code == 0
    again = json.loads((tmp_path / "b.json").read_text())
    assert again["work"] == stats["work"]
    assert [device["samples"] for device in again["devices"]] == [device["samples"] for device in stats["devices"]]
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), np.load(tmp_path / "b.npy"))


def test_command_says_which_device_was_dropped(rptcam, second):
    second.healthy_launches = 2
    code, said = rptcam("-o", "a.npy", "--split", "0:1=0.5,0:2=0.5", "--spp", "64")
    assert code == 0
    assert "warning: device 0:2" in said
    assert "made to fail; it is dropped" in said
    assert " was dropped at " in said


@pytest.mark.parametrize(
    "words",
    [
        ("--device", "0:1", "--device", "0:9"),
        ("--device", "0:1", "--device", "0:1"),
        ("--device", "0:1", "--device", "0:2", "--split", "0:1=0.5,0:2=0.6"),
        ("--split", "nonsense"),
    ],
)
def test_command_ends_with_3_and_one_line(rptcam, words, tmp_path):
    code, said = rptcam("-o", "a.npy", *words)
    assert code == 3
    assert said.startswith("error: --")
    assert said.count("\n") == 1
    assert not (tmp_path / "a.npy").exists()


def test_record_of_parts_joins_what_is_alike_and_keeps_what_was_dropped():
    both, one = split_text({"0:1": 0.7, "0:2": 0.3}), split_text({"0:1": 1.0})
    assert split_of(both) == {"0:1": 0.7, "0:2": 0.3}
    assert end_parts([], 16) == []
    parts = begin_part([], 0, both)
    assert end_parts(parts, 16) == [{"samples": [0, 16], "split": both}]
    parts = begin_part(parts, 8, one, {"0:2": "why"})
    after = {"samples": [8, 16], "split": one, "dropped": {"0:2": "why"}}
    assert end_parts(parts, 16) == [{"samples": [0, 8], "split": both}, after]
    assert end_parts(begin_part(parts, 8, one, {"0:3": "how"}), 9)[1]["dropped"] == {"0:2": "why", "0:3": "how"}
    assert end_parts(begin_part(parts, 0, one), 9) == [{"samples": [0, 9], "split": one, "dropped": {"0:2": "why"}}]
    first, second = {"samples": [0, 8], "split": both}, {"samples": [8, 9], "split": both}
    assert join_parts([first], [second]) == [{"samples": [0, 9], "split": both}]
    assert join_parts([first], [after]) == [first, after]
    assert not is_shared([{"samples": [0, 8], "split": one}])
    assert is_shared([first])
