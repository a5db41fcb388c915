"""Materials of the scene as records, and which parts of them there are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.records import MATERIAL, MaterialKind
from rptcam_cl.plan.covers import cover_mean, internal_reflectance, rough_cover, smooth_mean
from rptcam_cl.plan.optical_constants import KnownSpectra, fill_index, metal_constants, metal_spectra
from rptcam_cl.plan.sheen import sheen_lobe
from rptcam_cl.plan.textures import TextureTable
from rptcam_cl.scene import (
    LARGEST_RADIANCE,
    AbsorbingMaterial,
    BumpyMaterial,
    Colour,
    Conductor,
    CoveringMaterial,
    Dielectric,
    Emissive,
    Material,
    MetalSpectrum,
    Mix,
    OpticalConstants,
    Plastic,
    Principled,
    Texture,
    ThinGlass,
    alpha_pair,
)

_TEXTURES = ("texture", "glow_texture", "roughness_texture", "metallic_texture", "coat_texture",
             "coat_roughness_texture", "sheen_texture", "opacity_texture", "factor_texture",
             "normal_texture", "anisotropy_texture", "specular_texture", "specular_color_texture",
             "coat_normal_texture", "transmission_texture")  # fmt: skip

Faceted = Conductor | Dielectric | Plastic | Principled


@dataclass(frozen=True)
class Materials:
    """What the kernels read of materials.

    Attributes
    ----------
    records : array of Material
    index : dict
        Record of each material, by its ``id``.
    facts : dict
        Which kinds of material and which of their features there are.
    """

    records: NDArray[np.void]
    index: dict[int, int]
    facts: dict[str, int]


def _kind(material: Material) -> MaterialKind:
    match material:
        case Conductor() if material.metal is not None:
            return MaterialKind.METAL
        case Dielectric() | Plastic() if material.alphas is not None:
            return MaterialKind[f"ROUGH_{material.kind.upper()}"]
    return MaterialKind[material.kind.upper()]


class _Filler:
    """Writes a material into its record."""

    def __init__(self, textures: TextureTable, spectra: KnownSpectra) -> None:
        self._textures, self._spectra = textures, spectra

    def _colour(self, record: np.void, name: str, texture: str, value: Colour | Texture, limit: float) -> None:
        """Write a colour with the number of its spectrum, or the texture that gives it."""
        record[name][:3], record[texture] = self._textures.slot(value, limit=limit)
        record[name][3] = self._spectra.number(value, light=limit > 1.0)

    def _number(self, record: np.void, name: str, value: float | Texture) -> None:
        """Write a number, or the texture that gives it."""
        colour: tuple[float, float, float] | Texture = (value,) * 3 if isinstance(value, (int, float)) else value
        (record[name], _, _), record[f"{name}_texture"] = self._textures.slot(colour, limit=1.0)

    def _roughness(self, record: np.void, name: str, value: float | Texture) -> float:
        """Return the roughness; 1 where a texture is written that gives it."""
        if isinstance(value, (int, float)):
            return value
        _, record[name] = self._textures.slot(value, limit=1.0)
        return 1.0

    def fill(self, record: np.void, material: Material) -> None:
        """Write everything but the two materials of a mix into a record of `_white`."""
        record["kind"] = _kind(material)
        reflectance = getattr(material, "reflectance", None)
        if reflectance is not None:
            self._colour(record, "color", "texture", reflectance, 1.0)
        record["parameter"] = getattr(material, "parameter", 0.0)
        match material:
            case Emissive():
                self._colour(record, "color", "texture", material.radiance, LARGEST_RADIANCE)
            case Principled():
                self._principled(record, material)
            case Mix():
                self._number(record, "factor", material.factor)
        if isinstance(material, (Conductor, Dielectric, Plastic)):
            _facets(record, material, material.alphas or (0.0, 0.0))
        if isinstance(material, Dielectric):
            fill_index(record, material)
        if isinstance(material, Conductor) and material.metal is not None:
            self._metal(record, material.metal)
        if isinstance(material, Plastic):
            _cover(record, material)
        if isinstance(material, AbsorbingMaterial):
            record["absorption"][:3] = material.absorption
            record["absorption"][3] = self._spectra.number(material.absorption)
        if isinstance(material, ThinGlass):
            record["absorption"][:3] = material.depth
            record["absorption"][3] = self._spectra.number(material.depth)
        self._coverage(record, material)

    def _metal(self, record: np.void, metal: str | OpticalConstants | MetalSpectrum) -> None:
        """Write the index n + i k of a metal: of each channel, and of one that was measured the spectra."""
        if isinstance(metal, OpticalConstants):
            record["metal_n"][:3], record["metal_k"][:3] = metal.n, metal.k
            return
        record["metal_n"][:3], record["metal_k"][:3] = metal_constants(metal)
        record["metal_n"][3], record["metal_k"][3] = map(self._spectra.add, metal_spectra(metal))

    def _coverage(self, record: np.void, material: Material) -> None:
        if isinstance(material, CoveringMaterial):
            self._number(record, "opacity", material.opacity)
            record["cutoff"] = material.opacity_cutoff if material.opacity_mode == "mask" else 0.0
        if isinstance(material, BumpyMaterial) and material.normal_map is not None:
            _, record["normal_texture"] = self._textures.slot(material.normal_map, limit=1.0)
            record["normal_strength"] = material.normal_map.strength

    def _principled(self, record: np.void, material: Principled) -> None:
        self._colour(record, "color", "texture", material.base_color, 1.0)
        self._colour(record, "glow", "glow_texture", material.emission, LARGEST_RADIANCE)
        self._number(record, "metallic", material.metallic)
        roughness = self._roughness(record, "roughness_texture", material.roughness)
        _facets(record, material, alpha_pair(roughness, material.anisotropy))
        if material.anisotropy_map is not None:
            _, record["anisotropy_texture"] = self._textures.slot(material.anisotropy_map, limit=1.0)
            record["anisotropy_strength"] = material.anisotropy_map.strength
            record["anisotropy_turn"] = _turn(material)
        self._number(record, "specular", material.specular)
        self._colour(record, "specular_color", "specular_color_texture", material.specular_color, 1.0)
        self._number(record, "transmission", material.transmission)
        self._number(record, "coat", material.clearcoat)
        coat_roughness = self._roughness(record, "coat_roughness_texture", material.clearcoat_roughness)
        record["coat_flat"] = material.clearcoat_flat
        if material.clearcoat_normal_map is not None:
            _, record["coat_normal_texture"] = self._textures.slot(material.clearcoat_normal_map, limit=1.0)
            record["coat_normal_strength"] = material.clearcoat_normal_map.strength
        record["coat_alpha"] = alpha_pair(coat_roughness, 0.0)[0]
        if not isinstance(material.sheen, tuple) or max(material.sheen) > 0:
            self._sheen(record, material)

    def _sheen(self, record: np.void, material: Principled) -> None:
        self._colour(record, "sheen", "sheen_texture", material.sheen, 1.0)
        alpha = alpha_pair(material.sheen_roughness, 0.0)[0]
        lobe = sheen_lobe(alpha)
        record["sheen_cover"], record["sheen_last"] = lobe.albedo[:4], lobe.albedo[4]
        record["sheen_alpha"], record["sheen_peak"], record["sheen_half"] = alpha, lobe.peak, lobe.half


def _facets(record: np.void, material: Faceted, alphas: tuple[float, float]) -> None:
    record["alpha"], record["alpha_across"] = alphas
    if alphas[0] != alphas[1]:
        record["anisotropy_turn"] = _turn(material)


def _turn(material: Faceted) -> float:
    return material.anisotropy_rotation_degrees / 360 % 1


def _cover(record: np.void, material: Plastic) -> None:
    if material.alphas is None:
        mean = smooth_mean(material.index)
    else:
        cover = rough_cover(material.alphas, material.index)
        record["cover"], record["cover_last"] = cover[:4], cover[4]
        mean = cover_mean(cover)
    record["internal"] = internal_reflectance(mean, material.index)


def _facts(records: NDArray[np.void]) -> dict[str, int]:
    """Which kinds and features the records have."""
    kinds = set(records["kind"].tolist())
    principled = records["kind"] == MaterialKind.PRINCIPLED
    clear = np.isin(records["kind"], (MaterialKind.DIELECTRIC, MaterialKind.ROUGH_DIELECTRIC, MaterialKind.PRINCIPLED))
    coated = principled & ((records["coat"] > 0) | (records["coat_texture"] >= 0))
    flat = (records["coat_flat"] != 0) & (records["normal_texture"] >= 0)
    clearing = records["transmission_texture"] >= 0
    tinted = records["specular_color"][principled] != (1, 1, 1, 0)
    brushed = records["anisotropy_texture"] >= 0
    facts = {f"HAS_{kind.name}": int(kind in kinds) for kind in MaterialKind}
    features = {
        "HAS_ANISOTROPY": np.any(records["alpha"] != records["alpha_across"]) or np.any(brushed),
        "HAS_ANISOTROPY_TURN": np.any(records["anisotropy_turn"][~brushed] != 0),
        "HAS_ANISOTROPY_MAP": np.any(brushed),
        "HAS_TRANSMISSION": np.any(records["transmission"][principled] > 0) or np.any(clearing),
        "HAS_TRANSMISSION_TEXTURE": np.any(clearing),
        "HAS_CLEARCOAT": np.any(coated),
        "HAS_COAT_NORMAL": np.any(coated & ((records["coat_normal_texture"] >= 0) | flat)),
        "HAS_SHEEN": np.any(records["sheen"][principled] > 0) or np.any(records["sheen_texture"] >= 0),
        "HAS_ABSORPTION": np.any(records["absorption"][clear] > 0),
        "HAS_GLOW": np.any(records["glow"] > 0) or np.any(records["glow_texture"] >= 0),
        "HAS_ROUGHNESS_TEXTURE": np.any(records["roughness_texture"] >= 0),
        "HAS_METALLIC_TEXTURE": np.any(records["metallic_texture"] >= 0),
        "HAS_COAT_TEXTURE": np.any(records["coat_texture"] >= 0),
        "HAS_COAT_ROUGHNESS_TEXTURE": np.any(records["coat_roughness_texture"] >= 0),
        "HAS_SHEEN_TEXTURE": np.any(records["sheen_texture"] >= 0),
        "HAS_SPECULAR_TEXTURE": np.any(records["specular_texture"] >= 0),
        "HAS_SPECULAR_COLOR": np.any(tinted) or np.any(records["specular_color_texture"] >= 0),
        "HAS_SPECULAR_COLOR_TEXTURE": np.any(records["specular_color_texture"] >= 0),
        "HAS_DISPERSION": np.any(records["dispersion_terms"] > 0),
        "HAS_OPACITY": np.any(records["opacity"] < 1) or np.any(records["opacity_texture"] >= 0),
        "HAS_NORMAL_MAP": np.any(records["normal_texture"] >= 0),
    }
    return facts | {name: int(value) for name, value in features.items()}


def _white(count: int) -> NDArray[np.void]:
    """Return records of materials of no kind: white, without textures or holes."""
    records = MATERIAL.zeros(count)
    records["color"][:, :3], records["specular_color"][:, :3], records["opacity"] = 1.0, 1.0, 1.0
    for name in _TEXTURES:
        records[name] = -1
    return records


def pack_materials(materials: Sequence[Material], textures: TextureTable, spectra: KnownSpectra) -> Materials:
    """Return one record per distinct material, those that are mixed included; collect their textures and spectra."""
    parts = [part for material in materials if isinstance(material, Mix) for part in material.materials]
    distinct = list({id(material): material for material in (*materials, *parts)}.values())
    index = {id(material): place for place, material in enumerate(distinct)}
    records = _white(len(distinct))
    filler = _Filler(textures, spectra)
    for record, material in zip(records, distinct, strict=False):
        filler.fill(record, material)
        if isinstance(material, Mix):
            record["first"], record["second"] = (index[id(part)] for part in material.materials)
    if not distinct:
        records["kind"], records["color"] = -1, 0.0
    records["textured"] = np.any([records[name] >= 0 for name in _TEXTURES], axis=0)
    records["textured"] |= records["kind"] == MaterialKind.MIX
    return Materials(records, index, _facts(records))
