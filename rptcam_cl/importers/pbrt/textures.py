"""Textures of pbrt as textures of ours, or as the colour that comes nearest."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.pictures import SUFFIXES
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.colours import COLOURS, reflectance
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.parameters import Parameter
from rptcam_cl.importers.pbrt.pictures import OTHERS, is_readable, mean_colour, picture_name, write_exr
from rptcam_cl.importers.pbrt.state import Entity

Array = NDArray[np.float64]
Keys = dict[str, Any]

WRAPS = {"repeat": "repeat", "clamp": "clamp", "octahedralsphere": "clamp"}
# Parameters of filtering, which is ours to choose.
FILTERING = ("maxanisotropy", "trilinear", "filter")
GREY = 0.5
# Along each side of the picture of u and v.
UV_TEXELS = 256
# Nested deeper than textures are on purpose; a name that refers to itself never gets here.
DEEPEST = 32


@dataclass(frozen=True, eq=False)
class Shade:
    """What a parameter of a material is: one colour, or a texture of ours with its mean.

    Attributes
    ----------
    mean : (3,) array, or a function that returns it
        The colour, or the mean of the texture, for where ours takes no texture.
    texture : dict or None
        Keys of a texture.
    """

    mean: Array | Callable[[], Array]
    texture: Keys | None = None

    @cached_property
    def colour(self) -> Array:
        """The mean; that of a picture is computed on demand, as the whole picture must be read."""
        return self.mean() if callable(self.mean) else self.mean

    def keys(self) -> Any:
        """Return what a key of ours that takes colours and textures is set to."""
        return self.colour.tolist() if self.texture is None else self.texture

    def scaled(self, factor: Array) -> Shade:
        """Return the shade times a colour, as near as a texture of ours can."""
        texture = self.texture
        if texture is not None:
            texture = dict(texture)
            for name in ("even", "odd"):
                if name in texture:
                    texture[name] = np.clip(np.array(texture[name]) * factor, 0, 1).tolist()
            if texture["kind"] == "image":
                texture["gain"] = _plainest(np.maximum(np.multiply(texture.get("gain", 1.0), factor), 0))
        return Shade(lambda: np.clip(self.colour * factor, 0, 1), texture)


def _plainest(gain: Array) -> float | list[float]:
    """Return a gain as a number where its channels are equal."""
    return float(gain[0]) if np.ptp(gain) == 0 else list(gain.tolist())


def shade(context: Context, entity: Entity, name: str, default: float | Array, depth: int = 0) -> Shade:
    """Return a colour parameter of a material or texture."""
    item = entity.parameters.get(name, "texture", *COLOURS)
    if item is None or item.kind != "texture":
        return Shade(reflectance(context, entity, name, default))
    return _named(context, entity, item, "spectrum", depth)


def value(context: Context, entity: Entity, name: str, default: float) -> float:
    """Return a number parameter; a texture or colour is replaced by its mean."""
    found = number_shade(context, entity, name, default)
    if found.texture is not None:
        place = entity.parameters.items[name].place
        context.report.approximated(place, f'{entity.what}: "{name}" is its mean, not a texture')
    return single(context, entity, name, found)


def number_shade(context: Context, entity: Entity, name: str, default: float) -> Shade:
    """Return a number parameter that may vary over the surface; one given as a colour stays a colour."""
    item = entity.parameters.get(name, "texture", *COLOURS)
    if item is None or item.kind == "float":
        return Shade(np.full(3, default if item is None else entity.parameters.number(name, default)))
    if item.kind == "texture":
        return _named(context, entity, item, "float", 0)
    return Shade(reflectance(context, entity, name, default))


def single(context: Context, entity: Entity, name: str, found: Shade) -> float:
    """Return the mean over the channels of a parameter where ours takes one number; a colour is reported."""
    if np.ptp(found.colour) > 1e-6:
        place = entity.parameters.items[name].place
        context.report.approximated(place, f'{entity.what}: the colour "{name}" as its mean over the channels')
    return float(found.colour.mean())


def _named(context: Context, entity: Entity, item: Parameter, kind: str, depth: int) -> Shade:
    (name, *others) = (str(text) for text in item.values)
    texture = entity.textures.get((kind, name))
    if texture is None or others:
        other = entity.textures.get(("float" if kind == "spectrum" else "spectrum", name))
        hint = f"; one of the other type is, on {other.place.line}" if other is not None else ""
        raise item.place.error(f'no {kind} texture is named "{name}"{hint}')
    if depth > DEEPEST:
        raise item.place.error(f"textures refer to each other more than {DEEPEST} deep")
    found = context.known.get(id(texture))
    if not isinstance(found, Shade):
        found = context.known[id(texture)] = _converted(context, texture, depth + 1)
    return found


def _converted(context: Context, texture: Entity, depth: int) -> Shade:
    """Return a texture as one of ours."""
    match texture.kind:
        case "constant":
            return Shade(_constant(context, texture))
        case "imagemap":
            return _image(context, texture)
        case "checkerboard":
            return _checkerboard(context, texture, depth)
        case "scale":
            return _scale(context, texture, depth)
        case "mix":
            return _mix(context, texture, depth)
        case "bilerp":
            corners = {"v00": 0.0, "v01": 1.0, "v10": 0.0, "v11": 1.0}
            found = [shade(context, texture, name, default, depth).colour for name, default in corners.items()]
            context.report.approximated(texture.place, f"{texture.what}: the mean of its corners")
            return Shade(np.mean(found, axis=0))
        case "dots":
            return _dots(context, texture, depth)
        case "uv":
            return _coordinates(context, texture)
    known = ("fbm", "wrinkled", "windy", "marble", "ptex", "directionmix")
    if texture.kind not in known:
        drawn = ("constant", "imagemap", "checkerboard", "scale", "mix", "bilerp", "dots", "uv")
        allowed = ", ".join((*drawn, *known))
        raise texture.place.error(f'unknown texture "{texture.kind}" (allowed: {allowed})')
    texture.parameters.used.update(texture.parameters.items)
    context.report.approximated(texture.place, f"{texture.what}: grey {GREY:g}")
    return Shade(np.full(3, GREY))


def _constant(context: Context, texture: Entity) -> Array:
    item = texture.parameters.get("value", *COLOURS)
    if item is not None and item.kind == "float":
        return np.full(3, texture.parameters.number("value", 1.0))
    return reflectance(context, texture, "value", 1.0)


def _mapping(context: Context, texture: Entity) -> Keys:
    parameters = texture.parameters
    mapping = parameters.text("mapping", "uv")
    if mapping != "uv":
        parameters.skip("v1", "v2")
        context.report.approximated(texture.place, f'{texture.what}: the mapping "{mapping}" as that of u and v')
    scale = [parameters.number("uscale", 1.0), parameters.number("vscale", 1.0)]
    offset = [parameters.number("udelta", 0.0), parameters.number("vdelta", 0.0)]
    return ({"scale": scale} if scale != [1, 1] else {}) | ({"offset": offset} if offset != [0, 0] else {})


def _image(context: Context, texture: Entity) -> Shade:
    parameters = texture.parameters
    parameters.skip(*FILTERING)
    name = parameters.text("filename", "")
    if not name:
        raise texture.place.error(f'{texture.what} needs a parameter "string filename"')
    place = parameters.items["filename"].place
    path = context.find_or_note(name, place, f"grey {GREY:g}")
    if path is None:
        texture.parameters.used.update(texture.parameters.items)
        return Shade(np.full(3, GREY))
    wrap = parameters.text("wrap", "repeat")
    found: Keys = {"kind": "image"}
    if parameters.boolean("invert", False):
        context.report.ignored(place, f"{texture.what}: invert")
    if not is_readable(path):
        allowed = " ".join((*SUFFIXES, *OTHERS))
        context.report.approximated(
            place, f"{name}: a kind of picture that is not read (grey {GREY:g}; allowed: {allowed})"
        )
        for unused in ("wrap", "scale", "encoding", "gamma", "uscale", "vscale", "udelta", "vdelta", "mapping"):
            parameters.skip(unused)
        return Shade(np.full(3, GREY))
    found["file"] = picture_name(context, path, place)
    if wrap in WRAPS and WRAPS[wrap] != "repeat":
        found["wrap"] = WRAPS[wrap]
    elif wrap not in WRAPS:
        context.report.approximated(place, f'{texture.what}: wrap "{wrap}" as clamp')
        found["wrap"] = "clamp"
    found |= _encoding(context, texture)
    if (gain := max(parameters.number("scale", 1.0), 0.0)) != 1:
        found["gain"] = gain
    linear = found.get("color_space") == "linear"
    return Shade(
        lambda: np.clip(gain * mean_colour(path, place, linear=linear), 0, 1), found | _mapping(context, texture)
    )


def _encoding(context: Context, texture: Entity) -> Keys:
    """Return how the picture's numbers are meant: ``encoding`` in pbrt-v4, ``gamma`` in pbrt-v3."""
    parameters = texture.parameters
    if not parameters.has("encoding") and not parameters.has("gamma"):
        return {}
    encoding = parameters.text("encoding", "") if parameters.has("encoding") else (
        "sRGB" if parameters.boolean("gamma", True) else "linear")  # fmt: skip
    if encoding.startswith("gamma"):
        context.report.approximated(texture.place, f'{texture.what}: encoding "{encoding}" as sRGB')
        encoding = "sRGB"
    return {"color_space": "srgb" if encoding == "sRGB" else "linear"}


def _checkerboard(context: Context, texture: Entity, depth: int) -> Shade:
    if texture.parameters.integer("dimension", 2) != 2:
        context.report.approximated(texture.place, f"{texture.what}: in u and v, not in space")
    texture.parameters.skip("aamode")
    even, odd = (shade(context, texture, name, default, depth) for name, default in (("tex1", 1.0), ("tex2", 0.0)))
    if even.texture is not None or odd.texture is not None:
        context.report.approximated(texture.place, f"{texture.what}: its textures as one colour each")
    keys = {"kind": "checker", "even": even.colour.tolist(), "odd": odd.colour.tolist()}
    return Shade((even.colour + odd.colour) / 2, keys | _mapping(context, texture))


def _scale(context: Context, texture: Entity, depth: int) -> Shade:
    """Return the product of two textures: ``tex`` and ``scale`` in pbrt-v4, ``tex1`` and ``tex2`` in pbrt-v3."""
    names = ("tex", "scale") if texture.parameters.has("tex") or texture.parameters.has("scale") else ("tex1", "tex2")
    first, second = (_factor(context, texture, name, depth) for name in names)
    if first.texture is not None and second.texture is not None:
        context.report.approximated(texture.place, f"{texture.what}: the second texture as one colour")
    if first.texture is None:
        first, second = second, first
    return first.scaled(second.colour)


def _factor(context: Context, texture: Entity, name: str, depth: int) -> Shade:
    item = texture.parameters.get(name, "texture", *COLOURS)
    if item is not None and item.kind in ("float", "rgb", "color") and len(item.values) in (1, 3):
        return Shade(np.broadcast_to(np.asarray(item.values, np.float64), (3,)).copy())  # may exceed 1
    return shade(context, texture, name, 1.0, depth)


def _mix(context: Context, texture: Entity, depth: int) -> Shade:
    """Return a mixture; an amount that is a colour mixes each channel by its own share."""
    first, second = (shade(context, texture, name, default, depth) for name, default in (("tex1", 0.0), ("tex2", 1.0)))
    amount = number_shade(context, texture, "amount", 0.5)
    for part, other in ((first, 1 - amount.colour), (second, amount.colour)):
        if amount.texture is None and np.all(other == 1):
            return part
    if any(part.texture is not None for part in (first, second, amount)):
        context.report.approximated(texture.place, f"{texture.what}: its textures as one colour each")
    return Shade((1 - amount.colour) * first.colour + amount.colour * second.colour)


def _dots(context: Context, texture: Entity, depth: int) -> Shade:
    """Return the mean of spots and ground: every other cell of u and v has a spot of radius 0.35."""
    inside, outside = (
        shade(context, texture, name, default, depth).colour for name, default in (("inside", 1.0), ("outside", 0.0))
    )
    _mapping(context, texture)
    context.report.approximated(texture.place, f"{texture.what}: the mean of its spots and their ground")
    spots = 0.5 * math.pi * 0.35**2
    return Shade(spots * inside + (1 - spots) * outside)


def _coordinates(context: Context, texture: Entity) -> Shade:
    """Return u as red and v as green: a picture, whose texels hold what their centres have."""
    if "uv" not in context.pictures:
        steps = (np.arange(UV_TEXELS) + 0.5) / UV_TEXELS
        red, green = np.meshgrid(steps, steps[::-1])  # the top row is that of the largest v
        pixels = np.stack([red, green, np.zeros_like(red)], axis=-1).astype(np.float32)
        context.pictures["uv"] = context.files.add("files", "uv.exr", partial(write_exr, pixels))
        context.report.noted(texture.place, f"{texture.what}: written as a picture, to {context.pictures['uv']}")
    keys = {"kind": "image", "file": context.pictures["uv"]}
    return Shade(np.array([0.5, 0.5, 0.0]), keys | _mapping(context, texture))
