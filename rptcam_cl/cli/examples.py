"""``rptcam examples``: lists the scenes that come with the package, and copies one to be rendered and changed."""

import argparse
import shlex
import sys
from pathlib import Path

from rptcam_cl.cli.parser import Commands
from rptcam_cl.core.resources import SCENES, example_files, example_scenes

LARGEST = 1 << 26  # bytes of one file


def add_to(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "examples",
        help="list the scenes that come along, or copy one to a folder",
        description="List the scenes that come with the package. With a name and -o, copy that scene and the files it "
        "reads to a folder, where it can be rendered and changed.",
    )
    parser.add_argument("scene", nargs="?", choices=tuple(SCENES), metavar="NAME", help="a scene of the list")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder to copy to, made if need be (default: the current one)"
    )
    parser.set_defaults(run=_run, parser=parser)


def _run(arguments: argparse.Namespace) -> int:
    from rptcam_cl.core.errors import InputError

    if arguments.scene is None:
        if arguments.output is not None:
            raise InputError(
                "rptcam examples: -o copies one scene; name it, as rptcam examples first_light -o my_scene"
            )
        _list()
        return 0
    scene = _copied(arguments.scene, arguments.output or Path())
    command = shlex.join(["rptcam", "render", str(scene), "-o", f"{arguments.scene}.png"])
    print(f"wrote {scene}; render it with: {command}", file=sys.stderr)
    return 0


def _list() -> None:
    width = max(map(len, SCENES))
    for name, path in example_scenes().items():
        print(f"{name:{width}}  {_summary(path)}")


def _summary(path: Path) -> str:
    """Return the first sentence of the comment at the head of a scene."""
    lines = []
    for line in path.read_text("utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return " ".join(lines).partition(". ")[0].rstrip(".")


def _copied(name: str, folder: Path) -> Path:
    """Copy the files of a scene to a folder and return its scene file there.

    Raises
    ------
    InputError
        When one of them would replace a file of other content; none is written then.
    """
    from rptcam_cl.core.atomic import replacing
    from rptcam_cl.core.errors import InputError, StateError
    from rptcam_cl.core.references import read_whole

    files = {folder / path.name: read_whole(path, LARGEST) for path in example_files(name)}
    for target, content in files.items():
        if target.exists() and not (target.is_file() and read_whole(target, 2 * LARGEST) == content):
            raise InputError(f"{target}: is there already and differs; choose another folder with -o, or move it away")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        why = "is a file, not a folder" if folder.is_file() else f"cannot be made ({problem.strerror})"
        raise StateError(f"{folder}: {why}") from None
    for target, content in reversed(files.items()):  # the scene file last
        with replacing(target) as temporary:
            temporary.write_bytes(content)
    return next(iter(files))
