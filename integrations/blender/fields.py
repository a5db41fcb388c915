"""Values of a material's nodes: constants, pictures over texture coordinates, and what nodes make of them.

A `Field` is a constant, or a picture of linear values with the way that texture coordinates take to it. Nodes that work
point by point are calculated for every texel, so that a picture behind a colour ramp is still one picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float32]

UNIT_SIDE = 1024  # texels of a picture that holds what several others with other coordinates make together


@dataclass(frozen=True)
class Mapping:
    """How coordinates become those of a picture: scaled, turned [radians], shifted; and which coordinates they are."""

    scale: tuple[float, float] = (1.0, 1.0)
    rotation: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    source: str = "uv"

    def keys(self) -> dict[str, Any]:
        """Keys of a texture."""
        keys: dict[str, Any] = {}
        if self.scale != (1.0, 1.0):
            keys["scale"] = list(self.scale)
        if self.rotation:
            keys["rotation_degrees"] = (math.degrees(self.rotation) + 180) % 360 - 180
        if self.offset != (0.0, 0.0):
            keys["offset"] = list(self.offset)
        return keys

    def at(self, u: Values, v: Values) -> tuple[Values, Values]:
        """Coordinates in the picture of points (u, v)."""
        x, y = u * np.float32(self.scale[0]), v * np.float32(self.scale[1])
        cos, sin = np.float32(math.cos(self.rotation)), np.float32(math.sin(self.rotation))
        return cos * x - sin * y + np.float32(self.offset[0]), sin * x + cos * y + np.float32(self.offset[1])


@dataclass(frozen=True, eq=False)
class Field:
    """A value of nodes.

    Attributes
    ----------
    values : float32 array
        (channels,) of a constant, or (height, width, channels) with the top row first; 4 channels with alpha.
    mapping : Mapping
    wrap, filter
        As textures have them.
    codes : array or None
        The picture as it is stored, where no node has changed it: that is handed on, and not the values.
    color_space : str
        Of the codes.
    """

    values: Values
    mapping: Mapping = field(default_factory=Mapping)
    wrap: str = "repeat"
    filter: str = "bilinear"
    codes: NDArray[Any] | None = None
    color_space: str = "auto"

    @property
    def is_constant(self) -> bool:
        """Whether it is the same everywhere."""
        return self.values.ndim == 1

    @property
    def colour(self) -> Values:
        """Red, green and blue, of a picture their mean."""
        values = self.values if self.is_constant else self.values.reshape(-1, self.values.shape[-1]).mean(axis=0)
        return np.broadcast_to(values, 3) if len(values) == 1 else values[:3]

    @property
    def number(self) -> float:
        """The colour as a number, as Blender converts it."""
        return float(self.colour @ np.array([0.2126, 0.7152, 0.0722], np.float32))


def constant(value: float | Sequence[float]) -> Field:
    """A field that is the same everywhere."""
    return Field(np.atleast_1d(np.array(value, np.float32)))


def rgb(values: Values) -> Values:
    """Three channels of values of one, three or four."""
    return np.repeat(values, 3, axis=-1) if values.shape[-1] == 1 else values[..., :3]


def grey(values: Values) -> Values:
    """One channel, by the luminance."""
    if values.shape[-1] == 1:
        return values
    return (values[..., :3] @ np.array([0.2126, 0.7152, 0.0722], np.float32))[..., None]


def combine(calculate: Callable[..., Values], *fields: Field) -> Field:
    """What a node makes of its inputs, texel by texel."""
    pictures = [each for each in fields if not each.is_constant]
    if not pictures:
        return Field(np.asarray(calculate(*(each.values for each in fields)), np.float32))
    same = {(each.mapping, each.wrap) for each in pictures}
    if len(same) == 1:
        largest = max(pictures, key=lambda each: each.values.size)
        size = largest.values.shape[:2]
        arrays = [each.values if each.is_constant else _resized(each.values, size) for each in fields]
        base = replace(largest, codes=None)
    else:
        arrays = [each.values if each.is_constant else _over_unit_square(each) for each in fields]
        base = Field(pictures[0].values, Mapping(source=pictures[0].mapping.source))
    result = np.asarray(calculate(*arrays), np.float32)
    return replace(base, values=result) if result.ndim == 3 else Field(result)


def _resized(values: Values, size: tuple[int, int]) -> Values:
    if values.shape[:2] == size:
        return values
    rows = (np.arange(size[0]) + 0.5) / size[0]
    columns = (np.arange(size[1]) + 0.5) / size[1]
    return _looked_up(values, *np.meshgrid(columns, 1 - rows), "clamp")


def _over_unit_square(picture: Field) -> Values:
    middle = ((np.arange(UNIT_SIDE) + 0.5) / UNIT_SIDE).astype(np.float32)
    u, v = np.meshgrid(middle, middle[::-1])
    return _looked_up(picture.values, *picture.mapping.at(u, v), picture.wrap)


def _looked_up(values: Values, u: NDArray[Any], v: NDArray[Any], wrap: str) -> Values:
    """Bilinear look-up; v counts from the bottom row."""
    height, width = values.shape[:2]
    x, y = u * width - 0.5, (1 - v) * height - 0.5
    x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - x0)[..., None].astype(np.float32), (y - y0)[..., None].astype(np.float32)

    def texel(rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Values:
        return values[_wrapped(rows, height, wrap), _wrapped(columns, width, wrap)]

    top = texel(y0, x0) * (1 - fx) + texel(y0, x0 + 1) * fx
    bottom = texel(y0 + 1, x0) * (1 - fx) + texel(y0 + 1, x0 + 1) * fx
    result: Values = top * (1 - fy) + bottom * fy
    return result


def _wrapped(index: NDArray[np.int64], count: int, wrap: str) -> NDArray[np.int64]:
    if wrap == "clamp":
        return np.clip(index, 0, count - 1)
    if wrap == "mirror":
        index = np.mod(index, 2 * count)
        return np.where(index < count, index, 2 * count - 1 - index)
    return np.mod(index, count)


def texture_of(value: Field, channels: int, most: float = 1.0) -> Any:
    """A number, a colour, or the keys of an image texture with so many channels, cut to 0 … `most`."""
    if value.is_constant:
        cut = np.clip(value.values, 0, most)
        return float(grey(cut)[0]) if channels == 1 else [float(channel) for channel in rgb(cut)]
    keys: dict[str, Any] = {"kind": "image", "filter": value.filter, "wrap": value.wrap, **value.mapping.keys()}
    if value.codes is not None and (channels == 3 or value.codes.ndim == 2):
        return keys | {"file": value.codes, "color_space": value.color_space}
    values = grey(value.values) if channels == 1 else value.values
    picture = np.clip(rgb(values), 0, most).astype(np.float32)
    keys = keys | {"file": np.ascontiguousarray(picture), "color_space": "linear"}
    return keys | {"channel": "r"} if channels == 1 else keys


def ramp_table(table: Values, factor: Values) -> Values:
    """A colour ramp or curve, given by rows evenly from 0 to 1, at factors."""
    at = np.clip(grey(factor)[..., 0], 0, 1) * (len(table) - 1)
    below = np.minimum(at.astype(np.int64), len(table) - 2)
    share = (at - below)[..., None].astype(np.float32)
    result: Values = table[below] * (1 - share) + table[below + 1] * share
    return result


def mix_colours(kind: str, factor: Values, first: Values, second: Values) -> Values:
    """Blender's blend modes of two colours."""
    f, a, b = grey(factor), rgb(first), rgb(second)
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = {
            "MIX": lambda: b,
            "DARKEN": lambda: np.minimum(a, b),
            "MULTIPLY": lambda: a * b,
            "LIGHTEN": lambda: np.maximum(a, b),
            "SCREEN": lambda: 1 - (1 - a) * (1 - b),
            "ADD": lambda: a + b,
            "SUBTRACT": lambda: a - b,
            "DIFFERENCE": lambda: np.abs(a - b),
            "DIVIDE": lambda: np.where(b != 0, a / b, a),
            "OVERLAY": lambda: np.where(a < 0.5, 2 * a * b, 1 - 2 * (1 - a) * (1 - b)),
        }
        if kind not in whole:
            raise KeyError(kind)
        result: Values = a * (1 - f) + np.asarray(whole[kind](), np.float32) * f
    return result


def _quotient(a: Values, b: Values) -> Values:
    zero = np.zeros(np.broadcast_shapes(a.shape, b.shape), np.float32)
    return np.divide(a, b, out=zero, where=b != 0)


MATH: dict[str, Callable[[Values, Values, Values], Values]] = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: _quotient(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: np.power(np.maximum(a, 0), b),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0)),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: (a < b).astype(np.float32),
    "GREATER_THAN": lambda a, b, c: (a > b).astype(np.float32),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "ROUND": lambda a, b, c: np.floor(a + 0.5),
    "EXPONENT": lambda a, b, c: np.exp(a),
}  # fmt: skip
"""Operations of the Math node."""


def hue_saturation(colour: Values, turn: float, saturation: float, value: float) -> Values:
    """The node Hue/Saturation/Value with factor 1; the hue turns by so many circles."""
    colour = rgb(colour)
    most, least = colour.max(axis=-1), colour.min(axis=-1)
    span = most - least
    safe = np.where(span > 0, span, 1)
    r, g, b = (colour[..., i] for i in range(3))
    h = np.where(most == r, (g - b) / safe, np.where(most == g, 2 + (b - r) / safe, 4 + (r - g) / safe)) / 6
    h = np.mod(np.where(span > 0, h, 0) + turn, 1)
    s = np.clip(np.where(most > 0, span / np.where(most > 0, most, 1), 0) * saturation, 0, 1)
    v = most * value
    shades = [np.clip(np.abs(np.mod(h * 6 + shift, 6) - 3) - 1, 0, 1) for shift in (0, 4, 2)]
    result: Values = np.stack([np.maximum(v * (1 - s + s * shade), 0) for shade in shades], axis=-1)
    return result
