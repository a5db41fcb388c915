"""A wide bounding volume hierarchy as the kernels read it, and how good it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

EMPTY = 0x7FFFFFFF  # in `children`: no child
STACK_STEP = 16  # of the stacks that kernels are compiled with: scenes of like size share their programs


@dataclass(frozen=True, eq=False)
class Bvh:
    """A tree of boxes over primitives; node 0 is the root, which is there even without primitives.

    Attributes
    ----------
    bounds
        Boxes of the children (m, 6, width), float32: rows min x, y, z, max x, y, z. No child: mins +inf, maxs -inf.
    children
        (m, width) int32: an inner node's index; ``~block`` (negative) for a leaf block; `EMPTY` for no child.
    blocks
        Primitives of each leaf block (b, leaf_size), int32: used places first, then -1.
    """

    bounds: NDArray[np.float32]
    children: NDArray[np.int32]
    blocks: NDArray[np.int32]

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        return self.bounds.nbytes + self.children.nbytes + self.blocks.nbytes


@dataclass(frozen=True)
class Quality:
    """Figures of a tree.

    Attributes
    ----------
    cost
        Expected steps of a ray that meets the root's box: nodes and leaf blocks, each weighted by its area over the
        root's (surface area heuristic).
    nodes, blocks
        How many there are.
    fill
        Mean share of a leaf block's places that is used.
    depth
        Nodes on the longest way from the root to a leaf.
    stack
        Most entries that a traversal holds which pushes every child of a node and then takes the last.
    """

    cost: float
    nodes: int
    blocks: int
    fill: float
    depth: int
    stack: int


def stack_size(entries: int) -> int:
    """Return the size of the stack that kernels are compiled with for a tree that needs so many entries."""
    return -(-entries // STACK_STEP) * STACK_STEP


def quality(bvh: Bvh) -> Quality:
    """Return the figures of a tree."""
    depth, stack = _longest_way(bvh.children)
    used = int(np.count_nonzero(bvh.blocks >= 0))
    return Quality(
        cost=_cost(bvh),
        nodes=len(bvh.children),
        blocks=len(bvh.blocks),
        fill=used / max(bvh.blocks.size, 1),
        depth=depth,
        stack=stack,
    )


def is_sound(bvh: Bvh) -> bool:
    """Return whether arrays of any origin can be traversed: indices in range, each node, block and primitive once."""
    bounds, children, blocks = bvh.bounds, bvh.children, bvh.blocks
    if bounds.dtype != np.float32 or children.dtype != np.int32 or blocks.dtype != np.int32:
        return False
    if children.ndim != 2 or blocks.ndim != 2 or bounds.shape != (len(children), 6, children.shape[1]):
        return False
    inner, leaf, used = children[(children >= 0) & (children != EMPTY)], ~children[children < 0], blocks[blocks >= 0]
    return (
        len(children) > 0
        and _are_boxes(bounds, children)
        and _are_all(inner - 1, len(children) - 1)
        and _are_all(leaf, len(blocks))
        and _are_all(used, len(used))
        and not bool((blocks < -1).any() or ((blocks[:, :-1] < 0) & (blocks[:, 1:] >= 0)).any())
        and _reached(children) == len(children)
    )


def _are_boxes(bounds: NDArray[np.float32], children: NDArray[np.int32]) -> bool:
    """Return whether children have boxes, and places without a child the one that no ray meets."""
    lower, upper = bounds[:, :3], bounds[:, 3:]
    used = (children != EMPTY)[:, None]
    boxes = (lower <= upper) & np.isfinite(lower) & np.isfinite(upper)
    return bool(np.where(used, boxes, (lower == np.inf) & (upper == -np.inf)).all())


def _reached(children: NDArray[np.int32]) -> int:
    """Return how many nodes hang below the root, it included, where each is the child of at most one."""
    level, count = np.zeros(1, np.int64), 0
    while len(level):
        count += len(level)
        row = children[level]
        level = row[(row >= 0) & (row != EMPTY)].astype(np.int64)
    return count


def _are_all(indices: NDArray[np.int32], count: int) -> bool:
    """Return whether ``indices`` are 0 ... count - 1 in some order."""
    if len(indices) != count or count == 0:
        return len(indices) == count
    if int(indices.min()) < 0 or int(indices.max()) >= count:
        return False
    return bool((np.bincount(indices, minlength=count) == 1).all())


def _cost(bvh: Bvh) -> float:
    bounds = bvh.bounds.astype(np.float64)
    used = bvh.children != EMPTY
    extent = np.where(used[:, None], bounds[:, 3:] - bounds[:, :3], 0.0)
    areas = extent[:, 0] * extent[:, 1] + extent[:, 1] * extent[:, 2] + extent[:, 2] * extent[:, 0]
    root = np.maximum(bounds[0, 3:].max(axis=1) - bounds[0, :3].min(axis=1), 0.0)
    root_area = float(root[0] * root[1] + root[1] * root[2] + root[2] * root[0])
    return 1.0 + float(areas.sum()) / root_area if root_area > 0.0 else 1.0


def _longest_way(children: NDArray[np.int32]) -> tuple[int, int]:
    """Return depth and stack entries, level by level."""
    level, held = np.zeros(1, np.int64), np.zeros(1, np.int64)
    depth, stack = 0, 0
    while len(level):
        depth += 1
        row = children[level]
        held = held + np.count_nonzero(row != EMPTY, axis=1)
        stack = max(stack, int(held.max()))
        inner = (row >= 0) & (row != EMPTY)
        held = np.repeat(held - 1, inner.sum(axis=1))
        level = row[inner].astype(np.int64)
    return depth, stack
