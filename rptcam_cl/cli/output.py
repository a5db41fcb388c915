"""What commands share: arguments and their parsers; JSON, numbers, tables, progress and summary; what Ctrl-C does."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import re
import shlex
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

from rptcam_cl.api.options import RenderOptions, check_together, number
from rptcam_cl.core.errors import DeviceError, InputError, RptcamError, near_name
from rptcam_cl.core.files import FILM_SUFFIXES, LAYER_SUFFIXES, plain, replacing

if TYPE_CHECKING:
    import argparse

    from rptcam_cl.imaging.image import Image
    from rptcam_cl.rendering.progressive import Progress
    from rptcam_cl.scene.scene import Scene


# What the commands print: JSON that every reader accepts, numbers for people, and tables.


def as_json(value: Any) -> str:
    """The value as indented JSON text."""
    return json.dumps(plain(value, json=True), indent=2, ensure_ascii=False, allow_nan=False)


def as_bytes(count: float) -> str:
    """A number of bytes for people, as ``15.6 GiB``."""
    for unit in ("B", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.4g} {unit}"
        count /= 1024
    return f"{count:.4g} GiB"


def print_warnings(warnings: Iterable[str]) -> None:
    """Print a line for each warning to standard error, which leaves standard output to data."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


_NOTHING = 1e-12  # what rounding leaves of a zero


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, float):
        return f"{0.0 if abs(value) < _NOTHING else value:.5g}"
    return str(value)


def print_table(columns: Sequence[str], rows: Sequence[Sequence[Any]], title: str = "") -> None:
    """Print rows under the names of their columns; numbers to five digits, what does not exist as a dash."""
    cells = [[_text(value) for value in row] for row in rows]
    if sys.stdout.isatty():
        _print_ruled(columns, cells, title)
        return
    if title:
        print(title)
    widths = [max(map(len, column)) for column in zip(columns, *cells, strict=True)]
    for line in (columns, *cells):
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def _print_ruled(columns: Sequence[str], cells: Sequence[Sequence[str]], title: str) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title) or None)
    for column in columns:
        table.add_column(escape(column), justify="right")
    for row in cells:
        table.add_row(*map(escape, row))
    Console().print(table)


# How a render is coming along: a bar where somebody watches, a line now and then where the text is kept.

Show = Callable[["Progress"], None]

_LINE_INTERVAL = 10.0  # [s]
_LAST = 0.02  # share of the tiles of a render with a noise target, whose time is reported at its end
_WORTH = 0.1  # share of the time from which on it is
_LONG = 10.0  # [s], of the whole render


def as_duration(seconds: float) -> str:
    """A time for people, as ``4.2 s``, ``42 s`` or ``1 h 02 min``."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def fraction_done(progress: Progress, time_limit: float | None) -> float | None:
    """Share of the work that is done, 0..1, by the nearer of the two ends; nothing when there is no end.

    Parameters
    ----------
    progress
        How far the render is.
    time_limit
        When it is to end, however many samples are done [s].
    """
    shares = []
    if progress.tiles_left is not None:
        shares.append(progress.seconds / (progress.seconds + progress.tiles_left.seconds))
    elif progress.tiles_done is not None:
        shares.append(progress.tiles_done)
    elif progress.spp_target and progress.spp_target > progress.samples_at_start:
        here = progress.samples_done - progress.samples_at_start
        shares.append(here / (progress.spp_target - progress.samples_at_start))
    if time_limit:
        shares.append(progress.seconds / time_limit)
    return min(max(shares), 1.0) if shares else None


def describe(progress: Progress, time_limit: float | None = None) -> str:
    """The state of a render in one line: samples, speed, time left, share of rays that the lens blocked.

    With a noise target its tiles and their time come first: a terminal of 80 columns cuts off the rest.
    """
    if progress.stage != "render":
        return f"{progress.stage} ..."
    target = f"/{progress.spp_target}" if progress.spp_target else ""
    samples = [f"{progress.samples_done}{target} spp"]
    if progress.seconds > 0 and progress.samples_done > 0:
        here = progress.samples_done - progress.samples_at_start
        samples.append(f"{here / progress.seconds:.3g} spp/s")
        samples.append(f"{progress.msamples_per_second:.3g} Msamples/s")
    done = fraction_done(progress, time_limit)
    left = [] if not done else [f"{as_duration(progress.seconds * (1 - done) / done)} left"]
    if progress.tiles_done is None:
        parts = samples + left
    else:
        parts = [f"{100 * progress.tiles_done:.0f} % of the tiles done"]
        if (tiles := progress.tiles_left) is not None:
            parts += [f"about {text}" for text in left]
            if tiles.few:
                noise, wanted = 100 * tiles.worst, 100 * tiles.target
                parts.append(f"{tiles.count} have up to {noise:.2g} % noise for {wanted:.2g} %")
        parts += samples
    if progress.blocked_share is not None:
        parts.append(f"lens blocks {100 * progress.blocked_share:.0f} %")
    return ", ".join(parts)


def _last_tiles_text(few_left: Progress, last: Progress) -> str | None:
    """How long the last 2 % of the tiles of a render with a noise target took, and why; None if that was not long.

    Parameters
    ----------
    few_left
        The first report with no more than these left.
    last
        The last report.
    """
    tiles = few_left.tiles_left
    if tiles is None or last.seconds < _LONG:
        return None
    share = 1 - few_left.seconds / last.seconds
    if share < _WORTH:
        return None
    return (
        f"the last {tiles.count} tiles took {100 * share:.0f} % of the time: they had up to {100 * tiles.worst:.2g} %"
        f" noise when all others met {100 * tiles.target:.2g} % (--spp limits the samples of a pixel)"
    )


Say = Callable[[str, float | None], None]
"""Shows in words what is being done, and the share that is done, where it is known."""


@contextlib.contextmanager
def say_on_stderr(line: Callable[[str, float | None], str] | None = None) -> Iterator[Say]:
    """A function that shows how work is coming along.

    On a terminal it moves a bar, which goes away at the end; elsewhere it prints a line every ten seconds.

    Parameters
    ----------
    line
        Makes the line of words and share; by default the words.
    """
    if not sys.stderr.isatty():
        last, stream = time.monotonic(), sys.stderr

        def print_line(words: str, share: float | None) -> None:
            nonlocal last
            if time.monotonic() - last >= _LINE_INTERVAL:
                last = time.monotonic()
                print(words if line is None else line(words, share), file=stream, flush=True)

        yield print_line
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (BarColumn(bar_width=None), TextColumn("{task.description}", markup=False))
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, expand=True, refresh_per_second=5) as bar:
        task = bar.add_task("start ...", total=None)

        def move(words: str, share: float | None) -> None:
            bar.update(task, description=words)
            if share is not None:
                bar.update(task, total=1.0, completed=share)

        yield move


@contextlib.contextmanager
def progress_on_stderr(time_limit: float | None = None) -> Iterator[Show]:
    """A function that shows each report of a render, as `say_on_stderr` does.

    At the end it says why the last tiles of a noise target took long, if they did.

    Parameters
    ----------
    time_limit
        When the render is to end [s], if by time.
    """
    few_left: Progress | None = None
    last: Progress | None = None
    with say_on_stderr() as say:

        def show(progress: Progress) -> None:
            nonlocal few_left, last
            if progress.tiles_done is not None:
                last = progress
                if few_left is None and progress.tiles_left is not None and progress.tiles_done >= 1 - _LAST:
                    few_left = progress
            share = fraction_done(progress, time_limit) if progress.stage == "render" else None
            say(describe(progress, time_limit), share)

        yield show
    if few_left is not None and last is not None and (text := _last_tiles_text(few_left, last)):
        print(text, file=sys.stderr)


# What is said of a render when it has ended.

_MUCH_BLOCKED = 0.1  # of the rays pass at least, or something is wrong


def _exposure_text(metadata: dict[str, Any]) -> str:
    """The choice of exposure ``auto``: the light, and time and ISO where there are any."""
    chosen = f"metered {metadata['metered_cd_m2']:.4g} cd/m²"
    if "exposure_time_s" in metadata:
        time_s = metadata["exposure_time_s"]
        chosen += f", {f'1/{1 / time_s:.0f}' if time_s < 0.1 else f'{time_s:.3g}'} s at ISO {metadata['iso']:.4g}"
    return chosen


def _samples_text(stats: dict[str, Any]) -> str:
    """How many samples the pixels have; with a noise target each tile has as many as it takes."""
    spread = stats.get("noise", {"spp_min": stats["spp"]})
    if spread["spp_min"] == stats["spp"]:
        return f"{stats['spp']} spp"
    return f"{spread['spp_mean']:.0f} spp on average ({spread['spp_min']} to {stats['spp']})"


def summary(image: Image, outputs: list[Path]) -> str:
    """How large the picture is, where it went, how long it took, and what the lens and the meter have done."""
    stats: dict[str, Any] = image.stats
    seconds = stats["seconds"]
    parts = [
        f"{image.width} x {image.height}",
        _samples_text(stats),
        f"{as_duration(seconds['total'])} ({as_duration(seconds['render'])} rendering)",
        f"{stats['msamples_per_second']:.3g} Msamples/s",
    ]
    outcomes = stats.get("lens")
    if outcomes and sum(outcomes.values()):
        parts.append(f"the lens blocked {100 * (1 - outcomes['passed'] / sum(outcomes.values())):.0f} % of the rays")
    if "metered_cd_m2" in image.metadata:
        parts.append(_exposure_text(image.metadata))
    return f"wrote {', '.join(map(str, outputs))}: {', '.join(parts)}"


def dark_warnings(image: Image, *, whole: bool = True) -> list[str]:
    """A warning where no light arrives at all, or hardly a ray passes the lens: most of the film is dark or noisy."""
    if whole and not image.pixels.any():
        return [
            "the picture is black: no light reaches the film (does something shine, and does the camera look at it?"
            " camera.target, objects of emissive material, lights and environment say so)"
        ]
    outcomes = image.stats.get("lens")
    if not outcomes or not sum(outcomes.values()) or outcomes["passed"] >= _MUCH_BLOCKED * sum(outcomes.values()):
        return []
    share = 1 - outcomes["passed"] / sum(outcomes.values())
    size = image.metadata.get("film_size_mm")
    film = f" of {size[0]:.4g} x {size[1]:.4g} mm" if isinstance(size, list | tuple) and len(size) == 2 else ""
    return [
        f"the lens blocked {100 * share:.0f} % of the rays: the film{film} is perhaps larger than its image circle"
        " (rptcam lens info says how large that is; film.width_mm or film.format sets the film)"
    ]


def shared_text(stats: dict[str, Any]) -> str | None:
    """The share of each of several devices, and how to repeat it; None for a device alone."""
    if len(stats.get("devices", ())) < 2:
        return None
    done = [
        f"{device['id']} {device['name']} "
        + ("was dropped" if "dropped" in device else f"took {device['share']:.1%}")
        + f" at {device['msamples_per_second']:.3g} Msamples/s"
        for device in stats["devices"]
    ]
    again = {part["split"] for part in stats["work"]}
    repeat = f"; --split {again.pop()} repeats it" if len(again) == 1 else ""
    return f"devices: {', '.join(done)}{repeat}"


# Ctrl-C that ends a render after the pass at hand instead of losing it.

INTERRUPTED = 128 + signal.SIGINT
"""Exit code of an interrupted command, as shells count."""

ENDS_LATER = "interrupted: the picture at hand is finished first; Ctrl-C again ends at once"
"""What the first Ctrl-C says where it ends a whole picture later, and not a pass."""


@contextlib.contextmanager
def stop_on_interrupt(words: str | None = None) -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, or termination, or the end of the terminal; the second interrupts at once.

    So does a device that fails after the first: Ctrl-C takes a compiler's files away while it works.
    Outside the main thread, where signals do not arrive, the event stays unset.
    With words, the first says them, for a command that goes on for longer than a pass.
    """
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return

    def handle(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()
        if words is not None:  # past Python's buffers, which may be in the middle of another line
            with contextlib.suppress(OSError, ValueError):
                os.write(sys.stderr.fileno(), f"{words}\n".encode())

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    closed = getattr(signal, "SIGHUP", None)  # the terminal is closed; what nohup starts is to go on
    if closed is not None and signal.getsignal(closed) == signal.SIG_DFL:
        before[closed] = signal.signal(closed, handle)
    try:
        yield stop
    except DeviceError:
        if stop.is_set():
            raise KeyboardInterrupt from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# The files of a picture: every one that can be written, and a place for the film where none can.


def save(image: Image, outputs: Iterable[Path], raws: Iterable[Path] = (), stats: Path | None = None) -> None:
    """Write every output that can be written, then report the first that could not, and where the film is instead.

    Parameters
    ----------
    raws
        Raw files to write too.
    stats
        A file for the statistics.
    """
    failures: list[Exception] = []

    def attempt(write: Callable[[], object]) -> bool:
        try:
            write()
        except Exception as error:  # whatever a library raises: the picture is not lost with it
            failures.append(error)
            return False
        return True

    def write_stats(path: Path) -> None:
        with replacing(path) as temporary:
            temporary.write_text(as_json(image.stats) + "\n", encoding="utf-8", errors="backslashreplace")

    # A list, and not a generator: all are attempted.
    films = [attempt(partial(image.save, path)) and path.suffix.lower() in FILM_SUFFIXES for path in outputs]
    for raw in raws:
        attempt(lambda raw=raw: image.raw().save(raw))  # type: ignore[misc]
    if stats is not None:
        attempt(partial(write_stats, stats))
    if not failures:
        return
    where = "" if any(films) else _rescue(image)
    if isinstance(failures[0], RptcamError):
        raise type(failures[0])(f"{failures[0]}{where}")
    if where:
        print(f"note: the picture could not be written{where}", file=sys.stderr)
    raise failures[0]


def _rescue(image: Image) -> str:
    """Write the film of a picture that cannot go where it was to go to the first place that takes it; say where."""
    for folder in dict.fromkeys((tempfile.gettempdir(), os.path.expanduser("~"), os.getcwd())):  # noqa: PTH109, PTH111
        for suffix in LAYER_SUFFIXES:
            try:
                descriptor, name = tempfile.mkstemp(prefix="rptcam-", suffix=suffix, dir=folder)
                os.close(descriptor)
            except OSError:
                continue
            try:
                image.save(Path(name))
            except Exception:  # as above
                Path(name).unlink(missing_ok=True)
            else:
                return f" (the film is kept in {name}, for rptcam develop)"
    return " (and no place was found where the film could be kept)"


# Arguments of the command line: parsing with hints, and what the parsed ones of a render ask for.

COMMAND = "COMMAND"  # what stands for the name of a command in the help
SCENE_SUFFIXES = (".yaml", ".yml")  # of scene files, which alone a render reads as they are


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `InputError` with a hint and knows no abbreviations."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)
        self._words: list[str] = []

    def near_option(self, word: str) -> str:
        """The text ``; did you mean ...?`` with the option most like a word, by all its names, or nothing."""
        options = [name.strip("-") for name in self._option_string_actions if name.startswith("--")]
        near = near_name(word.partition("=")[0].strip("-"), options)
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
            if choice[1].endswith(SCENE_SUFFIXES):
                message += f"; to render it: rptcam render {shlex.quote(choice[1])} -o OUT.png"
        if message.startswith("the following arguments are required"):
            for word in self._words:
                if word.startswith("--") and word.partition("=")[0] not in self._option_string_actions:
                    message = f"unknown argument {word}{self.near_option(word)}, and {message}"
                    break
        hint = near_name(choice[1], re.findall(r"[\w-]+", choice[2])) if choice else ""
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


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the scene file."""
    parser.add_argument("scene", type=Path, metavar="SCENE", help="scene file (YAML)")


def loaded_scene(arguments: argparse.Namespace) -> Scene:
    """The scene with the values that ``--set`` replaces; its warnings go to standard error."""
    from rptcam_cl.scene.load import load_scene

    scene = load_scene(arguments.scene, arguments.overrides)
    print_warnings(scene.warnings)
    return scene


def add_device(
    parser: argparse.ArgumentParser, purpose: str = "", default: str = "$RPTCAM_DEVICE, $PYOPENCL_CTX, auto"
) -> None:
    """Add the choice of the device that renders a scene, or of what a purpose says, with a default in words."""
    text = f"{purpose}an index as 0:0, a part of a name, cpu, gpu or auto (default: {default})"
    parser.add_argument("--device", metavar="SPEC", help=text)


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


def _layers_to_record(arguments: argparse.Namespace, scene: Scene) -> list[str] | None:
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
    given = vars(arguments)
    keywords = {option.name: given[option.name] for option in fields(RenderOptions) if option.name in given}
    return keywords | {
        "layers": _layers_to_record(arguments, scene),
        "checkpoint": None if arguments.watch else checkpoint_of(arguments),
        "device": device_of(arguments),
        "numerics": arguments.stats is not None,
    }


def apply_options(arguments: argparse.Namespace, scene: Scene) -> Scene:
    """The scene with all options applied."""
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
