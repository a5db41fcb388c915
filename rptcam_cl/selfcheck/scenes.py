"""Scenes and rays that are hard: many primitives of every kind, a closed mesh, rays along axes."""

from __future__ import annotations

from typing import Any

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


Array = NDArray[np.float64]
MATTE = {"kind": "matte", "reflectance": 0.6}
NET = {"kind": "matte", "reflectance": 0.6, "opacity": {"kind": "checker", "even": 1, "odd": 0.3, "scale": [6, 6]}}
LAMP = {"kind": "emissive", "radiance": 4}
KINDS = ("sphere", "ellipsoid", "rectangle", "disk", "box", "cylinder", "cone")


def one(kind: str, center: Array, size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return an object of a kind about a place, turned at random."""
    a, b = directions(rng, 2) * size
    at = center.tolist()
    shapes: dict[str, dict[str, Any]] = {
        "sphere": {"shape": "sphere", "center": at, "radius": size},
        "ellipsoid": {
            "shape": "sphere", "center": [0, 0, 0], "radius": size,
            "transform": [{"scale": [1, 0.3, 2]}, {"rotate": {"axis": a.tolist(), "degrees": 50}}, {"translate": at}],
        },
        "rectangle": {"shape": "rectangle", "corner": at, "edge_u": (2 * a).tolist(), "edge_v": (a + b).tolist()},
        "disk": {"shape": "disk", "center": at, "normal": a.tolist(), "radius": size},
        "box": {
            "shape": "box", "min": [-size, -size, -size], "max": [size, 0.3 * size, 2 * size],
            "transform": [{"rotate": {"axis": b.tolist(), "degrees": 70}}, {"translate": at}],
        },
        "cylinder": {"shape": "cylinder", "base": at, "top": (center + 2 * a).tolist(), "radius": 0.4 * size},
        "cone": {"shape": "cone", "base": at, "apex": (center + 3 * a).tolist(), "radius": size},
    }  # fmt: skip
    return shapes[kind]


def upright(kind: str, center: Array, size: float) -> dict[str, Any]:
    """Return an object of a kind whose planes and axes are those of the world: its box is flat, or touched all over."""
    at, x, y = center.tolist(), [size, 0, 0], [0, size, 0]
    shapes: dict[str, dict[str, Any]] = {
        "sphere": {"shape": "sphere", "center": at, "radius": size},
        "ellipsoid": {"shape": "sphere", "center": at, "radius": size, "transform": [{"scale": [1, 1, 0.5]}]},
        "rectangle": {"shape": "rectangle", "corner": at, "edge_u": x, "edge_v": y},
        "disk": {"shape": "disk", "center": at, "normal": [0, 1, 0], "radius": size},
        "box": {"shape": "box", "min": at, "max": (center + size).tolist()},
        "cylinder": {"shape": "cylinder", "base": at, "top": (center + x).tolist(), "radius": size / 2},
        "cone": {"shape": "cone", "base": at, "apex": (center + y).tolist(), "radius": size / 2},
    }
    return shapes[kind]


def crowd(rng: np.random.Generator, count: int, place: Any = (0, 0, 0), holes: bool = True) -> list[dict[str, Any]]:
    """Return ``count`` objects of every kind within [-1, 1]^3 about a place, a few of them twice, and a plane below."""
    place = np.asarray(place, np.float64)
    grid = np.round(rng.uniform(-1, 1, (count, 3)) * 8) / 8
    items = []
    for index, center in enumerate(grid):
        kind, size = KINDS[index % len(KINDS)], float(rng.choice([0.03, 0.125, 0.25]))
        item = upright(kind, place + center, size) if index % 3 == 0 else one(kind, place + center, size, rng)
        items.append(item | {"material": NET if holes and index % 5 == 0 else MATTE})
    items += items[:: max(count // 15, 1)]  # at equal distance: the first of the list counts
    plane = {"shape": "plane", "point": (place - [0, 1.5, 0]).tolist(), "normal": [0, 1, 0]}
    plane["material"] = NET if holes else MATTE
    return [*items, plane]


def random_rays(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return rays from in and about [-1, 1]^3."""
    return rng.uniform(-2, 2, (count, 3)), directions(rng, count)


def axis_rays(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return rays along an axis, through the planes that upright objects lie in, with zeros of both signs."""
    o = np.round(rng.uniform(-1.5, 1.5, (count, 3)) * 16) / 16
    axis, sign = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
    d = np.where(rng.random((count, 3)) < 0.5, 0.0, -0.0)
    d[np.arange(count), axis] = sign
    return o, d


def slanting_rays(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return rays that almost lie in such a plane."""
    o, d = axis_rays(rng, count)
    d += rng.choice([0.0, 1e-30, -1e-30, 1e-8, -1e-8, 1e-4], (count, 3))
    return o, d / np.linalg.norm(d, axis=1, keepdims=True)
