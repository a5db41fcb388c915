"""Wide nodes out of a binary tree, as the kernels read them, and how good they are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.trees.binary_tree import BinaryTree
from rptcam_cl.rendering.trees.builder import scale_of

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


MAX_STACK = 128  # entries that a traversal may need


def max_levels(width: int) -> int:
    """Return how many levels of wide nodes keep the traversal's stack within `MAX_STACK` entries."""
    return (MAX_STACK - 1) // (width - 1)


def max_binary_depth(width: int) -> int:
    """Return a depth of binary trees that wide nodes can always be made of within `max_levels` levels."""
    return max_levels(width) * (width.bit_length() - 1)


def widen(tree: BinaryTree, blocks: NDArray[np.int32], width: int) -> Bvh:
    """Return the wide tree whose nodes have the least area in sum.

    Where a part of the tree is so deep that this might not end in time, nodes open their deepest children instead: that
    does away with log2(width) levels at once.
    """
    costs = _costs(tree, width)
    levels = []
    nodes = np.array([tree.root], np.int32)
    for left in range(max_levels(width), 0, -1):
        in_haste = -(-tree.height[nodes].astype(np.int64) // (width.bit_length() - 1)) >= left
        slots = np.full((len(nodes), width), -1, np.int32)
        slots[~in_haste] = _cheapest(tree, costs, nodes[~in_haste], width)
        slots[in_haste] = _flattest(tree, nodes[in_haste], width)
        levels.append(slots)
        nodes = slots[slots >= tree.leaves]
        if len(nodes) == 0:
            break
    return _lay_out(tree, np.concatenate(levels), blocks)


def _costs(tree: BinaryTree, width: int) -> NDArray[np.float32]:
    """Return the least area of wide nodes below each node (nodes, width): if it may take 1, 2 ... width slots.

    In one slot the node is a wide node of its own; in several its children share them (Ylitie 2017, section 3.1).
    """
    costs = np.zeros((len(tree.bounds), width), np.float32)
    areas = _areas(tree)
    order = np.argsort(tree.height, kind="stable")
    ends = np.cumsum(np.bincount(tree.height))
    for begin, end in pairwise(ends):
        nodes = order[begin:end]
        left, right = (costs[child] for child in tree.children[nodes - tree.leaves].T)
        shared = np.full((len(nodes), width), np.inf, np.float32)
        for slots in range(2, width + 1):
            shared[:, slots - 1] = _sharings(left, right, slots).min(axis=0)
        alone = areas[nodes] + shared[:, -1]
        costs[nodes] = np.minimum(shared, alone[:, None])
    return costs


def _sharings(left: NDArray[np.float32], right: NDArray[np.float32], slots: int) -> NDArray[np.float32]:
    """Return the costs of two children that share slots, by what the left one has: 1 ... slots - 1."""
    return np.stack([left[:, k] + right[:, slots - 2 - k] for k in range(slots - 1)])


def _areas(tree: BinaryTree) -> NDArray[np.float32]:
    """Return half areas, of the scene scaled near size 1; never quite 0, so that fewer nodes are always better."""
    extent = (tree.bounds[:, 3:].astype(np.float64) - tree.bounds[:, :3]) * scale_of(tree.bounds[tree.root])
    areas: NDArray[np.float64] = (extent * np.roll(extent, 1, axis=1) + 1e-12 * extent).sum(axis=1) + 1e-24
    return areas.astype(np.float32)


def _cheapest(tree: BinaryTree, costs: NDArray[np.float32], nodes: NDArray[np.int32], width: int) -> NDArray[np.int32]:
    """Return what stands in the slots of wide nodes of least cost: nodes of the binary tree, or -1."""
    slots, granted = np.full((len(nodes), width), -1, np.int32), np.zeros((len(nodes), width), np.int64)
    slots[:, 0], granted[:, 0] = nodes, np.where(nodes >= tree.leaves, width, 1)
    for filled in range(1, width):
        # The node itself, then any that is granted several slots and worth them, gives way to its children.
        known = np.maximum(slots, 0)
        opens = (granted > 1) & ((costs[known, granted - 1] < costs[known, 0]) | (filled == 1))
        row = np.flatnonzero(opens.any(axis=1))
        column = opens[row].argmax(axis=1)
        pair = tree.children[slots[row, column] - tree.leaves]
        total = granted[row, column]
        share = np.zeros(len(row), np.int64)
        for number in range(2, width + 1):
            which = total == number
            left, right = (costs[pair[which, side]] for side in (0, 1))
            share[which] = _sharings(left, right, number).argmin(axis=0) + 1
        slots[row, column], slots[row, filled] = pair.T
        granted[row, column], granted[row, filled] = share, total - share
    return slots


def _flattest(tree: BinaryTree, nodes: NDArray[np.int32], width: int) -> NDArray[np.int32]:
    """Return what stands in the slots of wide nodes that opened their deepest child each time."""
    slots = np.full((len(nodes), width), -1, np.int32)
    slots[:, 0] = nodes
    rows = np.arange(len(nodes))
    for filled in range(1, width):
        height = np.where(slots >= 0, tree.height[slots], 0)
        deepest = height.argmax(axis=1)
        row = rows[height[rows, deepest] > 0]
        column = deepest[row]
        slots[row, column], slots[row, filled] = tree.children[slots[row, column] - tree.leaves].T
    return slots


def _lay_out(tree: BinaryTree, slots: NDArray[np.int32], blocks: NDArray[np.int32]) -> Bvh:
    inner, leaf = slots >= tree.leaves, (slots >= 0) & (slots < tree.leaves)
    children = np.full(slots.shape, EMPTY, np.int32)
    children[inner] = np.arange(1, int(inner.sum()) + 1)  # the very order in which the levels were made
    children[leaf] = ~slots[leaf]
    bounds = np.empty((len(slots), slots.shape[1], 6), np.float32)
    bounds[..., :3], bounds[..., 3:] = np.inf, -np.inf
    bounds[slots >= 0] = tree.bounds[slots[slots >= 0]]
    return Bvh(np.ascontiguousarray(bounds.transpose(0, 2, 1)), children, blocks)
