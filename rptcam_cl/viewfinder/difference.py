"""How two settings differ: a map in stops, and numbers.

The number of a comparison is relMSE, the mean over the picture of |b - a|^2 / (|a|^2 + (0.01 mean a)^2) with vectors of
the three channels, |a|^2 averaged over tiles of 8 x 8 pixels, as `rptcam tradeoff` has it; a is the picture, b what it
is compared with. The noise of both counts in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import FLOAT32_MIN_NORMAL

TILE = 8  # pixels
FLOOR = 0.01  # of the mean: what is darker counts as this dark
RANGE_STOPS = 2.0  # that the map shows in its strongest colours
DARKER, EQUAL, BRIGHTER = (40, 90, 220), (244, 244, 244), (214, 48, 40)


@dataclass(frozen=True)
class Difference:
    """What a second film shows against a first.

    Attributes
    ----------
    stops : (h, w) float32 array
        How much brighter the second is; negative where it is darker.
    relmse : float
    mean_stops : float
        Mean of the absolute values of `stops`.
    bias_stops : float
        How much brighter the second is in the mean.
    worst_stops : float
        99.9th percentile of the absolute values: more than noise of single pixels.
    """

    stops: NDArray[np.float32]
    relmse: float
    mean_stops: float
    bias_stops: float
    worst_stops: float

    def numbers(self) -> dict[str, Any]:
        """Return the numbers as plain values."""
        return {
            "relmse": self.relmse,
            "mean_stops": self.mean_stops,
            "bias_stops": self.bias_stops,
            "worst_stops": self.worst_stops,
        }

    def rgb(self, range_stops: float = RANGE_STOPS) -> NDArray[np.uint8]:
        """Return the map as a picture (h, w, 3): blue where the second is darker, red where it is brighter."""
        share = np.clip(self.stops / np.float32(range_stops), -1, 1)[..., None]
        darker, equal, brighter = (np.array(colour, np.float32) for colour in (DARKER, EQUAL, BRIGHTER))
        ends = np.where(share < 0, darker, brighter)
        return np.asarray(np.floor(equal + np.abs(share) * (ends - equal) + 0.5), np.uint8)


def legend(range_stops: float = RANGE_STOPS) -> list[dict[str, Any]]:
    """Return stops and colours of the map's ends and middle."""
    return [
        {"stops": -range_stops, "colour": DARKER},
        {"stops": 0.0, "colour": EQUAL},
        {"stops": range_stops, "colour": BRIGHTER},
    ]


def difference(first: NDArray[np.float32], second: NDArray[np.float32]) -> Difference:
    """Return how a film (h, w, 3) differs from another of the same size.

    Raises
    ------
    InputError
        They have other sizes.
    """
    if first.shape != second.shape:
        raise InputError(f"compare: the films have other sizes (got {first.shape} and {second.shape})")
    a, b = first.astype(np.float64), second.astype(np.float64)
    mean_square = float(np.sum(np.square(a.mean(axis=(0, 1)))))
    squares = _tile_means(np.sum(np.square(a), axis=2)) + FLOOR**2 * mean_square
    error = np.sum(np.square(b - a), axis=2)
    relmse = float(np.mean(np.divide(error, squares, out=np.zeros_like(error), where=squares > 0)))
    bright_a, bright_b = luminance(a), luminance(b)
    floor = FLOOR * max(float(bright_a.mean()), float(bright_b.mean()), FLOAT32_MIN_NORMAL)
    stops = np.log2(np.maximum(bright_b, floor) / np.maximum(bright_a, floor))
    size = np.abs(stops)
    return Difference(
        stops.astype(np.float32),
        relmse,
        float(size.mean()),
        float(np.log2(max(bright_b.mean(), floor) / max(bright_a.mean(), floor))),
        float(np.percentile(size, 99.9)),
    )


def _tile_means(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values (h, w), each replaced by the mean of its tile; tiles at the right and the bottom may be smaller."""
    starts = [np.arange(0, size, TILE) for size in values.shape]
    sums = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
    sizes = [np.diff([*start, size]) for start, size in zip(starts, values.shape, strict=True)]
    means = sums / np.outer(*sizes)
    return np.asarray(means.repeat(sizes[0], axis=0).repeat(sizes[1], axis=1))
