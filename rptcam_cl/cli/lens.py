"""``rptcam lens``: the lenses that come with the package, and the commands that look at any lens."""

import argparse
import math
from typing import TYPE_CHECKING, Any

from rptcam_cl.cli import (
    lens_breathing,
    lens_convert,
    lens_design,
    lens_draw,
    lens_field,
    lens_ghosts,
    lens_glare,
    lens_losses,
    lens_spots,
    lens_tolerance,
    lens_trace,
    lens_wavefront,
)
from rptcam_cl.cli.lens_options import add_coating, add_lens, coated_lens, wavelength, zoomed_lens
from rptcam_cl.cli.output import as_json
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.constants import LINE_D_NM
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.optics import Lens, LensTransmission


def add_to(commands: Commands) -> None:
    """Add the command with its own commands."""
    text = "list, examine, draw, measure, convert and design lenses"
    lens = commands.add_parser("lens", help=text, description=text.capitalize() + ".")
    inner = lens.add_commands("lens_command")
    text = "list the lenses that come with the package"
    listing = inner.add_parser("list", help=text, description=text.capitalize() + ".")
    form = listing.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON, with source, focal length and f-number")
    form.add_argument("--markdown", action="store_true", help="print the same as a table in Markdown")
    listing.set_defaults(run=_list, parser=listing)
    text = "print the first-order data of a lens"
    info = inner.add_parser("info", help=text, description=text.capitalize() + ".")
    add_lens(info)
    info.add_argument(
        "--wavelength-nm", type=wavelength, metavar="W", default=LINE_D_NM,
        help="wavelength in nanometres (default: %(default)s)",
    )  # fmt: skip
    info.add_argument(
        "--transmission", choices=("ideal", "bare", "coated"),
        help="light lost in the lens: none, by bare surfaces and glass, or by coated ones (default: ideal)",
    )  # fmt: skip
    add_coating(info)
    info.add_argument("--json", action="store_true", help="print JSON")
    info.set_defaults(run=_info, parser=info)
    for command in (
        lens_draw,
        lens_spots,
        lens_wavefront,
        lens_field,
        lens_losses,
        lens_breathing,
        lens_tolerance,
        lens_ghosts,
        lens_glare,
        lens_trace,
        lens_convert,
        lens_design,
    ):
        command.add_to(inner)


def _list(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import list_lenses, load_lens

    lenses = {name: load_lens(name) for name in list_lenses()}
    if arguments.json or arguments.markdown:
        rows = [_row(name, lens) for name, lens in lenses.items()]
        print(as_json(rows) if arguments.json else _markdown(rows))
        return 0
    width = max(map(len, lenses), default=0)
    for name, lens in lenses.items():
        print(f"{name:<{width}}  {lens.name}")
    return 0


def _row(name: str, lens: "Lens") -> dict[str, Any]:
    first = lens.first_order()
    return {
        "name": name,
        "lens": lens.name,
        "focal_length_mm": first.focal_length_mm,
        "f_number": first.f_number,
        "surfaces": first.surfaces,
        "source": lens.source,
    }


def _markdown(rows: list[dict[str, Any]]) -> str:
    lines = ["| name | lens | f [mm] | f/ | surfaces | source |", "|---|---|---|---|---|---|"]
    for row in rows:
        cells = (row["name"], row["lens"], f"{row['focal_length_mm']:.4g}", f"{row['f_number']:.3g}", row["surfaces"])
        source = row["source"].replace("|", "\\|")
        lines.append(f"| `{cells[0]}` | {' | '.join(map(str, cells[1:]))} | {source} |")
    return "\n".join(lines)


def _label(key: str) -> str:
    """A key as words: ``back_focal_distance_mm`` is ``back focal distance [mm]``."""
    for unit in ("mm", "nm", "m", "degrees"):
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


def _transmission(arguments: argparse.Namespace, lens: "Lens") -> "LensTransmission":
    """The losses by the options."""
    from rptcam_cl.optics import BY_NAME, has_coatings

    name = arguments.transmission or ("ideal" if arguments.coating is None else "coated")
    if name != "coated" and arguments.coating is not None:
        raise InputError(f"--coating: has no effect with --transmission {name} (allowed only with coated)")
    if name == "coated" and not has_coatings(lens):
        raise InputError(f"--transmission: {lens.name} does not say how it is coated (give --coating, such as mgf2)")
    return BY_NAME[name]


def _info(arguments: argparse.Namespace) -> int:
    from rptcam_cl.optics import lens_info

    lens = coated_lens(arguments, zoomed_lens(arguments, arguments.wavelength_nm))
    distance = math.inf if arguments.focus_distance_m is None else 1000 * arguments.focus_distance_m
    facts = lens_info(lens, arguments.f_number, distance, arguments.wavelength_nm, _transmission(arguments, lens))
    if arguments.json:
        print(as_json(facts))
    else:
        del facts["warnings"]  # which standard error has
        if facts["film_distance_mm"] is not None and facts["image_circle_mm"] is None:
            facts["image_circle_mm"] = "without end: no rim of the lens ends it"
        print("\n".join(_lines({"name": facts["name"], "source": facts["source"]} | facts)))
    return 0
