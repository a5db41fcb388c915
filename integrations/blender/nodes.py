"""Shader nodes that make values: pictures, ramps, arithmetic; each to a constant or a picture.

Nodes are read into `Node` records, groups opened and reroutes left out, so that nothing here needs Blender.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from collections.abc import Mapping as MappingOf
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .fields import (
    MATH,
    Field,
    Mapping,
    combine,
    constant,
    grey,
    hue_saturation,
    mix_colours,
    ramp_table,
    rgb,
    texture_of,
)
from .report import Report


@dataclass(frozen=True, eq=False)
class Link:
    """An output of another node."""

    node: Node
    output: str


Input = float | tuple[float, ...] | Link | None


@dataclass(eq=False)
class Node:
    """A shader node: its kind as Blender names it (``BSDF_PRINCIPLED``), inputs by identifier, and other values.

    Values are properties of the node; of a picture also `codes` (top row first) and `color_space`, of a ramp or of
    curves `table`.
    """

    kind: str
    name: str
    inputs: dict[str, Input] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)


Paint = Callable[[str], Field | None]
"""The colours of vertices by the name of their attribute, as a picture of the mesh's own or their mean."""


class ValueReader:
    """The values of nodes of one material or world."""

    def __init__(self, name: str, report: Report, paint: Paint | None = None) -> None:
        self._name, self._report, self._paint = name, report, paint
        self._fields: dict[tuple[int, str], Field] = {}
        self._sources: dict[str, None] = {}

    def say(self, what: str) -> None:
        """Report what is not as in Blender."""
        self._report.add(f"{self._name}: {what}.")

    @property
    def takes_colors(self) -> bool:
        """Whether a value came from colours of vertices."""
        return any(source.startswith("color:") for source in self._sources)

    def coordinates(self) -> str:
        """The coordinates of all its textures; with several kinds the first counts for all.

        Those of colours of vertices count where nothing else has any.
        """
        sources = list(self._sources) or ["uv"]
        if len(sources) > 1 and self.takes_colors:
            self.say("colours of vertices beside a texture or other such colours: their mean is taken")
            sources = [source for source in sources if not source.startswith("color:")] or ["uv"]
        if len(sources) > 1:
            self.say(f"its textures go by {' and '.join(sources)}; all go by {sources[0]} here")
        return sources[0]

    def counts(self, node: Node, name: str) -> bool:
        """Whether an input is there and not 0."""
        if name not in node.inputs:
            return False
        value = self.field(node, name)
        return not value.is_constant or value.number > 0

    def is_white(self, node: Node, name: str) -> bool:
        """Whether a colour is white everywhere."""
        value = self.field(node, name, (1.0, 1.0, 1.0))
        return value.is_constant and float(np.abs(value.colour - 1).max()) == 0

    def colour(self, node: Node, name: str) -> Any:
        """A colour or a texture."""
        return self.cut(self.field(node, name))

    def cut(self, value: Field) -> Any:
        """A colour or a texture, cut to 0 … 1; what lies above 1, but for rounding, is said in the report."""
        most = float(rgb(value.values).max())
        if most > 1.001:
            self.say(f"colours of up to {most:.3g} are cut to 1: no surface reflects more light than it gets here")
        return texture_of(value, 3)

    def number(self, node: Node, name: str) -> Any:
        """A number or a texture, from 0 to 1."""
        return texture_of(self.field(node, name), 1)

    def constant(self, node: Node, name: str, what: str) -> float:
        """A number; of a texture its mean, said in the report."""
        value = self.field(node, name)
        if not value.is_constant:
            self.say(f"{what} is the same everywhere here, the mean of its texture")
        return value.number if len(value.colour) == 3 and value.values.shape[-1] >= 3 else float(value.colour[0])

    def field(self, node: Node, name: str, default: float | tuple[float, ...] = 0.0) -> Field:
        """The value of an input."""
        value = node.inputs.get(name, default)
        if value is None:
            value = default
        if not isinstance(value, Link):
            return constant(value if not isinstance(value, tuple) else value[:3])
        key = (id(value.node), value.output)
        if key not in self._fields:
            self._fields[key] = self._of_node(value.node, value.output)
        return self._fields[key]

    def _of_node(self, node: Node, output: str) -> Field:
        found = _VALUES.get(node.kind)
        result = None if found is None else found(self, node, output)
        if result is None:
            fallback = node.values.get("stand_in", 0.5)
            self.say(f"the node {node.name} is not translated; the value {fallback} stands in for it")
            return constant(fallback)
        if result.mapping.source.startswith("color:") and node.kind not in ("VERTEX_COLOR", "ATTRIBUTE"):
            self.say(f"{node.name} is calculated at the vertices, whose colours it is of")
        return result

    # Nodes of values

    def image(self, node: Node, output: str) -> Field | None:
        """Image Texture."""
        codes = node.values.get("codes")
        if codes is None:
            self.say(f"the picture of {node.name} is not there: magenta stands in")
            return constant((1.0, 0.0, 1.0))
        mapping = self.mapping(node)
        if node.values.get("projection", "FLAT") != "FLAT":
            self.say(f"the picture of {node.name} is laid flat by its coordinates, not as a box, ball or tube")
        wrap = {"REPEAT": "repeat", "EXTEND": "clamp", "MIRROR": "mirror", "CLIP": "clamp"}
        extension = node.values.get("extension", "REPEAT")
        if extension == "CLIP":
            self.say(f"the picture of {node.name} goes on at its edges, where Blender has nothing")
        space = node.values.get("color_space", "srgb")
        values = linear(codes, space)
        shown = codes[..., :3] if codes.ndim == 3 else codes
        picture = Field(
            values[..., 3:4] if output == "Alpha" and values.shape[-1] == 4 else values[..., :3],
            mapping,
            wrap.get(extension, "repeat"),
            "nearest" if node.values.get("interpolation") == "Closest" else "bilinear",
            None if output == "Alpha" else np.ascontiguousarray(shown),
            space,
        )
        if output == "Alpha" and values.shape[-1] < 4:
            return constant(1.0)
        return picture

    def mapping(self, node: Node) -> Mapping:
        """The way of coordinates to a texture."""
        link = node.inputs.get("Vector")
        at, mapping = link, Mapping()
        if isinstance(link, Link) and link.node.kind == "MAPPING":
            mapping, at = self._mapping_node(link.node), link.node.inputs.get("Vector")
        source = "uv" if node.kind == "TEX_IMAGE" else "generated"
        if isinstance(at, Link):
            name = {"UVMAP": "UV", "TEX_COORD": at.output}.get(at.node.kind, "")
            if name in ("UV", "Generated", "Object"):
                source = {"UV": "uv", "Generated": "generated", "Object": "object"}[name]
                if at.node.values.get("uv_map"):
                    source = f"uv:{at.node.values['uv_map']}"
            else:
                self.say(f"the coordinates of {node.name} come from {at.node.name}; texture coordinates are taken")
        self._sources.setdefault(source)
        return replace(mapping, source=source)

    def _mapping_node(self, node: Node) -> Mapping:
        vectors = {}
        for name, default in (("Location", 0.0), ("Rotation", 0.0), ("Scale", 1.0)):
            value = self.field(node, name, (default,) * 3)
            if not value.is_constant:
                self.say(f"{node.name}: a mapping that changes from place to place is left out")
                return Mapping()
            vectors[name] = [float(c) for c in value.colour]
        location, rotation, scale = vectors["Location"], vectors["Rotation"], vectors["Scale"]
        if rotation[0] or rotation[1]:
            self.say(f"{node.name}: of the turn only that about z counts")
        kind = node.values.get("vector_type", "POINT")
        if kind == "POINT":
            return Mapping((scale[0], scale[1]), rotation[2], (location[0], location[1]))
        if kind == "VECTOR":
            return Mapping((scale[0], scale[1]), rotation[2])
        if kind == "TEXTURE" and scale[0] and scale[1] and (not rotation[2] or scale[0] == scale[1]):
            cos, sin = math.cos(-rotation[2]), math.sin(-rotation[2])
            x, y = (-location[0], -location[1])
            offset = ((cos * x - sin * y) / scale[0], (sin * x + cos * y) / scale[1])
            return Mapping((1 / scale[0], 1 / scale[1]), -rotation[2], offset)
        self.say(f"{node.name}: a mapping of the kind {kind.title()} with this turn and scale is left out")
        return Mapping()

    def vertex_color(self, node: Node, output: str) -> Field | None:
        """Color Attribute, and Attribute of the geometry."""
        if node.values.get("attribute_type", "GEOMETRY") != "GEOMETRY":
            return None
        name = node.values.get("layer_name", node.values.get("attribute_name", ""))
        if output == "Alpha":
            self.say(f"{node.name}: the alpha of colours of vertices is 1 here")
            return constant(1.0)
        self._sources.setdefault(f"color:{name}")
        if self._paint is None:
            return constant((0.5, 0.5, 0.5))
        colors = self._paint(name)
        if colors is None:
            self.say(f"the mesh has no colours {name or 'of vertices'}: {node.name} is black")
            return constant((0.0, 0.0, 0.0))
        return combine(lambda c: rgb(c).mean(axis=-1, keepdims=True), colors) if output == "Fac" else colors

    def checker(self, node: Node, output: str) -> Field | None:
        """Checker Texture over flat coordinates."""
        mapping = self.mapping(node)
        if not mapping.source.startswith("uv"):
            return None
        scale = self.constant(node, "Scale", "the scale of its checker")
        ends = [self.field(node, "Color1"), self.field(node, "Color2")]
        if output != "Color" or not all(end.is_constant for end in ends):
            if output == "Color":
                self.say(f"the colours of {node.name} are the means of their textures")
            else:
                ends = [constant(1.0), constant(0.0)]
        rows, columns = np.indices((4, 4)) // 2  # the lower left cell has the second colour
        is_first = ((rows + columns) % 2 == 0)[..., None]
        values = np.where(is_first, rgb(ends[0].colour), rgb(ends[1].colour)).astype(np.float32)
        factor = scale / 2
        moved = Mapping(
            (mapping.scale[0] * factor, mapping.scale[1] * factor),
            mapping.rotation,
            (mapping.offset[0] * factor, mapping.offset[1] * factor),
            mapping.source,
        )
        return Field(values, moved, "repeat", "nearest")

    def ramp(self, node: Node, output: str) -> Field:
        """Color Ramp."""
        table = np.asarray(node.values["table"], np.float32)
        columns = slice(3, 4) if output == "Alpha" else slice(0, 3)
        return combine(lambda f: ramp_table(table[:, columns], f), self.field(node, "Fac"))

    def curves(self, node: Node, output: str) -> Field:
        """RGB Curves, given by their tables from 0 to 1."""
        table = np.asarray(node.values["table"], np.float32)

        def bend(factor: Any, colour: Any) -> Any:
            colour = rgb(colour)
            bent = np.concatenate([ramp_table(table[:, i : i + 1], colour[..., i : i + 1]) for i in range(3)], axis=-1)
            return colour * (1 - grey(factor)) + bent * grey(factor)

        return combine(bend, self.field(node, "Fac", 1.0), self.field(node, "Color"))

    def mix_values(self, node: Node, output: str) -> Field | None:
        """Mix and MixRGB."""
        if node.kind == "MIX_RGB":
            names, kind = ("Fac", "Color1", "Color2"), "RGBA"
        else:
            kind = node.values.get("data_type", "FLOAT")
            suffix = {"FLOAT": "Float", "VECTOR": "Vector", "RGBA": "Color"}.get(kind)
            if suffix is None:
                return None
            names = ("Factor_Float", f"A_{suffix}", f"B_{suffix}")
        blend = node.values.get("blend_type", "MIX") if kind == "RGBA" else "MIX"
        fields = [self.field(node, name) for name in names]
        clamped = np.clip if node.values.get("clamp_factor", True) else lambda f, *_: f
        fields[0] = combine(lambda f: clamped(f, 0, 1), fields[0])
        try:
            mixed = combine(lambda f, a, b: mix_colours(blend, f, a, b), *fields)
        except KeyError:
            self.say(f"{node.name}: the blend mode {blend.title()} is Mix here")
            mixed = combine(lambda f, a, b: mix_colours("MIX", f, a, b), *fields)
        if node.values.get("clamp_result") or node.values.get("use_clamp"):
            mixed = combine(lambda c: np.clip(c, 0, 1), mixed)
        return combine(grey, mixed) if kind == "FLOAT" else mixed

    def maths(self, node: Node, output: str) -> Field | None:
        """Math."""
        operation = MATH.get(node.values.get("operation", "ADD"))
        if operation is None:
            return None
        inputs = [self.field(node, name) for name in ("Value", "Value_001", "Value_002")]
        result = combine(lambda a, b, c: operation(grey(a), grey(b), grey(c)), *inputs)
        return combine(lambda v: np.clip(v, 0, 1), result) if node.values.get("use_clamp") else result

    def map_range(self, node: Node, output: str) -> Field | None:
        """Map Range, linear."""
        if node.values.get("data_type", "FLOAT") != "FLOAT" or node.values.get("interpolation_type") != "LINEAR":
            return None
        names = ("Value", "From Min", "From Max", "To Min", "To Max")
        value, *ends = (self.field(node, name) for name in names)
        clamp = node.values.get("clamp", True)

        def calculate(v: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
            share = (grey(v) - grey(a)) / np.where(grey(b) == grey(a), 1, grey(b) - grey(a))
            return grey(c) + (np.clip(share, 0, 1) if clamp else share) * (grey(d) - grey(c))

        return combine(calculate, value, *ends)

    def separate(self, node: Node, output: str) -> Field | None:
        """Separate Color and Separate RGB."""
        if node.values.get("mode", "RGB") != "RGB":
            return None
        channel = {"Red": 0, "R": 0, "X": 0, "Green": 1, "G": 1, "Y": 1}.get(output, 2)
        name = next(iter(node.inputs))
        return combine(lambda c: rgb(c)[..., channel : channel + 1], self.field(node, name))

    def join(self, node: Node, output: str) -> Field | None:
        """Combine Color, RGB and XYZ."""
        if node.values.get("mode", "RGB") != "RGB":
            return None
        fields = [self.field(node, name) for name in list(node.inputs)[:3]]

        def stacked(*channels: Any) -> Any:
            return np.concatenate(np.broadcast_arrays(*(grey(channel) for channel in channels)), axis=-1)

        return combine(stacked, *fields)

    def stand_in_of_angle(self, node: Node, output: str) -> Field:
        """Fresnel and Layer Weight: their mean over a lit ball."""
        if node.kind == "FRESNEL":
            index = max(self.constant(node, "IOR", "the index of a Fresnel node"), 1.0)
            value = min(((index - 1) / (index + 1)) ** 2 + 0.05, 1.0)
        else:
            value = 0.1 if output == "Fresnel" else 0.3
        self.say(f"{node.name}: the same from every side here, {value:.2f}")
        return constant(value)


def linear(codes: np.ndarray[Any, Any], color_space: str) -> Any:
    """Codes of a picture as linear values, its alpha as it is."""
    if codes.ndim == 2:
        codes = codes[..., None]
    values = codes.astype(np.float32)
    if codes.dtype == np.uint8:
        values /= 255
    elif codes.dtype == np.uint16:
        values /= 65535
    if color_space == "srgb":
        colour = values[..., :3]
        curved = np.where(colour <= 0.04045, colour / 12.92, ((np.maximum(colour, 0) + 0.055) / 1.055) ** 2.4)
        values = np.concatenate([curved.astype(np.float32), values[..., 3:]], axis=-1)
    return values


_VALUES: MappingOf[str, Callable[[ValueReader, Node, str], Field | None]] = {
    "TEX_IMAGE": ValueReader.image,
    "TEX_ENVIRONMENT": ValueReader.image,
    "TEX_CHECKER": ValueReader.checker,
    "VERTEX_COLOR": ValueReader.vertex_color,
    "ATTRIBUTE": ValueReader.vertex_color,
    "VALTORGB": ValueReader.ramp,
    "CURVE_RGB": ValueReader.curves,
    "MIX": ValueReader.mix_values,
    "MIX_RGB": ValueReader.mix_values,
    "MATH": ValueReader.maths,
    "MAP_RANGE": ValueReader.map_range,
    "SEPARATE_COLOR": ValueReader.separate,
    "SEPRGB": ValueReader.separate,
    "SEPARATE_XYZ": ValueReader.separate,
    "SEPXYZ": ValueReader.separate,
    "COMBINE_COLOR": ValueReader.join,
    "COMBRGB": ValueReader.join,
    "COMBXYZ": ValueReader.join,
    "FRESNEL": ValueReader.stand_in_of_angle,
    "LAYER_WEIGHT": ValueReader.stand_in_of_angle,
    "RGB": lambda self, node, output: self.field(node, "Color"),
    "VALUE": lambda self, node, output: self.field(node, "Value"),
    "RGBTOBW": lambda self, node, output: combine(grey, self.field(node, "Color")),
    "CLAMP": lambda self, node, output: combine(
        lambda v, a, b: np.clip(grey(v), grey(a), grey(b)),
        self.field(node, "Value"), self.field(node, "Min"), self.field(node, "Max", 1.0),
    ),
    "INVERT": lambda self, node, output: combine(
        lambda f, c: rgb(c) * (1 - grey(f)) + (1 - rgb(c)) * grey(f),
        self.field(node, "Fac", 1.0), self.field(node, "Color"),
    ),
    "GAMMA": lambda self, node, output: combine(
        lambda c, g: np.power(np.maximum(rgb(c), 0), grey(g)), self.field(node, "Color"), self.field(node, "Gamma", 1.0)
    ),
    "BRIGHTCONTRAST": lambda self, node, output: combine(
        lambda c, b, k: np.maximum(rgb(c) * (1 + grey(k)) + grey(b) - grey(k) / 2, 0),
        self.field(node, "Color"), self.field(node, "Bright"), self.field(node, "Contrast"),
    ),
    "HUE_SAT": lambda self, node, output: combine(
        lambda f, c: rgb(c) * (1 - grey(f)) + grey(f) * hue_saturation(
            c, self.constant(node, "Hue", "the hue") - 0.5,
            self.constant(node, "Saturation", "the saturation"), self.constant(node, "Value", "the value"),
        ),
        self.field(node, "Fac", 1.0), self.field(node, "Color"),
    ),
}  # fmt: skip
