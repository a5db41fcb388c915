"""Blender's world as the environment of a scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .fields import Field
from .nodes import Link, Node, ValueReader
from .report import Report

UP = [0.0, 0.0, 1.0]


def environment(surface: Node | None, color: tuple[float, ...], report: Report) -> dict[str, Any] | None:
    """The environment of a world's nodes, or of its colour without them; None for a dark one."""
    if surface is None:
        return _even(np.array(color[:3]), 1.0)
    node = _background(surface, report)
    if node is None:
        return None
    reader = ValueReader("World", report)
    strength = reader.field(node, "Strength", 1.0)
    if not strength.is_constant:
        report.add("World: a strength that depends on the direction is its mean here.")
    power = strength.number
    if power <= 0:
        return None
    link = node.inputs.get("Color")
    if isinstance(link, Link) and link.node.kind == "TEX_SKY":
        return sky(link.node.values, power, report)
    if isinstance(link, Link) and (picture := _picture_behind(link.node)) is not None:
        return _image(link, picture, reader, power, report)
    return _even(reader.field(node, "Color").colour, power)


def _background(node: Node, report: Report) -> Node | None:
    """The background that lights the scene; behind a mix by the kind of ray, the one that is not for the camera."""
    if node.kind in ("BACKGROUND", "EMISSION"):
        return node
    if node.kind in ("MIX_SHADER", "ADD_SHADER"):
        ends = [link.node for name in ("Shader", "Shader_001") if isinstance(link := node.inputs.get(name), Link)]
        report.add("World: of mixed backgrounds the first counts, for the camera as for the light.")
        return _background(ends[0], report) if ends else None
    report.add(f"World: {node.name} is left out.")
    return None


def _even(colour: Any, strength: float) -> dict[str, Any] | None:
    radiance = [max(float(channel) * strength, 0.0) for channel in colour]
    return {"kind": "constant", "radiance": radiance} if any(radiance) else None


def _picture_behind(node: Node) -> Node | None:
    """The Environment Texture that a value comes from."""
    if node.kind == "TEX_ENVIRONMENT":
        return node
    for value in node.inputs.values():
        if isinstance(value, Link) and (found := _picture_behind(value.node)) is not None:
            return found
    return None


def _image(link: Link, picture: Node, reader: ValueReader, strength: float, report: Report) -> dict[str, Any] | None:
    """A picture round the scene, turned by the Mapping node's angle about z.

    The middle of Blender's pictures lies at +x and ours at +y, where +z is up.
    """
    codes = picture.values.get("codes")
    if codes is None:
        report.add(f"World: the picture of {picture.name} is not there; magenta stands in.")
        return _even(np.array([1.0, 0.0, 1.0]), strength)
    if picture.values.get("projection", "EQUIRECTANGULAR") != "EQUIRECTANGULAR":
        report.add("World: a mirror ball is read as a picture in longitude and latitude.")
    rotation = 0.0
    at = picture.inputs.get("Vector")
    if isinstance(at, Link) and at.node.kind == "MAPPING":
        turn = reader.field(at.node, "Rotation", (0.0, 0.0, 0.0)).colour
        rotation = float(turn[2])
        if turn[0] or turn[1]:
            report.add("World: of the turn of its picture only that about the vertical counts.")
    file, space = codes, picture.values.get("color_space", "srgb")
    if link.node is not picture:  # nodes between
        made: Field = reader.field(Node("", "", {"Color": link}), "Color")
        file, space = np.ascontiguousarray(np.maximum(made.values, 0), np.float32), "linear"
    elif codes.ndim == 3:
        file = np.ascontiguousarray(codes[..., :3])
    return {
        "kind": "image",
        "file": file,
        "gain": strength,
        "color_space": space,
        "up": UP,
        "rotation_degrees": (-90 - math.degrees(rotation) + 180) % 360 - 180,
    }


def sky(values: dict[str, Any], strength: float, report: Report) -> dict[str, Any]:
    """A clear sky in place of a Sky Texture: sun and haze as there, by another model."""
    kind = values["sky_type"]
    if kind in ("PREETHAM", "HOSEK_WILKIE"):
        x, y, z = values["sun_direction"]
        elevation, azimuth = math.asin(max(min(z, 1.0), -1.0)), math.atan2(-x, y)
        turbidity, with_sun = values["turbidity"], False
    else:
        elevation, azimuth = values["sun_elevation"], -values["sun_rotation"]
        turbidity, with_sun = 2 + values.get("dust_density", 1.0), bool(values["sun_disc"])
    report.add(
        f"World: the sky texture ({kind.replace('_', ' ').title()}) is our clear sky after Preetham with the same sun; "
        "its colours and its brightness differ."
    )
    return {
        "kind": "sky",
        "sun_elevation_degrees": min(max(math.degrees(elevation), 0.0), 90.0),
        "sun_azimuth_degrees": (math.degrees(azimuth) + 180) % 360 - 180,
        "turbidity": min(max(turbidity, 2.0), 10.0),
        "sun": with_sun,
        "gain": strength,
        "up": UP,
    }
