"""Mesh files by their suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.contents import Draft, MeshContents, finished
from rptcam_cl.mesh_files.ply import read_ply

Find = Callable[[Path], Path]


def _ply(path: Path, find: Find) -> Draft:
    return Draft([read_ply(path)], [], [])


READERS: dict[str, Callable[[Path, Find], Draft]] = {".ply": _ply}


def read_mesh_file(path: Path, find: Find) -> MeshContents:
    """Return what a mesh file holds.

    Parameters
    ----------
    path : Path
        The file; its suffix tells the format.
    find : callable
        Returns the checked path of a further file that this one names.

    Raises
    ------
    InputError
        When the file does not hold what its format promises, or nothing that can be shown.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(f"{path}: is not a mesh file (got {suffix or 'no suffix'}; allowed: {', '.join(READERS)})")
    try:
        if not path.stat().st_size:
            raise InputError(f"{path}: is empty")
        return finished(READERS[suffix](path, find), str(path))
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror or problem})") from None
