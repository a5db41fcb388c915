"""Arguments of the command line: parsing with hints, and what the parsed ones of a render ask for."""

from __future__ import annotations

import argparse
import math
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

from rptcam_cl.api.options import check_together, nearest, number
from rptcam_cl.core.errors import InputError

if TYPE_CHECKING:
    from rptcam_cl.scene.scene import Scene

COMMAND = "COMMAND"  # what stands for the name of a command in the help


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `InputError` with a hint and knows no abbreviations."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)
        self._words: list[str] = []

    def near_option(self, word: str) -> str:
        """The text ``; did you mean ...?`` with the option most like a word, by all its names, or nothing."""
        options = [name.strip("-") for name in self._option_string_actions if name.startswith("--")]
        near = nearest(word.partition("=")[0].strip("-"), options)
        if not near:
            return ""
        name = "--" + near.removeprefix("; did you mean ").removesuffix("?")
        return f"; did you mean {'/'.join(self._option_string_actions[name].option_strings)}?"

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse words, which an error may have to look at."""
        self._words = [word for word in args or () if isinstance(word, str)]
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Raise `InputError` in place of printing and leaving."""
        choice = re.search(r"invalid choice: '(.*)' \(choose from (.*)\)", message)
        if choice and message.startswith(f"argument {COMMAND}: "):
            message = f"there is no command {choice[1]}"
            if choice[1].endswith((".yaml", ".yml")):
                message += f"; to render it: rptcam render {shlex.quote(choice[1])} -o OUT.png"
        if message.startswith("the following arguments are required"):
            for word in self._words:
                if word.startswith("--") and word.partition("=")[0] not in self._option_string_actions:
                    message = f"unknown argument {word}{self.near_option(word)}, and {message}"
                    break
        hint = nearest(choice[1], re.findall(r"[\w-]+", choice[2])) if choice else ""
        raise InputError(f"{self.prog}: {message}{hint}; see {self.prog} --help")

    def add_commands(self, dest: str) -> Commands:
        """Let the words of this parser be a command; without one it shows its help, as an error."""
        self.set_defaults(run=run_nothing, parser=self)
        return self.add_subparsers(title="commands", metavar=COMMAND, dest=dest)


def run_nothing(arguments: argparse.Namespace) -> int:
    """Print the help of a command that has commands of its own, as an error."""
    arguments.parser.print_help(sys.stderr)
    return InputError.exit_code


Commands: TypeAlias = "argparse._SubParsersAction[Parser]"
"""What a command adds its parser to."""


def add_command(
    commands: Commands, name: str, text: str, run: Callable[[argparse.Namespace], int], description: str = ""
) -> Parser:
    """Add a command by its line in the list of commands; its own help begins with that as a sentence by default."""
    parser = commands.add_parser(name, help=text, description=description or f"{text[0].upper()}{text[1:]}.")
    parser.set_defaults(run=run, parser=parser)
    return parser


port = number(int, 0, 2**16 - 1, "0 to 65535; 0 takes one that is free")
finite = number(float, -sys.float_info.max, sys.float_info.max, "a finite number")
positive = number(float, math.nextafter(0.0, 1.0), math.nextafter(math.inf, 0.0), "a finite number above 0")


def point(text: str) -> tuple[float, float]:
    """Place ``x,y`` in the picture in fractions of its width and height, from the left and from the top."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        x, y = -1.0, -1.0
    if not (0.0 <= x <= 1.0 and 0.0 <= y <= 1.0):
        raise argparse.ArgumentTypeError(f"got {text}; allowed x,y in 0..1")
    return x, y


def focus_method(text: str) -> str:
    """Name of a method of autofocus."""
    from rptcam_cl.scene.lens_settings import METHODS

    return _one_of(METHODS, text)


def focus_policy(text: str) -> str:
    """Which of several zones decides."""
    from rptcam_cl.scene.lens_settings import POLICIES

    return _one_of(POLICIES, text)


def _one_of(names: Sequence[str], text: str) -> str:
    from rptcam_cl.scene.base import near_name

    if text not in names:
        raise argparse.ArgumentTypeError(f"got {text}{near_name(text, names)}; allowed {', '.join(names)}")
    return text


def add_device(parser: argparse.ArgumentParser) -> None:
    """Add the choice of the device that a scene is rendered on."""
    parser.add_argument(
        "--device", metavar="SPEC",
        help="an index as 0:0, a part of a name, cpu, gpu or auto (default: $RPTCAM_DEVICE, $PYOPENCL_CTX, auto)",
    )  # fmt: skip


# What the parsed arguments of ``rptcam render`` ask for: layers, devices, files, and the options of the render.

RAYS = ("ray_origin", "ray_direction")


def is_part(arguments: argparse.Namespace) -> bool:
    """Whether a part is rendered in place of the whole."""
    return arguments.part is not None or arguments.samples is not None


def files_to_write(arguments: argparse.Namespace) -> list[Path]:
    """The pictures and the raw files."""
    return [*arguments.outputs, *arguments.raws]


def names_of(paths: Sequence[Path]) -> str:
    """Names of files in a message."""
    return ", ".join(map(str, paths))


def check_different(paths: Sequence[Path], flags: str) -> None:
    """Raise `InputError` if a file would be written twice."""
    if len({path.resolve() for path in paths}) < len(paths):
        raise InputError(f"{flags}: the same file twice")


def checkpoint_of(arguments: argparse.Namespace) -> Path:
    """Where the state of the render is kept: beside the first output."""
    from rptcam_cl.rendering.checkpoint import SUFFIX

    first: Path = arguments.outputs[0]
    return first.with_suffix(SUFFIX)


def layers_of_outputs(arguments: argparse.Namespace) -> list[str] | None:
    """The layers that outputs have: those requested, none where no output could hold the scene's, else the scene's."""
    from rptcam_cl.imaging.writers import holds_layers

    if arguments.layers is not None:
        return list(arguments.layers)
    if is_part(arguments):
        return None
    return None if any(map(holds_layers, arguments.outputs)) else []


def layers_to_record(arguments: argparse.Namespace, scene: Scene) -> list[str] | None:
    """The layers to record: those of the outputs (None: the scene's), and what the files of truth need."""
    layers = layers_of_outputs(arguments)
    if arguments.truth is None:
        return layers
    from rptcam_cl.imaging.writers import LABELS

    return list(dict.fromkeys((*(scene.render.layers if layers is None else layers), *LABELS, *RAYS)))


def device_of(arguments: argparse.Namespace) -> str | list[str] | None:
    """The devices as `rptcam_cl.render` takes them."""
    given: list[str] | None = arguments.device
    return given[0] if given is not None and len(given) == 1 else given


def render_keywords(arguments: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """The keyword arguments of `rptcam_cl.render`."""
    from rptcam_cl.api.job import RenderOptions

    given = vars(arguments)
    keywords = {option.name: given[option.name] for option in fields(RenderOptions) if option.name in given}
    return keywords | {
        "layers": layers_to_record(arguments, scene),
        "checkpoint": None if arguments.watch else checkpoint_of(arguments),
        "device": device_of(arguments),
        "numerics": arguments.stats is not None,
    }


def apply_options(arguments: argparse.Namespace, scene: Scene) -> Scene:
    """The scene with all options applied."""
    from rptcam_cl.api.job import RenderOptions

    return RenderOptions(**render_keywords(arguments, scene)).apply_to(scene)


def check_cluster_arguments(arguments: argparse.Namespace) -> bool:
    """Whether a cluster renders.

    Raises
    ------
    InputError
        For certificates without one.
    """
    if arguments.cluster is None and arguments.workers is None:
        if arguments.tls is not None:
            raise InputError("--tls: is for a cluster (allowed: with --cluster tls://…)")
        return False
    return True


def is_for_cluster(arguments: argparse.Namespace) -> bool:
    """Whether a cluster renders the picture; raises `InputError` for options that do not go with one."""
    if not check_cluster_arguments(arguments):
        return False
    flag = "--workers" if arguments.cluster is None else "--cluster"
    check_together(arguments, "cluster", flag)
    if arguments.device is not None and len(arguments.device) > 1:
        raise InputError(f"--device: each worker renders on one device (allowed: one name with {flag})")
    return True


def cluster_keywords(arguments: argparse.Namespace) -> dict[str, Any]:
    """The keyword arguments that say which cluster renders."""
    from rptcam_cl.batch.cluster import TLS

    tls: Any = arguments.tls
    if tls == "none":
        tls = False
    elif tls is not None:
        names = re.split(r"\s*,\s*", tls.strip())
        if len(names) != 3:
            raise InputError(f"--tls: three files (got {tls}; allowed: as ca.pem,cert.pem,key.pem)")
        tls = TLS(*names)
    device = arguments.device[0] if isinstance(arguments.device, list) else arguments.device
    return {
        "cluster": arguments.cluster, "workers": arguments.workers, "tls": tls, "device": device,
        "allow_mixed": arguments.allow_mixed,
    }  # fmt: skip
