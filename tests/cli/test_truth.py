"""``rptcam render --truth``: the files of ground truth beside a picture."""

import json

import numpy as np
import pytest

from rptcam_cl.cli import main

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
