"""The command line with the real renderer, on whatever device there is."""

import contextlib
import json
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import PIL.Image
import pytest

from rptcam_cl.cli import output

Command = Callable[..., Any]

REALISTIC = "camera={kind: realistic, lens: dgauss-50mm, eye: [0, 0, 5], target: [0, 0, 0], focus: {distance_m: 4}}"


def test_real_lens_takes_a_picture_in_every_format(scene: Path, rptcam: Command) -> None:
    outputs = ("-o", "a.npy", "-o", "a.exr", "-o", "a.png", "--stats", "a.json")
    run = rptcam("render", "scene.yaml", *outputs, "--spp", "4", "--size", "24x16", "--set", REALISTIC)
    assert run.code == 0, run.err
    film = np.load("a.npy")
    assert film.shape == (16, 24, 3)
    assert np.isfinite(film).all()
    assert film.max() > 0
    with OpenEXR.File("a.exr") as file:
        assert np.array_equal(file.channels()["RGB"].pixels, film)
        header = dict(file.header())
    with PIL.Image.open("a.png") as picture:
        assert picture.size == (24, 16)
        text = dict(picture.text)
    for key in ("scene_hash", "seed", "spp", "lens", "device"):
        assert text[key] == str(header[key]), key
    assert "Double Gauss" in text["lens"]
    assert text["version"] == header["rptcam_version"]


def test_statistics_have_the_promised_keys(scene: Path, rptcam: Command) -> None:
    run = rptcam(
        "render", "scene.yaml", "-o", "a.npy", "--stats", "a.json", "--spp", "2", "--set", REALISTIC, "--quiet"
    )
    assert (run.code, run.out, run.err) == (0, "", "")
    stats = json.loads(Path("a.json").read_text("utf-8"))
    assert stats["samples"] == 8 * 6 * 2
    assert stats["spp"] == 2
    assert stats["seconds"].keys() == {"start", "compile", "render", "total"}
    assert stats["msamples_per_second"] > 0
    assert sum(stats["lens"].values()) == stats["samples"]
    assert stats["lens"]["passed"] > 0
    assert stats["device"]


def test_interrupt_while_rendering_saves_the_picture_so_far(
    scene: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextlib.contextmanager
    def press_when_rendering(time_limit: float | None) -> Iterator[Callable[[Any], None]]:
        pressed = False

        def show(progress: Any) -> None:
            nonlocal pressed
            if progress.stage == "render" and not pressed:
                pressed = True
                os.kill(os.getpid(), signal.SIGINT)

        yield show

    monkeypatch.setattr(output, "progress_on_stderr", press_when_rendering)
    Path("a.rpck").write_bytes(b"of no use, and not asked for")
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--stats", "a.json", "--time", "60")
    assert run.code == 130
    stats = json.loads(Path("a.json").read_text("utf-8"))
    assert stats["interrupted"] is True
    assert stats["spp"] >= 1
    assert "--resume goes on from it" in run.err
    assert np.isfinite(np.load("a.npy")).all()
    more = str(stats["spp"] + 3)
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--stats", "b.json", "--spp", more, "--resume", "--quiet")
    assert (run.code, json.loads(Path("b.json").read_text("utf-8"))["resumed_from"]) == (0, stats["spp"])
    run = rptcam("render", "scene.yaml", "-o", "b.npy", "--spp", more, "--quiet")
    assert run.code == 0
    np.testing.assert_array_equal(np.load("a.npy"), np.load("b.npy"))
    assert not Path("b.rpck").exists()


def test_state_that_does_not_fit_is_exit_code_4(scene: Path, rptcam: Command) -> None:
    assert rptcam("render", "scene.yaml", "-o", "a.png", "--spp", "1", "--resume").code == 0
    run = rptcam("render", "scene.yaml", "-o", "a.png", "--spp", "2", "--resume", "--seed", "9")
    assert run.code == 4
    assert run.err == (
        "error: a.rpck: does not continue this render: its seed is 0, and this render's 9"
        " (remove it, or render without --resume)\n"
    )
    Path("a.rpck").write_text("hello", "utf-8")
    run = rptcam("render", "scene.yaml", "-o", "a.png", "--spp", "2", "--resume")
    assert (run.code, run.err) == (
        4, "error: a.rpck: is not a saved render (remove it, or render without --resume)\n",
    )  # fmt: skip
    run = rptcam("render", "scene.yaml", "-o", "a.png", "--spp", "2")
    assert run.code == 0
    assert "note: a.rpck holds an earlier render; --resume would go on from it" in run.err


def test_time_limit_ends_the_render(scene: Path, rptcam: Command) -> None:
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--stats", "a.json", "--time", "0.2")
    assert run.code == 0
    stats = json.loads(Path("a.json").read_text("utf-8"))
    assert stats["spp"] >= 1
    assert stats["interrupted"] is False


@pytest.mark.parametrize(
    ("words", "variables"),
    [(["--device", "no such device"], {}), ([], {"RPTCAM_DEVICE": "no such device"}), (["--device", "9:9"], {})],
)
def test_device_that_is_not_there_is_exit_code_3_and_lists_those_that_are(
    scene: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch, words: list[str], variables: dict[str, str]
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    run = rptcam("render", "scene.yaml", "-o", "a.npy", *words)
    assert run.code == 3
    assert run.err.startswith("error: ")
    assert "0:0" in run.err
    assert not Path("a.npy").exists()


def test_black_picture_is_said_with_what_to_look_at(scene: Path, rptcam: Command) -> None:
    words = ("render", "scene.yaml", "-o", "a.npy", "--spp", "1", "--quiet")
    run = rptcam(*words)
    assert (run.code, run.err) == (0, "")
    behind = "objects=[{shape: sphere, center: [0, 0, 99], radius: 1, material: {kind: emissive, radiance: 1}}]"
    run = rptcam(*words, "--set", "environment=null", "--set", behind)
    assert run.code == 0
    assert run.err.startswith("warning: the picture is black: no light reaches the film")
