"""``rptcam lens draw``: a lens in cross-section with its rays."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli.lens_options import (
    add_fields,
    add_lens,
    add_wavelengths,
    check_picture,
    count,
    lens_in_use,
    tracer_of,
    write_picture,
)
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "draw a lens in cross-section, with rays traced by a device"
    parser = commands.add_parser(
        "draw", help=text, description=text.capitalize() + "; a red cross is where a ray was blocked."
    )
    add_lens(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help=".svg, .png or .pdf (default: SVG to standard output)"
    )
    parser.add_argument(
        "--section", choices=("y", "x"), default="y", help="the y-z plane or the x-z plane (default: %(default)s)"
    )
    add_fields(parser)
    add_wavelengths(parser, (LINE_D_NM,))
    parser.add_argument(
        "--rays", type=count, metavar="N", default=7,
        help="rays that pass, for each field and wavelength (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--only-passing", action="store_true", help="leave out the rays that are blocked")
    parser.add_argument(
        "--device", metavar="SPEC",
        help="traces the rays: an index as 0:0, a part of a name, cpu, gpu, auto, or none for the float64 reference "
        "on the host (default: auto, or the reference where there is no device)",
    )  # fmt: skip
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import DRAWN, View, draw_lens, svg_text

    check_picture(arguments.output, arguments.lens, DRAWN)
    state = lens_in_use(arguments, arguments.wavelengths[len(arguments.wavelengths) // 2])
    tracer, name = tracer_of(arguments.device)
    view = View(
        section=arguments.section,
        fields=arguments.fields,
        rays=arguments.rays,
        wavelengths_nm=arguments.wavelengths,
        blocked=not arguments.only_passing,
    )
    picture = draw_lens(state, view, tracer)
    print(f"rays traced {name}", file=sys.stderr)
    if state.film_distance_mm is None:
        print("this lens forms no real image of a distant object: no film is drawn", file=sys.stderr)
    if arguments.output is None:
        print(svg_text(picture), end="")
    write_picture(picture, arguments.output)
    return 0
