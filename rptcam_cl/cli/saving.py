"""The files of a picture: every one that can be written, and a place for the film where none can."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.cli.output import as_json
from rptcam_cl.core.errors import RptcamError

if TYPE_CHECKING:
    from rptcam_cl.imaging import Image


def save(image: Image, arguments: argparse.Namespace) -> None:
    """Write every output that can be written, then report the first that could not, and where the film is instead."""
    from rptcam_cl.core.atomic import replacing
    from rptcam_cl.imaging import FILM_SUFFIXES

    failures: list[Exception] = []

    def attempt(write: Callable[[], object]) -> bool:
        try:
            write()
        except Exception as error:  # whatever a library raises: the picture is not lost with it
            failures.append(error)
            return False
        return True

    def write_stats() -> None:
        with replacing(arguments.stats) as temporary:
            temporary.write_text(as_json(image.stats) + "\n", encoding="utf-8", errors="backslashreplace")

    # A list, and not a generator: all are attempted.
    films = [attempt(partial(image.save, path)) and path.suffix.lower() in FILM_SUFFIXES for path in arguments.outputs]
    for raw in arguments.raws:
        attempt(partial(_save_raw, image, raw))
    if arguments.stats is not None:
        attempt(write_stats)
    if not failures:
        return
    where = "" if any(films) else rescued(image)
    if isinstance(failures[0], RptcamError):
        raise type(failures[0])(f"{failures[0]}{where}")
    if where:
        print(f"note: the picture could not be written{where}", file=sys.stderr)
    raise failures[0]


def _save_raw(image: Image, path: Path) -> None:
    image.raw().save(path)


def rescued(image: Image) -> str:
    """Write the film of a picture that cannot go where it was to go to the first place that takes it; say where."""
    for folder in dict.fromkeys((tempfile.gettempdir(), os.path.expanduser("~"), os.getcwd())):  # noqa: PTH109, PTH111
        for suffix in (".exr", ".npz"):
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
