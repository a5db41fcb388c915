"""Layers on the command line."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

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
