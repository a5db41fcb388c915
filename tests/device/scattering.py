"""What the kernels' BSDFs say at a flat vertex, for materials of the scene."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device.session import Session
from rptcam_cl.rendering.plan.materials import facet_shares, pack_materials
from rptcam_cl.rendering.plan.textures import KnownSpectra, TextureTable
from rptcam_cl.scene.load import load_scene
from tests.device.probes import run
from tests.rendering.test_world import still_life

LANES = 8
# Every feature, in one program; no pictures, and each vertex of one material.
FEATURES = ("MATTE", "MIRROR", "CONDUCTOR", "DIELECTRIC", "METAL", "ROUGH_DIELECTRIC", "PLASTIC", "ROUGH_PLASTIC",
            "THIN_GLASS", "PRINCIPLED", "ANISOTROPY", "TRANSMISSION", "CLEARCOAT", "SHEEN", "TANGENT",
            "SPECULAR_COLOR", "SPHERE", "TRANSLUCENT", "GLASS_TINT", "OREN_NAYAR", "HAIR", "MEASURED",
            "THIN_FILM", "METALLIC")  # fmt: skip
ABSENT = ("ABSORPTION", "GLOW", "GLOW_BEHIND", "METALLIC_TEXTURE", "COAT_TEXTURE", "COAT_ROUGHNESS_TEXTURE",
          "SHEEN_TEXTURE", "ENTRIES", "SPECULAR_TEXTURE", "SPECULAR_COLOR_TEXTURE", "TRANSMISSION_TEXTURE",
          "PASSED_TEXTURE")  # fmt: skip
FACTS = {f"HAS_{name}": 1 for name in FEATURES} | {f"HAS_{name}": 0 for name in ABSENT} | {"VW": LANES, "HAS_MEDIA": 0}


@dataclass(frozen=True)
class Scattered:
    """Columns of the probe: BSDF times cosine and density of the given directions; directions sampled."""

    value: NDArray[np.float64]
    pdf: NDArray[np.float64]
    direction: NDArray[np.float64]
    weight: NDArray[np.float64]
    sampled_pdf: NDArray[np.float64]


def direction(cosine, turns=0.0):
    """Return unit vectors by cosine to z and azimuth [turns], shape (..., 3)."""
    cosine, turns = np.broadcast_arrays(np.asarray(cosine, float), turns)
    sine = np.sqrt(1 - cosine**2)
    return np.stack([sine * np.cos(2 * np.pi * turns), sine * np.sin(2 * np.pi * turns), cosine], axis=-1)


METAL = {"kind": "conductor", "reflectance": 1.0, "alpha": 0.3}


@cache
def pack(material: str, folder: Path, beside_metal: bool) -> tuple[Any, NDArray[Any]]:
    """Return the record of a material, given as JSON, with its facts, and the texels of its textures.

    Files that it names lie in ``folder``, where one of the same name as in another is another. ``beside_metal`` adds a
    second material, for which there are tables of facets.
    """
    scene = load_scene(still_life() | {"materials": {"tested": json.loads(material), "metal": METAL}})
    textures = TextureTable(scene)
    packed = pack_materials(list(scene.materials.values())[: 1 + beside_metal], textures, KnownSpectra())
    return packed, textures.pack().texels


def scatter(session: Session, material, wi, wo=None, numbers=None, *, again: bool = False) -> Scattered:
    """Return what a material does to light from ``wo`` to ``wi`` (n, 3), and samples by ``numbers`` (n, 3).

    ``again`` adds the light that facets scatter more than once, as renders do.
    """
    wi = np.atleast_2d(wi)
    count = max(len(np.atleast_2d(part)) for part in (wi, wo, numbers) if part is not None)
    padded = -(-count // 256) * 256
    wo = wi if wo is None else wo
    numbers = np.full(3, 0.5) if numbers is None else numbers
    table = np.zeros((9, padded), np.float32)
    table[2], table[5] = -1, 1
    for first, part in ((0, -wi), (3, np.asarray(wo)), (6, np.asarray(numbers))):
        table[first : first + 3, :count] = np.broadcast_to(np.atleast_2d(part), (count, 3)).T
    packed, texels = pack(json.dumps(material), Path.cwd(), again)
    records, base = packed.records, packed.facts["HAS_BRUSHED_BASE"]
    if again and packed.facts["HAS_ANISOTROPY"] and packed.facts["FACET_SHARES"]:
        base = 1  # a program that knows of brushed bases does for all that is brushed
    shared = int((again or base) and packed.facts["FACET_SHARES"])
    tables = facet_shares(records) if shared else np.zeros(1, np.float32)
    facts = FACTS | {"FACET_ENERGY": int(again), "FACET_SHARES": shared, "HAS_BRUSHED_BASE": base}
    if shared:  # the tables are of brushed metal where something is brushed
        facts["HAS_ANISOTROPY"] = packed.facts["HAS_ANISOTROPY"]
    if packed.facts["HAS_ROUGHNESS_TEXTURE"]:  # its tables, at the greatest alpha that it may give
        facts |= {"HAS_ROUGHNESS_TEXTURE": 1, "HAS_TEXTURE": 1}
        records = records.copy()
        records["roughness_texture"] = -1
    out = session.allocate(11 * 4 * padded)
    run(
        session, "probe_scatter", facts, padded // LANES,
        materials=session.upload(records),
        facet_shares=session.upload(tables), texels=session.upload(texels),
        material=np.int32(0), out=out, capacity=np.uint32(padded), **{"in": session.upload(table)},
    )  # fmt: skip
    rows = session.read(out, np.float32, 11 * padded).reshape(11, padded)[:, :count].astype(np.float64)
    return Scattered(rows[:3].T, rows[3], rows[4:7].T, rows[7:10].T, rows[10])
