"""The commands ``rptcam lens spot``, ``mtf``, … of every declared measurement, and ``rptcam lens ghosts``."""

import argparse
from functools import partial
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli import lens_options
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands, Parser, add_command, finite, positive
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.measures import MEASUREMENTS, MIDDLE_NM, Measurement, Option

if TYPE_CHECKING:
    from rptcam_cl.optics.charts import Measured
    from rptcam_cl.optics.image_quality import Setting


NUMBERS = (".npy",)


def share(text: str) -> float:
    """A share of the light."""
    value = finite(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed from 0 to below 1")
    return value


READERS = {
    "angles": lens_options.angles,
    "steep angles": lens_options.steep_angles,
    "angle": finite,
    "wavelengths": lens_options.wavelengths,
    "numbers": lens_options.numbers,
    "count": lens_options.count,
    "length": positive,
    "share": share,
}


def add_lens_measurements(commands: Commands) -> None:
    """Add a command for each measurement."""
    for measurement in MEASUREMENTS:
        parser = add_command(commands, measurement.command, measurement.help, partial(_measure, measurement))
        lens_options.add_lens_argument(parser)
        for k, option in enumerate(measurement.options):
            _add_option(parser, option)
            if k == 0 and measurement.has_best_focus:
                _add_best_focus(parser)
        if measurement.has_wavelength:
            lens_options.add_wavelength(parser)
        if measurement.has_coating:
            lens_options.add_coating(parser)
        lens_options.add_plot(parser, has_chart=measurement.has_chart, has_array=bool(measurement.array))


def _add_option(parser: Parser, option: Option) -> None:
    if option.kind == "flag":
        parser.add_argument(option.flag, dest=option.keyword, action="store_true", help=option.help)
    elif option.kind == "choice":
        parser.add_argument(option.flag, dest=option.keyword, choices=option.choices, help=option.help)
    else:
        default = option.default if option.printed is None else option.printed
        parser.add_argument(
            option.flag, dest=option.keyword, type=READERS[option.kind], metavar=option.metavar, default=default,
            help=option.help,
        )  # fmt: skip


def _add_best_focus(parser: Parser) -> None:
    text = "move the film to the least spot on the axis (default: paraxial focus)"
    parser.add_argument("--best-focus", action="store_true", help=text)
    text = "move the film to the least spot of this field, at the first wavelength"
    parser.add_argument("--best-focus-field", type=float, metavar="DEG", help=text)


def _measure(measurement: Measurement, arguments: argparse.Namespace) -> int:
    """Measure, print and draw."""
    options = {option.keyword: getattr(arguments, option.keyword) for option in measurement.options}
    for option in measurement.options:
        option.check(options[option.keyword], option.flag)
    output = arguments.output if measurement.has_chart else None
    lens_options.check_picture(output, arguments.lens, NUMBERS if measurement.array else ())
    state = lens_options.lens_in_use(arguments, arguments.wavelength_nm if measurement.has_wavelength else LINE_D_NM)
    if measurement.has_best_focus:
        state = _in_best_focus(arguments, state)
    result = measurement.measure(state, options)
    if arguments.json:
        parts = {name: result.about[name] for name in ("film_distance_mm", *measurement.facts)}
        rows = result.table[0] if measurement.is_single else result.table
        print(as_json({"lens": state.lens.name, **parts, measurement.key: rows}))
    elif measurement.is_single:
        print_table(("fact", "value"), list(result.table[0].items()), result.caption)
    else:
        _print_rows(measurement, result)
    if output is not None and output.suffix.lower() in NUMBERS:
        from rptcam_cl.optics.image_quality import npy_bytes

        lens_options.write(npy_bytes(result.about[measurement.array]), output)
    elif output is not None and result.chart is not None:
        lens_options.write_picture(result.chart(), output)
    return 0


def _in_best_focus(arguments: argparse.Namespace, state: "Setting") -> "Setting":
    """The lens with its film where the options want it."""
    from rptcam_cl.optics.image_quality import at_best_focus

    degrees = arguments.best_focus_field
    if degrees is not None and not abs(degrees) < 89:
        raise InputError(f"--best-focus-field: got {degrees:g}; allowed between -89 and 89 degrees")
    if degrees is None and not arguments.best_focus:
        return state
    return at_best_focus(state, arguments.wavelengths_nm, degrees or 0.0)


def _print_rows(measurement: Measurement, result: "Measured") -> None:
    known = result.table[0] if result.table else measurement.columns
    columns = {key: head for key, head in measurement.columns.items() if key in known}
    cells = [
        ["all" if key == "wavelength_nm" and row[key] is None else row[key] for key in columns] for row in result.table
    ]
    print_table(list(columns.values()), cells, result.caption)


# ``rptcam lens ghosts``: light that surfaces reflect onto the film, way by way.

_COLUMNS = ("surfaces", "in frame", "on the plane", "x [mm]", "y [mm]", "rms [mm]", "focus [mm]", "blur [mm]")
SHOWN = 20


def add_lens_ghosts(commands: Commands) -> None:
    """Add the command."""
    text = "ghosts of a source: light that surfaces reflect onto the film, pair by pair"
    parser = add_command(commands, "ghosts", text, _ghosts)
    lens_options.add_lens_argument(parser)
    parser.add_argument(
        "--source", type=finite, metavar="ANGLE", default=0.0,
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
    lens_options.add_wavelengths(parser, (MIDDLE_NM,))
    lens_options.add_coating(parser)
    parser.add_argument("--all", action="store_true", help=f"print every way, not the {SHOWN} brightest")
    lens_options.add_plot(parser)


def frame(text: str) -> tuple[float, float]:
    """Width and height of ``W,H``."""
    sides = lens_options.numbers(text)
    if len(sides) != 2 or min(sides) <= 0:
        raise argparse.ArgumentTypeError(f"got {text}; allowed two lengths above 0, as 36,24")
    return sides[0], sides[1]


def order(text: str) -> int:
    """How many reflections are followed."""
    if text not in ("2", "4"):
        raise argparse.ArgumentTypeError(f"got {text}; light reaches the film after an even number: allowed 2 or 4")
    return int(text)


def _ghosts(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.field_measures import draw_ghost, ghost_summary, ghost_table
    from rptcam_cl.optics.ghosts import Lit, find_ghosts
    from rptcam_cl.optics.spot import Beam

    lens_options.check_picture(arguments.output, arguments.lens, (".svg",))
    state = lens_options.lens_in_use(arguments)
    away = 1000 * arguments.source_distance_m if arguments.source_distance_m is not None else float("inf")
    accounts = [
        find_ghosts(
            Lit(
                state.lens, state.film, Beam(arguments.source, away), wavelength, arguments.film_mm,
                film_reflectance=arguments.film_reflectance,
            ),
            arguments.order,
        )
        for wavelength in arguments.wavelengths
    ]  # fmt: skip
    parts = [
        {"wavelength_nm": one.lit.wavelength_nm, **ghost_summary(one), "ways": ghost_table(one)} for one in accounts
    ]
    if arguments.json:
        head = {"lens": state.lens.name, "film_distance_mm": state.film, "source_degrees": arguments.source}
        print(as_json(head | {"ghosts": parts}))
    else:
        for part in parts:
            _print(part, f"{state.lens.name}, film at {state.film:.6g} mm, source at {arguments.source:g}°", arguments)
    if arguments.output is not None:
        worst = next((part["worst"] for part in parts if part["worst"]), None)
        if worst is not None:
            lens_options.write_picture(draw_ghost(state, accounts[0], tuple(worst)), arguments.output)
    return 0


def _print(part: dict[str, Any], title: str, arguments: argparse.Namespace) -> None:
    """Print the sums of one wavelength and its brightest ways."""
    from rptcam_cl.optics.field_measures import way_text

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
