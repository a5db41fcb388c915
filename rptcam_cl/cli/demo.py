"""``rptcam demo``: a first picture, from scenes that come with the package."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli import render
from rptcam_cl.cli.parser import Commands, Parser, add_device
from rptcam_cl.core.resources import SCENES, example_scenes


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "demo",
        help="render a first picture of a scene that comes along",
        description="Render the first picture, from a scene that comes with the package; it needs no other file.",
    )
    parser.add_argument(
        "scene", nargs="?", choices=tuple(SCENES), default=next(iter(SCENES)), metavar="SCENE",
        help="another of its scenes (rptcam examples lists them)",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", metavar="OUT", help="picture to write (default: SCENE.png in the current folder)"
    )
    parser.add_argument("--spp", metavar="N", help="samples per pixel, in place of the scene's")
    parser.add_argument("--size", metavar="WxH", help="resolution in pixels")
    add_device(parser)
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    scene = example_scenes()[arguments.scene]
    picture = Path(arguments.output or f"{arguments.scene}.png")
    words = [str(scene), f"--output={picture}"]
    words += [f"--{name}={value}" for name in ("spp", "size", "device") if (value := getattr(arguments, name))]
    parser = Parser(prog=arguments.parser.prog)
    render.add_arguments(parser)
    parsed = parser.parse_args(words)
    code: int = parsed.run(parsed)
    if code == 0:
        print(f"the scene is {scene}; for a copy to change: rptcam examples {arguments.scene} -o .", file=sys.stderr)
    return code
