"""The command ``rptcam``: data goes to standard output, messages to standard error.

Exit codes: 0 done, 1 a bug in rptcam, 2 wrong input, 3 no usable device, 4 a file could not be read or
written, 5 numbers that cannot be trusted or autofocus that failed in a strict run, 130 interrupted.
"""

import contextlib
import importlib
import os
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import partial
from typing import Any, TextIO, cast

from rptcam_cl.cli.output import INTERRUPTED, Parser, add_command, run_nothing
from rptcam_cl.core import __version__
from rptcam_cl.core.errors import InputError, RptcamError, StateError

_DEBUG = "--debug"
_STANDARD_OUTPUT = "standard output"
FAULT = 1  # exit code of an unexpected error


# The module of each command and its line in the help, in their order there. `add_…` of the module adds its options,
# `run_…` does it, and the docstring of that is the head of its own help.
COMMANDS = {
    "demo": ("render", "render a first picture of a scene that comes along"),
    "examples": ("first_steps", "list the scenes that come along, or copy one to a folder"),
    "new": ("first_steps", "write a starting scene: your model, your light, your lens"),
    "render": ("render", "render a scene file to pictures"),
    "merge": ("render", "make the picture of a render that was made in parts"),
    "settle": ("first_steps", "find focus, camera model and exposure, and write the scene so"),
    "sweep": ("frames", "render a scene with every combination of some values"),
    "stack": ("frames", "make one picture that is sharp throughout, by many focuses"),
    "halves": ("frames", "see as dual pixels and focusing screens do"),
    "dataset": ("frames", "render many pictures whose keys are drawn from distributions"),
    "view": ("first_steps", "open a scene in the browser, with the dials of a camera"),
    "focus": ("camera", "find the focus of a scene's camera"),
    "tradeoff": ("camera", "measure what each approximation of a picture costs and gains"),
    "develop": ("render", "make pictures of a film that was saved"),
    "convert": ("first_steps", "make a scene file from one of pbrt or USD, or from a model"),
    "lens": ("lens", "list, examine, draw, measure, convert and design lenses"),
    "camera": ("camera", "the camera for computer vision: intrinsics, distortion, pose"),
    "devices": ("first_steps", "list the OpenCL devices"),
    "doctor": ("first_steps", "report on versions, devices and caches; check the devices"),
    "resident": ("first_steps", "say which processes stay for quick starts, or end them"),
    "schema": ("first_steps", "print the JSON schema of scene or lens files"),
}


def build_parser(command: str | None = None) -> Parser:
    """The parser of the whole command line, or of a single command, whose module alone is then imported."""
    parser = Parser(prog="rptcam", description="Render scenes through real photographic lenses, on OpenCL devices.")
    parser.add_argument("-V", "--version", action="version", version=f"rptcam {__version__}")
    parser.add_argument(_DEBUG, action="store_true", help="show where in the program an unexpected error arose")
    commands = parser.add_commands("command")
    for name in COMMANDS if command is None else (command,):
        module_name, text = COMMANDS[name]
        module = importlib.import_module(f"rptcam_cl.cli.{module_name}")
        run = getattr(module, f"run_{name}", None)  # one with commands of its own has none
        parser_of_command = add_command(commands, name, text, run or run_nothing, (run and run.__doc__) or "")
        getattr(module, f"add_{name}")(parser_of_command)
    return parser


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    if category is UserWarning:  # ours; libraries warn in classes of their own, of no use to a user
        print(f"warning: {message}", file=sys.stderr)


def _run(arguments: Sequence[str]) -> int:
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:], "--help"]
    command = arguments[0] if arguments and arguments[0] in COMMANDS else None
    parsed, unknown = build_parser(command).parse_known_args(arguments)
    if unknown:
        hint = parsed.parser.near_option(unknown[0])
        raise InputError(f"{parsed.parser.prog}: unknown argument {unknown[0]}{hint}; see {parsed.parser.prog} --help")
    code: int = parsed.run(parsed)
    sys.stdout.flush()
    return code


def _report_unexpected(error: Exception) -> int:
    """Print an unexpected error, write its traceback to a file, and return the exit code."""
    what = f"{type(error).__name__}: {error}".splitlines()[0][:500]
    print(f"error: unexpected {what}", file=sys.stderr)
    try:
        descriptor, path = tempfile.mkstemp(prefix="rptcam-", suffix=".log")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="replace") as file:
            file.write(f"rptcam {__version__}, Python {sys.version}\n{sys.argv}\n\n")
            traceback.print_exception(error, file=file)
    except OSError:
        print(f"this is a bug in rptcam; please report it, with the output of {_DEBUG}", file=sys.stderr)
    else:
        print(f"this is a bug in rptcam; please report it, with the file {path}", file=sys.stderr)
    return FAULT


def _file_trouble(error: OSError) -> int:
    """Print which file could not be read or written, and return the exit code."""
    name = error.filename or "a file could not be read or written"
    if name == _STANDARD_OUTPUT:
        _abandon(sys.stdout)
    print(f"error: {name}: {error.strerror or error}", file=sys.stderr)
    return StateError.exit_code


class _GuardedStream:
    """A standard stream each of whose calls runs within a context, which is made anew for it."""

    def __init__(self, stream: TextIO, guard: Callable[[], AbstractContextManager[None]]) -> None:
        self._stream, self._guard = stream, guard

    def write(self, text: str) -> int:
        """Write text."""
        with self._guard():
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Send on what is held back."""
        with self._guard():
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def _name_standard_output() -> Iterator[None]:
    """Let errors say that they are of standard output."""
    try:
        yield
    except OSError as error:
        error.filename = _STANDARD_OUTPUT
        raise


@contextlib.contextmanager
def _go_on_unheard(stream: TextIO) -> Iterator[None]:
    """Let the work go on where the reader of a stream has gone."""
    try:
        yield
    except OSError:
        _abandon(stream)


def _abandon(stream: TextIO) -> None:
    """Send what a stream still holds nowhere, so that the interpreter does not complain at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Parameters
    ----------
    arguments
        Words after the command's name; those of the process when absent.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = _DEBUG in words
    errors = _GuardedStream(sys.stderr, partial(_go_on_unheard, sys.stderr))
    with warnings.catch_warnings(), contextlib.redirect_stderr(cast("TextIO", errors)):
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = _warn
        try:
            with contextlib.redirect_stdout(_GuardedStream(sys.stdout, _name_standard_output)):
                try:
                    return _run([word for word in words if word != _DEBUG])
                except SystemExit:  # of --help and --version
                    sys.stdout.flush()
                    raise
        except RptcamError as error:
            print(f"error: {error}", file=sys.stderr)
            return error.exit_code
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return INTERRUPTED
        except OSError as error:
            if isinstance(error, BrokenPipeError) and error.filename == _STANDARD_OUTPUT:  # its reader has seen enough
                _abandon(sys.stdout)
                return 0
            if debug:
                raise
            return _file_trouble(error)
        except MemoryError as error:
            if debug:
                raise
            print(f"error: not enough memory ({str(error) or 'it is used up'})", file=sys.stderr)
            return StateError.exit_code
        except Exception as error:
            if debug:
                raise
            return _report_unexpected(error)
