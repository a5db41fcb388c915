"""Meshes made by formula, and rays through them."""

import numpy as np


def boxes_of(triangles):
    """Lower and upper corners of triangles (n, 3 vertices, 3)."""
    return triangles.min(axis=1), triangles.max(axis=1)


def soup(count, size=0.05, seed=1):
    """Triangles of all sizes up to `size` all over the unit cube."""
    random = np.random.default_rng(seed)
    scale = size * random.uniform(0, 1, (count, 1, 1)) ** 3
    return (random.uniform(0, 1, (count, 1, 3)) + scale * random.normal(size=(count, 3, 3))).astype(np.float32)


def grid_surface(rows, columns, surface):
    """Triangles between the points surface(u, v), u and v in [0, 1]."""
    u, v = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    p = np.stack(surface(u, v), axis=-1)
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]
    pairs = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)], axis=2)
    return pairs.reshape(-1, 3, 3).astype(np.float32)


def knot(rows=120, columns=20):
    """A tube round a (2, 3) torus knot."""

    def surface(u, v):
        t, a = 2 * np.pi * u, 2 * np.pi * v
        radius = 2 + np.cos(3 * t) + 0.5 * np.cos(a)
        return radius * np.cos(2 * t), -np.sin(3 * t) + 0.5 * np.sin(a), radius * np.sin(2 * t)

    return grid_surface(rows, columns, surface)


def hall():
    """A finely made ball in a hall of large walls."""

    def ball(u, v):
        theta, phi = np.pi * u, 2 * np.pi * v
        return np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)

    walls = [grid_surface(6, 6, lambda u, v, k=k: np.roll([40 * u, 40 * v, 0 * u + k], k)) for k in range(3)]
    return np.concatenate([grid_surface(30, 40, ball) + np.float32(7), *walls])


def rays_through(triangles, count, seed=2):
    """Origins and directions of rays between random points of the box of all triangles."""
    random = np.random.default_rng(seed)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    a, b = low + (high - low) * random.uniform(-0.1, 1.1, (2, count, 3))
    return a, b - a


def nearest(triangles, origins, directions):
    """Smallest positive ray parameter per ray, inf without a hit, by Moeller and Trumbore (1997) in float64."""
    p = triangles.astype(np.float64)
    edge1, edge2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    found = np.full(len(origins), np.inf)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        found[i] = hits(p[:, 0], edge1, edge2, o, d).min(initial=np.inf)
    return found


def hits(corner, edge1, edge2, o, d):
    """Ray parameters of one ray at triangles, inf where it misses."""
    with np.errstate(divide="ignore", invalid="ignore"):
        h = np.cross(d, edge2)
        det = (edge1 * h).sum(1)
        s = o - corner
        u = (s * h).sum(1) / det
        q = np.cross(s, edge1)
        v = (q @ d) / det
        t = (edge2 * q).sum(1) / det
        return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
