"""Cameras and lamps of glTF files: the nodes of the scene that show one, at their places.

Sources: glTF 2.0, section 3.10; Khronos, KHR_lights_punctual. Both look along -z of their node.
"""

from __future__ import annotations

import math
from dataclasses import field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.file_material import Colour
from rptcam_cl.assets.meshes.gltf import LIGHTS, placed_nodes
from rptcam_cl.assets.meshes.gltf_data import read_container
from rptcam_cl.assets.meshes.gltf_json import JsonNode
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

KINDS = ("point", "spot", "directional")
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class GltfCamera:
    """A perspective camera.

    Attributes
    ----------
    name : str
    eye, forward, up : (x, y, z)
        Place and unit directions in the frame of the file.
    height_radians : float
        Full field of view from the lower to the upper edge.
    aspect : float or None
        Width over height; None where the file leaves it to the viewer.
    """

    name: str
    eye: Vector
    forward: Vector
    up: Vector
    height_radians: float
    aspect: float | None


@dataclass(frozen=True)
class GltfLight:
    """A lamp without size.

    Attributes
    ----------
    name, kind : str
        Kind is point, spot or directional.
    eye, forward : (x, y, z)
        Place, and unit direction in which it shines.
    amount : (red, green, blue)
        Its colour times candelas, for a directional one lux.
    cone_radians : (inner, outer)
        Angles from the axis of a spot.
    """

    name: str
    kind: str
    eye: Vector
    forward: Vector
    amount: Colour
    cone_radians: tuple[float, float] = (0.0, math.pi / 4)


@dataclass(frozen=True)
class GltfWorld:
    """Cameras and lamps, in the order of the nodes; notes say what is left out."""

    cameras: list[GltfCamera] = field(default_factory=list)
    lights: list[GltfLight] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_gltf_world(path: Path) -> GltfWorld:
    """Return the cameras and lamps that the default scene of a glTF file shows.

    Raises
    ------
    InputError
        When the file is not as glTF 2.0 says.
    """
    document, _ = read_container(path)
    world = GltfWorld()
    cameras = document.parts("cameras")
    lights = [light for part in document.extensions(LIGHTS) for light in part.parts("lights")]
    for node, placement in placed_nodes(document):
        if node.has("camera"):
            _add_camera(world, cameras[node.whole("camera", below=len(cameras))], node, placement)
        for shown in node.extensions(LIGHTS):
            _add_light(world, lights[shown.whole("light", below=len(lights))], node, placement)
    return world


def _add_camera(world: GltfWorld, camera: JsonNode, node: JsonNode, placement: NDArray[np.float64]) -> None:
    name = node.text("name") or camera.text("name") or f"camera {len(world.cameras) + 1}"
    if camera.text("type") != "perspective":
        world.notes.append(f"{node.place}: {name} is not a perspective camera and is left out")
        return
    lens = camera.part("perspective")
    height = lens.number("yfov", math.nan, 1e-6, math.pi - 1e-6)
    if math.isnan(height):
        raise lens.wrong("yfov", "is missing", "an angle in radians")
    aspect = lens.number("aspectRatio", math.nan, 1e-3, 1e3)
    eye, forward = _pose_of(placement, node)
    up = _unit(placement[:3, 1], node)
    world.cameras.append(GltfCamera(name, eye, forward, up, height, None if math.isnan(aspect) else aspect))


def _add_light(world: GltfWorld, light: JsonNode, node: JsonNode, placement: NDArray[np.float64]) -> None:
    kind = light.text("type")
    if kind not in KINDS:
        raise light.wrong("type", "is not known", ", ".join(KINDS))
    strength = light.number("intensity", 1.0, 0)
    red, green, blue = (max(0.0, strength * value) for value in light.numbers("color", (1.0, 1.0, 1.0)))
    if not max(red, green, blue) > 0:
        return
    cone = light.part("spot")
    outer = cone.number("outerConeAngle", math.pi / 4, 1e-4, math.pi / 2)
    inner = min(cone.number("innerConeAngle", 0.0, 0, math.pi / 2), outer * (1 - 1e-3))
    name = node.text("name") or light.text("name") or f"light {len(world.lights) + 1}"
    eye, forward = _pose_of(placement, node)
    world.lights.append(GltfLight(name, kind, eye, forward, (red, green, blue), (inner, outer)))


def _pose_of(placement: NDArray[np.float64], node: JsonNode) -> tuple[Vector, Vector]:
    x, y, z = placement[:3, 3].tolist()
    return (x, y, z), _unit(-placement[:3, 2], node)


def _unit(vector: NDArray[np.float64], node: JsonNode) -> Vector:
    length = float(np.linalg.norm(vector))
    if not (length > 0 and math.isfinite(length)):
        raise InputError(f"{node.place}: its transform leaves no direction (allowed: a scale that is not zero)")
    x, y, z = (vector / length).tolist()
    return x, y, z
