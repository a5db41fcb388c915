"""Histograms and clipping counts.

`histogram` counts the display codes 0 to 255 of the developed picture, as the back of a camera shows it; luminance is
the luma of ITU-R BT.709-6. `stop_histogram` counts film values by thirds of a stop about middle grey, for those who
develop from the linear file; `raw_histogram` counts the numbers of a sensor. What is clipped is counted on the film, or
on the sensor, and never on the developed picture.
"""

from __future__ import annotations

import math
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import luminance
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.imaging import RawImage

MIDDLE_GREY = 0.18
CODES = 256
MOST_PIXELS = 1 << 16
DARKEST_EV, BRIGHTEST_EV, PER_STOP = -10, 6, 3
CHANNELS = ("red", "green", "blue")
DARK_VALUE = 0.5 / 255 / 12.92  # film values below it are shown as code 0: the foot of sRGB (IEC 61966-2-1)
RAW_BINS = 256


@dataclass(frozen=True)
class Clipping:
    """Pixels whose light is lost.

    Attributes
    ----------
    pixels : int
        Counted.
    high : dict
        How many reach white, by ``any``, ``luminance``, ``red``, ``green`` and ``blue``.
    low : dict
        How many are black, in the same way; ``any`` counts those that are black in all channels.
    """

    pixels: int
    high: dict[str, int]
    low: dict[str, int]

    def as_dict(self) -> dict[str, Any]:
        """Return the counts as plain values."""
        return {"pixels": self.pixels, "high": dict(self.high), "low": dict(self.low)}


@dataclass(frozen=True)
class Histogram:
    """Counts by brightness.

    Attributes
    ----------
    counts : dict
        Arrays of counts by channel: ``luminance``, ``red``, ``green``, ``blue``, or those of a sensor.
    edges : array
        Of the bins, one more than there are.
    scale : str
        What the edges are: ``display code``, ``stops`` about middle grey, or ``DN``.
    samples : int
        Pixels that were counted.
    clipped : Clipping or None
        Of the film, where it is known.
    """

    counts: dict[str, NDArray[np.int64]]
    edges: NDArray[np.float64]
    scale: str
    samples: int
    clipped: Clipping | None = None
    notes: dict[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the histogram as plain values, the channels by their names."""
        clipped = {} if self.clipped is None else {"clipped": self.clipped.as_dict()}
        counts = {name: values.tolist() for name, values in self.counts.items()}
        ends = [float(self.edges[0]), float(self.edges[-1])]
        return (
            counts
            | {"edges": ends, "bins": len(self.edges) - 1, "scale": self.scale, "samples": self.samples}
            | (clipped | self.notes)
        )


def thinned(picture: NDArray[Any], most: int = MOST_PIXELS) -> NDArray[Any]:
    """Return evenly spaced pixels of a picture, about as many as `most`: single ones, as means would hide extremes."""
    step = max(1, math.ceil(math.sqrt(picture.shape[0] * picture.shape[1] / most)))
    return picture[step // 2 :: step, step // 2 :: step]


def histogram(
    picture: NDArray[np.uint8], pixels: NDArray[np.float32] | None = None, most: int = MOST_PIXELS
) -> Histogram:
    """Return how many pixels of a developed picture have each display code.

    Parameters
    ----------
    picture
        (height, width, 3), 8 bits.
    pixels
        The film (height, width, 3), whose clipping is counted.
    most
        Pixels to count at most, about; the clipping counts them all.
    """
    codes = thinned(picture, most).reshape(-1, 3)
    luma = np.floor(luminance(codes, np.float32) + np.float32(0.5)).astype(np.uint8)
    counts = {"luminance": np.bincount(luma, minlength=CODES)}
    counts |= {name: np.bincount(codes[:, k], minlength=CODES) for k, name in enumerate(CHANNELS)}
    edges = np.arange(CODES + 1, dtype=np.float64) - 0.5
    return Histogram(counts, edges, "display code", len(codes), None if pixels is None else clipping(pixels))


def stop_histogram(pixels: NDArray[np.float32], most: int = MOST_PIXELS) -> Histogram:
    """Return how many pixels of a film lie in each third of a stop about middle grey; the ends take what is beyond."""
    values = thinned(pixels, most).reshape(-1, 3)
    bins = (BRIGHTEST_EV - DARKEST_EV) * PER_STOP
    series = {"luminance": luminance(values, np.float32)} | {name: values[:, k] for k, name in enumerate(CHANNELS)}
    counts = {}
    for name, channel in series.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            stops = np.log2(channel.astype(np.float64) / MIDDLE_GREY)
        place = np.floor((np.nan_to_num(stops, nan=-99.0, neginf=-99.0, posinf=99.0) - DARKEST_EV) * PER_STOP)
        counts[name] = np.bincount(np.clip(place, 0, bins - 1).astype(np.int64), minlength=bins)
    return Histogram(counts, np.linspace(DARKEST_EV, BRIGHTEST_EV, bins + 1), "stops", len(values))


def raw_histogram(raw: RawImage) -> Histogram:
    """Return how many numbers of a sensor lie in each of 256 bins, by the colours of its mosaic, all pixels counted."""
    sensor, numbers = raw.sensor, raw.numbers
    width = max(1, (sensor.top_dn + 1) // RAW_BINS)
    bins = -(-(sensor.top_dn + 1) // width)
    counts = {
        name: np.bincount(np.concatenate([plane.ravel() for plane in planes]) // width, minlength=bins)
        for name, planes in _planes(numbers, sensor.pattern).items()
    }
    notes = {"black_dn": sensor.black_level_dn, "white_dn": sensor.white_level_dn}
    notes["saturated"] = int(np.count_nonzero(numbers >= math.floor(sensor.white_level_dn)))
    return Histogram(counts, np.arange(bins + 1, dtype=np.float64) * width, "DN", numbers.size, None, notes)


def _planes(numbers: NDArray[np.uint16], pattern: str) -> dict[str, list[NDArray[np.uint16]]]:
    """Return the numbers of each colour of a mosaic."""
    if numbers.ndim == 3:
        return {name: [numbers[..., k]] for k, name in enumerate(CHANNELS)}
    if len(pattern) != 4:
        return {"luminance": [numbers]}
    planes: dict[str, list[NDArray[np.uint16]]] = {name: [] for name in CHANNELS}
    for place, letter in enumerate(pattern):
        planes[CHANNELS["RGB".index(letter)]].append(numbers[place // 2 :: 2, place % 2 :: 2])
    return planes


def clipping(pixels: NDArray[np.float32]) -> Clipping:
    """Return how many pixels of a film reach white, 1, and how many are so dark that they are shown as code 0."""
    series = {"any": strongest(pixels), "luminance": luminance(pixels, np.float32)}
    series |= {name: pixels[..., k] for k, name in enumerate(CHANNELS)}
    high = {name: int(np.count_nonzero(values >= 1)) for name, values in series.items()}
    low = {name: int(np.count_nonzero(values < DARK_VALUE)) for name, values in series.items()}
    return Clipping(pixels.shape[0] * pixels.shape[1], high, low)


def strongest(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the largest channel (h, w) of each pixel, in a tenth of the time of a maximum along the last axis."""
    return np.maximum(np.maximum(pixels[..., 0], pixels[..., 1]), pixels[..., 2])
