"""The commands of ``rptcam lens`` that measure: ``spot``, ``mtf``, … of every declared measurement, ``ghosts``,
``trace``, ``breathing``, ``focus-scale`` and ``tolerance``."""

import argparse
import math
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import digits, number
from rptcam_cl.cli import lens_options
from rptcam_cl.cli.output import Commands, Parser, add_command, add_device, as_json, finite, positive, print_table
from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import check_writable
from rptcam_cl.optics.measures import MEASUREMENTS, MIDDLE_NM, Measurement, Option

if TYPE_CHECKING:
    from rptcam_cl.optics import charts, ray_trace
    from rptcam_cl.optics.lens import Lens
    from rptcam_cl.optics.spots import Setting
    from rptcam_cl.rendering import tolerance_run, tolerances, traceable_lens


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
    "distances": lens_options.distances,
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
        if measurement.has_section:
            parser.add_argument(
                "--section", choices=("y", "x"), default="y",
                help="fields lie along y, or along x, which then stands for y in the results (default: %(default)s)",
            )  # fmt: skip
        if measurement.has_wavelength:
            lens_options.add_wavelength(parser)
        if measurement.has_coating:
            lens_options.add_coating(parser)
        lens_options.add_plot(parser, has_chart=measurement.has_chart, has_array=bool(measurement.array))


def _add_option(parser: Parser, option: Option) -> None:
    if option.kind == "flag":
        parser.add_argument(option.flag, dest=option.keyword, action="store_true", help=option.help)
    elif option.kind == "choice":
        parser.add_argument(
            option.flag, dest=option.keyword, choices=option.choices, default=option.default, help=option.help
        )
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
    section = arguments.section if measurement.has_section else "y"
    result = measurement.measure(state, options, section)
    if arguments.json:
        parts = {name: result.about[name] for name in ("film_distance_mm", *measurement.facts)}
        rows = result.table[0] if measurement.is_single else result.table
        along = {"section": section} if measurement.has_section else {}
        print(as_json({"lens": state.lens.name, **along, **parts, measurement.key: rows}))
    elif measurement.is_single:
        print_table(("fact", "value"), list(result.table[0].items()), result.caption)
    else:
        _print_rows(measurement, result)
    if output is not None and output.suffix.lower() in NUMBERS:
        from rptcam_cl.optics.spots import npy_bytes

        lens_options.write(npy_bytes(result.about[measurement.array]), output)
    elif output is not None and result.chart is not None:
        lens_options.write_picture(result.chart(), output)
    return 0


def _in_best_focus(arguments: argparse.Namespace, state: "Setting") -> "Setting":
    """The lens with its film where the options want it."""
    from rptcam_cl.optics.spots import at_best_focus

    degrees = arguments.best_focus_field
    if degrees is not None and not abs(degrees) < 89:
        raise InputError(f"--best-focus-field: got {degrees:g}; allowed between -89 and 89 degrees")
    if degrees is None and not arguments.best_focus:
        return state
    return at_best_focus(state, arguments.wavelengths_nm, degrees or 0.0)


def _print_rows(measurement: Measurement, result: "charts.Measured") -> None:
    known = result.table[0] if result.table else measurement.columns
    columns = {key: head for key, head in measurement.columns.items() if key in known}
    cells = [
        [
            "all" if key == "wavelength_nm" and row[key] is None else "inf" if row[key] == math.inf else row[key]
            for key in columns
        ]
        for row in result.table
    ]
    print_table(list(columns.values()), cells, result.caption)


# ``rptcam lens ghosts``: light that surfaces reflect onto the film, way by way.

_COLUMNS = ("surfaces", "in frame", "on the plane", "±", "x [mm]", "y [mm]", "rms [mm]", "focus [mm]", "blur [mm]")
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
    from rptcam_cl.optics.beams import Beam
    from rptcam_cl.optics.field_measures import draw_ghost, ghost_summary, ghost_table
    from rptcam_cl.optics.ghosts import Lit, find_ghosts

    lens_options.check_picture(arguments.output, arguments.lens, (".svg",))
    state = lens_options.lens_in_use(arguments)
    away = 1000 * arguments.source_distance_m if arguments.source_distance_m is not None else float("inf")
    accounts, *fewer = ([
        find_ghosts(
            Lit(
                state.lens, state.film, Beam(arguments.source, away), wavelength, arguments.film_mm,
                film_reflectance=arguments.film_reflectance,
            ),
            arguments.order, 1 / divided,
        )
        for wavelength in arguments.wavelengths
    ] for divided in (1, 2, 3))  # fmt: skip
    parts = [
        {"wavelength_nm": one.lit.wavelength_nm, **ghost_summary(one, less), "ways": ghost_table(one, less)}
        for one, *less in zip(accounts, *fewer, strict=True)
    ]
    if arguments.json:
        head = {"lens": state.lens.name, "film_distance_mm": state.film, "source_degrees": arguments.source}
        print(as_json(head | {"ghosts": parts}))
    else:
        for part in parts:
            _print_ghosts(
                part, f"{state.lens.name}, film at {state.film:.6g} mm, source at {arguments.source:g}°", arguments
            )
    if arguments.output is not None:
        worst = next((part["worst"] for part in parts if part["worst"]), None)
        if worst is not None:
            lens_options.write_picture(draw_ghost(state, accounts[0], tuple(worst)), arguments.output)
    return 0


def _print_ghosts(part: dict[str, Any], title: str, arguments: argparse.Namespace) -> None:
    """Print the sums of one wavelength and its brightest ways."""
    from rptcam_cl.optics.field_measures import way_text

    rows = part["ways"] if arguments.all else part["ways"][:SHOWN]
    of = "the image's light" if part["shares_are_of"] == "image" else "the light that enters"
    cells = [[way_text(row["surfaces"]), *list(row.values())[1:]] for row in rows]
    print_table(_COLUMNS, cells, f"{title}, {part['wavelength_nm']:g} nm; shares of {of}")
    if len(rows) < len(part["ways"]):
        print(f"and {len(part['ways']) - len(rows)} fainter ones (--all shows them)")
    frame, plane, error = (part[name] for name in ("ghosts_in_frame", "ghosts", "ghosts_error"))
    print(f"all ghosts: {frame:.4g} in the frame, {plane:.4g} on its plane, ± {error:.2g}")
    if part["worst"] is not None:
        print(f"worst: {way_text(part['worst'])}; most concentrated: {way_text(part['densest'])}")
    goes = ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in part["account"].items() if value)
    print(f"of the light that enters: {goes}, ± {part['account_error']:.2g}")


# ``rptcam lens trace``: the path and fate of single rays.


def add_lens_trace(commands: Commands) -> None:
    """Add the command."""
    text = "trace single rays: where they leave the lens, or which surface stops them"
    description = f"{text.capitalize()}. Millimetres; z = 0 at the first vertex, +z towards the film."
    parser = add_command(commands, "trace", text, _run_lens_trace, description)
    lens_options.add_lens_argument(parser)
    parser.add_argument(
        "rays", metavar="RAYS", nargs="?",
        help="JSON [{origin, direction, wavelength_nm}], or CSV x,y,z,dx,dy,dz[,wavelength_nm]; - reads standard input",
    )  # fmt: skip
    parser.add_argument("--film-point", type=finite, nargs=2, metavar=("X", "Y"), help="one ray from here on the film")
    parser.add_argument(
        "--through", type=finite, nargs=2, metavar=("U", "V"), default=(0.0, 0.0),
        help="to this point of the plane of the last vertex (default: 0 0)",
    )  # fmt: skip
    parser.add_argument(
        "--start", choices=("film", "scene"), default="film", help="side where rays begin (default: %(default)s)"
    )
    lens_options.add_wavelength(parser, "of rays that have none of their own")
    add_device(parser, default="the float64 reference on the host")
    parser.add_argument("--precision", choices=("single", "double"), help="arithmetic of the device (default: single)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def _rays(arguments: argparse.Namespace, state: "Setting") -> lens_options.RayList:
    if (arguments.rays is None) == (arguments.film_point is None):
        raise InputError("rptcam lens trace: needs either a file of rays or --film-point")
    if arguments.rays is not None:
        return lens_options.read_rays(arguments.rays, arguments.wavelength_nm)
    if arguments.start != "film":
        raise InputError("--film-point: such a ray starts from the film (leave out --start scene)")
    (x, y), (u, v) = arguments.film_point, arguments.through
    return [[x, y, state.film_z]], [[u - x, v - y, -state.film]], [arguments.wavelength_nm]


def _trace(arguments: argparse.Namespace, state: "Setting", rays: lens_options.RayList) -> "tuple[ray_trace.Rays, str]":
    """The rays behind the lens, and what traced them."""
    from rptcam_cl.optics.ray_trace import trace

    if arguments.device in (None, "none"):
        if arguments.precision is not None:
            raise InputError("--precision: belongs to a device; name one with --device")
        return trace(state.lens, *rays, arguments.start), "in float64 on the host"
    from rptcam_cl.device.session import open_session
    from rptcam_cl.rendering.traceable_lens import trace_on_device

    session = open_session(arguments.device)
    precision: traceable_lens.Precision = arguments.precision or "single"
    name = f"on {session.info.id} {session.info.name}, {precision} precision"
    return trace_on_device(state.lens, session, *rays, arguments.start, precision), name


def _rows(rays: "ray_trace.Rays", wavelengths: list[float]) -> list[dict[str, Any]]:
    from rptcam_cl.optics.ray_trace import Status

    return [
        {
            "status": Status(int(rays.status[i])).name,
            "surface": int(rays.surface[i]) if rays.surface[i] >= 0 else None,
            "origin": rays.origins[i].tolist(),
            "direction": rays.directions[i].tolist(),
            "wavelength_nm": wavelengths[i],
        }
        for i in range(len(wavelengths))
    ]


def _run_lens_trace(arguments: argparse.Namespace) -> int:
    state = lens_options.lens_in_use(arguments, arguments.wavelength_nm)
    rays = _rays(arguments, state)
    traced, name = _trace(arguments, state, rays)
    rows = _rows(traced, rays[2])
    print(f"{len(rows)} rays traced {name}", file=sys.stderr)
    if arguments.json:
        print(as_json({"lens": state.lens.name, "start": arguments.start, "rays": rows}))
        return 0
    columns = ("ray", "status", "surface", "x", "y", "z", "dx", "dy", "dz", "wavelength [nm]")
    cells = [
        [i, row["status"].replace("_", " "), row["surface"], *row["origin"], *row["direction"], row["wavelength_nm"]]
        for i, row in enumerate(rows)
    ]
    print_table(columns, cells, f"{state.lens.name}, rays from the {arguments.start}")
    return 0


# ``rptcam lens breathing``: field of view and speed of a lens over its focus and its zoom.

_DISTANCES_M = "inf,10,5,3,2,1.5"
_distances = lens_options.number_list(
    "distances above 0 with commas between, as inf,5,2,1", lambda value: 0 < value < 1e9 or value == math.inf
)


def add_lens_breathing(commands: Commands) -> None:
    """Add the command."""
    text = "field of view, f-number and T-number over focus and zoom"
    parser = add_command(commands, "breathing", text, _breathing)
    lens_options.add_lens_argument(parser)
    parser.add_argument(
        "--distances-m", type=_distances, metavar="A,B,…", default=_DISTANCES_M,
        help="from the object to the film in metres, the first is what others are compared with; inf is infinity"
        " (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--film-width-mm", type=positive, metavar="W", default=36.0, help="of the film (default: %(default)s)"
    )
    lens_options.add_coating(parser)
    parser.add_argument("--csv", action="store_true", help="print comma-separated values")
    lens_options.add_plot(parser)


def _positions(arguments: argparse.Namespace) -> list[tuple[str, "Lens"]]:
    """The lens in each of its zoom positions, or in the one that the options choose, stopped down."""
    from rptcam_cl.optics.lens import in_configuration

    lens = lens_options.zoomed_lens(arguments, LINE_D_NM)
    if lens.configurations and arguments.zoom is None and arguments.focal_length_mm is None:
        positions = [(each.name, in_configuration(lens, each.name)) for each in lens.configurations]
    else:
        positions = [(arguments.zoom or "", lens)]
    if arguments.f_number is None:
        return positions
    return [(name, each.with_stop_diameter(each.stop_diameter_for(arguments.f_number))) for name, each in positions]


def _breathing(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics.ray_trace import COATED, UNCOATED, has_coatings
    from rptcam_cl.rendering.cameras.chief_rays import breathing_chart, breathing_csv, breathing_table

    lens_options.check_picture(arguments.output, arguments.lens)
    if arguments.focus_distance_m is not None:
        raise InputError("--focus-distance-m: has no effect on breathing (allowed: --distances-m)")
    positions = _positions(arguments)
    lens = positions[0][1]
    losses = COATED if has_coatings(lens) else UNCOATED
    rows = breathing_table(positions, arguments.distances_m, arguments.film_width_mm, LINE_D_NM, losses)
    if arguments.json:
        print(as_json({"lens": lens.name, "film_width_mm": arguments.film_width_mm, "breathing": rows}))
    elif arguments.csv:
        print(breathing_csv(rows), end="")
    else:
        columns = ("zoom", "focus [m]", "f [mm]", "film [mm]", "field [°]", "breathing [%]", "magnification", "f/", "T")
        print_table(columns, [list(row.values()) for row in rows], lens.name)
    if arguments.output is not None:
        lens_options.write_picture(breathing_chart(lens.name, rows), arguments.output)
    return 0


# ``rptcam lens focus-scale``: what is engraved on the focus ring.


def add_lens_focus_scale(commands: Commands) -> None:
    """Add the command."""
    text = "the scale engraved on the focus ring: distances, turn, and what moves how far"
    parser = add_command(commands, "focus-scale", text, _focus_scale)
    lens_options.add_lens_argument(parser)
    parser.add_argument(
        "--distances-m", type=_distances, metavar="A,B,…",
        help="from the object to the film in metres (default: those of a lens barrel, from infinity to the nearest)",
    )  # fmt: skip
    parser.add_argument(
        "--nearest-m", type=positive, metavar="D",
        help="where the scale ends (default: as near as the lens file says, or 10 focal lengths)",
    )  # fmt: skip
    parser.add_argument(
        "--throw-degrees", type=positive, metavar="A", default=120.0,
        help="how far the ring turns from infinity to the last mark (default: %(default)s)",
    )  # fmt: skip
    lens_options.add_plot(parser)


def _focus_scale(arguments: argparse.Namespace) -> int:
    from rptcam_cl.rendering.cameras.chief_rays import focus_scale, focus_scale_chart

    lens_options.check_picture(arguments.output, arguments.lens)
    if arguments.focus_distance_m is not None:
        raise InputError("--focus-distance-m: has no effect on the scale (allowed: --distances-m, --nearest-m)")
    if arguments.distances_m and arguments.nearest_m:
        raise InputError("--nearest-m: has no effect beside --distances-m")
    positions = _positions(arguments)
    rows = focus_scale(
        positions, LINE_D_NM, arguments.throw_degrees, arguments.distances_m or None, arguments.nearest_m
    )
    name = positions[0][1].name
    if arguments.json:
        print(as_json({"lens": name, "throw_degrees": arguments.throw_degrees, "scale": rows}))
    else:
        columns = ("zoom", "focus [m]", "[ft]", "turn [°]", "moves [mm]", "film [mm]", "magnification")
        print_table(columns, [list(row.values()) for row in rows], name)
    if arguments.output is not None:
        lens_options.write_picture(focus_scale_chart(name, rows), arguments.output)
    return 0


# ``rptcam lens tolerance``: how copies of a lens turn out within tolerances.

MOST_COPIES = 100_000
_copies = number(digits, 10, MOST_COPIES, f"10 to {MOST_COPIES}")
_seed = number(digits, 0, 2**63 - 1, "whole numbers from 0")


def add_lens_tolerance(commands: Commands) -> None:
    """Add the command."""
    text = "copies of a lens made within tolerances: yield, percentiles and worst offenders"
    parser = add_command(commands, "tolerance", text, _run_lens_tolerance)
    parser.add_argument("lens", metavar="LENS", help="a name from the list, or a lens file")
    parser.add_argument(
        "spec", metavar="SPEC", help="a YAML file of tolerances, or a grade: commercial, precision, high_precision"
    )
    lens_options.add_catalogue(parser)
    default = "(default: as the specification says)"
    parser.add_argument("--copies", type=_copies, metavar="N", help=f"how many lenses to make {default}")
    parser.add_argument("--seed", type=_seed, metavar="S", help=f"which lenses {default}")
    parser.add_argument(
        "--limit", type=finite, metavar="X",
        help="print which share of the copies has this spot [micrometres], or modulation (0 to 1), or a better one",
    )  # fmt: skip
    parser.add_argument(
        "--for-yield", type=finite, metavar="P",
        help="find the loosest tolerances of these kinds with which P percent of the copies reach the limit",
    )  # fmt: skip
    parser.add_argument("--write", type=Path, metavar="FILE", help="write them as a specification, .yaml")
    add_device(parser, "trace the copies on a device: ", "on the host")
    lens_options.add_plot(parser)


def _run_lens_tolerance(arguments: argparse.Namespace) -> int:
    from rptcam_cl.rendering.tolerance_run import report, tolerance, tolerance_chart

    lens_options.check_picture(arguments.output, arguments.lens)
    if arguments.output is not None and arguments.output.resolve() == Path(arguments.spec).resolve():
        raise InputError(f"{arguments.output}: would overwrite the specification")
    if arguments.for_yield is not None or arguments.write is not None:
        return _loosest(arguments)
    run = tolerance(
        lens_options.load(arguments.lens, arguments.catalogue),
        arguments.spec,
        copies=arguments.copies,
        seed=arguments.seed,
        trace=_copies_tracer(arguments.device),
    )
    if arguments.json:
        share = {} if arguments.limit is None else {"limit": arguments.limit} | asdict(run.yield_at(arguments.limit))
        print(as_json(report(run) | ({"yield_at": share} if share else {})))
    else:
        _print_tolerance(run, arguments.limit)
    if arguments.output is not None:
        lens_options.write_picture(tolerance_chart(run), arguments.output)
    return 0


def _copies_tracer(device: str | None) -> "tolerances.FilmPoints":
    from rptcam_cl.optics.as_built import film_points
    from rptcam_cl.rendering.traceable_lens import CopiesTracer

    return film_points if device is None else CopiesTracer(device).film_points


def _loosest(arguments: argparse.Namespace) -> int:
    import yaml

    from rptcam_cl.rendering.tolerance_run import loosest_set, report, tolerance_chart

    if arguments.for_yield is None or not 0 < arguments.for_yield < 100:
        raise InputError("--for-yield: expected percents above 0 and below 100, with --limit")
    if arguments.limit is None:
        raise InputError("--for-yield: needs --limit, the spot [µm] or modulation that the copies are to reach")
    if arguments.write is not None:
        check_writable(arguments.write, [arguments.spec])
    lens = lens_options.load(arguments.lens, arguments.catalogue)
    found = loosest_set(
        lens, arguments.spec, arguments.limit, arguments.for_yield, copies=arguments.copies, seed=arguments.seed,
        trace=_copies_tracer(arguments.device),
    )  # fmt: skip
    share = asdict(found.run.yield_at(arguments.limit))
    if arguments.json:
        facts = {"limit": arguments.limit, "yield_at": share, "specification": found.specification}
        print(as_json(facts | {"factors": found.factors.tolist(), "run": report(found.run)}))
    else:
        entries = found.specification["tolerances"]
        rows = [
            [label, factor, next(f"{key} {value:g}" for key, value in entry.items())]
            for label, factor, entry in zip(found.labels, found.factors.tolist(), entries, strict=True)
        ]
        print_table(("tolerance", "times", "now"), rows, f"{lens.name}: loosest set for {arguments.for_yield:g} %")
        value, low, high = (100 * part for part in share.values())
        what = "at most" if found.run.rank_by == "spot" else "at least"
        count = found.run.copies.count
        interval = f"95 %: {low:.1f} to {high:.1f} %"
        print(f"{value:.1f} % of {count} other copies have {what} {arguments.limit:g} ({interval})")
    if arguments.write is not None:
        lens_options.write(yaml.safe_dump(found.specification, sort_keys=False).encode(), arguments.write)
    if arguments.output is not None:
        lens_options.write_picture(tolerance_chart(found.run), arguments.output)
    return 0


def _print_tolerance(run: "tolerance_run.ToleranceRun", limit: float | None) -> None:
    from rptcam_cl.rendering.tolerance_run import percentile_rows

    by_spot = run.rank_by == "spot"
    head = f"{run.lens.name}, {run.copies.count} copies, fields {', '.join(f'{a:g}' for a in run.fields_degrees)}°"
    modulation = f"MTF at {run.tolerances.merit.mtf_per_mm:g}/mm"
    columns = ("copies [%]", "rms spot [µm]", modulation, "95 % interval", "refocus [mm]", "copy")
    rows: list[list[object]] = [["design", float(run.design.spot_um[0]), float(run.design.modulation[0]), "", 0.0, ""]]
    for row in percentile_rows(run):
        interval = f"{row['low']:.4g} to {row['high']:.4g}"
        rows.append([f"{row['percent']:g}", row["spot_um"], row["mtf"], interval, row["shift_mm"], str(row["copy"])])
    print_table(columns, rows, f"{head}; ranked by {'spot' if by_spot else 'modulation'}")
    print(f"more rays change spots by at most {100 * run.spot_error:.2g} %, modulation by {run.mtf_error:.2g}")
    if limit is not None:
        share, low, high = (100 * value for value in run.yield_at(limit))
        what = f"a spot of {limit:g} µm or less" if by_spot else f"a modulation of {limit:g} or more"
        print(f"{share:.1f} % of the copies have {what} (95 %: {low:.1f} to {high:.1f} %)")
    if run.compensators:
        settings = [[label, f"{100 * rms:.0f}", f"{100 * at_end:.0f}"] for label, rms, at_end in run.adjustments()]
        print_table(("compensator", "rms [% of its range]", "copies at its end [%]"), settings, "Adjusted in each copy")
    offenders = [
        [one.label, one.direction, one.spot_change_um, one.mtf_change, one.shift_mm] for one in run.worst_offenders()
    ]
    changes = ("worst offenders", "at", "spot [µm]", "MTF", "refocus [mm]")
    print_table(changes, offenders, "Each tolerance alone, less the design")
