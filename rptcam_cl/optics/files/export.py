"""A lens as text: of our own form, which reads back as the same lens, CODE V, Zemax and pbrt."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, permutations, zip_longest
from typing import Any

import numpy as np

from rptcam_cl.core import LINE_C_NM, LINE_D_NM, LINE_F_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics import glass as media
from rptcam_cl.optics.files.glasses import find_glass, glasses_of, named_glass, plain_glass_name
from rptcam_cl.optics.glass import Coating, Medium
from rptcam_cl.optics.lens import Lens, brought_to_focus, in_configuration, limiting_surface
from rptcam_cl.optics.shapes import Biconic, Diffractive, Grating, IdealLens, Toroid, short_radius
from rptcam_cl.optics.spots import Setting, default_fields, setting
from rptcam_cl.optics.surface import FocusState, Region, StopShape, Surface, SurfacePose, tilt_of

# What files of other programs have in common when a lens is written: what they cannot say, beam, rows, tilts.

WAVELENGTHS_NM = (LINE_F_NM, LINE_D_NM, LINE_C_NM)
IN_AIR = 1e-9


def _beam_of(lens: Lens) -> tuple[float, tuple[float, ...], float]:
    """Return entrance pupil [mm], fields [degrees] and last vertex to film [mm] of a lens for a distant object.

    The field is only the axis where the lens has no other.
    """
    use = setting(lens)
    pupil = lens.first_order().entrance_pupil.diameter_mm
    try:
        fields = sorted({round(angle, 6) for angle in default_fields(use)})
    except InputError:
        fields = [0.0]
    return pupil if math.isfinite(pupil) else 0.0, tuple(fields), use.film_distance_mm or 0.0


def rows_of(lens: Lens, film_distance_mm: float) -> Iterator[tuple[Surface, float, float, bool]]:
    """Yield each surface, its curvature in the plane of y [1/mm], the gap behind it [mm] and whether it is the stop."""
    stop, last = limiting_surface(lens), len(lens.surfaces) - 1
    for k, surface in enumerate(lens.surfaces):
        curvature = 0.0 if surface.cylinder == "x" else surface.curvature
        yield surface, curvature, lens.sense * film_distance_mm if k == last else surface.thickness, k == stop


def _positions_of(lens: Lens) -> tuple[list[str], list[Setting]]:
    """Return the zoom positions of a lens, far away, and then those of their floating groups in the same order.

    First come their names; each is the lens as it stands there, or as it is focused nearer.
    """
    far = [in_configuration(lens, each.name) for each in lens.configurations] or [lens]
    own_names = [each.name for each in lens.configurations] or ["far"]
    names = list(own_names)
    places = [Setting(state, setting(replace(state, configurations=())).film_distance_mm or 0.0) for state in far]
    for states in zip_longest(*(state.floating for state in far)):
        for name, state, near in zip(own_names, far, states, strict=True):
            if near is None:
                raise InputError(f"{lens.name}: its zoom positions focus nearer in different numbers of states")
            focused, film = brought_to_focus(replace(state, configurations=()), near.distance_mm)
            away = near.distance_mm - focused.length - film
            names.append(f"{name}, {near.distance_mm:g} mm")
            places.append(Setting(focused, film, away))
    return names, places


def _gaps_that_vary(places: Sequence[Setting]) -> Iterator[tuple[int, list[float]]]:
    """Yield the surfaces behind which spaces differ between positions, with these; the last one's ends at the film."""
    last = len(places[0].lens.surfaces) - 1
    for k in range(last + 1):
        gaps = [one.film if k == last else one.lens.surfaces[k].thickness for one in places]
        if len(set(gaps)) > 1:
            yield k, gaps


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
    if lens.fold is not None:
        reasons.append("its axis is folded, and its film stands across the last part of it")
    where: dict[str, list[str]] = {}
    for k, reason in of_surfaces:
        where.setdefault(reason, []).append(str(k))
    reasons += [f"{reason} (surface {', '.join(places)})" for reason, places in where.items()]
    reasons += of_whole
    if reasons:
        raise InputError(f"{lens.name}: a {form} cannot say it: {'; '.join(reasons)}")


def left_out(lens: Lens) -> list[str]:
    """Return warnings about parts of a lens that neither form keeps and no ray depends on."""
    notes = []
    if any(surface.coating is not None for surface in lens.surfaces):
        notes.append("coatings are left out")
    if lens.focusing is not None:
        notes.append("what moves to focus is left out: the lens is written as its file has it")
    return notes


def with_model_glasses(lens: Lens) -> Lens:
    """Return the lens with glasses of the same indices that no catalogue knows."""
    glasses = {k: surface.glass for k, surface in enumerate(lens.surfaces) if surface.glass != media.AIR}
    return lens.with_changes({k: {"glass": replace(glass, name="")} for k, glass in glasses.items()})  # type: ignore[call-arg]


def _maker_and_name(medium: Medium) -> tuple[str, str] | None:
    """Return the maker and the maker's name of a catalogue glass, None for any other medium."""
    named = named_glass(medium.name) if medium.name else None
    if named is None or not named.maker or find_glass(named.written) != medium:
        return None
    base, _, _ = named.written.rpartition("_")
    glasses = glasses_of(named.maker)
    glass = glasses.get(plain_glass_name(named.written)) or glasses.get(plain_glass_name(base))
    return (named.maker, glass.name) if glass else (named.maker, named.written)


def _model_of(medium: Medium) -> tuple[float, float]:
    """Return n_d and V_d of a medium; of one without dispersion `NO_DISPERSION`, as programs divide by V_d."""
    if isinstance(medium, media.AbbeCauchy):
        return medium.nd, medium.vd
    nd, vd = float(medium.index(LINE_D_NM)), media.abbe_number(medium)
    return nd, vd if 0 < vd < media.NO_DISPERSION else media.NO_DISPERSION


def tilts(pose: SurfacePose) -> tuple[float, float, float]:
    """Return right-handed turns [degrees] about x, then the new y, then the new z, that make up the tilt of a pose."""
    x, y, z = tilt_of(pose.matrix().T)  # of the way back, which turns in the other order
    return -x, -y, -z


def number(value: float) -> str:
    """Return a number with as many digits as it needs."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Return numbers in a line, with as many digits as they need."""
    return " ".join(map(number, values))


def one_line(text: str) -> str:
    """Return a text without what would end a line or a quotation."""
    return " ".join(text.replace("'", " ").replace('"', " ").split())


def _sequence_reasons(lens: Lens) -> Iterator[tuple[int, str]]:
    """Yield why neither Zemax nor CODE V can say a surface, with its number."""
    for k, surface in enumerate(lens.surfaces):
        if surface.stop_shape is not None:
            yield k, "the stop is not round"
        if not math.isfinite(surface.semi_diameter):
            yield k, "it has no diameter"
        region = surface.region
        if region is not None and (region.inverted or region.normal_degrees is not None or not region.blocks):
            yield k, "only a part of it is there"
        elif region is not None and region.is_round:
            yield k, "its opening lies beside the axis"
        if surface.form is not None and not isinstance(surface.form, Biconic | Toroid):
            yield k, f"it is {surface.form.description}"
        if isinstance(surface.form, Biconic) and surface.aspheric:
            yield k, "it is a biconic with powers of r"


# A lens as a CODE V sequence, which our reader, optiland and ray-optics read back.

POWERS = dict(zip(range(4, 22, 2), "ABCDEFGHJ", strict=True))
_PRIVATE_NM = (404.66, 435.83, LINE_F_NM, 546.07, LINE_D_NM, 632.8, LINE_C_NM, 706.52)  # of private glasses


def codev_text(lens: Lens) -> str:
    """Return the CODE V sequence of a lens, for a distant object; lengths in millimetres.

    Raises
    ------
    InputError
        With every reason why such a sequence cannot say this lens.
    """
    refuse(lens, ".seq file", chain(_sequence_reasons(lens), _codev_reasons(lens)))
    pupil, fields, film = _beam_of(lens)
    private: dict[Medium, str] = {}
    words = ["REFL" if surface.is_mirror else _codev_glass(surface.glass, private) for surface in lens.surfaces]
    title = one_line(lens.name)
    title = f" {title}" if title.startswith("Z") else title  # which readers take for a position of a zoom
    lines = ["RDM N;LEN", f"TITLE '{title}'", f"EPD {number(pupil)}", "DIM M"]
    lines.append(f"WL {numbers(reversed(WAVELENGTHS_NM))}")
    lines += [f"REF {len(WAVELENGTHS_NM) - WAVELENGTHS_NM.index(LINE_D_NM)}", "WTW 1 1 1"]
    lines += [f"XAN {numbers([0] * len(fields))}", f"YAN {numbers(fields)}"]
    if private:
        lines += ["PRV", f"  PWL {numbers(_PRIVATE_NM)}"]
        lines += [f"  '{name}' {numbers(_indices(medium))}" for medium, name in private.items()]
        lines.append("END")
    lines.append("SO 0.0 1.0E+13")
    for (surface, curvature, gap, is_stop), word in zip(rows_of(lens, film), words, strict=True):
        lines.append(f"S {number(curvature)} {number(gap)} {word}".rstrip())
        lines += [f"  {line}" for line in _details(surface, is_stop)]
    return "\n".join([*lines, "SI 0.0 0.0", *_codev_positions(lens), "GO", ""])


def _codev_positions(lens: Lens) -> Iterator[str]:
    names, places = _positions_of(lens)
    if len(places) == 1:
        return
    yield f"ZOO {len(places)}"
    yield from (f"TIT Z{z} '{one_line(name)}'" for z, name in enumerate(names, start=1))
    away = [min(one.object_distance_mm, 1e13) for one in places]
    if len(set(away)) > 1:
        yield f"ZOO THI SO {numbers(away)}"
    yield f"ZOO EPD {numbers(one.lens.first_order().entrance_pupil.diameter_mm for one in places)}"
    yield from (f"ZOO THI S{k + 1} {numbers(gaps)}" for k, gaps in _gaps_that_vary(places))


def _details(surface: Surface, is_stop: bool) -> Iterator[str]:
    if is_stop:
        yield "STO"
    yield f"CIR {number(surface.semi_diameter)}"
    if surface.inner_semi_diameter:
        yield f"CIR HOL {number(surface.inner_semi_diameter)}"
    if surface.region is not None:
        yield f"REX {number(surface.region.half_width)}"
        yield f"REY {number(surface.region.half_height)}"
    if isinstance(surface.phase, IdealLens):
        yield f"MFL {number(surface.phase.focal_length_mm)}"
    if isinstance(surface.phase, Diffractive):
        yield from ("DIF DOE", f"HOR {surface.phase.order}", f"HWL {number(surface.phase.wavelength_nm)}", "HCT R")
        yield from (f"HCO C{power // 2} {number(value)}" for power, value in surface.phase.terms)
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


def _codev_glass(medium: Medium, private: dict[Medium, str]) -> str:
    """Return the word of a glass; one that no catalogue has becomes a private glass.

    It is called by its n_d and V_d, which programs take who do not read private glasses.
    """
    if medium == media.AIR:
        return ""
    if known := _maker_and_name(medium):
        return f"{plain_glass_name(known[1])}_{known[0].upper()}"  # CODE V has no hyphens
    if medium not in private:
        nd, vd = _model_of(medium)
        name = f"{nd!r}:{vd!r}"
        while name in private.values():
            name = name.replace(":", "0:")  # the same numbers
        private[medium] = name
    return f"'{private[medium]}'"


def _indices(medium: Medium) -> list[float]:
    if isinstance(medium, media.ConstantIndex):
        return [medium.value] * len(_PRIVATE_NM)
    return list(media.held_index(medium, np.array(_PRIVATE_NM)))


def _codev_reasons(lens: Lens) -> Iterator[tuple[int, str]]:
    for k, surface in enumerate(lens.surfaces):
        if any(power not in POWERS for power, _ in surface.aspheric):
            yield k, "a power of r is odd, 2 or above 20"
        if surface.cylinder == "x" or isinstance(surface.form, Biconic):
            yield k, "it is a biconic, or a cylinder that curves in x"
        if isinstance(surface.phase, Grating):
            yield k, f"it is {surface.phase.description}"


# A lens as a sequential Zemax file, which our reader, optiland and ray-optics read back.

HIGHEST = 8  # parameters of an asphere


def zemax_text(lens: Lens) -> str:
    """Return the Zemax file of a lens, for a distant object; lengths in millimetres.

    Raises
    ------
    InputError
        With every reason why such a file cannot say this lens.
    """
    refuse(lens, ".zmx file", chain(_sequence_reasons(lens), _zemax_reasons(lens)))
    pupil, fields, film = _beam_of(lens)
    makers = _makers(lens)
    catalogues = " ".join([*map(str.upper, makers), "MISC"])
    lines = ["VERS 140730 0 0", "MODE SEQ", f"NAME {one_line(lens.name)}", "UNIT MM X W X CM MR CPMM"]
    lines += [f"ENPD {number(pupil)}", f"GCAT {catalogues}"]
    count = len(fields)
    lines += [f"FTYP 0 0 {count} {len(WAVELENGTHS_NM)} 0 0 0", f"XFLN {numbers([0] * count)}"]
    lines += [f"YFLN {numbers(fields)}", f"FWGN {numbers([1] * count)}"]
    lines += [f"{word} {numbers([0] * count)}" for word in ("VDXN", "VDYN", "VCXN", "VCYN", "VANN")]
    lines += [f"WAVM {k} {number(nm / 1000)} 1.0" for k, nm in enumerate(WAVELENGTHS_NM, start=1)]
    lines.append(f"PWAV {1 + WAVELENGTHS_NM.index(LINE_D_NM)}")
    blocks = [["  TYPE STANDARD", "  CURV 0.0", "  DISZ INFINITY"]]
    behind: list[int] = []  # the block that has the space behind each surface
    for row in rows_of(lens, film):
        blocks += _surface(*row, makers)
        behind.append(len(blocks) - 1)
    blocks.append(["  TYPE STANDARD", "  CURV 0.0", "  DISZ 0.0"])
    for k, block in enumerate(blocks):
        lines += [f"SURF {k}", *block]
    lines += _zemax_positions(lens, behind)
    return "\n".join([*lines, ""])


def _zemax_positions(lens: Lens, behind: Sequence[int]) -> Iterator[str]:
    _, places = _positions_of(lens)
    if len(places) == 1:
        return
    yield f"MNUM {len(places)} 1"
    pupils = [one.lens.first_order().entrance_pupil.diameter_mm for one in places]
    away = [min(one.object_distance_mm, 1e10) for one in places]
    spaces = [(0, away)] if len(set(away)) > 1 else []
    for k, gaps in _gaps_that_vary(places):
        pose = places[0].lens.surfaces[k].pose
        spaces.append((behind[k], [gap - (pose.offset[2] if pose else 0.0) for gap in gaps]))
    rows = [("THIC", surface, values) for surface, values in spaces] + [("APER", 0, pupils)]
    for key, surface, values in rows:
        yield from (
            f'{key} {surface} {z} {number(value)} 0 0 0 1 1 1 0 0 "" 0' for z, value in enumerate(values, start=1)
        )


def _makers(lens: Lens) -> tuple[str, ...]:
    """Return the makers of the glasses of a lens, in an order in which every name means the glass of its maker."""
    known = {surface.glass.name: _maker_and_name(surface.glass) for surface in lens.surfaces}
    makers = tuple(dict.fromkeys(entry[0] for entry in known.values() if entry))
    for order in permutations(makers):
        if all(_means(entry[1], order, written) for written, entry in known.items() if entry):
            return order
    return makers


def _means(name: str, makers: Sequence[str], written: str) -> bool:
    meant = named_glass(name, makers)
    return meant is not None and meant.written == written


def _surface(surface: Surface, curvature: float, gap: float, is_stop: bool, makers: Sequence[str]) -> list[list[str]]:
    """Return the lines of a surface; of a tilted one with the coordinate breaks around it."""
    kind, parameters = _kind(surface)
    conic = 0.0 if surface.cylinder == "x" else surface.conic
    lines = ["  STOP"] if is_stop else []
    lines += [f"  TYPE {kind}", f"  CURV {number(curvature)} 0 0 0 0"]
    lines += [f"  PARM {k} {number(value)}" for k, value in sorted(parameters.items())]
    lines += [f"  XDAT {k} {number(value)} 0 0 1.0 0.0" for k, value in enumerate(_binary_data(surface), start=1)]
    lines.append(f"  DISZ {number(gap if surface.pose is None else 0.0)}")
    if surface.is_mirror:
        lines.append("  GLAS MIRROR 0 0 1.5 40")
    elif surface.glass != media.AIR:
        lines.append(f"  GLAS {_zemax_glass(surface.glass, makers)}")
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
    shaped = surface.curvature or surface.aspheric or surface.form or surface.is_mirror or surface.phase
    return not (shaped or surface.is_stop or surface.region) and surface.glass == media.AIR


def _break(
    decentre: tuple[float, float], turns: tuple[float, float, float], turns_first: bool, gap: float
) -> list[str]:
    values = [*decentre, *turns, 1.0 if turns_first else 0.0]
    parameters = [f"  PARM {k} {number(value)}" for k, value in enumerate(values, start=1)]
    return ["  TYPE COORDBRK", "  CURV 0.0", *parameters, f"  DISZ {number(gap)}"]


def _kind(surface: Surface) -> tuple[str, dict[int, float]]:
    """Return the type of a surface and its parameters."""
    powers = dict(surface.aspheric)
    if isinstance(surface.phase, IdealLens):
        return "PARAXIAL", {1: surface.phase.focal_length_mm}
    if isinstance(surface.phase, Grating):
        return "DGRATING", {1: surface.phase.lines_per_mm / 1000, 2: surface.phase.order}
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
    if isinstance(surface.phase, Diffractive):
        return "BINARY_2", {0: surface.phase.order, **{power // 2: value for power, value in powers.items()}}
    if not powers:
        return "STANDARD", {}
    if all(power % 2 == 0 for power in powers):
        return "EVENASPH", {k: powers.get(2 * k, 0.0) for k in range(1, HIGHEST + 1)}
    return "ODDASPHE", {k: powers.get(k, 0.0) for k in range(1, HIGHEST + 1)}


def _binary_data(surface: Surface) -> list[float]:
    """Return the extra data of a diffractive surface: terms, norm radius 1, and radians of r^2, r^4, ..."""
    if not isinstance(surface.phase, Diffractive):
        return []
    terms, radians = dict(surface.phase.terms), 2e6 * math.pi / surface.phase.wavelength_nm
    powers = range(2, max(terms) + 1, 2)
    return [len(powers), 1.0, *(terms.get(power, 0.0) * radians for power in powers)]


def _zemax_glass(medium: Medium, makers: Sequence[str]) -> str:
    if (known := _maker_and_name(medium)) and _means(known[1], makers, medium.name):
        return f"{known[1].replace(' ', '_')} 0 0 1.5 40.0 0 0 0 0 0 0"
    if medium.name == "fused silica" and find_glass(medium.name) == medium:
        return "F_SILICA 0 0 1.5 40.0 0 0 0 0 0 0"
    nd, vd = _model_of(medium)
    return f"___BLANK 1 0 {number(nd)} {number(vd)} 0 0 0 0 0 0"


def _zemax_reasons(lens: Lens) -> Iterator[tuple[int, str]]:
    for k, surface in enumerate(lens.surfaces):
        powers = [power for power, _ in surface.aspheric]
        straight = surface.cylinder or isinstance(surface.form, Toroid)
        even = all(power % 2 == 0 for power in powers)
        highest = 2 * (HIGHEST - 1) if straight else 2 * HIGHEST if even else HIGHEST
        if isinstance(surface.phase, Diffractive) and (surface.cylinder or surface.form or not even):
            yield k, "it is a diffractive surface on such a shape"
        if isinstance(surface.phase, Grating) and (surface.phase.towards_degrees != 90 or powers or straight):
            yield k, "it is a grating of other lines than along x, or on such a surface"
        if max(powers, default=0) > highest:
            yield k, f"a power of r is above {highest}"
        if powers and (surface.cylinder == "x" or (not even and straight)):
            yield k, "it is a cylinder or toroid with such powers of r"
        if surface.pose is not None and surface.pose.offset[2] and k == 0:
            yield k, "the first surface is decentred along the axis"


#
# A lens as a pbrt table: radius, thickness to the next row, index behind, diameter, in millimetres.
#
# pbrt takes radius 0 for the stop, so it cannot have plane glass; it knows spheres in a row and one index for each
# glass.


def pbrt_text(lens: Lens, wavelength_nm: float = LINE_D_NM) -> str:
    """Return the table of a lens, with its indices at a wavelength [nm]; the last thickness is the film's, at infinity.

    Raises
    ------
    InputError
        With every reason why a table cannot say this lens.
    """
    is_older = len(lens.surfaces) > 2 and lens.surfaces[0].thickness == 0
    of_whole = ["the first thickness is 0, which readers take for the older kind of table"] if is_older else []
    of_whole += ["it is a zoom lens (choose a focal length)"] if lens.configurations else []
    refuse(lens, ".dat table", _pbrt_reasons(lens, wavelength_nm), of_whole)
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


def _pbrt_reasons(lens: Lens, wavelength_nm: float) -> Iterator[tuple[int, str]]:
    indices = lens.indices(wavelength_nm)
    for k, surface in enumerate(lens.surfaces):
        for reason in _surface_reasons(surface, float(indices[k]), float(indices[k + 1])):
            yield k, reason


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
    yield from (text for text, applies in shapes.items() if applies)
    yield from (beside.description for beside in (surface.form, surface.phase) if beside is not None)
    if surface.is_stop and surface.curvature:
        yield "a stop on curved glass"
    elif surface.is_stop and max(abs(before - 1), abs(after - 1)) > IN_AIR:
        yield "a stop that is not in air"
    elif not surface.is_stop and not surface.curvature:
        yield "a plane, which a table has for the stop only"
    if not 1 <= after <= 5:
        yield f"an index of {after:g}"


# A lens as text of our own form, which reads back as the same lens. Lengths in millimetres.

_WRITTEN_THICKNESS_MM = 10.0
_SCHOTT_POWERS = (0.0, 2.0, -2.0, -4.0, -6.0, -8.0)


def lens_text(lens: Lens, comments: Sequence[str] = ()) -> str:
    """Return the YAML of a lens, comments above.

    Raises
    ------
    InputError
        When the form cannot say something about the lens.
    """
    if lens.first_sense != 1.0:
        raise InputError(f"{lens.name}: begins behind a mirror, which a lens file cannot say")
    lines = [f"# {line}" for comment in comments for line in comment.splitlines()]
    lines.append(f"name: {_flow(lens.name)}")
    if lens.source:
        lines.append(f"source: {_flow(lens.source)}")
    if published := {key: value for key, value in lens.published.items() if key != "marked_f_number"}:
        lines.append(f"published: {_flow(published)}")
    if "marked_f_number" in lens.published:
        lines.append(f"marked_f_number: {_flow(lens.published['marked_f_number'])}")
    if lens.object_medium != media.AIR:
        lines.append(f"object_medium: {_flow(_medium(lens.object_medium))}")
    if lens.fold is not None:
        lines.append(f"fold: {_flow(_pose(lens.fold))}")
    lines.append("surfaces:")
    last = len(lens.surfaces) - 1
    lines += [f"  - {_flow(_surface_keys(lens, k, k == last))}" for k in range(last + 1)]
    if lens.configurations:
        lines.append("configurations:")
        for state in lens.configurations:
            row: dict[str, Any] = {"name": state.name, "gaps": dict(state.gaps)}
            if state.stop_diameter_mm is not None:
                row["stop_diameter"] = state.stop_diameter_mm
            if state.floating:
                row["floating"] = list(map(_focus_state, state.floating))
            lines.append(f"  - {_flow(row)}")
    if lens.focusing is not None:
        group = lens.focusing
        entry = {"surfaces": [group.first, group.last], "travel": list(group.travel_mm)}
        lines.append(f"focusing: {_flow(entry)}")
    if lens.motor is not None:
        motor = {"speed": lens.motor.speed_mm_s, "acceleration": lens.motor.acceleration_mm_s2}
        lines.append(f"focus_drive: {_flow(motor | ({'source': lens.motor.source} if lens.motor.source else {}))}")
    if lens.floating and not lens.configurations:
        lines.append("floating:")
        lines += [f"  - {_flow(_focus_state(state))}" for state in lens.floating]
    return "\n".join([*lines, ""])


def _focus_state(state: FocusState) -> dict[str, Any]:
    row: dict[str, Any] = {"distance": state.distance_mm, "gaps": dict(state.gaps)}
    return row if state.film_shift_mm is None else row | {"film_shift": state.film_shift_mm}


def _surface_keys(lens: Lens, k: int, last: bool) -> dict[str, Any]:
    surface = lens.surfaces[k]
    where = f"{lens.name}: surface {k}"
    if not math.isfinite(surface.semi_diameter):
        raise InputError(f"{where}: has no diameter, which a lens file needs")
    row: dict[str, Any] = {}
    if surface.is_stop:
        row["stop"] = True
    if surface.is_mirror:
        row["mirror"] = True
    if surface.body_per_k is not None:
        row["body_expansion_per_k"] = surface.body_per_k
    if surface.curvature:
        row["radius"] = short_radius(surface.curvature)
    if not last:
        row["thickness"] = surface.thickness
    if surface.glass != media.AIR and not surface.is_mirror:
        row["glass"] = _medium(surface.glass)
    row["diameter"] = 2 * surface.semi_diameter
    if surface.inner_semi_diameter:
        row["inner_diameter"] = 2 * surface.inner_semi_diameter
    if surface.coating is not None:
        row["coating"] = _coating(surface.coating, where)
    row |= _shape(surface)
    if surface.pose is not None:
        row |= _pose(surface.pose)
    if surface.region is not None:
        row |= _region(surface.region, where)
    if isinstance(surface.stop_shape, StopShape):
        row["shape"] = {"polygon": [list(point) for point in surface.stop_shape.vertices]}
    return row


def _shape(surface: Surface) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if surface.conic:
        row["conic"] = surface.conic
    if surface.aspheric:
        row["aspheric"] = dict(surface.aspheric)
    if surface.cylinder:
        row["cylinder"] = surface.cylinder
    row |= {surface.phase.key: surface.phase.written()} if surface.phase else {}
    return row | (surface.form.written() if surface.form else {})


def _pose(pose: SurfacePose) -> dict[str, Any]:
    """Return decentre and tilt: the matrix is a turn about x, then y, then z."""
    tilt = tilt_of(pose.matrix())
    row: dict[str, Any] = {}
    if any(pose.offset) or not any(tilt):
        row["decentre"] = list(pose.offset)
    if any(tilt):
        row["tilt_degrees"] = list(tilt)
    return row


def _region(region: Region, where: str) -> dict[str, Any]:
    if region.inverted:
        raise InputError(f"{where}: is clear outside of a region, which a lens file cannot say")
    clear: dict[str, Any] = {}
    if math.isfinite(region.half_width):
        clear["rectangle"] = [2 * region.half_width, 2 * region.half_height]
    if any(region.centre):
        clear["centre"] = list(region.centre)
    if math.isfinite(region.radius):
        clear["diameter"] = 2 * region.radius
    if region.inner_radius:
        clear["inner_diameter"] = 2 * region.inner_radius
    if region.normal_degrees is not None:
        clear |= {"half_plane_degrees": region.normal_degrees, "edge": region.edge}
    return {"clear": clear} if region.blocks else {"clear": clear, "outside": "pass"}


def _coating(coating: Coating, where: str) -> Any:
    if coating == media.BARE:
        return "bare"
    if coating == media.MAGNESIUM_FLUORIDE:
        return "mgf2"
    if isinstance(coating, media.QuarterWave):
        return {"quarter_wave": {"index": coating.index, "wavelength_nm": coating.wavelength_nm}}
    if isinstance(coating, media.LayerStack):
        rows: list[dict[str, float]] = []
        for layer in coating.layers:
            rows.append({"index": layer.index, "thickness_nm": layer.thickness_nm})
            if layer.extinction:
                rows[-1]["extinction"] = layer.extinction
        return {"layers": rows}
    if not isinstance(coating, media.MeasuredReflectance):
        raise InputError(f"{where}: has a coating that a lens file cannot say ({type(coating).__name__})")
    if len(coating.values) == 1:
        return {"reflectance": coating.values[0]}
    return {"reflectance": {"wavelengths_nm": list(coating.wavelengths_nm), "values": list(coating.values)}}


def _medium(medium: Medium) -> Any:
    """Return a glass with what it absorbs, where its name does not say that."""
    if medium.name and find_glass(medium.name) == medium:
        return medium.name
    entry = _glass_keys(medium)
    thermal = {} if medium.thermal is None else _thermal(medium.thermal)
    if medium.absorption is not None:  # what is left behind 10 mm
        shares = np.exp(-_WRITTEN_THICKNESS_MM * np.asarray(medium.absorption.per_mm)).tolist()
        at = {"thickness_mm": _WRITTEN_THICKNESS_MM, "wavelengths_nm": list(medium.absorption.wavelengths_nm)}
        entry |= {"transmittance": at | {"values": shares}}
    return entry | thermal


def _thermal(thermal: media.Thermal) -> dict[str, Any]:
    """Return the keys of a glass under heat."""
    row: dict[str, Any] = {}
    if thermal.dispersion is not None:
        d, e = list(thermal.dispersion[:3]), list(thermal.dispersion[3:5])
        row["thermal"] = {"d": d, "e": e, "resonance_um": thermal.dispersion[5], "reference_c": thermal.reference_c}
    return row if thermal.expansion_per_k is None else row | {"expansion_per_k": thermal.expansion_per_k}


def _glass_keys(medium: Medium) -> dict[str, Any]:
    """Return the law of a glass, its range and its name, where that is not what a reader calls it by itself."""
    entry: dict[str, Any]
    usual = ""
    match medium:
        case media.ConstantIndex():
            entry, usual = {"index": medium.value}, f"n = {medium.value:g}"
        case media.AbbeCauchy():
            entry, usual = {"nd": medium.nd, "vd": medium.vd}, f"{medium.nd:g} / {medium.vd:g}"
        case media.AbbeLinear():
            entry, usual = {"linear_abbe": {"n": medium.n, "v": medium.v}}, f"{medium.n:g} / {medium.v:g} linear"
        case media.Sellmeier():
            law: dict[str, Any] = {"b": list(medium.b), "c": list(medium.c)}
            entry = {"sellmeier": law | ({"c0": medium.c0} if medium.c0 else {})}
        case media.PowerSeries():
            powers, values = zip(*medium.terms, strict=True)
            if medium.squared and powers == _SCHOTT_POWERS:
                entry = {"schott": list(values)}
            elif not medium.squared and powers == tuple(-2.0 * i for i in range(len(powers))):
                entry = {"cauchy": list(values)}
            else:
                raise InputError(f"a lens file cannot say the glass {medium.name!r}: its powers are {powers}")
        case media.TabulatedIndex():
            entry = {"table": {"wavelengths_nm": list(medium.wavelengths_nm), "values": list(medium.values)}}
        case _:
            raise InputError(f"a lens file cannot say the glass {medium.name!r} ({type(medium).__name__})")
    if isinstance(medium, media.Sellmeier | media.PowerSeries) and medium.range_nm is not None:
        entry["range_nm"] = list(medium.range_nm)
    return entry if medium.name in ("", usual) else entry | {"name": medium.name}


def _flow(value: Any) -> str:
    """Return a value on one line of YAML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_key(key)}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool | int | str) or value is None:
        return json.dumps(value, ensure_ascii=False)
    number = float(value)
    if math.isinf(number):
        return ".inf" if number > 0 else "-.inf"
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)


def _key(key: Any) -> str:
    return key if isinstance(key, str) and key.isidentifier() else _flow(key)
