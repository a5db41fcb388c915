"""``rptcam examples``, ``demo`` and ``view``: scenes that come with the package, a first picture, the viewfinder."""

import argparse
import shlex
import sys
from pathlib import Path

from rptcam_cl.cli.parser import Commands, Parser, add_device, add_overrides, port, size
from rptcam_cl.cli.render import add_arguments
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import SCENES, example_files, example_scenes

# ``rptcam examples``: lists the scenes that come with the package, and copies one to be rendered and changed.

LARGEST = 1 << 26  # bytes of one file


def add_examples(commands: Commands) -> None:
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
    parser.set_defaults(run=_run_examples, parser=parser)


def _run_examples(arguments: argparse.Namespace) -> int:
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
    from rptcam_cl.core.errors import InputError, StateError
    from rptcam_cl.core.files import read_whole, replacing

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


# ``rptcam demo``: a first picture, from scenes that come with the package.


def add_demo(commands: Commands) -> None:
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
    parser.set_defaults(run=_run_demo, parser=parser)


def _run_demo(arguments: argparse.Namespace) -> int:
    scene = example_scenes()[arguments.scene]
    picture = Path(arguments.output or f"{arguments.scene}.png")
    words = [str(scene), f"--output={picture}"]
    words += [f"--{name}={value}" for name in ("spp", "size", "device") if (value := getattr(arguments, name))]
    parser = Parser(prog=arguments.parser.prog)
    add_arguments(parser)
    parsed = parser.parse_args(words)
    code: int = parsed.run(parsed)
    if code == 0:
        print(f"the scene is {scene}; for a copy to change: rptcam examples {arguments.scene} -o .", file=sys.stderr)
    return code


# ``rptcam view``: a scene in the browser, with the dials of a camera.

_CONSENT = "--let-others-in"


def add_view(commands: Commands) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "view",
        help="open a scene in the browser, with the dials of a camera",
        description="Open a scene in the browser and hold its camera: focus, stop, lens, exposure, pose. The scene file"
        " is watched. Ctrl-C ends it. Needs rptcam_cl[view].",
    )
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")
    parser.add_argument("--port", type=port, default=0, metavar="N", help="port (default: one that is free)")
    parser.add_argument(
        "--host", default="127.0.0.1", metavar="ADDRESS",
        help=f"address to listen at (default: 127.0.0.1, this machine alone); any other needs {_CONSENT}",
    )  # fmt: skip
    parser.add_argument(
        _CONSENT, action="store_true", dest="others",
        help="let other machines in, over a connection that is not encrypted; they too need the token",
    )  # fmt: skip
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")
    parser.add_argument("--size", type=size, metavar="WxH", help="resolution in pixels")
    add_device(parser)
    add_overrides(parser)
    parser.set_defaults(run=_run_view, parser=parser)


def _run_view(arguments: argparse.Namespace) -> int:
    from rptcam_cl.device.session import means_one, open_early

    if means_one(arguments.device):
        open_early(arguments.device)
    from rptcam_cl.viewfinder.engine import Viewfinder
    from rptcam_cl.viewfinder.page import check_server, is_loopback

    check_server()
    from rptcam_cl.viewfinder.server import serve

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
