"""Arguments of the command line: parsing with hints, and values with their ranges."""

import argparse
import difflib
import math
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn, Protocol, TypeVar

from rptcam_cl.core.errors import InputError

Number = TypeVar("Number", int, float)


def nearest(word: str, known: Iterable[str], prefix: str = "") -> str:
    """The text ``; did you mean ...?`` with the known word most like ``word``, after a prefix, or nothing."""
    matches = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {prefix}{matches[0]}?" if matches else ""


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

    def add_commands(self, dest: str) -> "Commands":
        """Let the words of this parser be a command; without one it shows its help, as an error."""
        self.set_defaults(run=_without_command, parser=self)
        return self.add_subparsers(title="commands", metavar=COMMAND, dest=dest)


def _without_command(arguments: argparse.Namespace) -> int:
    arguments.parser.print_help(sys.stderr)
    return InputError.exit_code


class Commands(Protocol):
    """What a command adds itself to."""

    def add_parser(self, name: str, *, help: str, description: str) -> Parser:
        """Parser of one more command."""


def _number(kind: Callable[[str], Number], lowest: float, highest: float, allowed: str) -> Callable[[str], Number]:
    def parse(text: str) -> Number:
        try:
            value = kind(text)
        except ValueError:
            value = kind("-1")  # below every range here
        if not lowest <= value <= highest:
            raise argparse.ArgumentTypeError(f"got {text}; allowed {allowed}")
        return value

    return parse


def _whole(text: str) -> int:
    """A whole number, as ``1000000`` or ``1e6``."""
    try:
        return int(text)
    except ValueError:
        if len(text) < 20 and (number := float(text)).is_integer():
            return int(number)
        raise


_SMALLEST = math.nextafter(0.0, 1.0)
_LARGEST = math.nextafter(math.inf, 0.0)

spp = _number(_whole, 1, 2**32 - 1, "a whole number from 1 to 4294967295")  # sample numbers have 32 bits on the device
seed = _number(int, 0, 2**64 - 1, "a whole number from 0 to 2^64 - 1")
port = _number(int, 0, 2**16 - 1, "0 to 65535; 0 takes one that is free")
positive = _number(float, _SMALLEST, _LARGEST, "a finite number above 0")

_AMOUNT = r"([0-9.]+(?:e[+-]?\d+)?)\s*"
_DURATION = rf"(?:{_AMOUNT}h\s*)?(?:{_AMOUNT}(?:min|m)\s*)?(?:{_AMOUNT}s)?|{_AMOUNT}"
_UNITS = {1: 3600.0, 2: 60.0, 3: 1.0, 4: 1.0}  # of its groups


def share(text: str) -> float:
    """Share between 0 and 1 of ``0.02`` or ``2%``."""
    number, per_cent = re.fullmatch(r"(.*?)\s*(%?)", text.strip(), re.DOTALL).groups()  # type: ignore[union-attr]
    try:
        found = float(number) / (100.0 if per_cent else 1.0)
    except ValueError:
        found = -1.0
    if not 0 < found < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed a number between 0 and 1, as 0.02 or 2%")
    return found


def duration(text: str) -> float:
    """Time of ``60``, ``60s``, ``2min``, ``1h`` or ``1m30s`` [s]."""
    match = re.fullmatch(_DURATION, text.strip(), re.IGNORECASE)
    try:
        found = sum(unit * float(match[group] or 0) for group, unit in _UNITS.items()) if match else -1.0
    except ValueError:
        found = -1.0
    if not 0 < found <= 1e9:
        raise argparse.ArgumentTypeError(f"got {text}; allowed a time above 0, as 60s, 2min, 1h or 1m30s")
    return found


def sample_range(text: str) -> tuple[int, int]:
    """First sample and the one that it ends before of ``FIRST:END``."""
    match = re.fullmatch(r"(\d{1,10}):(\d{1,10})", text, re.ASCII)
    first, end = (int(match[1]), int(match[2])) if match else (0, 0)
    if not first < end < 2**32:
        raise argparse.ArgumentTypeError(f"got {text}; allowed FIRST:END, as 0:64 and then 64:128")
    return first, end


def part(text: str) -> str:
    """Part ``K/N`` of a film."""
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text, re.ASCII)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise argparse.ArgumentTypeError(f"got {text}; allowed K/N, from 1/8 to 8/8 for eight parts")
    return text


def size(text: str) -> tuple[int, int]:
    """Width and height of ``WxH`` [pixels]."""
    match = re.fullmatch(r"(\d{1,9})[xX×](\d{1,9})", text, re.ASCII)
    width, height = (int(match[1]), int(match[2])) if match else (0, 0)
    if width < 1 or height < 1:
        raise argparse.ArgumentTypeError(f"got {text}; allowed WxH in pixels, as 640x360")
    return width, height


def crop(text: str) -> tuple[float, float, float, float]:
    """Window ``x0,x1,y0,y1`` of the film in fractions of its width and height, from the left and from the top."""
    try:
        x0, x1, y0, y1 = (float(part) for part in text.split(","))
    except ValueError:
        x0, x1, y0, y1 = 1.0, 0.0, 1.0, 0.0
    if not (0.0 <= x0 < x1 <= 1.0 and 0.0 <= y0 < y1 <= 1.0):
        raise argparse.ArgumentTypeError(f"got {text}; allowed x0,x1,y0,y1 in 0..1 with x0 < x1 and y0 < y1")
    return x0, x1, y0, y1


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


def add_devices(parser: argparse.ArgumentParser) -> None:
    """Add the choice of the devices that share a render."""
    parser.add_argument(
        "--device", action="append", metavar="SPEC", dest="devices",
        help="an index as 0:0, a part of a name, cpu, gpu, auto or all (default: $RPTCAM_DEVICE, $PYOPENCL_CTX, auto);"
        " may be repeated for several devices that share the render",
    )  # fmt: skip
    parser.add_argument(
        "--split", metavar="SPEC=SHARE,...",
        help="share of each device, as 0:0=0.7,1:0=0.3 (default: by speed, which is measured)",
    )  # fmt: skip


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add changes to the scene file."""
    parser.add_argument(
        "--set", action="append", default=[], metavar="key.path=value", dest="overrides",
        help="replace a value of the scene file, as camera.f_number=4; may be repeated",
    )  # fmt: skip


def add_missing(parser: argparse.ArgumentParser) -> None:
    """Add the option for missing files."""
    parser.add_argument(
        "--missing", choices=("error", "grey"), default="error",
        help="files that are not there: an error that names them all (default), or grey in place of pictures, and"
        " meshes left out, each with a warning",
    )  # fmt: skip


def add_allow_mixed(parser: argparse.ArgumentParser) -> None:
    """Add whether what other code has made is joined with what this one makes."""
    parser.add_argument(
        "--allow-mixed", action="store_true",
        help="join what other code, another numpy or another driver has made, too, and name all in the metadata",
    )  # fmt: skip


def layers(text: str) -> tuple[str, ...]:
    """Names of auxiliary layers in ``a,b,c``; ``all`` stands for every one."""
    from rptcam_cl.scene.film import LAYER_NAMES

    names = tuple(name.strip() for name in text.split(","))
    if names == ("all",):
        return LAYER_NAMES
    for index, name in enumerate(names):
        if name not in LAYER_NAMES:
            hint = nearest(name, LAYER_NAMES)
            raise argparse.ArgumentTypeError(
                f"got {name or f'a comma too many in {text}'}{hint}; allowed all, {', '.join(LAYER_NAMES)}"
            )
        if name in names[:index]:
            raise argparse.ArgumentTypeError(f"{name} twice; allowed each layer once")
    return names


# Lists of values with an ellipsis: ``2,2.8,…,22`` goes on as it began, in stops for f-numbers, in equal steps else.

ELLIPSES = ("…", "...")
MOST_VALUES = 10_000
ON_THE_WAY = 1e-6  # of a step, by which the last value may miss it

# As engraved on lenses and shown by cameras: full, half and third stops.
F_NUMBERS = (
    (0.5, 0.7, 1, 1.4, 2, 2.8, 4, 5.6, 8, 11, 16, 22, 32, 45, 64, 90, 128),
    (1, 1.2, 1.4, 1.7, 2, 2.4, 2.8, 3.3, 4, 4.8, 5.6, 6.7, 8, 9.5, 11, 13, 16, 19, 22, 27, 32, 38, 45, 54, 64),
    (
        1, 1.1, 1.2, 1.4, 1.6, 1.8, 2, 2.2, 2.5, 2.8, 3.2, 3.5, 4, 4.5, 5, 5.6, 6.3, 7.1, 8, 9, 10, 11, 13, 14, 16, 18,
        20, 22, 25, 29, 32, 36, 40, 45, 51, 57, 64,
    ),
)  # fmt: skip


def expanded(key: str, values: list[Any], where: str) -> list[Any]:
    """Return the values with those in place of an ellipsis.

    Raises
    ------
    InputError
        When it does not stand between numbers that make a series.
    """
    places = [k for k, value in enumerate(values) if value in ELLIPSES]
    if not places:
        return values
    place = places[0]
    before, after = values[:place], values[place + 1 :]
    if not (before and after and all(_is_number(value) for value in [*before, *after])):
        raise InputError(f"{where}: the ellipsis has to stand between numbers (as 2,2.8,…,22)")
    is_stops = key.rpartition(".")[2] == "f_number"
    middle = (_stops if is_stops else _steps)(before[-2:], after[0], where)
    return [*before, *middle, *after]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _stops(before: list[float], last: float, where: str) -> list[float]:
    """Return the f-numbers between the last one before an ellipsis and the one behind it, of a scale with all."""
    for scale in F_NUMBERS:
        if not all(value in scale for value in (*before, last)):
            continue
        first, end = scale.index(before[-1]), scale.index(last)
        step = 1 if first < end else -1
        if len(before) == 1 or scale.index(before[0]) + step == first:
            return list(scale[first + step : end : step])
    raise InputError(
        f"{where}: is no series of full, half or third stops (got {', '.join(map(str, before))}, …, {last};"
        " allowed: as 2,2.8,…,22, 2,2.4,…,8 or 2,2.2,…,4)"
    )


def _steps(before: list[float], last: float, where: str) -> list[float]:
    """Return the numbers between, in steps of the two before the ellipsis."""
    step = before[-1] - before[0]
    count = (last - before[-1]) / step if step else 0.0
    if len(before) < 2 or not 1 - ON_THE_WAY <= count <= MOST_VALUES or abs(count - round(count)) > ON_THE_WAY:
        raise InputError(
            f"{where}: is no series of equal steps (got {', '.join(map(str, before))}, …, {last};"
            " allowed: as 1,1.5,…,4)"
        )
    whole = all(isinstance(value, int) for value in (*before, last))
    values = [before[-1] + k * (last - before[-1]) / round(count) for k in range(1, round(count))]
    return [round(value) for value in values] if whole else [float(f"{value:.12g}") for value in values]
