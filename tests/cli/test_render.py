import json
import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli.output import dark_warnings
from rptcam_cl.core.errors import DeviceError, InputError, NumericError, StateError
from rptcam_cl.imaging.image import Image, read_film

Command = Callable[..., Any]


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_options_reach_the_renderer(scene: Path, renderer: Any, rptcam: Command) -> None:
    words = "--noise 0.02 --resume --spp 9 --time 2.5 --seed 18446744073709551615 --size 640x360 --device cpu --quiet"
    words += " --crop 0,0.5,0.25,1"
    run = rptcam("render", "scene.yaml", "-o", "a.npy", *words.split(), "--set", "camera.fov_degrees=50")
    assert (run.code, run.out, run.err) == (0, "", "")
    (asked,) = renderer.asked
    assert asked["scene"].camera.fov_degrees == 50
    expected = {
        "spp": 9,
        "seconds": 2.5,
        "noise": 0.02,
        "resume": True,
        "checkpoint": Path("a.rpck"),
        "seed": 2**64 - 1,
        "size": (640, 360),
        "crop": (0.0, 0.5, 0.25, 1.0),
        "device": "cpu",
    }
    assert {key: asked[key] for key in expected} == expected


def test_large_numbers_of_samples_may_be_written_as_people_write_them(
    scene: Path, renderer: Any, rptcam: Command
) -> None:
    assert rptcam("render", "scene.yaml", "-o", "a.npy", "--spp", "1e6").code == 0
    assert renderer.asked[-1]["spp"] == 1_000_000


def test_options_left_out_leave_the_choice_to_the_scene(scene: Path, renderer: Any, rptcam: Command) -> None:
    assert rptcam("render", "scene.yaml", "-o", "a.npy").code == 0
    (asked,) = renderer.asked
    assert {key: asked[key] for key in ("spp", "seconds", "seed", "size", "crop", "device")} == dict.fromkeys(
        ("spp", "seconds", "seed", "size", "crop", "device")
    )


def test_demo_renders_a_scene_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, renderer: Any, rptcam: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    run = rptcam("demo", "colour_chart", "--size", "64x40", "--device", "cpu")
    assert run.code == 0, run.err
    assert names(tmp_path) == ["colour_chart.png"]
    assert "the scene is " in run.err
    (asked,) = renderer.asked
    assert (asked["size"], asked["spp"], asked["device"]) == ((64, 40), None, "cpu")


def test_every_output_and_the_statistics_are_written(scene: Path, renderer: Any, rptcam: Command) -> None:
    outputs = ("-o", "a.npy", "--output", "a.png", "-o", "a.exr", "--stats", "stats.json")
    run = rptcam("render", "scene.yaml", *outputs)
    assert run.code == 0
    assert run.out == ""
    assert "wrote a.npy, a.png, a.exr: 8 x 6, 4 spp, 0.6 s (0.3 s rendering), 1.5 Msamples/s" in run.err
    assert run.err.endswith("the lens blocked 25 % of the rays\n")
    assert names(scene.parent) == ["a.exr", "a.npy", "a.png", "scene.yaml", "stats.json"]
    assert np.array_equal(np.load("a.npy"), renderer.image.pixels)
    assert json.loads(Path("stats.json").read_text("utf-8")) == renderer.image.stats


def test_samples_that_a_noise_target_took_are_said_and_not_their_limit(
    scene: Path, renderer: Any, rptcam: Command
) -> None:
    renderer.image.stats.update({"spp": 16384, "noise": {"spp_min": 64, "spp_mean": 330.4}})
    assert "8 x 6, 330 spp on average (64 to 16384), 0.6 s" in rptcam("render", "scene.yaml", "-o", "a.npy").err
    renderer.image.stats.update({"spp": 64, "noise": {"spp_min": 64, "spp_mean": 64.0}})
    assert "8 x 6, 64 spp, 0.6 s" in rptcam("render", "scene.yaml", "-o", "a.npy").err


def test_film_that_cannot_go_where_it_was_to_go_is_kept_elsewhere(
    scene: Path, renderer: Any, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(scene.parent))
    Path("out").mkdir()
    renderer.during = lambda options: Path("out").rmdir()
    run = rptcam("render", "scene.yaml", "-o", "out/a.png")
    assert run.code == 4
    (kept,) = scene.parent.glob("rptcam-*.exr")
    assert f"out/a.png: there is no folder {scene.parent}/out; make it first (the film is kept in {kept}" in run.err
    np.testing.assert_array_equal(read_film(kept).pixels, renderer.image.pixels)
    kept.unlink()
    Path("out").mkdir()
    assert rptcam("render", "scene.yaml", "-o", "out/a.png", "-o", "b.exr").code == 4
    assert Path("b.exr").exists() and not list(scene.parent.glob("rptcam-*.exr"))  # the film is there


def test_statistics_that_json_cannot_say_are_null(scene: Path, renderer: Any, rptcam: Command) -> None:
    renderer.image.stats["extra"] = {"share": float("nan"), "count": np.int64(3)}
    assert rptcam("render", "scene.yaml", "-o", "a.npy", "--stats", "s.json").code == 0
    assert json.loads(Path("s.json").read_text("utf-8"))["extra"] == {"share": None, "count": 3}


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["-o", "a.gif"], 2, r"a\.gif: .*allowed: \.png, \.jpg, \.jpeg, \.tif, \.tiff, \.exr, \.npy"),
        (["-o", "a"], 2, r"got no suffix; allowed: \.png"),
        (["-o", "folder.png"], 4, "is a folder"),
        (["-o", "missing/a.png"], 4, "there is no folder"),
        (["-o", "/proc/a.png"], 4, "cannot be written"),
        (["-o", "a.png", "-o", "./a.png"], 2, "same file twice"),
        (["-o", "a.####.png"], 2, "#### stands for the number of a frame"),
        (["-o", "a.png", "-o", "b.txt"], 2, r"b\.txt"),
        (["-o", "a.png", "--stats", "scene.yaml"], 2, r"\.json"),
        (["-o", "a.png", "--stats", "missing/s.json"], 4, "there is no folder"),
        (["-o", "scene.npy"], 2, "is an input"),
        ([], 2, "required: -o"),
        (["-o"], 2, "expected one argument"),
        (["-o", "a.png", "--watch", "--plan"], 2, "anew each time .allowed: without --plan"),
        (["-o", "a.png", "--watch", "--resume"], 2, "anew each time .allowed: without --resume"),
        (
            ["-o", "a.rpck", "--watch", "--part", "1/2"],
            2,
            "one whole picture, here, anew each time .allowed: without --part",
        ),
        (
            ["-o", "a.rpck", "--watch", "--samples", "0:2"],
            2,
            "picture, here, anew each time .allowed: without --samples",
        ),
        (
            ["-o", "a.#.png", "--watch", "--frames", "1-2"],
            2,
            "picture, here, anew each time .allowed: without --frames",
        ),
        (["-o", "a.png", "--watch", "--cluster", "tls://a:1"], 2, "here, anew each time .allowed: without --cluster"),
        (["-o", "a.png", "--watch", "--workers", "2"], 2, "picture, here, anew each time .allowed: without --workers"),
        (["-o", "a.png", "--raw", "a.dng"], 2, "--raw: the scene has no sensor"),
        (
            ["-o", "a.png", "--raw", "a.gif", "--set", "exposure={mode: physical, f_number: 8}", "--set", "sensor={}"],
            2,
            r"a\.gif",
        ),
        (["-o", "a.png", "--layers", "depth"], 2, "--layers: no output can hold them"),
        (["-o", "a.png", "--truth", "scene.yaml"], 4, "scene.yaml is no folder"),
        (["-o", "a.png", "--noise", "1"], 2, "--noise: got 1; allowed a number between 0 and 1"),
        (["-o", "a.png", "--noise", "nan"], 2, "--noise: got nan; allowed a number between 0 and 1"),
        (["-o", "a.png", "--spp", "0"], 2, "--spp: got 0; allowed a whole number from 1 to 4294967295"),
        (["-o", "a.png", "--spp", "-1"], 2, "--spp: got -1"),
        (["-o", "a.png", "--spp", "4294967296"], 2, "--spp: got 4294967296"),
        (["-o", "a.png", "--spp", "1.5"], 2, "--spp: got 1.5"),
        (["-o", "a.png", "--spp", "5e9"], 2, "--spp: got 5e9"),
        (["-o", "a.png", "--spp", "inf"], 2, "--spp: got inf"),
        (["-o", "a.exr", "--layers", "depth,"], 2, "--layers: got a comma too many in depth,; allowed all"),
        (["-o", "a.png", "--set", "camera.fov=50"], 2, "camera.fov: unknown key; did you mean fov_degrees"),
        (["-o", "a.png", "--spp", "9" * 5000], 2, "--spp: got 999"),
        (["-o", "a.png", "--time", "0"], 2, "--time: got 0; allowed a time above 0, as 60s, 2min, 1h or 1m30s"),
        (["-o", "a.png", "--time", "nan"], 2, "--time: got nan"),
        (["-o", "a.png", "--time", "inf"], 2, "--time: got inf"),
        (["-o", "a.png", "--time", "-3"], 2, "--time: got -3"),
        (["-o", "a.png", "--seed", "-1"], 2, "--seed: got -1; allowed a whole number from 0 to"),
        (["-o", "a.png", "--seed", "18446744073709551616"], 2, "--seed: got 18446744073709551616"),
        (["-o", "a.png", "--size", "0x10"], 2, "--size: got 0x10; allowed WxH"),
        (["-o", "a.png", "--size", "640"], 2, "--size: got 640"),
        (["-o", "a.png", "--size", "640x-360"], 2, "--size: got 640x-360"),
        (["-o", "a.png", "--crop", "0,1,0"], 2, "--crop: got 0,1,0; allowed x0,x1,y0,y1"),
        (["-o", "a.png", "--crop", "0.5,0.5,0,1"], 2, "--crop: got"),
        (["-o", "a.png", "--crop", "0,1.1,0,1"], 2, "--crop: got"),
        (["-o", "a.png", "--crop", "0,nan,0,1"], 2, "--crop: got"),
        (["-o", "a.png", "--ssp", "4"], 2, "unknown argument --ssp; did you mean --spp"),
        (["-o", "a.png", "--sp", "4"], 2, "unknown argument --sp"),
        (["--out", "a.png"], 2, "unknown argument --out; did you mean -o/--output?"),
        (["-o", "a.png", "--set", "f_number=4"], 2, "unknown key; did you mean camera.f_number?"),
        (["-o", "a.png", "--set", "camera.iso=400"], 2, "unknown key; did you mean exposure.iso?"),
        (["-o", "a.png", "--resum"], 2, "unknown argument --resum; did you mean --resume"),
        (["-o", "a.png", "second.yaml"], 2, r"unknown argument second\.yaml"),
        (["-o", "a.png", "--set", "camera.fov_degreees=50"], 2, "did you mean"),
        (["-o", "a.png", "--set", "camera.fov_degrees"], 2, "camera.fov_degrees"),
    ],
)
def test_mistake_is_named_before_anything_is_rendered(
    scene: Path, renderer: Any, rptcam: Command, words: list[str], code: int, message: str
) -> None:
    (scene.parent / "folder.png").mkdir()
    (scene.parent / "scene.npy").symlink_to(scene)
    before = names(scene.parent)
    run = rptcam("render", "scene.yaml", *words)
    assert run.code == code
    assert run.err.startswith("error: ")
    assert re.search(message, run.err), run.err
    assert run.out == ""
    assert renderer.asked == []
    assert names(scene.parent) == before


def test_scene_file_that_is_not_there_is_named(scene: Path, renderer: Any, rptcam: Command) -> None:
    run = rptcam("render", "absent.yaml", "-o", "a.png")
    assert run.code in (2, 4)
    assert "absent.yaml" in run.err


def test_lens_file_is_not_overwritten(scene: Path, renderer: Any, rptcam: Command) -> None:
    lens = scene.parent / "lens.yaml"
    lens.write_text("surfaces:\n- {radius: 50, thickness: 5, glass: {index: 1.5}, diameter: 20}\n- {diameter: 20}\n")
    (scene.parent / "lens.npy").symlink_to(lens)
    words = [
        "--set",
        "camera={kind: realistic, eye: [0, 0, 5], target: [0, 0, 0], lens: lens.yaml, focus: {distance_m: 5}}",
    ]
    run = rptcam("render", "scene.yaml", "-o", "lens.npy", *words)
    assert run.code == 2
    assert "is an input" in run.err


def test_probable_mistake_is_a_warning_and_renders(scene: Path, renderer: Any, rptcam: Command) -> None:
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--set", "environment=null", "--quiet")
    assert run.code == 0
    assert run.err.startswith("warning: ")


def test_device_that_fails_after_an_interrupt_is_no_error_but_its_end(
    scene: Path, renderer: Any, rptcam: Command
) -> None:
    def interrupted_compiler(options: dict[str, Any]) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        raise DeviceError("tempfile.preproc.cl: No such file or directory")

    renderer.during = interrupted_compiler
    run = rptcam("render", "scene.yaml", "-o", "a.png")
    assert (run.code, run.err) == (130, "interrupted\n")


@pytest.mark.parametrize(("error", "code"), [(DeviceError, 3), (StateError, 4)])
def test_failure_while_rendering_is_one_line(
    scene: Path, renderer: Any, rptcam: Command, error: type[Exception], code: int
) -> None:
    def fail(options: dict[str, Any]) -> None:
        raise error("the reason")

    renderer.during = fail
    run = rptcam("render", "scene.yaml", "-o", "a.png")
    assert (run.code, run.err) == (code, "error: the reason\n")
    assert names(scene.parent) == ["scene.yaml"]


def test_output_that_fails_at_the_end_does_not_lose_the_others(
    scene: Path, renderer: Any, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Image.save

    def fail_for_png(image: Image, path: Path) -> None:
        if path.suffix == ".png":
            raise StateError("a.png: no space")
        save(image, path)

    monkeypatch.setattr(Image, "save", fail_for_png)
    run = rptcam("render", "scene.yaml", "-o", "a.png", "-o", "a.npy", "--stats", "s.json")
    assert run.code == 4
    assert "a.png: no space" in run.err
    assert names(scene.parent) == ["a.npy", "s.json", "scene.yaml"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_keeps_the_picture_and_gives_130(
    scene: Path, renderer: Any, rptcam: Command, number: signal.Signals
) -> None:
    def press(options: dict[str, Any]) -> None:
        assert not options["should_stop"]()
        os.kill(os.getpid(), number)
        assert options["should_stop"]()
        renderer.image.stats["interrupted"] = True

    handlers = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]
    renderer.during = press
    run = rptcam("render", "scene.yaml", "-o", "a.npy")
    assert run.code == 130
    assert "interrupted" in run.err
    assert Path("a.npy").exists()
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == handlers


def test_second_interrupt_leaves_at_once(scene: Path, renderer: Any, rptcam: Command) -> None:
    def press_twice(options: dict[str, Any]) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("still rendering")

    renderer.during = press_twice
    run = rptcam("render", "scene.yaml", "-o", "a.npy")
    assert (run.code, run.err) == (130, "interrupted\n")
    assert names(scene.parent) == ["scene.yaml"]


BLACK, DIM = np.zeros((2, 3, 3), np.float32), np.zeros((2, 3, 3), np.float32)
DIM[1, 2, 0] = 1e-9


@pytest.mark.parametrize(
    ("pixels", "whole", "passed", "metadata", "words"),
    [
        (BLACK, True, 50, {}, "the picture is black: no light reaches the film"),
        (BLACK, False, 50, {}, ""),  # a part of a picture may be black
        (DIM, True, 50, {}, ""),
        (DIM, True, 9, {"film_size_mm": [36.0, 24.0]}, "blocked 91 % of the rays: the film of 36 x 24 mm is perhaps"),
        (DIM, True, 9, {}, "blocked 91 % of the rays: the film is perhaps"),
        (DIM, True, 0, {}, "blocked 100 % of the rays"),
        (DIM, True, None, {}, ""),
    ],
)
def test_dark_pictures_are_warned_of(
    pixels: np.ndarray, whole: bool, passed: int | None, metadata: dict[str, Any], words: str
) -> None:
    stats = {} if passed is None else {"lens": {"passed": passed, "blocked": 100 - passed}}
    found = dark_warnings(SimpleNamespace(pixels=pixels, stats=stats, metadata=metadata), whole=whole)  # type: ignore
    assert len(found) == bool(words)
    assert words in "".join(found)


def test_truth_is_refused_where_it_could_not_be_written(
    scene: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    (scene.parent / "file").write_text("")
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--truth", "file/deep")
    assert (run.code, "file is no folder" in run.err) == (4, True), run.err
    monkeypatch.setattr(os, "access", lambda path, mode: not str(path).endswith(scene.parent.name))
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--truth", "new/deep")
    assert (run.code, "cannot be written to" in run.err) == (4, True), run.err
    assert names(scene.parent) == ["file", "scene.yaml"]


def test_what_was_done_beside_the_samples_is_said_a_line_each(scene: Path, renderer: Any, rptcam: Command) -> None:
    metadata = renderer.image.metadata
    more = {
        "diffraction": {"says": "off"}, "ghosts": {"says": "12 ways"}, "lamps_aimed_at": 2,
        "accuracy": {"says": ["thin_lens", "as the blur is small"]}, "metered_cd_m2": 12.5,
        "autofocus": {"warnings": ["it is dark"]},
    }  # fmt: skip
    metadata.update(more)
    run = rptcam("render", "scene.yaml", "-o", "a.npy")
    assert run.err.splitlines()[:-1] == [
        "warning: autofocus: it is dark", "diffraction: off", "ghosts: 12 ways",
        "bokeh: camera rays aim at 2 lamps out of focus", "accuracy: thin_lens", "accuracy: as the blur is small",
    ]  # fmt: skip
    metadata["lamps_aimed_at"] = 1
    assert "aim at 1 lamp out of focus" in rptcam("render", "scene.yaml", "-o", "a.npy").err
    assert rptcam("render", "scene.yaml", "-o", "a.npy", "--quiet").err == "warning: autofocus: it is dark\n"


def test_picture_of_a_strict_render_that_fails_is_written(scene: Path, renderer: Any, rptcam: Command) -> None:
    def fail(options: dict[str, Any]) -> None:
        raise NumericError("strict: 3 samples were not finite", renderer.image)

    renderer.during = fail
    run = rptcam("render", "scene.yaml", "-o", "a.npy", "--strict", "--quiet")
    assert (run.code, run.err) == (5, "error: strict: 3 samples were not finite\n")
    np.testing.assert_array_equal(np.load("a.npy"), renderer.image.pixels)


def test_part_whose_file_could_not_be_written_is_an_error(scene: Path, renderer: Any, rptcam: Command) -> None:
    renderer.image.stats["checkpoint"] = None
    run = rptcam("render", "scene.yaml", "-o", "a.rpck", "--part", "1/2")
    assert (run.code, run.err) == (4, "error: a.rpck: could not be written\n")


def test_film_that_nothing_takes_is_said_to_be_lost(
    scene: Path, renderer: Any, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> Any:
        raise OSError(28, "No space left on device")

    Path("out").mkdir()

    def end(options: dict[str, Any]) -> None:
        Path("out").rmdir()
        monkeypatch.setattr("tempfile.mkstemp", full)

    renderer.during = end
    run = rptcam("render", "scene.yaml", "-o", "out/a.png")
    assert run.code == 4
    assert run.err.endswith("make it first (and no place was found where the film could be kept)\n")


def test_picture_that_is_interrupted_while_watched_is_not_written(
    scene: Path, renderer: Any, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer.image.stats["interrupted"] = True
    monkeypatch.setattr("rptcam_cl.cli.frames.render_again", lambda path, stop, picture: picture(lambda: False))
    assert rptcam("render", "scene.yaml", "-o", "a.npy", "--watch").code == 0
    assert names(scene.parent) == ["scene.yaml"]
    renderer.image.stats["interrupted"] = False
    assert rptcam("render", "scene.yaml", "-o", "a.npy", "--watch").code == 0
    assert names(scene.parent) == ["a.npy", "scene.yaml"]


@pytest.mark.parametrize(
    ("words", "early"),
    [
        ([], None),
        (["--device", "cpu"], "cpu"),
        (["--set", "camera.fov_degrees=50", "--layers", "depth", "-o", "a.npz"], None),
        (["--device", "all"], ...),
        (["--device", "0:0", "--device", "0:1"], ...),
        (["--split", "0:0=0.7,1:0=0.3"], ...),
        (["--plan"], ...),
    ],
)
def test_device_of_a_single_picture_is_opened_while_its_scene_is_read(
    scene: Path, renderer: Any, rptcam: Command, monkeypatch: pytest.MonkeyPatch, words: list[str], early: Any
) -> None:
    opened: list[Any] = []

    def open_early(*given: Any) -> Callable[[], None]:
        opened.append(given)
        return lambda: opened.append("rendered")

    monkeypatch.setattr("rptcam_cl.device.session.open_early", open_early)
    monkeypatch.setattr("rptcam_cl.cli.render._print_plan", lambda *_: 0)
    assert rptcam("render", "scene.yaml", "-o", "a.npy", *words).code == 0
    overrides = [word for word in words if word.startswith("camera.")]
    layers = ("depth",) if "--layers" in words else None
    assert opened == ([] if early is ... else [(early, str(scene), overrides, layers), "rendered"])
    opened.clear()
    renderer.during = lambda options: (_ for _ in ()).throw(InputError("no"))
    rptcam("render", "scene.yaml", "-o", "a.npy", *words)
    assert "rendered" not in opened  # after an error it is opened anew
