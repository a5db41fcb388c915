"""The frames before and after a picture, as `render` takes them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.api.job import render
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.load import load_scene

SCENE: dict[str, Any] = {
    "film": {"resolution": [24, 16]},
    "camera": {"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 40},
    "materials": {"grey": {"kind": "matte", "reflectance": 0.5}},
    "objects": [{"shape": "sphere", "center": [0, 0, -4], "radius": 0.8, "material": "grey"}],
    "environment": {"kind": "constant", "radiance": 1},
}
FLOW = ["flow_backward", "flow_forward"]


def ahead(distance: float) -> dict[str, Any]:
    return SCENE | {"objects": [{"shape": "sphere", "center": [0, 0, -distance], "radius": 0.8, "material": "grey"}]}


def test_neighbours_are_whatever_a_scene_may_be(tmp_path: Path) -> None:
    before = tmp_path / "before.json"
    before.write_text(json.dumps(ahead(5.0)))
    found = render(SCENE, spp=1, layers=FLOW, neighbours=(str(before), ahead(3.0)))
    expected = render(SCENE, spp=1, layers=FLOW, neighbours=(load_scene(ahead(5.0)), load_scene(ahead(3.0))))
    for name in FLOW:
        np.testing.assert_array_equal(found[name], expected[name])
    assert np.abs(found["flow_forward"]).max() > 1
    alone = render(SCENE, spp=1, layers=FLOW, neighbours=(None, before))
    assert np.isnan(alone["flow_backward"]).all()
    assert np.isfinite(alone["flow_forward"]).all()


@pytest.mark.parametrize(
    ("neighbours", "message"),
    [
        ((None,), "got 1 of them"),
        ((None, None, None), "got 3 of them"),
        ("scene.yaml", "got str"),
        ((None, "none.yaml"), "none.yaml"),
    ],
)
def test_wrong_neighbours_are_refused(neighbours: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        render(SCENE, spp=1, layers=FLOW, neighbours=neighbours)
