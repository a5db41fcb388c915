"""``rptcam lens transmittance``: how much light a lens lets through, over the wavelength."""

import argparse
from typing import TYPE_CHECKING

from rptcam_cl.cli.lens_options import (
    add_coating,
    add_lens,
    add_plot,
    add_wavelengths,
    check_picture,
    coated_lens,
    lens_in_use,
    write_picture,
)
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM

if TYPE_CHECKING:
    from rptcam_cl.lenstools import Row

WAVELENGTHS = (400.0, 450.0, 500.0, 550.0, LINE_D_NM, 600.0, 650.0, 700.0)


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "light that glass and surfaces let through on the axis, and T-numbers"
    parser = commands.add_parser("transmittance", help=text, description=text[0].upper() + text[1:] + ".")
    add_lens(parser)
    add_wavelengths(parser, WAVELENGTHS)
    add_coating(parser)
    add_plot(parser)
    parser.set_defaults(run=_transmittance, parser=parser)


def _transmittance(arguments: argparse.Namespace) -> int:
    from dataclasses import replace

    from rptcam_cl.lenstools import transmittance_chart, transmittance_table

    check_picture(arguments.output, arguments.lens)
    state = lens_in_use(arguments)
    state = replace(state, lens=coated_lens(arguments, state.lens))
    rows: list[Row] = transmittance_table(state, arguments.wavelengths)
    if arguments.json:
        print(as_json({"lens": state.lens.name, "film_distance_mm": state.film_distance_mm, "transmittance": rows}))
    else:
        columns = ("wavelength [nm]", "glass", "bare", "coated", "T bare", "T coated")
        print_table(columns, [list(row.values()) for row in rows], state.lens.name)
    if arguments.output is not None:
        write_picture(transmittance_chart(state, rows), arguments.output)
    return 0
