"""Numbers in lines of text, many lines at once; the line that is wrong is found only when there is one."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError

Line = tuple[int, bytes]


def parsed(text: bytes) -> NDArray[np.float64] | None:
    """Return the numbers in a text, None when something else is in it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(text, np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        return None


def numbers_of_lines(lines: Sequence[Line], each: int, what: str, path: Path) -> NDArray[np.float64]:
    """Return the first numbers (n, each) of lines that may have more of them.

    Parameters
    ----------
    lines : sequence of (number, text)
        Lines without their keyword, with their place in the file.
    each : int
        How many numbers a line must have at least.
    what : str
        What an error calls a line.
    path : Path
        The file, for errors.
    """
    if not lines:
        return np.empty((0, each))
    found = parsed(b" ".join(text for _, text in lines))
    width = len(lines[0][1].split())
    if found is not None and width >= each and all(len(text.split()) == width for _, text in lines):
        return found.reshape(-1, width)[:, :each]
    rows = np.empty((len(lines), each))
    for place, (number, text) in enumerate(lines):
        row = parsed(text) if text.strip() else None
        if row is None or len(row) < each:
            got = text.decode("latin-1").strip()[:60]
            raise InputError(f"{path}:{number}: is not {what} (got {got!r}; allowed: {each} numbers)")
        rows[place] = row[:each]
    return rows
