"""A render that devices share is the one that each of them makes alone, and a failed device takes nothing with it."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.rendering import checkpoint as saving
from rptcam_cl.rendering import several
from rptcam_cl.rendering.several import Worker, measure_speed, owners, shares_of
from tests.rendering.test_determinism import LENS
from tests.rendering.test_resume import SIZE, bits, scene, until
from tests.support.cases import slow

SPLIT = {"0:1": 0.7, "0:2": 0.3}
LAYERS = ["depth", "object_id", "samples", "variance"]  # the same everywhere, as is the limit: one program
LIMITED = ["render.clamp=3"]


def same(one, other):
    """Whether two pictures agree in everything that a render tells of the light."""
    assert bits(one) == bits(other)
    assert one.stats.get("lens") == other.stats.get("lens")
    assert one.stats.get("noise") == other.stats.get("noise")
    assert one.stats.get("clamp") == other.stats.get("clamp")
    assert one.stats["samples"] == other.stats["samples"]
    assert one.layers.keys() == other.layers.keys()
    for name in one.layers:
        np.testing.assert_array_equal(one[name], other[name])
    return True


def taken(image):
    return {device["id"]: device["samples"] for device in image.stats["devices"]}


@pytest.mark.parametrize("name", ["pinhole", slow("lens")])
def test_shared_picture_is_that_of_one_device(name, first, second, whole):
    options = {"size": SIZE, "seed": 3, "spp": 41, "layers": LAYERS}
    made = rptcam_cl.load_scene(scene(name), LIMITED)
    alone = rptcam_cl.render(made, device=whole, **options)
    shared = rptcam_cl.render(made, device=[first, second], **options)
    assert same(shared, alone)
    assert sum(taken(shared).values()) == shared.stats["samples"]
    assert all(device["msamples_per_second"] > 0 for device in shared.stats["devices"])
    [part] = shared.stats["work"]
    assert part["samples"] == [0, 41]
    again = rptcam_cl.render(made, device=[first, second], split=part["split"], **options)
    assert same(again, alone)
    assert (taken(again), again.stats["work"]) == (taken(shared), shared.stats["work"])
    assert shared.metadata["work"] == shared.stats["work"]


@pytest.mark.slow
def test_shares_are_those_asked_for(first, second):
    image = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=8, device=[first, second], split=SPLIT)
    assert taken(image)["0:1"] / image.stats["samples"] == pytest.approx(0.7, abs=0.06)  # of 35 tiles
    assert image.stats["work"] == [{"samples": [0, 8], "split": "0:1=0.7,0:2=0.3"}]
    assert [device["share"] for device in image.stats["devices"]] == [0.7, 0.3]


def test_noise_target_stops_the_same_tiles(first, second, whole):
    options = {"size": SIZE, "noise": 0.1, "layers": LAYERS}
    made = rptcam_cl.load_scene(scene("pinhole"), LIMITED)
    alone = rptcam_cl.render(made, device=whole, **options)
    assert same(rptcam_cl.render(made, device=[first, second], split=SPLIT, **options), alone)
    assert alone["samples"].std() > 0


def test_devices_work_at_the_same_time(first, second, monkeypatch):
    together, alone = threading.Barrier(2), Worker.run

    def run(self, job, halt):
        together.wait(timeout=120)  # breaks unless the other device is at work too
        alone(self, job, halt)

    monkeypatch.setattr(Worker, "run", run)
    rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, device=[first, second], split=SPLIT)


def test_time_ends_a_shared_render(first, second):
    image = rptcam_cl.render(scene("pinhole"), size=(64, 64), seconds=0.7, device=[first, second], split=SPLIT)
    assert image.stats["seconds"]["render"] > 0.2  # else it would have no end; a busy machine may take any longer
    assert (image.stats["samples"], image.stats["work"][0]["samples"][1]) == (
        64 * 64 * image.stats["spp"],
        image.stats["spp"],
    )


@pytest.mark.slow
def test_auto_exposure_and_focus_are_those_of_one_device(first, second, whole):
    auto = scene("pinhole") | {"camera": LENS | {"focus": {"auto": "depth"}}, "exposure": {"mode": "auto"}}
    options = {"size": SIZE, "spp": 2}
    assert same(
        rptcam_cl.render(auto, device=[first, second], split=SPLIT, **options),
        rptcam_cl.render(auto, device=whole, **options),
    )


@pytest.mark.parametrize(("name", "launches"), [("pinhole", 2), *map(slow, ("lens", "lens"), (3, 6))])
def test_device_that_fails_is_dropped_and_nothing_is_lost(name, launches, first, second, whole):
    options = {"size": SIZE, "seed": 3, "spp": 41, "layers": LAYERS}
    made = rptcam_cl.load_scene(scene(name), LIMITED)
    alone = rptcam_cl.render(made, device=whole, **options)
    second.healthy_launches = 5 + launches  # two of them to scout, three to warm up
    with pytest.warns(UserWarning, match=r"0:2 .* made to fail; it is dropped, and what it has made is made again"):
        split = {"0:1": 0.25, "0:2": 0.75}
        shared = rptcam_cl.render(made, device=[first, second], split=split, wave_size=1024, **options)
    assert same(shared, alone)
    assert taken(shared) == {"0:1": shared.stats["samples"], "0:2": 0}
    assert "made to fail" in shared.stats["devices"][1]["dropped"]
    [part] = shared.stats["work"]
    assert (part["samples"], part["split"], list(part["dropped"])) == ([0, 41], "0:1=1", ["0:2"])


@pytest.mark.slow
def test_what_was_saved_before_a_device_failed_is_kept(first, second, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(saving, "INTERVAL", 0.0)
    options = {"size": SIZE, "seed": 3, "noise": 0.1, "spp": 192, "layers": ["samples", "variance", "depth"]}
    alone = rptcam_cl.render(scene("pinhole"), device=whole, **options)
    second.healthy_launches = 5 + 3 * 7
    with pytest.warns(UserWarning, match="made to fail"):
        shared = rptcam_cl.render(
            scene("pinhole"), device=[first, second, whole], split={"0:1": 0.3, "0:2": 0.4, "0:0": 0.3},
            checkpoint=tmp_path / "a.rpck", **options,
        )  # fmt: skip
    assert same(shared, alone)
    assert all(count > 0 for count in taken(shared).values())
    assert sum(taken(shared).values()) == shared.stats["samples"]
    before, after = shared.stats["work"]
    assert before["samples"][1] == after["samples"][0] > 0
    assert "dropped" in after
    assert "dropped" not in before


def test_device_that_fails_while_its_film_is_read_is_dropped(first, second, whole):
    def on_progress(progress):
        if progress.samples_done == 7:
            second.healthy_launches = -1

    options = {"size": SIZE, "spp": 7}
    with pytest.warns(UserWarning, match="made to fail"):
        shared = rptcam_cl.render(
            scene("pinhole"), device=[first, second], split=SPLIT, on_progress=on_progress, **options
        )
    assert same(shared, rptcam_cl.render(scene("pinhole"), device=whole, **options))


def test_device_that_fails_while_speeds_are_measured_is_dropped(first, second, whole, monkeypatch):
    def measure(wavefront):
        if wavefront.session is second:
            second.healthy_launches = 0
        return measure_speed(wavefront)

    monkeypatch.setattr(several, "measure_speed", measure)
    with pytest.warns(UserWarning, match="made to fail; it is dropped"):
        shared = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, device=[first, second])
    assert same(shared, rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, device=whole))


@pytest.mark.filterwarnings("ignore:.*made to fail")
def test_render_ends_with_the_reason_when_every_device_fails(first, second):
    first.healthy_launches, second.healthy_launches = 4, 6
    with pytest.raises(DeviceError, match=r"no device is left to render on: device 0:[12] .*made to fail"):
        rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, wave_size=256, device=[first, second], split=SPLIT)


def test_device_that_cannot_begin_is_an_error_where_it_was_named(first, second):
    second.healthy_launches = 0
    with pytest.raises(DeviceError, match=r"^device 0:2 .*made to fail \(leave 0:2 out of --device"):
        rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, device=[first, second])


def test_interrupted_shared_render_goes_on_to_the_same_bits_on_whatever_devices(first, second, whole, tmp_path):
    made = rptcam_cl.load_scene(scene("pinhole"), LIMITED)
    options = {"size": SIZE, "seed": 3, "layers": LAYERS, "checkpoint": tmp_path / "a.rpck", "resume": True}
    alone = rptcam_cl.render(made, size=SIZE, seed=3, layers=LAYERS, spp=60, device=whole)
    part = rptcam_cl.render(
        made, spp=60, device=[first, second], split=SPLIT, should_stop=until(1), wave_size=1024, **options
    )
    assert part.stats["interrupted"]
    done = part.stats["spp"]
    assert done < 40
    more = rptcam_cl.render(made, spp=40, device=[first, second], **options)  # by the shares of before
    assert more.stats["work"] == [{"samples": [0, 40], "split": "0:1=0.7,0:2=0.3"}]
    idle = rptcam_cl.render(made, spp=20, device=[first, second], **options)  # which has them already
    assert same(idle, more)
    assert (taken(idle), idle.stats["work"]) == ({"0:1": 0, "0:2": 0}, more.stats["work"])
    rest = rptcam_cl.render(made, spp=60, device=whole, **options)
    assert rest.stats["resumed_from"] == 40
    assert same(rest, alone)
    assert rest.stats["work"] == [*more.stats["work"], {"samples": [40, 60], "split": "0:0=1"}]
    assert taken(rest) == {"0:0": 20 * SIZE[0] * SIZE[1]}


@pytest.mark.usefixtures("three")
def test_device_that_cannot_begin_is_left_out_of_all(second, whole, monkeypatch):
    alone = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, device=whole)
    for wanted in ("all", None):
        monkeypatch.setenv("RPTCAM_DEVICE", "all")
        second.healthy_launches = 0
        with pytest.warns(UserWarning, match=r"device 0:2 .*made to fail; it is left out"):
            image = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, device=wanted)
        assert same(image, alone)
        assert list(taken(image)) == ["0:0", "0:1"]
    second.healthy_launches = 0
    with pytest.warns(UserWarning, match=r"device 0:2 .* it is left out"):
        image = rptcam_cl.render(scene("pinhole"), size=SIZE, spp=4, device="all", split="0:0=0.3,0:1=0.1,0:2=0.6")
    assert image.stats["work"][0]["split"] == "0:0=0.75,0:1=0.25"


ENDLESS = """
import rptcam_cl
from rptcam_cl.rendering import checkpoint as saving
from rptcam_cl.device.session import Session
from tests.rendering import test_resume as t
from tests.rendering.several.devices import processor_and_cores
saving.INTERVAL = 0.0
cores = [Session(info) for info in processor_and_cores()[1:]]
rptcam_cl.render(t.scene("pinhole"), size=t.SIZE, spp=10**6, device=cores, split={{"0:1": 0.7, "0:2": 0.3}},
                 checkpoint={state!r}, resume=True)
"""


@pytest.mark.slow
def test_killed_shared_render_goes_on_to_the_same_bits(first, second, whole, tmp_path):
    state, root = tmp_path / "a.rpck", Path(__file__).resolve().parents[3]
    for _ in range(2):
        before = state.stat().st_mtime_ns if state.exists() else None
        process = subprocess.Popen([sys.executable, "-c", ENDLESS.format(state=str(state))], cwd=root)
        while process.poll() is None and (not state.exists() or state.stat().st_mtime_ns == before):
            time.sleep(0.01)
        process.kill()
        assert process.wait() < 0
    options = {"size": SIZE, "checkpoint": state, "resume": True}
    saved = rptcam_cl.render(scene("pinhole"), spp=1, device=[first, second], **options).stats["resumed_from"]
    part = rptcam_cl.render(scene("pinhole"), spp=saved + 5, device=[first, second], **options)
    assert part.stats["work"] == [{"samples": [0, saved + 5], "split": "0:1=0.7,0:2=0.3"}]
    assert same(part, rptcam_cl.render(scene("pinhole"), size=SIZE, spp=saved + 5, device=whole))


def test_names_of_all_devices_that_worked_are_told_after_a_resume(first, second, tmp_path, monkeypatch):
    options = {"size": SIZE, "checkpoint": tmp_path / "a.rpck", "resume": True}
    rptcam_cl.render(scene("pinhole"), spp=2, device=first, **options)
    object.__setattr__(second.info, "name", "another")
    try:
        image = rptcam_cl.render(scene("pinhole"), spp=4, device=second, **options)
    finally:
        object.__setattr__(second.info, "name", first.info.name)
    assert image.metadata["device"] == f"{first.info.name}, another"
    assert image.stats["work"] == [
        {"samples": [0, 2], "split": "0:1=1"},
        {"samples": [2, 4], "split": "0:2=1"},
    ]


def test_every_tile_has_one_owner_and_shares_are_kept():
    for shares in ([0.5, 0.5], [0.7, 0.3], [0.01, 0.99], [0.2, 0.3, 0.5]):
        dealt = owners(2000, shares)
        np.testing.assert_allclose(np.bincount(dealt, minlength=len(shares)) / 2000, shares, atol=0.003)
        rows = owners(2000, shares).reshape(-1, 40)  # no device has whole columns or rows of a picture 40 tiles wide
        assert all(len(set(line)) > 1 for line in [*rows, *rows.T]) or min(shares) < 0.1


@pytest.mark.parametrize("speeds", [[1, 1], [1, 2, 3], [1e-9, 1e3], [5.0]])
def test_shares_follow_speeds_and_add_up(speeds):
    shares = shares_of(speeds)
    assert sum(round(1000 * share) for share in shares) == 1000
    np.testing.assert_allclose(shares, np.array(speeds) / sum(speeds), atol=0.0011)
    assert min(shares) > 0
