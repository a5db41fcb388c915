"""``rptcam convert``, scenes of other renderers, and ``new``, a first scene round a model."""

import argparse
import shlex
import sys
from pathlib import Path

from rptcam_cl.cli.parser import Commands, add_missing, positive, size
from rptcam_cl.core.errors import InputError

# ``rptcam convert``: a scene file of another renderer becomes one of ours.

SOURCES = (".pbrt", ".pbrt.gz")
TARGETS = (".yaml", ".yml")


def add_convert(commands: Commands) -> None:
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
    parser.set_defaults(run=_run_convert, parser=parser)


def _check_names(source: Path, target: Path) -> None:
    from rptcam_cl.core.files import check_writable

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


def _run_convert(arguments: argparse.Namespace) -> int:
    from rptcam_cl.exchange.pbrt.convert import convert_scene

    _check_names(arguments.source, arguments.target)
    done = convert_scene(arguments.source, arguments.target, missing=arguments.missing)
    warnings = done.write(arguments.target)
    if not arguments.quiet:
        for message in (*done.report, *(f"warning: {text}" for text in warnings)):
            print(message, file=sys.stderr)
        count = len(done.scene.get("objects", ()))
        print(f"wrote {arguments.target}: {count} object{'' if count == 1 else 's'}", file=sys.stderr)
    return 0


# ``rptcam new``: writes a starting scene round a model.

SUFFIXES = (".yaml", ".yml")


def add_new(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "new",
        help="write a starting scene: your model, your light, your lens",
        description="Write a scene that is framed, lit, focused and exposed, to be changed from there. Files that lie "
        "elsewhere are copied beside it, because a scene reads its own folder only. Without a model it shows three "
        "balls, without a picture of light a studio. Cameras and lamps of a glTF file count.",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE.yaml", help="scene file to write")
    parser.add_argument("--model", type=Path, metavar="FILE", help="mesh to show: .glb, .gltf, .obj, .ply or .stl")
    parser.add_argument("--hdri", type=Path, metavar="FILE", help="picture of light from all around: .hdr or .exr")
    parser.add_argument(
        "--lens", metavar="NAME", help="lens of the library (rptcam lens list) or a lens file (default: dgauss-50mm)"
    )
    parser.add_argument("--size", type=size, default=(960, 640), metavar="WxH", help="resolution (default: 960x640)")
    parser.add_argument(
        "--up", choices=("x", "y", "z"), help="axis of the model that points upwards (default: z for .stl, else y)"
    )
    parser.add_argument(
        "--metres-per-unit", type=positive, default=1.0, metavar="M",
        help="length of a unit of the model [m]: 0.001 where it counts millimetres (default: 1)",
    )  # fmt: skip
    parser.add_argument("--reframe", action="store_true", help="frame the model, even if its file has a camera")
    parser.set_defaults(run=_run_new, parser=parser)


def _run_new(arguments: argparse.Namespace) -> int:
    from rptcam_cl.core.errors import InputError
    from rptcam_cl.core.files import check_writable, replacing
    from rptcam_cl.exchange.starting import Wishes, starting_scene
    from rptcam_cl.scene.load import load_scene, scene_text

    target: Path = arguments.scene
    if target.suffix.lower() not in SUFFIXES:
        got, hint = target.suffix or "no suffix", ""
        if target.is_file() and arguments.model is None:
            words = ["rptcam", "new", f"{target.stem}.yaml", "--model", str(target)]
            hint = f"; for a scene of that model: {shlex.join(words)}"
        raise InputError(f"{target}: a scene file is YAML (got {got}; allowed: {', '.join(SUFFIXES)}){hint}")
    if target.exists():
        raise InputError(f"{target}: is there already; choose another name, or remove it first")
    check_writable(target)
    start = starting_scene(
        Wishes(
            arguments.model, arguments.hdri, arguments.lens, arguments.size, arguments.up, arguments.metres_per_unit,
            arguments.reframe,
        ),
        target.parent,
    )  # fmt: skip
    copied = start.copies.write()
    scene = load_scene(start.scene, base_dir=target.parent, missing="grey")
    with replacing(target) as temporary:
        temporary.write_text(scene_text(start.scene, (HEAD,)), "utf-8")
    for message in (*start.report, *(f"copied {path.name}" for path in copied), *_warned(scene.warnings, start.report)):
        print(message, file=sys.stderr)
    named, picture = shlex.quote(str(target)), shlex.quote(f"{target.stem}.png")
    print(f"wrote {target}; next: rptcam render {named} -o {picture}, or rptcam view {named}", file=sys.stderr)
    return 0


def _warned(warnings: tuple[str, ...], known: list[str]) -> list[str]:
    return [f"warning: {text}" for text in warnings if text not in known]


HEAD = "A starting scene by rptcam new: change what you like; docs/scene.md has every key."
