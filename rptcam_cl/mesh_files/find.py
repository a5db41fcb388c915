"""How a reader opens a mesh file, and finds the further files that it names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from rptcam_cl.errors import InputError, StateError
from rptcam_cl.references import open_regular

LARGEST_MESH = 16 << 30  # bytes

# Returns the checked path of a file given relative to the mesh file.
Find = Callable[[Path], Path]


def open_mesh(path: Path) -> BinaryIO:
    """Return a mesh file opened for reading.

    Raises
    ------
    InputError
        When it is not a regular file of bearable size.
    StateError
        When it cannot be opened.
    """
    try:
        return open_regular(path, LARGEST_MESH)
    except (InputError, StateError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
