"""``rptcam lens``: the lenses that come with the package, and the first-order data of any lens."""

import argparse
import math
import sys
from typing import Any

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.output import as_json
from rptcam_cl.cli.parser import Commands

_D_LINE = 587.5618  # [nm], of helium, where n_d is measured


def add_to(commands: Commands) -> None:
    """Add the command with its own commands ``list`` and ``info``."""
    text = "list lenses, and tell what a lens is"
    lens = commands.add_parser("lens", help=text, description=text.capitalize() + ".")
    inner = lens.add_subparsers(title="commands", metavar="COMMAND", dest="lens_command", required=True)
    listing = inner.add_parser("list", help="list the lenses that come with the package")
    listing.set_defaults(run=_list, parser=listing)
    info = inner.add_parser("info", help="print the first-order data of a lens")
    info.add_argument("lens", metavar="LENS", help="a name from the list, or a lens file")
    info.add_argument("--f-number", type=values.positive, metavar="N", help="stop down (default: as in the file)")
    info.add_argument(
        "--focus-distance-m", type=values.positive, metavar="D",
        help="distance from the object to the film in metres (default: infinity)",
    )  # fmt: skip
    info.add_argument(
        "--wavelength-nm", type=values.positive, metavar="W", default=_D_LINE,
        help="wavelength in nanometres (default: %(default)s)",
    )  # fmt: skip
    info.add_argument("--json", action="store_true", help="print JSON")
    info.set_defaults(run=_info, parser=info)


def _list(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import list_lenses, load_lens

    names = list_lenses()
    width = max(map(len, names), default=0)
    for name in names:
        print(f"{name:<{width}}  {load_lens(name).name}")
    return 0


def _label(key: str) -> str:
    """A key as words: ``back_focal_distance_mm`` is ``back focal distance [mm]``."""
    for unit in ("mm", "nm", "m"):
        if key.endswith(f"_{unit}"):
            return f"{key.removesuffix(f'_{unit}').replace('_', ' ')} [{unit}]"
    return key.replace("_", " ")


def _lines(facts: dict[str, Any], indent: str = "") -> list[str]:
    lines = []
    for key, value in facts.items():
        label = f"{indent}{_label(key)}"
        if isinstance(value, dict):
            lines += [label, *_lines(value, indent + "  ")]
        else:
            shown = f"{value:.6g}" if isinstance(value, float) and math.isfinite(value) else value
            lines.append(f"{label:<32}{'-' if shown is None else shown}")
    return lines


def _info(arguments: argparse.Namespace) -> int:
    from rptcam_cl.cli.lens_facts import lens_facts
    from rptcam_cl.optics import load_lens

    lens = load_lens(arguments.lens)
    for warning in lens.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    facts = lens_facts(lens, arguments.f_number, arguments.focus_distance_m, arguments.wavelength_nm)
    print(as_json(facts) if arguments.json else "\n".join(_lines(facts)))
    return 0
