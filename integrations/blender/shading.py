"""Blender's shader nodes and pictures, read into records for `materials.translate` and `world.environment`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import bpy
import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import PRIMARIES, SRGB_WHITE, Chromaticity, linear_from_srgb, srgb_from_primaries
from rptcam_cl.core.errors import RptcamError
from rptcam_cl.scene.assets.pictures import read_picture

from .nodes import Link, Node
from .report import Report

LINEAR_SPACES = ("Non-Color", "Linear", "Linear Rec.709", "Raw", "scene_linear")
ACES = PRIMARIES["acescg"]
OTHER_SPACES: dict[str, tuple[tuple[Chromaticity, ...], Chromaticity]] = {  # linear ones: their primaries and white
    "ACEScg": ACES,
    "ACES2065-1": (((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077)), ACES[1]),  # SMPTE ST 2065-1
    "Linear Rec.2020": PRIMARIES["rec2020"],
    "Linear DCI-P3 D65": (((0.68, 0.32), (0.265, 0.69), (0.15, 0.06)), SRGB_WHITE),  # SMPTE EG 432-1
}
OF_NODES = (
    "vector_type", "operation", "use_clamp", "data_type", "blend_type", "clamp_factor", "clamp_result", "space",
    "uv_map", "invert", "clamp", "interpolation_type", "mode", "distribution", "extension", "interpolation",
    "projection", "sky_type", "sun_direction", "turbidity", "sun_elevation", "sun_rotation", "sun_disc", "dust_density",
    "aerosol_density", "model", "parametrization", "layer_name", "attribute_name", "attribute_type",
    "fresnel_type",
)  # fmt: skip
BAKED_UV = "rptcam"  # the texture coordinates that they go by

Codes = NDArray[np.uint8] | NDArray[np.float32]


class PictureSource(Protocol):
    """What holds pictures between two readings."""

    def picture(
        self, image: Any, report: Report, user: Any = None, *, keeps_alpha: bool = True
    ) -> tuple[NDArray[Any] | None, str]:
        """The codes of a picture at the frame of its user, top row first, and its colour space."""
        ...


# Pictures


def codes_of(image: Any, file: str = "", *, keeps_alpha: bool = True) -> Codes | None:
    """The codes of a picture, or of the file of one of its frames, top row first; None where it is not there.

    Those of another linear space than Rec. 709 become linear floats.
    """
    codes = _of_file(Path(file), image) if file else _of_image(image)
    if codes is None:
        return None
    codes = _with_alpha(codes, image, keeps_alpha)
    other = OTHER_SPACES.get(image.colorspace_settings.name)
    if other is None or codes.dtype != np.uint8 or codes.shape[-1] < 3:
        return codes
    values = codes.astype(np.float32) / 255
    values[..., :3] = np.maximum(values[..., :3] @ srgb_from_primaries(*other).T, 0)
    return values


def space_of(image: Any, codes: Codes | None) -> str:
    """``linear``, ``srgb``, or the name of a space that is neither, for codes of `codes_of`."""
    name = str(image.colorspace_settings.name)
    if name in LINEAR_SPACES or (codes is not None and codes.dtype != np.uint8):  # Blender makes floats linear
        return "linear"
    return "srgb" if name == "sRGB" else name


def _of_image(image: Any) -> Codes | None:
    width, height = image.size
    if not width or not height:
        return None
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    rows = values.reshape(height, width, image.channels)[::-1]
    if image.is_float:
        return np.ascontiguousarray(rows)
    return np.ascontiguousarray(np.clip(rows * 255 + 0.5, 0, 255).astype(np.uint8))


def _of_file(file: Path, image: Any) -> Codes | None:
    try:
        read = read_picture(file)
    except (RptcamError, OSError):
        return None
    texels = read.texels if read.has_alpha else np.ascontiguousarray(read.texels[..., :3])
    if read.encoded and texels.dtype != np.uint8 and image.colorspace_settings.name == "sRGB":  # codes of 16 bits
        texels[..., :3] = linear_from_srgb(texels[..., :3])
    return texels


def _with_alpha(codes: Codes, image: Any, keeps_alpha: bool) -> Codes:
    """Colours as Cycles has them: without their alpha where a node takes it, else times alpha.

    Bytes of Blender are without it and floats times it.
    """
    if codes.shape[-1] != 4 or image.alpha_mode == "CHANNEL_PACKED" or image.colorspace_settings.is_data:
        return codes
    if image.alpha_mode == "NONE":
        return np.ascontiguousarray(codes[..., :3])
    alpha = codes[..., 3:].astype(np.float32) / (255 if codes.dtype == np.uint8 else 1)
    if codes.dtype == np.uint8 and not keeps_alpha and (alpha < 1).any():
        return np.concatenate([(codes[..., :3] * alpha + 0.5).astype(np.uint8), codes[..., 3:]], axis=-1)
    if codes.dtype != np.uint8 and keeps_alpha and (alpha < 1).any():
        return np.concatenate([codes[..., :3] / np.where(alpha > 0, alpha, 1), codes[..., 3:]], axis=-1)
    return codes


# Nodes


def has_nodes(owner: Any) -> bool:
    """Whether the nodes of a material, world or lamp count; from Blender 6.0 on they always do."""
    return owner.node_tree is not None and bool(getattr(owner, "use_nodes", True))


def output_of(tree: Any) -> Any:
    """The active output of a material, world or lamp, as Cycles picks it."""
    found = None
    for node in tree.nodes:
        is_output = node.bl_idname in ("ShaderNodeOutputMaterial", "ShaderNodeOutputWorld", "ShaderNodeOutputLight")
        if is_output and node.target in ("ALL", "CYCLES"):
            if node.is_active_output:
                return node
            found = found or node
    return found


def baked_node(codes: Any, *, is_normal: bool) -> Link:
    """What stands in the place of a baked input's nodes."""
    at = Link(Node("UVMAP", "baked", values={"uv_map": BAKED_UV}), "UV")
    values = {"codes": codes, "color_space": "linear", "extension": "EXTEND", "uv_size": 1.0}
    picture = Link(Node("TEX_IMAGE", "baked", {"Vector": at}, values), "Color")
    if not is_normal:
        return picture
    return Link(Node("NORMAL_MAP", "baked", {"Color": picture, "Strength": 1.0}, {"space": "TANGENT"}), "Normal")


class NodeReader:
    """Reads nodes into records; a group is opened wherever it is used."""

    def __init__(
        self, reader: PictureSource, size: float, report: Report, baked: dict[tuple[str, str], str] | None = None
    ) -> None:
        self._baked = baked or {}
        self._reader, self._uv_size, self._report = reader, size, report
        self._made: dict[tuple[Any, ...], Node] = {}

    def linked(self, node: Any, name: str) -> Node | None:
        """The node behind an input."""
        value = self._input(node.inputs[name], ())
        return value.node if isinstance(value, Link) else None

    def _input(self, socket: Any, stack: tuple[Any, ...]) -> Any:
        """What an input gets: a link, or its own value."""
        if socket.is_linked and socket.links and not socket.links[0].is_muted:
            link = socket.links[0]
            return self._output(link.from_node, link.from_socket, stack, socket)
        return _value_of(socket)

    def _output(self, node: Any, socket: Any, stack: tuple[Any, ...], into: Any) -> Any:
        """What an output gives, looked up through reroutes, groups and muted nodes."""
        if node.type == "REROUTE":
            return self._input(node.inputs[0], stack)
        if node.mute:
            behind = [link.from_socket for link in node.internal_links if link.to_socket == socket]
            return self._input(behind[0], stack) if behind else _value_of(into)
        if node.type == "GROUP" and node.node_tree is not None:
            ends = [each for each in node.node_tree.nodes if each.type == "GROUP_OUTPUT" and each.is_active_output]
            inner = [each for end in ends for each in end.inputs if each.identifier == socket.identifier]
            return self._input(inner[0], (*stack, node)) if inner else _value_of(into)
        if node.type == "GROUP_INPUT" and stack:
            outer = [each for each in stack[-1].inputs if each.identifier == socket.identifier]
            return self._input(outer[0], stack[:-1]) if outer else _value_of(into)
        return Link(self._node(node, stack), socket.name if node.type == "TEX_COORD" else socket.identifier)

    def _node(self, node: Any, stack: tuple[Any, ...]) -> Node:
        key = (node.as_pointer(), *(group.as_pointer() for group in stack))
        if key in self._made:
            return self._made[key]
        made = self._made[key] = Node(node.type, node.name)
        for socket in node.inputs:
            image = None if stack else bpy.data.images.get(self._baked.get((node.name, socket.identifier), ""))
            if image is not None:
                codes, _ = self._reader.picture(image, self._report)
                made.inputs[socket.identifier] = baked_node(codes, is_normal=socket.identifier == "Normal")
                continue
            made.inputs[socket.identifier] = self._input(socket, stack)
        if node.type in ("RGB", "VALUE"):
            made.inputs["Color" if node.type == "RGB" else "Value"] = _value_of(node.outputs[0])
        made.values = {name: _plain(getattr(node, name)) for name in OF_NODES if hasattr(node, name)}
        made.values["uv_size"] = self._uv_size
        if node.type == "VALTORGB":
            made.values["table"] = [tuple(node.color_ramp.evaluate(i / 255)) for i in range(256)]
        elif node.type == "CURVE_RGB":
            made.values["table"] = _curves(node.mapping)
        elif node.type in ("TEX_IMAGE", "TEX_ENVIRONMENT") and node.image is not None:
            alpha = node.outputs.get("Alpha")
            made.values["codes"], made.values["color_space"] = self._reader.picture(
                node.image, self._report, node.image_user, keeps_alpha=alpha is not None and alpha.is_linked
            )
        return made


def _plain(value: Any) -> Any:
    return value if isinstance(value, (str, int, float, bool)) else tuple(value)


def _value_of(socket: Any) -> Any:
    value = getattr(socket, "default_value", None)
    if value is None or isinstance(value, (str, bpy.types.ID)):
        return None
    return float(value) if isinstance(value, (int, float, bool)) else tuple(float(each) for each in value)


def _curves(mapping: Any) -> list[tuple[float, ...]]:
    """Red, green and blue of the curves with the common one, 256 rows."""
    mapping.initialize()
    common, channels = mapping.curves[3], mapping.curves[:3]
    rows = []
    for i in range(256):
        at = mapping.evaluate(common, i / 255)
        rows.append(tuple(mapping.evaluate(curve, at) for curve in channels))
    return rows
