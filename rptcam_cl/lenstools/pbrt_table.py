"""A lens as a pbrt table: radius, thickness to the next row, index behind, diameter, in millimetres.

pbrt takes radius 0 for the stop, so it cannot have plane glass; it knows spheres in a row and one index for each glass.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rptcam_cl.colour import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.lenstools.foreign import IN_AIR, refuse
from rptcam_cl.lenstools.lens_state import setting
from rptcam_cl.optics import Lens, Surface, short_radius


def pbrt_text(lens: Lens, wavelength_nm: float = LINE_D_NM) -> str:
    """Return the table of a lens, with its indices at a wavelength [nm]; the last thickness is the film's, at infinity.

    Raises
    ------
    InputError
        With every reason why a table cannot say this lens.
    """
    refuse(lens, ".dat table", _reasons(lens, wavelength_nm), _of_whole(lens))
    film = setting(lens, wavelength_nm=wavelength_nm).film_distance_mm or 0.0
    indices = lens.indices(wavelength_nm)
    lines = [f"# {line}" for line in (*lens.name.splitlines(), *lens.source.splitlines())]
    lines.append(f"# radius  thickness  index at {wavelength_nm:g} nm  diameter  [mm]")
    for k, surface in enumerate(lens.surfaces):
        radius = short_radius(surface.curvature) if surface.curvature else 0.0
        index = 0.0 if surface.is_stop else float(indices[k + 1])
        thickness = surface.thickness if k < len(lens.surfaces) - 1 else film
        lines.append(f"{radius!r}\t{thickness!r}\t{index!r}\t{2 * surface.semi_diameter!r}")
    return "\n".join([*lines, ""])


def loses_dispersion(lens: Lens) -> bool:
    """Return whether some glass of the lens bends colours differently, which a table cannot say."""
    return bool(np.ptp(lens.indices([LINE_F_NM, LINE_C_NM]), axis=1).max() > 0)


def _reasons(lens: Lens, wavelength_nm: float) -> Iterator[tuple[int, str]]:
    indices = lens.indices(wavelength_nm)
    for k, surface in enumerate(lens.surfaces):
        for reason in _surface_reasons(surface, float(indices[k]), float(indices[k + 1])):
            yield k, reason


def _of_whole(lens: Lens) -> Iterator[str]:
    if len(lens.surfaces) > 2 and lens.surfaces[0].thickness == 0:
        yield "the first thickness is 0, which readers take for the older kind of table"


def _surface_reasons(surface: Surface, before: float, after: float) -> Iterator[str]:
    shapes = {
        "conic": surface.conic,
        "aspheric": surface.aspheric,
        "cylindrical": surface.cylinder,
        "tilted or decentred": surface.pose is not None,
        "not round": surface.region is not None or surface.stop_shape is not None,
        "without diameter": not np.isfinite(surface.semi_diameter),
        "of negative thickness": surface.thickness < 0,
        "a mirror": surface.is_mirror,
        "a ring": surface.inner_semi_diameter > 0,
    }
    yield from (text for text, found in shapes.items() if found)
    if surface.form is not None:
        yield surface.form.description
    if surface.is_stop and surface.curvature:
        yield "a stop on curved glass"
    elif surface.is_stop and max(abs(before - 1), abs(after - 1)) > IN_AIR:
        yield "a stop that is not in air"
    elif not surface.is_stop and not surface.curvature:
        yield "a plane, which a table has for the stop only"
    if not 1 <= after <= 5:
        yield f"an index of {after:g}"
