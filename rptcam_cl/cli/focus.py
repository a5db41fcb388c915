"""``rptcam focus``, autofocus of a scene's camera, and ``tradeoff``, what each approximation costs and gains."""

import argparse
import contextlib
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.api.options import add_options, crop, duration, share, size
from rptcam_cl.cli.lens_options import check_file, check_picture, write, write_picture
from rptcam_cl.cli.output import as_json, print_table, print_warnings, say_on_stderr
from rptcam_cl.cli.parser import add_device, focus_method, focus_policy, point
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.studies.focus.probe import FocusReport
    from rptcam_cl.studies.tradeoff import TradeoffReport


# ``rptcam focus``: autofocus of a scene's camera.

_ZONES = ("zones", "zones_file", "point", "object")


def add_focus(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument(
        "--method", type=focus_method, metavar="NAME",
        help="contrast, laplacian, variance, depth, phase or hybrid (default: the scene's, or contrast)",
    )  # fmt: skip
    parser.add_argument(
        "--zone", action="append", type=crop, metavar="x0,x1,y0,y1", dest="zones",
        help="rectangle to focus on, in fractions of the picture from the left and the top; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--zones", type=Path, metavar="FILE", dest="zones_file", help="file with a line xleft xright ytop ybottom each"
    )
    parser.add_argument("--point", type=point, metavar="x,y", help="point to focus on, in the same fractions")
    parser.add_argument("--object", metavar="NAME", help="object to focus on, wherever it is seen")
    parser.add_argument(
        "--policy", type=focus_policy, metavar="NAME",
        help="which of several zones decides: closest (default), farthest, centre or weighted",
    )  # fmt: skip
    add_options(parser, "seed")
    add_device(parser)
    add_options(parser, "overrides")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the curve, .svg, .png or .pdf")


def run_focus(arguments: argparse.Namespace) -> int:
    """Find the focus of a scene's camera by probing through its lens; prints where the film has to be."""
    given = [name for name in _ZONES if getattr(arguments, name) is not None]
    if len(given) > 1:
        raise InputError("rptcam focus: takes one of --zone, --zones, --point and --object")
    if arguments.plot is not None:
        check_picture(arguments.plot, str(arguments.scene))
        check_file(arguments.plot, str(arguments.scene))
    from rptcam_cl.scene.load import load_scene
    from rptcam_cl.studies.focus.controller import autofocus
    from rptcam_cl.studies.focus.probe import focus_plot

    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    report = autofocus(
        scene,
        arguments.method,
        zones=_zones(arguments),
        point=arguments.point,
        object=arguments.object,
        policy=arguments.policy,
        seed=arguments.seed,
        device=arguments.device,
    )
    print_warnings(report.warnings)
    if arguments.plot is not None:
        write_picture(focus_plot(report, f"{arguments.scene.stem}: autofocus by {report.method}"), arguments.plot)
    if arguments.json:
        print(as_json(report.as_dict()))
    else:
        _print_focus(report)
    return 0


def _zones(arguments: argparse.Namespace) -> Any:
    if arguments.zones_file is None:
        return arguments.zones
    from rptcam_cl.scene.lens_settings import read_zones

    return read_zones(arguments.zones_file, str(arguments.zones_file))


def _print_focus(report: "FocusReport") -> None:
    """Print the probes and the focus that was found."""
    rows = [
        [probe.film_distance_mm, probe.value, probe.error, probe.stop, probe.samples / 1e6, probe.seconds]
        for probe in report.probes
    ]
    columns = ("film distance [mm]", "measure", "error", "stop", "Msamples", "seconds")
    print_table(columns, rows, f"autofocus by {report.method}")
    if "started" in report.notes:
        start, step = report.notes["start_m"], report.notes["step_m"]
        print(f"from {start:.6g} m in steps of {step:.6g} m: {report.notes['started']}")
    distance = "nothing" if report.focus_distance_m is None else f"{report.focus_distance_m:.6g} m"
    film = f"film {report.film_distance_mm:.6g} mm behind the lens"
    doubt = "" if report.failure is None else ", NOT KNOWN TO BE IN FOCUS"
    print(f"{film}, sharp at {distance}, confidence {report.confidence:.2f}{doubt}")


# ``rptcam tradeoff``: what each approximation of a picture costs and gains.

PRINTED = Path("-")  # in place of a file: to standard output


def add_tradeoff(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument(
        "--budget",
        type=duration,
        metavar="TIME",
        default=60.0,
        help="how long to measure, as 60s or 5min (default 60s)",
    )
    parser.add_argument(
        "--time",
        type=duration,
        metavar="TIME",
        default=60.0,
        help="rendering time to advise for (default 60s)",
    )
    parser.add_argument(
        "--error", type=share, metavar="X", default=0.02,
        help="relative error (root of relMSE) to advise for, as 0.02 or 2%% (default 0.02)",
    )  # fmt: skip
    parser.add_argument("--size", type=size, metavar="WxH", help="resolution in pixels, in place of the scene's")
    parser.add_argument(
        "--json", nargs="?", const=PRINTED, type=Path, metavar="FILE",
        help="write all numbers, .json; without a name, print them as JSON in place of text",
    )  # fmt: skip
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write advice and tables, .md")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw errors over time, field and picture, .svg, .png or .pdf"
    )
    parser.add_argument("--details", action="store_true", help="print all tables and how they were found, too")
    add_device(parser)
    add_options(parser, "overrides")
    parser.add_argument("--quiet", action="store_true", help="print only the result, warnings and errors")


def run_tradeoff(arguments: argparse.Namespace) -> int:
    """Render a scene in many ways by turns, and advise which one to use."""
    _check_outputs(arguments)
    from rptcam_cl.scene.load import load_scene
    from rptcam_cl.studies.tradeoff import measure_tradeoff

    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    with contextlib.nullcontext() if arguments.quiet else say_on_stderr(_line) as show:
        report = measure_tradeoff(
            scene,
            budget=arguments.budget,
            seconds=arguments.time,
            error=arguments.error,
            size=arguments.size,
            device=arguments.device,
            on_progress=show,
        )
    _write(report, arguments)  # before any printing, which a reader like head may end
    if arguments.json == PRINTED:
        print(as_json(report.as_dict()))
    else:
        overrides = "".join(f" --set {shlex.quote(text)}" for text in arguments.overrides)
        _print_tradeoff(
            report, f"rptcam render {shlex.quote(str(arguments.scene))}{overrides}", details=arguments.details
        )
    return 0


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Check, before anything is measured, that all files can be written."""
    from rptcam_cl.core.files import check_writable, known_suffix

    for path, suffix in ((arguments.json, ".json"), (arguments.markdown, ".md")):
        if path is None or (path == PRINTED and suffix == ".json"):
            continue
        known_suffix(path, (suffix,), "unknown kind of file")
        check_writable(path, [arguments.scene])
    if arguments.plot is not None:
        check_picture(arguments.plot, str(arguments.scene))


def _print_tradeoff(report: "TradeoffReport", command: str, *, details: bool) -> None:
    """Print the advice, whose commands may be pasted, and the tables and how they were found if that is wanted."""
    from rptcam_cl.studies.tradeoff import COMMAND, caveats, recommendation, summary, tables

    if not details:
        print("\n".join(summary(report)).replace(COMMAND, command))
        return

    print("\n".join(recommendation(report)).replace(COMMAND, command), end="\n\n")
    for title, columns, rows in tables(report):
        print_table(columns, rows, title)
        print()
    print("\n".join(caveats(report)))


def _write(report: "TradeoffReport", arguments: argparse.Namespace) -> None:
    from rptcam_cl.studies.tradeoff import markdown, tradeoff_plot

    title = f"{arguments.scene.stem}: accuracy and time"
    if arguments.json not in (None, PRINTED):
        write((as_json(report.as_dict()) + "\n").encode(), arguments.json)
    if arguments.markdown is not None:
        write(markdown(report, title).encode(), arguments.markdown)
    if arguments.plot is not None:
        write_picture(tradeoff_plot(report, title), arguments.plot)


def _line(words: str, share: float | None) -> str:
    return words if share is None else f"{words} ({share:.0%})"
