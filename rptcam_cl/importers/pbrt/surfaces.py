"""Materials of ours as plain keys, and pbrt's roughness as GGX's alpha."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.state import Entity
from rptcam_cl.importers.pbrt.textures import Shade, value

Keys = dict[str, Any]

# A rough surface whose index is nearer to 1 has no distinguishable facets (see scene.dielectric).
LEAST_BEND = 0.01

# A share of light that is too small to matter.
NOTHING = 1e-6


def matte(reflectance: Shade | NDArray[np.float64]) -> Keys:
    """Return a surface that scatters evenly."""
    shade = reflectance if isinstance(reflectance, Shade) else Shade(reflectance)
    return {"kind": "matte", "reflectance": shade.keys()}


def conductor(metal: Keys, alphas: tuple[float, float] | None) -> Keys:
    """Return a metal; ours are rough, a smooth one has the least alpha there is."""
    return {"kind": "conductor", **metal, **alpha_keys(alphas or (0.0, 0.0))}


def dielectric(index: float, alphas: tuple[float, float] | None) -> Keys:
    """Return a transparent solid; one with an index near 1 is smooth, as ours must be."""
    rough = alpha_keys(alphas) if abs(index - 1) >= LEAST_BEND else {}
    return {"kind": "dielectric", "index": index, **rough}


def has_effect(shade: Shade) -> bool:
    """Return whether a share is more than nothing."""
    return shade.texture is not None or bool(shade.colour.max() > NOTHING)


# Ours is smooth below; pbrt-v4 calls a surface smooth below it, too (TrowbridgeReitzDistribution::EffectivelySmooth).
SMOOTH = 1e-3
ONLY_V3 = (
    "matte", "plastic", "glass", "metal", "mirror", "uber", "substrate", "translucent", "disney", "kdsubsurface",
    "fourier",
)  # fmt: skip


def alpha_of(roughness: float, *, version: int) -> float:
    """Return GGX's alpha of a roughness that is to be remapped.

    pbrt-v3 fits a polynomial to the logarithm (TrowbridgeReitzDistribution::RoughnessToAlpha), pbrt-v4 takes the root.
    """
    if version == 4:
        return math.sqrt(max(roughness, 0.0))
    x = math.log(max(roughness, 1e-3))
    return 1.62142 + 0.819955 * x + 0.1734 * x**2 + 0.0171201 * x**3 + 0.000640711 * x**4


def alphas(context: Context, entity: Entity, default: float, prefix: str = "") -> tuple[float, float] | None:
    """Return alpha along u and v of a material, None where it is smooth."""
    version = 3 if entity.kind in ONLY_V3 else 4
    both = value(context, entity, f"{prefix}roughness", default)
    pair = (
        value(context, entity, f"{prefix}uroughness", both),
        value(context, entity, f"{prefix}vroughness", both),
    )
    # 0 is smooth in either release: pbrt-v3 asks before it remaps, pbrt-v4 after
    if max(pair) <= 0:
        entity.parameters.boolean("remaproughness", True)
        return None
    if entity.parameters.boolean("remaproughness", True):
        pair = (alpha_of(pair[0], version=version), alpha_of(pair[1], version=version))
    return None if max(pair) < SMOOTH else pair


def alpha_keys(pair: tuple[float, float] | None) -> dict[str, object]:
    """Return the key of a rough material, nothing for a smooth one."""
    if pair is None:
        return {}
    u, v = (min(max(alpha, SMOOTH), 1.0) for alpha in pair)
    return {"alpha": u if u == v else [u, v]}
