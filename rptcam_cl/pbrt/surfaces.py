"""Materials of ours as plain keys."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.pbrt.roughness import alpha_keys
from rptcam_cl.pbrt.textures import Shade

Keys = dict[str, Any]

# A rough surface whose index is nearer to 1 has no facets that could be told apart (see scene.dielectric).
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
    """Return a transparent solid; one that hardly bends light is smooth, as ours must be."""
    rough = alpha_keys(alphas) if abs(index - 1) >= LEAST_BEND else {}
    return {"kind": "dielectric", "index": index, **rough}


def has_effect(shade: Shade) -> bool:
    """Return whether a share is more than nothing."""
    return shade.texture is not None or bool(shade.colour.max() > NOTHING)


def luminance(colour: NDArray[np.float64]) -> float:
    """Return the luminance of linear sRGB."""
    return float(colour @ (0.2126, 0.7152, 0.0722))
