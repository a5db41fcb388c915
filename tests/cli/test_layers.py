"""Layers on the command line."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.scene.film import SINGLE_LAYERS


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ("-o a.exr --layers depth,normal", ["depth", "normal"]),
        ("-o a.png -o a.npz --layers all", list(SINGLE_LAYERS)),
        ("-o a.exr", None),  # the scene's
        ("-o a.png", []),  # no place for any
    ],
)
def test_layers_asked_for_are_recorded(scene, renderer, rptcam, words, asked):
    assert rptcam("render", "scene.yaml", *words.split()).code == 0
    assert renderer.asked[0]["layers"] == asked


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("-o a.png -o a.npy --layers depth", r"--layers: no output can hold them \(allowed: -o with a name"),
        ("-o a.exr --layers dept", r"argument --layers: got dept; did you mean depth\?; allowed all, depth, "),
        ("-o a.exr --layers depth,depth", "argument --layers: depth twice"),
        ("-o a.exr --layers depth,", "argument --layers: got a comma too many in depth,; allowed all, depth"),
    ],
)  # fmt: skip
def test_layers_that_cannot_be_are_refused_before_rendering(scene, renderer, rptcam, words, message):
    run = rptcam("render", "scene.yaml", *words.split())
    assert run.code == 2
    assert len(run.err.strip().splitlines()) == 1
    assert re.search(message, run.err)
    assert renderer.asked == []


@pytest.mark.parametrize(("words", "asked"), [((), False), (("--denoise",), True)])
def test_denoising_is_done_when_asked_for(scene, renderer, rptcam, words, asked):
    assert rptcam("render", "scene.yaml", "-o", "a.png", *words).code == 0
    assert renderer.asked[0]["denoise"] is asked


def test_layers_and_camera_reach_the_files(scene, rptcam):
    words = ("-o", "a.npz", "--layers", "depth,object_id", "--spp", "2", "--stats", "a.json", "--quiet")
    assert rptcam("render", "scene.yaml", *words).code == 0
    with np.load("a.npz") as held:
        assert held["depth"].shape == (6, 8)
        assert np.isclose(held["depth"].min(), 4.05, atol=0.1)
        metadata = json.loads(str(held["metadata"]))
    assert metadata["object_names"] == ["objects.0"]
    camera = json.loads(Path("a.json").read_text("utf-8"))["camera"]
    assert camera["world_from_camera"][2] == [0.0, 0.0, 1.0, 5.0]
    assert camera["resolution"] == [8, 6]
    assert camera["window"] == [0, 0, 8, 6]
    assert camera["intrinsics"]["fx"] == pytest.approx(4 / np.tan(np.radians(20)))


SCENE = """
film: {resolution: [16, 12], width_mm: 36}
camera: {kind: pinhole, fov_degrees: 40, eye: [0, 0, 0], target: [0, 0, -1]}
objects:
  - {name: ball, label: toy, shape: sphere, center: [0, 0, -3], radius: 0.5, material: {kind: matte, reflectance: 0.5}}
environment: {kind: constant, radiance: 1}
render: {spp: 1, max_depth: 2}
"""


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    return path


def test_truth_lies_beside_the_picture(scene, tmp_path):
    folder, picture = tmp_path / "new" / "truth", tmp_path / "ball.npz"
    words = ["render", str(scene), "-o", str(picture), "--layers", "depth", "--truth", str(folder), "--quiet"]
    assert main(words) == 0
    assert sorted(path.name for path in folder.iterdir()) == [
        "classes.png", "coco.json", "depth.npy", "instances.png", "rays.npz",
    ]  # fmt: skip
    said = json.loads((folder / "coco.json").read_text())
    assert said["images"][0]["file_name"] == "ball.npz"
    assert [each["name"] for each in said["categories"]] == ["toy", "object"]
    (ball,) = said["annotations"]
    assert ball["occlusion"] == 0
    with np.load(folder / "rays.npz") as rays:
        away = rays["ray_direction"] - rays["ray_direction"][..., 2:] * [0, 0, 1]
        aim = np.linalg.norm(away, axis=-1)  # the sine of the angle to the middle of the ball
    assert ball["area"] == np.count_nonzero(aim < 0.5 / 3)
    with np.load(picture) as film:
        assert "depth" in film
        assert not {"sharp_object_id", "ray_origin"} & set(film)


@pytest.mark.parametrize(
    ("more", "message", "code"),
    [
        (["--truth", "{0}/scene.yaml"], "is no folder", 4),
        (["--truth", "{0}/scene.yaml/truth"], "is no folder", 4),
        (["--truth", "{0}/truth", "--frames", "1-2"], "without --frames", 2),
    ],
)
def test_what_has_no_truth_is_refused_first(more, message, code, scene, tmp_path, capsys):
    words = [word.format(tmp_path) for word in more]
    name = "out.####.png" if "--frames" in more else "out.png"
    assert main(["render", str(scene), "-o", str(tmp_path / name), *words]) == code
    said = capsys.readouterr().err
    assert message in said
    assert said.count("error:") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["scene.yaml"]
