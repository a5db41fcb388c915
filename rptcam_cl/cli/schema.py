"""``rptcam schema``: the JSON schema of scene or lens files, for editors that complete and check."""

import argparse

from rptcam_cl.cli.parser import Commands


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "schema",
        help="print the JSON schema of scene or lens files",
        description="Print the JSON schema of scene files, for editors that complete and check.",
    )
    parser.add_argument("--lens", action="store_true", help="of lens files instead")
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    if arguments.lens:
        from rptcam_cl.optics import lens_json_schema_text

        print(lens_json_schema_text(), end="")
        return 0
    from rptcam_cl.scene import scene_json_schema_text

    print(scene_json_schema_text(), end="")
    return 0
