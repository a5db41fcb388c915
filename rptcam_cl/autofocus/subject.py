"""Where in the picture an object is, for autofocus that is told what to focus on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.autofocus.probe import Zone
from rptcam_cl.autofocus.renderer import ProbeRenderer
from rptcam_cl.errors import InputError
from rptcam_cl.scene.refusal import listed, near_name

LEAST_HALF = 0.01  # of the picture's shorter side: half a side of the smallest zone


def zone_of_object(probe: ProbeRenderer, name: str) -> Zone:
    """Return the largest square that fits into what is seen of an object, the first of that name.

    Raises
    ------
    InputError
        When no object has that name, or none of it is seen.
    """
    names = [item.name for item in probe.scene.objects]
    if name not in names:
        known = [item for item in names if item]
        raise InputError(
            f"camera.focus.auto.object: no object has this name{near_name(name, known)} (got {name};"
            f" allowed: {listed(known) or 'a name, once an object has one'})"
        )
    seen = probe.objects() == names.index(name)
    if not seen.any():
        raise InputError(f"camera.focus.auto.object: {name} is not in the picture")
    row, column, half = _deepest(seen)
    height, width = seen.shape
    size = max(half, LEAST_HALF * min(height, width))
    left, top = max((column + 0.5 - size) / width, 0.0), max((row + 0.5 - size) / height, 0.0)
    return Zone(left, min((column + 0.5 + size) / width, 1.0), top, min((row + 0.5 + size) / height, 1.0))


def _deepest(seen: NDArray[np.bool_]) -> tuple[int, int, float]:
    """Return row and column of a pixel farthest from the edge of a shape, and how far that is."""
    depth, shape = 0, np.pad(seen, 1)
    while True:
        smaller = shape.copy()
        for axis in (0, 1):
            smaller &= np.roll(shape, 1, axis) & np.roll(shape, -1, axis)
        if not smaller.any():
            break
        shape, depth = smaller, depth + 1
    places = np.argwhere(shape) - 1
    middle = places[np.argmin(np.abs(places - places.mean(axis=0)).sum(axis=1))]
    return int(middle[0]), int(middle[1]), (depth + 0.5) / np.sqrt(2)
