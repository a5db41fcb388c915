"""``rptcam merge``: parts of a render become its picture."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.parser import Commands
from rptcam_cl.cli.saving import save
from rptcam_cl.core.errors import InputError


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "merge",
        help="make the picture of a render that was made in parts",
        description="Put together the parts that `rptcam render --part` and --samples made, anywhere.",
    )
    parser.add_argument("parts", type=Path, nargs="+", metavar="PART", help="files of the parts: .rpck")
    parser.add_argument(
        "-o", "--output", action="append", required=True, type=Path, metavar="OUT", dest="outputs",
        help="picture to write, as of render; or the whole as .rpck, for render --resume; may be repeated",
    )  # fmt: skip
    values.add_allow_mixed(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api import merge
    from rptcam_cl.core.atomic import check_writable
    from rptcam_cl.imaging import check_output
    from rptcam_cl.rendering import SUFFIX

    outputs: list[Path] = arguments.outputs
    states = [output for output in outputs if output.suffix == SUFFIX]
    pictures = [output for output in outputs if output.suffix != SUFFIX]
    if len(states) > 1:
        raise InputError(f"-o: two files {SUFFIX} (allowed: one)")
    if len({output.resolve() for output in outputs}) < len(outputs):
        raise InputError("-o: the same file twice")
    for output in states:
        check_writable(output, arguments.parts)
    for output in pictures:
        check_output(output, arguments.parts)
    image = merge(arguments.parts, checkpoint=states[0] if states else None, allow_mixed=arguments.allow_mixed)
    if pictures:
        save(image, argparse.Namespace(outputs=pictures, raws=[], stats=None))
    if not arguments.quiet:
        names, count = ", ".join(map(str, outputs)), len(arguments.parts)
        made = f"{image.width} x {image.height}, {image.stats['spp']} spp, of {count} part{'s' * (count > 1)}"
        print(f"wrote {names}: {made}", file=sys.stderr)
        if "parts" in image.metadata:
            print(f"devices: {image.metadata['device']}; they may differ in the last bit", file=sys.stderr)
    return 0
