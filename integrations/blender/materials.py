"""Blender's materials as materials of a scene: surface nodes to BSDFs, their inputs to constants and textures.

What has no equal is approximated, and the report says how.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from collections.abc import Mapping as MappingOf
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .fields import Field, combine, constant, grey, rgb, texture_of
from .nodes import Link, Node, Paint, ValueReader
from .report import Report


@dataclass(frozen=True)
class BlenderMaterial:
    """A material: its surface, whatever else its output has, and the size of its texture coordinates.

    Attributes
    ----------
    surface : Node or None
        What is linked to the output.
    color : tuple of float
        Of a material without nodes, likewise metallic and roughness.
    has_displacement, has_volume
        Whether something is linked there.
    """

    name: str
    surface: Node | None
    color: tuple[float, ...] = (0.8, 0.8, 0.8)
    metallic: float = 0.0
    roughness: float = 0.4
    has_displacement: bool = False
    has_volume: bool = False


@dataclass(frozen=True)
class Translated:
    """A material of the scene, and which coordinates its textures go by."""

    keys: dict[str, Any]
    coordinates: str = "uv"
    takes_colors: bool = False
    """Whether it takes the colours of vertices, and so is another on each mesh."""


BLACK = {"kind": "matte", "reflectance": 0.0}
NO_SURFACE = {"kind": "matte", "reflectance": 0.0, "opacity": 0.0}
SMOOTHEST = 0.032  # roughness that principled materials have at least
MOST_RADIANCE = 1e30
OF_METALS = (1e-3, 100.0)  # optical constants that scenes take
# Inputs of shaders that are read, said to be left out, or mean nothing by themselves; others that count are reported.
_WHEREVER = {"Color", "Roughness", "Normal", "Tangent", "Weight", "IOR"}
KNOWN = {
    "BSDF_PRINCIPLED": _WHEREVER | {
        "Base Color", "Metallic", "Alpha", "Diffuse Roughness", "Subsurface Weight", "Subsurface Radius",
        "Subsurface Scale", "Subsurface IOR", "Subsurface Anisotropy", "Specular IOR Level", "Specular Tint",
        "Anisotropic", "Anisotropic Rotation", "Transmission Weight", "Transmission Dispersion Abbe Number",
        "Coat Weight", "Coat Roughness", "Coat IOR", "Coat Tint", "Coat Normal", "Sheen Weight", "Sheen Roughness",
        "Sheen Tint", "Emission Color", "Emission Strength", "Thin Film Thickness", "Thin Film IOR",
    },
    "BSDF_METALLIC": _WHEREVER | {"Base Color", "Edge Tint", "Extinction", "Anisotropy", "Rotation", "Thin Film IOR"},
    "BSDF_GLOSSY": _WHEREVER | {"Anisotropy", "Rotation"},
    "BSDF_ANISOTROPIC": _WHEREVER | {"Anisotropy", "Rotation"},
    "BSDF_GLASS": _WHEREVER | {"Rotation", "Thin Film IOR"},
    **dict.fromkeys(("BSDF_DIFFUSE", "BSDF_REFRACTION", "BSDF_SHEEN", "BSDF_TRANSLUCENT"), _WHEREVER),
}  # fmt: skip
# Roughness of Blender's sheen (Zeltner and others 2022), that of ours (Estevez and Kulla 2017) that sends back the same
# share of even light, and a factor on it. Measured on balls in an even world, where Blender's send back 1 to 31 %.
SHEEN = (
    (0.05, 0.1, 0.0), (0.1, 0.1, 0.07), (0.15, 0.1, 0.5), (0.2, 0.111, 1.0), (0.25, 0.152, 1.0), (0.3, 0.193, 1.0),
    (0.35, 0.236, 1.0), (0.4, 0.294, 1.0), (0.45, 0.363, 1.0), (0.5, 0.435, 1.0), (0.6, 0.587, 1.0),
    (0.7, 0.762, 1.0), (0.75, 0.88, 1.0), (0.8, 1.0, 1.0),
)  # fmt: skip


def translate(material: BlenderMaterial, report: Report, paint: Paint | None = None) -> Translated:
    """The material as a scene has it; with `paint` on a mesh that gives its nodes the colours of its vertices."""
    reader = _Translator(f"Material {material.name}", report, paint)
    if material.surface is None:
        keys = {
            "kind": "principled",
            "base_color": [min(max(float(c), 0.0), 1.0) for c in material.color[:3]],
            "metallic": material.metallic,
            "roughness": material.roughness,
        }
        return Translated(keys)
    if material.has_displacement:
        reader.say("displacement is left out; subdivide and displace by a modifier")
    if material.has_volume:
        reader.say("its volume is left out")
    keys = reader.surface(material.surface)
    return Translated(keys, reader.coordinates(), reader.takes_colors)


_Share = tuple[dict[str, Any], Field]
"""A surface of a mix, and its share."""


def _share_of_second(first: _Share, second: _Share) -> Field:
    """The share of the second of two surfaces in both."""
    return combine(lambda a, b: b / np.maximum(a + b, np.float32(1e-9)), first[1], second[1])


class _Translator(ValueReader):
    """The surfaces of one material."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._mixed: dict[int, tuple[list[dict[str, Any]], list[_Share]]] = {}  # by the list of a mix's materials

    def surface(self, node: Node) -> dict[str, Any]:
        """The material of a shader node."""
        found = _SURFACES.get(node.kind)
        if found is None:
            self.say(f"the shader {node.name} has no equal; matte grey stands in")
            return {"kind": "matte", "reflectance": 0.5}
        for name in node.inputs.keys() - KNOWN.get(node.kind, node.inputs.keys()):
            if self.counts(node, name):
                self.say(f"{name} is left out")
        return found(self, node)

    def shader(self, node: Node, name: str) -> Node | None:
        """The shader that is linked to an input."""
        link = node.inputs.get(name)
        return link.node if isinstance(link, Link) else None

    def principled(self, node: Node) -> dict[str, Any]:
        """The Principled BSDF."""
        keys: dict[str, Any] = {"kind": "principled"}
        base, transmission = self.field(node, "Base Color"), self.field(node, "Transmission Weight")
        is_clear = not transmission.is_constant or transmission.number > 0
        if is_clear and transmission.is_constant and transmission.number == 1:
            base = combine(lambda c: np.sqrt(np.clip(c, 0, 1)), base)  # each passage takes the root, both the colour
        elif is_clear:
            self.say("partly transparent: light that passes takes the base colour at each of its two passages")
        for key, name in (("metallic", "Metallic"), ("roughness", "Roughness")):
            keys[key] = self.number(node, name)
        # Cycles cuts the colours of a metal, too
        keys["base_color"] = texture_of(base, 3) if keys["metallic"] == 1 else self.cut(base)
        index = max(self.constant(node, "IOR", "the index"), 1e-3)
        keys["index"] = self._index(node, index, is_clear)
        if keys["index"] == 1.0:
            keys["specular"] = 0.0  # grazing light is not reflected either
        self._colour_of_specular(node, keys)
        if is_clear:
            keys["transmission"] = texture_of(transmission, 1)
            if isinstance(keys["roughness"], float) and keys["roughness"] < SMOOTHEST:
                if keys["transmission"] == 1 and keys["metallic"] == 0 and not self._has_more(node, keys):
                    keys = {"kind": "dielectric", "index": keys["index"]} | self._tint("transmittance", base)
                    return keys | self._holes(node) | self._normals(node)
                self.say(f"clear, and more than glass: its roughness is {SMOOTHEST} at least")
        self._say_distribution(node, keys["roughness"])
        self._layers(node, keys)
        self._emission(node, keys)
        return keys | self._holes(node) | self._normals(node)

    def _has_more(self, node: Node, keys: dict[str, Any]) -> bool:
        """Whether a clear principled surface is more than a dielectric with a tint."""
        layers = any(self.counts(node, name) for name in ("Coat Weight", "Sheen Weight"))
        return layers or self.counts(node, "Emission Strength") or "specular_color" in keys

    def _say_distribution(self, node: Node, roughness: Any) -> None:
        if node.values.get("distribution") == "GGX" and not (isinstance(roughness, float) and roughness <= 0.3):
            self.say("light that meets its facets twice is kept, as with the distribution Multiscatter GGX")

    def _index(self, node: Node, index: float, is_clear: bool) -> float:
        """The index that has the reflectance of Blender's index and specular level together."""
        level = self.constant(node, "Specular IOR Level", "the specular level")
        if level == 0.5:
            return max(index, 1.01) if is_clear else max(index, 1.0)
        f0 = min(((index - 1) / (index + 1)) ** 2 * 2 * level, 0.99)
        if is_clear:
            self.say("clear with a specular level that is not 0.5: the level is left out")
            return max(index, 1.01)
        return (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))

    def _colour_of_specular(self, node: Node, keys: dict[str, Any]) -> None:
        tint = self.field(node, "Specular Tint", (1.0, 1.0, 1.0))
        if not tint.is_constant or float(np.abs(tint.colour - 1).max()) > 0:
            keys["specular_color"] = self.cut(tint)
            if keys["metallic"] != 0.0:
                self.say("the specular tint colours its dielectric part, not the rim of the metal")

    def _layers(self, node: Node, keys: dict[str, Any]) -> None:
        """Coat, sheen, brushing; what has no equal."""
        if self.counts(node, "Anisotropic"):
            keys["anisotropy"] = min(max(self.constant(node, "Anisotropic", "the anisotropy"), 0.0), 1.0)
            turn = self.constant(node, "Anisotropic Rotation", "the anisotropic rotation")
            if turn:
                keys["anisotropy_rotation_degrees"] = 360 * (turn % 1)
            self.say("brushed along its texture coordinates, whatever its tangent says")
        if self.counts(node, "Coat Weight"):
            keys["clearcoat"] = self.number(node, "Coat Weight")
            keys["clearcoat_roughness"] = self.number(node, "Coat Roughness")
            if self.constant(node, "Coat IOR", "the coat's index") != 1.5:
                self.say("its coat has the index 1.5")
            if not self.is_white(node, "Coat Tint"):
                self.say("its coat is clear, without a tint")
            keys |= {"clearcoat_flat": True} if self._normals(node, quiet=True) else {}
        if self.counts(node, "Sheen Weight"):
            tint, weight = self.field(node, "Sheen Tint", (1.0, 1.0, 1.0)), self.field(node, "Sheen Weight")
            keys |= self._fibres(node, "Sheen Roughness", combine(lambda a, b: rgb(a) * grey(b), tint, weight))
        if self.counts(node, "Subsurface Weight"):
            self.say("subsurface scattering is left out: its base scatters at the surface")
        if self.counts(node, "Diffuse Roughness"):
            self.say("its base is even (Lambert), without a roughness of its own")
        if self.counts(node, "Thin Film Thickness"):
            self._film(node, keys)

    def _film(self, node: Node, keys: dict[str, Any]) -> None:
        """A film in which light interferes."""
        reflects = ("metallic", "specular_color", "base_color" if keys["metallic"] != 0 else "metallic")
        if keys.get("transmission", 0.0) != 0 or any(isinstance(keys.get(name), dict) for name in reflects):
            self.say("its thin film is left out, as it is clear or reflects by a texture")
            return
        thickness = self.constant(node, "Thin Film Thickness", "the thickness of its film")
        index = self.constant(node, "Thin Film IOR", "the index of its film")
        keys["thin_film"] = {"thickness_nm": min(thickness, 20_000.0), "index": min(max(index, 1.0), 5.0)}

    def _emission(self, node: Node, keys: dict[str, Any]) -> None:
        strength, colour = self.field(node, "Emission Strength"), self.field(node, "Emission Color")
        if strength.is_constant and strength.number <= 0:
            return
        light = combine(lambda a, b: rgb(a) * grey(b), colour, strength)
        if light.is_constant and not light.colour.any():
            return
        keys |= {"emission": self.radiance(light), "two_sided": True}

    def radiance(self, light: Field) -> Any:
        """A radiance that may be above 1, of pictures too."""
        if light.is_constant:
            return [float(min(max(c, 0.0), MOST_RADIANCE)) for c in light.colour]
        return texture_of(light, 3, MOST_RADIANCE)

    def diffuse(self, node: Node) -> dict[str, Any]:
        """Diffuse BSDF."""
        if self.counts(node, "Roughness"):
            self.say("diffuse with a roughness: even (Lambert) here")
        return {"kind": "matte", "reflectance": self.colour(node, "Color")} | self._normals(node)

    def scattering(self, node: Node) -> dict[str, Any]:
        """What scatters inside, as a matte surface."""
        self.say(f"{node.name}: it scatters at the surface, as matte, and lets no light through")
        return {"kind": "matte", "reflectance": self.colour(node, "Color")} | self._normals(node)

    def translucent(self, node: Node) -> dict[str, Any]:
        """Translucent BSDF."""
        keys = {"kind": "translucent", "reflectance": 0.0, "transmittance": self.colour(node, "Color")}
        return keys | self._normals(node)

    def sheen(self, node: Node) -> dict[str, Any]:
        """Sheen and velvet without a base."""
        if node.values.get("distribution", "MICROFIBER") != "MICROFIBER":
            self.say(f"its {node.values['distribution'].title()} sheen is of fibres here")
        keys = {"kind": "principled", "base_color": 0.0, "specular": 0.0}
        return keys | self._fibres(node, "Roughness", self.field(node, "Color")) | self._normals(node)

    def _fibres(self, node: Node, name: str, colour: Field) -> dict[str, Any]:
        """The sheen that sends back as much even light as Blender's, of other fibres."""
        roughness = min(max(self.constant(node, name, "its sheen's roughness"), 0.0), 1.0)
        self.say(
            "its sheen is of other fibres than Blender's: as much light from all sides, another share of one lamp's"
        )
        of_blender, ours, share = np.array(SHEEN).T
        if roughness > of_blender[-1]:
            self.say(f"its sheen is as of roughness {of_blender[-1]}, the strongest here")
        factor = float(np.interp(roughness, of_blender, share))
        lit = combine(lambda c: rgb(c) * np.float32(factor), colour) if factor < 1 else colour
        return {"sheen": self.cut(lit), "sheen_roughness": float(np.interp(roughness, of_blender, ours))}

    def glossy(self, node: Node) -> dict[str, Any]:
        """Glossy BSDF."""
        roughness = self.constant(node, "Roughness", "the roughness of a glossy surface")
        if roughness**2 < 1e-3:
            colour = self.field(node, "Color")
            if not colour.is_constant:
                self.say("a mirror has one colour: the mean of its texture")
            return {"kind": "mirror", "reflectance": self.cut(constant(colour.colour))}
        if node.values.get("distribution", "GGX") not in ("GGX", "MULTI_GGX"):
            self.say(f"its {node.values['distribution'].title()} highlights are GGX here")
        self._say_distribution(node, roughness)
        keys = {"kind": "conductor", "reflectance": self.colour(node, "Color"), "roughness": min(roughness, 1.0)}
        anisotropy = self.constant(node, "Anisotropy", "the anisotropy") if "Anisotropy" in node.inputs else 0.0
        if anisotropy:
            self.say("its highlights are round: the anisotropy of the glossy shader is left out")
        return keys | self._normals(node)

    def metallic(self, node: Node) -> dict[str, Any]:
        """Metallic BSDF: a metal by its colour, or by its optical constants."""
        roughness = min(max(self.constant(node, "Roughness", "the roughness of a metal"), SMOOTHEST), 1.0)
        self._say_distribution(node, roughness)
        keys: dict[str, Any] = {"roughness": roughness, "anisotropy": 0.0}
        if self.counts(node, "Anisotropy"):
            keys["anisotropy"] = min(max(self.constant(node, "Anisotropy", "the anisotropy"), 0.0), 1.0)
            keys["anisotropy_rotation_degrees"] = 360 * (self.constant(node, "Rotation", "the rotation") % 1)
            self.say("brushed along its texture coordinates, whatever its tangent says")
        is_measured = node.values.get("fresnel_type") == "PHYSICAL_CONDUCTOR"
        one, other = ("IOR", "Extinction") if is_measured else ("Base Color", "Edge Tint")
        fields = self.field(node, one), self.field(node, other, (1.0, 1.0, 1.0))
        is_even = all(each.is_constant for each in fields)
        if not is_measured and not is_even:
            if not self.is_white(node, other):
                self.say("a metal by a texture: its rim is white (Schlick), without the edge tint")
            keys |= {"kind": "principled", "metallic": 1.0, "base_color": texture_of(fields[0], 3)}
            return keys | self._normals(node)
        if not is_even:
            self.say("its optical constants are the means of their textures")
        index, absorbs = (np.broadcast_to(each.colour, 3) for each in fields)
        if not is_measured:
            index, absorbs = metal_of(index, absorbs)
        metal = {"n": np.clip(index, *OF_METALS).tolist(), "k": np.clip(absorbs, *OF_METALS).tolist()}
        return {"kind": "conductor", "metal": metal} | keys | self._normals(node)

    def _tint(self, key: str, colour: Field) -> dict[str, Any]:
        """A colour of glass under its key; nothing where it is white."""
        white = colour.is_constant and float(colour.colour.min()) == float(colour.colour.max()) == 1
        return {} if white else {key: self.cut(colour)}

    def glass(self, node: Node) -> dict[str, Any]:
        """Glass and Refraction BSDF."""
        if node.kind == "BSDF_REFRACTION":
            self.say("the refraction shader also reflects here, as glass does")
        return self._glass(node)

    def _glass(self, node: Node) -> dict[str, Any]:
        index = min(max(self.constant(node, "IOR", "the index"), 0.2), 5.0)
        roughness = self.constant(node, "Roughness", "the roughness of glass")
        colour = self.field(node, "Color")
        rough = {"roughness": min(roughness, 1.0)} if roughness**2 >= 1e-3 else {}
        if rough and abs(index - 1) <= 0.01:
            index = 1.011
        self._say_distribution(node, roughness)
        tints = self._tint("reflectance", colour) | self._tint("transmittance", colour)  # both, as Cycles has it
        return {"kind": "dielectric", "index": index} | rough | tints | self._normals(node)

    def hair(self, node: Node) -> dict[str, Any]:
        """Principled Hair BSDF."""
        keys: dict[str, Any] = {"kind": "hair"}
        if node.values.get("model", "CHIANG") != "CHIANG":
            self.say("hair of Huang's model is of Chiang's here")
        way = node.values.get("parametrization", "COLOR")
        if way == "COLOR":
            keys["reflectance"] = [min(max(float(c), 1e-4), 0.999) for c in self._mean(node, "Color")]
        elif way == "ABSORPTION":
            keys["absorption"] = [max(float(c), 0.0) for c in self._mean(node, "Absorption Coefficient")]
        else:
            melanin, red = (self.constant(node, name, name.lower()) for name in ("Melanin", "Melanin Redness"))
            amount = -math.log(max(1 - min(melanin, 1.0), 1e-4))
            brown, ruddy = amount * (1 - red), amount * red
            pairs = zip((0.506, 0.841, 1.653), (0.343, 0.733, 1.924), strict=True)  # as the node documents them
            keys["absorption"] = [brown * one + ruddy * other for one, other in pairs]
            if not self.is_white(node, "Tint"):
                self.say("the tint of hair by melanin is left out")
        for key, name in (("roughness", "Roughness"), ("roughness_across", "Radial Roughness")):
            keys[key] = min(max(self.constant(node, name, name.lower()), 0.01), 1.0)
        keys["index"] = min(max(self.constant(node, "IOR", "the index"), 1.01), 3.0)
        tilt = math.degrees(self.constant(node, "Offset", "the offset"))
        keys["tilt_degrees"] = min(max(tilt, -10.0), 10.0)
        for name in ("Coat", "Random Color", "Random Roughness"):
            if self.counts(node, name):
                self.say(f"{name} of hair is left out")
        return keys

    def _mean(self, node: Node, name: str) -> Any:
        value = self.field(node, name)
        if not value.is_constant:
            self.say(f"{name} of hair is the mean of its texture")
        return np.broadcast_to(value.colour, 3)

    def transparent(self, node: Node) -> dict[str, Any]:
        """Transparent BSDF."""
        colour = self.field(node, "Color")
        if not colour.is_constant:
            self.say("transparent: the mean of its colours is taken")
        if float(colour.colour.min()) >= 1:
            return dict(NO_SURFACE)
        return {"kind": "thin_glass", "index": 1.0, "transmittance": [float(min(max(c, 0), 1)) for c in colour.colour]}

    def emission(self, node: Node) -> dict[str, Any]:
        """Emission, from both sides."""
        light = combine(lambda a, b: rgb(a) * grey(b), self.field(node, "Color"), self.field(node, "Strength"))
        return {"kind": "emissive", "radiance": self.radiance(light), "two_sided": True}

    def holdout(self, node: Node) -> dict[str, Any]:
        """Holdout."""
        self.say("holdout: black here, and alpha is not cut out")
        return dict(BLACK)

    def mix(self, node: Node) -> dict[str, Any]:
        """Mix Shader: holes, emission beside a surface, or a mix of two."""
        first, second = self.shader(node, "Shader"), self.shader(node, "Shader_001")
        if (glass := self._glass_by_hand(node, first, second)) is not None:
            return glass
        factor = self.field(node, "Fac")
        if factor.is_constant and factor.number <= 0:
            return self.surface(first) if first else dict(BLACK)
        if factor.is_constant and factor.number >= 1:
            return self.surface(second) if second else dict(BLACK)
        ends = [self.surface(each) if each else dict(BLACK) for each in (first, second)]
        inverse = combine(lambda f: 1 - grey(f), factor)
        for seen, other, share in ((ends[1], ends[0], factor), (ends[0], ends[1], inverse)):
            if other == NO_SURFACE:
                return self._with_holes(seen, share)
        for lamp, other, share in ((ends[1], ends[0], factor), (ends[0], ends[1], inverse)):
            if lamp["kind"] == "emissive":
                return self._lamp_beside(lamp, other, share)
        return self._mix_of_two(ends, factor)

    def _glass_by_hand(self, node: Node, first: Node | None, second: Node | None) -> dict[str, Any] | None:
        """What a Fresnel node mixes of refraction and gloss of one index and roughness: glass of both colours."""
        link = node.inputs.get("Fac")
        if not isinstance(link, Link) or link.node.kind != "FRESNEL" or first is None or second is None:
            return None
        if (first.kind, second.kind) not in (
            ("BSDF_REFRACTION", "BSDF_GLOSSY"),
            ("BSDF_REFRACTION", "BSDF_ANISOTROPIC"),
        ):
            return None
        index, other = (self.constant(each, "IOR", "the index") for each in (link.node, first))
        rough, glossy = (self.constant(each, "Roughness", "the roughness of glass") for each in (first, second))
        if abs(index - other) > 1e-3 or abs(rough - glossy) > 1e-3:
            return None
        tints = self._tint("transmittance", self.field(first, "Color")) | self._tint(
            "reflectance", self.field(second, "Color")
        )
        keys = {key: value for key, value in self._glass(first).items() if key in ("kind", "index", "roughness")}
        return keys | tints | self._normals(first)

    def _with_holes(self, keys: dict[str, Any], share: Field) -> dict[str, Any]:
        if keys.get("opacity", 1.0) != 1.0:
            self.say("holes within holes: those of the inner shader are left out")
        return keys | {"opacity": texture_of(share, 1)}

    def _mix_of_two(self, ends: list[dict[str, Any]], factor: Field) -> dict[str, Any]:
        """A mix; of one with mixes in it all surfaces by their shares, until there are two."""
        leaves: list[_Share] = []
        for each, share in zip(ends, (combine(lambda f: 1 - grey(f), factor), combine(grey, factor)), strict=True):
            if "opacity" in each:
                self.say("a mix of surfaces with holes: these are left out")
            if each["kind"] == "emissive":
                self.say("emission in a mix within a mix is left out")
            own = dict(BLACK) if each["kind"] == "emissive" else {k: v for k, v in each.items() if k != "opacity"}
            if own["kind"] == "mix":
                leaves += [
                    (leaf, combine(np.multiply, share, part)) for leaf, part in self._mixed[id(own["materials"])][1]
                ]
            else:
                leaves.append((own, share))
        if len(leaves) > 2:
            while len(leaves) > 2:
                leaves = self._fewer(leaves)
            factor = _share_of_second(*leaves)
        materials = [leaf for leaf, _ in leaves]
        self._mixed[id(materials)] = materials, leaves
        return {"kind": "mix", "materials": materials, "factor": texture_of(factor, 1)}

    def _fewer(self, leaves: list[_Share]) -> list[_Share]:
        """Shares of surfaces with two mattes as one of their mean; where there are not two, without the least."""
        matte = [leaf for leaf in leaves if leaf[0].keys() == {"kind", "reflectance"} and leaf[0]["kind"] == "matte"]
        if len(matte) < 2:
            self.say("a mix of more than two surfaces: the one with the smallest share is left out")
            least = min(leaves, key=lambda leaf: leaf[1].number)
            return [leaf for leaf in leaves if leaf is not least]
        first, second = matte[:2]
        one, two, amount = (
            first[0]["reflectance"],
            second[0]["reflectance"],
            texture_of(_share_of_second(first, second), 1),
        )
        colour: Any = {"kind": "mixture", "first": one, "second": two, "amount": amount}
        if not any(isinstance(each, dict) for each in (one, two, amount)):
            colour = (np.broadcast_to(one, 3) * (1 - amount) + np.broadcast_to(two, 3) * amount).tolist()
        elif not isinstance(amount, dict):
            colour["amount"] = [amount] * 3
        mean = {"kind": "matte", "reflectance": colour}, combine(np.add, first[1], second[1])
        return [mean, *(leaf for leaf in leaves if leaf is not first and leaf is not second)]

    def _lamp_beside(self, lamp: dict[str, Any], other: dict[str, Any], share: Field) -> dict[str, Any]:
        """Emission mixed with a surface that scatters: both by their shares."""
        if not isinstance(lamp["radiance"], list) or not share.is_constant:
            self.say("emission mixed by a texture: the surface shines with the mean")
        radiance = lamp["radiance"] if isinstance(lamp["radiance"], list) else [1.0, 1.0, 1.0]
        light = [channel * share.number for channel in radiance]
        self.say("emission mixed with a surface: its surface is darker by its share")
        if other["kind"] == "matte" and not isinstance(other["reflectance"], dict):
            base = np.broadcast_to(np.array(other["reflectance"], np.float64), 3) * (1 - share.number)
            shines = {"emission": light, "two_sided": True}
            return {"kind": "principled", "base_color": base.tolist(), "specular": 0.0, **shines}
        if other["kind"] == "principled":
            return self._principled_beside(other, light, share.number)
        self.say("what its emission is mixed with is left out")
        return lamp | {"radiance": light}

    def _principled_beside(self, keys: dict[str, Any], light: list[float], share: float) -> dict[str, Any]:
        """A principled surface beside a light that takes its share: as much darker, its holes closed by as much."""
        left, opacity = 1 - share, keys.get("opacity", 1.0)
        whole = left * opacity + share if isinstance(opacity, float) else 1.0
        left = left * opacity / whole if isinstance(opacity, float) else left

        def dim(value: Any) -> Any:
            if isinstance(value, dict):
                return {"kind": "mixture", "second": value, "amount": [left] * 3}
            return (np.asarray(value) * left).tolist()

        layers = {key: dim(keys[key]) for key in ("base_color", "clearcoat", "sheen") if key in keys}
        layers["specular"] = dim(keys.get("specular", 1.0))
        own = {"opacity": whole} if whole < 1 else {}
        kept = {key: value for key, value in keys.items() if key != "opacity" or isinstance(value, dict)}
        shines = {"emission": self._joined(keys, [c / whole for c in light], left), "two_sided": True}
        return kept | layers | own | shines

    def _joined(self, keys: dict[str, Any], light: list[float], left: float = 1.0) -> list[float]:
        """A light and what is left of that of a surface; one by a texture is left out, which is said."""
        own = keys.get("emission", [0.0, 0.0, 0.0])
        if isinstance(own, dict):
            self.say("of two emissions the one by a texture is left out")
            return light
        return [left * one + other for one, other in zip(own, light, strict=True)]

    def add(self, node: Node) -> dict[str, Any]:
        """Add Shader: emission over a surface; of two surfaces a mix of twice the light is not possible."""
        ends = [self.surface(each) for name in ("Shader", "Shader_001") if (each := self.shader(node, name))]
        ends = [each for each in ends if each != NO_SURFACE or len(ends) == 1]
        if len(ends) < 2:
            return ends[0] if ends else dict(BLACK)
        lamps = [each for each in ends if each["kind"] == "emissive"]
        others = [each for each in ends if each["kind"] != "emissive"]
        if len(lamps) == 2:
            self.say("two emissions added: the first counts")
            return lamps[0]
        if lamps:
            return self._lamp_over(lamps[0], others[0])
        self.say("two shaders added: mixed half and half here")
        return self._mix_of_two(ends, constant(0.5))

    def _lamp_over(self, lamp: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
        if other["kind"] == "matte":
            kept = {key: value for key, value in other.items() if key not in ("kind", "reflectance")}
            base = {"kind": "principled", "base_color": other["reflectance"], "specular": 0.0}
            return base | kept | {"emission": lamp["radiance"], "two_sided": True}
        if other["kind"] == "principled":
            textured = isinstance(lamp["radiance"], dict)
            if textured and "emission" in other:
                self.say("of two emissions that of the principled surface is left out")
            light = lamp["radiance"] if textured else self._joined(other, lamp["radiance"])
            return other | {"emission": light, "two_sided": True}
        self.say("what it is added to is left out")
        return lamp

    def _holes(self, node: Node) -> dict[str, Any]:
        alpha = self.field(node, "Alpha", 1.0)
        if alpha.is_constant and alpha.number >= 1:
            return {}
        return {"opacity": texture_of(alpha, 1)}

    def _normals(self, node: Node, quiet: bool = False) -> dict[str, Any]:
        """The normal map behind an input Normal."""
        link = node.inputs.get("Normal")
        if not isinstance(link, Link):
            return {}
        source = link.node
        if source.kind == "NORMAL_MAP":
            return self._normal_map(source, quiet)
        if source.kind == "BUMP":
            return self._bump(source, quiet)
        if not quiet:
            self.say(f"normals by {source.name} are left out")
        return {}

    def _normal_map(self, node: Node, quiet: bool) -> dict[str, Any]:
        if node.values.get("space", "TANGENT") != "TANGENT":
            if not quiet:
                self.say("a normal map that is not in tangent space is left out")
            return {}
        picture = self.field(node, "Color")
        if picture.is_constant:
            return {}
        texture = texture_of(picture, 3)
        texture.pop("channel", None)
        strength = self.constant(node, "Strength", "the strength of its normal map")
        return {"normal_map": texture | {"strength": min(max(strength, 0.0), 10.0)}}

    def _bump(self, node: Node, quiet: bool) -> dict[str, Any]:
        """A normal map made of a picture of heights."""
        height = self.field(node, "Height", 1.0)
        if height.is_constant:
            return {}
        strength = self.constant(node, "Strength", "the strength of its bumps")
        distance = self.constant(node, "Distance", "the height of its bumps")
        size = node.values.get("uv_size", 1.0)  # of a unit of texture coordinates [units of the scene]
        if not quiet:
            self.say(
                f"bumps are a normal map here, made for texture coordinates of {size:.3g} units; on other objects they "
                "are as much steeper or flatter"
            )
        sign = -1.0 if node.values.get("invert") else 1.0
        normals = _normals_of_heights(grey(height.values)[..., 0], height, sign * strength * distance / size)
        texture = texture_of(replace(height, values=normals, codes=None), 3)
        return {"normal_map": texture}


def for_strands(keys: dict[str, Any], name: str, report: Report) -> dict[str, Any]:
    """A material as curves can have it."""

    def plain(value: Any) -> Any:
        """The mean of a texture."""
        found = value
        while isinstance(found, dict):
            found = found.get("mean", 0.5)
        return found

    kind = keys["kind"]
    if kind == "hair" or (kind in ("matte", "translucent") and "opacity" not in keys):
        return {key: value for key, value in keys.items() if key != "normal_map"}
    colour = next((keys[key] for key in ("base_color", "reflectance", "transmittance") if key in keys), 0.5)
    if kind in ("principled", "conductor", "plastic") and not {"opacity", "transmission", "emission"} & keys.keys():
        return {key: value for key, value in keys.items() if key != "normal_map"}
    report.add(f"Material {name}: on strands it is matte, as {kind} is of faces alone.")
    return {"kind": "matte", "reflectance": plain(colour) if isinstance(colour, dict) else colour}


def without_hair(keys: dict[str, Any]) -> dict[str, Any]:
    """A matte material for faces that have one of hair."""
    return {"kind": "matte", "reflectance": keys.get("reflectance", 0.2)}


def metal_of(facing: Any, edge: Any) -> tuple[Any, Any]:
    """Optical constants n and k [channels] of a metal that has a colour seen straight on, and a tint at its rim.

    The tint is a factor on Schlick's curve where the cosine is 1/7, as in Blender; else the nearest.
    """
    f0 = np.clip(facing, 1e-4, 0.9999)
    root, cosine = np.sqrt(f0), 1 / 7
    wanted = (f0 + (1 - f0) * (1 - cosine) ** 5) * np.clip(edge, 0, 1)
    low, high = (1 - f0) / (1 + f0), (1 + root) / (1 - root)  # of what absorbs the most, and of what is clear

    def absorption(n: Any) -> Any:
        return np.sqrt(np.maximum((f0 * (n + 1) ** 2 - (n - 1) ** 2) / (1 - f0), 0))

    for _ in range(60):
        n = (low + high) / 2
        is_bright = conductor_reflectance(n, absorption(n), cosine) > wanted
        low, high = np.where(is_bright, n, low), np.where(is_bright, high, n)
    return n, absorption(n)


def conductor_reflectance(n: Any, k: Any, cosine: float) -> Any:
    """Fresnel's reflectance of unpolarised light by a metal in air."""
    eta, c = n + 1j * k, cosine
    inside = np.sqrt(eta**2 - (1 - c * c))
    across, along = (c - inside) / (c + inside), (eta**2 * c - inside) / (eta**2 * c + inside)
    return (np.abs(across) ** 2 + np.abs(along) ** 2) / 2


def _normals_of_heights(heights: Any, picture: Field, gain: float) -> Any:
    """Codes of a normal map of heights over texture coordinates."""
    rows, columns = heights.shape
    du = (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) * (columns / 2 * abs(picture.mapping.scale[0]))
    dv = (np.roll(heights, 1, 0) - np.roll(heights, -1, 0)) * (rows / 2 * abs(picture.mapping.scale[1]))
    normals = np.stack([-gain * du, -gain * dv, np.ones_like(heights)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return (0.5 + 0.5 * normals).astype(np.float32)


_SURFACES: MappingOf[str, Callable[[_Translator, Node], dict[str, Any]]] = {
    "BSDF_PRINCIPLED": _Translator.principled,
    "BSDF_DIFFUSE": _Translator.diffuse,
    "BSDF_GLOSSY": _Translator.glossy,
    "BSDF_ANISOTROPIC": _Translator.glossy,
    "BSDF_METALLIC": _Translator.metallic,
    "BSDF_GLASS": _Translator.glass,
    "BSDF_REFRACTION": _Translator.glass,
    "BSDF_TRANSPARENT": _Translator.transparent,
    "BSDF_TRANSLUCENT": _Translator.translucent,
    "SUBSURFACE_SCATTERING": _Translator.scattering,
    "BSDF_SHEEN": _Translator.sheen,
    "BSDF_HAIR_PRINCIPLED": _Translator.hair,
    "EMISSION": _Translator.emission,
    "BACKGROUND": _Translator.emission,
    "HOLDOUT": _Translator.holdout,
    "MIX_SHADER": _Translator.mix,
    "ADD_SHADER": _Translator.add,
}
