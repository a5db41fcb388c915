"""How noise falls with the samples of a pixel: on a lattice faster than 1 / n, and not at one rate for ever."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

INDEPENDENT = -1.0  # exponent for independent samples
STEEPEST, FLATTEST = -2.5, -0.5  # exponents beyond which what was seen is chance


@dataclass(frozen=True)
class NoiseLaw:
    """relMSE of the noise over samples per pixel: powers that meet at two numbers of samples.

    Attributes
    ----------
    samples : (float, float)
    noise : (value, value)
        At these; numbers, or arrays with a value for each replicate.
    before, beyond : value
        Exponents of the samples below the first number and above the second.
    """

    samples: tuple[float, float]
    noise: tuple[Any, Any]
    before: Any
    beyond: Any

    @property
    def between(self) -> Any:
        """Exponent of the samples between the two numbers."""
        first, last = self.noise
        with np.errstate(divide="ignore", invalid="ignore"):
            found = np.log(np.divide(last, first)) / np.log(self.samples[1] / self.samples[0])
        return np.clip(np.where(np.isfinite(found), found, INDEPENDENT), STEEPEST, FLATTEST)

    def after(self, samples: Any) -> Any:
        """Return the noise after samples per pixel, which may be a share of one."""
        at, last = self.samples
        middle = self.noise[0] * (samples / at) ** np.where(samples < at, self.before, self.between)
        return np.where(samples > last, self.noise[1] * (samples / last) ** self.beyond, middle)

    def until(self, noise: Any) -> Any:
        """Return the samples per pixel after which the noise is what is given, above 0; 0 where there is none."""
        at, last = self.samples
        with np.errstate(divide="ignore", invalid="ignore"):
            middle = at * np.divide(noise, self.noise[0]) ** (1 / np.where(noise > self.noise[0], self.before, self.between))
            return np.where(noise < self.noise[1], last * np.divide(noise, self.noise[1]) ** (1 / self.beyond), middle)


def noise_law(samples: tuple[int, int, int], noise: Array, fall: tuple[float, float], before: Array) -> NoiseLaw:
    """Return the law of noise for each replicate, the first of which is the estimate.

    Beyond the most samples that were rendered noise may go on as it fell last, or as that of independent samples: the
    estimate is halfway, the replicates lie all over.

    Parameters
    ----------
    samples
        Numbers of samples that were rendered, rising.
    noise
        After the middle one.
    fall
        What is left of it after the last, and the relative standard error of that.
    before
        Exponent between the first two.
    """
    rng = np.random.default_rng(len(noise))
    left, error = fall
    apart = rng.standard_normal(len(noise))
    share = rng.random(len(noise))
    apart[0], share[0] = 0.0, 0.5
    steepness = np.log(samples[2] / samples[1])
    last = noise * np.clip(left * np.exp(error * apart), np.exp(STEEPEST * steepness), np.exp(FLATTEST * steepness))
    law = NoiseLaw(samples[1:], (noise, last), np.clip(before, STEEPEST, FLATTEST), INDEPENDENT)
    return NoiseLaw(law.samples, law.noise, law.before, INDEPENDENT + share * (law.between - INDEPENDENT))
