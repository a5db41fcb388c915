"""``rptcam convert``: a scene file of another renderer becomes one of ours."""

import argparse
import sys
from pathlib import Path

from rptcam_cl.cli.parser import Commands, add_missing
from rptcam_cl.core.errors import InputError

SOURCES = (".pbrt", ".pbrt.gz")
TARGETS = (".yaml", ".yml")


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "convert",
        help="make a scene file from one of pbrt",
        description="Make a scene file from one of pbrt-v2, v3 or v4. What is ignored or approximated is listed; "
        "meshes and pictures go to folders beside the scene file.",
    )
    parser.add_argument("source", type=Path, metavar="SCENE.pbrt", help="scene file of pbrt-v2, v3 or v4")
    parser.add_argument("target", type=Path, metavar="SCENE.yaml", help="scene file to write")
    parser.add_argument("--quiet", action="store_true", help="print only errors")
    add_missing(parser)
    parser.set_defaults(run=_run, parser=parser)


def _check_names(source: Path, target: Path) -> None:
    from rptcam_cl.core.atomic import check_writable

    if not source.name.lower().endswith(SOURCES):
        hint = " (put a mesh into a scene as an object of shape mesh)" if source.suffix.lower() in _MESHES else ""
        raise InputError(
            f"{source}: only scenes of pbrt can be converted{hint} (got {source.suffix or 'no suffix'}; "
            f"allowed: {', '.join(SOURCES)})"
        )
    if target.suffix.lower() not in TARGETS:
        got = target.suffix or "no suffix"
        raise InputError(f"{target}: a scene file is YAML (got {got}; allowed: {', '.join(TARGETS)})")
    check_writable(target, [source])


_MESHES = (".ply", ".obj", ".stl", ".gltf", ".glb")


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.importers.pbrt import convert_scene

    _check_names(arguments.source, arguments.target)
    done = convert_scene(arguments.source, arguments.target, missing=arguments.missing)
    warnings = done.write(arguments.target)
    if not arguments.quiet:
        for message in (*done.report, *(f"warning: {text}" for text in warnings)):
            print(message, file=sys.stderr)
        count = len(done.scene.get("objects", ()))
        print(f"wrote {arguments.target}: {count} object{'' if count == 1 else 's'}", file=sys.stderr)
    return 0
