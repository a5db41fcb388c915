"""The surfaces of a lens as device records, in the order in which rays from one side meet them."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.optics import Lens
from rptcam_cl.records import SURFACE


def surface_records(
    lens: Lens, wavelength_nm: float, start: Literal["film", "scene"], first_gap_mm: float
) -> NDArray[np.void]:
    """Return one record per surface in order of travel.

    Parameters
    ----------
    start
        Side where rays begin. The device's z runs along the direction of travel, so curvatures change sign for rays
        from the film.
    first_gap_mm
        Distance along the travel from the plane z = 0 of the rays to the first vertex they meet.
    """
    indices = lens.indices(wavelength_nm)
    count = len(lens.surfaces)
    backwards = start == "film"
    order = range(count - 1, -1, -1) if backwards else range(count)
    records = SURFACE.zeros(count)
    previous = None
    for record, k in zip(records, order, strict=True):
        surface = lens.surfaces[k]
        before, after = (indices[k + 1], indices[k]) if backwards else (indices[k], indices[k + 1])
        record["curvature"] = -surface.curvature if backwards else surface.curvature
        record["gap"] = first_gap_mm if previous is None else abs(lens.vertices[k] - lens.vertices[previous])
        record["semi_diameter2"] = np.square(surface.semi_diameter)
        record["eta"] = before / after
        previous = k
    return records
