"""``rptcam lens ghosts``: light that surfaces reflect onto the film, way by way."""

import argparse
from dataclasses import replace
from typing import Any

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import (
    add_coating,
    add_lens,
    add_plot,
    add_wavelengths,
    check_picture,
    coated_lens,
    lens_in_use,
    number,
    numbers,
    write_picture,
)
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands

_COLUMNS = ("surfaces", "in frame", "on the plane", "x [mm]", "y [mm]", "rms [mm]", "focus [mm]", "blur [mm]")
MIDDLE_NM = 550.0
SHOWN = 20


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "ghosts of a source: light that surfaces reflect onto the film, pair by pair"
    parser = commands.add_parser("ghosts", help=text, description=text[0].upper() + text[1:] + ".")
    add_lens(parser)
    parser.add_argument(
        "--source", type=number, metavar="ANGLE", default=0.0,
        help="where the light comes from, in degrees from the axis (default: 0)",
    )  # fmt: skip
    parser.add_argument(
        "--source-distance-m", type=values.positive, metavar="D",
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
    from rptcam_cl.lenstools import draw_ghost, ghost_summary, ghost_table
    from rptcam_cl.optics import Beam, Lit, find_ghosts

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
    from rptcam_cl.lenstools import way_text

    rows = part["ways"] if arguments.all else part["ways"][:SHOWN]
    of = "the image's light" if part["shares_are_of"] == "image" else "the light that enters"
    cells = [[way_text(row["surfaces"]), *list(row.values())[1:]] for row in rows]
    print_table(_COLUMNS, cells, f"{title}, {part['wavelength_nm']:g} nm; shares of {of}")
    if len(rows) < len(part["ways"]):
        print(f"and {len(part['ways']) - len(rows)} fainter ones (--all shows them)")
    print(f"all ghosts: {part['ghosts_in_frame']:.4g} in the frame, {part['ghosts']:.4g} on its plane")
    if part["worst"] is not None:
        print(f"worst: {way_text(part['worst'])}; most concentrated: {way_text(part['densest'])}")
    goes = ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in part["account"].items() if value)
    print(f"of the light that enters: {goes}")
