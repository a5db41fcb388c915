"""``rptcam develop``: a film that was saved becomes pictures, without rendering it anew."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.errors import InputError


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "develop",
        help="make pictures of a film that was saved",
        description="Make pictures of a linear film that was saved, with other settings of the section picture.",
    )
    parser.add_argument("film", type=Path, metavar="FILM", help="film that render wrote: .exr, .npz or .npy")
    parser.add_argument(
        "-o", "--output", action="append", required=True, type=Path, metavar="OUT", dest="outputs",
        help="picture to write, format by suffix: .png, .jpg or .tif; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--raw", action="append", default=[], type=Path, metavar="OUT", dest="raws",
        help="raw file of the sensor that the film was rendered for: .dng, .tif or .npy; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--set", action="append", default=[], metavar="picture.key=value", dest="overrides",
        help="replace a setting that the film was rendered with, as picture.tone=agx; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--desqueeze", type=values.positive, metavar="FACTOR",
        help="make the picture of an anamorphic lens as much wider, as 1.36",
    )  # fmt: skip
    parser.add_argument(
        "--large", action="store_true",
        help="develop films of more than 67 million pixels, too, which take minutes however small their files are",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.imaging import (
        DEVELOPED_SUFFIXES,
        LARGE,
        check_output,
        check_raw_output,
        desqueezed,
        develop,
        read_film,
    )

    for output in arguments.outputs:
        if output.suffix.lower() not in DEVELOPED_SUFFIXES:
            got = output.suffix or "no suffix"
            raise InputError(f"{output}: is no developed picture (got {got}; allowed {' '.join(DEVELOPED_SUFFIXES)})")
        check_output(output, [arguments.film])
    for raw in arguments.raws:
        check_raw_output(raw, [arguments.film])
    written = [*arguments.outputs, *arguments.raws]
    if len({path.resolve() for path in written}) < len(written):
        raise InputError("-o, --raw: the same file twice")
    image = develop(read_film(arguments.film, most_pixels=None if arguments.large else LARGE), arguments.overrides)
    if arguments.desqueeze is not None:
        if arguments.raws:
            raise InputError("--raw: is what the sensor counts, as it is squeezed (allowed: without --desqueeze)")
        image = desqueezed(image, arguments.desqueeze)
    raws = [(image.raw(), path) for path in arguments.raws]
    for output in arguments.outputs:
        image.save(output)
    for numbers, path in raws:
        numbers.save(path)
    if not arguments.quiet:
        print(f"wrote {', '.join(map(str, written))}: {image.width} x {image.height}", file=sys.stderr)
    return 0
