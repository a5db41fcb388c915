"""``rptcam devices``: the OpenCL devices that a render may run on."""

import argparse
from typing import Any

from rptcam_cl.cli.output import as_bytes, as_json
from rptcam_cl.cli.parser import Commands


def add_to(commands: Commands) -> None:
    """Add the command."""
    text = "list the OpenCL devices"
    parser = commands.add_parser("devices", help=text, description=text.capitalize() + "; * marks the default.")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run, parser=parser)


def _line(device: dict[str, Any]) -> str:
    mark = "*" if device["default"] else " "
    precision = "fp64" if device["fp64"] else "fp32 only"
    facts = f"{device['compute_units']} compute units, {as_bytes(device['memory_bytes'])}, {precision}"
    barred = f"\n{'':8}cannot be used: {device['problem']}" if device["problem"] else ""
    return f"{mark} {device['id']:<5} {device['type']}  {device['name']} ({device['platform']}; {facts}){barred}"


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.api import devices

    found = devices()
    print(as_json(found) if arguments.json else "\n".join(map(_line, found)))
    return 0
