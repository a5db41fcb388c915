"""How pictures of one way to render differ from each other and from those of another, by pairs of seeds.

The measure is relMSE, the mean over the picture of |x - r|^2 / (|r|^2 + (0.01 mean r)^2), with vectors of the three
channels and |r|^2 averaged over the tile of 8 x 8 pixels: a pixel's own, known from few samples, would add as much
noise as all that is measured. It comes from pictures of the reference under other seeds than the pair's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.tradeoff.tiles import SpreadTiles

Array = NDArray[np.float64]

EDGE = 0.01  # of the mean: what keeps dark pixels from counting beyond measure


@dataclass(frozen=True)
class PairErrors:
    """The results of every pair of seeds for one configuration; matrices (seeds, seeds) with nothing on the diagonal.

    Attributes
    ----------
    bias : array
        Products of differences from the reference: their mean is the square of the bias, as relMSE.
    noise : tuple of array
        Half the squared difference of two pictures, for each number of samples: its mean is the noise of one.
    brightness : (seeds,) array
        Mean of the picture.
    by_tile : (tiles,) array
        The mean of `bias` in each tile.
    noise_of_tiles : (tiles,) array
        Standard error of `by_tile`, as it is where nothing but noise is measured.
    evenness : float
        Square of the picture's mean over the mean of what squares are relative to: what relMSE a picture has at least
        that is too bright by one on the whole (Cauchy and Schwarz).
    weight_variances : dict
        Variances that the means of `bias` and of the last of `noise` have besides, because the reference that they are
        relative to is known from few seeds itself.
    fall : (2, m) array
        Noise in some of the tiles: with the most samples that all were rendered with, and with many.
    tile_errors : dict
        Standard errors of the means of `bias`, of the last of `noise`, and of `brightness` relative to the reference's,
        that come from rendering some of the tiles only. Cells of a grid are taken for a random sample, which makes them
        too large rather than too small.
    """

    bias: Array
    noise: tuple[Array, ...]
    brightness: Array
    by_tile: Array
    noise_of_tiles: Array
    evenness: float
    weight_variances: dict[str, float]
    tile_errors: dict[str, float]
    fall: Array


@dataclass(frozen=True)
class LongPictures:
    """Pictures of a few of the tiles with many samples, which tell how noise falls.

    Attributes
    ----------
    samples : int
        Samples per pixel.
    chosen : (m,) array
        Which of the tiles.
    pixels : list
        For each configuration, pixels (seeds, p, 3).
    """

    samples: int
    chosen: NDArray[np.int64]
    pixels: list[NDArray[np.float32]]


class _Scales:
    """What squared differences in each tile are divided by, from the pictures of the reference under some seeds."""

    def __init__(self, reference: Array, tiles: SpreadTiles) -> None:
        self.seeds, self._tiles = len(reference), tiles
        self.shares = _sums(np.ones(len(tiles.pixels)), tiles)
        self._pictures, self._total = reference, reference.sum(axis=0)
        self._squares = np.mean(reference**2, axis=2)
        self._all_squares = self._squares.sum(axis=0)
        self._edge = EDGE * float(tiles.weights @ self._total.mean(axis=1)) / self.seeds

    def without(self, *left_out: int) -> Array:
        """Return |r|^2 + (0.01 mean r)^2 of each tile from the other seeds: over pairs, without the noise of either."""
        total, squares, count = self._total, self._all_squares, self.seeds - len(left_out)
        for seed in left_out:
            total, squares = total - self._pictures[seed], squares - self._squares[seed]
        found = (np.mean(total**2, axis=1) - squares) / (count * (count - 1))
        return np.asarray(np.maximum(_sums(found, self._tiles) / self.shares, 0.0) + self._edge**2)


def pair_errors(
    pictures: list[list[NDArray[np.float32]]], samples: tuple[int, ...], tiles: SpreadTiles, long: LongPictures
) -> list[PairErrors]:
    """Return the errors of every configuration; the first is the reference.

    Parameters
    ----------
    pictures
        For each configuration and number of samples, pixels (seeds, p, 3).
    samples
        The numbers of samples per pixel.
    tiles
        Where the pixels are.
    long
        Pictures of more samples.
    """
    part = np.array(samples) / sum(samples)
    means = [
        np.asarray(np.sum([share * stack for share, stack in zip(part, own, strict=True)], axis=0, dtype=np.float64))
        for own in pictures
    ]
    scales = _Scales(means[0], tiles)
    light = [_sums(mean.mean(axis=(0, 2)), tiles) for mean in means]
    few = tiles.some(long.chosen)
    found = []
    for own, more, mean, lit in zip(pictures, long.pixels, means, light, strict=True):
        away = _by_pair(mean - means[0], tiles, _product)
        noises = [_by_pair(stack, tiles, _half_square) for stack in own]
        bias, last = _over_tiles(away, scales), _over_tiles(noises[-1], scales)
        by_tile = {"bias": _mean_of_pairs(away, scales), "noise": _mean_of_pairs(noises[-1], scales)}
        errors = {name: _sampling_error(sums, scales.shares, tiles.all) for name, sums in by_tile.items()}
        found.append(
            PairErrors(
                bias=bias,
                noise=(*(_over_tiles(noise, scales) for noise in noises[:-1]), last),
                brightness=mean.mean(axis=2) @ tiles.weights,
                by_tile=by_tile["bias"] / scales.shares,
                noise_of_tiles=_noise_of_tiles(away, scales) / scales.shares,
                evenness=float(lit.sum()) ** 2 / float(scales.shares @ scales.without()),
                weight_variances={
                    "bias": _weight_variance(away, bias, scales),
                    "noise": _weight_variance(noises[-1], last, scales),
                },
                tile_errors=errors | {"energy": _ratio_error(lit, light[0], scales.shares, tiles.all)},
                fall=_fall(by_tile["noise"][long.chosen], _by_pair(more, few, _half_square), scales, long.chosen),
            )
        )
    return found


def _fall(noise: Array, sums: Array, scales: _Scales, chosen: NDArray[np.int64]) -> Array:
    """Return the noise of some tiles beside that in pictures of more samples."""
    seeds = len(sums)
    return np.stack([noise, sums.sum(axis=(0, 1)) / (seeds * (seeds - 1)) / scales.without()[chosen]])


def _product(first: Array, second: Array) -> Array:
    return np.asarray(np.mean(first * second, axis=1))


def _half_square(first: Array, second: Array) -> Array:
    return np.asarray(np.mean(np.square(first.astype(np.float64) - second), axis=1) / 2)


def _by_pair(values: Any, tiles: SpreadTiles, together: Callable[[Array, Array], Array]) -> Array:
    """Return sums over each tile, shape (seeds, seeds, tiles), of what two pictures of different seeds give."""
    seeds = len(values)
    sums = np.zeros((seeds, seeds, len(tiles.tiles)))
    for s, t in combinations(range(seeds), 2):
        sums[s, t] = sums[t, s] = _sums(together(values[s], values[t]), tiles)
    return sums


def _over_tiles(sums: Array, scales: _Scales) -> Array:
    """Return the matrix (seeds, seeds) of sums over tiles, relative to the reference under other seeds."""
    matrix = np.zeros((scales.seeds, scales.seeds))
    for s, t in combinations(range(scales.seeds), 2):
        matrix[s, t] = matrix[t, s] = float(np.sum(sums[s, t] / scales.without(s, t)))
    return matrix


def _mean_of_pairs(sums: Array, scales: _Scales) -> Array:
    """Return the mean over pairs in each tile, relative to the reference under all seeds."""
    return np.asarray(sums.sum(axis=(0, 1)) / (scales.seeds * (scales.seeds - 1)) / scales.without())


def _noise_of_tiles(sums: Array, scales: _Scales) -> Array:
    """Return the standard error of `_mean_of_pairs`, all pairs being independent, as of pure noise they are."""
    first, second = np.triu_indices(scales.seeds, 1)
    return np.asarray(sums[first, second].std(axis=0) / math.sqrt(len(first)) / scales.without())


def _weight_variance(sums: Array, matrix: Array, scales: _Scales) -> float:
    """Return by how much the variance (jackknife over seeds) grows when what tiles are divided by is found anew."""
    seeds = scales.seeds
    pairs = (seeds - 1) * (seeds - 2)
    all_sums, all_pairs = sums.sum(axis=(0, 1)), matrix.sum()
    anew = [float(np.sum((all_sums - 2 * sums[s].sum(axis=0)) / scales.without(s))) / pairs for s in range(seeds)]
    kept = [(all_pairs - 2 * matrix[s].sum()) / pairs for s in range(seeds)]
    return float(max(np.var(anew) - np.var(kept), 0.0) * (seeds - 1))


def _sums(values: Array, tiles: SpreadTiles) -> Array:
    """Return the weighted sums of pixels (p,) in each tile."""
    return np.asarray(np.bincount(tiles.cell, tiles.weights * values, len(tiles.tiles)), np.float64)


def _sampling_error(sums: Array, shares: Array, all_tiles: int) -> float:
    """Return the standard error of the sum over tiles that are some of all, each of a share of the picture."""
    n = len(sums)
    if n < 2:
        return 0.0
    apart = sums - shares * sums.sum()
    return float(np.sqrt((1 - n / all_tiles) * n / (n - 1) * (apart @ apart)))


def _ratio_error(sums: Array, reference: Array, shares: Array, all_tiles: int) -> float:
    """Return the standard error of the ratio of two sums over tiles."""
    whole = float(reference.sum())
    ratio = float(sums.sum()) / whole
    return _sampling_error(sums - ratio * reference, shares, all_tiles) / abs(whole)
