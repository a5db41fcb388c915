"""The top of a curve of contrast, from a few of its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.autofocus.looks import Look

Array = NDArray[np.float64]

DETAIL = 1.5  # power of the image scale by which the contrast between pixels falls: 1 to 2 for natural textures
FLOOR = 0.02  # of the greatest measure: smaller ones say no more than that they are small


@dataclass(frozen=True)
class Peak:
    """The top of a curve.

    Attributes
    ----------
    place : float
        Where it is [mm].
    error : float
        Its standard error, from noise.
    width : float
        Distance from it at which the measure is half of its greatest; infinite for a flat curve.
    rise : float
        By how many of its standard errors the greatest measure exceeds the least.
    inside : bool
        Whether the greatest measure has lesser ones on both sides.
    """

    place: float
    error: float
    width: float
    rise: float
    inside: bool


def peak_of(looks: Sequence[Look], zone: int) -> Peak:
    """Return the top of the curve through some looks at one stop, for one zone.

    A blur of diameter b takes the share 1 / (1 + (b / b0)^2) or so of the contrast of a texture of many scales, and b
    grows evenly with the distance from the focus. So a parabola is laid through the *reciprocal* of the measure, at the
    greatest and its neighbours. The error is that of the jackknife over the parts, which the looks have in common.

    Where the film is scaled with the image, the blur grows evenly on that film with d / scale, d being the distance
    from the place of reference; as the scale is 1 + k d, the parabola is laid over d / (1 + k d). Where it is not, the
    details that pixels see shrink as the image grows.
    """
    looks = sorted(looks, key=lambda look: look.place)
    scale = np.array([look.scale for look in looks])
    is_scaled = looks[0].reference is not None
    origin = looks[0].reference or 0.0
    away = np.array([look.place for look in looks]) - origin
    growth = _growth(away, scale) if is_scaled else 0.0
    places = away / (1 + growth * away)
    gain = np.ones_like(scale) if is_scaled else scale**DETAIL
    values = gain * [look.found[zone].value for look in looks]
    without = gain[:, None] * [look.found[zone].leave_one_out for look in looks]
    top = int(values.argmax())
    inside = 0 < top < len(looks) - 1
    three = np.arange(max(min(top - 1, len(looks) - 3), 0), min(max(top + 2, 3), len(looks)))
    place, width = _vertex(places[three], values[three])
    others = np.array([_vertex(places[three], values)[0] for values in without[three].T])
    error = _spread(others)
    bottom = int(values.argmin())
    difference = _spread(without[top] - without[bottom])
    rise = float((values[top] - values[bottom]) / difference) if difference > 0 else np.inf
    unscaled = 1 - growth * place
    return Peak(
        origin + place / unscaled, error / unscaled**2, width, rise if values[top] > values[bottom] else 0.0, inside
    )


def _growth(away: Array, scale: Array) -> float:
    """Return by how much the scale grows with the distance from the place of reference [1/mm]."""
    farthest = int(np.abs(away).argmax())
    return float((scale[farthest] - 1) / away[farthest]) if away[farthest] else 0.0


def _spread(without: Array) -> float:
    """Return the standard error of a statistic from its values without each of the parts."""
    count = len(without)
    return float(np.sqrt((count - 1) / count * np.square(without - without.mean()).sum()))


def _vertex(places: Array, values: Array) -> tuple[float, float]:
    """Return where the reciprocal of three values is least, not beyond the places, and the half width there."""
    top = int(values.argmax())
    if len(places) < 3 or not values[top] > 0:
        return float(places[top]), np.inf
    middle, reach = places[top], float(np.ptp(places))
    reciprocal = values[top] / np.maximum(values, FLOOR * values[top])
    a, b, c = np.linalg.solve(np.vander((places - middle) / reach, 3), reciprocal)
    if not a > 0:
        return float(middle), np.inf
    at = float(np.clip(middle - reach * b / (2 * a), places.min(), places.max()))
    least = max(c - b * b / (4 * a), 1e-6)
    return at, reach * float(np.sqrt(least / a))
