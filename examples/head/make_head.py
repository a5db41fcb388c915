"""Make the head of head.yaml from formulas: head.ply, head.png, its colours, and hair.npz, its strands.

Run in the repository: python examples/head/make_head.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "studio"))
import files
import pictures
import shapes

COLUMNS, ROWS = 160, 136  # of vertices round the head and down it
STRANDS, COILS, POINTS = 11000, 2600, 10  # of hair on the head and in its knot, and of each strand
EAR = ((7.4, -0.6, -2.0), (0.75, 2.5, 1.4))
MIDDLE, KNOT = np.array([0.0, 2.5, -2.0]), np.array([0.0, 7.5, -11.6])  # [cm]
REACH = 30.0  # [cm] from the middle, within which the surface lies
Array = pictures.Array


def ellipsoid(p: Array, centre: tuple[float, ...], radii: tuple[float, ...]) -> Array:
    """Return about how far points are outside of an ellipsoid [cm]."""
    q = (p - centre) / radii
    length = np.linalg.norm(q, axis=-1)
    return np.asarray(length * (length - 1) / np.maximum(np.linalg.norm(q / radii, axis=-1), 1e-9))


def capsule(p: Array, a: tuple[float, ...], b: tuple[float, ...], radii: tuple[float, float]) -> Array:
    """Return about how far points are outside of a line between two balls [cm]."""
    way = np.subtract(b, a)
    t = np.clip((p - a) @ way / (way @ way), 0, 1)
    return np.asarray(np.linalg.norm(p - a - t[..., None] * way, axis=-1) - radii[0] - t * (radii[1] - radii[0]))


def joined(a: Array, b: Array, width: float) -> Array:
    """Return the union of two bodies, their corner filled over a width [cm]; a negative one cuts out the second."""
    if width < 0:
        return -joined(-a, b, -width)
    share = np.clip(width - np.abs(a - b), 0, None) / width
    return np.asarray(np.minimum(a, b) - share**2 * width / 4)


def head(p: Array) -> Array:
    """Return about how far points are outside of the head [cm]; it looks along +z, its eyes are beside the origin."""
    q = folded(p)
    ear = joined(ellipsoid(q, *EAR), ellipsoid(q, (8.0, 0.0, -1.55), (0.55, 1.5, 0.75)), -0.4)
    return joined(skull(q), ear, 0.6)


def folded(p: Array) -> Array:
    """Return points on one side of the head, where it is the same."""
    return np.concatenate([np.abs(p[..., :1]), p[..., 1:]], axis=-1)


def skull(p: Array) -> Array:
    """Return the same without ears, at points with x >= 0."""
    d = joined(ellipsoid(p, (0, 3.6, -2.4), (7.3, 8.2, 9.2)), ellipsoid(p, (0, -3.2, 1.0), (5.7, 7.6, 6.6)), 3.0)
    d = joined(d, capsule(p, (0, -5, -3.2), (0, -26, -6.5), (4.3, 5.0)), 2.4)
    for centre, radii, width in (
        ((0, -9.3, 5.2), (1.7, 1.5, 1.7), 2.4),  # chin
        ((3.5, -2.6, 4.3), (2.6, 2.4, 2.5), 2.2),  # cheeks
        ((2.4, 1.9, 6.05), (2.1, 0.65, 1.0), 1.5),  # brows
    ):
        d = joined(d, ellipsoid(p, centre, radii), width)
    d = joined(d, ellipsoid(p, (3.0, -0.1, 8.4), (1.7, 1.0, 1.6)), -1.2)
    d = joined(d, ellipsoid(p, (3.0, -0.15, 5.75), (1.5, 1.05, 1.2)), 0.35)  # lids
    d = joined(d, ellipsoid(p, (3.05, -0.72, 7.0), (1.35, 0.07, 0.6)), -0.12)  # closed
    d = joined(d, capsule(p, (0, 1.0, 6.9), (0, -2.7, 8.9), (0.6, 0.85)), 1.3)
    d = joined(d, ellipsoid(p, (0.95, -3.0, 7.9), (0.75, 0.65, 0.95)), 0.5)
    d = joined(d, ellipsoid(p, (0, -5.25, 7.0), (2.0, 0.5, 0.75)), 0.5)
    d = joined(d, ellipsoid(p, (0, -6.25, 6.85), (1.7, 0.62, 0.85)), 0.5)
    return joined(d, ellipsoid(p, (0, -5.74, 7.9), (2.1, 0.09, 0.75)), -0.15)


def surface() -> Array:
    """Return points of the head as seen from its middle, (ROWS, COLUMNS, 3), from the neck up and from behind round."""
    v, u = np.meshgrid(np.linspace(0, 1, ROWS), np.linspace(0, 1, COLUMNS), indexing="ij")
    turn = np.pi / 2 + 2 * np.pi * u + 0.7 * np.sin(2 * np.pi * u)  # more of them in front
    fall = np.pi * (1 - v) - 0.4 * np.sin(2 * np.pi * v)
    way = np.stack([np.sin(fall) * np.cos(turn), np.cos(fall), -np.sin(fall) * np.sin(turn)], axis=-1)
    way[:, -1] = way[:, 0]
    middle = np.array([0, -2.5, 0.0])
    steps = np.linspace(0, REACH, 161)
    inside = np.stack([head(middle + t * way) < 0 for t in steps])
    last = len(steps) - 1 - np.argmax(inside[::-1], axis=0)
    low, high = steps[last], steps[np.minimum(last + 1, len(steps) - 1)]
    for _ in range(16):
        half = (low + high) / 2
        is_inside = head(middle + half[..., None] * way) < 0
        low, high = np.where(is_inside, half, low), np.where(is_inside, high, half)
    drop = np.minimum(low, (middle[1] + 20.0) / np.maximum(-way[..., 1], 1e-6))  # a flat end
    return np.asarray(middle + drop[..., None] * way)


def colours(p: Array) -> Array:
    """Return the colour of the skin at each point as sRGB bytes: lips, cheeks and lids are redder."""
    for axis in (0, 1):  # four pixels a vertex
        places = np.linspace(0, p.shape[axis] - 1, 4 * p.shape[axis] - 3)
        low = np.minimum(places.astype(int), p.shape[axis] - 2)
        share = (places - low).reshape([-1, 1, 1] if axis == 0 else [1, -1, 1])
        p = (1 - share) * np.take(p, low, axis) + share * np.take(p, low + 1, axis)
    q = folded(p)
    v, u = np.meshgrid(np.linspace(0, 1, p.shape[0]), np.linspace(0, 1, p.shape[1]), indexing="ij")
    spots = pictures.mottled(u, v, (40, 50), 3)[..., None]
    colour = np.array([222.0, 184, 162]) + 10 * (spots - 0.5)
    for centre, radii, share, paint in (
        ((4.4, -3.2, 5.5), (2.6, 2.2, 3.5), 0.5, (222, 150, 132)),
        ((0, -3, 8.6), (1.7, 1.4, 1.6), 0.35, (220, 150, 134)),
        ((3.0, -0.3, 6.6), (1.9, 1.2, 2.0), 0.45, (196, 146, 132)),
        ((7.3, -0.8, -1.9), (1.2, 3.2, 2.2), 0.5, (226, 150, 134)),
        ((0, -5.72, 7.6), (2.1, 0.95, 1.6), 1.0, (192, 104, 104)),
    ):
        far = np.linalg.norm((q - centre) / radii, axis=-1)
        there = share * (np.clip(3.0 * (1 - far), 0, 1) if share == 1 else np.exp(-2 * far**2))[..., None]
        colour = colour + there * (np.array(paint, float) - colour)
    hair = 0.92 * grown(p)[..., None]
    return np.asarray(colour + hair * (np.array([86.0, 58, 38]) - colour))[::-1]


def strands(p: Array) -> tuple[Array, Array]:
    """Return the points of hair, brows and lashes, (n, 4) with their width [cm], and how many each strand has."""
    random = np.random.default_rng(5)
    lines = np.concatenate([combed(p.reshape(-1, 3), random), coiled(random), locks(random)])
    width = np.broadcast_to(0.026 * np.r_[0.7, np.ones(POINTS - 2), 0.5], lines.shape[:2])
    long = np.concatenate([lines, width[..., None]], axis=-1).reshape(-1, 4)
    short = brows_and_lashes(random)
    return np.concatenate([long, *short]), np.r_[np.full(len(lines), POINTS), np.full(len(short), 3)]


def combed(places: Array, random: np.random.Generator) -> Array:
    """Return strands that lie on the head from their roots to the knot, a few of them loose."""
    roots = places[grown(places) > random.uniform(0.35, 0.65, len(places))]
    share = np.linalg.norm(roots - MIDDLE, axis=1) * (np.abs(roots[:, 2] - 1) + 8)  # the mesh is denser in front
    at = roots[random.choice(len(roots), STRANDS, p=share / share.sum())] + random.normal(0, 0.15, (STRANDS, 3))
    start, end = unit(at - MIDDLE), unit(KNOT - MIDDLE + random.normal(0, 0.9, (STRANDS, 3)))
    angle = np.arccos(np.clip(np.sum(start * end, axis=1), -1, 1))[:, None]
    lock = np.round(3.2 * start[:, 0] + 2 * start[:, 1])[:, None] * 2.4  # strands of one lock bend alike
    lift = random.uniform(0.02, 0.75, STRANDS) ** 1.5
    is_loose = random.random(STRANDS) < 0.035
    curl = random.normal(0, 1, (STRANDS, 3)) * np.where(is_loose, 0.16, 0.014)[:, None]
    points = []
    for t in np.linspace(0, 1, POINTS):
        way = (np.sin((1 - t) * angle) * start + np.sin(t * angle) * end) / np.sin(angle)
        way = way + np.sin(np.pi * t) * (0.035 * np.sin(5 * t + lock + [0, 2, 4]) + curl)
        points.append(over(unit(way), lift * np.minimum(1, 5 * t) + is_loose * 1.6 * t * (1 - t)))
    return np.stack(points, axis=1)


def coiled(random: np.random.Generator) -> Array:
    """Return the strands of the knot: rings that are wound askew."""
    turn, tilt = random.uniform(0, 2 * np.pi, COILS), random.normal(0, 0.5, COILS)
    size = np.abs(random.normal(0, 0.28, COILS))
    around = turn[:, None] + np.linspace(0, 2.6, POINTS) * np.sign(random.normal(0.6, 1, COILS))[:, None]
    across = 1.05 * tilt[:, None] * np.cos(2 * around + 3 * tilt[:, None])
    ball = np.stack([np.cos(around) * np.cos(across), np.sin(around) * np.cos(across), np.sin(across)], axis=-1)
    return np.asarray(KNOT + (1 - 0.25 * size[:, None, None]) * ball * [3.6, 3.4, 2.6] + [0, 0, -1.2])


def locks(random: np.random.Generator, count: int = 70) -> Array:
    """Return strands that hang before the left ear."""
    t = np.linspace(0, 1, POINTS)[:, None]
    aside, sway = random.normal(0, 1, (count, 1, 3)) * [0.12, 0.3, 0.3], random.normal(0, 0.4, (count, 1, 1))
    hanging = np.array([6.9, 2.6, 0.2]) + t * [0.55, -11, 1.2] + np.sin(5.5 * t + sway) * [0.12, 0, 0.75]
    return np.asarray(hanging + aside + (t * sway) * [0.3, 2.5, 0.9])


def brows_and_lashes(random: np.random.Generator) -> list[Array]:
    """Return strands of three points, 600 of brows and 300 of lashes."""
    strands, sides = [], random.choice([-1.0, 1.0], 900)
    for number, side in enumerate(sides):
        if number < 600:
            x = random.uniform(0.9, 4.6)
            root = np.array([x, 1.75 + 0.35 * np.sin((x - 0.9) / 3.7 * 2.6) + random.normal(0, 0.16), 6.0])
            run = np.array([0.75, 0.28 - 0.16 * (x - 0.9), 0.0])
        else:
            x = random.uniform(1.75, 4.35)
            root = np.array([x, -0.78 + 0.04 * (x - 3) ** 2, 6.0])
            run = np.array([0.25 * (x - 3.0), -0.2, 0.0])
        line = root + np.linspace(0, 1, 3)[:, None] * run
        for _ in range(16):  # on to the skin
            line[:, 2] -= 0.7 * (head(line) - [0, 0.06, 0.08])
        if number >= 600:
            line = line[0] + np.array([[0, 0, 0], [0, -0.06, 0.14], [0, 0.04, 0.42]]) + [[0], [0.5], [1]] * run
        strands.append(np.concatenate([line * [side, 1, 1], [[0.024], [0.022], [0.008]]], axis=1))
    return strands


def grown(p: Array) -> Array:
    """Return the share of hair at points of the head: 1 behind the hairline, 0 on the face, the ears and the neck."""
    line = np.interp(p[..., 2], [-9, -6, -3.2, -0.6, 0.4, 3.0, 5.5, 8], [-7.5, -6.5, -3.0, 0.5, 3.0, 4.0, 6.9, 7.3])
    aside = np.linalg.norm((folded(p) - EAR[0]) / EAR[1], axis=-1) > 1.25
    return np.asarray(np.clip((p[..., 1] - line) / 0.8 + 0.5, 0, 1) * aside)


def over(way: Array, height: Array) -> Array:
    """Return the points at a height over the head [cm] in directions from its middle."""
    low, high = np.zeros(len(way)), np.full(len(way), REACH / 2)
    for _ in range(14):
        half = (low + high) / 2
        is_inside = skull(folded(MIDDLE + half[:, None] * way)) < height
        low, high = np.where(is_inside, half, low), np.where(is_inside, high, half)
    return np.asarray(MIDDLE + low[:, None] * way)


def unit(vectors: Array) -> Array:
    """Return vectors, (n, 3), of length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


if __name__ == "__main__":
    here = Path(__file__).parent
    points = surface()
    files.write_ply(here / "head.ply", shapes.grid(points), steps=1000)
    (here / "head.png").write_bytes(pictures.encoded(colours(points), "PNG"))
    hair, counts = strands(points)
    np.savez_compressed(here / "hair.npz", points=hair.astype(np.float16), counts=counts.astype(np.uint8))
