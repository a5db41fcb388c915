"""``rptcam settle``: focus, camera model and exposure of a scene are found once, for all renders that follow."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.output import print_warnings
from rptcam_cl.cli.parser import Commands


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "settle",
        help="find focus, camera model and exposure, and write the scene so",
        description="Write a scene whose auto focus, accuracy and exposure are found, so that parts and frames agree.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.yaml", help="scene file to write")
    values.add_device(parser)
    values.add_overrides(parser)
    parser.add_argument("--quiet", action="store_true", help="print only warnings and errors")
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api import load_scene, settle
    from rptcam_cl.core.atomic import check_writable
    from rptcam_cl.core.errors import InputError

    if arguments.output.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"{arguments.output}: a scene is YAML (allowed: a name that ends in .yaml)")
    check_writable(arguments.output, [arguments.scene])
    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    found = settle(scene, arguments.output, device=arguments.device).found
    if not arguments.quiet:
        print(f"wrote {arguments.output}: {', '.join(found) or 'nothing was left to be found'}", file=sys.stderr)
    return 0
