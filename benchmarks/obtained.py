"""What a render errs by and takes, against a longer render of the most accurate configuration."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from benchmarks.stopwatch import cores
from rptcam_cl.api.job import render
from rptcam_cl.device.session import Session
from rptcam_cl.scene.scene import Scene

Picture = NDArray[np.float64]

EDGE = 0.01  # of the mean: what keeps dark pixels from counting beyond measure
TILE = 8


@dataclass(frozen=True)
class Obtained:
    """What some renders with different seeds came to.

    Attributes
    ----------
    seconds : float
        Time of one of them, start and compilation left out: on a processor the CPU time divided by the cores.
    relmse, uncertainty : float
        Their mean squared error, and its standard error.
    """

    seconds: float
    relmse: float
    uncertainty: float

    @property
    def error(self) -> float:
        """Root of relMSE; 0 where nothing could be seen above the noise of the reference."""
        return math.sqrt(max(self.relmse, 0.0))

    def ends(self, sigmas: float = 2.0) -> tuple[float, float]:
        """Return the error with its uncertainty taken off and added."""
        off = sigmas * self.uncertainty
        return math.sqrt(max(self.relmse - off, 0.0)), math.sqrt(max(self.relmse + off, 0.0))


class Reference:
    """Independent pictures of the most accurate configuration: products of differences from two are free of noise."""

    def __init__(self, pictures: list[Picture]) -> None:
        self.pictures = pictures
        self._pairs = list(combinations(range(len(pictures)), 2))
        mean = float(np.mean(pictures))
        squares = np.mean([np.mean(pictures[i] * pictures[j], axis=2) for i, j in self._pairs], axis=0)
        self._scale = np.maximum(_over_tiles(squares), 0.0) + (EDGE * mean) ** 2

    def relmse(self, picture: Picture) -> NDArray[np.float64]:
        """Return the error of a picture by each pair of references."""
        apart = [picture - other for other in self.pictures]
        return np.array([float((np.mean(apart[i] * apart[j], axis=2) / self._scale).mean()) for i, j in self._pairs])

    def of(self, pictures: list[Picture], seconds: float) -> Obtained:
        """Return the mean error of pictures, uncertain by their own spread and by that of the references."""
        found = np.array([self.relmse(picture) for picture in pictures])
        own = float(found.mean(axis=1).var(ddof=1)) / len(pictures)
        count = len(self.pictures)
        without = [found[:, [k not in pair for pair in self._pairs]].mean() for k in range(count)]
        others = (count - 1) * float(np.var(without))  # jackknife
        return Obtained(seconds, float(found.mean()), math.sqrt(own + others))


def rendered(scene: Scene, session: Session, samples: int, seeds: list[int]) -> tuple[list[Picture], float]:
    """Return pictures of a scene, and the time of one of them without start and compilation [s]."""
    by_cpu = session.info.type == "cpu"

    def taken(count: int, seed: int) -> tuple[Picture, float]:
        wall, cpu = time.perf_counter(), time.process_time()
        image = render(scene, spp=count, seed=seed, device=session)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        return np.asarray(image, np.float64), cpu / cores() if by_cpu else wall

    taken(1, 0)  # compiles
    least = min(taken(1, 0)[1] for _ in range(2))
    runs = [taken(samples, seed) for seed in seeds]
    each = max(min(seconds for _, seconds in runs) - least, 0.0)
    return [picture for picture, _ in runs], each * samples / max(samples - 1, 1)


def _over_tiles(values: Picture) -> Picture:
    """Return the mean of each tile of 8 x 8 pixels, or of what is left of it at the edges, in each of its pixels."""
    rows, columns = (np.arange(size) // TILE for size in values.shape)
    tile = rows[:, None] * (columns[-1] + 1) + columns
    means = np.bincount(tile.ravel(), values.ravel()) / np.bincount(tile.ravel())
    return np.asarray(means[tile])
