"""``rptcam merge``, ``rptcam settle`` and ``rptcam develop``: from parts, scenes and films to pictures."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli.output import print_warnings
from rptcam_cl.cli.parser import Commands, add_allow_mixed, add_device, add_overrides, positive
from rptcam_cl.cli.render import save
from rptcam_cl.core.errors import InputError

# ``rptcam merge``: parts of a render become its picture.


def add_merge(commands: Commands) -> None:
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
    add_allow_mixed(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run_merge, parser=parser)


def _run_merge(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api.interface import merge
    from rptcam_cl.core.files import check_writable
    from rptcam_cl.imaging.writers import check_output
    from rptcam_cl.rendering.checkpoint import SUFFIX

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


# ``rptcam develop``: a film that was saved becomes pictures, without rendering it anew.


def add_develop(commands: Commands) -> None:
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
        "--desqueeze", type=positive, metavar="FACTOR",
        help="make the picture of an anamorphic lens as much wider, as 1.36",
    )  # fmt: skip
    parser.add_argument(
        "--large", action="store_true",
        help="develop films of more than 67 million pixels, too, which take minutes however small their files are",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run_develop, parser=parser)


def _run_develop(arguments: argparse.Namespace) -> int:
    from rptcam_cl.imaging.formats import check_raw_output
    from rptcam_cl.imaging.image import LARGE, desqueezed, develop, read_film
    from rptcam_cl.imaging.writers import DEVELOPED_SUFFIXES, check_output

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


# ``rptcam settle``: focus, camera model and exposure of a scene are found once, for all renders that follow.


def add_settle(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "settle",
        help="find focus, camera model and exposure, and write the scene so",
        description="Write a scene whose auto focus, accuracy and exposure are found, so that parts and frames agree.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.yaml", help="scene file to write")
    add_device(parser)
    add_overrides(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run_settle, parser=parser)


def _run_settle(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api.interface import settle
    from rptcam_cl.core.errors import InputError
    from rptcam_cl.core.files import check_writable
    from rptcam_cl.scene.load import load_scene

    if arguments.output.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{arguments.output}: a scene is YAML (allowed: a name that ends in .yaml)")
    check_writable(arguments.output, [arguments.scene])
    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    found = settle(scene, arguments.output, device=arguments.device).found
    if not arguments.quiet:
        print(f"wrote {arguments.output}: {', '.join(found) or 'nothing was left to be found'}", file=sys.stderr)
    return 0
