"""``rptcam lens breathing``: field of view and speed of a lens over its focus and its zoom."""

import argparse
import math
from typing import TYPE_CHECKING

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import (
    add_coating,
    add_lens,
    add_plot,
    check_picture,
    coated_lens,
    write_picture,
    zoomed_lens,
)
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens

DISTANCES_M = "inf,10,5,3,2,1.5"


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "field of view, f-number and T-number over focus and zoom"
    parser = commands.add_parser("breathing", help=text, description=text[0].upper() + text[1:] + ".")
    add_lens(parser)
    parser.add_argument(
        "--distances-m", type=distances, metavar="A,B,…", default=DISTANCES_M,
        help="from the object to the film in metres, the first is what others are compared with; inf is infinity"
        " (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--film-width-mm", type=values.positive, metavar="W", default=36.0, help="of the film (default: %(default)s)"
    )
    add_coating(parser)
    parser.add_argument("--csv", action="store_true", help="print comma-separated values")
    add_plot(parser)
    parser.set_defaults(run=_breathing, parser=parser)


def distances(text: str) -> list[float]:
    """Distances of ``inf,2,1`` [m]."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or not all(0 < value < 1e9 or value == math.inf for value in found):
        raise argparse.ArgumentTypeError(f"got {text}; allowed distances above 0 with commas between, as inf,5,2,1")
    return found


def _positions(arguments: argparse.Namespace) -> list[tuple[str, "Lens"]]:
    """The lens in each of its zoom positions, or in the one that the options choose, stopped down."""
    from rptcam_cl.optics import configured

    lens = coated_lens(arguments, zoomed_lens(arguments, LINE_D_NM))
    if lens.configurations and arguments.zoom is None and arguments.focal_length_mm is None:
        found = [(each.name, configured(lens, each.name)) for each in lens.configurations]
    else:
        found = [(arguments.zoom or "", lens)]
    if arguments.f_number is None:
        return found
    return [(name, each.with_stop_diameter(each.stop_diameter_for(arguments.f_number))) for name, each in found]


def _breathing(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import breathing_chart, breathing_csv, breathing_table
    from rptcam_cl.optics import COATED, UNCOATED, has_coatings

    check_picture(arguments.output, arguments.lens)
    if arguments.focus_distance_m is not None:
        raise InputError("--focus-distance-m: has no effect on breathing (allowed: --distances-m)")
    positions = _positions(arguments)
    lens = positions[0][1]
    losses = COATED if has_coatings(lens) else UNCOATED
    rows = breathing_table(positions, arguments.distances_m, arguments.film_width_mm, LINE_D_NM, losses)
    if arguments.json:
        print(as_json({"lens": lens.name, "film_width_mm": arguments.film_width_mm, "breathing": rows}))
    elif arguments.csv:
        print(breathing_csv(rows), end="")
    else:
        columns = ("zoom", "focus [m]", "f [mm]", "film [mm]", "field [°]", "breathing [%]", "magnification", "f/", "T")
        print_table(columns, [list(row.values()) for row in rows], lens.name)
    if arguments.output is not None:
        write_picture(breathing_chart(lens.name, rows), arguments.output)
    return 0
