"""Cameras and lamps of glTF files, against what the format and KHR_lights_punctual say."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.gltf import read_gltf_world

from .gltf_writer import triangle

# A node that is turned by 90 degrees about +y looks along -x; by columns, and twice as large.
NODE = {"matrix": [0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 3, 4, 5, 1]}
LENS = {"yfov": 0.5, "znear": 0.1}


def world(tmp_path: Path, camera: Any = None, lamp: Any = None, **node: Any) -> Any:
    """Return what is read of a file with one camera and one lamp in one node."""
    writer = triangle()
    writer.json["cameras"] = [camera or {"type": "perspective", "perspective": LENS}]
    writer.json["extensions"] = {"KHR_lights_punctual": {"lights": [lamp or {"type": "point"}]}}
    shown = {"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}
    writer.json["nodes"].append(NODE | shown | node)
    writer.json["scenes"] = [{"nodes": [0, 1]}]
    (tmp_path / "a.glb").write_bytes(writer.glb())
    return read_gltf_world(tmp_path / "a.glb")


@pytest.mark.parametrize(
    ("lens", "aspect"), [(LENS, None), (LENS | {"aspectRatio": 1.5}, 1.5), (LENS | {"aspectRatio": 1e-3}, 1e-3)]
)
def test_camera_looks_along_minus_z_of_its_node(tmp_path: Path, lens: dict[str, float], aspect: float | None) -> None:
    (camera,), _, notes = world(tmp_path, {"type": "perspective", "perspective": lens})
    assert (camera.eye, camera.forward, camera.up) == ((3, 4, 5), (-1, 0, 0), (0, 1, 0))
    assert (camera.height_radians, camera.aspect, camera.name, notes) == (0.5, aspect, "camera 1", [])


@pytest.mark.parametrize(("of_node", "of_camera", "name"), [("a", "b", "a"), ("", "b", "b"), ("", "", "camera 1")])
def test_camera_is_called_as_its_node(tmp_path: Path, of_node: str, of_camera: str, name: str) -> None:
    camera = {"type": "perspective", "perspective": LENS, "name": of_camera}
    assert world(tmp_path, camera, name=of_node)[0][0].name == name


def test_parallel_camera_is_left_out_with_a_note(tmp_path: Path) -> None:
    cameras, _, (note,) = world(tmp_path, {"type": "orthographic", "name": "plan"})
    assert cameras == []
    assert note.endswith("nodes[1]: plan is not a perspective camera and is left out")


AMOUNT = [2 / 683, 1 / 683, 0]  # 2 cd, or lx, of a light whose spectrum has 683 lm/W
LAMPS: dict[str, dict[str, Any]] = {
    "directional": {"direction": (-1, 0, 0), "irradiance": AMOUNT},
    "point": {"position": (3, 4, 5), "intensity": AMOUNT},
    "spot": {
        "position": (3, 4, 5), "intensity": AMOUNT, "direction": (-1, 0, 0),
        "inner_degrees": 0.0, "outer_degrees": 45.0,
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", LAMPS)
def test_lamps_have_the_defaults_of_the_extension(tmp_path: Path, kind: str) -> None:
    (light,) = world(tmp_path, lamp={"type": kind, "intensity": 2, "color": [1, 0.5, -1]})[1]
    assert light == {"kind": kind} | LAMPS[kind]
    (light,) = world(tmp_path, lamp={"type": kind})[1]
    assert next(light[key] for key in ("irradiance", "intensity") if key in light) == [1 / 683] * 3


@pytest.mark.parametrize(
    ("cone", "inner", "outer"),
    [
        ({"innerConeAngle": 0.2, "outerConeAngle": 0.5}, 0.2, 0.5),
        ({"innerConeAngle": 0.5, "outerConeAngle": 0.5}, 0.4995, 0.5),
    ],
)
def test_cone_of_a_spot_has_an_edge(tmp_path: Path, cone: dict[str, float], inner: float, outer: float) -> None:
    (light,) = world(tmp_path, lamp={"type": "spot", "spot": cone})[1]
    np.testing.assert_allclose(np.radians([light["inner_degrees"], light["outer_degrees"]]), [inner, outer])


@pytest.mark.parametrize("dark", [{"intensity": 0}, {"color": [0, 0, 0]}, {"color": [-1, 0, 0]}])
def test_dark_lamps_are_none(tmp_path: Path, dark: dict[str, Any]) -> None:
    assert world(tmp_path, lamp={"type": "point"} | dark)[1] == []


WRONG: list[tuple[dict[str, Any], str]] = [
    (
        {"camera": {"type": "perspective", "perspective": {}}},
        "perspective.yfov: is missing (got None; allowed: an angle",
    ),
    ({"camera": {"type": "perspective", "perspective": {"yfov": 3.15}}}, "yfov: must be a number in its range"),
    ({"camera": {"type": "perspective", "perspective": {"yfov": 0}}}, "yfov: must be a number in its range"),
    ({"lamp": {"type": "area"}}, "lights[0].type: is not known (got 'area'; allowed: point, spot, directional)"),
    ({"lamp": {"type": "point", "intensity": -1}}, "intensity: must be a number in its range"),
    ({"lamp": {"type": "spot", "spot": {"outerConeAngle": 1.58}}}, "outerConeAngle: must be a number in its range"),
    ({"extensions": {"KHR_lights_punctual": {"light": 1}}}, "light: must be a whole number in its range (got 1"),
    ({"matrix": [*NODE["matrix"][:8], 0, 0, 0, 0, 3, 4, 5, 1]}, "nodes[1]: its transform leaves no direction"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG)
def test_wrong_cameras_and_lamps_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        world(tmp_path, **changes)
