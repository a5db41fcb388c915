"""A lens as a CODE V sequence, which our reader, optiland and ray-optics read back."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from rptcam_cl.colour import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.lenstools.foreign import (
    WAVELENGTHS_NM,
    beam_of,
    maker_and_name,
    model_of,
    number,
    numbers,
    one_line,
    refuse,
    rows_of,
    sequence_reasons,
    tilts,
)
from rptcam_cl.optics import (
    AIR,
    Biconic,
    ConstantIndex,
    Lens,
    Medium,
    Surface,
    Toroid,
    held_index,
    plain_glass_name,
)

POWERS = dict(zip(range(4, 22, 2), "ABCDEFGHJ", strict=True))
PRIVATE_NM = (404.66, 435.83, LINE_F_NM, 546.07, LINE_D_NM, 632.8, LINE_C_NM, 706.52)  # of private glasses


def codev_text(lens: Lens) -> str:
    """Return the CODE V sequence of a lens, for a distant object; lengths in millimetres.

    Raises
    ------
    InputError
        With every reason why such a sequence cannot say this lens.
    """
    refuse(lens, ".seq file", chain(sequence_reasons(lens), _reasons(lens)))
    beam = beam_of(lens)
    private: dict[Medium, str] = {}
    words = ["REFL" if surface.is_mirror else _glass(surface.glass, private) for surface in lens.surfaces]
    title = one_line(lens.name)
    title = f" {title}" if title.startswith("Z") else title  # which readers take for a position of a zoom
    lines = ["RDM N;LEN", f"TITLE '{title}'", f"EPD {number(beam.pupil_diameter)}", "DIM M"]
    lines.append(f"WL {numbers(reversed(WAVELENGTHS_NM))}")
    lines += [f"REF {len(WAVELENGTHS_NM) - WAVELENGTHS_NM.index(LINE_D_NM)}", "WTW 1 1 1"]
    lines += [f"XAN {numbers([0] * len(beam.fields))}", f"YAN {numbers(beam.fields)}"]
    if private:
        lines += ["PRV", f"  PWL {numbers(PRIVATE_NM)}"]
        lines += [f"  '{name}' {numbers(_indices(medium))}" for medium, name in private.items()]
        lines.append("END")
    lines.append("SO 0.0 1.0E+13")
    for row, word in zip(rows_of(lens, beam), words, strict=True):
        lines.append(f"S {number(row.curvature)} {number(row.gap)} {word}".rstrip())
        lines += [f"  {line}" for line in _details(row.surface, row.is_stop)]
    return "\n".join([*lines, "SI 0.0 0.0", "GO", ""])


def _details(surface: Surface, is_stop: bool) -> Iterator[str]:
    if is_stop:
        yield "STO"
    yield f"CIR {number(surface.semi_diameter)}"
    if surface.inner_semi_diameter:
        yield f"CIR HOL {number(surface.inner_semi_diameter)}"
    if surface.region is not None:
        yield f"REX {number(surface.region.half_width)}"
        yield f"REY {number(surface.region.half_height)}"
    if surface.cylinder:
        yield "CYL"
    elif isinstance(surface.form, Toroid):
        yield "YTO"
        yield f"CUX {number(surface.form.curvature_x)}"
    if surface.aspheric:
        if not surface.cylinder and surface.form is None:
            yield "ASP"
        yield f"K {number(surface.conic)}"
        yield from (f"{POWERS[power]} {number(value)}" for power, value in surface.aspheric)
    elif surface.conic:
        yield "CON"
        yield f"K {number(surface.conic)}"
    if surface.pose is not None:
        x, y, z = surface.pose.offset
        a, b, c = tilts(surface.pose)
        yield f"XDE {number(x)}; YDE {number(y)}; ZDE {number(z)}"
        yield f"ADE {number(-a)}; BDE {number(-b)}; CDE {number(c)}"
        yield "DAR"


def _glass(medium: Medium, private: dict[Medium, str]) -> str:
    """Return the word of a glass; one that no catalogue has becomes a private glass.

    It is called by its n_d and V_d, which programs take who do not read private glasses.
    """
    if medium == AIR:
        return ""
    if found := maker_and_name(medium):
        return f"{plain_glass_name(found[1])}_{found[0].upper()}"  # CODE V has no hyphens
    if medium not in private:
        nd, vd = model_of(medium)
        name = f"{nd!r}:{vd!r}"
        while name in private.values():
            name = name.replace(":", "0:")  # the same numbers
        private[medium] = name
    return f"'{private[medium]}'"


def _indices(medium: Medium) -> list[float]:
    if isinstance(medium, ConstantIndex):
        return [medium.value] * len(PRIVATE_NM)
    return list(held_index(medium, np.array(PRIVATE_NM)))  # type: ignore[arg-type]


def _reasons(lens: Lens) -> Iterator[tuple[int, str]]:
    for k, surface in enumerate(lens.surfaces):
        if any(power not in POWERS for power, _ in surface.aspheric):
            yield k, "a power of r is odd, 2 or above 20"
        if surface.cylinder == "x" or isinstance(surface.form, Biconic):
            yield k, "it is a biconic, or a cylinder that curves in x"
