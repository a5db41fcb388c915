"""``rptcam lens glare``: how much light a bright surrounding sends to a black spot on the film."""

import argparse
from dataclasses import asdict, replace

from rptcam_cl.cli.lens_ghosts import MIDDLE_NM, share
from rptcam_cl.cli.lens_options import add_coating, add_lens, add_wavelengths, coated_lens, lens_in_use
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "veiling glare index: a black spot in the middle of the film under a hemisphere of even light"
    parser = commands.add_parser("glare", help=text, description=text[0].upper() + text[1:] + " (ISO 9358).")
    add_lens(parser)
    parser.add_argument(
        "--film-reflectance", type=share, metavar="R", default=0.0,
        help="share of the light that the film scatters (default: 0)",
    )  # fmt: skip
    parser.add_argument(
        "--barrel-reflectance", type=share, metavar="R", default=0.0,
        help="share that rims behind the stop scatter (default: 0)",
    )  # fmt: skip
    add_wavelengths(parser, (MIDDLE_NM,))
    add_coating(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_glare, parser=parser)


def _glare(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import veiling_glare

    state = lens_in_use(arguments)
    state = replace(state, lens=coated_lens(arguments, state.lens))
    rows = []
    for wavelength in arguments.wavelengths:
        found = veiling_glare(
            state.lens, state.film, wavelength, film_reflectance=arguments.film_reflectance,
            barrel_reflectance=arguments.barrel_reflectance,
        )  # fmt: skip
        rows.append({"wavelength_nm": wavelength, **asdict(found), "index": found.index})
    if arguments.json:
        print(as_json({"lens": state.lens.name, "film_distance_mm": state.film, "glare": rows}))
    else:
        columns = ("wavelength [nm]", "surfaces", "film", "barrel", "glare index")
        print_table(columns, [list(row.values()) for row in rows], f"{state.lens.name}; parts of a white film's light")
    return 0
