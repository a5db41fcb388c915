"""Perlin's noise of 2002 in float64, and the textures that pbrt makes of it."""

import numpy as np

from rptcam_cl.rendering.plan.textures import PERMUTATION

TABLE = np.frombuffer(2 * PERMUTATION, np.uint8).astype(int)
# The twelve edges of a cube, four of them twice, by the last four bits, as pbrt has them.
EDGES = np.array([
    (1, 1, 0), (-1, 1, 0), (1, -1, 0), (-1, -1, 0), (1, 0, 1), (-1, 0, 1), (1, 0, -1), (-1, 0, -1),
    (0, 1, 1), (0, -1, 1), (0, 1, -1), (0, -1, -1), (1, 1, 0), (-1, 1, 0), (0, 1, -1), (0, -1, -1),
])  # fmt: skip


def perlin(places):
    """Noise at places (3, n)."""
    cell = np.floor(places).astype(int)
    offset = places - cell
    fade = offset**3 * (10 - 15 * offset + 6 * offset**2)
    total = np.zeros(places.shape[1])
    for corner in np.ndindex(2, 2, 2):
        x, y, z = (cell & 255) + np.array(corner)[:, None]
        slopes = EDGES[TABLE[TABLE[TABLE[x] + y] + z] & 15]
        share = np.prod(np.where(np.array(corner)[:, None], fade, 1 - fade), axis=0)
        total += share * np.sum(slopes.T * (offset - np.array(corner)[:, None]), axis=0)
    return total


def summed(places, octaves=8, gain=0.5, size=lambda noise: noise):
    """Octaves of noise at places (3, n)."""
    return sum(gain**k * size(perlin(1.99**k * places)) for k in range(octaves))
