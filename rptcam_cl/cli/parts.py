"""Renders in parts: the options of ``rptcam render`` for one, and what goes with them."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rptcam_cl.cli import parser as values
from rptcam_cl.core.errors import InputError

# Options that need the whole film or its picture.
WHOLE_FILM = {"raws": "--raw", "stats": "--stats", "denoise": "--denoise", "noise": "--noise", "time": "--time"}
WHOLE_FILM |= {"watch": "--watch", "preview": "--preview"}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add which part of the film is rendered, for `rptcam merge`."""
    parser.add_argument(
        "--part", type=values.part, metavar="K/N",
        help="render part K of N parts of the tiles, to be merged; -o names a file that ends in .rpck",
    )  # fmt: skip
    parser.add_argument(
        "--samples", type=values.sample_range, metavar="FIRST:END",
        help="render these samples of each pixel alone, as 64:128, likewise",
    )  # fmt: skip


def requested(arguments: argparse.Namespace) -> bool:
    """Whether a part is rendered in place of the whole."""
    return arguments.part is not None or arguments.samples is not None


def check_output(arguments: argparse.Namespace, inputs: Sequence[Path]) -> None:
    """Refuse what no part can be written to, and options that need the whole film.

    Raises
    ------
    InputError, StateError
    """
    from rptcam_cl.core.atomic import check_writable
    from rptcam_cl.rendering import SUFFIX

    option = "--part" if arguments.part is not None else "--samples"
    for name, words in WHOLE_FILM.items():
        if getattr(arguments, name):
            raise InputError(
                f"{words}: needs the whole film (allowed: without {option}; rptcam merge makes the picture)"
            )
    if arguments.samples is not None and arguments.spp is not None:
        raise InputError("--spp: --samples says where the samples end (allowed: one of the two)")
    outputs: list[Path] = arguments.outputs
    if len(outputs) != 1 or outputs[0].suffix != SUFFIX:
        got = ", ".join(map(str, outputs))
        raise InputError(f"-o: a part is one file (got {got}; allowed: a name that ends in {SUFFIX})")
    check_writable(outputs[0], inputs)
