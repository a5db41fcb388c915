"""``rptcam lens spot``, ``mtf``, ``psf``, ``wavefront``, ``ghosts``, ``glare`` and ``transmittance``."""

import argparse
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli.lens_options import (
    FDC,
    STEEPEST,
    add_coating,
    add_fields,
    add_lens_argument,
    add_plot,
    add_wavelengths,
    check_picture,
    coated_lens,
    count,
    lens_in_use,
    number,
    numbers,
    write,
    write_picture,
)
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands, Parser, positive
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rptcam_cl.optics.field_measures import TransmittanceRow
    from rptcam_cl.optics.image_quality import Setting


# ``rptcam lens spot``, ``mtf`` and ``psf``: how sharply a lens draws points, from exact rays.

NUMBERS = (".npy",)


def add_lens_spots(commands: Commands) -> None:
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
    psf.add_argument("--width-um", type=positive, metavar="W", help="side of the image (default: chosen from the spot)")
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
    add_lens_argument(parser)
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
    from rptcam_cl.optics.image_quality import at_best_focus

    state, degrees = lens_in_use(arguments), arguments.best_focus_field
    if degrees is not None and not abs(degrees) < 89:
        raise InputError(f"--best-focus-field: got {degrees:g}; allowed between -89 and 89 degrees")
    if degrees is None and not arguments.best_focus:
        return state
    return at_best_focus(state, arguments.wavelengths, degrees or 0.0)


def _document(state: "Setting", **parts: Any) -> str:
    return as_json({"lens": state.lens.name, "film_distance_mm": state.film, **parts})


def _spot(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.image_quality import film_spots, spot_chart, spot_table

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
    from rptcam_cl.optics.image_quality import (
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
    from rptcam_cl.optics.image_quality import (
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


# ``rptcam lens wavefront``: path differences at the exit pupil, from exact rays.

_COLUMNS = ("field [°]", "wavelength [nm]", "rms [waves]", "less tilt", "range", "Strehl", "at the peak", "y [mm]")


def add_lens_wavefront(commands: Commands) -> None:
    """Add the command."""
    text = "wavefront at the exit pupil: path differences in wavelengths, and Strehl ratios"
    parser = lens_command(commands, "wavefront", text, (LINE_D_NM,))
    add_fields(parser)
    add_plot(parser)
    parser.set_defaults(run=_wavefront, parser=parser)


def _wavefront(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.image_quality import field_waves, wavefront_chart, wavefront_table

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


# ``rptcam lens ghosts``: light that surfaces reflect onto the film, way by way.

_GHOST_COLUMNS = ("surfaces", "in frame", "on the plane", "x [mm]", "y [mm]", "rms [mm]", "focus [mm]", "blur [mm]")
MIDDLE_NM = 550.0
SHOWN = 20


def add_lens_ghosts(commands: Commands) -> None:
    """Add the command."""
    text = "ghosts of a source: light that surfaces reflect onto the film, pair by pair"
    parser = commands.add_parser("ghosts", help=text, description=text[0].upper() + text[1:] + ".")
    add_lens_argument(parser)
    parser.add_argument(
        "--source", type=number, metavar="ANGLE", default=0.0,
        help="where the light comes from, in degrees from the axis (default: 0)",
    )  # fmt: skip
    parser.add_argument(
        "--source-distance-m", type=positive, metavar="D",
        help="of a lamp from the first surface, along the axis (default: a source at infinity)",
    )  # fmt: skip
    parser.add_argument(
        "--film-mm", type=frame, metavar="W,H", default=(36.0, 24.0), help="size of the frame (default: 36,24)"
    )
    parser.add_argument(
        "--order", type=order, metavar="N", default=2, help="most reflections on a way, 2 or 4 (default: 2)"
    )
    parser.add_argument(
        "--film-reflectance", type=share, metavar="R", default=0.0,
        help="share of the light that the film reflects like a mirror (default: 0)",
    )  # fmt: skip
    add_wavelengths(parser, (MIDDLE_NM,))
    add_coating(parser)
    parser.add_argument("--all", action="store_true", help=f"print every way, not the {SHOWN} brightest")
    add_plot(parser)
    parser.set_defaults(run=_ghosts, parser=parser)


def frame(text: str) -> tuple[float, float]:
    """Width and height of ``W,H``."""
    found = numbers(text)
    if len(found) != 2 or min(found) <= 0:
        raise argparse.ArgumentTypeError(f"got {text}; allowed two lengths above 0, as 36,24")
    return found[0], found[1]


def order(text: str) -> int:
    """How many reflections are followed."""
    if text not in ("2", "4"):
        raise argparse.ArgumentTypeError(f"got {text}; light reaches the film after an even number: allowed 2 or 4")
    return int(text)


def share(text: str) -> float:
    """A share of the light."""
    value = number(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed from 0 to below 1")
    return value


def _ghosts(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.field_measures import draw_ghost, ghost_summary, ghost_table
    from rptcam_cl.optics.ghosts import Lit, find_ghosts
    from rptcam_cl.optics.spot import Beam

    check_picture(arguments.output, arguments.lens, (".svg",))
    state = lens_in_use(arguments)
    state = replace(state, lens=coated_lens(arguments, state.lens))
    away = 1000 * arguments.source_distance_m if arguments.source_distance_m is not None else float("inf")
    found = [
        find_ghosts(
            Lit(
                state.lens, state.film, Beam(arguments.source, away), wavelength, arguments.film_mm,
                film_reflectance=arguments.film_reflectance,
            ),
            arguments.order,
        )
        for wavelength in arguments.wavelengths
    ]  # fmt: skip
    parts = [{"wavelength_nm": one.lit.wavelength_nm, **ghost_summary(one), "ways": ghost_table(one)} for one in found]
    if arguments.json:
        head = {"lens": state.lens.name, "film_distance_mm": state.film, "source_degrees": arguments.source}
        print(as_json(head | {"ghosts": parts}))
    else:
        for part in parts:
            _print(part, f"{state.lens.name}, film at {state.film:.6g} mm, source at {arguments.source:g}°", arguments)
    if arguments.output is not None:
        worst = next((part["worst"] for part in parts if part["worst"]), None)
        if worst is not None:
            write_picture(draw_ghost(state, found[0], tuple(worst)), arguments.output)
    return 0


def _print(part: dict[str, Any], title: str, arguments: argparse.Namespace) -> None:
    """Print the sums of one wavelength and its brightest ways."""
    from rptcam_cl.optics.field_measures import way_text

    rows = part["ways"] if arguments.all else part["ways"][:SHOWN]
    of = "the image's light" if part["shares_are_of"] == "image" else "the light that enters"
    cells = [[way_text(row["surfaces"]), *list(row.values())[1:]] for row in rows]
    print_table(_GHOST_COLUMNS, cells, f"{title}, {part['wavelength_nm']:g} nm; shares of {of}")
    if len(rows) < len(part["ways"]):
        print(f"and {len(part['ways']) - len(rows)} fainter ones (--all shows them)")
    print(f"all ghosts: {part['ghosts_in_frame']:.4g} in the frame, {part['ghosts']:.4g} on its plane")
    if part["worst"] is not None:
        print(f"worst: {way_text(part['worst'])}; most concentrated: {way_text(part['densest'])}")
    goes = ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in part["account"].items() if value)
    print(f"of the light that enters: {goes}")


# ``rptcam lens glare``: how much light a bright surrounding sends to a black spot on the film.


def add_lens_glare(commands: Commands) -> None:
    """Add the command."""
    text = "veiling glare index: a black spot in the middle of the film under a hemisphere of even light"
    parser = commands.add_parser("glare", help=text, description=text[0].upper() + text[1:] + " (ISO 9358).")
    add_lens_argument(parser)
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
    from rptcam_cl.optics.irradiance import veiling_glare

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


# ``rptcam lens transmittance``: how much light a lens lets through, over the wavelength.

WAVELENGTHS = (400.0, 450.0, 500.0, 550.0, LINE_D_NM, 600.0, 650.0, 700.0)


def add_lens_losses(commands: Commands) -> None:
    """Add the command."""
    text = "light that glass and surfaces let through on the axis, and T-numbers"
    parser = commands.add_parser("transmittance", help=text, description=text[0].upper() + text[1:] + ".")
    add_lens_argument(parser)
    add_wavelengths(parser, WAVELENGTHS)
    add_coating(parser)
    add_plot(parser)
    parser.set_defaults(run=_transmittance, parser=parser)


def _transmittance(arguments: argparse.Namespace) -> int:
    from dataclasses import replace

    from rptcam_cl.optics.field_measures import transmittance_chart, transmittance_table

    check_picture(arguments.output, arguments.lens)
    state = lens_in_use(arguments)
    state = replace(state, lens=coated_lens(arguments, state.lens))
    rows: list[TransmittanceRow] = transmittance_table(state, arguments.wavelengths)
    if arguments.json:
        print(as_json({"lens": state.lens.name, "film_distance_mm": state.film_distance_mm, "transmittance": rows}))
    else:
        columns = ("wavelength [nm]", "glass", "bare", "coated", "T bare", "T coated")
        print_table(columns, [list(row.values()) for row in rows], state.lens.name)
    if arguments.output is not None:
        write_picture(transmittance_chart(state, rows), arguments.output)
    return 0
