"""``rptcam view``: a scene in the browser, with the dials of a camera."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli import parser as values
from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.errors import InputError

_CONSENT = "--let-others-in"


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "view",
        help="open a scene in the browser, with the dials of a camera",
        description="Open a scene in the browser and hold its camera: focus, stop, lens, exposure, pose. The scene file"
        " is watched. Ctrl-C ends it. Needs rptcam_cl[view].",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument("--port", type=values.port, default=0, metavar="N", help="port (default: one that is free)")
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS",
        help=f"address to listen at (default: 127.0.0.1, this machine alone); any other needs {_CONSENT}",
    )  # fmt: skip
    parser.add_argument(
        _CONSENT, action="store_true", dest="others",
        help="let other machines in, over a connection that is not encrypted; they too need the token",
    )  # fmt: skip
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")
    parser.add_argument("--size", type=values.size, metavar="WxH", help="resolution in pixels")
    values.add_device(parser)
    values.add_overrides(parser)
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.device import means_one, open_early

    if means_one(arguments.device):
        open_early(arguments.device)
    from rptcam_cl.viewfinder import Viewfinder, check_server, is_loopback, serve

    check_server()
    if not (is_loopback(arguments.host) or arguments.others):
        raise InputError(
            f"--host {arguments.host}: lets other machines in, over a connection that is not encrypted (allowed: with"
            f" {_CONSENT}, or 127.0.0.1)"
        )
    finder = Viewfinder(arguments.scene, arguments.overrides, device=arguments.device, size=arguments.size)
    for warning in finder.warnings:
        print(f"warning: {warning}", file=sys.stderr)

    def announce(address: str) -> None:
        print(f"{arguments.scene} is at {address}\nCtrl-C ends it.", flush=True)

    serve(finder, host=arguments.host, port=arguments.port, browse=not arguments.no_browser, announce=announce)
    return 0
