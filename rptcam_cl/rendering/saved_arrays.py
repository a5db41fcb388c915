"""Whether the arrays of a saved render, which may come from anywhere, fit the render that is to go on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.errors import StateError

GROWING = ("noise_tiles", "noise_runs")  # as many rows as tiles are left, or as runs are kept

Arrays = Mapping[str, NDArray[Any]]


def check_fits(saved: Arrays, fresh: Arrays) -> None:
    """Refuse arrays that kernels would read or write beyond their ends.

    Parameters
    ----------
    saved
        Of the file.
    fresh
        The same arrays of the render at its start.

    Raises
    ------
    StateError
        When one is missing, or of another type or shape, or names a tile that is not there.
    """
    for name, wanted in fresh.items():
        found = saved.get(name)
        start = 1 if name in GROWING else 0
        if found is None or found.dtype.kind != wanted.dtype.kind or found.ndim != wanted.ndim:
            raise _misfit(name)
        if found.shape[start:] != wanted.shape[start:]:
            raise _misfit(name)
    tiles = saved.get("noise_tiles", np.zeros(0))
    if "noise_tiles" in fresh and tiles.size and int(tiles.max()) >= len(fresh["noise_tiles"]):
        raise _misfit("noise_tiles")


def _misfit(name: str) -> StateError:
    return StateError(f"the saved render is damaged: its array {name} does not fit (render without --resume)")
