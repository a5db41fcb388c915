"""``rptcam lens vignette`` and ``distortion``: how a lens draws over the field."""

import argparse

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import (
    FDC,
    add_fields,
    add_lens,
    add_plot,
    add_wavelengths,
    check_picture,
    count,
    lens_in_use,
    wavelength,
    write_picture,
)
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM

_SHARES = (0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)


def add_to(commands: Commands) -> None:
    """Add the two commands."""
    text = "how the film darkens towards its edge, by the pupil and by cos^4"
    vignette = commands.add_parser("vignette", help=text, description=text.capitalize() + ".")
    add_lens(vignette)
    vignette.add_argument("--film-radius-mm", type=values.positive, metavar="R", help="how far (default: image circle)")
    vignette.add_argument("--steps", type=count, metavar="N", default=16, help="radii (default: %(default)s)")
    vignette.add_argument(
        "--wavelength-nm", type=wavelength, metavar="W", default=LINE_D_NM,
        help="wavelength in nanometres (default: %(default)s)",
    )  # fmt: skip
    add_plot(vignette)
    vignette.set_defaults(run=_vignette, parser=vignette)
    text = "where chief rays meet the film against an ideal projection, and lateral colour"
    distortion = commands.add_parser("distortion", help=text, description=text.capitalize() + ".")
    add_lens(distortion)
    add_fields(distortion, steep=True)
    add_wavelengths(distortion, FDC)
    distortion.add_argument(
        "--projection", choices=("tan", "theta", "stereographic", "equisolid", "orthographic"),
        help="ideal height: f tan(angle), f angle, 2 f tan(angle/2), 2 f sin(angle/2) or f sin(angle) "
        "(default: tan, and for wide lenses that bend lines what they follow best)",
    )  # fmt: skip
    add_plot(distortion)
    distortion.set_defaults(run=_distortion, parser=distortion)


def _vignette(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import film_radii, vignetting_chart, vignetting_table

    check_picture(arguments.output, arguments.lens)
    state = lens_in_use(arguments, arguments.wavelength_nm)
    rows = vignetting_table(state, film_radii(state, arguments.steps, arguments.film_radius_mm))
    if arguments.json:
        print(as_json({"lens": state.lens.name, "film_distance_mm": state.film, "vignetting": rows}))
    else:
        columns = ("radius [mm]", "irradiance", "relative", "stops", "angle [°]", "cos^4", "pass area [mm²]", "share")
        print_table(columns, [list(row.values()) for row in rows], f"{state.lens.name}, film at {state.film:.6g} mm")
    if arguments.output is not None:
        write_picture(vignetting_chart(state, rows), arguments.output)
    return 0


def _distortion(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import (
        PROJECTIONS,
        default_fields,
        distortion_chart,
        distortion_table,
        followed_projection,
    )

    check_picture(arguments.output, arguments.lens)
    state = lens_in_use(arguments)
    _ = state.film
    fields = arguments.fields or default_fields(state, _SHARES)
    projection = arguments.projection or followed_projection(state, fields)
    rows = distortion_table(state, fields, arguments.wavelengths, projection)
    if arguments.json:
        print(as_json({"lens": state.lens.name, "film_distance_mm": state.film, "projection": projection,
                       "distortion": rows}))  # fmt: skip
    else:
        columns = ("field [°]", "wavelength [nm]", "height [mm]", "ideal [mm]", "off [mm]", "off [%]", "colour [µm]")
        meant = PROJECTIONS[projection][1] + (", which it follows best" if arguments.projection is None else "")
        title = f"{state.lens.name}, film at {state.film:.6g} mm, against {meant}"
        print_table(columns, [list(row.values()) for row in rows], title)
    if arguments.output is not None:
        write_picture(distortion_chart(state, rows, projection), arguments.output)
    return 0
