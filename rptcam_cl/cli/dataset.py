"""``rptcam dataset``: many pictures of a scene whose keys are drawn from distributions, with their exact cameras."""

import argparse
import re
import sys
from pathlib import Path

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.interrupt import ENDS_LATER, INTERRUPTED, stop_on_interrupt
from rptcam_cl.cli.output import print_warnings
from rptcam_cl.cli.parser import Commands


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "dataset",
        help="render many pictures whose keys are drawn from distributions",
        description="Render the frames of a dataset, each with its exact camera. Frames that are there are kept.",
    )
    parser.add_argument("specification", type=Path, metavar="SPEC", help="specification (YAML); see docs/datasets.md")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FOLDER", help="folder to write to")
    parser.add_argument("-n", type=_count, metavar="N", dest="count", help="frames, in place of the specification's")
    parser.add_argument(
        "--frames", type=indices, metavar="FIRST[-LAST[:STEP]]",
        help="make these frames alone, which count from 0, as 517 or 0-99",
    )  # fmt: skip
    parser.add_argument(
        "--shard", type=_count, metavar="N", help="write shards of N frames, TAR files as WebDataset reads them"
    )
    values.add_device(parser)
    values.add_overrides(parser)
    values.add_allow_mixed(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run, parser=parser)


def _count(text: str) -> int:
    if not re.fullmatch(r"\d{1,9}", text, re.ASCII) or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed a whole number, 1 or more")
    return int(text)


def indices(text: str) -> range:
    """Frames of ``517``, ``0-99`` or ``0-99:2``."""
    match = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?(?::(\d{1,9}))?", text, re.ASCII)
    first = int(match[1]) if match else 1
    last = int(match[2] or first) if match else 0
    step = int(match[3] or 1) if match else 1
    if first > last or step < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed FIRST[-LAST[:STEP]], as 517 or 0-99")
    return range(first, last + 1, step)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.datasets import dataset, read_specification

    wanted = read_specification(arguments.specification, arguments.overrides, frames=arguments.count)
    print_warnings(wanted.scene.warnings)
    frames = dataset(
        wanted, arguments.output, only=arguments.frames, shard=arguments.shard, device=arguments.device,
        allow_mixed=arguments.allow_mixed,
    )  # fmt: skip
    kept = rendered = 0
    with stop_on_interrupt(ENDS_LATER) as stop:
        for frame in frames:
            kept, rendered = kept + frame.kept, rendered + (not frame.kept)
            if not arguments.quiet and not frame.kept:
                drawn = ", ".join(f"{key}={_shown(value)}" for key, value in frame.values.items())
                print(f"frame {frame.index}: {drawn}", file=sys.stderr)
            if stop.is_set():
                print("interrupted: the same command goes on with the rest", file=sys.stderr)
                return INTERRUPTED
    if not arguments.quiet:
        print(f"wrote {arguments.output}: {rendered} frames rendered, {kept} kept", file=sys.stderr)
    return 0


def _shown(value: object) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_shown, value)) + "]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
