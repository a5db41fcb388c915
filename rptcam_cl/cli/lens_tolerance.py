"""``rptcam lens tolerance``: how copies of a lens turn out within tolerances."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.cli.lens_options import add_catalogue, add_plot, check_picture, load, number, write_picture
from rptcam_cl.cli.output import as_json, print_table
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.tolerances import ToleranceRun

MOST_COPIES = 100_000


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "copies of a lens made within tolerances: yield, percentiles and worst offenders"
    parser = commands.add_parser("tolerance", help=text, description=text[0].upper() + text[1:] + ".")
    parser.add_argument("lens", metavar="LENS", help="a name from the list, or a lens file")
    parser.add_argument(
        "spec", metavar="SPEC", help="a YAML file of tolerances, or a grade: commercial, precision, high_precision"
    )
    add_catalogue(parser)
    default = "(default: as the specification says)"
    parser.add_argument("--copies", type=_copies, metavar="N", help=f"how many lenses to make {default}")
    parser.add_argument("--seed", type=_seed, metavar="S", help=f"which lenses {default}")
    parser.add_argument(
        "--limit", type=number, metavar="X",
        help="print which share of the copies has this spot [micrometres], or modulation (0 to 1), or a better one",
    )  # fmt: skip
    add_plot(parser)
    parser.set_defaults(run=_run, parser=parser)


def _copies(text: str) -> int:
    if not (text.isascii() and text.isdigit() and 10 <= int(text) <= MOST_COPIES):
        raise argparse.ArgumentTypeError(f"got {text}; allowed 10 to {MOST_COPIES}")
    return int(text)


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) < 2**63):
        raise argparse.ArgumentTypeError(f"got {text}; allowed whole numbers from 0")
    return int(text)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.lenstools import tolerance_chart
    from rptcam_cl.tolerances import report, tolerance

    check_picture(arguments.output, arguments.lens)
    if arguments.output is not None and arguments.output.resolve() == Path(arguments.spec).resolve():
        raise InputError(f"{arguments.output}: would overwrite the specification")
    run = tolerance(
        load(arguments.lens, arguments.catalogue), arguments.spec, copies=arguments.copies, seed=arguments.seed
    )
    if arguments.json:
        found = {} if arguments.limit is None else {"limit": arguments.limit} | run.yield_at(arguments.limit)._asdict()
        print(as_json(report(run) | ({"yield_at": found} if found else {})))
    else:
        _print(run, arguments.limit)
    if arguments.output is not None:
        write_picture(tolerance_chart(run), arguments.output)
    return 0


def _print(run: "ToleranceRun", limit: float | None) -> None:
    from rptcam_cl.tolerances import percentile_rows

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
    offenders = [
        [one.label, one.direction, one.spot_change_um, one.mtf_change, one.shift_mm] for one in run.worst_offenders()
    ]
    changes = ("worst offenders", "at", "spot [µm]", "MTF", "refocus [mm]")
    print_table(changes, offenders, "Each tolerance alone, less the design")
