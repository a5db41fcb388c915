"""``rptcam render --frames``: each picture is that of its frame alone, and what is there is kept."""

import contextlib
import os
import re
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.cli import output
from rptcam_cl.imaging.image import read_film
from rptcam_cl.scene.changes import set_keys

Command = Callable[..., Any]
SEQUENCE = """
sequence:
  frames_per_second: 10
  keys:
    camera.fov_degrees: [{time_s: 0, value: 30}, {time_s: 0.4, value: 50}]
    environment.radiance: [{time_s: 0, value: 1}, {time_s: 0.2, value: 3}]
"""
WORDS = ("render", "scene.yaml", "-o", "out.####.exr", "-o", "see.##.png", "--spp", "2")


@pytest.fixture
def moving(scene: Path) -> Path:
    scene.write_text(scene.read_text("utf-8") + SEQUENCE, encoding="utf-8")
    return scene


def test_each_frame_has_the_bits_of_its_scene_alone(moving: Path, rptcam: Command) -> None:
    run = rptcam(*WORDS, "--frames", "1-5:2")
    assert run.code == 0, run.err
    written = sorted(path.name for path in moving.parent.iterdir() if path != moving)
    assert written == [*(f"out.000{k}.exr" for k in (1, 3, 5)), *(f"see.0{k}.png" for k in (1, 3, 5))]
    scene = rptcam_cl.load_scene(moving)
    for frame, fov, radiance in ((1, 30, 1), (3, 40, 3), (5, 50, 3)):
        film = read_film(f"out.000{frame}.exr")
        keys = {"camera.fov_degrees": fov, "environment.radiance": radiance, "shutter.open_s": (frame - 1) / 10}
        alone = rptcam_cl.render(set_keys(scene, keys), spp=2)
        np.testing.assert_array_equal(film.pixels, alone.pixels)
        assert (film.metadata["frame"], film.metadata["timecode"]) == (frame, f"00:00:00:0{frame - 1}")
        assert film.metadata["frames_per_second"] == 10
        assert film.metadata["world_from_camera"]
    before = Path("out.0003.exr").read_bytes()
    assert rptcam(*WORDS, "--frames", "3").code == 0  # alone, in place of the one of the sequence
    assert Path("out.0003.exr").read_bytes() == before


def test_noise_is_that_of_one_seed_unless_each_frame_is_given_its_own(scene: Path, rptcam: Command) -> None:
    scene.write_text(scene.read_text("utf-8") + "sequence: {frames_per_second: 10}\n", encoding="utf-8")
    words = ("render", "scene.yaml", "-o", "out.####.npz", "--spp", "2", "--frames")
    assert rptcam(*words, "1-2").code == 0
    one, other = (read_film(f"out.000{k}.npz") for k in (1, 2))
    np.testing.assert_array_equal(one.pixels, other.pixels)
    assert rptcam(*words, "2", "--seed", "2").code == 0
    alone = read_film("out.0002.npz")
    assert (alone.metadata["seed"], alone.metadata["frame"]) == (2, 2)
    assert (alone.pixels != one.pixels).any()


def test_missing_and_damaged_frames_are_rendered_again_and_others_kept(moving: Path, rptcam: Command) -> None:
    assert rptcam(*WORDS, "--frames", "1-4").code == 0
    before = {path.name: path.read_bytes() for path in moving.parent.glob("*.*.*")}
    Path("out.0002.exr").unlink()
    Path("see.03.png").write_bytes(before["see.03.png"][:60])
    run = rptcam(*WORDS, "--frames", "1-4", "--resume")
    assert run.code == 0, run.err
    assert re.findall(r"(kept|wrote) out\.000(\d)", run.err) == [
        ("kept", "1"), ("wrote", "2"), ("wrote", "3"), ("kept", "4"),
    ]  # fmt: skip
    assert {path.name: path.read_bytes() for path in moving.parent.glob("*.*.*")} == before
    run = rptcam(*WORDS, "--frames", "1-2", "--resume", "--spp", "3")
    assert run.err.count("wrote") == 2  # of other samples
    changed = ("--set", "picture.ev=1")  # no other film, but another picture
    assert rptcam(*WORDS, "--frames", "1-2", "--resume", "--spp", "3", *changed).err.count("wrote") == 2
    assert rptcam(*WORDS, "--frames", "1-2", "--resume", "--spp", "3", *changed).err.count("kept") == 2


def test_frame_that_was_interrupted_before_its_noise_target_is_gone_on_with(
    moving: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = (*WORDS[:-2], "--noise", "0.001", "--spp", "600", "--frames", "1-2")
    assert rptcam(*words).code == 0
    whole = {path.name: path.read_bytes() for path in moving.parent.glob("*.*.*")}

    @contextlib.contextmanager
    def press_in_the_second_frame(time_limit: float | None) -> Iterator[Callable[[Any], None]]:
        pressed = False

        def show(progress: Any) -> None:
            nonlocal pressed
            if progress.stage == "render" and Path("out.0001.exr").exists() and not pressed:
                pressed = True
                os.kill(os.getpid(), signal.SIGINT)

        yield show

    for name in whole:
        Path(name).unlink()
    with monkeypatch.context() as patched:
        patched.setattr(output, "progress_on_stderr", press_in_the_second_frame)
        assert rptcam(*words).code == 130
    assert read_film("out.0002.exr").metadata["interrupted"] is True
    assert Path("out.0002.exr").read_bytes() != whole["out.0002.exr"]
    run = rptcam(*words, "--resume")
    assert (run.code, run.err.count("kept")) == (0, 1), run.err
    assert {path.name: path.read_bytes() for path in moving.parent.glob("*.*.*")} == whole


def test_interrupt_after_the_last_sample_of_a_frame_ends_the_sequence(
    moving: Path, renderer: Any, rptcam: Command
) -> None:
    renderer.during = lambda options: os.kill(os.getpid(), signal.SIGINT)  # as while noise is removed
    assert rptcam(*WORDS, "--frames", "1-3").code == 130
    assert len(renderer.asked) == 1
    assert Path("out.0001.exr").exists()


def test_frames_that_lack_a_layer_or_lead_elsewhere_are_rendered_again(moving: Path, rptcam: Command) -> None:
    words = (*WORDS, "--frames", "1-2", "--resume")

    def kept(*more: str) -> int:
        run = rptcam(*words, *more)
        assert run.code == 0, run.err
        return int(run.err.count("kept"))

    flow = ("--layers", "depth,flow_forward")
    assert [kept(), kept(), kept(*flow), kept(*flow)] == [0, 2, 0, 2]
    moving.write_text(moving.read_text("utf-8").replace("{time_s: 0.2, value: 3}", "{time_s: 0.2, value: 4}"), "utf-8")
    assert kept(*flow) == 0
    later = "[{time_s: 0, value: 30}, {time_s: 0.1, value: 35}, {time_s: 0.2, value: 41}]"  # from frame 3 on
    moving.write_text(
        moving.read_text("utf-8").replace("[{time_s: 0, value: 30}, {time_s: 0.4, value: 50}]", later), "utf-8"
    )
    assert kept(*flow) == 1  # frame 2 leads to frame 3


def test_picture_without_frames_goes_by_the_scene_as_it_stands(moving: Path, rptcam: Command) -> None:
    still = rptcam_cl.render(set_keys(rptcam_cl.load_scene(moving), {"sequence": None}), spp=1)
    assert rptcam_cl.render(moving, spp=1).metadata["scene_hash"] == still.metadata["scene_hash"]


@pytest.mark.parametrize(
    ("frames", "words", "message"),
    [
        ("0-3", [], "--frames: got 0-3; allowed FIRST-LAST"),
        ("3-1", [], "--frames: got 3-1"),
        ("1-3:0", [], "--frames: got 1-3:0"),
        ("1-3", ["-o", "a.exr"], "a.exr: every frame would overwrite it"),
        ("1-3", ["--stats", "s.json"], "--stats: is for a single picture"),
        ("1-3", ["--part", "1/2"], "--part: is for a single picture"),
        ("1-9", ["--set", "sequence.keys={camera.fov_degrees: [{time_s: 0, value: 90}, {time_s: 0.5, value: 240}]}"],
         "frame 4: camera.fov_degrees: is out of range (got 180"),
        ("1-9", ["--set", "sequence.keys={}",
                 "--set", "shutter.keys={camera.fov_degrees: [{time_s: 0, value: 90}, {time_s: 0.5, value: 240}]}"],
         "frame 4: shutter.keys: at 0.3 s: camera.fov_degrees: is out of range (got 180"),
        ("1-3", ["--set", "sequence.keys={camera.fov: [{time_s: 0, value: 90}]}"], "frame 1: "),
        ("1-3", ["--set", "sequence.keys={sequence.keys: [{time_s: 0, value: 90}]}"], "is no key that may change"),
        ("1-3", ["--set", "sequence.keys={picture.ev: [{time_s: 1, value: 0}, {time_s: 0, value: 1}]}"],
         "does not come after the keyframe before it"),
    ],
)  # fmt: skip
def test_mistake_of_a_sequence_is_named_before_any_work(
    moving: Path, renderer: Any, rptcam: Command, frames: str, words: list[str], message: str
) -> None:
    run = rptcam("render", "scene.yaml", "-o", "out.####.exr", "--frames", frames, *words)
    assert (run.code, renderer.asked) == (2, [])
    assert message in run.err
    assert [path.name for path in moving.parent.iterdir()] == ["scene.yaml"]


def test_video_has_every_frame(moving: Path, rptcam: Command) -> None:
    av = pytest.importorskip("av")
    words = ("render", "scene.yaml", "-o", "out.####.exr", "--spp", "1", "--video", "a.mkv")
    run = rptcam(*words, "--frames", "1-3")
    assert run.code == 0, run.err
    assert "wrote a.mkv: 3 frames" in run.err
    with av.open("a.mkv") as file:
        assert float(file.streams.video[0].average_rate) == 10
        assert sum(1 for _ in file.decode(video=0)) == 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "a.####.exr", "--frames", "1-2", "--video", "a.avi"], "a.avi: is no video"),
        (["-o", "a.####.png", "--frames", "1-2", "--video", "a.mkv"], "--video: is made of the films"),
        (["-o", "a.exr", "--video", "a.mkv"], "--video: is of a sequence"),
    ],
)
def test_mistake_of_a_video_is_named(
    moving: Path, renderer: Any, rptcam: Command, words: list[str], message: str
) -> None:
    pytest.importorskip("av")
    run = rptcam("render", "scene.yaml", *words)
    assert (run.code, renderer.asked) == (2, [])
    assert message in run.err
