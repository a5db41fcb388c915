"""The tree by which light sampling finds its lamps where there are many: ``kernels/light/light_tree.h``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kinds import EmitterKind

Array = NDArray[np.float64]

# Variance of picks by power from which on a tree is used. Of the scenes measured above it none lost at equal time, and
# they gained up to 12 times; most of those below it lost, as a vertex takes longer by a tree (benchmarks/journal.md).
BREAK_EVEN = 0.5
FROM_AFAR = frozenset({EmitterKind.ENVIRONMENT, EmitterKind.DIRECTIONAL, EmitterKind.SUN})
NODE_FLOATS = 8
MOST_LAMPS, MOST_POINTS = 4096, 64  # that tell whether a tree gains


@dataclass(frozen=True, eq=False)
class Lamps:
    """What the tree knows of each lamp.

    Attributes
    ----------
    middle : (n, 3) array
        Mean position of its light [m].
    extent2 : (n,) array
        Mean squared distance from there [m²].
    axis : (n, 3) array
        Mean direction in which it shines; shorter than 1 where it shines all round.
    power : (n,) array
        In any unit.
    """

    middle: Array
    extent2: Array
    axis: Array
    power: Array


@dataclass(frozen=True, eq=False)
class LightTree:
    """The nodes with the lamps of the leaves behind them, the leaf of each lamp, and levels above the leaves."""

    nodes: NDArray[np.float32]
    leaf_of: NDArray[np.int32]
    levels: int


def lamps_of(records: NDArray[np.void], power: Array) -> Lamps:
    """Return what the tree knows of emitter records that are not at infinity."""
    kind = records["kind"]
    a, u, v, z = (records[name][:, :3].astype(np.float64) for name in ("a", "u", "v", "normal"))
    uu, vv, zz, uv = ((x * y).sum(axis=1) for x, y in ((u, u), (v, v), (z, z), (u, v)))
    nothing, radius2 = np.zeros_like(a), records["a"][:, 3].astype(np.float64) ** 2
    facing = z * np.where(records["two_sided"] != 0, 0.0, 1.0)[:, None]
    by_kind = {  # offset of the middle from `a`, mean squared distance from there, axis
        EmitterKind.RECTANGLE: ((u + v) / 2, (uu + vv) / 12, facing),
        EmitterKind.DISK: (nothing, (uu + vv) / 4, facing),
        EmitterKind.TRIANGLE: ((u + v) / 3, (uu + vv - uv) / 18, facing),
        EmitterKind.SPHERE: (nothing, radius2, nothing),
        EmitterKind.POINT: (nothing, 0 * uu, nothing),
        EmitterKind.SPOT: (nothing, 0 * uu, z),
        EmitterKind.PROFILE: (nothing, 0 * uu, z / 2),
        EmitterKind.BOX: (nothing, (uu + vv + zz) * 5 / 9, nothing),
        EmitterKind.ELLIPSOID: (nothing, (uu + vv + zz) / 3, nothing),
        EmitterKind.CYLINDER: (z / 2, (uu + vv) / 2 + zz / 12, nothing),
        EmitterKind.CONE: (z / 3, (uu + vv) / 4 + zz / 18, nothing),
    }
    middle, extent2, axis = a.copy(), np.zeros(len(a)), np.zeros_like(a)
    for one, (offset, spread, mean) in by_kind.items():
        mine = kind == one
        middle[mine] += offset[mine]
        extent2[mine], axis[mine] = spread[mine], mean[mine]
    return Lamps(middle, extent2, axis, power / power.sum())


def variance_by_power(lamps: Lamps, points: Array) -> float:
    """Return the mean relative variance of light at points (m, 3) from lamps picked by power; 0 where that is right.

    Shadows and the surfaces' own directions are left out.
    """
    lamps = Lamps(*(part[:: -(-len(lamps.power) // MOST_LAMPS)] for part in vars(lamps).values()))
    shining = lamps.power > 0
    moments = []
    for point in points[:: -(-len(points) // MOST_POINTS) or 1]:
        to = lamps.middle[shining] - point
        inverse = 1 / np.maximum((to**2).sum(axis=1) + lamps.extent2[shining], np.finfo(np.float32).tiny)
        axis, spread = lamps.axis[shining], lamps.extent2[shining] * inverse / 2
        cosine = -(axis * to).sum(axis=1) * np.sqrt(inverse)
        soft = np.sqrt(np.maximum(cosine**2 + spread + (1 - (axis**2).sum(axis=1)) / 4, 0))
        light = np.maximum((cosine + soft) / 2, 0.01) * inverse
        power = lamps.power[shining]
        moments.append((power * light**2).sum() * power.sum() / (power * light).sum() ** 2 - 1)
    return float(np.mean(moments)) if moments else 0.0


def light_tree(lamps: Lamps) -> LightTree:
    """Return a balanced tree: each node parts its lamps, along their longest extent, into halves by number, and those
    again."""
    count = len(lamps.power)
    levels = -(-max(count - 1, 0).bit_length() // 2) * 2
    nodes = np.zeros((2 << levels, NODE_FLOATS), np.float32)
    order, starts = np.arange(count), np.array([0, count])  # of the lamps of each node of a level
    for level in range(levels + 1):
        nodes[1 << level : 2 << level] = _nodes(lamps, order, starts)
        if level < levels:
            order = _sorted(lamps.middle, order, starts)
            halves = starts[:-1] + (np.diff(starts) + 1) // 2
            starts = np.append(np.stack([starts[:-1], halves], axis=1).ravel(), count)
    leaf = np.repeat(np.arange(1 << levels), np.diff(starts))
    leaf_of, lamp_of = np.zeros(count, np.int32), np.zeros(1 << levels, np.int32)
    leaf_of[order], lamp_of[leaf] = leaf, order
    return LightTree(np.concatenate([nodes.ravel(), lamp_of.view(np.float32)]), leaf_of, levels // 2)


def _sorted(middle: Array, order: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the order in which the lamps of each node stand along the axis on which they lie farthest apart."""
    there = middle[order]
    lamps = np.diff(starts)[np.diff(starts) > 0]
    firsts = np.cumsum(lamps) - lamps
    extent = np.maximum.reduceat(there, firsts) - np.minimum.reduceat(there, firsts)
    node = np.repeat(np.arange(len(lamps)), lamps)
    return order[np.lexsort((there[np.arange(len(order)), extent.argmax(axis=1)[node]], node))]


def _nodes(lamps: Lamps, order: NDArray[np.int64], starts: NDArray[np.int64]) -> Array:
    """Return the nodes of a level: means weighted by power. A node without lamps, below one with a single one, is 0."""
    rows = np.zeros((len(starts) - 1, NODE_FLOATS))
    used = np.flatnonzero(np.diff(starts))
    weight = lamps.power[order]
    about = np.average(lamps.middle, axis=0, weights=lamps.power)  # so that squares do not cancel far from the eye
    middle = lamps.middle[order] - about
    squares = (middle**2).sum(axis=1) + lamps.extent2[order]
    columns = np.column_stack([middle, squares, lamps.axis[order], np.ones(len(order))]) * weight[:, None]
    rows[used] = np.add.reduceat(columns, starts[:-1][used])
    rows[used, :7] /= np.maximum(rows[used, 7:], np.finfo(np.float64).tiny)  # triangles without area have no power
    rows[used, 3] = np.maximum(rows[used, 3] - (rows[used, :3] ** 2).sum(axis=1), 0.0)
    rows[used, :3] += about
    return rows
