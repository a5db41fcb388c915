"""Materials of the scene as records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.plan.textures import TextureTable
from rptcam_cl.records import MATERIAL, MaterialKind
from rptcam_cl.scene.material import Conductor, Dielectric, Emissive, Material, Matte, Mirror


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


def _fill(record: np.void, material: Material, textures: TextureTable) -> None:
    record["kind"] = _kind(material)
    record["texture"] = -1
    match material:
        case Dielectric():
            record["color"][:3] = 1.0
            record["parameter"] = material.index
        case Emissive():
            record["color"][:3] = material.radiance
            record["parameter"] = material.two_sided
        case Matte() | Mirror() | Conductor():
            record["color"][:3], record["texture"] = textures.slot(material.reflectance, limit=1.0)
            if isinstance(material, Conductor):
                record["parameter"] = material.alpha


def pack_materials(materials: Sequence[Material], textures: TextureTable) -> tuple[NDArray[np.void], dict[int, int]]:
    """Return one record per distinct material, and the record index by ``id`` of each; collect their textures."""
    distinct = list({id(material): material for material in materials}.values())
    records = MATERIAL.zeros(len(distinct))
    for index, material in enumerate(distinct):
        _fill(records[index], material, textures)
    return records, {id(material): index for index, material in enumerate(distinct)}


def material_kinds(materials: Sequence[Material]) -> set[MaterialKind]:
    """Return the kinds among the materials."""
    return {_kind(material) for material in materials}
