"""What is learnt of a picture's noise while its render is under way, and which tiles that leaves to be rendered."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.wavefront.achieved import AchievedNoise, TwoParts, noise_of_runs
from rptcam_cl.wavefront.noise import NoiseEstimate, NoiseReport, next_end
from rptcam_cl.wavefront.several import AnyWavefront


class NoiseWatch:
    """Looks at the film as samples come in: tile by tile where that was asked for, else by two parts of the samples.

    Attributes
    ----------
    estimate : NoiseEstimate or None
        Of the tiles, where there is a target or their variance is a layer.
    """

    def __init__(self, wavefront: AnyWavefront, target: float | None) -> None:
        self._wavefront = wavefront
        asked = target is not None or "variance" in wavefront.settings.layers
        self.estimate = NoiseEstimate(wavefront.layout, target) if asked else None
        self._parts = None if asked else TwoParts(wavefront.layout)

    @property
    def satisfied(self) -> bool:
        """Whether all tiles meet the target."""
        return self.estimate is not None and len(self.estimate.tiles) == 0

    def resume(self, done: int, arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from a film of ``done`` samples per pixel and what `arrays` gave beside it."""
        if self.estimate is not None:
            self.estimate.restore(arrays)
            self._wavefront.choose_tiles(self.estimate.tiles)
        elif self._parts is not None and done:
            self._parts.take(done, self._wavefront.sums())

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what to keep, to go on later."""
        return {} if self.estimate is None else self.estimate.arrays()

    def most(self, done: int, count: int) -> int:
        """Return how many of ``count`` samples may follow before the film has to be looked at."""
        return count if self.estimate is None else min(count, next_end(done) - done)

    def look(self, done: int, *, last: bool) -> None:
        """Look at the film, where ``done`` samples per pixel are a reason to."""
        if self.estimate is not None and done == next_end(done - 1):
            self._wavefront.finish()
            if self.estimate.take(done, self._wavefront.sums()):
                self._wavefront.choose_tiles(self.estimate.tiles)
        if self._parts is not None and not last and self._parts.wants(done):
            self._wavefront.finish()
            self._parts.take(done, self._wavefront.sums())

    def samples_of_tiles(self, done: int) -> NDArray[np.uint32]:
        """Return how many samples per pixel each tile has."""
        if self.estimate is not None:
            return self.estimate.samples_of_tiles(done)
        return np.full(len(self._wavefront.layout.whole_list()), done, np.uint32)

    def variance(self) -> NDArray[np.float32]:
        """Return the variance of each pixel's mean luminance; nan where it was not asked for."""
        if self.estimate is not None:
            return self.estimate.variance
        return np.full(self._wavefront.layout.pixels, np.nan, np.float32)

    def report(self) -> NoiseReport | None:
        """Return how noisy the tiles are, where that was asked for."""
        return None if self.estimate is None else self.estimate.report()

    def achieved(self, done: int, sums: NDArray[np.float32]) -> AchievedNoise | None:
        """Return how noisy the finished picture is."""
        if self._parts is not None:
            return self._parts.report(done, sums)
        return noise_of_runs(self._wavefront.layout, self.samples_of_tiles(done), sums, self.variance())
