"""``rptcam render --watch`` and ``--preview``: pictures while a scene is edited, and while a render goes on."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.cli.frames import render_again
from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.core.files import Folders

SCENE = """\
film: {resolution: [24, 16]}
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}
environment: {kind: constant, radiance: LIGHT}
"""


def eventually(holds: Callable[[], Any], seconds: float = 60.0) -> Any:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := holds():
            return found
        time.sleep(0.05)
    raise AssertionError("it has not come")


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[tuple[Path, Path, subprocess.Popen[str]]]:
    scene, output = tmp_path / "scene.yaml", tmp_path / "out.npy"
    scene.write_text(SCENE.replace("LIGHT", "0.25"))
    command = [sys.executable, "-m", "rptcam_cl", "render", scene, "-o", output, "--spp", "1", "--watch", "--quiet"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    yield scene, output, process
    process.kill()
    process.wait()


def shows(output: Path, light: float) -> bool:
    return output.exists() and bool(np.allclose(np.load(output), light))


def test_edited_scene_is_rendered_again_and_an_error_keeps_the_picture(
    watched: tuple[Path, Path, subprocess.Popen[str]],
) -> None:
    scene, output, process = watched
    eventually(lambda: shows(output, 0.25))
    scene.write_text(SCENE.replace("LIGHT", "0.5"))
    eventually(lambda: shows(output, 0.5))
    scene.write_text(SCENE.replace("fov_degrees: 40", "fov_degrees: 400").replace("LIGHT", "1"))
    assert process.stderr is not None
    error = process.stderr.readline()
    assert f"{scene}:2:" in error and "camera.fov_degrees: is out of range" in error
    assert shows(output, 0.5)
    scene.write_text(SCENE.replace("LIGHT", "1"))
    eventually(lambda: shows(output, 1.0))
    process.send_signal(signal.SIGINT)
    assert process.wait(120) == 0


def test_files_that_are_named_are_watched_too_and_errors_are_waited_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rptcam_cl.cli.frames.INTERVAL_S", 0.0)
    scene, lens, stop = tmp_path / "scene.yaml", tmp_path / "lens.yaml", threading.Event()
    scene.write_text("")
    lens.write_text("1")
    seen: list[str] = []

    def picture(should_stop: Callable[[], bool]) -> None:
        text = Folders(tmp_path).find("lens.yaml").read_text()
        should_stop()  # the files that a picture names count from this comparison on
        seen.append(text)
        if seen[-1] == "2":
            raise InputError("the lens is no lens")
        if seen[-1] == "3":
            while not should_stop():  # a render that the next edit ends
                time.sleep(0.02)

    thread = threading.Thread(target=render_again, args=(scene, stop, picture), daemon=True)
    thread.start()
    eventually(lambda: seen)
    for text in ("2", "3", "4"):
        (tmp_path / "new").write_text(text)
        (tmp_path / "new").replace(lens)
        eventually(lambda text=text: seen[-1] == text)
    stop.set()
    thread.join(60)
    assert not thread.is_alive() and seen == ["1", "2", "3", "4"]
    assert "error: the lens is no lens" in capsys.readouterr().err


def test_what_fails_because_watching_ends_is_not_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stop = threading.Event()

    def picture(should_stop: Callable[[], bool]) -> None:
        stop.set()
        raise DeviceError("tempfile.preproc.cl: No such file or directory")

    render_again(tmp_path / "scene.yaml", stop, picture)
    assert capsys.readouterr().err == ""


def test_preview_writes_the_picture_so_far(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from rptcam_cl.imaging.image import Image

    saved: list[Image] = []
    keep = Image.save

    def save(image: Image, path: Any) -> None:
        saved.append(image)
        keep(image, path)

    monkeypatch.setattr(Image, "save", save)
    (tmp_path / "scene.yaml").write_text(SCENE.replace("LIGHT", "0.5"))
    output = tmp_path / "out.npy"
    words = [
        "render",
        str(tmp_path / "scene.yaml"),
        "-o",
        str(output),
        "--quiet",
        "--spp",
        "1600",
        "--preview",
        "0.001s",
    ]
    assert main(words) == 0
    assert len(saved) > 1
    *previews, last = saved
    assert last.metadata["spp"] == 1600 and all(image.metadata["spp"] <= 1600 for image in previews)
    for image in saved:
        np.testing.assert_allclose(image.pixels, 0.5, rtol=1e-6)
    np.testing.assert_array_equal(np.load(output), last.pixels)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.npy", "scene.yaml"]


@pytest.mark.parametrize("words", ["--part 1/2", "--samples 0:2", "--frames 1-2", "--workers 2", "--resume", "--plan"])
def test_watched_render_is_of_one_whole_picture(words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "scene.yaml").write_text("nothing to read", "utf-8")
    out = str(tmp_path / "a.rpck")
    assert main(["render", str(tmp_path / "scene.yaml"), "-o", out, "--watch", *words.split()]) == 2
    option = words.partition(" ")[0]
    assert (
        f"--watch: renders one whole picture, here, anew each time (allowed: without {option})"
        in capsys.readouterr().err
    )
