"""The binary tree that the device leaves behind as one mark per place, as arrays."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass


@dataclass(frozen=True, eq=False)
class BinaryTree:
    """A binary tree over leaves 0 ... n - 1; inner nodes are n ... 2 n - 2.

    Attributes
    ----------
    root
        Index of the root.
    children
        (n - 1, 2) int32: left and right child of inner node n + i.
    bounds
        (2 n - 1, 6) float32: min x, y, z, max x, y, z of every node.
    height
        (2 n - 1,) uint8: levels below each node; 0 for leaves.
    """

    root: int
    children: NDArray[np.int32]
    bounds: NDArray[np.float32]
    height: NDArray[np.uint8]

    @property
    def leaves(self) -> int:
        """How many leaves there are."""
        return len(self.children) + 1


def binary_tree(depths: NDArray[np.uint8], leaf_bounds: NDArray[np.float32]) -> BinaryTree:
    """Return the tree in which the node of depth ``depths[i]`` parts leaves ``i`` and ``i + 1``.

    Parameters
    ----------
    depths
        (n - 1,): 1 for the root, 2 for its children ...; between two nodes of one depth stands one of less depth.
    leaf_bounds
        (n, 6) boxes of the leaves.
    """
    leaves = len(leaf_bounds)
    order = np.argsort(depths, kind="stable")
    ends = np.cumsum(np.bincount(depths, minlength=1))
    levels = [order[a:b] for a, b in pairwise(ends)]
    children = _link(levels, leaves)
    bounds = np.empty((2 * leaves - 1, 6), np.float32)
    bounds[:leaves] = leaf_bounds
    height = np.zeros(2 * leaves - 1, np.uint8)
    for level in reversed(levels):
        left, right = children[level].T
        bounds[leaves + level, :3] = np.minimum(bounds[left, :3], bounds[right, :3])
        bounds[leaves + level, 3:] = np.maximum(bounds[left, 3:], bounds[right, 3:])
        height[leaves + level] = np.maximum(height[left], height[right]) + 1
    root = leaves + int(levels[0][0]) if levels else 0
    return BinaryTree(root, children, bounds, height)


def _link(levels: list[NDArray[np.int64]], leaves: int) -> NDArray[np.int32]:
    """Return the children of the inner nodes, given those of each depth in order."""
    # At first the children of node i are the leaves beside it; a node of the next depth takes the place of one of them.
    children = np.stack([np.arange(leaves - 1), np.arange(1, leaves)], axis=1).astype(np.int32)
    first, last = np.zeros(1, np.int64), np.full(1, leaves - 1)  # the leaves below each node of a level
    for parents, level in pairwise(levels):
        place = np.searchsorted(parents, level)  # parents[place - 1] < node < parents[place]
        before = np.maximum(place - 1, 0)
        is_right = (place > 0) & (level < last[before])
        parent = np.where(is_right, before, place)
        children[parents[parent], is_right.astype(np.int64)] = leaves + level
        first, last = (
            np.where(is_right, parents[parent] + 1, first[parent]),
            np.where(is_right, last[parent], parents[parent]),
        )
    return children


def heights(children: NDArray[np.int32], root: int, most: int) -> NDArray[np.uint8] | None:
    """Return the levels below each node of a tree as in `BinaryTree`, or None where they are more than ``most``."""
    leaves = len(children) + 1
    height = np.zeros(2 * leaves - 1, np.uint8)
    levels = [np.array([root], np.int32)]
    while len(inner := levels[-1][levels[-1] >= leaves]):
        if len(levels) > most:
            return None
        levels[-1] = inner
        levels.append(children[inner - leaves].ravel())
    for level in reversed(levels[:-1]):
        left, right = children[level - leaves].T
        height[level] = np.maximum(height[left], height[right]) + 1
    return height
