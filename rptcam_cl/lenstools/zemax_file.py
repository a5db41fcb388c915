"""A lens as a sequential Zemax file, which our reader, optiland and ray-optics read back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, permutations

from rptcam_cl.colour import LINE_D_NM
from rptcam_cl.lenstools.foreign import (
    WAVELENGTHS_NM,
    Row,
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
    Lens,
    Medium,
    Surface,
    Toroid,
    glass_named,
    named_glass,
)

HIGHEST = 8  # parameters of an asphere


def zemax_text(lens: Lens) -> str:
    """Return the Zemax file of a lens, for a distant object; lengths in millimetres.

    Raises
    ------
    InputError
        With every reason why such a file cannot say this lens.
    """
    refuse(lens, ".zmx file", chain(sequence_reasons(lens), _reasons(lens)))
    beam = beam_of(lens)
    makers = _makers(lens)
    catalogues = " ".join([*map(str.upper, makers), "MISC"])
    lines = ["VERS 140730 0 0", "MODE SEQ", f"NAME {one_line(lens.name)}", "UNIT MM X W X CM MR CPMM"]
    lines += [f"ENPD {number(beam.pupil_diameter)}", f"GCAT {catalogues}"]
    count = len(beam.fields)
    lines += [f"FTYP 0 0 {count} {len(WAVELENGTHS_NM)} 0 0 0", f"XFLN {numbers([0] * count)}"]
    lines += [f"YFLN {numbers(beam.fields)}", f"FWGN {numbers([1] * count)}"]
    lines += [f"{word} {numbers([0] * count)}" for word in ("VDXN", "VDYN", "VCXN", "VCYN", "VANN")]
    lines += [f"WAVM {k} {number(nm / 1000)} 1.0" for k, nm in enumerate(WAVELENGTHS_NM, start=1)]
    lines.append(f"PWAV {1 + WAVELENGTHS_NM.index(LINE_D_NM)}")
    blocks = [["  TYPE STANDARD", "  CURV 0.0", "  DISZ INFINITY"]]
    for row in rows_of(lens, beam):
        blocks += _surface(row, makers)
    blocks.append(["  TYPE STANDARD", "  CURV 0.0", "  DISZ 0.0"])
    for k, block in enumerate(blocks):
        lines += [f"SURF {k}", *block]
    return "\n".join([*lines, ""])


def _makers(lens: Lens) -> tuple[str, ...]:
    """Return the makers of the glasses of a lens, in an order in which every name means the glass of its maker."""
    found = {surface.glass.name: maker_and_name(surface.glass) for surface in lens.surfaces}
    makers = tuple(dict.fromkeys(entry[0] for entry in found.values() if entry))
    for order in permutations(makers):
        if all(_means(entry[1], order, written) for written, entry in found.items() if entry):
            return order
    return makers


def _means(name: str, makers: Sequence[str], written: str) -> bool:
    meant = named_glass(name, makers)
    return meant is not None and meant.written == written


def _surface(row: Row, makers: Sequence[str]) -> list[list[str]]:
    """Return the lines of a surface; of a tilted one with the coordinate breaks around it."""
    surface, gap = row.surface, row.gap
    kind, parameters = _kind(surface)
    conic = 0.0 if surface.cylinder == "x" else surface.conic
    lines = ["  STOP"] if row.is_stop else []
    lines += [f"  TYPE {kind}", f"  CURV {number(row.curvature)} 0 0 0 0"]
    lines += [f"  PARM {k} {number(value)}" for k, value in sorted(parameters.items())]
    lines.append(f"  DISZ {number(gap if surface.pose is None else 0.0)}")
    if surface.is_mirror:
        lines.append("  GLAS MIRROR 0 0 1.5 40")
    elif surface.glass != AIR:
        lines.append(f"  GLAS {_glass(surface.glass, makers)}")
    if conic:
        lines.append(f"  CONI {number(conic)}")
    lines.append(f'  DIAM {number(surface.semi_diameter)} 1 0 0 1 ""')
    if surface.inner_semi_diameter or _is_bare_plane(surface):  # whose semi-diameter alone would stop nothing
        lines.append(f"  CLAP {number(surface.inner_semi_diameter)} {number(surface.semi_diameter)} 0")
    if surface.region is not None:
        lines.append(f"  SQAP {number(surface.region.half_width)} {number(surface.region.half_height)}")
    if surface.pose is None:
        return [lines]
    (x, y, z), (a, b, c) = surface.pose.offset, tilts(surface.pose)
    there, back = _break((x, y), (a, b, c), False, 0.0), _break((-x, -y), (-a, -b, -c), True, gap - z)
    ahead = [_break((0, 0), (0, 0, 0), False, z)] if z else []
    return [*ahead, there, lines, back]


def _is_bare_plane(surface: Surface) -> bool:
    shaped = surface.curvature or surface.aspheric or surface.form or surface.is_mirror
    return not (shaped or surface.is_stop or surface.region) and surface.glass == AIR


def _break(
    decentre: tuple[float, float], turns: tuple[float, float, float], turns_first: bool, gap: float
) -> list[str]:
    values = [*decentre, *turns, 1.0 if turns_first else 0.0]
    parameters = [f"  PARM {k} {number(value)}" for k, value in enumerate(values, start=1)]
    return ["  TYPE COORDBRK", "  CURV 0.0", *parameters, f"  DISZ {number(gap)}"]


def _kind(surface: Surface) -> tuple[str, dict[int, float]]:
    """Return the type of a surface and its parameters."""
    powers = dict(surface.aspheric)
    if surface.cylinder == "x" and not surface.conic:  # a straight line, turned about an axis parallel to y
        return "TOROIDAL", {1: 1 / surface.curvature if surface.curvature else 0.0}
    if surface.cylinder == "x":
        return "BICONICX", {1: 1 / surface.curvature if surface.curvature else 0.0, 2: surface.conic}
    form = surface.form
    if isinstance(form, Biconic):
        return "BICONICX", {1: 1 / form.curvature_x if form.curvature_x else 0.0, 2: form.conic_x}
    if surface.cylinder or isinstance(form, Toroid):
        radius = 1 / form.curvature_x if isinstance(form, Toroid) and form.curvature_x else 0.0
        return "TOROIDAL", {1: radius, **{power // 2 + 1: value for power, value in powers.items()}}
    if not powers:
        return "STANDARD", {}
    if all(power % 2 == 0 for power in powers):
        return "EVENASPH", {k: powers.get(2 * k, 0.0) for k in range(1, HIGHEST + 1)}
    return "ODDASPHE", {k: powers.get(k, 0.0) for k in range(1, HIGHEST + 1)}


def _glass(medium: Medium, makers: Sequence[str]) -> str:
    if (found := maker_and_name(medium)) and _means(found[1], makers, medium.name):
        return f"{found[1].replace(' ', '_')} 0 0 1.5 40.0 0 0 0 0 0 0"
    if medium.name == "fused silica" and glass_named(medium.name) == medium:
        return "F_SILICA 0 0 1.5 40.0 0 0 0 0 0 0"
    nd, vd = model_of(medium)
    return f"___BLANK 1 0 {number(nd)} {number(vd)} 0 0 0 0 0 0"


def _reasons(lens: Lens) -> Iterator[tuple[int, str]]:
    for k, surface in enumerate(lens.surfaces):
        powers = [power for power, _ in surface.aspheric]
        straight = surface.cylinder or isinstance(surface.form, Toroid)
        even = all(power % 2 == 0 for power in powers)
        highest = 2 * (HIGHEST - 1) if straight else 2 * HIGHEST if even else HIGHEST
        if max(powers, default=0) > highest:
            yield k, f"a power of r is above {highest}"
        if powers and (surface.cylinder == "x" or (not even and straight)):
            yield k, "it is a cylinder or toroid with such powers of r"
        if surface.pose is not None and surface.pose.offset[2] and k == 0:
            yield k, "the first surface is decentred along the axis"
