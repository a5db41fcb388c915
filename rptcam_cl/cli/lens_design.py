"""``rptcam lens design``: single lenses and achromats from closed forms, as lens files."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import FDC, check_file, number, write
from rptcam_cl.cli.parser import Commands, Parser
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.optics import GlassChoice, Lens

_CONSTRAINTS = ("r1=r2", "r2=r3", "flat-r3")


def add_to(commands: Commands) -> None:
    """Add the command with its own commands."""
    text = "make a lens file of a single lens or an achromatic doublet"
    design = commands.add_parser("design", help=text, description=text.capitalize() + ".")
    inner = design.add_commands("design_command")
    text = "a single lens by the lensmaker's equation"
    single = inner.add_parser("singlet", help=text, description=text.capitalize() + ".")
    _add_common(single)
    single.add_argument("--glass", metavar="G", default="N-BK7", help=f"{_GLASS_HELP} (default: %(default)s)")
    single.add_argument(
        "--bending", type=number, metavar="Q", default=0.0,
        help="(R2 + R1) / (R2 - R1): 0 equal radii, 1 plane on the film side, -1 on the scene side (default: 0)",
    )  # fmt: skip
    single.add_argument(
        "--focus-distance-m",
        type=values.positive,
        metavar="D",
        help="also write the distances that focus an object this far from the film",
    )
    single.set_defaults(run=_singlet, parser=single)
    text = "a cemented achromat from two glasses and one more condition"
    double = inner.add_parser("doublet", help=text, description=text.capitalize() + ".")
    _add_common(double)
    double.add_argument("--crown", metavar="G", default="N-BK7", help=f"{_GLASS_HELP} (default: %(default)s)")
    double.add_argument("--flint", metavar="G", default="F2", help="glass on the film side (default: %(default)s)")
    third = double.add_mutually_exclusive_group()
    third.add_argument(
        "--constraint", choices=_CONSTRAINTS, default="r1=r2",
        help="biconvex first lens, biconcave second lens, or plane last surface (default: %(default)s)",
    )  # fmt: skip
    third.add_argument("--r1-mm", type=number, metavar="R", help="first radius, in place of a constraint")
    double.set_defaults(run=_doublet, parser=double)


_GLASS_HELP = "a name as N-BK7, n_d/V_d as 1.517/64.2, or an index as 1.5"


def _add_common(parser: Parser) -> None:
    parser.add_argument("--focal-length-mm", type=number, required=True, metavar="F", help="below 0: a diverging lens")
    parser.add_argument("--diameter-mm", type=values.positive, required=True, metavar="D", help="clear diameter")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write here (default: standard output)")


def _glass(text: str) -> "GlassChoice":
    """The glass that a word names."""
    from rptcam_cl.optics import GlassChoice, abbe_number, document_of, read_glass

    entry: Any = text
    parts = text.split("/")
    try:
        numbers = [float(part) for part in parts]
        entry = {"index": numbers[0]} if len(numbers) == 1 else {"nd": numbers[0], "vd": numbers[1]}
    except ValueError:
        pass
    medium = read_glass(document_of({"name": "design", "glass": entry}), ("glass",))
    return GlassChoice(float(medium.index(LINE_D_NM)), abbe_number(medium), entry)


def _focal_lengths(lens: "Lens") -> list[str]:
    first = lens.first_order()
    lines = [f"focal length {first.focal_length_mm:.6g} mm at n_d, f/{first.f_number:.4g}"]
    lines.append(f"last surface to rear focal point {first.back_focal_distance_mm:.6g} mm")
    names = zip("FdC", (lens.first_order(wave).focal_length_mm for wave in FDC), strict=True)
    lines.append("focal length at " + ", ".join(f"{name} {length:.6g}" for name, length in names) + " mm")
    return lines


def _written(arguments: argparse.Namespace, lens: "Lens", comments: list[str]) -> int:
    from rptcam_cl.lenstools import lens_text

    text = lens_text(lens, [*comments, *_focal_lengths(lens)])
    if arguments.output is None:
        print(text, end="")
    else:
        write(text.encode(), arguments.output)
    return 0


def _singlet(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import film_distance, image_distances, load_lens, singlet

    check_file(arguments.output, "")
    glass = _glass(arguments.glass)
    lens = load_lens(singlet(arguments.focal_length_mm, glass, arguments.diameter_mm, arguments.bending))
    comments = []
    if arguments.focus_distance_m is not None:
        distance = 1000 * arguments.focus_distance_m
        near, far = image_distances(arguments.focal_length_mm, distance)
        comments.append(
            f"object {arguments.focus_distance_m:g} m from the film: thin lens {near:.6g} mm (or {far:.6g} mm) before "
            f"the film; this lens: last surface to film {film_distance(lens, distance):.6g} mm"
        )
    return _written(arguments, lens, comments)


def _doublet(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import doublet, doublet_radii, load_lens

    check_file(arguments.output, "")
    crown, flint = _glass(arguments.crown), _glass(arguments.flint)
    if math.isinf(crown.abbe) or math.isinf(flint.abbe):
        raise InputError("an achromat needs glasses that disperse: name them, or give n_d/V_d as 1.517/64.2")
    constraint, r1 = arguments.constraint.replace("-", " "), 0.0
    if arguments.r1_mm is not None:
        constraint, r1 = "r1", arguments.r1_mm
    focal_length = arguments.focal_length_mm
    lens = load_lens(doublet(focal_length, crown, flint, arguments.diameter_mm, constraint, r1))
    radii = doublet_radii(focal_length, crown, flint, constraint, r1)
    shown = ", ".join("plane" if math.isinf(radius) else f"{radius:.6g}" for radius in radii)
    return _written(arguments, lens, [f"thin achromat of {focal_length:g} mm: radii {shown} mm"])
