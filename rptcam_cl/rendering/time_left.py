"""How long a render with a noise target still takes: the samples that its tiles need, at the speed of late."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.noise import NoiseEstimate, run_length

RECENT = 2 / 3  # of the time so far, after which the speed counts: fewer tiles use a device less well
LEAST_POWER, MOST_POWER = 0.5, 1.0
MOST_SAMPLES = 2**32 - 1
FEW = 0.05  # share of the tiles whose noise is said when no more are left


@dataclass(frozen=True)
class TilesLeft:
    """The tiles that do not meet the noise target yet.

    Attributes
    ----------
    count : int
    worst, target : float
        Relative standard error of the noisiest of them, and the one requested.
    samples : float
        Of all their pixels, still to be made.
    seconds : float
        For those [s].
    few : bool
        Whether most of the picture is done, so that it is worth saying why it goes on.
    """

    count: int
    worst: float
    target: float
    samples: float
    seconds: float
    few: bool


class TimeLeft:
    """Foretells the end of a render with a noise target, from its reports.

    The error of a tile falls by a power of its samples: 1/2 for independent ones, more where the lattice helps. The
    power is that of the median tile since it had half of its samples. A tile then needs (error / target)^(1 / power)
    times its samples, up to the end of a run, where the decision is made. Samples go at the speed of late.
    """

    def __init__(self) -> None:
        self._marks = [(0.0, 0)]  # seconds, samples of all pixels
        self._errors: list[tuple[int, NDArray[np.float32]]] = []  # samples per pixel, error of each tile

    def note(self, seconds: float, samples: int) -> None:
        """Note how many samples of all pixels were made after so many seconds."""
        while len(self._marks) > 1 and self._marks[1][0] <= RECENT * seconds:
            self._marks.pop(0)
        if seconds > self._marks[-1][0]:
            self._marks.append((seconds, samples))

    def tiles_left(self, estimate: NoiseEstimate | None, done: int, most: int | None) -> TilesLeft | None:
        """Return what is left; None without a target, before the noise is known, and when all tiles meet it.

        Parameters
        ----------
        done
            Samples per pixel of the tiles that are still rendered.
        most
            Samples per pixel at which the render ends in any case.
        """
        if estimate is None or estimate.target is None or not estimate.measured_at or not len(estimate.tiles):
            return None
        (since, before), (now, made) = self._marks[0], self._marks[-1]
        if made <= before:
            return None
        errors = estimate.error[estimate.tiles].astype(np.float64)
        needed = estimate.measured_at * (errors / estimate.target) ** (1 / self._power(estimate))
        needed = np.array([_run_end(max(value, done + 1)) for value in np.minimum(needed, MOST_SAMPLES)])
        if most is not None:
            needed = np.minimum(needed, most)
        samples = float(((needed - done) * estimate.layout.pixels_of_tile[estimate.tiles]).sum())
        return TilesLeft(
            len(errors), float(errors.max()), estimate.target, samples, samples * (now - since) / (made - before),
            len(errors) <= FEW * estimate.layout.tiles,
        )  # fmt: skip

    def _power(self, estimate: NoiseEstimate) -> float:
        """Return by which power of the samples the errors of the tiles fall."""
        count = estimate.measured_at
        if not self._errors or self._errors[-1][0] != count:
            self._errors.append((count, estimate.error.copy()))
        while len(self._errors) > 1 and self._errors[1][0] <= count / 2:
            self._errors.pop(0)
        first, then = self._errors[0]
        if first > count / 2:
            return LEAST_POWER
        with np.errstate(divide="ignore", invalid="ignore"):
            falls = np.log(then[estimate.tiles] / estimate.error[estimate.tiles]) / np.log(count / first)
        falls = falls[np.isfinite(falls)]
        return float(np.clip(np.median(falls), LEAST_POWER, MOST_POWER)) if len(falls) else LEAST_POWER


def _run_end(samples: float) -> float:
    length = run_length(int(samples) - 1)
    return float(np.ceil(samples / length) * length)
