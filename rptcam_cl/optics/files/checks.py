"""Geometric sanity of a prescription: what cannot be a lens is refused, what is doubtful becomes a warning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rptcam_cl.errors import InputError
from rptcam_cl.optics.first_order import first_order
from rptcam_cl.optics.glass import WAVELENGTH_D
from rptcam_cl.optics.lens import Lens

Report = Callable[[int, str, str], InputError]

LONGEST_PLAUSIBLE_MM = 10_000.0


def check_lens(lens: Lens, report: Report) -> Lens:
    """Return the lens with its warnings, or raise the `report(surface, key, text)` of its first impossibility."""
    for index, surface in enumerate(lens.surfaces):
        if surface.semi_diameter * abs(surface.curvature) > 1 + 1e-9:
            raise report(
                index,
                "diameter",
                f"the diameter {2 * surface.semi_diameter:g} mm is more than twice the radius "
                f"{abs(surface.radius):g} mm, so the surface does not reach its rim",
            )
        if surface.thickness < 0 and not (surface.is_stop or lens.surfaces[index + 1].is_stop):
            raise report(
                index, "thickness", f"must not be negative except beside the stop (got {surface.thickness:g} mm)"
            )
    _check_gaps(lens, report)
    if all(surface.is_stop for surface in lens.surfaces):
        raise report(0, "stop", "a lens needs at least one surface beside its stop")
    return replace(lens, warnings=(*lens.warnings, *_doubts(lens)))


def _check_gaps(lens: Lens, report: Report) -> None:
    """Refuse neighbouring surfaces that cross inside the smaller of their rims. A plane stop has no body to cross."""
    for index, (first, second) in enumerate(zip(lens.surfaces, lens.surfaces[1:], strict=False)):
        if first.is_stop or second.is_stop:
            continue
        height = min(first.semi_diameter, second.semi_diameter)
        if not np.isfinite(height):
            continue
        gap = first.thickness + second.rim_sag(height) - first.rim_sag(height)
        if gap < -1e-6 * max(1.0, height):
            raise report(
                index,
                "thickness",
                f"surfaces {index} and {index + 1} cross: they overlap by {-gap:.4g} mm at {height:g} mm from the axis",
            )


def _doubts(lens: Lens) -> tuple[str, ...]:
    doubts = []
    data = first_order(lens, WAVELENGTH_D)
    length = abs(data.focal_length_mm)
    if LONGEST_PLAUSIBLE_MM < length < np.inf:
        doubts.append(f"focal length {data.focal_length_mm:.6g} mm: are the lengths in metres or micrometres?")
    if np.any(lens.indices(WAVELENGTH_D) < 1):
        doubts.append("a medium has an index below 1")
    return tuple(doubts)
