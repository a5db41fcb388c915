"""Textures of pbrt as textures of ours, or as the colour that comes nearest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.pbrt.colours import COLOURS, reflectance
from rptcam_cl.pbrt.context import Context
from rptcam_cl.pbrt.parameters import Parameter
from rptcam_cl.pbrt.pictures import OTHERS, is_readable, picture_name
from rptcam_cl.pbrt.state import Entity
from rptcam_cl.pictures import SUFFIXES

Array = NDArray[np.float64]
Keys = dict[str, Any]

WRAPS = {"repeat": "repeat", "clamp": "clamp", "octahedralsphere": "clamp"}
# Parameters of filtering, which is ours to choose.
FILTERING = ("maxanisotropy", "trilinear", "filter")
GREY = 0.5
# Nested deeper than textures are on purpose; a name that refers to itself never gets here.
DEEPEST = 32


@dataclass(frozen=True, eq=False)
class Shade:
    """What a parameter of a material is: one colour, or a texture of ours with its mean where that is known.

    Attributes
    ----------
    colour : (3,) array
        The colour, or what stands for the texture where ours takes no texture.
    texture : dict or None
        Keys of a texture.
    """

    colour: Array
    texture: Keys | None = None

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
                texture["gain"] = max(texture.get("gain", 1.0) * float(factor.mean()), 0.0)
        return Shade(np.clip(self.colour * factor, 0, 1), texture)


def shade(context: Context, entity: Entity, name: str, default: float | Array, depth: int = 0) -> Shade:
    """Return a colour parameter of a material or texture."""
    item = entity.parameters.get(name, "texture", *COLOURS)
    if item is None or item.kind != "texture":
        return Shade(reflectance(context, entity, name, default))
    return _named(context, entity, item, "spectrum", depth)


def value(context: Context, entity: Entity, name: str, default: float) -> float:
    """Return a number parameter; a texture is replaced by its mean where that is known."""
    item = entity.parameters.get(name, "texture", "float", "spectrum", "rgb")
    if item is None:
        return default
    if item.kind != "texture":
        return float(reflectance(context, entity, name, default).mean()) if item.kind != "float" else (
            entity.parameters.number(name, default))  # fmt: skip
    found = _named(context, entity, item, "float", 0)
    if found.texture is not None:
        context.report.approximated(item.place, f'{entity.what}: "{name}" is its mean, not a texture')
    return float(found.colour.mean())


def number_shade(context: Context, entity: Entity, name: str, default: float) -> Shade:
    """Return a number parameter that may vary over the surface."""
    item = entity.parameters.get(name, "texture", "float")
    if item is None or item.kind == "float":
        return Shade(np.full(3, default if item is None else entity.parameters.number(name, default)))
    return _named(context, entity, item, "float", 0)


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
            corners = [shade(context, texture, name, 0.5, depth).colour for name in ("v00", "v01", "v10", "v11")]
            context.report.approximated(texture.place, f"{texture.what}: the mean of its corners")
            return Shade(np.mean(corners, axis=0))
    known = ("dots", "fbm", "wrinkled", "windy", "marble", "ptex", "directionmix")
    if texture.kind not in known:
        allowed = ", ".join(("constant", "imagemap", "checkerboard", "scale", "mix", "bilerp", *known))
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
    path = context.find(name, place)
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
    return Shade(np.full(3, GREY * gain), found | _mapping(context, texture))


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
    if first.texture is not None and first.texture["kind"] == "image" and np.ptp(second.colour) > 1e-6:
        context.report.approximated(texture.place, f"{texture.what}: the tint of a picture as its mean grey")
    return first.scaled(second.colour)


def _factor(context: Context, texture: Entity, name: str, depth: int) -> Shade:
    item = texture.parameters.get(name, "texture", *COLOURS)
    if item is not None and item.kind in ("float", "rgb", "color") and len(item.values) in (1, 3):
        return Shade(np.broadcast_to(np.asarray(item.values, np.float64), (3,)).copy())  # may exceed 1
    return shade(context, texture, name, 1.0, depth)


def _mix(context: Context, texture: Entity, depth: int) -> Shade:
    first, second = (shade(context, texture, name, default, depth) for name, default in (("tex1", 0.0), ("tex2", 1.0)))
    amount = value(context, texture, "amount", 0.5)
    if first.texture is not None or second.texture is not None:
        context.report.approximated(texture.place, f"{texture.what}: its textures as one colour each")
    return Shade((1 - amount) * first.colour + amount * second.colour)
