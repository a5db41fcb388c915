"""``rptcam render --frames`` on a cluster: each worker renders whole frames, and the files are those of one machine."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rptcam_cl
from rptcam_cl.batch.cluster import RenderedPart, TasksOut
from rptcam_cl.batch.cluster_run import parts_of, render_scenes_on_cluster
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.image import read_film
from rptcam_cl.scene.changes import set_keys
from tests.cli.conftest import rptcam  # noqa: F401

Command = Callable[..., Any]
SCENE = """
film: {resolution: [16, 12]}
camera: {kind: pinhole, eye: [0, 0, 3], target: [0, 0, 0], fov_degrees: 30}
objects:
  - shape: rectangle
    corner: [-1, -1, 0]
    edge_u: [2, 0, 0]
    edge_v: [0, 2, 0]
    material: {kind: matte, reflectance: {kind: image, file: dots.png}}
environment: {kind: constant, radiance: 1}
sequence: {keys: {camera.fov_degrees: [{time_s: 0, value: 30}, {time_s: 1, value: 60}]}}
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    dots = np.random.default_rng(3).integers(0, 255, (8, 8, 3), np.uint8)
    Image.fromarray(dots).save("dots.png")
    Image.fromarray(255 - dots).save("other.png")
    Path("scene.yaml").write_text(SCENE, "utf-8")
    return tmp_path / "scene.yaml"


@pytest.mark.slow
def test_frames_have_the_bytes_of_one_machine_and_those_that_are_there_are_kept(
    scene: Path,
    address: str,
    rptcam: Command,  # noqa: F811
) -> None:
    words = ("render", "scene.yaml", "--spp", "2", "--frames", "1-4", "-o")
    assert rptcam(*words, "here.##.exr").code == 0
    run = rptcam(*words, "out.##.exr", "--cluster", address, "--tls", "none")
    assert run.code == 0, run.err
    for frame in range(1, 5):
        assert Path(f"out.0{frame}.exr").read_bytes() == Path(f"here.0{frame}.exr").read_bytes()
    Path("out.03.exr").unlink()
    run = rptcam(*words, "out.##.exr", "--cluster", address, "--tls", "none", "--resume")
    assert (run.err.count("kept"), run.err.count("wrote")) == (3, 1)
    assert Path("out.03.exr").read_bytes() == Path("here.03.exr").read_bytes()


def test_files_that_only_some_frames_name_are_sent_too(scene: Path, address: str) -> None:
    given = rptcam_cl.load_scene(scene)
    other = set_keys(given, {"objects.0.material.reflectance.file": "other.png"})
    found = dict(render_scenes_on_cluster({7: given, 9: other}, address, tls=False, settings={"spp": 1}))
    for number, alone in ((7, given), (9, other)):
        np.testing.assert_array_equal(found[number].pixels, rptcam_cl.render(alone, spp=1).pixels)


def test_picture_that_comes_with_the_stop_is_given_out(
    scene: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    came: list[Any] = []
    plain = TasksOut.next

    def noted(tasks: TasksOut) -> Any:
        found = plain(tasks)
        came.extend([found] if found and isinstance(found[1], RenderedPart) else [])
        return found

    monkeypatch.setattr(TasksOut, "next", noted)
    given = dict.fromkeys(range(20), rptcam_cl.load_scene(scene))
    pictures: list[int] = []
    with pytest.raises(InterruptedError):
        words = {"tls": False, "settings": {"spp": 1}, "should_stop": lambda: bool(came)}
        for number, _ in render_scenes_on_cluster(given, address, **words):
            pictures.append(number)
    assert len(pictures) == len(came) == 1


def test_sweep_on_a_cluster_has_the_films_of_one_machine(
    scene: Path,
    address: str,
    rptcam: Command,  # noqa: F811
) -> None:
    words = ("sweep", "scene.yaml", "--over", "camera.fov_degrees=30,40", "--spp", "2", "-o")
    assert rptcam(*words, "here").code == 0
    run = rptcam(*words, "there", "--cluster", address, "--tls", "none")
    assert run.code == 0, run.err
    assert run.err.count("rendered") == 2
    films = sorted(path.name for path in Path("here").glob("*.exr"))
    assert len(films) == 2
    for name in films:
        np.testing.assert_array_equal(read_film(Path("there") / name).pixels, read_film(Path("here") / name).pixels)
    assert Path("there/contact_sheet.png").read_bytes() == Path("here/contact_sheet.png").read_bytes()
    assert rptcam(*words, "there", "--cluster", address, "--tls", "none").err.count("kept") == 2
    assert "--tls: is for a cluster" in rptcam(*words, "there", "--tls", "a,b,c").err


def test_frames_that_cannot_be_sent_are_refused_before_any_work(scene: Path, address: str) -> None:
    noisy = set_keys(rptcam_cl.load_scene(scene), {"render.noise": 0.1})
    with pytest.raises(InputError, match="a noise target needs the whole film"):
        next(render_scenes_on_cluster({1: noisy}, address, tls=False))
    assert dict(render_scenes_on_cluster({}, address, tls=False)) == {}


def test_equal_workers_have_as_many_parts_each() -> None:
    assert [parts_of(seconds, 2) for seconds in (1, 60, 63)] == [8, 46, 46]  # of the square root of 2 x 0.03 x 30 s
    assert parts_of(36000, 2) == 3602  # of 10 s
    assert parts_of(3.6e6, 1000) == 91000  # of 40 s, as fast as the client takes them in
    assert parts_of(3600, 7) % 7 == 0
