"""``rptcam lens convert``: a lens file of any known kind becomes one of ours, of pbrt, of Zemax or of CODE V."""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import add_catalogue, check_file, load, wavelength, write
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError

_SUFFIXES = (".yaml", ".yml", ".dat", ".zmx", ".seq")


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "write a lens as a file of ours (.yaml), a pbrt table (.dat) or for Zemax (.zmx) or CODE V (.seq)"
    parser = commands.add_parser("convert", help=text, description=text.capitalize() + ".")
    parser.add_argument("lens", metavar="LENS", help="a name from the list, or a lens file of any known kind")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", required=True, help=".yaml, .dat, .zmx or .seq")
    add_catalogue(parser)
    parser.add_argument("--f-number", type=values.positive, metavar="N", help="stop down (default: as in the file)")
    parser.add_argument(
        "--focal-length-mm", type=values.positive, metavar="F", help="set a zoom lens and write it as it then is"
    )
    parser.add_argument(
        "--wavelength-nm", type=wavelength, metavar="W", default=LINE_D_NM,
        help="wavelength of the indices in a .dat table (default: %(default)s)",
    )  # fmt: skip
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import codev_text, left_out, lens_text, loses_dispersion, pbrt_text, zemax_text
    from rptcam_cl.optics import has_coatings, zoomed

    suffix = arguments.output.suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(f"{arguments.output}: unknown kind of lens file to write (allowed: {', '.join(_SUFFIXES)})")
    check_file(arguments.output, arguments.lens)
    lens = load(arguments.lens, arguments.catalogue)
    comments = []
    if arguments.focal_length_mm is not None:
        lens = replace(zoomed(lens, arguments.focal_length_mm), configurations=(), published={})
        comments.append(f"Set to a focal length of {arguments.focal_length_mm:g} mm.")
    if arguments.f_number is not None:
        lens = lens.with_stop_diameter(lens.stop_diameter_for(arguments.f_number))
        lens = replace(lens, published={"marked_f_number": lens.first_order().f_number})
        comments.append(f"Stopped down to f/{arguments.f_number:g}.")
    if suffix in (".zmx", ".seq"):
        text = zemax_text(lens) if suffix == ".zmx" else codev_text(lens)
        for note in left_out(lens):
            print(f"a {suffix} file: {note}", file=sys.stderr)
    elif suffix != ".dat":
        text = lens_text(lens, comments)
    else:
        text = pbrt_text(lens, arguments.wavelength_nm)
        if loses_dispersion(lens):
            print(f"a .dat table has no dispersion: its indices are those at {arguments.wavelength_nm:g} nm",
                  file=sys.stderr)  # fmt: skip
        if has_coatings(lens):
            print("a .dat table has no coatings: they are left out", file=sys.stderr)
        if lens.focusing is not None:
            print("a .dat table has no focusing group: the lens is written focused at infinity", file=sys.stderr)
    write(text.encode(), arguments.output)
    return 0
