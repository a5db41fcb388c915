"""How pictures of one way to render differ from each other and from those of another, by pairs of seeds.

The measure is relMSE, the mean over the picture of |x - r|^2 / (|r|^2 + (0.01 mean r)^2), with vectors of the three
channels and |r|^2 averaged over the tile of 8 x 8 pixels: a pixel's own, known from few samples, would add as much noise
as all that is measured. It comes from pictures of the reference under other seeds than the pair's.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.tradeoff.tiles import SpreadTiles

Array = NDArray[np.float64]

EDGE = 0.01  # of the mean: what keeps dark pixels from counting beyond measure


@dataclass(frozen=True)
class PairErrors:
    """What every pair of seeds tells of one configuration; matrices (seeds, seeds) with nothing on the diagonal.

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
    tile_errors : dict
        Standard errors of the means of `bias`, of the last of `noise`, and of `brightness` relative to the reference's,
        that come from rendering some of the tiles only. Cells of a grid are taken for a random sample, which makes them
        too large rather than too small.
    """

    bias: Array
    noise: tuple[Array, ...]
    brightness: Array
    by_tile: Array
    tile_errors: dict[str, float]


def pair_errors(
    pictures: list[list[NDArray[np.float32]]], samples: tuple[int, ...], tiles: SpreadTiles
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
    """
    share = np.array(samples) / sum(samples)
    seeds, count = len(pictures[0][0]), len(tiles.tiles)
    means = [sum(part * stack.astype(np.float64) for part, stack in zip(share, own, strict=True)) for own in pictures]
    reference = np.asarray(means[0])
    total = reference.sum(axis=0)
    squares = np.mean(reference**2, axis=2)
    edge = EDGE * float(tiles.weights @ total.mean(axis=1)) / seeds
    share_of_tile = _sums(np.ones(len(tiles.pixels)), tiles)
    bias = np.zeros((len(pictures), seeds, seeds))
    noise = np.zeros((len(pictures), len(samples), seeds, seeds))
    by_tile = np.zeros((2, len(pictures), count))  # bias and noise
    for s, t in combinations(range(seeds), 2):
        others = np.mean((total - reference[s] - reference[t]) ** 2, axis=1)  # over pairs of the others, without noise:
        others = (others - squares.sum(axis=0) + squares[s] + squares[t]) / ((seeds - 2) * (seeds - 3))
        weights = tiles.weights / (np.maximum(_sums(others, tiles) / share_of_tile, 0.0) + edge**2)[tiles.cell]
        for index, own in enumerate(pictures):
            product = weights * np.mean((means[index][s] - reference[s]) * (means[index][t] - reference[t]), axis=1)
            bias[index, s, t] = bias[index, t, s] = product.sum()
            by_tile[0, index] += np.bincount(tiles.cell, product, count)
            for k, stack in enumerate(own):
                apart = weights * np.mean(np.square(stack[s].astype(np.float64) - stack[t]), axis=1) / 2
                noise[index, k, s, t] = noise[index, k, t, s] = apart.sum()
            by_tile[1, index] += np.bincount(tiles.cell, apart, count)
    by_tile *= 2 / (seeds * (seeds - 1))
    light = np.array([_sums(np.asarray(mean).mean(axis=(0, 2)), tiles) for mean in means])
    return [
        PairErrors(
            bias=bias[i],
            noise=tuple(noise[i]),
            brightness=np.asarray(means[i]).mean(axis=2) @ tiles.weights,
            by_tile=by_tile[0, i] / share_of_tile,
            tile_errors={
                "bias": _sampling_error(by_tile[0, i], share_of_tile, tiles.all),
                "noise": _sampling_error(by_tile[1, i], share_of_tile, tiles.all),
                "energy": _ratio_error(light[i], light[0], share_of_tile, tiles.all),
            },
        )
        for i in range(len(pictures))
    ]


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
