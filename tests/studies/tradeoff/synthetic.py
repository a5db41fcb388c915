"""Pictures whose noise and bias are known: pixels in tiles, of which all or some are rendered."""

import numpy as np

from rptcam_cl.studies.tradeoff_errors import LongPictures, SpreadTiles, draws, measurements, pair_errors

PER_TILE = 64
SAMPLES = (2, 8)
MANY = 128  # samples of a quarter of the tiles, two seeds
SEEDS = 8
SECONDS = 0.01  # of a sample
NOISE = 1.0  # relMSE of one sample, on pixels of 1


def spread(rendered, every):
    """Tiles of a few pixels each."""
    cell = np.repeat(np.arange(rendered), PER_TILE)
    weights = np.full(rendered * PER_TILE, 1 / (rendered * PER_TILE))
    return SpreadTiles(np.arange(rendered, dtype=np.uint32), (1, rendered), np.arange(len(cell)), cell, weights, every)


def noise_of(rng, samples, fall, shape):
    """Skewed noise with a variance of NOISE / samples**fall."""
    count = samples**fall / NOISE
    return rng.gamma(count, 1 / count, shape) - 1


def pictures_of(mean, rng, common, fall):
    """Pictures (seeds, p, 3) for each number of samples: ``mean`` with skewed noise, partly that of ``common``."""
    found = []
    for count, shared in zip(SAMPLES, common, strict=True):
        own = noise_of(rng, count, fall, shared.shape)
        found.append((mean[:, None] + 0.8 * shared + 0.6 * own).astype(np.float32))
    return found


def measured(rng, bias, rendered, every, replicates=500, fall=1.0):
    """Measurements of a reference of 1 everywhere, and of a configuration that is off by ``bias`` in each pixel of all.

    The tiles that are rendered are the first of a random order. Noise falls with so high a power of the samples.
    """
    tiles = spread(rendered, every)
    seen = bias.reshape(every, PER_TILE)[rng.permutation(every)[:rendered]].ravel()
    shape = (SEEDS, rendered * PER_TILE, 3)
    common = [noise_of(rng, count, fall, shape) for count in SAMPLES]
    reference = [(1 + shared).astype(np.float32) for shared in common]
    chosen = np.sort(rng.choice(rendered, max(rendered // 4, 4), replace=False))
    there = np.isin(tiles.cell, chosen)
    more = 1 + noise_of(rng, MANY, fall, (2, 2, int(there.sum()), 3))
    long = [
        (apart[:, None] + noise).astype(np.float32)
        for apart, noise in zip((0 * seen[there], seen[there]), more, strict=True)
    ]
    errors = pair_errors(
        [reference, pictures_of(1 + seen, rng, common, fall)], SAMPLES, tiles, LongPictures(MANY, chosen, long)
    )
    times = [(scale * SECONDS * rng.lognormal(0, 0.1, SEEDS),) * 2 for scale in (2, 1)]
    named = [
        {"name": name, "knob": knob, "same_as": (), "settings": (), "tier": "", "unbiased": False, "start_s": 0.0}
        for name, knob in (("full", ""), ("other", "camera"))
    ]
    return measurements(named, errors, times, (*SAMPLES, MANY), draws(SEEDS, rng, replicates))
