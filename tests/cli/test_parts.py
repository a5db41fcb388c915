"""``rptcam render --part`` and ``rptcam merge`` on the command line."""

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rptcam_cl
from rptcam_cl.cli.render import _forecast_lines
from rptcam_cl.rendering.account import Forecast

Command = Callable[..., Any]


def test_options_of_a_part_reach_the_renderer(scene: Path, renderer: Any, rptcam: Command) -> None:
    renderer.image.stats["checkpoint"] = "p.rpck"
    run = rptcam("render", "scene.yaml", "-o", "p.rpck", "--part", "3/8", "--samples", "64:128")
    assert run.code == 0, run.err
    (asked,) = renderer.asked
    assert (asked["part"], asked["samples"], asked["checkpoint"]) == ("3/8", (64, 128), Path("p.rpck"))
    assert asked["layers"] is None  # those of the scene, for the picture that is merged later
    assert "wrote p.rpck" in run.err


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--part", "0/8"], 2, "--part: got 0/8; allowed K/N"),
        (["--part", "9/8"], 2, "--part: got 9/8"),
        (["--samples", "64"], 2, "--samples: got 64; allowed FIRST:END"),
        (["--samples", "64:64"], 2, "--samples: got 64:64"),
        (["--part", "1/8", "-o", "a.png"], 2, r"-o: a part is one file \(got p\.rpck, a\.png; allowed: .*\.rpck"),
        (["--part", "1/8", "--noise", "0.1"], 2, "--noise: needs the whole film"),
        (["--part", "1/8", "--time", "5"], 2, "--time: needs the whole film"),
        (["--part", "1/8", "--denoise"], 2, "--denoise: needs the whole film"),
        (["--part", "1/8", "--stats", "s.json"], 2, "--stats: needs the whole film"),
        (["--samples", "0:8", "--spp", "8"], 2, "--spp: --samples says where the samples end"),
        ([], 2, r"p\.rpck: the suffix sets the format"),
    ],
)
def test_mistake_of_a_part_is_named_before_any_work(
    scene: Path, renderer: Any, rptcam: Command, words: list[str], code: int, message: str
) -> None:
    run = rptcam("render", "scene.yaml", "-o", "p.rpck", *words)
    assert (run.code, renderer.asked) == (code, [])
    assert re.search(message, run.err), run.err
    assert [path.name for path in scene.parent.iterdir()] == ["scene.yaml"]


def test_parts_are_rendered_and_merged(scene: Path, rptcam: Command) -> None:
    for number in (1, 2):
        words = ("--size", "16x8", "--spp", "3", "--part", f"{number}/2", "--quiet")
        run = rptcam("render", "scene.yaml", "-o", f"{number}.rpck", *words)
        assert run.code == 0, run.err
    alone = rptcam("merge", "1.rpck", "-o", "a.exr")
    assert (alone.code, "gaps: samples 0:3 of part 2/2" in alone.err) == (4, True)
    run = rptcam("merge", "1.rpck", "2.rpck", "-o", "a.exr", "-o", "all.rpck")
    assert run.code == 0, run.err
    assert "wrote a.exr, all.rpck: 16 x 8, 3 spp, of 2 parts" in run.err
    rptcam_cl.render(scene, size=(16, 8), spp=3).save("b.exr")
    assert Path("a.exr").read_bytes() == Path("b.exr").read_bytes()
    assert Path("all.rpck").exists()


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["a.rpck", "-o", "a.png"], 4, r"a\.rpck: cannot be read: No such file"),
        (["scene.yaml", "-o", "a.png"], 4, r"scene\.yaml: is not a saved render"),
        (["a.rpck", "-o", "a.jpe"], 2, r"a\.jpe: the suffix sets the format"),
        (["a.rpck", "-o", "a.rpck"], 2, "is an input"),
        (["a.rpck", "-o", "b.rpck", "-o", "c.rpck"], 2, r"two files \.rpck"),
        (["a.rpck", "-o", "b.png", "-o", "b.png"], 2, "the same file twice"),
        (["a.rpck", "-o", "none/b.png"], 4, "there is no folder"),
        (["-o", "b.png"], 2, "required: PART"),
    ],
)
def test_mistake_of_a_merge_is_named(scene: Path, rptcam: Command, words: list[str], code: int, message: str) -> None:
    run = rptcam("merge", *words)
    assert run.code == code
    assert re.search(message, run.err), run.err
    assert [path.name for path in scene.parent.iterdir()] == ["scene.yaml"]


def test_settle_writes_a_scene(scene: Path, rptcam: Command) -> None:
    run = rptcam("settle", "scene.yaml", "-o", "resolved.yaml", "--set", "camera.fov_degrees=50")
    assert (run.code, run.err) == (0, "wrote resolved.yaml: nothing was left to be found\n")
    assert rptcam_cl.load_scene("resolved.yaml").camera.fov_degrees == 50


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["-o", "scene.yaml"], 2, "is an input"),
        (["-o", "a.png"], 2, "a.png: a scene file is YAML (got .png; allowed: .yaml, .yml)"),
        (["-o", "a"], 2, "a: a scene file is YAML (got no suffix; allowed"),
        (["-o", "none/a.yaml"], 4, "there is no folder"),
    ],
)
def test_settle_refuses_where_it_cannot_write(
    scene: Path, rptcam: Command, words: list[str], code: int, message: str
) -> None:
    run = rptcam("settle", "scene.yaml", *words)
    assert (run.code, message in run.err) == (code, True), run.err


def test_plan_says_what_a_render_takes_and_renders_nothing(scene: Path, rptcam: Command) -> None:
    run = rptcam("render", "scene.yaml", "-o", "a.png", "--plan", "--spp", "5")
    assert run.code == 0, run.err
    assert re.search(r"^samples: 240, \d+ kernel launches\nmemory:  .* on device .*\ntime:    \d", run.out), run.out
    assert [path.name for path in scene.parent.iterdir()] == ["scene.yaml"]
    assert rptcam("render", "scene.yaml", "-o", "a.png", "--plan", "--noise", "0.1").out.startswith("samples: at most ")


def test_lines_of_a_plan_are_its_numbers_with_their_units() -> None:
    needs = {"0:0": SimpleNamespace(total=3_000_000), "1:0": SimpleNamespace(total=5 * 10**9)}
    given: dict[str, Any] = {"samples": 3_000_000, "devices": needs, "saved_bytes": 2_000_000, "launches": 1200}
    given |= {"seconds": 120.0, "measured_seconds": 0.5}
    lines = _forecast_lines(Forecast(**given, at_most=False), 2.0)
    assert lines == [
        "samples: 3,000,000, 1,200 kernel launches",
        "memory:  3 MB on device 0:0, 5 GB on device 1:0; 2 MB for its state on disk",
        "time:    2 min 00 s of rendering at 0.025 Msamples/s (measured for 0.5 s), after 2.0 s of preparing",
    ]
    lines = _forecast_lines(Forecast(**given, at_most=True), 2.0)
    assert lines[0] == "samples: at most 3,000,000, at most 1,200 kernel launches"
    assert lines[2].startswith("time:    at most 2 min 00 s of ")


def test_plan_of_a_given_time_is_refused(scene: Path, rptcam: Command) -> None:
    run = rptcam("render", "scene.yaml", "-o", "a.png", "--plan", "--time", "5")
    assert (run.code, "--plan: --time says how long it takes" in run.err) == (2, True)
