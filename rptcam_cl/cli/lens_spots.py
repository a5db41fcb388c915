"""``rptcam lens spot``, ``mtf`` and ``psf``: how sharply a lens draws points, from exact rays."""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import (
    FDC,
    STEEPEST,
    add_fields,
    add_lens,
    add_plot,
    add_wavelengths,
    check_picture,
    count,
    lens_in_use,
    number,
    numbers,
    write,
    write_picture,
)
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands, Parser
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rptcam_cl.lenstools import Setting

NUMBERS = (".npy",)


def add_to(commands: Commands) -> None:
    """Add the three commands."""
    spot = lens_command(commands, "spot", "spots on the film: centroid and rms size for fields and wavelengths", FDC)
    add_fields(spot, steep=True)
    add_plot(spot)
    spot.set_defaults(run=_spot, parser=spot)
    mtf = lens_command(commands, "mtf", "modulation transfer from the spots, times what diffraction leaves of it", FDC)
    add_fields(mtf, steep=True)
    add_plot(mtf)
    mtf.add_argument(
        "--frequencies", type=numbers, metavar="F,F,…", default=[10.0, 20.0, 30.0, 40.0, 50.0],
        help="in cycles per mm on the film; the plot ends at the last (default: 10,20,30,40,50)",
    )  # fmt: skip
    add_diffraction(mtf)
    mtf.set_defaults(run=_mtf, parser=mtf)
    psf = lens_command(commands, "psf", "image of one point by geometrical or wave optics", (LINE_D_NM,))
    psf.add_argument(
        "--field", type=number, metavar="A", default=0.0, help="angle from the axis in degrees (default: 0)"
    )
    psf.add_argument("--pixels", type=count, metavar="N", default=64, help="along each side (default: %(default)s)")
    psf.add_argument(
        "--width-um", type=values.positive, metavar="W", help="side of the image (default: chosen from the spot)"
    )
    psf.add_argument("--json", action="store_true", help="print JSON")
    psf.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="write the share of light per pixel, .npy, or plot it, .svg, .png or .pdf",
    )
    add_diffraction(psf)
    psf.set_defaults(run=_psf, parser=psf)


def add_diffraction(parser: Parser) -> None:
    """Add the choice between rays and waves."""
    parser.add_argument(
        "--diffraction",
        action="store_true",
        help="by wave optics, from the path differences of the traced rays (default: by rays)",
    )


def lens_command(commands: Commands, name: str, text: str, waves: tuple[float, ...]) -> Parser:
    """Return a command that takes a focused lens and wavelengths."""
    parser = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
    add_lens(parser)
    add_wavelengths(parser, waves)
    parser.add_argument(
        "--best-focus",
        action="store_true",
        help="move the film to the least spot on the axis (default: paraxial focus)",
    )
    parser.add_argument(
        "--best-focus-field",
        type=float,
        metavar="DEG",
        help="move the film to the least spot of this field, at the first wavelength",
    )
    parser.add_argument(
        "--rays",
        type=count,
        metavar="N",
        help="rays across the beam each way (default: as many as the figures need)",
    )
    return parser


def focused_state(arguments: argparse.Namespace) -> "Setting":
    """The lens in focus as the options of `lens_command` say."""
    from rptcam_cl.lenstools import at_best_focus

    state, degrees = lens_in_use(arguments), arguments.best_focus_field
    if degrees is not None and not abs(degrees) < 89:
        raise InputError(f"--best-focus-field: got {degrees:g}; allowed between -89 and 89 degrees")
    if degrees is None and not arguments.best_focus:
        return state
    return at_best_focus(state, arguments.wavelengths, degrees or 0.0)


def _document(state: "Setting", **parts: Any) -> str:
    return as_json({"lens": state.lens.name, "film_distance_mm": state.film, **parts})


def _spot(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import film_spots, spot_chart, spot_table

    check_picture(arguments.output, arguments.lens)
    state = focused_state(arguments)
    spots = film_spots(state, arguments.fields, arguments.wavelengths, arguments.rays)
    rows = spot_table(spots)
    if arguments.json:
        print(_document(state, spots=rows))
    else:
        columns = (
            "field [°]",
            "wavelength [nm]",
            "rays",
            "x [mm]",
            "y [mm]",
            "rms [µm]",
            "in x",
            "in y",
            "largest",
            "rms ±",
            "largest ±",
        )
        shown = [["all" if key == "wavelength_nm" and value is None else value for key, value in row.items()]
                 for row in rows]  # fmt: skip
        print_table(columns, shown, f"{state.lens.name}, film at {state.film:.6g} mm")
    if arguments.output is not None:
        write_picture(spot_chart(state, spots), arguments.output)
    return 0


def _mtf(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import (
        field_waves,
        film_spots,
        mtf_chart,
        mtf_moves,
        mtf_table,
        wave_mtf_chart,
        wave_mtf_table,
    )

    check_picture(arguments.output, arguments.lens)
    if min(arguments.frequencies) < 0 or max(arguments.frequencies) <= 0:
        raise InputError("--frequencies: must not be negative, and one must be above 0")
    state = focused_state(arguments)
    chart: Callable[[], Figure]
    if arguments.diffraction:
        waves = field_waves(state, arguments.fields, arguments.wavelengths, arguments.rays)
        rows = wave_mtf_table(waves, arguments.frequencies)
        chart = partial(wave_mtf_chart, state, waves, max(arguments.frequencies))
    else:
        moves = mtf_moves(arguments.frequencies)
        spots = film_spots(state, arguments.fields, arguments.wavelengths, arguments.rays, moves)
        rows = mtf_table(spots, arguments.frequencies)
        chart = partial(mtf_chart, state, spots, max(arguments.frequencies))
    if arguments.json:
        print(_document(state, mtf=rows))
    else:
        columns = ["field [°]", "cycles/mm", "tangential", "sagittal", "limit tang.", "limit sag."]
        columns += [] if arguments.diffraction else ["±"]
        print_table(columns, [list(row.values()) for row in rows], f"{state.lens.name}, film at {state.film:.6g} mm")
    if arguments.output is not None:
        write_picture(chart(), arguments.output)
    return 0


def _psf(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import (
        field_waves,
        film_spots,
        image_moves,
        npy_bytes,
        point_image,
        psf_chart,
        wave_point_image,
    )

    output = arguments.output
    if not abs(arguments.field) <= STEEPEST:
        raise InputError(f"--field: got {arguments.field:g}; allowed from -{STEEPEST:g} to {STEEPEST:g} degrees")
    check_picture(output, arguments.lens, NUMBERS)
    state = focused_state(arguments)
    if arguments.diffraction:
        waves = field_waves(state, [arguments.field], arguments.wavelengths, arguments.rays)
        image = wave_point_image(waves, arguments.pixels, arguments.width_um)
    else:
        spots = film_spots(state, [arguments.field], arguments.wavelengths, arguments.rays, image_moves)
        image = point_image(spots, arguments.pixels, arguments.width_um)
    facts = {"field_degrees": arguments.field, "width_um": image.width_um, "pixels": arguments.pixels, **image.facts}
    if arguments.json:
        print(_document(state, psf=facts))
    else:
        print_table(("fact", "value"), [[name, value] for name, value in facts.items()], state.lens.name)
    if output is not None and output.suffix.lower() in NUMBERS:
        write(npy_bytes(image), output)
    elif output is not None:
        write_picture(psf_chart(state, image, arguments.field), output)
    return 0
