"""The files of a picture: every one that can be written, and a place for the film where none can."""

from __future__ import annotations

import argparse
import os
import tempfile
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

    failures: list[RptcamError] = []
    film_is_written = False
    for output in arguments.outputs:
        try:
            image.save(output)
            film_is_written |= output.suffix.lower() in FILM_SUFFIXES
        except RptcamError as error:
            failures.append(error)
    for raw in arguments.raws:
        try:
            image.raw().save(raw)
        except RptcamError as error:
            failures.append(error)
    if arguments.stats is not None:
        try:
            with replacing(arguments.stats) as temporary:
                temporary.write_text(as_json(image.stats) + "\n", encoding="utf-8")
        except RptcamError as error:
            failures.append(error)
    if failures:
        where = "" if film_is_written else _rescued(image)
        raise type(failures[0])(f"{failures[0]}{where}")


def _rescued(image: Image) -> str:
    """Write the film of a picture that cannot go where it was to go into the folder for temporary files; say so."""
    try:
        descriptor, name = tempfile.mkstemp(prefix="rptcam-", suffix=".exr")
    except OSError:
        return ""
    os.close(descriptor)
    try:
        image.save(Path(name))
    except RptcamError:
        Path(name).unlink(missing_ok=True)
        return ""
    return f" (the film is kept in {name}, for rptcam develop)"
