"""A closed mesh, and directions, to try rays on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def globe(rings: int, segments: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points and faces of a unit sphere of rings and segments, facing outwards, convex and closed."""
    theta = np.pi * np.arange(1, rings) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.outer(np.sin(theta), np.cos(phi)), np.outer(np.sin(theta), np.sin(phi)),
                     np.outer(np.cos(theta), np.ones(segments))], axis=-1)  # fmt: skip
    points = np.concatenate([[[0, 0, 1]], ring.reshape(-1, 3), [[0, 0, -1]]])
    last = len(points) - 1
    faces = []
    for j in range(segments):
        k = (j + 1) % segments
        faces.append((0, 1 + j, 1 + k))
        faces.append((last, last - segments + k, last - segments + j))
        for i in range(rings - 2):
            a, b = 1 + i * segments + j, 1 + i * segments + k
            faces += [(a, a + segments, b + segments), (a, b + segments, b)]
    return points, np.array(faces)


def directions(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return unit vectors, evenly over the sphere."""
    v = rng.standard_normal((count, 3))
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))
