"""``rptcam sweep`` on the command line."""

import os
import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.api.job import SeriesRenderer
from rptcam_cl.cli import main
from rptcam_cl.cli.frames import F_NUMBERS, expand_ellipsis
from rptcam_cl.core import remember as kept
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import open_session

Command = Callable[..., Any]


def test_sweep_prints_a_table_and_goes_on_where_it_was(scene: Path, rptcam: Command) -> None:
    words = ("sweep", "scene.yaml", "--over", "camera.fov_degrees=30,50", "-o", "out", "--spp", "1")
    run = rptcam(*words)
    assert run.code == 0, run.err
    assert run.out.splitlines()[0].split() == ["camera.fov_degrees", "mean", "noise", "spp", "seconds"]
    assert run.err == "fov_degrees 30: rendered\nfov_degrees 50: rendered\n"
    assert rptcam(*words).err == "fov_degrees 30: kept\nfov_degrees 50: kept\n"
    assert len(list(Path("out").glob("*.exr"))) == 2


@pytest.mark.parametrize(
    "words",
    [
        ("sweep", "scene.yaml", "--over", "camera.fov_degrees=30,50", "-o", "out", "--spp", "1"),
        ("dataset", "spec.yaml", "-o", "out"),
        ("dataset", "spec.yaml", "-o", "out", "--shard", "1"),
        (
            "render",
            "scene.yaml",
            "-o",
            "out/a.##.exr",
            "-o",
            "out/a.##.png",
            "--frames",
            "1-2",
            "--resume",
            "--spp",
            "1",
        ),
        ("render", "scene.yaml", "-o", "out/a.##.png", "--frames", "1-2", "--resume", "--spp", "1"),
    ],
)
@pytest.mark.parametrize("what", ["code", "driver"])
def test_folder_of_other_code_or_of_another_driver_is_gone_on_with_only_when_told(
    scene: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], what: str
) -> None:
    Path("out").mkdir()
    Path("spec.yaml").write_text("scene: scene.yaml\nframes: 2\nvary: {picture.ev: {uniform: [0, 1]}}\n")
    one = ("--frames", "0") if words[0] == "dataset" else ()
    with monkeypatch.context() as other:
        if what == "code":
            other.setattr(kept, "code_digest", lambda: "other")
        else:
            other.setitem(vars(open_session().info), "driver", "old")
        assert rptcam(*(word.replace("=30,50", "=30").replace("1-2", "1") for word in words), *one).code == 0
    files = {path: path.read_bytes() for path in Path("out").iterdir() if path.is_file()}
    run = rptcam(*words)
    assert run.code == 4 and re.search(rf": its {what} is \w+.*, and that of .*--allow-mixed", run.err), run.err
    for path, content in files.items():
        assert path.read_bytes() == content
    run = rptcam(*words, "--allow-mixed")
    assert run.code == 0 and re.search(rf"warning: .*: its {what} is ", run.err), run.err
    assert re.search("kept", run.err), run.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--over", "camera.fov_degrees"], "is not of the form key.path=a,b"),
        (["--over", "camera.fov_degrees=[1"], "--over camera.fov_degrees"),
        (["--over", "picture.ev=1", "--over", "picture.ev=2"], "picture.ev twice"),
        (["--over", "camera.fov_degrees=30,999"], "camera.fov_degrees=999: "),
        (["--over", "picture.ev=1", "--mtf", "2,0"], "--mtf: got 2,0"),
        ([], "required: --over"),
    ],
)
def test_mistake_of_a_sweep_is_named(scene: Path, rptcam: Command, words: list[str], message: str) -> None:
    run = rptcam("sweep", "scene.yaml", "-o", "out", *words)
    assert run.code == 2
    assert re.search(re.escape(message), run.err), run.err
    assert not Path("out").exists()


@pytest.mark.parametrize("words", [("sweep", "scene.yaml", "--over", "picture.ev=1,2"), ("dataset", "spec.yaml")])
def test_folder_to_write_to_that_is_a_file_is_said_to_be_one(
    scene: Path, rptcam: Command, words: tuple[str, ...]
) -> None:
    Path("spec.yaml").write_text("scene: scene.yaml\nframes: 2\nvary: {picture.ev: {uniform: [0, 1]}}\n")
    run = rptcam(*words, "-o", "spec.yaml")
    assert (run.code, run.err) == (4, "error: spec.yaml: is a file, not a folder\n")


@pytest.mark.parametrize(
    "words", [("sweep", "scene.yaml", "--over", "picture.ev=1,2", "--spp", "1"), ("dataset", "spec.yaml")]
)
def test_first_interrupt_says_that_the_picture_is_finished(
    scene: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    Path("spec.yaml").write_text("scene: scene.yaml\nframes: 2\nvary: {picture.ev: {uniform: [0, 1]}}\n")
    render = SeriesRenderer.render

    def pressed(self: SeriesRenderer, *given: Any, **named: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return render(self, *given, **named)

    monkeypatch.setattr(SeriesRenderer, "render", pressed)
    assert main((*words, "-o", "out", "--quiet")) == 130
    assert capfd.readouterr().err.splitlines() == [
        "interrupted: the picture at hand is finished first; Ctrl-C again ends at once",
        "interrupted: the same command goes on with the rest",
    ]


@pytest.mark.parametrize(
    ("key", "values", "wanted"),
    [
        ("camera.f_number", [2, 2.8, "…", 22], [2, 2.8, 4, 5.6, 8, 11, 16, 22]),
        ("camera.f_number", [2, "...", 8], [2, 2.8, 4, 5.6, 8]),
        ("camera.f_number", [2, 2.4, "…", 5.6], [2, 2.4, 2.8, 3.3, 4, 4.8, 5.6]),
        ("camera.f_number", [2, 2.2, "…", 4, 16], [2, 2.2, 2.5, 2.8, 3.2, 3.5, 4, 16]),
        ("camera.f_number", [8, 5.6, "…", 2], [8, 5.6, 4, 2.8, 2]),
        ("camera.focus.distance_m", [1, 1.5, "…", 3], [1, 1.5, 2, 2.5, 3]),
        ("render.seed", [0, 2, "...", 8], [0, 2, 4, 6, 8]),
        ("camera.lens", ["a", "b"], ["a", "b"]),
    ],
)
def test_ellipsis_goes_on_as_the_values_began(key, values, wanted):
    assert expand_ellipsis(key, values, "--over") == wanted


@pytest.mark.parametrize(
    ("key", "values", "match"),
    [
        ("camera.f_number", [2, 2.9, "…", 22], "no series of full, half or third stops"),
        ("camera.f_number", [2, 2.8, "…", 23], "no series of full"),
        ("camera.f_number", ["…", 22], "between numbers"),
        ("camera.f_number", [2, "…"], "between numbers"),
        ("camera.lens", ["a", "…", "b"], "between numbers"),
        ("film.width_mm", [1, 2, "…", 4, "…", 8], "between numbers"),
        ("film.width_mm", [1, "…", 4], "no series of equal steps"),
        ("film.width_mm", [1, 1.5, "…", 2.3], "no series of equal steps"),
        ("film.width_mm", [3, 2, "…", 5], "no series of equal steps"),
        ("film.width_mm", [1, 1, "…", 5], "no series of equal steps"),
    ],
)
def test_what_makes_no_series_is_refused(key, values, match):
    with pytest.raises(InputError, match=match):
        expand_ellipsis(key, values, "--over")


def test_scales_are_stops_apart():
    for scale, stop in zip(F_NUMBERS, (1, 1 / 2, 1 / 3), strict=True):
        exact = [2 ** (round(k) * stop / 2 + (-1 if scale[0] == 0.5 else 0)) for k in range(len(scale))]
        assert all(abs(nominal / value - 1) < 0.06 for nominal, value in zip(scale, exact, strict=True))
