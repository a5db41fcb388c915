"""The files of ``rptcam camera``: all are checked before anything is traced, and all are made before one is written."""

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rptcam_cl.cli.camera_maps import NAMES, check_maps, written_maps
from rptcam_cl.core.errors import InputError, StateError

if TYPE_CHECKING:
    from rptcam_cl.calibration import Calibration, View

    File = tuple[Path, Callable[[Path], object]]  # and what writes it

TEXTS = ("opencv", "ros", "openlensio", "usd", "osl")
COLMAP = ("cameras.txt", "images.txt", "points3D.txt")
USD = (".usda", ".usd")  # of text; a file .usdc is binary


def check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse, before anything is traced, files that could not be written.

    Raises
    ------
    InputError, StateError
    """
    from rptcam_cl.core.atomic import check_writable

    if (usd := arguments.usd) is not None and usd.suffix.lower() not in USD:
        raise InputError(f"--usd: {usd}: such a file is {' or '.join(USD)} (got {usd.suffix or 'none'})")
    if arguments.plot is not None:
        from rptcam_cl.lenstools import check_suffix

        check_suffix(arguments.plot)
    check_maps(arguments)
    _check_apart(arguments)
    folder: Path | None = arguments.colmap
    if folder is not None and not folder.is_dir():
        if os.path.lexists(folder):
            raise StateError(f"--colmap: {folder} is no folder (allowed: a folder, which is made if it is missing)")
        check_writable(folder)
    for _, path in _outputs(arguments):
        if path.parent != folder or folder.is_dir():
            check_writable(path, [arguments.source])


def _outputs(arguments: argparse.Namespace) -> Iterator[tuple[str, Path]]:
    """Yield options and the files that they name."""
    for name in (*TEXTS, "plot", *NAMES):
        if (path := getattr(arguments, name)) is not None:
            yield f"--{name.replace('_', '-')}", path
    if arguments.colmap is not None:
        for name in COLMAP:
            yield "--colmap", arguments.colmap / name


def _check_apart(arguments: argparse.Namespace) -> None:
    """Refuse outputs that would overwrite one another."""
    files = list(_outputs(arguments))
    if arguments.colmap is not None:
        files.append(("--colmap", arguments.colmap))
    known: dict[str, str] = {}
    for option, path in files:
        first = known.setdefault(os.path.realpath(path), option)
        if first != option:
            raise InputError(f"{option}: {path} is the output of {first} too (allowed: a name of its own)")


def write_files(arguments: argparse.Namespace, seen: "View", chosen: "Calibration") -> None:
    """Write what is requested, all or nothing."""
    files, folder = list(_files(arguments, seen, chosen)), arguments.colmap
    is_new = folder is not None and not folder.is_dir()
    if is_new:
        folder.mkdir()
    try:
        _write(files)
    except BaseException:
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        raise
    for path, _ in files:
        if path.parent != folder or path.name not in COLMAP:
            print(f"wrote {path}", file=sys.stderr)
    if folder is not None:
        print(f"wrote {folder}", file=sys.stderr)


def _files(arguments: argparse.Namespace, seen: "View", chosen: "Calibration") -> Iterator["File"]:
    from rptcam_cl.calibration import WRITTEN, colmap_texts, residual_chart
    from rptcam_cl.lenstools import encoded

    for name in TEXTS:
        if (path := getattr(arguments, name)) is not None:
            yield path, partial(_put, WRITTEN[name](seen, chosen).encode())
    if arguments.plot is not None:
        yield arguments.plot, partial(_put, encoded(residual_chart(seen, chosen), arguments.plot))
    yield from written_maps(arguments, seen)
    if arguments.colmap is not None:
        picture = f"{Path(arguments.source).stem.replace(' ', '_')}.png"
        for name, text in colmap_texts(seen, chosen, picture).items():
            yield arguments.colmap / name, partial(_put, text.encode())


def _put(data: bytes, path: Path) -> None:
    path.write_bytes(data)


def _write(files: list["File"]) -> None:
    """Write all files beside their places, and then give them their names."""
    from rptcam_cl.core.atomic import replacing

    with ExitStack() as whole:
        for path, writer in files:
            writer(whole.enter_context(replacing(path)))
