"""``rptcam lens wavefront``: path differences at the exit pupil, from exact rays."""

import argparse

from rptcam_cl.cli.lens_options import add_fields, add_plot, check_picture, write_picture
from rptcam_cl.cli.lens_spots import focused_state, lens_command
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM

_COLUMNS = ("field [°]", "wavelength [nm]", "rms [waves]", "less tilt", "range", "Strehl", "at the peak", "y [mm]")


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "wavefront at the exit pupil: path differences in wavelengths, and Strehl ratios"
    parser = lens_command(commands, "wavefront", text, (LINE_D_NM,))
    add_fields(parser)
    add_plot(parser)
    parser.set_defaults(run=_wavefront, parser=parser)


def _wavefront(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import field_waves, wavefront_chart, wavefront_table

    check_picture(arguments.output, arguments.lens)
    state = focused_state(arguments)
    waves = field_waves(state, arguments.fields, arguments.wavelengths, arguments.rays)
    rows = wavefront_table(waves)
    if arguments.json:
        print(as_json({"lens": state.lens.name, "film_distance_mm": state.film, "wavefronts": rows}))
    else:
        title = f"{state.lens.name}, film at {state.film:.6g} mm"
        print_table(_COLUMNS, [list(row.values()) for row in rows], title)
    if arguments.output is not None:
        write_picture(wavefront_chart(state, waves), arguments.output)
    return 0
