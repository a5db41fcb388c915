"""Materials of USD as materials of ours: preview surfaces, standard_surface, OpenPBR, and those of MaterialX files."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from rptcam_cl.core.colour import linear_from_srgb
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.conversion import COAT_INDEX, Array, FileStore, Report, nested
from rptcam_cl.scene.assets.pictures import SUFFIXES, read_picture
from rptcam_cl.scene.materials import LEAST_BEND, MOST_BEND, MOST_INDEX
from rptcam_cl.scene.textures import MOST_NESTED

Keys = dict[str, Any]


def pxr(name: str) -> Any:
    """Return a module of usd-core.

    Raises
    ------
    InputError
        When it is not installed.
    """
    try:
        return importlib.import_module(f"pxr.{name}")
    except ImportError:
        raise InputError("stages of USD need usd-core: pip install 'rptcam_cl[usd]'") from None


def number_of(prim: Any, name: str, default: float, time: Any) -> float:
    """Return a number that a prim says at a moment, or the default where it says none."""
    value = prim.GetAttribute(name).Get(time)
    return default if value is None else float(value)


class PrimReport(Report):
    """What became of prims: messages with the paths that they concern."""

    def __init__(self) -> None:
        super().__init__()
        self.prims: dict[tuple[str, str], list[str]] = {}

    def say(self, effect: str, what: str, prim: Any) -> None:
        """Note that something of a prim is ``ignored`` or ``approximated``."""
        self.prims.setdefault((effect, what), []).append(str(prim.GetPath()))

    def described(self) -> list[dict[str, Any]]:
        """List the messages as plain data: what becomes of what, of which prims, and of how many objects."""
        return [
            {"effect": effect, "message": what, "prims": paths, "objects": len(paths)}
            for (effect, what), paths in self.prims.items()
        ]

    def __iter__(self) -> Iterator[str]:
        for (effect, what), paths in self.prims.items():
            more = f" (and {len(paths) - 1} more)" if len(paths) > 1 else ""
            yield f"{paths[0]}: {effect}: {what}{more}"

    def __len__(self) -> int:
        return len(self.prims)


# Surfaces.

# What has no counterpart: inputs, and the value at which they do nothing.
_PREVIEW_REST = {"occlusion": 1.0}
_STANDARD_REST = {
    "diffuse_roughness": 0.0, "transmission_scatter": 0.0, "transmission_dispersion": 0.0,
    "transmission_extra_roughness": 0.0, "coat_anisotropy": 0.0, "coat_affect_color": 0.0,
    "coat_affect_roughness": 0.0, "tangent": None,
}  # fmt: skip
_OPENPBR_REST = {
    "base_diffuse_roughness": 0.0, "transmission_scatter": 0.0, "transmission_dispersion_scale": 0.0,
    "coat_roughness_anisotropy": 0.0, "geometry_tangent": None,
    "geometry_coat_tangent": None,
}  # fmt: skip
# Names of inputs of standard_surface, and those of OpenPBR that differ.
_STANDARD = {name: name for name in (
    "base", "metalness", "specular", "specular_IOR", "specular_anisotropy", "transmission", "subsurface", "coat",
    "coat_IOR", "sheen", "sheen_color", "sheen_roughness", "opacity", "thin_walled", "normal", "coat_normal",
)}  # fmt: skip
_OPENPBR = {
    "base": "base_weight", "metalness": "base_metalness", "specular": "specular_weight",
    "specular_IOR": "specular_ior", "specular_anisotropy": "specular_roughness_anisotropy",
    "transmission": "transmission_weight", "subsurface": "subsurface_weight", "coat": "coat_weight",
    "coat_IOR": "coat_ior", "sheen": "fuzz_weight", "sheen_color": "fuzz_color", "sheen_roughness": "fuzz_roughness",
    "opacity": "geometry_opacity", "thin_walled": "geometry_thin_walled", "normal": "geometry_normal",
    "coat_normal": "geometry_coat_normal",
}  # fmt: skip
_NITS = 1000.0  # OpenPBR has luminances; a radiance of 1 stands for so many


@dataclass(eq=False)
class Shading:
    """Makes materials of ours of those of a stage at one moment.

    Attributes
    ----------
    metres_per_unit : float
    primvars : set of str
        Names of the primvars that the last surface has read.
    """

    time: Any
    report: PrimReport
    files: FileStore
    metres_per_unit: float
    primvars: set[str] = field(default_factory=set)
    _prim: Any = None
    _pictures: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.shade = pxr("UsdShade")

    def surface(self, material: Any, prim: Any) -> Keys | None:
        """Return the keys of a material on a prim; None, with a report, for one of another kind."""
        self.primvars, self._prim = set(), prim
        shader = _shader_of(material.ComputeSurfaceSource)
        kind = str(shader.GetIdAttr().Get() or "") if shader else ""
        if "UsdPreviewSurface" in kind:
            return self._preview(_Inputs(self, shader))
        if "standard_surface" in kind or "open_pbr_surface" in kind:
            return self._standard(_Inputs(self, shader), "open_pbr" in kind)
        what = f"the colour of the prim, as its shader is {kind or 'none'}"
        self.report.say("approximated", what, material.GetPrim())
        return None

    def shows_colours(self, material: Any) -> bool:
        """Return whether a preview surface has the colour that a mesh says for its parts."""
        get = _Inputs(self, shader) if (shader := _shader_of(material.ComputeSurfaceSource)) else None
        source = get._source("diffuseColor") if get else None
        reader = self.shade.Shader(source.GetPrim()) if source is not None else None
        return bool(reader) and _Inputs(self, reader).primvar_name() == "displayColor"

    def coordinates(self, material: Any) -> list[str]:
        """Return the names of the primvars that place the pictures of a material."""
        usd = pxr("Usd")
        prims = usd.PrimRange(material.GetPrim(), usd.TraverseInstanceProxies())
        shaders = [self.shade.Shader(prim) for prim in prims if prim.IsA(self.shade.Shader)]
        pairs = [each for each in shaders if str(each.GetIdAttr().Get() or "").endswith(("_float2", "_vector2"))]
        return [name for each in pairs if (name := _Inputs(self, each).primvar_name())]

    def primvar(self, name: str, prim: Any) -> Any:
        """Return the values of a primvar as an array of floats; None where a prim has none of that name."""
        given = pxr("UsdGeom").PrimvarsAPI(prim).FindPrimvarWithInheritance(name) if prim else None
        values = np.asarray(given.ComputeFlattened(self.time) if given and given.HasValue() else [])
        return np.atleast_1d(values) if values.size and values.dtype.kind == "f" else None

    def primvar_of_surface(self, name: str) -> Any:
        """Return the mean of a primvar of the prim that has the surface; None where it has none of that name."""
        self.primvars.add(name)
        values = self.primvar(name, self._prim)
        if values is not None and np.any(values != values[:1]):
            self.report.say("approximated", f"{name}, which differs about the prim, as its mean", self._prim)
        return None if values is None else values.mean(axis=0)

    def displacement(self, material: Any) -> Keys | None:
        """Return the picture, height and middle by which a material moves its surface; None for one that does not."""
        shader = _shader_of(material.ComputeDisplacementSource) or material.ComputeSurfaceSource()[0]
        if not shader or not shader.GetInput("displacement"):
            return None
        get = _Inputs(self, shader)
        heights = get.value("displacement")
        gain = float(np.mean(get.plain("scale", 1.0)))
        if not isinstance(heights, dict):
            if heights is not None and np.any(heights != 0):
                self.report.say("ignored", "displacement that is everywhere the same", shader.GetPrim())
            return None
        first = heights.get("channel", "r") in ("r", "rgb") and "rotation_degrees" not in heights
        if heights["kind"] != "image" or not first:
            what = "displacement by another texture than a picture's first channel"
            self.report.say("ignored", what, shader.GetPrim())
            return None
        layout = {name: heights[name] for name in ("scale", "offset") if name in heights}
        factor = gain * float(np.ravel(heights.get("gain", 1.0))[0])
        bias = gain * get.bias
        return {"file": heights["file"], "height": factor, "middle": -bias / factor if factor else 0.0, **layout}

    def _preview(self, get: _Inputs) -> Keys:
        keys: Keys = {"kind": "principled", "base_color": get.colour("diffuseColor", (0.18, 0.18, 0.18))}
        keys["roughness"] = get.number("roughness", 0.5)
        keys["index"] = min(max(float(get.plain("ior", 1.5)), 1.0), MOST_INDEX)
        if get.plain("useSpecularWorkflow", 0):
            tint = np.array(get.plain("specularColor", (0, 0, 0)), np.float64)
            keys["index"], keys["specular_color"] = _of_reflectance(tint)
            if isinstance(get.value("specularColor"), dict):
                self.report.say("ignored", "a specular colour that is a texture", get.shader.GetPrim())
        else:
            keys["metallic"] = get.number("metallic", 0.0)
        keys["clearcoat"] = get.number("clearcoat", 0.0)
        keys["clearcoat_roughness"] = get.number("clearcoatRoughness", 0.01)
        keys["emission"] = get.colour("emissiveColor", (0.0, 0.0, 0.0), most=math.inf)
        threshold = get.plain("opacityThreshold", 0.0)
        mask = {"opacity_mode": "mask", "opacity_cutoff": min(float(threshold), 1.0)} if threshold else {}
        if (share := get.number("opacity", 1.0)) != 1.0:
            keys |= {"opacity": share, **mask}
        get.ignore(_PREVIEW_REST)
        return keys | get.normals("normal", "normal_map")

    def _standard(self, get: _Inputs, open_pbr: bool) -> Keys:
        """Return standard_surface of Autodesk or OpenPBR, as far as the principled material goes."""
        of = _OPENPBR if open_pbr else _STANDARD
        get.ignore(_OPENPBR_REST if open_pbr else _STANDARD_REST)
        clear = get.number(of["transmission"], 0.0)
        index = float(get.plain(of["specular_IOR"], 1.5))
        index = min(max(index, 1 + LEAST_BEND), MOST_BEND) if clear else min(max(index, 1.0), MOST_INDEX)
        colour = self._base(get, of, clear)
        share = get.number(of["opacity"], 1.0)
        holes: Keys = {"opacity": share} if share != 1.0 else {}
        if clear == 1.0 and isinstance(colour, list) and get.plain(of["thin_walled"], False):
            return {"kind": "thin_glass", "index": index, "transmittance": colour, **holes}
        rough = get.number("specular_roughness", 0.3 if open_pbr else 0.2)
        keys: Keys = {
            "kind": "principled", "base_color": colour, "metallic": get.number(of["metalness"], 0.0),
            "specular": get.number(of["specular"], 1.0), "specular_color": get.colour("specular_color", (1, 1, 1)),
            "roughness": rough, "index": index, "transmission": clear,
            "clearcoat": get.number(of["coat"], 0.0),
            "clearcoat_roughness": get.number("coat_roughness", 0.0 if open_pbr else 0.1), **holes,
        }  # fmt: skip
        coat_index = float(get.plain(of["coat_IOR"], 1.6 if open_pbr else 1.5))
        if keys["clearcoat"] and abs(coat_index - COAT_INDEX) > 1e-3:
            self.report.say("approximated", f"a coat of index {COAT_INDEX}", get.shader.GetPrim())
        if (sheen := float(np.mean(get.plain(of["sheen"], 0.0)))) > 0:
            keys["sheen"] = get.colour(of["sheen_color"], (1, 1, 1), factor=sheen)
            keys["sheen_roughness"] = get.number(of["sheen_roughness"], 0.5 if open_pbr else 0.3)
        glow = float(get.plain("emission_luminance", 0.0)) / _NITS if open_pbr else float(get.plain("emission", 0.0))
        if glow > 0:
            keys["emission"] = get.colour("emission_color", (1, 1, 1), factor=glow, most=math.inf)
        if clear == 1.0 and (depth := float(get.plain("transmission_depth", 0.0))) > 0:
            left = np.clip(get.plain("transmission_color", (1, 1, 1)), 0, 1).tolist()
            keys["attenuation"] = {"color": left, "distance_m": depth * self.metres_per_unit}
        keys |= self._stretch(get, of, rough, open_pbr) | self._film(get, keys, open_pbr)
        keys |= get.normals(of["normal"], "normal_map")
        return keys | (get.normals(of["coat_normal"], "clearcoat_normal_map") if keys["clearcoat"] else {})

    def _base(self, get: _Inputs, of: dict[str, str], clear: Any) -> Any:
        """Return the colour of the base: of what passes where all does, under a coat with the colour of that."""
        prim = get.shader.GetPrim()
        if clear == 1.0:
            deep = float(get.plain("transmission_depth", 0.0)) > 0
            return [1.0, 1.0, 1.0] if deep else get.colour("transmission_color", (1, 1, 1))
        if clear != 0.0:
            self.report.say("approximated", "what passes has the colour of the base", prim)
        colour = get.colour("base_color", (0.8, 0.8, 0.8), factor=float(get.plain(of["base"], 1.0)))
        if isinstance(below := get.number(of["subsurface"], 0.0), dict) or below > 0:
            self.report.say("approximated", "subsurface scattering as an even reflection of its colour", prim)
            inside = get.colour("subsurface_color", (0.8, 0.8, 0.8) if of is _OPENPBR else (1, 1, 1))
            colour = _mixture(colour, inside, below)
        coat = get.number(of["coat"], 0.0)
        tint = get.colour("coat_color", (1, 1, 1))
        if coat != 0.0 and tint != [1.0, 1.0, 1.0]:
            self.report.say("approximated", "the colour of a coat as one of the base", prim)
            colour = _product(colour, _mixture([1.0, 1.0, 1.0], tint, coat))
        return colour

    def _film(self, get: _Inputs, keys: Keys, open_pbr: bool) -> Keys:
        """Return the thin film of a surface of such keys, where it may lie on that."""
        share = float(np.mean(get.plain("thin_film_weight", 0.0))) if open_pbr else 1.0
        thickness = float(get.plain("thin_film_thickness", 0.5 if open_pbr else 0.0)) * (1000 if open_pbr else 1)
        if share <= 0 or thickness <= 0:
            return {}
        numbers = not any(isinstance(keys[key], dict) for key in ("metallic", "specular", "specular_color"))
        coloured = isinstance(keys["base_color"], dict) and keys["metallic"] != 0
        if not numbers or coloured or keys["transmission"] != 0:
            self.report.say(
                "ignored", "a thin film beside transmission or textures of what reflects", get.shader.GetPrim()
            )
            return {}
        index = float(get.plain("thin_film_ior" if open_pbr else "thin_film_IOR", 1.4 if open_pbr else 1.5))
        film = {"thickness_nm": min(thickness, 20_000.0), "index": min(max(index, 1.0), 5.0), "share": min(share, 1.0)}
        return {"thin_film": film}

    def _stretch(self, get: _Inputs, of: dict[str, str], rough: Any, open_pbr: bool) -> Keys:
        """Return roughness and stretch of highlights along u; alpha across over that along is 1 - 0.9 anisotropy."""
        stretch = get.number(of["specular_anisotropy"], 0.0)
        if isinstance(stretch, dict) or isinstance(rough, dict):
            if stretch != 0.0:
                self.report.say("ignored", "a stretch of highlights by textures", get.shader.GetPrim())
            return {}
        if stretch == 0.0:
            return {}
        keys: Keys = {"anisotropy": min(stretch / 0.9, 1.0)}
        if open_pbr:
            ratio = 1 - stretch
            keys["roughness"] = min(rough * (2 * ratio / (1 + ratio**2)) ** 0.25, 1.0)
        elif turn := float(get.plain("specular_rotation", 0.0)):
            keys["anisotropy_rotation_degrees"] = 360 * turn
        return keys

    def picture(self, asset: Any) -> str | None:
        """The name of a picture beside the scene, copied there also out of a .usdz; None where there is none."""
        path = asset.resolvedPath or asset.path
        if not path or "<UDIM>" in path:
            return None
        if path not in self._pictures:
            name = Path(path.rstrip("]").replace("[", "/")).name
            raw = _content(asset)
            if raw is None or Path(name).suffix.lower() not in SUFFIXES:
                return None
            self._pictures[path] = self.files.add("files", name, lambda target: target.write_bytes(raw))
        return self._pictures[path]


def _content(asset: Any) -> bytes | None:
    """Return the bytes of a file that a stage names; None where there is none."""
    ar = pxr("Ar")
    content = ar.GetResolver().OpenAsset(ar.ResolvedPath(asset.resolvedPath)) if asset.resolvedPath else None
    return None if content is None else bytes(content.GetBuffer())


def _may_have_alpha(picture: bytes) -> bool:
    """Return whether a picture has alpha; also of one that cannot be read here, which the scene tells."""
    try:
        return read_picture(picture).has_alpha
    except InputError:
        return True


def _shader_of(source: Callable[..., Any]) -> Any:
    """The shader at a material's output, which files of MaterialX have under a name of their own."""
    return source()[0] or source("mtlx")[0]


def _of_reflectance(tint: Array) -> tuple[float, list[float]]:
    """Return index and specular colour of a reflectance at normal incidence."""
    most = float(np.clip(tint, 0, 0.99).max())
    root = math.sqrt(most)
    return max((1 + root) / (1 - root), 1.0), (np.clip(tint, 0, 1) / most if most > 0 else np.zeros(3)).tolist()


# Values of inputs: constants, and textures of ours.


def _product(first: Any, second: Any) -> Any:
    """Return two colours or textures multiplied; of mixtures that stand too deep in each other the first alone."""
    if isinstance(first, dict) and isinstance(second, dict):
        keys: Keys = {"kind": "mixture", "second": first, "amount": second}
        return keys if nested(keys) <= MOST_NESTED else first
    if isinstance(second, dict):
        first, second = second, first
    if not isinstance(first, dict):
        return (np.asarray(first) * np.asarray(second)).tolist()
    if np.all(np.asarray(second) == 1):
        return first
    if first["kind"] == "image":
        return first | {"gain": np.maximum(np.multiply(first.get("gain", 1.0), np.broadcast_to(second, 3)), 0).tolist()}
    return {"kind": "mixture", "second": first, "amount": np.clip(np.broadcast_to(second, 3), 0, 1).tolist()}


def _mixture(first: Any, second: Any, amount: Any) -> Any:
    """Return a colour or texture between two."""
    if not any(isinstance(each, dict) for each in (first, second, amount)):
        share = np.asarray(amount)
        return ((1 - share) * np.asarray(first) + share * np.asarray(second)).tolist()
    if not isinstance(amount, dict) and np.all(np.asarray(amount) == 0):
        return first
    if not isinstance(amount, dict) and np.all(np.asarray(amount) == 1):
        return second
    parts = {"first": first, "second": second, "amount": amount}
    keys: Keys = {"kind": "mixture"} | {
        name: part if isinstance(part, dict) else np.clip(np.broadcast_to(part, 3), 0, 1).tolist()
        for name, part in parts.items()
    }
    return keys if nested(keys) <= MOST_NESTED else second


_CHANNELS = {"x": "r", "y": "g", "z": "b", "w": "a"} | {name: name for name in "rgba"}
# Nodes that pass on what comes in.
_PASSING = ("normalmap", "convert", "extract", "swizzle", "separate2", "separate3", "separate4", "combine2", "dot")
_WRAPS = {"clamp": "clamp", "black": "clamp", "constant": "clamp", "mirror": "mirror"}
_DEEPEST = 32


class _Inputs:
    """The inputs of a shader.

    Attributes
    ----------
    bias : float
        What the last picture that was read has added to its values, where that is not reported.
    """

    def __init__(self, shading: Shading, shader: Any, depth: int = 0) -> None:
        self.shading, self.shader, self.bias = shading, shader, 0.0
        self._depth = depth

    def _source(self, name: str) -> Any:
        """Return the attribute that gives an input its value: of a shader's output, or of a constant; None without."""
        given = self.shader.GetInput(name)
        found = self.shading.shade.Utils.GetValueProducingAttributes(given) if given else ()
        return found[0] if found else None

    def plain(self, name: str, default: Any) -> Any:
        """Return a constant; the default where a texture gives the value."""
        found = self.value(name)
        return default if found is None or isinstance(found, dict) else found

    def value(self, name: str) -> Any:
        """Return a constant or a texture; None where nothing gives a value, or, with a report, what is not read."""
        source = self._source(name)
        if source is None:
            return None
        if not self.shading.shade.Output.IsOutput(source):
            return source.Get(self.shading.time)
        shader = self.shading.shade.Shader(source.GetPrim())
        inner = _Inputs(self.shading, shader, self._depth + 1)
        found = inner.output(source.GetName().rsplit(":", 1)[-1], name) if self._depth < _DEEPEST else None
        self.bias = inner.bias
        return found

    def output(self, output: str, wanted: str) -> Any:
        """Return the value of an output: a constant or a texture; None, with a report, for other nodes."""
        kind = str(self.shader.GetIdAttr().Get() or "")
        node = kind.removeprefix("ND_").split("_")[0]
        if (name := self.primvar_name()) is not None:
            found = self.shading.primvar_of_surface(name)
            found = self.plain("fallback", self.plain("default", None)) if found is None else found
            if found is None:
                self.shading.report.say(
                    "approximated", f"{wanted} as 0, which a primvar that is not there has", self.shader.GetPrim()
                )
            return 0.0 if found is None else found
        if self.shader.GetInput("file"):
            return self._picture(kind, output, wanted)
        if node == "constant":
            return self.value("value")
        if node in _PASSING:
            return self._channel(self.value("in"), node, output)
        if node == "multiply":
            parts = [1.0 if (part := self.value(name)) is None else part for name in ("in1", "in2")]
            return _product(*parts)
        if node == "mix":
            low, high, share = (self.value(name) for name in ("bg", "fg", "mix"))
            return _mixture(*(0.0 if part is None else part for part in (low, high, share)))
        self.shading.report.say("ignored", f"the shader {kind}, which gives {wanted}", self.shader.GetPrim())
        return None

    def primvar_name(self) -> str | None:
        """Return the name of the primvar that a shader reads; None for a shader that reads none."""
        kind = str(self.shader.GetIdAttr().Get() or "")
        if kind.startswith("ND_geomcolor"):
            return "displayColor"
        named = {"UsdPrimvarReader": "varname", "ND_geompropvalue": "geomprop"}.get(kind.rsplit("_", 1)[0])
        return str(self.plain(named, "")) if named else None

    def _channel(self, found: Any, node: str, output: str) -> Any:
        """Return one channel of what comes in, where a node takes one."""
        letters = str(self.plain("channels", ""))
        letter = output[3:] if node.startswith("separate") else letters if len(letters) == 1 else ""
        letter = "xyzw"[int(self.plain("index", 0))] if node == "extract" else letter
        if letter not in _CHANNELS:
            return found
        if isinstance(found, dict):
            return found | {"channel": _CHANNELS[letter]} if found["kind"] == "image" else found
        return None if found is None else float(np.ravel(found)["rgba".index(_CHANNELS[letter])])

    def colour(self, name: str, default: tuple[float, ...], *, factor: float = 1.0, most: float = 1.0) -> Any:
        """Return a colour, a list, or a texture."""
        found = self.value(name)
        colour = _product(default if found is None else found, factor)
        return colour if isinstance(colour, dict) else np.clip(np.broadcast_to(colour, 3), 0, most).tolist()

    def number(self, name: str, default: float) -> Any:
        """Return a number from 0 to 1, or a texture."""
        found = self.value(name)
        if isinstance(found, dict):
            return found
        return float(np.clip(np.mean(default if found is None else found), 0, 1))

    def normals(self, name: str, key: str) -> Keys:
        """Return the key of a picture of normals."""
        found = self.value(name)
        if not isinstance(found, dict) or found["kind"] != "image":
            return {}
        strength = float(np.mean(self._normal_scale(name)))
        keys = {each: value for each, value in found.items() if each not in ("kind", "gain", "channel")}
        return {key: keys | {"color_space": "linear"} | ({"strength": strength} if strength != 1 else {})}

    def _normal_scale(self, name: str) -> Any:
        """Return the factor of a MaterialX node on the slopes of normals; 1 elsewhere, where it is one of a layout."""
        source = self._source(name)
        shader = self.shading.shade.Shader(source.GetPrim())
        is_map = str(shader.GetIdAttr().Get() or "").startswith("ND_normalmap")
        return np.clip(_Inputs(self.shading, shader).plain("scale", 1.0), 0, 10) if is_map else 1.0

    def ignore(self, rest: dict[str, Any]) -> None:
        """Report inputs without a counterpart that have another value than that at which they do nothing."""
        for name, nothing in rest.items():
            source = self._source(name)
            if source is None:
                continue
            value = None if self.shading.shade.Output.IsOutput(source) else source.Get(self.shading.time)
            if value is None or nothing is None or np.any(np.asarray(value) != nothing):
                self.shading.report.say("ignored", name, self.shader.GetPrim())

    def _picture(self, kind: str, output: str, wanted: str) -> Keys | float | None:
        asset = self.plain("file", None)
        file = self.shading.picture(asset) if asset else None
        if file is None:
            what = f"the picture {asset.path}" if asset else f"the shader {kind}"
            self.shading.report.say("ignored", f"{what}, which gives {wanted}", self.shader.GetPrim())
            return None
        if output == "a" and not _may_have_alpha(_content(asset) or b""):
            return 1.0  # as such a picture has (UsdUVTexture)
        keys: Keys = {"kind": "image", "file": file, **self._layout(kind)}
        if output in ("r", "g", "b", "a"):
            keys["channel"] = output
        if (space := self._space(kind)) != "auto":
            keys["color_space"] = space
        if kind.startswith("ND_"):
            return keys
        gain, bias = (np.resize(np.array(self.plain(name, default), np.float64), 4) for name, default in (
            ("scale", (1, 1, 1, 1)), ("bias", (0, 0, 0, 0))))  # fmt: skip
        gain, bias = (each[["rgba".index(output)] * 3 if len(output) == 1 else [0, 1, 2]] for each in (gain, bias))
        self.bias = float(bias[0])
        if wanted == "normal":
            usual = ((1, 0), (2, -1))  # of a picture whose bytes are the components' halves about 0.5
            if not any(np.all(gain == factor) and np.all(bias == shift) for factor, shift in usual):
                what = "the scale and bias of a picture of normals, which are read as 2 v - 1"
                self.shading.report.say("ignored", what, self.shader.GetPrim())
            return keys
        if not np.all(gain == 1):
            keys["gain"] = np.maximum(gain, 0).tolist()
        if wanted != "displacement" and bias.any():
            self.shading.report.say("ignored", "the bias of a texture", self.shader.GetPrim())
        return keys

    def _space(self, kind: str) -> str:
        """Return how a picture's numbers are meant; in MaterialX those of numbers and vectors are linear."""
        source = self._source("file")
        named = str(source.GetColorSpace()) if source is not None else ""
        named = named or str(self.plain("sourceColorSpace", "auto"))
        if named == "auto" and kind.startswith("ND_") and "_color" not in kind:
            return "linear"
        return "auto" if named == "auto" else "srgb" if named.lower().startswith("srgb") else "linear"

    def _layout(self, kind: str) -> Keys:
        """Return how a picture lies on the surface."""
        names = ("uaddressmode", "vaddressmode") if kind.startswith("ND_") else ("wrapS", "wrapT")
        wraps = [str(self.plain(name, "")) for name in names]
        ours = [_WRAPS.get(wrap, "repeat") for wrap in wraps]
        keys: Keys = next(({"wrap": wrap} for wrap in ours if wrap != "repeat"), {})
        for what, there in ((f"{' and '.join(names)} that differ as {keys.get('wrap')}", ours[0] != ours[1]),
                            ("black beyond a picture as its edge", {"black", "constant"} & {*wraps})):  # fmt: skip
            if there:
                self.shading.report.say("approximated", what, self.shader.GetPrim())
        if kind.startswith("ND_tiledimage"):
            tiles, shift, own, tile = (np.array(self.plain(name, default), np.float64) for name, default in (
                ("uvtiling", (1, 1)), ("uvoffset", (0, 0)), ("realworldimagesize", (1, 1)),
                ("realworldtilesize", (1, 1))))  # fmt: skip
            ratio = tile / np.where(own > 0, own, 1)
            return keys | {"scale": (tiles * ratio).tolist()} | _offset_keys(-shift * ratio)
        source = self._source("st") or self._source("texcoord")
        placed = self.shading.shade.Shader(source.GetPrim()) if source is not None else None
        form = str(placed.GetIdAttr().Get() or "") if placed else ""
        if form != "UsdTransform2d" and not form.startswith("ND_place2d"):
            return keys
        get = _Inputs(self.shading, placed)
        scale = np.array(get.plain("scale", (1, 1)), np.float64)
        if form == "UsdTransform2d":
            turn, shift = float(get.plain("rotation", 0.0)), np.array(get.plain("translation", (0, 0)), np.float64)
        else:  # which divides by the scale, turns the other way round, and subtracts the offset
            scale = 1 / np.where(scale != 0, scale, 1)
            turn, shift = -float(get.plain("rotate", 0.0)), -np.array(get.plain("offset", (0, 0)), np.float64)
            get.ignore({"pivot": 0.0, "operationorder": 0})
        return keys | {"scale": scale.tolist()} | ({"rotation_degrees": turn} if turn else {}) | _offset_keys(shift)


def _offset_keys(offset: Array) -> Keys:
    return {"offset": offset.tolist()} if offset.any() else {}


# Files of MaterialX as layers of USD.

_LARGEST_MATERIALX = 16 << 20
_INCLUDE = "{http://www.w3.org/2001/XInclude}include"
_MOST_INCLUDES = 64
_TYPES = {
    "float": "Float", "color3": "Color3f", "color4": "Color4f", "vector2": "Float2", "vector3": "Float3",
    "vector4": "Float4", "integer": "Int", "boolean": "Bool", "string": "String", "filename": "Asset",
}  # fmt: skip
_METRES = {"millimeter": 0.001, "centimeter": 0.01, "meter": 1.0, "kilometer": 1000.0, "inch": 0.0254, "foot": 0.3048,
           "yard": 0.9144}  # fmt: skip
_LINEAR = ("", "lin_rec709", "none", "raw", "lin_srgb")


def materialx_layer(path: str, report: PrimReport) -> Any:
    """Return a layer of USD with the materials of a MaterialX file below ``/MaterialX/Materials``.

    Parameters
    ----------
    path
        Of the file, as USD resolves it: also within a .usdz.

    Raises
    ------
    InputError
        When it is no file of MaterialX.
    """
    root = _materialx_root(path, [])
    layer = pxr("Sdf").Layer.CreateAnonymous("materialx.usda")
    stage = pxr("Usd").Stage.Open(layer)
    stage.DefinePrim("/MaterialX/Materials")
    network = _Network(root, path, stage, report)
    for material in root.findall("surfacematerial"):
        network.add_material(material)
    return layer


def _materialx_root(path: str, read: list[str]) -> ElementTree.Element:
    """Return the document of a file, with those that it includes."""
    ar = pxr("Ar")
    asset = ar.GetResolver().OpenAsset(ar.ResolvedPath(path))
    raw = bytes(asset.GetBuffer())[: _LARGEST_MATERIALX + 1] if asset else b""
    try:
        if not raw or len(raw) > _LARGEST_MATERIALX or b"<!ENTITY" in raw:
            raise InputError(f"{path}: is empty, too large, or defines entities (allowed: a MaterialX file)")
        root = ElementTree.fromstring(raw)
    except ElementTree.ParseError as problem:
        raise InputError(f"{path}: is no MaterialX file ({problem})") from None
    if root.tag != "materialx":
        raise InputError(f"{path}: is no MaterialX file (its root is {root.tag!r}; allowed: materialx)")
    read.append(path)
    for include in root.findall(_INCLUDE):
        name = ar.GetResolver().CreateIdentifier(include.get("href", ""), ar.ResolvedPath(path))
        if name not in read and len(read) < _MOST_INCLUDES:
            root.extend(_materialx_root(name, read))
    return root


@dataclass(eq=False)
class _Network:
    """Writes the nodes of a MaterialX document, as far as a material needs them, below that material."""

    root: ElementTree.Element
    path: str
    stage: Any
    report: PrimReport

    def __post_init__(self) -> None:
        self.shade, self.sdf = pxr("UsdShade"), pxr("Sdf")

    def add_material(self, element: ElementTree.Element) -> None:
        """Add a material with the shaders of its surface and its displacement."""
        name = pxr("Tf").MakeValidIdentifier(element.get("name", ""))
        material = self.shade.Material.Define(self.stage, f"/MaterialX/Materials/{name}")
        for given, create in (("surfaceshader", material.CreateSurfaceOutput),
                              ("displacementshader", material.CreateDisplacementOutput)):  # fmt: skip
            source = element.find(f"input[@name='{given}']")
            node = None if source is None else self._named(self.root, source.get("nodename", ""))
            if node is not None:
                shader = self._shader(node, self.root, material.GetPath())
                create("mtlx").ConnectToSource(shader.ConnectableAPI(), "out")

    def _named(self, scope: ElementTree.Element, name: str) -> ElementTree.Element | None:
        return next((each for each in scope if each.get("name") == name and each.tag != "output"), None)

    def _shader(self, element: ElementTree.Element, scope: ElementTree.Element, above: Any) -> Any:
        """Return the shader of a node in a document or a graph, written once for each material."""
        names = [scope.get("name", "")] if scope is not self.root else []
        path = above.AppendChild(pxr("Tf").MakeValidIdentifier("_".join([*names, element.get("name", "")])))
        if self.stage.GetPrimAtPath(path):
            return self.shade.Shader.Get(self.stage, path)
        shader = self.shade.Shader.Define(self.stage, path)
        shader.CreateIdAttr(f"ND_{element.tag}_{element.get('type', '')}")
        for given in element.findall("input"):
            self._input(shader, given, scope, element, above)
        return shader

    def _input(
        self, shader: Any, given: ElementTree.Element, scope: ElementTree.Element, node: ElementTree.Element, above: Any
    ) -> None:
        kind = _TYPES.get(given.get("type", ""))
        if kind is None:
            return
        if (inner := given.get("interfacename")) and scope is not self.root:
            outer = scope.find(f"input[@name='{inner}']")
            given, scope = (given, scope) if outer is None else (outer, self.root)
        target = shader.CreateInput(str(given.get("name")), getattr(self.sdf.ValueTypeNames, kind))
        source, inside, output = self._follow_connection(given, scope)
        if source is not None:
            made = self._shader(source, inside, above)
            target.ConnectToSource(made.CreateOutput(output, getattr(self.sdf.ValueTypeNames, kind)))
        elif (text := given.get("value")) is not None:
            spaces = (each.get("colorspace") for each in (given, node, scope, self.root))
            space = next(filter(None, spaces), "")
            try:
                value = self._value(text, given, scope)
            except ValueError:
                self.report.say("ignored", f"the value {text!r} of {given.get('name')}", shader.GetPrim())
                return
            if kind == "Asset":
                target.GetAttr().SetColorSpace(space or "lin_rec709")
            elif kind.startswith("Color") and space == "srgb_texture":
                value = tuple(linear_from_srgb(np.array(value)).tolist())
            elif kind.startswith("Color") and space not in _LINEAR:
                self.report.say("approximated", f"colours of {space} as linear sRGB", shader.GetPrim())
            target.Set(value)

    def _follow_connection(
        self, given: ElementTree.Element, scope: ElementTree.Element
    ) -> tuple[ElementTree.Element | None, ElementTree.Element, str]:
        """Return the node that an input takes its value from, the graph that has it, and the output."""
        if graph := given.get("nodegraph"):
            inside = self._named(self.root, graph)
            outputs = [] if inside is None else inside.findall("output")
            wanted = given.get("output", "")
            chosen = next((each for each in outputs if each.get("name") == wanted or not wanted), None)
            if inside is None or chosen is None:
                return None, scope, ""
            return self._named(inside, chosen.get("nodename", "")), inside, chosen.get("output", "out")
        if name := given.get("nodename"):
            return self._named(scope, name), scope, given.get("output", "out")
        return None, scope, ""

    def _value(self, text: str, given: ElementTree.Element, scope: ElementTree.Element) -> Any:
        """Return the value that a text means; raise a ValueError where it means none."""
        match given.get("type"):
            case "filename":
                outer = scope.get("fileprefix", "") if scope is not self.root else ""
                resolver, here = pxr("Ar").GetResolver(), pxr("Ar").ResolvedPath(self.path)
                tried = (self.root.get("fileprefix", "") + outer + text, text)
                names = [resolver.CreateIdentifier(each, here) for each in tried]
                return self.sdf.AssetPath(next(filter(resolver.Resolve, names), names[0]))
            case "string":
                return text
            case "boolean":
                return text.strip().lower() == "true"
            case "integer":
                return int(text)
        unit = _METRES.get(given.get("unit", ""), 1.0)
        numbers = [unit * float(word) for word in re.split(r"[\s,]+", text.strip())]
        return numbers[0] if given.get("type") == "float" else tuple(numbers)
