"""How noisy a picture has become, when nobody asked for a noise target: from two parts of its samples.

The film is looked at whenever the samples have doubled, which costs little. At the end the difference between the means
of the samples before and after such a look estimates the variance of the mean of all. Parts of a lattice together are
evener than each alone, so the estimate errs to the safe side (see `rptcam_cl.wavefront.noise`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.wavefront.film import TILE_PIXELS, FilmLayout
from rptcam_cl.wavefront.noise import DARKEST, LUMINANCE

LARGEST_SHARE = 0.875  # of the samples that the first part may hold


@dataclass(frozen=True)
class AchievedNoise:
    """Relative standard errors of a picture's luminance.

    Attributes
    ----------
    picture : float
        Root mean square over the pixels of the standard error of a pixel, divided by the mean of the picture.
    tile_95 : float
        The same per tile of 8 x 8 pixels: the error that 95 of 100 tiles keep. Tiles darker than a twentieth of the
        picture's mean count relative to that.
    source : str
        What it was estimated from: "runs of samples", or "two parts of the samples".
    """

    picture: float
    tile_95: float
    source: str


def noise_of_runs(
    layout: FilmLayout, samples: NDArray[np.uint32], sums: NDArray[np.float32], variance: NDArray[np.float32]
) -> AchievedNoise | None:
    """Return how noisy a picture is whose variance was estimated on the way; None where there is no variance yet.

    Parameters
    ----------
    samples : (tiles of the buffer,) array
        Samples per pixel.
    sums : (6, pixels) array
        Of the film.
    variance : (pixels,) array
        Of the mean luminance.
    """
    mean = _luminance(sums) / np.repeat(np.maximum(samples, 1), TILE_PIXELS)
    return _achieved(layout, mean, variance, "runs of samples")


def _achieved(
    layout: FilmLayout, mean: NDArray[np.floating], variance: NDArray[np.floating], source: str
) -> AchievedNoise | None:
    """Return how noisy a picture is; None where it is black or its noise is not known.

    Parameters
    ----------
    mean, variance : (pixels,) arrays
        Mean luminance of each pixel of the film's buffer, and the variance of that mean.
    """
    inside, pixels = layout.inside, layout.pixels_of_tile[: layout.tiles]
    tiles = [
        np.where(inside, values, 0).reshape(-1, TILE_PIXELS).sum(axis=1, dtype=np.float64)
        for values in (mean, variance)
    ]
    means, variances = (values[: layout.tiles] for values in tiles)
    whole = float(means.sum() / pixels.sum())
    if not (whole > 0 and np.isfinite(variances).all()):
        return None
    errors = np.sqrt(variances / pixels) / np.maximum(means / pixels, DARKEST * whole)
    picture = float(np.sqrt(variances.sum() / pixels.sum())) / whole
    return AchievedNoise(picture, float(np.quantile(errors, 0.95)), source)


class TwoParts:
    """Looks at the film of a render under way, so that its noise can be told at the end."""

    def __init__(self, layout: FilmLayout) -> None:
        self._layout = layout
        self._looks: list[tuple[int, NDArray[np.float32]]] = []  # the last two: samples, and the sum of luminance

    def wants(self, done: int) -> bool:
        """Return whether the film should be looked at after ``done`` samples per pixel."""
        return not self._looks or done >= 2 * self._looks[-1][0]

    def take(self, done: int, sums: NDArray[np.float32]) -> None:
        """Look at the film's sums (6, pixels) after ``done`` samples per pixel."""
        self._looks = [*self._looks[-1:], (done, _luminance(sums))]

    def report(self, done: int, sums: NDArray[np.float32]) -> AchievedNoise | None:
        """Return how noisy the picture is in the end; None where all its samples came at once."""
        earlier = [look for look in self._looks if look[0] <= LARGEST_SHARE * done]
        if not earlier:
            return None
        first, before = earlier[-1]
        second, luminance = done - first, _luminance(sums)
        difference = before / first - (luminance - before) / second
        variance = difference**2 * (first * second / done**2)
        return _achieved(self._layout, luminance / done, variance, "two parts of the samples")


def _luminance(sums: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the sum of luminance per pixel, in float32: what is asked for is noise, far above its rounding."""
    weights = LUMINANCE.astype(np.float32)
    return np.asarray(weights @ sums[:3] - weights @ sums[3:])
