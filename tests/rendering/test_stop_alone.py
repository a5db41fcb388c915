"""A camera whose lens is a stop without glass: a pinhole camera with a real opening."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from tests.rendering.pictures import WHITE, scene_of

HOLE = {"name": "a hole", "surfaces": [{"stop": True, "diameter": 0.3}]}
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}


@pytest.mark.parametrize("pupil", ["auto", "rear", "bounds"])
def test_a_white_world_falls_off_by_the_fourth_power_of_the_cosine(pupil):
    camera = {"kind": "realistic", "lens": HOLE, "focus": {"film_distance_mm": 30}, "pupil": pupil, **POSE}
    scene = scene_of([], camera, environment=WHITE, depth=1, resolution=[24, 24], film={"size_mm": [36, 36]})
    image = rptcam_cl.render(scene, spp=256, seed=3)
    x = (np.arange(24) + 0.5) * 1.5 - 18
    expected = (30**2 / (30**2 + x[:, None] ** 2 + x**2)) ** 2
    assert np.asarray(image)[..., 0] == pytest.approx(expected, rel=0.3)
    assert (np.asarray(image)[..., 0] / expected).mean() == pytest.approx(1.0, abs=0.005)
    assert image.metadata.get("focal_length_mm") is None and image.metadata.get("f_number") is None


@pytest.mark.parametrize("option", [{"focus": {"distance_m": 1}}, {"focus": {"film_distance_mm": 30}, "f_number": 200}])
def test_focus_and_f_number_need_power(option):
    camera = {"kind": "realistic", "lens": HOLE, **POSE, **option}
    with pytest.raises(InputError, match=r"a hole: has no (power, so it focuses nothing|focal length, so no f-number)"):
        rptcam_cl.render(scene_of([], camera, environment=WHITE, depth=1), spp=1)
