"""The stages of a render, each called alone, and the settings that they share."""

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.job import RenderJob, RenderOptions
from rptcam_cl.core.errors import InputError

SCENE: dict[str, Any] = {
    "film": {"resolution": [8, 6]},
    "camera": {"kind": "pinhole", "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40},
    "objects": [
        {"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": {"kind": "matte", "reflectance": 0.5}}
    ],
    "environment": {"kind": "constant", "radiance": 1},
    "exposure": {"mode": "auto"},
}


def test_stages_one_by_one_make_the_picture_of_render() -> None:
    stages: list[str] = []
    settings = RenderOptions(spp=3, seed=5, layers=["depth"], on_progress=lambda state: stages.append(state.stage))
    job = RenderJob.prepare(SCENE, settings)
    assert stages == ["compile"]
    assert job.resolved.scene.exposure.mode != "auto"
    assert job.resolved.metadata["metered_cd_m2"] > 0
    rendering = job.run()
    assert rendering.spp == 3
    image = job.report(rendering)
    whole = rptcam_cl.render(SCENE, spp=3, seed=5, layers=["depth"])
    assert np.array_equal(image.pixels, whole.pixels)
    assert np.array_equal(image["depth"], whole["depth"])
    assert image.metadata == whole.metadata
    assert image.stats.keys() == whole.stats.keys()
    assert image.stats["seconds"].keys() == {"start", "compile", "render", "total"}


def test_settings_do_not_change() -> None:
    with pytest.raises(FrozenInstanceError):
        RenderOptions().spp = 4  # type: ignore[misc]


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("inf"), float("nan")])
def test_time_that_is_none_is_refused(seconds: float) -> None:
    with pytest.raises(InputError, match=r"seconds: is out of range .*allowed: a finite number above 0"):
        RenderOptions(seconds=seconds)


@pytest.mark.parametrize(
    ("given", "most"),
    [({}, 7), ({"seconds": 1.0}, None), ({"noise": 0.1}, 16384), ({"noise": 0.1, "seconds": 1.0}, 16384),
     ({"spp": 5, "seconds": 1.0}, 5), ({"spp": 5, "noise": 0.1}, 5)],
)  # fmt: skip
def test_samples_are_limited_by_what_is_given(given: dict[str, Any], most: int | None) -> None:
    scene = rptcam_cl.load_scene(SCENE | {"render": {"spp": 7}})
    assert RenderOptions(**given).most_spp(scene) == most
