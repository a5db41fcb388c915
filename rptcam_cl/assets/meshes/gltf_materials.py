"""Materials of glTF files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.file_material import Colour, FileMaterial, FileTexture, Wrap
from rptcam_cl.assets.meshes.gltf_data import Data
from rptcam_cl.assets.meshes.gltf_json import JsonNode
from rptcam_cl.assets.meshes.mesh import MeshSurface
from rptcam_cl.assets.meshes.vertex_colours import MOST_TRIANGLES, painted

WRAPS: dict[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
NEAREST = 9728
PICTURES = ("image/png", "image/jpeg", "image/webp", "")
WEBP = "EXT_texture_webp"

FOLLOWED = (
    "KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_materials_emissive_strength", "KHR_materials_ior",
    "KHR_materials_sheen", "KHR_materials_specular", "KHR_materials_transmission", "KHR_materials_unlit",
    "KHR_materials_volume",
)  # fmt: skip


class GltfMaterials:
    """The materials of a glTF file.

    Attributes
    ----------
    materials : list of FileMaterial
        The last one is for primitives that have none.
    uv_sets : list of int
        Which set of texture coordinates each uses.
    notes : list of str
        What of them is left out.
    """

    def __init__(self, document: JsonNode, data: Data) -> None:
        self._data = data
        self._textures = document.parts("textures")
        self._images = document.parts("images")
        self._samplers = document.parts("samplers")
        self._contents: dict[str, Path | bytes] = {}
        self._count = len(document.parts("materials"))
        self.materials: list[FileMaterial] = []
        self.uv_sets: list[int] = []
        self.notes: list[str] = []
        for part in [*document.parts("materials"), JsonNode({}, "the default material")]:
            self._sets: dict[str, int] = {}
            material = self._material(part)
            uv_set = next(iter(self._sets.values()), 0)
            for key, other in self._sets.items():
                if other != uv_set:
                    self.notes.append(f"{part.place}: {key} is shown by the texture coordinates of the first texture")
            self.materials.append(material)
            self.uv_sets.append(uv_set)

    def index(self, primitive: JsonNode) -> int:
        """Return the material of a primitive."""
        return primitive.whole("material", below=self._count) if primitive.has("material") else self._count

    def painted(self, surface: MeshSurface, colours: NDArray[np.float32], primitive: JsonNode) -> MeshSurface:
        """Return a surface of a primitive in a material of its own that has the colours of the vertices."""
        assert surface.material is not None
        material = self.materials[surface.material]
        if material.has_textures and surface.uvs is not None:
            self.notes.append(f"{primitive.place}: colours of vertices are left out beside a texture")
            return surface
        if len(surface.faces) > MOST_TRIANGLES:
            self.notes.append(f"{primitive.place}: colours of more than {MOST_TRIANGLES} triangles are left out")
            return surface
        surface, texture = painted(surface, colours)
        self.materials.append(replace(material.without_textures(), base_texture=texture))
        return replace(surface, material=len(self.materials) - 1)

    def _material(self, part: JsonNode) -> FileMaterial:
        surface = part.part("pbrMetallicRoughness")
        *color, alpha = (min(1.0, max(0.0, value)) for value in surface.numbers("baseColorFactor", (1.0,) * 4))
        mode = part.text("alphaMode", "OPAQUE")
        if mode not in ("OPAQUE", "MASK", "BLEND"):
            raise part.wrong("alphaMode", "is not known", "OPAQUE, MASK, BLEND")
        base = self._texture(surface, "baseColorTexture")
        facets = self._texture(surface, "metallicRoughnessTexture")
        material = FileMaterial(
            name=part.text("name"),
            base_color=_colour(color),
            base_texture=base,
            metallic=surface.number("metallicFactor", 1.0, 0, 1),
            metallic_texture=facets,
            roughness=surface.number("roughnessFactor", 1.0, 0, 1),
            roughness_texture=facets,
            opacity=1.0 if mode == "OPAQUE" else alpha,
            opacity_texture=None if mode == "OPAQUE" else base,
            opacity_cutoff=part.number("alphaCutoff", 0.5, 0) if mode == "MASK" else None,
            normals=self._texture(part, "normalTexture"),
            normals_strength=part.part("normalTexture").number("scale", 1.0),
            emission=_colour(part.numbers("emissiveFactor", (0.0,) * 3)),
            emission_texture=self._texture(part, "emissiveTexture"),
            both_sides=part.flag("doubleSided"),
        )
        return self._extended(part, material)

    def _extended(self, part: JsonNode, material: FileMaterial) -> FileMaterial:
        """Return a material with what the extensions add."""
        for strength in part.extensions("KHR_materials_emissive_strength"):
            factor = strength.number("emissiveStrength", 1.0, 0)
            material = replace(material, emission=_colour([factor * value for value in material.emission]))
        for index in part.extensions("KHR_materials_ior"):
            material = replace(material, index=index.number("ior", 1.5, 0) or math.inf)
        for specular in part.extensions("KHR_materials_specular"):
            material = replace(
                material,
                specular=specular.number("specularFactor", 1.0, 0, 1),
                specular_texture=self._texture(specular, "specularTexture"),
                specular_color=_colour(specular.numbers("specularColorFactor", (1.0,) * 3)),
                specular_color_texture=self._texture(specular, "specularColorTexture"),
            )
        for volume in part.extensions("KHR_materials_volume"):
            material = replace(material, **_volume(volume))
        for transmission in part.extensions("KHR_materials_transmission"):
            material = replace(material, transmission=transmission.number("transmissionFactor", 0.0, 0, 1))
            if material.metallic_texture is not None and not material.solid:
                self._leave_out(transmission, "transmissionTexture")
            else:
                texture = self._texture(transmission, "transmissionTexture")
                material = replace(material, transmission_texture=texture)
        for coat in part.extensions("KHR_materials_clearcoat"):
            material = replace(
                material,
                clearcoat=coat.number("clearcoatFactor", 0.0, 0, 1),
                clearcoat_texture=self._texture(coat, "clearcoatTexture"),
                clearcoat_roughness=coat.number("clearcoatRoughnessFactor", 0.0, 0, 1),
                clearcoat_roughness_texture=self._texture(coat, "clearcoatRoughnessTexture"),
                clearcoat_normals=self._texture(coat, "clearcoatNormalTexture"),
                clearcoat_normals_strength=coat.part("clearcoatNormalTexture").number("scale", 1.0),
                clearcoat_flat=True,
            )
        for sheen in part.extensions("KHR_materials_sheen"):
            material = replace(
                material,
                sheen=_colour(sheen.numbers("sheenColorFactor", (0.0,) * 3)),
                sheen_texture=self._texture(sheen, "sheenColorTexture"),
                sheen_roughness=sheen.number("sheenRoughnessFactor", 0.0, 0, 1),
            )
            self._leave_out(sheen, "sheenRoughnessTexture")
        for stretch in part.extensions("KHR_materials_anisotropy"):
            turn = math.degrees(math.remainder(stretch.number("anisotropyRotation", 0.0), 2 * math.pi))
            material = replace(
                material,
                anisotropy=stretch.number("anisotropyStrength", 0.0, 0, 1),
                anisotropy_texture=self._texture(stretch, "anisotropyTexture"),
                anisotropy_rotation_degrees=turn,
            )
        for _ in part.extensions("KHR_materials_unlit"):
            material = replace(material, matte=True)
        for other in part.part("extensions").names():
            if other.startswith("KHR_materials_") and other not in FOLLOWED:
                self.notes.append(f"{part.place}: {other} is left out")
        return material

    def _leave_out(self, part: JsonNode, *keys: str) -> None:
        self.notes += [f"{part.place}.{key} is left out" for key in keys if part.has(key)]

    def _texture(self, part: JsonNode, key: str) -> FileTexture | None:
        """Return the picture of a texture reference, None when there is none that can be read."""
        if not part.has(key):
            return None
        reference = part.part(key)
        texture = plain = self._textures[reference.whole("index", below=len(self._textures))]
        texture = next((webp for webp in texture.extensions(WEBP) if webp.has("source")), texture)
        if not texture.has("source"):
            self.notes.append(f"{texture.place} has no PNG, JPEG or WebP picture and is left out")
            return None
        image = self._images[texture.whole("source", below=len(self._images))]
        if image.text("mimeType") not in PICTURES:
            self.notes.append(f"{image.place} is {image.text('mimeType')} and is left out")
            return None
        wrap, nearest = self._sampling(plain)
        self._sets[key] = reference.whole("texCoord", 0, below=100)
        found = FileTexture(self._content(image), _name(image), wrap=wrap, nearest=nearest)
        for transform in reference.extensions("KHR_texture_transform"):
            self._sets[key] = transform.whole("texCoord", self._sets[key], below=100)
            found = replace(found, **_laid(transform))
        return found

    def _content(self, image: JsonNode) -> Path | bytes:
        """Return the path of a picture, or its bytes; the same object for the same picture."""
        if image.place not in self._contents:
            if image.has("bufferView"):
                octets, _ = self._data.view(image.whole("bufferView", below=self._data.views))
                self._contents[image.place] = octets.tobytes()
            else:
                self._contents[image.place] = self._data.file_named_by(image)
        return self._contents[image.place]

    def _sampling(self, texture: JsonNode) -> tuple[Wrap, bool]:
        if not texture.has("sampler"):
            return "repeat", False
        sampler = self._samplers[texture.whole("sampler", below=len(self._samplers))]
        across, along = (WRAPS.get(sampler.whole(key, 10497)) for key in ("wrapS", "wrapT"))
        if across is None or along is None:
            raise sampler.wrong("wrapS" if across is None else "wrapT", "is not known", ", ".join(map(str, WRAPS)))
        if across != along:
            self.notes.append(f"{sampler.place}.wrapT is not as wrapS, which counts for both")
        return across, sampler.whole("magFilter", 0) == NEAREST


def _colour(values: Sequence[float]) -> Colour:
    red, green, blue = (max(0.0, value) for value in values)
    return (red, green, blue)


def _name(image: JsonNode) -> str:
    uri = "" if image.text("uri").startswith("data:") else image.text("uri")
    return (image.text("name") or uri or image.place.rpartition(" ")[2])[:200]


def _volume(volume: JsonNode) -> dict[str, Any]:
    """Return what KHR_materials_volume says: a solid where it has a thickness, and how it absorbs."""
    solid = volume.number("thicknessFactor", 0.0, 0) > 0
    distance = volume.number("attenuationDistance", math.inf, 0)
    colour = _colour(volume.numbers("attenuationColor", (1.0,) * 3))
    return {"solid": solid, "attenuation": (colour, distance) if 0 < distance < math.inf else None}


def _laid(transform: JsonNode) -> dict[str, Any]:
    """Return how KHR_texture_transform lays a picture, with v upwards.

    Its v runs downwards, where (u, v) goes to R S (u, v) + offset and R turns from v towards u; the example of its
    description ("the lower left quadrant, rotated clockwise") fixes the sense of the turn.
    """
    angle = transform.number("rotation", 0.0)
    across, along = transform.numbers("scale", (1.0, 1.0))
    u, v = transform.numbers("offset", (0.0, 0.0))
    cosine, sine = math.cos(angle), math.sin(angle)
    return {
        "scale": (across, along),
        "rotation_degrees": math.degrees(math.remainder(angle, 2 * math.pi)),
        "offset": (u + sine * along, 1 - v - cosine * along),
    }
