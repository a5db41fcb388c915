"""Wide nodes out of a binary tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.acceleration.binary_tree import BinaryTree
from rptcam_cl.acceleration.bvh import EMPTY, Bvh

MAX_STACK = 128  # entries that a traversal may need


def max_levels(width: int) -> int:
    """Return how many levels of wide nodes keep the traversal's stack within `MAX_STACK` entries."""
    return (MAX_STACK - 1) // (width - 1)


def max_binary_depth(width: int) -> int:
    """Return a depth of binary trees that wide nodes can always be made of within `max_levels` levels."""
    return max_levels(width) * int(np.log2(width))


def widen(tree: BinaryTree, blocks: NDArray[np.int32], width: int) -> Bvh:
    """Return the wide tree: each node opens its child of largest area until it has ``width`` (Wald 2008).

    Where a part of the tree is so deep that this might not end in time, the deepest child is opened instead: that does
    away with log2(width) levels at once.
    """
    leaves = len(blocks)
    opens = int(np.log2(width))
    slots_of_levels, left = [], max_levels(width)
    nodes = np.array([tree.root])
    while len(nodes):
        in_haste = -(-tree.height[nodes].astype(np.int64) // opens) >= left
        slots = _open(tree, nodes, width, in_haste)
        slots_of_levels.append(slots)
        nodes = slots[slots >= leaves]
        left -= 1
    return _lay_out(tree, np.concatenate(slots_of_levels), blocks)


def _open(tree: BinaryTree, nodes: NDArray[np.int64], width: int, in_haste: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return what stands in the places of each node: nodes of the binary tree, or -1."""
    leaves = len(tree.children) + 1
    slots = np.full((len(nodes), width), -1)
    worth = np.full((len(nodes), width), -1.0)  # of opening the slot; below 0: cannot be opened
    rows = np.arange(len(nodes))

    def put(column: NDArray[np.int64] | int, at: NDArray[np.int64], what: NDArray[np.int64]) -> None:
        slots[at, column] = what
        height = tree.height[what].astype(np.float64)
        area = np.maximum(_areas(tree.bounds[what]), 1e-300) * (1.0 + 1e-9 * height)  # of equal ones, the deepest
        worth[at, column] = np.where(what < leaves, -1.0, np.where(in_haste[at], height, area))

    put(0, rows, nodes)
    for filled in range(1, width):
        best = worth.argmax(axis=1)
        at = np.flatnonzero(worth[rows, best] >= 0.0)
        pair = tree.children[slots[at, best[at]] - leaves].astype(np.int64)
        put(best[at], at, pair[:, 0])
        put(filled, at, pair[:, 1])
    return slots


def _areas(bounds: NDArray[np.float32]) -> NDArray[np.float64]:
    extent = bounds[:, 3:].astype(np.float64) - bounds[:, :3]
    areas: NDArray[np.float64] = (extent * np.roll(extent, 1, axis=1)).sum(axis=1)
    return areas


def _lay_out(tree: BinaryTree, slots: NDArray[np.int64], blocks: NDArray[np.int32]) -> Bvh:
    leaves = len(blocks)
    inner, leaf = slots >= leaves, (slots >= 0) & (slots < leaves)
    children = np.full(slots.shape, EMPTY, np.int32)
    children[inner] = np.arange(1, int(inner.sum()) + 1)  # the very order in which the levels were made
    children[leaf] = ~slots[leaf].astype(np.int32)
    bounds = np.empty((len(slots), slots.shape[1], 6), np.float32)
    bounds[..., :3], bounds[..., 3:] = np.inf, -np.inf
    bounds[slots >= 0] = tree.bounds[slots[slots >= 0]]
    return Bvh(np.ascontiguousarray(bounds.transpose(0, 2, 1)), children, blocks)
