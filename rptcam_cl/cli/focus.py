"""``rptcam focus``: autofocus of a scene's camera."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.lens_options import check_file, check_picture, write_picture
from rptcam_cl.cli.output import as_json, print_table, print_warnings
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.focusing import FocusReport

_ZONES = ("zones", "zones_file", "point", "object")


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "focus",
        help="find the focus of a scene's camera",
        description="Find the focus of a scene's camera by probing through its lens; prints where the film has to be.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument(
        "--method", type=values.focus_method, metavar="NAME",
        help="contrast, laplacian, variance, depth, phase or hybrid (default: the scene's, or contrast)",
    )  # fmt: skip
    parser.add_argument(
        "--zone", action="append", type=values.crop, metavar="x0,x1,y0,y1", dest="zones",
        help="rectangle to focus on, in fractions of the picture from the left and the top; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--zones", type=Path, metavar="FILE", dest="zones_file", help="file with a line xleft xright ytop ybottom each"
    )
    parser.add_argument("--point", type=values.point, metavar="x,y", help="point to focus on, in the same fractions")
    parser.add_argument("--object", metavar="NAME", help="object to focus on, wherever it is seen")
    parser.add_argument(
        "--policy", type=values.focus_policy, metavar="NAME",
        help="which of several zones decides: closest (default), farthest, centre or weighted",
    )  # fmt: skip
    parser.add_argument("--seed", type=values.seed, metavar="N", help="seed of the random numbers")
    values.add_device(parser)
    values.add_overrides(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the curve, .svg, .png or .pdf")
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    given = [name for name in _ZONES if getattr(arguments, name) is not None]
    if len(given) > 1:
        raise InputError("rptcam focus: takes one of --zone, --zones, --point and --object")
    if arguments.plot is not None:
        check_picture(arguments.plot, str(arguments.scene))
        check_file(arguments.plot, str(arguments.scene))
    from rptcam_cl.api import autofocus, load_scene
    from rptcam_cl.focusing import focus_plot

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
        _print(report)
    return 0


def _zones(arguments: argparse.Namespace) -> Any:
    if arguments.zones_file is None:
        return arguments.zones
    from rptcam_cl.scene import read_zones

    return read_zones(arguments.zones_file, str(arguments.zones_file))


def _print(report: "FocusReport") -> None:
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
