"""Materials of the scene as records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.records import MATERIAL, MaterialKind, TextureKind
from rptcam_cl.scene.material import Conductor, Dielectric, Emissive, Material, Matte, Mirror
from rptcam_cl.scene.texture import Checker, Grid


def _kind(material: Material) -> MaterialKind:
    match material:
        case Matte():
            return MaterialKind.MATTE
        case Mirror():
            return MaterialKind.MIRROR
        case Conductor():
            return MaterialKind.CONDUCTOR
        case Dielectric():
            return MaterialKind.DIELECTRIC
        case Emissive():
            return MaterialKind.EMISSIVE


def texture_kind(material: Material) -> TextureKind:
    """Return the kind of texture that colours a material."""
    match getattr(material, "reflectance", None):
        case Checker():
            return TextureKind.CHECKER
        case Grid():
            return TextureKind.GRID
    return TextureKind.CONSTANT


def _fill_texture(record: np.void, reflectance: object) -> None:
    match reflectance:
        case Checker():
            colors, scale, offset = (reflectance.even, reflectance.odd), reflectance.scale, reflectance.offset
        case Grid():
            colors, scale, offset = (reflectance.background, reflectance.line), reflectance.scale, reflectance.offset
            record["line_width"] = reflectance.line_width
        case _:
            record["color"][:3] = reflectance
            return
    record["color"][:3], record["other"][:3] = colors
    record["mapping"] = (*scale, *offset)


def _fill(record: np.void, material: Material) -> None:
    record["kind"] = _kind(material)
    record["texture"] = texture_kind(material)
    match material:
        case Dielectric():
            record["color"][:3] = 1.0
            record["parameter"] = material.index
        case Emissive():
            record["color"][:3] = material.radiance
            record["parameter"] = material.two_sided
        case Matte() | Mirror() | Conductor():
            _fill_texture(record, material.reflectance)
            if isinstance(material, Conductor):
                record["parameter"] = material.alpha


def pack_materials(materials: Sequence[Material]) -> tuple[NDArray[np.void], dict[int, int]]:
    """Return one record per distinct material, and the record index by ``id`` of each material."""
    distinct = list({id(material): material for material in materials}.values())
    records = MATERIAL.zeros(len(distinct))
    for index, material in enumerate(distinct):
        _fill(records[index], material)
    return records, {id(material): index for index, material in enumerate(distinct)}


def material_kinds(materials: Sequence[Material]) -> set[MaterialKind]:
    """Return the kinds among the materials."""
    return {_kind(material) for material in materials}
