"""glTF 2.0 files, .gltf and .glb, at a time: meshes at their places in the tree of nodes, materials, cameras, lamps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LUMENS_PER_WATT  # glTF counts candelas and lux, a scene watts
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.gltf_data import (
    DRACO,
    FAN,
    MESHOPT,
    STRIP,
    TRIANGLES,
    Data,
    JsonNode,
    Vertices,
    read_container,
)
from rptcam_cl.scene.assets.mesh import LAMPS_LEFT_OUT, Draft, Find, MeshSurface, Node, Polygons, check_corners
from rptcam_cl.scene.file_materials import FileMaterial, FileTexture, Wrap
from rptcam_cl.scene.placement import SMALLEST_STRETCH_RATIO
from rptcam_cl.scene.quantities import Colour

# Materials of glTF files.

_WRAPS: dict[int, Wrap] = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST = 9728
_PICTURES = ("image/png", "image/jpeg", "image/webp", "")
WEBP = "EXT_texture_webp"

_FOLLOWED = (
    "KHR_materials_anisotropy", "KHR_materials_clearcoat", "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness", "KHR_materials_sheen", "KHR_materials_specular",
    "KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_volume", "KHR_materials_volume_scatter",
)  # fmt: skip


class _GltfMaterials:
    """The materials of a glTF file.

    Attributes
    ----------
    materials : list of FileMaterial
        The last one is for primitives that have none.
    opaque : list of bool
        Whether alpha does not count on each.
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
        self.opaque: list[bool] = []
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
            self.opaque.append(part.text("alphaMode", "OPAQUE") == "OPAQUE")
            self.uv_sets.append(uv_set)

    def index(self, primitive: JsonNode) -> int:
        """Return the material of a primitive."""
        return primitive.whole("material", below=self._count) if primitive.has("material") else self._count

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
        return self._add_extensions(part, material)

    def _add_extensions(self, part: JsonNode, material: FileMaterial) -> FileMaterial:
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
            solid = volume.number("thicknessFactor", 0.0, 0) > 0  # and no pane, where it has a thickness
            distance = volume.number("attenuationDistance", math.inf, 0)
            colour = _colour(volume.numbers("attenuationColor", (1.0,) * 3))
            absorbs = 0 < distance < math.inf
            material = replace(material, solid=solid, attenuation=(colour, distance) if absorbs else None)
        for transmission in part.extensions("KHR_materials_transmission"):
            material = replace(material, transmission=transmission.number("transmissionFactor", 0.0, 0, 1))
            if material.metallic_texture is not None and not material.solid:
                self._leave_out(transmission, "transmissionTexture")
            else:
                texture = self._texture(transmission, "transmissionTexture")
                material = replace(material, transmission_texture=texture)
        for gloss in part.extensions("KHR_materials_pbrSpecularGlossiness"):
            material = self._specular_gloss(gloss, material, part.text("alphaMode", "OPAQUE") == "OPAQUE")
        for scatter in part.extensions("KHR_materials_volume_scatter"):
            material = self._scatter(scatter, material)
        for diffuse in part.extensions("KHR_materials_diffuse_transmission"):
            material = self._diffuse_transmission(diffuse, material)
        for film in part.extensions("KHR_materials_iridescence"):
            self._leave_out(film, "iridescenceTexture", "iridescenceThicknessTexture")
            numbers = (("iridescenceFactor", 0.0), ("iridescenceIor", 1.3), ("iridescenceThicknessMaximum", 400.0))
            share, n, thickness = (film.number(key, default, 0) for key, default in numbers)
            material = replace(material, film=(min(share, 1.0), n, thickness) if share > 0 else None)
        for _ in part.extensions("KHR_materials_unlit"):
            material = replace(material, matte=True)
        for other in part.part("extensions").names():
            if other.startswith("KHR_materials_") and other not in _FOLLOWED:
                self.notes.append(f"{part.place}: {other} is left out")
        return self._add_layers(part, material)

    def _specular_gloss(self, gloss: JsonNode, material: FileMaterial, opaque: bool) -> FileMaterial:
        """Return a material whose base, metal and facets are by specular colour and glossiness.

        Its diffuse colour is what the largest channel of the specular colour leaves of diffuseFactor.
        """
        *diffuse, alpha = (min(1.0, max(0.0, value)) for value in gloss.numbers("diffuseFactor", (1.0,) * 4))
        specular = [min(1.0, max(0.0, value)) for value in gloss.numbers("specularFactor", (1.0,) * 3)]
        base, facets = (self._texture(gloss, key) for key in ("diffuseTexture", "specularGlossinessTexture"))
        left = 1 - max(specular) if facets is None else 1.0
        if facets is not None:
            self.notes.append(f"{gloss.place}: the painted specular colour does not darken the diffuse one")
        return replace(
            material,
            base_color=_colour([value * left for value in diffuse]),
            base_texture=base,
            metallic=0.0,
            metallic_texture=None,
            roughness=1 - gloss.number("glossinessFactor", 1.0, 0, 1),
            roughness_texture=None,
            gloss_texture=facets,
            index=1.5,
            specular=1.0,
            specular_texture=None,
            specular_color=_colour([value / 0.04 for value in specular]),  # an index of 1.5 reflects 0.04 head on
            specular_color_texture=facets,
            opacity=1.0 if opaque else alpha,
            opacity_texture=None if opaque else base,
        )

    def _scatter(self, scatter: JsonNode, material: FileMaterial) -> FileMaterial:
        """Return a material whose inside scatters, where light gets there as by glass."""
        key = "multiscatterColorFactor" if scatter.has("multiscatterColorFactor") else "multiscatterColor"
        colour = _colour([min(1.0, max(0.0, value)) for value in scatter.numbers(key, (0.0,) * 3)])
        asymmetry = scatter.number("scatterAnisotropy", 0.0, -1, 1)
        texture = self._texture(scatter, "multiscatterColorTexture")
        if not material.solid or material.attenuation is None or material.transmission == 0:
            reason = "without thickness, attenuationDistance and transmission"
            self.notes.append(f"{scatter.place} is left out {reason}")
            return material
        if texture is not None and asymmetry != 0:
            self.notes.append(f"{scatter.place}: scatterAnisotropy is left out beside a texture")
            asymmetry = 0.0
        return replace(material, scattering=(colour, asymmetry), scattering_texture=texture)

    def _diffuse_transmission(self, diffuse: JsonNode, material: FileMaterial) -> FileMaterial:
        """Return a material with what passes a thin sheet evenly."""
        if material.transmission > 0 or max(material.emission) > 0:
            self.notes.append(f"{diffuse.place} is left out beside transmission or emission")
            return material
        if material.metallic > 0 and material.metallic_texture is not None:
            self.notes.append(f"{diffuse.place}: passes light where the painting says metal, too")
        text = "is that of a thin sheet, and the gloss shows by the share that it does not pass"
        self.notes.append(f"{diffuse.place}: {text}")
        return replace(
            material,
            translucency=diffuse.number("diffuseTransmissionFactor", 0.0, 0, 1) * (1 - material.metallic),
            translucency_texture=self._texture(diffuse, "diffuseTransmissionTexture"),
            translucency_color=_colour(diffuse.numbers("diffuseTransmissionColorFactor", (1.0,) * 3)),
            translucency_color_texture=self._texture(diffuse, "diffuseTransmissionColorTexture"),
        )

    def _add_layers(self, part: JsonNode, material: FileMaterial) -> FileMaterial:
        """Return a material with what extensions put over it: coat, sheen and the direction of its brushing."""
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
        if image.text("mimeType") not in _PICTURES:
            self.notes.append(f"{image.place} is {image.text('mimeType')} and is left out")
            return None
        wrap, nearest = self._sampling(plain)
        self._sets[key] = reference.whole("texCoord", 0, below=100)
        file_texture = FileTexture(self._content(image), _name(image), wrap=wrap, nearest=nearest)
        for transform in reference.extensions("KHR_texture_transform"):
            self._sets[key] = transform.whole("texCoord", self._sets[key], below=100)
            file_texture = replace(file_texture, **_transform_keys(transform))
        return file_texture

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
        across, along = (_WRAPS.get(sampler.whole(key, 10497)) for key in ("wrapS", "wrapT"))
        if across is None or along is None:
            raise sampler.wrong("wrapS" if across is None else "wrapT", "is not known", ", ".join(map(str, _WRAPS)))
        if across != along:
            self.notes.append(f"{sampler.place}.wrapT is not as wrapS, which counts for both")
        return across, sampler.whole("magFilter", 0) == _NEAREST


def _colour(values: Sequence[float]) -> Colour:
    red, green, blue = (max(0.0, value) for value in values)
    return (red, green, blue)


def _name(image: JsonNode) -> str:
    uri = "" if image.text("uri").startswith("data:") else image.text("uri")
    return (image.text("name") or uri or image.place.rpartition(" ")[2])[:200]


def _transform_keys(transform: JsonNode) -> dict[str, Any]:
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


# Animations, morph targets and skins: the pose of a file at a time, or at rest.
#
# Source: glTF 2.0, sections 3.7.2.2 (morph targets), 3.7.3 (skins), 3.11 and appendix C (animations).

_PATHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3", "weights": "SCALAR"}
_INTERPOLATIONS = {"LINEAR": 1, "STEP": 1, "CUBICSPLINE": 3}  # rows of each key: a spline has tangents on both sides


def _pose_at(document: JsonNode, data: Data, time_s: float | None) -> tuple[JsonNode, list[str]]:
    """Put the nodes of a document where its animations have them at a time; say what of these is left out.

    All animations play together, but one that moves what an earlier one moves: that is another clip of the same thing.
    Before the first key of a channel its first value holds, after the last its last.
    """
    animations = document.parts("animations")
    if time_s is None:
        text = "animations are left out, and the pose is at rest; `time_s` gives a moment of them"
        return document, [f"{document.place}: {text}"] if animations else []
    nodes = document.parts("nodes")
    changes: dict[int, dict[str, list[float]]] = {}
    notes: list[str] = []
    for animation in animations:
        moved = _moved_by(animation, nodes, data, time_s, notes)
        if any(path in changes.get(index, {}) for index, path in moved):
            name = animation.text("name") or "it"
            notes.append(f"{animation.place}: {name} moves what an earlier animation moves and is left out")
            continue
        for (index, path), values in moved.items():
            changes.setdefault(index, {})[path] = values
    if not animations:
        notes.append(f"{document.place}: has no animations, so `time_s` changes nothing")
    return document.with_changes("nodes", changes), notes


def _moved_by(
    animation: JsonNode, nodes: list[JsonNode], data: Data, time_s: float, notes: list[str]
) -> dict[tuple[int, str], list[float]]:
    """Evaluate the channels of an animation, by node and path."""
    samplers = animation.parts("samplers")
    moved: dict[tuple[int, str], list[float]] = {}
    for channel in animation.parts("channels"):
        target = channel.part("target")
        path = target.text("path")
        if path == "pointer":  # KHR_animation_pointer
            notes.append(f"{target.place}: what it animates is no node, and is left out")
            continue
        if path not in _PATHS:
            raise target.wrong("path", "is not known", ", ".join(_PATHS))
        if not target.has("node"):
            continue
        index = target.whole("node", below=len(nodes))
        if nodes[index].has("matrix") and path != "weights":
            raise nodes[index].wrong("matrix", "is beside an animation", "translation, rotation and scale")
        sampler = samplers[channel.whole("sampler", below=len(samplers))]
        moved[index, path] = _sample(sampler, data, path, time_s)
    return moved


def _sample(sampler: JsonNode, data: Data, path: str, time_s: float) -> list[float]:
    """Interpolate between the keys of a sampler."""
    way = sampler.text("interpolation", "LINEAR")
    if way not in _INTERPOLATIONS:
        raise sampler.wrong("interpolation", "is not known", ", ".join(_INTERPOLATIONS))
    times = data.array(sampler.whole("input", below=data.count), ("SCALAR",))[:, 0].astype(np.float64)
    if not len(times) or not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise sampler.wrong("input", "has no times that rise", "an accessor of rising seconds")
    values = data.array(sampler.whole("output", below=data.count), (_PATHS[path],)).astype(np.float64)
    width, rest = divmod(values.size, len(times) * _INTERPOLATIONS[way])
    if rest or not width or (path != "weights" and width != values.shape[1]):
        raise sampler.wrong("output", f"has {len(values)} entries", f"as many as its {len(times)} times need")
    rows = values.reshape(len(times), _INTERPOLATIONS[way], width)
    at = min(max(time_s, times[0]), times[-1])
    first = min(int(np.searchsorted(times, at, "right")) - 1, max(0, len(times) - 2))
    second = min(first + 1, len(times) - 1)
    span = times[second] - times[first]
    share = (at - times[first]) / span if span > 0 else float(second > first)
    match way:
        case "STEP":
            result = rows[second if share >= 1 else first, 0]
        case "LINEAR" if path == "rotation":
            result = _slerp(rows[first, 0], rows[second, 0], share)
        case "LINEAR":
            result = (1 - share) * rows[first, 0] + share * rows[second, 0]
        case _:
            square, cube = share**2, share**3
            result = (2 * cube - 3 * square + 1) * rows[first, 1] + span * (cube - 2 * square + share) * rows[first, 2]
            result = result + (3 * square - 2 * cube) * rows[second, 1] + span * (cube - square) * rows[second, 0]
    return [float(value) for value in result]


def _slerp(first: NDArray[np.float64], second: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Interpolate between quaternions on the shorter way (Shoemake 1985)."""
    lengths = np.linalg.norm(first), np.linalg.norm(second)
    if not min(lengths) > 0:
        return first  # which its node refuses, as it does a second one when its time has come
    first, second = first / lengths[0], second / lengths[1]
    cosine = float(first @ second)
    if cosine < 0:
        second, cosine = -second, -cosine
    sine = float(np.linalg.norm(second - cosine * first))
    angle = math.atan2(sine, cosine)
    if sine < 1e-9:
        return second if share >= 1 else first
    return np.asarray((math.sin((1 - share) * angle) * first + math.sin(share * angle) * second) / math.sin(angle))


def _weights(node: JsonNode, mesh: JsonNode) -> tuple[float, ...]:
    """Return the weights of morph targets where a node shows a mesh: the node's, the mesh's, or zeros."""
    count = max((len(primitive.parts("targets")) for primitive in mesh.parts("primitives")), default=0)
    if not count:
        return ()
    of_mesh = mesh.numbers("weights", (0.0,) * count)
    return node.numbers("weights", of_mesh) if node.has("weights") else of_mesh


def _morph(rows: NDArray[Any], key: str, primitive: JsonNode, weights: tuple[float, ...], data: Data) -> NDArray[Any]:
    """Add to an attribute (n, 3) what the morph targets of a primitive have by their weights."""
    for target, weight in zip(primitive.parts("targets"), weights, strict=False):
        if weight == 0 or not target.has(key):
            continue
        steps = data.array(target.whole(key, below=data.count), ("VEC3",))
        if len(steps) != len(rows):
            raise target.wrong(key, f"has {len(steps)} entries", f"{len(rows)}, as the primitive has")
        rows = rows + weight * steps.astype(np.float64)
    return rows


def _joints(skin: JsonNode, document: JsonNode, data: Data) -> NDArray[np.float64]:
    """Return the matrices (j, 4, 4) by which the joints of a skin place what is bound to them."""
    nodes = document.parts("nodes")
    places = {node.place: placement for node, placement in _placed_nodes(document)}
    numbers = skin.wholes("joints", below=len(nodes))
    if not numbers or any(nodes[number].place not in places for number in numbers):
        raise skin.wrong("joints", "are not in the scene that is shown", "nodes of that scene")
    result = np.stack([places[nodes[number].place] for number in numbers])
    if not skin.has("inverseBindMatrices"):
        return result
    inverse = data.array(skin.whole("inverseBindMatrices", below=data.count), ("MAT4",)).astype(np.float64)
    if len(inverse) < len(numbers):
        raise skin.wrong("inverseBindMatrices", f"has {len(inverse)} entries", f"one for each of {len(numbers)} joints")
    with np.errstate(over="ignore", invalid="ignore"):  # triangles with what is not finite are dropped
        return np.asarray(result @ inverse[: len(numbers)].reshape(-1, 4, 4).transpose(0, 2, 1))


def _blend(vertices: Vertices, joints: NDArray[np.float64], place: str) -> NDArray[np.float64]:
    """Return the matrix (n, 3, 4) of each vertex: the mean of its joints' by their weights."""
    blended: Any = 0.0
    total: Any = 0.0
    unbound = joints[:1, :3]
    for number in range(100):
        which, shares = (vertices.rows(f"{key}_{number}", ("VEC4",)) for key in ("JOINTS", "WEIGHTS"))
        if which is None or shares is None:
            break
        which = np.where(shares != 0, which, 0).astype(np.int64)
        if which.size and int(which.max()) >= len(joints):
            raise InputError(
                f"{place}: names a joint that is not there (got {which.max()}; allowed: below {len(joints)})"
            )
        for joint, share in zip(which.T, shares.T.astype(np.float64), strict=True):
            blended = blended + share[:, None, None] * joints[joint, :3]
            total = total + share
    if isinstance(total, float):
        raise InputError(f"{place}: is shown with a skin, but has no JOINTS_0 and WEIGHTS_0")
    bound = (total != 0)[:, None, None]  # the sum is 1 but for rounding; what is bound to nothing follows one joint
    return np.asarray(np.where(bound, blended / np.where(bound, total[:, None, None], 1), unbound))


def _skin(surface: MeshSurface, matrices: NDArray[np.float64]) -> MeshSurface:
    """Return a surface whose vertices are placed by a matrix each; a mirror image keeps its front."""
    turns = matrices[:, :, :3]
    positions = np.einsum("nij,nj->ni", turns, surface.positions.astype(np.float64)) + matrices[:, :, 3]
    a, b, c = turns[:, 0], turns[:, 1], turns[:, 2]
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    mirrors = np.einsum("ni,ni->n", a, cofactors[:, 0]) < 0
    normals = surface.normals
    if normals is not None:
        wide = np.einsum("nij,nj->ni", cofactors, normals.astype(np.float64)) * np.where(mirrors, -1, 1)[:, None]
        length = np.linalg.norm(wide, axis=1, keepdims=True)
        normals = (wide / np.where(length > 0, length, 1)).astype(np.float32)
    corners = np.where(mirrors[surface.faces[:, :1]], surface.faces[:, ::-1], surface.faces)
    return replace(surface, positions=positions, faces=corners, normals=normals)


# glTF 2.0 files, .gltf and .glb: meshes, their places in the tree of nodes, and materials.

# Extensions that a file may require. What others do not require and are not listed here is left out.
_LIGHTS, _VARIANTS, _INSTANCES = "KHR_lights_punctual", "KHR_materials_variants", "EXT_mesh_gpu_instancing"
_VISIBILITY = "KHR_node_visibility"
Pose = tuple[str, tuple[float, ...], str | None]  # of a mesh: the weights of its morph targets, and its skin
_KNOWN_EXTENSIONS = (
    *_FOLLOWED, DRACO, *MESHOPT, _INSTANCES, _VARIANTS, WEBP, _LIGHTS, "KHR_mesh_quantization", "KHR_texture_transform",
    _VISIBILITY,
)  # fmt: skip


def read_gltf(path: Path, find: Find, time_s: float | None = None) -> Draft:
    """Return the surfaces of a glTF file, one for each triangle primitive, and a part for each node that shows one.

    Parameters
    ----------
    time_s : float, optional
        A moment of its animations; without it the pose is at rest.

    Raises
    ------
    InputError
        When the file is not as glTF 2.0 says, needs an extension that is not read, or shows no triangles.
    """
    document, binary = read_container(path)
    _check_version(document, path)
    data = Data(document, binary, path.parent, find)
    document, notes = _pose_at(document, data, time_s)
    materials = _GltfMaterials(document, data)
    meshes, skins = document.parts("meshes"), document.parts("skins")
    surfaces: list[MeshSurface] = []
    places: dict[Pose, list[int]] = {}
    nodes: list[Node] = []
    for node, placement in _placed_meshes(document, data):
        mesh = meshes[node.whole("mesh", below=len(meshes))]
        skin = skins[node.whole("skin", below=len(skins))] if node.has("skin") else None
        pose = mesh.place, _weights(node, mesh), None if skin is None else skin.place
        if pose not in places:
            joints, before = None if skin is None else _joints(skin, document, data), len(surfaces)
            title = mesh.text("name") or None
            shown = [_surface(part, data, materials, title, pose[1], joints) for part in mesh.parts("primitives")]
            surfaces += [surface for surface in shown if surface is not None]
            places[pose] = list(range(before, len(surfaces)))
        nodes += [(index, placement, node.text("name") or surfaces[index].name) for index in places[pose]]
    if not nodes:
        raise InputError(f"{path}: its scene shows no triangles")
    return Draft(surfaces, materials.materials, nodes, [*materials.notes, *notes, *_left_out(document)])


def _check_version(document: JsonNode, path: Path) -> None:
    # files of glTF 1.0 may hold their version as a number, or none
    version = "1.0, by its form" if document.is_mapping("meshes") else document.part("asset").text("version")
    if version.split(".")[0] != "2":
        raise InputError(f"{path}: is not glTF 2.0 (got version {version or 'none'!s}; allowed: 2.0)")
    if missing := [name for name in document.texts("extensionsRequired") if name not in _KNOWN_EXTENSIONS]:
        got, allowed = ", ".join(missing), ", ".join(_KNOWN_EXTENSIONS)
        raise InputError(f"{path}: needs extensions that are not read (got {got}; allowed: {allowed})")


def _left_out(document: JsonNode) -> list[str]:
    """Notes on parts of a file that are left out, and would change its picture."""
    primitives = [primitive for mesh in document.parts("meshes") for primitive in mesh.parts("primitives")]
    omissions = {
        LAMPS_LEFT_OUT: any(part.parts("lights") for part in document.extensions(_LIGHTS)),
        "morph targets of colours and texture coordinates are left out": any(
            name.startswith(("COLOR", "TEXCOORD"))
            for primitive in primitives
            for target in primitive.parts("targets")
            for name in target.names()
        ),
        "variants of materials are left out; the default materials show": _VARIANTS in document.texts("extensionsUsed"),
        "points and lines are left out": any(part.whole("mode", TRIANGLES) < TRIANGLES for part in primitives),
    }
    return [f"{document.place}: {text}" for text, there in omissions.items() if there]


def _surface(
    primitive: JsonNode,
    data: Data,
    materials: _GltfMaterials,
    name: str | None,
    weights: tuple[float, ...],
    joints: NDArray[np.float64] | None,
) -> MeshSurface | None:
    """Return the triangles of a primitive in the pose of its morph targets and joints, None when it has none."""
    mode = primitive.whole("mode", TRIANGLES)
    if mode not in (TRIANGLES, STRIP, FAN):
        return None
    vertices = Vertices(primitive, data)
    positions = vertices.rows("POSITION", ("VEC3",))
    if positions is None:
        return None
    material = materials.index(primitive)
    uvs = vertices.rows(f"TEXCOORD_{materials.uv_sets[material]}", ("VEC2",))
    corners = vertices.corners(mode)
    if not len(corners):
        return None
    check_corners(Polygons(np.arange(len(corners)), corners), len(positions), f"{primitive.place}: face")
    colours = vertices.rows("COLOR_0", ("VEC3", "VEC4"))
    if colours is not None and not materials.opaque[material] and (colours[:, 3:] < 1).any():
        materials.notes.append(f"{primitive.place}: the alpha of its colours is left out")
    normals = vertices.rows("NORMAL", ("VEC3",))
    surface = MeshSurface(
        _morph(positions, "POSITION", primitive, weights, data),
        corners,
        None if normals is None else _morph(normals, "NORMAL", primitive, weights, data),
        None if uvs is None else np.column_stack([uvs[:, 0], 1 - uvs[:, 1]]),
        material,
        name,
        None if colours is None else colours[:, :3],
    )
    return surface if joints is None else _skin(surface, _blend(vertices, joints, primitive.place))


def _placed_meshes(document: JsonNode, data: Data) -> Iterator[tuple[JsonNode, NDArray[np.float64]]]:
    """Yield the nodes of the default scene that show a mesh and where, parents before children.

    A mesh with a skin is where its joints put it, and not where its node is (glTF 2.0, 3.7.3.3).
    """
    for node, parent in _placed_nodes(document, hidden=False):
        if not node.has("mesh"):
            continue
        for placement in [np.eye(4)] if node.has("skin") else [parent @ each for each in _instances(node, data)]:
            if _can_be_shown(placement, node):
                yield node, placement


def _instances(node: JsonNode, data: Data) -> list[NDArray[np.float64]]:
    """Return the placements of a node's mesh below the node: those of EXT_mesh_gpu_instancing, or one."""
    for extension in node.extensions(_INSTANCES):
        attributes = extension.part("attributes")
        given = {
            key: data.array(attributes.whole(key, below=data.count), (kind,)).astype(np.float64)
            for key, kind in (("TRANSLATION", "VEC3"), ("ROTATION", "VEC4"), ("SCALE", "VEC3"))
            if attributes.has(key)
        }
        if len({len(rows) for rows in given.values()}) > 1:
            raise InputError(f"{attributes.place}: TRANSLATION, ROTATION and SCALE are not of one length")
        rows = {key.lower(): values.tolist() for key, values in given.items()}
        count = min((len(values) for values in rows.values()), default=1)
        return [
            _matrix(JsonNode({key: values[index] for key, values in rows.items()}, f"{attributes.place}[{index}]"))
            for index in range(count)
        ]
    return [np.eye(4)]


def _placed_nodes(document: JsonNode, *, hidden: bool = True) -> Iterator[tuple[JsonNode, NDArray[np.float64]]]:
    """Yield the nodes of the default scene and where each is in the file, parents before children; hidden ones, too."""
    nodes = document.parts("nodes")
    waiting = [(index, np.eye(4)) for index in reversed(_roots(document, nodes))]
    seen: set[int] = set()
    while waiting:
        index, parent = waiting.pop()
        node = nodes[index]
        if index in seen:
            raise InputError(f"{node.place}: is reached twice (allowed: a tree of nodes)")
        seen.add(index)
        if not hidden and any(
            part.has("visible") and not part.flag("visible") for part in node.extensions(_VISIBILITY)
        ):
            continue
        with np.errstate(over="ignore", invalid="ignore"):  # refused where a mesh is shown
            placement = parent @ _matrix(node)
        waiting += [(child, placement) for child in reversed(node.wholes("children", below=len(nodes)))]
        yield node, placement


def _roots(document: JsonNode, nodes: list[JsonNode]) -> list[int]:
    scenes = document.parts("scenes")
    if scenes:
        return scenes[document.whole("scene", 0, below=len(scenes))].wholes("nodes", below=len(nodes))
    children = {child for node in nodes for child in node.wholes("children", below=len(nodes))}
    return [index for index in range(len(nodes)) if index not in children]


def _matrix(node: JsonNode) -> NDArray[np.float64]:
    """Return the transform of a node: its matrix (by columns), or scale, then rotation, then translation."""
    if node.has("matrix"):
        matrix = np.array(node.numbers("matrix", (0.0,) * 16)).reshape(4, 4).T
        if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
            raise node.wrong("matrix", "is not affine", "a last row of 0 0 0 1")
        matrix[3] = (0, 0, 0, 1)
        return np.asarray(matrix)
    result = np.eye(4)
    x, y, z, w = node.numbers("rotation", (0.0, 0.0, 0.0, 1.0))
    length = np.sqrt(x * x + y * y + z * z + w * w)
    if not length > 0:
        raise node.wrong("rotation", "is the zero quaternion", "a unit quaternion")
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    result[:3, :3] = turn * node.numbers("scale", (1.0, 1.0, 1.0))
    result[:3, 3] = node.numbers("translation", (0.0, 0.0, 0.0))
    return result


def _can_be_shown(placement: NDArray[np.float64], node: JsonNode) -> bool:
    """Return whether a mesh has a size there; refuse a place that flattens space."""
    if not np.isfinite(placement).all():
        raise InputError(f"{node.place}: its transform is beyond floating point")
    stretches = np.linalg.svd(placement[:3, :3], compute_uv=False)
    if stretches[0] == 0:
        return False
    if stretches[-1] < SMALLEST_STRETCH_RATIO * stretches[0]:
        allowed = f"stretches whose ratio is at least {SMALLEST_STRETCH_RATIO:g}"
        raise InputError(f"{node.place}: its transform flattens space (allowed: {allowed})")
    return True


#
# Cameras and lamps of glTF files: the nodes of the scene that show one, at their places.
#
# Sources: glTF 2.0, section 3.10; Khronos, KHR_lights_punctual. Both look along -z of their node.

_KINDS = ("point", "spot", "directional")
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


def read_gltf_world(
    path: Path, find: Find | None = None, time_s: float | None = None
) -> tuple[list[GltfCamera], list[dict[str, Any]], list[str]]:
    """Read the cameras and lamps that the default scene of a glTF file shows, and notes on what is left out.

    Lamps have the keys of a scene's lights. At a time, which takes `find`, they are where animations move them.

    Raises
    ------
    InputError
        When the file is not as glTF 2.0 says.
    """
    document, binary = read_container(path)
    if find is not None:
        document, _ = _pose_at(document, Data(document, binary, path.parent, find), time_s)
    all_cameras = document.parts("cameras")
    all_lights = [light for part in document.extensions(_LIGHTS) for light in part.parts("lights")]
    cameras: list[GltfCamera] = []
    lights: list[dict[str, Any]] = []
    notes: list[str] = []
    for node, placement in _placed_nodes(document, hidden=False):
        if node.has("camera"):
            part = all_cameras[node.whole("camera", below=len(all_cameras))]
            name = node.text("name") or part.text("name") or f"camera {len(cameras) + 1}"
            if part.text("type") == "perspective":
                cameras.append(_read_camera(part, name, node, placement))
            else:
                notes.append(f"{node.place}: {name} is not a perspective camera and is left out")
        for shown in node.extensions(_LIGHTS):
            light = all_lights[shown.whole("light", below=len(all_lights))]
            lights += _read_light(light, node, placement)
    return cameras, lights, notes


def _read_camera(camera: JsonNode, name: str, node: JsonNode, placement: NDArray[np.float64]) -> GltfCamera:
    lens = camera.part("perspective")
    height = lens.number("yfov", math.nan, 1e-6, math.pi - 1e-6)
    if math.isnan(height):
        raise lens.wrong("yfov", "is missing", "an angle in radians")
    aspect = lens.number("aspectRatio", math.nan, 1e-3, 1e3)
    eye, forward = _pose_of(placement, node)
    up = _unit(placement[:3, 1], node)
    return GltfCamera(name, eye, forward, up, height, None if math.isnan(aspect) else aspect)


def _read_light(light: JsonNode, node: JsonNode, placement: NDArray[np.float64]) -> list[dict[str, Any]]:
    """Read a lamp that is not dark, as keys of a scene's light."""
    kind = light.text("type")
    if kind not in _KINDS:
        raise light.wrong("type", "is not known", ", ".join(_KINDS))
    strength = light.number("intensity", 1.0, 0)
    amount = [max(0.0, strength * value) / LUMENS_PER_WATT for value in light.numbers("color", (1.0, 1.0, 1.0))]
    if not max(amount) > 0:
        return []
    cone = light.part("spot")
    outer = cone.number("outerConeAngle", math.pi / 4, 1e-4, math.pi / 2)
    inner = min(cone.number("innerConeAngle", 0.0, 0, math.pi / 2), outer * (1 - 1e-3))
    eye, forward = _pose_of(placement, node)
    match kind:
        case "directional":
            return [{"kind": kind, "direction": forward, "irradiance": amount}]
        case "point":
            return [{"kind": kind, "position": eye, "intensity": amount}]
    angles = {"inner_degrees": math.degrees(inner), "outer_degrees": math.degrees(outer)}
    return [{"kind": kind, "position": eye, "intensity": amount, "direction": forward} | angles]


def _pose_of(placement: NDArray[np.float64], node: JsonNode) -> tuple[Vector, Vector]:
    x, y, z = placement[:3, 3].tolist()
    return (x, y, z), _unit(-placement[:3, 2], node)


def _unit(vector: NDArray[np.float64], node: JsonNode) -> Vector:
    length = float(np.linalg.norm(vector))
    if not (length > 0 and math.isfinite(length)):
        raise InputError(f"{node.place}: its transform leaves no direction (allowed: a scale that is not zero)")
    x, y, z = (vector / length).tolist()
    return x, y, z
