"""How much light longer paths could add at most, from the largest reflectance of the scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.records import MaterialKind


def largest_reflectance(materials: NDArray[np.void]) -> float:
    """Return a bound of the share of light that any surface sends on: 1 wherever that is not one colour of a matte or
    mirroring surface, as on glass, behind a cover, or with textures and spectra."""
    bound = 0.0
    for record in materials:
        if record["kind"] in (MaterialKind.EMISSIVE, -1):
            continue
        plain = record["kind"] in (MaterialKind.MATTE, MaterialKind.MIRROR)
        plain &= record["texture"] < 0 and record["opacity_texture"] < 0 and record["color"][3] == 0
        bound = max(bound, float(record["color"][:3].max()) if plain and record["opacity"] == 1 else 1.0)
    return bound


def truncation_bound(reflectance: float, depth: int) -> float:
    """Return the most that paths of more than ``depth`` edges add, relative to the brightest lamp's radiance.

    A path of d edges is reflected at most d - 1 times, so that what is missing is at most the rest of a geometric
    series, r^d / (1 - r); infinite where nothing is known of the reflectance.
    """
    return reflectance**depth / (1 - reflectance) if reflectance < 1 else np.inf
