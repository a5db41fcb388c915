"""What files of other programs have in common when a lens is written: what they cannot say, beam, rows, tilts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from rptcam_cl.colour import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.fields import default_fields
from rptcam_cl.lenstools.lens_state import setting
from rptcam_cl.optics import (
    NO_DISPERSION,
    AbbeCauchy,
    Biconic,
    Lens,
    Medium,
    Surface,
    SurfacePose,
    Toroid,
    abbe_number,
    glass_named,
    glasses_of,
    limiting_surface,
    named_glass,
    plain_glass_name,
)

WAVELENGTHS_NM = (LINE_F_NM, LINE_D_NM, LINE_C_NM)
IN_AIR = 1e-9


@dataclass(frozen=True)
class Beam:
    """What a sequence says beside its surfaces: entrance pupil [mm], fields [degrees], last vertex to film [mm]."""

    pupil_diameter: float
    fields: tuple[float, ...]
    film: float


def beam_of(lens: Lens) -> Beam:
    """Return the beam of a lens for a distant object; the field is only the axis where the lens has no other."""
    use = setting(lens)
    pupil = lens.first_order().entrance_pupil.diameter_mm
    try:
        fields = sorted({round(angle, 6) for angle in default_fields(use)})
    except InputError:
        fields = [0.0]
    return Beam(pupil if math.isfinite(pupil) else 0.0, tuple(fields), use.film_distance_mm or 0.0)


@dataclass(frozen=True)
class Row:
    """What both say of a surface: curvature in the plane of y [1/mm], gap behind it [mm], whether it is the stop."""

    surface: Surface
    curvature: float
    gap: float
    is_stop: bool


def rows_of(lens: Lens, beam: Beam) -> Iterator[Row]:
    """Yield the surfaces of a lens; the last gap is the film's."""
    stop, last = limiting_surface(lens), len(lens.surfaces) - 1
    for k, surface in enumerate(lens.surfaces):
        curvature = 0.0 if surface.cylinder == "x" else surface.curvature
        yield Row(surface, curvature, lens.sense * beam.film if k == last else surface.thickness, k == stop)


def refuse(lens: Lens, form: str, of_surfaces: Iterable[tuple[int, str]], of_whole: Iterable[str] = ()) -> None:
    """Raise an error with every reason why a form, such as ``.seq file``, cannot say a lens.

    Parameters
    ----------
    of_surfaces : iterable of (int, str)
        Reasons that lie in a surface, with its number.
    of_whole : iterable of str
        Reasons that lie in the lens as a whole, beside those that every form has.
    """
    reasons = []
    if abs(float(lens.object_medium.index(LINE_D_NM)) - 1) > IN_AIR:
        reasons.append(f"the medium in front of it is {lens.object_medium.name}, not air: a {form} begins in air")
    if lens.configurations:
        reasons.append("it is a zoom lens (choose a focal length)")
    where: dict[str, list[str]] = {}
    for k, reason in of_surfaces:
        where.setdefault(reason, []).append(str(k))
    reasons += [f"{reason} (surface {', '.join(places)})" for reason, places in where.items()]
    reasons += of_whole
    if reasons:
        raise InputError(f"{lens.name}: a {form} cannot say it: {'; '.join(reasons)}")


def left_out(lens: Lens) -> list[str]:
    """Return what neither form keeps and no ray depends on, for a warning."""
    notes = []
    if any(surface.coating is not None for surface in lens.surfaces):
        notes.append("coatings are left out")
    if lens.focusing is not None or lens.floating:
        notes.append("what moves to focus is left out: the lens is written as its file has it")
    return notes


def maker_and_name(medium: Medium) -> tuple[str, str] | None:
    """Return the maker and the maker's name of a catalogue glass, None for any other medium."""
    found = named_glass(medium.name) if medium.name else None
    if found is None or not found.maker or glass_named(found.written) != medium:
        return None
    base, _, _ = found.written.rpartition("_")
    glasses = glasses_of(found.maker)
    glass = glasses.get(plain_glass_name(found.written)) or glasses.get(plain_glass_name(base))
    return (found.maker, glass.name) if glass else (found.maker, found.written)


def model_of(medium: Medium) -> tuple[float, float]:
    """Return n_d and V_d of a medium; of one without dispersion `NO_DISPERSION`, as programs divide by V_d."""
    if isinstance(medium, AbbeCauchy):
        return medium.nd, medium.vd
    nd, vd = float(medium.index(LINE_D_NM)), abbe_number(medium)
    return nd, vd if 0 < vd < NO_DISPERSION else NO_DISPERSION


def tilts(pose: SurfacePose) -> tuple[float, float, float]:
    """Return right-handed turns [degrees] about x, then the new y, then the new z, that make up the tilt of a pose."""
    r = pose.matrix()
    y = math.asin(float(np.clip(r[0, 2], -1, 1)))
    x, z = math.atan2(-r[1, 2], r[2, 2]), math.atan2(-r[0, 1], r[0, 0])
    return math.degrees(x), math.degrees(y), math.degrees(z)


def number(value: float) -> str:
    """Return a number with as many digits as it needs."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Return numbers in a line, with as many digits as they need."""
    return " ".join(map(number, values))


def one_line(text: str) -> str:
    """Return a text without what would end a line or a quotation."""
    return " ".join(text.replace("'", " ").replace('"', " ").split())


def sequence_reasons(lens: Lens) -> Iterator[tuple[int, str]]:
    """Yield why neither Zemax nor CODE V can say a surface, with its number."""
    for k, surface in enumerate(lens.surfaces):
        if surface.stop_shape is not None:
            yield k, "the stop is not round"
        if not math.isfinite(surface.semi_diameter):
            yield k, "it has no diameter"
        region = surface.region
        if region is not None and (region.inverted or region.normal_degrees is not None or not region.blocks):
            yield k, "only a part of it is there"
        if surface.form is not None and not isinstance(surface.form, Biconic | Toroid):
            yield k, f"it is {surface.form.description}"
        if isinstance(surface.form, Biconic) and surface.aspheric:
            yield k, "it is a biconic with powers of r"
