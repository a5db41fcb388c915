"""Scenes round mesh files that a test writes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

CAMERA = {"kind": "pinhole", "eye": [0, 0, 50], "target": [0, 0, 0], "fov_degrees": 40}
GREY = {"kind": "matte", "reflectance": 0.5}

MeshScene = Callable[..., Scene]


@pytest.fixture
def mesh_scene(tmp_path: Path) -> MeshScene:
    """Load a scene of mesh objects, each given by its keys besides the shape, in the test's folder."""

    def load(*objects: dict[str, Any], **parts: Any) -> Scene:
        items = [{"shape": "mesh", **item} for item in objects]
        return load_scene({"camera": CAMERA, "objects": items, **parts}, base_dir=tmp_path)

    return load
