"""Shapes of the studio as grids of points: lathe work, tubes, stones, a gear, a cloth, a cushion, a hill, leaves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
TEA_WIDTHS = [(0.8, 1.7), (1.3, 2.45), (2.2, 2.58), (3.4, 2.4), (5.2, 1.95), (6.3, 1.88), (8.2, 2.15)]  # height, radius


@dataclass(frozen=True)
class Shape:
    """A mesh of quads, front sides counter-clockwise; a quad may have two equal corners."""

    positions: Array  # (n, 3) [scene units], +y up
    quads: NDArray[np.int64]  # (m, 4)
    uvs: Array  # (n, 2)

    def triangles(self) -> NDArray[np.int64]:
        """Return the faces as triangles, (k, 3), without those that have no area."""
        faces = np.concatenate([self.quads[:, [0, 1, 2]], self.quads[:, [0, 2, 3]]])
        a, b, c = (self.positions[faces[:, corner]] for corner in range(3))
        return faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-9]

    def polygons(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the faces as quads, (m, 4), and, where two corners meet at a pole, as triangles, (k, 3)."""
        corners = self.positions[self.quads]
        short = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2) < 1e-6
        pointed = short.any(axis=1)
        kept = np.sort((np.argmax(short, axis=1)[:, None] + np.array([1, 2, 3])) % 4, axis=1)
        return self.quads[~pointed], np.take_along_axis(self.quads, kept, axis=1)[pointed]


def grid(points: Array, *, closed: bool = False) -> Shape:
    """Return rows x columns of points, (r, c, 3), as a mesh; a closed one is joined at its opposite edges."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    if closed:
        index = np.pad(index, ((0, 1), (0, 1)), mode="wrap")
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    v, u = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    return Shape(points.reshape(-1, 3), quads, np.stack([u, v], axis=-1).reshape(-1, 2))


def joined(shapes: list[Shape]) -> Shape:
    """Return several shapes as one."""
    starts = np.cumsum([0] + [len(shape.positions) for shape in shapes[:-1]])
    quads = [shape.quads + start for shape, start in zip(shapes, starts, strict=True)]
    positions, uvs = ([getattr(shape, name) for shape in shapes] for name in ("positions", "uvs"))
    return Shape(np.concatenate(positions), np.concatenate(quads), np.concatenate(uvs))


def rounded(points: ArrayLike, times: int) -> Array:
    """Return a line of points with its corners cut that many times (Chaikin 1974); the ends stay."""
    line = np.asarray(points, float)
    for _ in range(times):
        cut = np.stack([0.75 * line[:-1] + 0.25 * line[1:], 0.25 * line[:-1] + 0.75 * line[1:]], axis=1)
        line = np.concatenate([line[:1], cut.reshape(-1, line.shape[1]), line[-1:]])
    return line


def lathe(profile: ArrayLike, sides: int, *, rounds: int = 3) -> Shape:
    """Turn a profile of pairs (radius, height) about +y; it runs from the axis up the outside."""
    line = rounded(profile, rounds)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    radius, height = line[:, :1], line[:, 1:]
    around = np.stack([radius * np.cos(angle), height + 0 * angle, -radius * np.sin(angle)], axis=-1)
    return grid(around)


def tube(line: Array, radius: ArrayLike, sides: int, *, closed: bool = False) -> Shape:
    """Return a tube round a line of points, (n, 3), of a radius each, or one for each point and side."""
    shift = (np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)) if closed else np.gradient(line, axis=0)
    along = shift / np.linalg.norm(shift, axis=1, keepdims=True)
    side = np.cross(along, [0.31, 0.2, 0.93])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(along, side)
    angle = np.linspace(0, 2 * np.pi, sides + (not closed), endpoint=not closed)
    radii = np.broadcast_to(np.asarray(radius, float).T, (len(angle), len(line))).T[..., None]
    ring = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * other[:, None]
    return grid(line[:, None] + radii * ring, closed=closed)


def plume(rows: int = 150, sides: int = 180) -> Shape:
    """Return milk that was poured into a glass of tea: a thread that falls, spreads on the bottom and billows."""
    line = [(0, 0.95), (1.0, 0.95), (2.1, 1.15), (2.3, 2.2), (1.9, 3.3), (1.35, 3.7), (0.95, 3.0), (0.6, 2.9)]
    line += [(0.45, 4.2), (0.4, 5.6), (0.36, 6.9), (0.5, 7.6), (0.9, 7.85), (0.8, 8.05), (0, 8.08)]
    curve = rounded(line, 4)
    steps = np.append(0, np.cumsum(np.hypot(*np.diff(curve, axis=0).T)))
    radius, height = (np.interp(np.linspace(0, steps[-1], rows), steps, values)[:, None] for values in curve.T)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    around, up = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=-1), np.array([0, 1.0, 0])
    slope = np.gradient(np.concatenate([radius, height], axis=1), axis=0)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    out = slope[:, None, 1:] * around - slope[:, None, :1] * up
    at = radius[..., None] * around + height[..., None] * up
    random, swell = np.random.default_rng(12), np.zeros(at.shape[:2])
    for octave in range(4):
        waves, shifts = random.normal(size=(6, 3)) * 1.3 * 2.0**octave, random.uniform(0, 6, 6)
        swell += 0.32 / 1.9**octave * np.abs(np.sin(at @ waves.T + shifts)).mean(axis=-1)
    thick = np.minimum(radius / 2.3, 1)[..., None]  # thin parts have small billows and bend, and the ends are closed
    at += (swell - swell.mean())[..., None] * (0.15 + 1.2 * thick) * np.minimum(1, 3 * thick) * out
    y = at[..., 1:2]
    at += (1 - thick) * np.concatenate([0.28 * np.sin(0.9 * y + 0.5), 0 * y, 0.22 * np.cos(1.3 * y)], axis=-1)
    most = np.interp(y, *np.transpose(TEA_WIDTHS)) - 0.06
    at *= np.where([True, False, True], np.minimum(1, most / np.hypot(at[..., :1], at[..., 2:])), 1)
    return grid(np.concatenate([at[..., :1], np.clip(y, 0.9, 8.1), at[..., 2:]], axis=-1))


def knot(steps: int = 456, sides: int = 112) -> Shape:
    """Return a trefoil of twisted rope that fills a ball of radius 3.2 or so: 102 144 triangles."""
    turn = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    ring = 2.0 + np.cos(3 * turn)
    line = np.stack([ring * np.cos(2 * turn), np.sin(3 * turn), ring * np.sin(2 * turn)], axis=-1)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    strands = np.abs(np.cos(2.0 * angle + 18 * turn[:, None]))
    return tube(line, 0.5 * (0.8 + 0.25 * np.sqrt(strands + 0.01)), sides, closed=True)


def gear(teeth: int = 24, radius: float = 3.0, bore: float = 0.8, height: float = 0.7) -> Shape:
    """Return a gear wheel whose v runs round the axis; it lies on the plane y = 0."""
    steps = np.array([0, 0.28, 0.36, 0.64, 0.72])  # of one tooth: valley, flank, top, flank
    angle = np.append(((np.arange(teeth)[:, None] + steps) / teeth).ravel(), 1.0) * 2 * np.pi
    rim = np.append(np.tile(radius * np.array([0.86, 0.86, 1, 1, 0.86]), teeth), radius * 0.86)
    hub = np.full_like(rim, bore)
    bevel = 0.05
    turns = [(hub, 0), (rim, 0), (rim, height - bevel), (rim - bevel, height), (0.8 * rim.min() + 0 * rim, height)]
    turns += [(0.76 * rim.min() + 0 * rim, 0.8 * height), (bore * 1.9 + 0 * rim, 0.8 * height)]
    turns += [(bore * 1.8 + 0 * rim, height), (hub + bevel, height), (hub, height - bevel), (hub, 0)]
    rows = [np.stack([r * np.cos(angle), h + 0 * r, -r * np.sin(angle)], axis=-1) for r, h in turns]
    return grid(np.stack(rows))


def stone(seed: int, rows: int = 32, columns: int = 48) -> Shape:
    """Return a hewn stone about as large as the unit ball: a ball cut by random planes, with rough faces."""
    random = np.random.default_rng(seed)
    polar, turn = np.meshgrid(np.linspace(np.pi, 0, rows), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij")
    out = np.stack([np.sin(polar) * np.cos(turn), np.cos(polar), -np.sin(polar) * np.sin(turn)], axis=-1)
    planes = random.normal(size=(18, 3))
    planes /= np.linalg.norm(planes, axis=1, keepdims=True)
    reach = np.maximum(out @ planes.T, 1e-3) / random.uniform(0.65, 0.95, 18)
    radius = np.sum(np.maximum(reach, 0) ** 30, axis=-1) ** (-1 / 30)
    for octave in range(4):
        waves = random.normal(size=(5, 3)) * 3 * 2**octave
        radius += 0.02 / 1.7**octave * np.sin(out @ waves.T + random.uniform(0, 6, 5)).sum(axis=-1)
    return grid(radius[..., None] * out)


def cloth(size: float = 34.0, steps: int = 72) -> Shape:
    """Return a cloth on a table, [-size/2, size/2] along x, that hangs over the edge z = 11."""
    across, along = np.meshgrid(np.linspace(-0.5, 0.5, steps + 1), np.linspace(-0.5, 0.5, steps + 1), indexing="ij")
    x, reach = size * across, size * along
    over = np.maximum(reach - 11.0, 0)
    edge = np.minimum(over, 1.2) / 1.2
    z = np.minimum(reach, 11.0) + 0.8 * np.sin(edge * np.pi / 2) + 0.6 * edge * np.sin(0.9 * x + 0.4)
    y = 0.12 - np.maximum(over - 0.7, 0)
    away = np.clip((np.hypot(x, reach) - 7.0) / 9.0, 0, 1) ** 2
    y += away * 0.5 * (1 - edge) * (1 + np.sin(0.55 * x + 0.32 * reach + 1.5 * np.sin(0.21 * reach)))
    sheet = grid(np.stack([x, y, z], axis=-1))
    return Shape(sheet.positions, sheet.quads, sheet.uvs)


def cushion(steps: int = 56) -> Shape:
    """Return a square cushion 40 wide about the origin, +y its thickness: sides drawn in, creases from the corners."""
    line = np.sin(np.linspace(-np.pi / 2, np.pi / 2, steps + 1))
    u, v = np.meshgrid(line, line, indexing="ij")
    x, z = 20 * u * (1 - 0.09 * (1 - v**2) * u**2), 20 * v * (1 - 0.09 * (1 - u**2) * v**2)
    full = np.sqrt((1 - u**2) * (1 - v**2))
    turn, away = np.arctan2(v, u), np.hypot(u, v)
    crease = np.sin(9 * turn + 2.3 * np.sin(2 * turn) + 1.7 * u) * np.clip((away - 0.35) / 0.6, 0, 1)
    top = 8.5 * full**0.8 + 1.5 * full**0.7 * crease - 1.6 * np.exp(-((away / 0.16) ** 2))
    lower = grid(np.stack([x, -8.5 * full**0.8, z], axis=-1)[::-1])
    return joined([grid(np.stack([x, top, z], axis=-1)[::-1, ::-1]), Shape(lower.positions, lower.quads, lower.uvs)])


def hill(x: Array, z: Array) -> Array:
    """Return the height of the moor [m]."""
    near = 1.4 * np.sin(x / 31 + 0.7) * np.cos(z / 43) + 0.8 * np.sin((x - z) / 19)
    far = 7 * np.clip((-z - 470) / 230, 0, 1) ** 2 * (1.2 + np.sin(x / 90 + 2.0))
    return near + far


def moor(steps: int = 110) -> Shape:
    """Return the ground about the field of stones [m]: x from -220 to 220, z from 20 to -700."""
    x, z = np.meshgrid(np.linspace(-220, 220, steps + 1), np.linspace(20, -700, steps + 1))
    return grid(np.stack([x, hill(x, z), z], axis=-1))


def leaf(foot: Array, tip: Array, width: float, bend: float) -> Shape:
    """Return a card for the picture of a leaf, from foot to tip, folded along its middle and bent downwards."""
    axis = tip - foot
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side *= width / max(float(np.linalg.norm(side)), 1e-9)
    share = np.linspace(0, 1, 5)
    middle = foot + share[:, None] * axis - bend * (share**2)[:, None] * np.array([0, np.linalg.norm(axis), 0])
    lift = np.array([0, 0.3 * width, 0])
    return grid(np.stack([middle - side + lift, middle, middle + side + lift], axis=1))


def branch(foot: ArrayLike, tip: ArrayLike, sag: float, pairs: int, size: float) -> tuple[Shape, list[Shape]]:
    """Return a stem, and its leaves in pairs that get smaller towards the tip."""
    start, end = np.asarray(foot, float), np.asarray(tip, float)
    share = np.linspace(0, 1, 24)[:, None]
    line = start + share * (end - start) + sag * (4 * share * (1 - share)) * np.array([0, 1.0, 0])
    stem = tube(line, np.linspace(0.14, 0.05, 24)[:, None], 8)
    leaves = []
    for number in range(pairs):
        place = 0.3 + 0.7 * number / (pairs - 1)
        at = int(place * 23)
        ahead = line[min(at + 1, 23)] - line[max(at - 1, 0)]
        ahead /= np.linalg.norm(ahead)
        side = np.cross(ahead, [0.0, 1.0, 0.0])
        length = size * (1.15 - 0.6 * place)
        for hand in (-1, 1):
            leaves.append(leaf(line[at], line[at] + length * (0.6 * ahead + hand * 0.8 * side), 0.24 * length, 0.22))
    return stem, [*leaves, leaf(line[-1] - 0.1 * ahead, line[-1] + 0.6 * size * ahead, 0.14 * size, 0.2)]
