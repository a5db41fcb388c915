"""Scenes with spectra in them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

SCENE = """\
camera: {{kind: pinhole, eye: [0, 1, 5], target: [0, 1, 0], fov_degrees: 40}}
materials:
  tested: {material}
objects: [{{shape: sphere, center: [0, 0, 0], radius: 1, material: tested}}]
lights: [{{kind: point, position: [0, 3, 0], intensity: {light}}}]
"""


@pytest.fixture
def scene(tmp_path: Path) -> Callable[..., Scene]:
    """Load a scene with a material and the intensity of a light, from texts."""

    def load(material: str = "{kind: matte, reflectance: 0.5}", light: str = "1", **files: str) -> Scene:
        for name, text in files.items():
            (tmp_path / f"{name}.csv").write_text(text, "utf-8")
        path = tmp_path / "scene.yaml"
        path.write_text(SCENE.format(material=material, light=light), "utf-8")
        return load_scene(path)

    return load


@pytest.fixture
def light(scene: Callable[..., Scene]) -> Callable[..., Any]:
    """Return the intensity that a text describes."""
    return lambda text, **files: scene(light=text, **files).lights[0].intensity


@pytest.fixture
def matte(scene: Callable[..., Scene]) -> Callable[..., Any]:
    """Return the reflectance that a text describes."""

    def load(text: str, **files: str) -> Any:
        return scene(f"{{kind: matte, reflectance: {text}}}", **files).objects[0].material.reflectance

    return load
