"""Sensors for tests, and what EMVA 1288 measures of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.colour import electrons_per_joule
from rptcam_cl.imaging.development import SensorModel

STRIPS = 16
Numbers = NDArray[np.uint16]
Estimate = tuple[float, float]  # and its standard error


def sensor(response: str | None = None, **changes: Any) -> SensorModel:
    """Return a sensor of 30000 electrons, which the film's 1 of white fills, behind 14 bits."""
    per_joule = electrons_per_joule(response, (0.5, 0.5, 0.5))
    keys: dict[str, Any] = {
        "electrons": per_joule / per_joule.sum(axis=0).max() * 30000,
        "full_well_e": 30000.0,
        "read_noise_e": 3.0,
        "system_gain_dn_per_e": (16383 - 512) / 30000,
        "black_level_dn": 512.0,
        "bit_depth": 14,
        "bayer": "RGGB",
    }
    return SensorModel(**keys | changes)


def flat(value: float | Sequence[float], size: int = 64) -> NDArray[np.float32]:
    return np.broadcast_to(np.asarray(value, np.float32), (size, size, 3))


@dataclass(frozen=True)
class Transfer:
    """What a photon transfer curve tells, each with its standard error."""

    gain: Estimate
    read_noise_e: Estimate
    full_well_e: Estimate


def photon_transfer(frame: Callable[[float, int], NDArray[Any]], levels: Sequence[float], beyond: float) -> Transfer:
    """Return gain, dark noise and saturation capacity by the photon transfer method of EMVA 1288 (release 3.1, 6.6).

    Differences of two frames leave the temporal noise alone, so that film noise and fixed patterns cancel. The spread
    over strips of the frame tells the errors.

    Parameters
    ----------
    frame
        Returns the raw numbers of a flat field of a level, with noise of a seed.
    levels
        Between 0 and saturation.
    beyond
        A level above saturation.
    """
    dark_mean, dark_variance = _mean_and_variance(frame(0.0, 0), frame(0.0, 1))
    points = [_mean_and_variance(frame(level, 2 * i), frame(level, 2 * i + 1)) for i, level in enumerate(levels, 1)]
    means = np.array([mean - dark_mean for mean, _ in points])
    variances = np.array([variance - dark_variance for _, variance in points])
    weights = 1 / np.array([variance.mean() for _, variance in points])[:, None] ** 2
    gain = (weights * means * variances).sum(axis=0) / (weights * means**2).sum(axis=0)
    noise = np.sqrt(dark_variance - 1 / 12) / gain  # the converter's rounding taken off
    top, _ = _mean_and_variance(frame(beyond, 998), frame(beyond, 999))
    return Transfer(_estimate(gain), _estimate(noise), _estimate((top - dark_mean) / gain))


def _mean_and_variance(first: NDArray[Any], second: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return mean and temporal variance of each strip."""
    a, b = (np.asarray(numbers, np.float64).reshape(STRIPS, -1) for numbers in (first, second))
    return (a + b).mean(axis=1) / 2, (a - b).var(axis=1) / 2


def _estimate(strips: NDArray[np.float64]) -> Estimate:
    return float(strips.mean()), float(strips.std(ddof=1) / np.sqrt(STRIPS))
