"""The command ``rptcam``: data goes to standard output, everything said along the way to standard error.

Exit codes: 0 done, 2 wrong input, 3 no usable device, 4 a file could not be read or written, 5 numbers
that cannot be trusted or autofocus that failed in a strict run, 130 interrupted.
"""

import os
import sys
import warnings
from collections.abc import Sequence
from typing import TextIO

from rptcam_cl._version import __version__
from rptcam_cl.cli import convert, demo, develop, devices, doctor, focus, lens, render, schema, tradeoff
from rptcam_cl.cli.interrupt import INTERRUPTED
from rptcam_cl.cli.parser import Parser, nearest
from rptcam_cl.errors import InputError, RptcamError, StateError


def build_parser() -> Parser:
    """The parser of the whole command line."""
    parser = Parser(prog="rptcam", description="Render scenes through real photographic lenses, on OpenCL devices.")
    parser.add_argument("--version", action="version", version=f"rptcam {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", dest="command", required=True)
    for command in (demo, render, focus, tradeoff, develop, convert, lens, devices, doctor, schema):
        command.add_to(commands)
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
    parsed, unknown = build_parser().parse_known_args(arguments)
    if unknown:
        options = [name for name in parsed.parser.option_names() if name.startswith("--")]
        hint = nearest(unknown[0].partition("=")[0], options)
        raise InputError(f"{parsed.parser.prog}: unknown argument {unknown[0]}{hint}; see {parsed.parser.prog} --help")
    code: int = parsed.run(parsed)
    sys.stdout.flush()
    return code


def _abandon_output() -> None:
    """Send what standard output still holds nowhere, lest the interpreter complain about it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Parameters
    ----------
    arguments
        Words after the command's name; those of the process when absent.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = _warn
        try:
            return _run(sys.argv[1:] if arguments is None else arguments)
        except RptcamError as error:
            print(f"error: {error}", file=sys.stderr)
            return error.exit_code
        except KeyboardInterrupt:
            print("interrupted", file=sys.stderr)
            return INTERRUPTED
        except BrokenPipeError:  # the reader has seen enough
            _abandon_output()
            return 0
        except OSError as error:
            if error.filename is None:
                _abandon_output()
            print(f"error: {error.filename or 'standard output'}: {error.strerror}", file=sys.stderr)
            return StateError.exit_code
