"""Renders that choose their camera model."""

import json

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.cli import main
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.studies.tier_models import equivalent
from tests.studies.tradeoff.tiers.cases import BALL, scene_of


def test_picture_is_that_of_the_chosen_camera_and_says_so():
    film = {"resolution": [48, 32]}
    accuracy = {"max_error_px": 0.3, "max_illumination_error": 0.01}
    scene = scene_of("telephoto-250mm", accuracy=accuracy, film=film, focus=5.0, f_number=22)
    image = render(scene, spp=4)
    told = image.metadata["accuracy"]
    assert told["camera_model"] == "thick_lens"
    assert image.metadata["camera"] == "thick_lens"
    assert image.stats["accuracy"] == told
    assert [found["camera_model"] for found in told["errors"]] == ["pinhole", "thin_lens", "thick_lens"]
    other = render(equivalent(scene, "thick_lens"), spp=4)
    assert np.array_equal(np.asarray(image), np.asarray(other))


@pytest.mark.slow
def test_chosen_camera_shows_what_the_traced_lens_does():
    """A lamp's middle and brightness agree within what the choice allows."""
    film = {"resolution": [64, 64], "width_mm": 10}
    accuracy = {"max_error_px": 0.2, "max_illumination_error": 0.02}
    scene = scene_of("telephoto-250mm", accuracy=accuracy, film=film, focus=5.0, f_number=11)
    lamp = {"kind": "emissive", "radiance": 1.0}
    ball = {"shape": "sphere", "center": [0.05, 0.04, -5], "radius": 0.02, "material": lamp}
    scene = type(scene).model_validate({"film": scene.film, "camera": scene.camera, "objects": [ball]})
    traced = change_scene(scene, camera={"accuracy": None})
    chosen, full = (np.asarray(render(each, spp=256))[..., 1] for each in (scene, traced))
    assert abs(chosen.sum() / full.sum() - 1) < 0.03
    rows, columns = np.mgrid[:64, :64]
    for axis in (rows, columns):
        assert abs((axis * chosen).sum() / chosen.sum() - (axis * full).sum() / full.sum()) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize(("tier", "light"), [("thin_lens", 0.03), ("thick_lens", 0.01)])
def test_ghosts_of_the_lens_come_with_the_camera_that_was_chosen(tier, light):
    film = {"resolution": [48, 32]}
    lamp = {"shape": "disk", "center": [0, 1.2, -5], "normal": [0, 0, 1], "radius": 0.02}
    objects = [BALL, lamp | {"material": {"kind": "emissive", "radiance": 1e3}}]
    camera = {"f_number": 22, "transmission": {"coating": "mgf2"}, "ghosts": "on", "barrel_reflectance": 0.01}
    accuracy = {"max_error_px": 0.4, "max_illumination_error": light}
    scene = scene_of("telephoto-250mm", accuracy=accuracy, film=film, objects=objects, **camera)
    chosen, traced = (render(each, spp=1) for each in (scene, change_scene(scene, camera={"accuracy": None})))
    assert chosen.metadata["camera"] == tier
    found, expected = (image.metadata["ghosts"] for image in (chosen, traced))
    assert found["sources"] == expected["sources"] > 0
    assert found["ways"] > 0
    assert found["barrel_share"] == expected["barrel_share"]


def test_command_prints_what_was_decided_and_why(tmp_path, capsys):
    scene = {
        "film": {"resolution": [48, 32]},
        "camera": {
            "kind": "realistic",
            "lens": "telephoto-250mm",
            "eye": [0, 0, 0],
            "target": [0, 0, -1],
            "focus": {"distance_m": 5},
            "f_number": 22,
            "accuracy": {"max_error_px": 0.3, "max_illumination_error": 0.01},
        },
        "objects": [BALL],
    }
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps(scene))
    assert main(["render", str(path), "-o", str(tmp_path / "out.npy"), "--spp", "1"]) == 0
    said = capsys.readouterr().err
    assert "accuracy: thick_lens: distortion" in said
    assert "(allowed are 0.3 px and 1 %)" in said
    assert "accuracy: not pinhole: light" in said
