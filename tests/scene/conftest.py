"""A scene that uses every kind of camera part, material, shape, light and texture."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

EVERYTHING = """\
metres_per_unit: 1.0
film: {resolution: [640, 360], size_mm: [36, 20.25], crop: [0, 0.5, 0.25, 1]}
camera:
  kind: realistic
  eye: [0, -9.5, 3.2]
  target: [0, 0, 0.9]
  up: [0, 0, 1]
  lens: double_gauss_50mm
  f_number: 4
  focus: {distance_m: 8.8}
exposure: irradiance
render: {spp: 1e2, max_depth: 5, seed: 7, roulette_depth: 0}
picture: {ev: -1}
materials:
  red: {kind: matte, reflectance: [0.75, 0.25, 0.2]}
  floor: {kind: matte, reflectance: {kind: checker, even: 0.7, odd: 0.15, scale: [40, 40]}}
  lines: {kind: matte, reflectance: {kind: grid, background: 0.92, line: 0.08, line_width: 0.125, scale: [16, 16]}}
  steel: {kind: conductor, reflectance: [0.9, 0.75, 0.45], alpha: 0.2}
  glass: {kind: dielectric, index: 1.5}
  chrome: {kind: mirror, reflectance: [0.95, 0.93, 0.88]}
  lamp: {kind: emissive, radiance: [17, 12, 4]}
objects:
  - {shape: sphere, center: [0, 0, 1], radius: 1, material: red, name: ball}
  - {shape: disk, center: [0, 9.9, 0], normal: [0, -1, 0], radius: 8, material: lamp}
  - {shape: rectangle, corner: [-20, -20, 0], edge_u: [40, 0, 0], edge_v: [0, 40, 0], material: floor}
  - shape: box
    min: [-1, -1, -1]
    max: [1, 1, 1]
    material: steel
    transform: [{scale: [0.2, 0.01, 0.2]}, {rotate: {axis: [0, 1, 0], degrees: 30}}, {translate: [2, 0, -0.65]}]
  - {shape: cylinder, base: [0, 0, 1], top: [0, 0, 2], radius: 0.5, material: glass, transform: {translate: [3, 0, 0]}}
  - {shape: cone, base: [0, 0, 0], apex: [0, 0.15, 0], radius: 0.05, capped: false, material: chrome}
  - {shape: plane, point: [0, 0, 0], normal: [0, 0, 1], material: {kind: matte, reflectance: "#808080"}}
lights:
  - {kind: point, position: [0, 5, 5], intensity: [100, 100, 100]}
  - {kind: directional, direction: [0, -1, 0], irradiance: 1}
environment: {kind: gradient, bottom: 1, top: [1, 1, 2]}
"""

SMALL = """\
camera: {kind: pinhole, eye: [0, 1, 5], target: [0, 1, 0], fov_degrees: 40}
objects:
  - {shape: sphere, center: [0, 1, 0], radius: 1, material: {kind: matte, reflectance: 0.5}}
environment: {kind: constant, radiance: 1}
"""

Load = Callable[..., Scene]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Load a scene from YAML text, as a file called scene.yaml."""

    def load_text(text: str, *overrides: str) -> Scene:
        path = tmp_path / "scene.yaml"
        path.write_text(text, "utf-8")
        return load_scene(path, overrides)

    return load_text


@pytest.fixture
def everything(load: Load) -> Scene:
    """The scene that uses every kind of part."""
    return load(EVERYTHING)
