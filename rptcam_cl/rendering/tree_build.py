"""A bounding volume hierarchy from boxes: binary splits by surface area on the device, then wide nodes."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import Rows, dataclass
from rptcam_cl.core.files import kernels_dir
from rptcam_cl.device.programs import Program
from rptcam_cl.device.session import Session

# The binary tree that the device leaves behind as one mark per place, as arrays.


@dataclass(frozen=True, eq=False)
class _BinaryTree:
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


def binary_tree(depths: NDArray[np.uint8], leaf_bounds: NDArray[np.float32]) -> _BinaryTree:
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
    return _BinaryTree(root, children, bounds, height)


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
    """Return the levels below each node of a tree as in `_BinaryTree`, or None where they are more than ``most``."""
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


# The device's part of a build: boxes that are counted, moved and sorted by the kernels of ``kernels/build``.

BINS = 16  # per axis
SWEEP = 32  # nodes of at most so many primitives are split exactly
SMALL = {"cpu": 4096, "gpu": 1024}  # primitives that one work item takes on: what a core's cache holds; many for a GPU
_SMALL_FOR_SHORT_LOOPS = 64  # for a device that limits loops: sorting more might take it 65535 steps
GROUP = {"cpu": 1, "gpu": 32}  # work items per group: each has kilobytes of its own
KERNELS = ("gather", "histogram", "partition", "subtree", "leaves", "search", "reinsert")
FILES = [f"build/{name}.cl" for name in KERNELS]
MOST_VISITS = 128  # nodes that the search for one node's better place looks at; more gain less than 1 %
FACTS = {"BINS": BINS, "SWEEP": SWEEP, "DEEPEST": 127, "MOST_VISITS": MOST_VISITS}


def build_program(session: Session) -> Program:
    """Return the program of all kernels that build: a single one, whatever the tree, as compiling takes its time."""
    return session.program(FILES, FACTS, "")


class Builder:
    """The boxes of a build on its device, and what can be done to them.

    Parameters
    ----------
    session
        The device.
    lower, upper
        Corners of the boxes (n, 3), float32.
    leaf_size
        Primitives of a leaf block, a power of two.
    max_depth
        Depth that no leaf may exceed.
    """

    def __init__(
        self, session: Session, lower: NDArray[np.float32], upper: NDArray[np.float32], leaf_size: int, max_depth: int
    ) -> None:
        self.leaf_size = leaf_size
        self.max_depth = max_depth
        self._session = session
        self._program = build_program(session)
        self._small = SMALL[session.kind] if session.loop_limit is None else _SMALL_FOR_SHORT_LOOPS
        self._count = len(lower)
        self._shrink = np.float32(_scale_of(np.concatenate([lower.min(axis=0), upper.max(axis=0)])))
        self._boxes = session.allocate(32 * self._count)
        self._spare: Any = None
        self._run("gather", self._count, 64, lower=session.upload(lower), upper=session.upload(upper))
        session.finish()

    def _run(self, kernel: str, items: int, group: int, **arguments: Any) -> None:
        """Run a kernel of the build over ``items``; all take the boxes."""
        launch = self._session.bind(self._program, kernel, boxes=self._boxes, **arguments, count=np.int32(items))
        launch.enqueue(-(-items // group) * group, group)

    def _run_heavy(self, kernel: str, items: int, **arguments: Any) -> None:
        self._run(kernel, items, GROUP[self._session.kind], **arguments)

    def is_small(self, count: NDArray[np.int64], depth: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Find the nodes that are left to one work item: small ones, and those deep enough to need exact halves."""
        blocks = -(-count // self.leaf_size)
        return (count <= self._small) | (depth + np.ceil(np.log2(np.maximum(blocks, 1))) >= self.max_depth)

    def histogram(self, chunks: NDArray[np.int32], grids: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the bins (chunks, 3 axes, BINS, 2 corners, 4): bounds; in the last place of the first, the count."""
        shape = (len(chunks), 3, BINS, 2, 4)
        size = int(np.prod(shape))
        bins = self._session.allocate(4 * size)
        given = {"chunks": self._session.upload(chunks), "grids": self._session.upload(grids)}
        self._run_heavy("histogram", len(chunks), **given, bins=bins)
        return self._session.read(bins, np.float32, size).reshape(shape)

    def partition(self, chunks: NDArray[np.int32], splits: NDArray[np.int32]) -> NDArray[np.float32]:
        """Move chunks to the other buffer, which takes the first one's place.

        Returns
        -------
        numpy.ndarray
            Bounds of the centroids (chunks, 2 children, 2 corners, 4).
        """
        if self._spare is None:
            self._spare = self._session.allocate(32 * self._count)
        spans = self._session.allocate(64 * len(chunks))
        given = {"chunks": self._session.upload(chunks), "splits": self._session.upload(splits)}
        self._run_heavy("partition", len(chunks), sorted=self._spare, **given, spans=spans)
        self._boxes, self._spare = self._spare, self._boxes
        return self._session.read(spans, np.float32, 16 * len(chunks)).reshape(-1, 2, 2, 4)

    def build_subtrees(self, ranges: NDArray[np.int32], marks: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Sort ranges (begin, end, depth, -) into leaves and return all marks."""
        self._spare = None
        memory = self._session.allocate(self._count)
        self._session.write(memory, marks)
        self._run_heavy(
            "subtree",
            len(ranges),
            marks=memory,
            ranges=self._session.upload(ranges),
            shrink=self._shrink,
            leaf_bits=np.int32(self.leaf_size.bit_length() - 1),
            max_depth=np.int32(self.max_depth),
        )
        return self._session.read(memory, np.uint8, self._count)

    def leaves(self, starts: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return blocks (leaves, leaf_size) and bounds (leaves, 6) of the leaves that begin at ``starts[:-1]``."""
        count = len(starts) - 1
        blocks = self._session.allocate(4 * self.leaf_size * count)
        bounds = self._session.allocate(32 * count)
        given = {"starts": self._session.upload(starts), "leaf_size": np.int32(self.leaf_size)}
        self._run("leaves", count, 64, **given, blocks=blocks, bounds=bounds)
        corners = self._session.read(bounds, np.float32, 8 * count).reshape(-1, 2, 4)[:, :, :3]
        primitives = self._session.read(blocks, np.int32, self.leaf_size * count)
        return primitives.reshape(-1, self.leaf_size), corners.reshape(-1, 6)


def _scale_of(bounds: NDArray[np.float32]) -> float:
    """Return the power of two that brings a box's longest edge into [0.5, 1), as near as float32 allows."""
    longest = float((bounds[3:].astype(np.float64) - bounds[:3]).max())
    exponent = int(np.frexp(longest)[1]) if longest > 0.0 else 0
    return float(np.ldexp(1.0, min(max(-exponent, -126), 126)))


# A better binary tree: nodes move to where the areas of the inner nodes sum up to less.

ROUNDS = 4  # more gain less than 1 %
_MOST_MOVES = 1 << 16  # in a round, the best ones: they run one after the other, which takes a GPU long
MOVES_OF_LAUNCH = 1 << 11  # a GPU that shows a screen, too, ends a launch that keeps it for seconds
STEPS_OF_MOVE = 6 * 128  # at most: five ways up a tree, taken together with the loop over the moves


def reinsert(tree: _BinaryTree, max_depth: int, session: Session) -> _BinaryTree:
    """Return a tree of the same leaves with less area, or the same tree where that would get deeper than ``max_depth``.

    In each round all nodes look for better places at once, and then move one after the other, the greatest gain first
    (Bittner 2013; Meister and Bittner 2018). Measured on a hall of beams and balls: a tenth less cost.
    """
    if tree.leaves < 4:
        return tree
    program = build_program(session)
    nodes = len(tree.bounds)
    boxes = np.zeros((nodes, 2, 4), np.float32)
    boxes[:, :, :3] = tree.bounds.reshape(-1, 2, 3)
    on_device = {
        "boxes": _written(session, boxes),
        "children": _written(session, tree.children),
        "parents": _written(session, _parents(tree)),
        "leaves": np.int32(tree.leaves),
        "root": np.int32(tree.root),
        "shrink": np.float32(_scale_of(tree.bounds[tree.root])),
    }
    places, gains = session.allocate(4 * nodes), session.allocate(4 * nodes)
    search = session.bind(program, "search", **on_device, places=places, gains=gains, count=np.int32(nodes))
    group = GROUP[session.kind]
    most = MOVES_OF_LAUNCH if session.loop_limit is None else session.loop_limit // STEPS_OF_MOVE
    for _ in range(ROUNDS):
        search.enqueue(-(-nodes // group) * group, group)
        better_places, gain = session.read(places, np.int32, nodes), session.read(gains, np.float32, nodes)
        moving = np.flatnonzero(better_places >= 0)
        if len(moving) == 0:
            break
        moving = moving[np.argsort(-gain[moving], kind="stable")][:_MOST_MOVES]
        for part in np.array_split(moving, -(-len(moving) // most)):
            moves = {"nodes": session.upload(part.astype(np.int32)), "places": session.upload(better_places[part])}
            session.bind(program, "reinsert", **on_device, **moves, count=np.int32(len(part))).enqueue(1, 1)
    better = session.read(on_device["boxes"], np.float32, boxes.size).reshape(boxes.shape)[:, :, :3].reshape(-1, 6)
    children = session.read(on_device["children"], np.int32, tree.children.size).reshape(-1, 2)
    height = heights(children, tree.root, max_depth)
    return tree if height is None else replace(tree, children=children, bounds=better, height=height)


def _written(session: Session, array: NDArray[Any]) -> Any:
    """Return a buffer that holds an array and may be written."""
    buffer = session.allocate(array.nbytes)
    session.write(buffer, array)
    return buffer


def _parents(tree: _BinaryTree) -> NDArray[np.int32]:
    parents = np.full(len(tree.bounds), -1, np.int32)
    parents[tree.children] = tree.leaves + np.arange(len(tree.children))[:, None]
    return parents


# Wide nodes out of a binary tree, as the kernels read them, and how good they are.

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


def refit(bvh: Bvh, leaves: NDArray[np.float32]) -> Bvh:
    """Return the same nodes and blocks where the leaf blocks have other boxes (blocks, 6)."""
    children, bounds = bvh.children, bvh.bounds.copy()
    node, child = np.nonzero(children < 0)
    bounds[node, :, child] = leaves[~children[node, child]]
    for level in reversed(_levels(children)[:-1]):
        row = children[level]
        place, child = np.nonzero((row >= 0) & (row != EMPTY))
        below = bounds[row[place, child]]
        bounds[level[place], :3, child] = below[:, :3].min(axis=2)
        bounds[level[place], 3:, child] = below[:, 3:].max(axis=2)
    return Bvh(bounds, children, bvh.blocks)


def _levels(children: NDArray[np.int32]) -> list[NDArray[np.int64]]:
    """Return the nodes of each level, the root first."""
    levels = [np.zeros(1, np.int64)]
    while len(levels[-1]):
        row = children[levels[-1]]
        levels.append(row[(row >= 0) & (row != EMPTY)].astype(np.int64))
    return levels[:-1]


def stack_size(entries: int) -> int:
    """Return the size of the stack that kernels are compiled with for a tree that needs so many entries."""
    return -(-entries // STACK_STEP) * STACK_STEP


def stack_entries(bvh: Bvh) -> int:
    """Return the most entries that a traversal holds which pushes every child of a node and then takes the last."""
    return longest_way(bvh.children)[1]


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
        and sum(map(len, _levels(children))) == len(children)  # all hang below the root
    )


def _are_boxes(bounds: NDArray[np.float32], children: NDArray[np.int32]) -> bool:
    """Return whether children have boxes, and places without a child the one that no ray meets."""
    lower, upper = bounds[:, :3], bounds[:, 3:]
    used = (children != EMPTY)[:, None]
    boxes = (lower <= upper) & np.isfinite(lower) & np.isfinite(upper)
    return bool(np.where(used, boxes, (lower == np.inf) & (upper == -np.inf)).all())


def _are_all(indices: NDArray[np.int32], count: int) -> bool:
    """Return whether ``indices`` are 0 ... count - 1 in some order."""
    if len(indices) != count or count == 0:
        return len(indices) == count
    if int(indices.min()) < 0 or int(indices.max()) >= count:
        return False
    return bool((np.bincount(indices, minlength=count) == 1).all())


def longest_way(children: NDArray[np.int32]) -> tuple[int, int]:
    """Return the levels of a tree, and the entries of a stack that holds every child before the next is taken."""
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
    """How many levels of wide nodes keep the traversal's stack within `MAX_STACK` entries."""
    return (MAX_STACK - 1) // (width - 1)


def max_binary_depth(width: int) -> int:
    """Return a depth of binary trees that wide nodes can always be made of within `max_levels` levels."""
    return max_levels(width) * (width.bit_length() - 1)


def widen(tree: _BinaryTree, blocks: NDArray[np.int32], width: int) -> Bvh:
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


def _costs(tree: _BinaryTree, width: int) -> NDArray[np.float32]:
    """Return the least area of wide nodes below each node (nodes, width): if it may take 1, 2 ... width slots.

    In one slot the node is a wide node of its own; in several its children share them (Ylitie 2017, section 3.1).
    """
    costs = np.zeros((len(tree.bounds), width), np.float32)
    areas = _node_areas(tree)
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


def _node_areas(tree: _BinaryTree) -> NDArray[np.float32]:
    """Return half areas, of the scene scaled near size 1; never quite 0, so that fewer nodes are always better."""
    extent = (tree.bounds[:, 3:].astype(np.float64) - tree.bounds[:, :3]) * _scale_of(tree.bounds[tree.root])
    areas: NDArray[np.float64] = (extent * np.roll(extent, 1, axis=1) + 1e-12 * extent).sum(axis=1) + 1e-24
    return areas.astype(np.float32)


def _cheapest(tree: _BinaryTree, costs: NDArray[np.float32], nodes: NDArray[np.int32], width: int) -> NDArray[np.int32]:
    """Fill the slots of wide nodes of least cost: with nodes of the binary tree, or -1."""
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


def _flattest(tree: _BinaryTree, nodes: NDArray[np.int32], width: int) -> NDArray[np.int32]:
    """Fill the slots of wide nodes by opening their deepest child each time."""
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


def _lay_out(tree: _BinaryTree, slots: NDArray[np.int32], blocks: NDArray[np.int32]) -> Bvh:
    inner, leaf = slots >= tree.leaves, (slots >= 0) & (slots < tree.leaves)
    children = np.full(slots.shape, EMPTY, np.int32)
    children[inner] = np.arange(1, int(inner.sum()) + 1)  # the very order in which the levels were made
    children[leaf] = ~slots[leaf]
    bounds = np.empty((len(slots), slots.shape[1], 6), np.float32)
    bounds[..., :3], bounds[..., 3:] = np.inf, -np.inf
    bounds[slots >= 0] = tree.bounds[slots[slots >= 0]]
    return Bvh(np.ascontiguousarray(bounds.transpose(0, 2, 1)), children, blocks)


# The tree over few boxes, found on the host: the kernels that build large ones take seconds to compile.

FEW = 128  # boxes, which take 5 ms; a tenth more cost than large trees at most, that of finding hits less than a 50th
Array = NDArray[np.float64]


def tree_of_few(lower: NDArray[np.float32], upper: NDArray[np.float32], leaf_size: int) -> Bvh:
    """Return the binary tree over boxes whose every node is split at the least cost, area times leaf blocks.

    Parameters
    ----------
    lower, upper
        Corners of one box or more (n, 3), float32.
    leaf_size
        Most boxes of a leaf.
    """
    low, high = lower.astype(np.float64), upper.astype(np.float64)
    order = np.arange(len(low))
    depths = np.zeros(len(low), np.uint8)
    waiting = [(0, len(low), 0)]
    while waiting:
        begin, end, depth = waiting.pop()
        blocks = _blocks(end - begin, leaf_size)
        if blocks > 1:
            part = order[begin:end]
            in_halves = depth + np.ceil(np.log2(blocks)) >= max_binary_depth(2)
            inside, middle = (
                _halves(low[part], high[part], leaf_size) if in_halves else _split(low[part], high[part], leaf_size)
            )
            order[begin:end] = part[inside]
            depths[begin + middle] = depth + 1
            waiting += [(begin, begin + middle, depth + 1), (begin + middle, end, depth + 1)]
    begins = np.concatenate([[0], np.flatnonzero(depths)])
    counts = np.diff(begins, append=len(low))
    places = begins[:, None] + np.arange(leaf_size)
    used = np.arange(leaf_size) < counts[:, None]
    primitives = np.where(used, order[np.minimum(places, len(low) - 1)], -1).astype(np.int32)
    bounds = [np.minimum.reduceat(lower[order], begins), np.maximum.reduceat(upper[order], begins)]
    return widen(binary_tree(depths[begins[1:]], np.concatenate(bounds, axis=1)), primitives, 2)


def _blocks(count: int, leaf_size: int) -> int:
    return -(-count // leaf_size)


def _halves(low: Array, high: Array, leaf_size: int) -> tuple[NDArray[np.intp], int]:
    """Return an order along the longest axis, and where it is cut so that both parts have as many leaves."""
    centres = low + high
    axis = int(np.ptp(centres, axis=0).argmax())
    return np.argsort(centres[:, axis], kind="stable"), (_blocks(len(low), leaf_size) + 1) // 2 * leaf_size


def _split(low: Array, high: Array, leaf_size: int) -> tuple[NDArray[np.intp], int]:
    """Return the order along an axis, and where it is cut, that cost least of all."""
    centres = low + high
    orders = np.argsort(centres, axis=0, kind="stable")
    if not np.ptp(centres, axis=0).any():
        return _halves(low, high, leaf_size)
    columns = orders.T  # (axis, place)
    before = _areas(np.minimum.accumulate(low[columns], axis=1), np.maximum.accumulate(high[columns], axis=1))
    back = columns[:, ::-1]
    after = _areas(np.minimum.accumulate(low[back], axis=1), np.maximum.accumulate(high[back], axis=1))[:, ::-1]
    counts = np.arange(1, len(low))
    costs = before[:, :-1] * -(-counts // leaf_size) + after[:, 1:] * -(-counts[::-1] // leaf_size)
    axis, cut = np.unravel_index(int(costs.argmin()), costs.shape)
    return columns[axis], int(cut) + 1


def _areas(low: Array, high: Array) -> Array:
    x, y, z = np.moveaxis(high - low, -1, 0)
    return np.asarray(x * y + y * z + z * x + 1e-12 * (x + y + z))  # flat boxes have some too


# A bounding volume hierarchy from boxes: binary splits by surface area on the device, then wide nodes.

CHUNK = 4096  # primitives of a work item
CLOSEST = 1e-36  # centroids closer than this coincide, as in kernels/build


@dataclass(frozen=True, eq=False)
class Nodes(Rows):
    """Ranges of primitives, with the depth of their nodes and the bounds of their doubled centroids."""

    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    depth: NDArray[np.int64]
    low: NDArray[np.float32]
    high: NDArray[np.float32]


def _split_large_nodes(builder: Builder, root: Nodes, marks: NDArray[np.uint8]) -> Nodes:
    """Split nodes until one work item can take on each; return those, and write the marks of the splits.

    The boxes move from one buffer to the other at each level; small nodes that come to lie in the second stray and are
    moved back.
    """
    done: list[Nodes] = []
    nodes, strayed = root, False
    while True:
        small = builder.is_small(nodes.end - nodes.begin, nodes.depth)
        done.append(nodes[small])
        strays, large = nodes[small & strayed], nodes[~small]
        if len(large) + len(strays) == 0:
            return Nodes.joined(done)
        nodes = _split_level(builder, large, strays, marks)
        strayed = not strayed


def _split_level(builder: Builder, large: Nodes, strays: Nodes, marks: NDArray[np.uint8]) -> Nodes:
    """Split the large nodes and return their children; move the strays as they are."""
    nodes = Nodes.joined([large, strays])
    first, count, node, starts = _chunks(nodes)
    shared = int(np.searchsorted(node, len(large)))  # chunks of large nodes, which come first
    axis, threshold = np.zeros(len(nodes), np.int64), np.full(len(nodes), BINS)
    grids = np.zeros((len(nodes), 2, 4), np.float32)
    grids[:, 0, :3], grids[:, 1, :3] = nodes.low, _bin_scale(nodes.low, nodes.high)
    on_left = count.copy()
    if len(large):
        pieces = np.stack([first, count, node, node], axis=1)[:shared].astype(np.int32)
        bins = builder.histogram(pieces, grids[: len(large)])
        axis[: len(large)], threshold[: len(large)] = _best_splits(bins, starts[: len(large)], builder.leaf_size)
        upto = np.cumsum(bins[np.arange(shared), axis[node[:shared]], :, 0, 3], axis=1).astype(np.int64)
        on_left[:shared] = upto[np.arange(shared), threshold[node[:shared]] - 1]
    total_left = np.add.reduceat(on_left, starts)
    to_left = nodes.begin[node] + _sum_before(on_left, starts, node)
    to_right = (nodes.begin + total_left)[node] + _sum_before(count - on_left, starts, node)
    rows = np.arange(len(nodes))
    grid = np.stack([grids[rows, 0, axis], grids[rows, 1, axis]], axis=1).view(np.int32)
    splits = np.column_stack([axis, threshold, grid]).astype(np.int32)[node]
    spans = builder.partition(np.stack([first, count, to_left, to_right], axis=1).astype(np.int32), splits)
    if not len(large):
        return large
    return _children(large, total_left[: len(large)], spans[:shared], starts[: len(large)], builder.leaf_size, marks)


def _chunks(nodes: Nodes) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Cut nodes into chunks; return the chunks' first primitives, counts and nodes, and each node's first chunk."""
    number = -(-(nodes.end - nodes.begin) // CHUNK)
    starts = np.cumsum(number) - number
    node = np.repeat(np.arange(len(nodes)), number)
    first = nodes.begin[node] + (np.arange(len(node)) - starts[node]) * CHUNK
    return first, np.minimum(first + CHUNK, nodes.end[node]) - first, node, starts


def _sum_before(values: NDArray[np.int64], starts: NDArray[np.int64], node: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the sum of the values of the chunks before each within its node."""
    before = np.cumsum(values) - values
    return before - before[starts][node]


def _bin_scale(low: NDArray[np.float32], high: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return bins per unit of doubled centroid, 0 where all coincide; less than BINS, to keep the last one inside."""
    extent = high - low
    return np.where(extent > CLOSEST, np.float32(0.9999 * BINS) / np.maximum(extent, np.float32(CLOSEST)), 0)


def _best_splits(
    bins: NDArray[np.float32], starts: NDArray[np.int64], leaf_size: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return axis and bins on the left of the cheapest split of each node; BINS on the left where there is none."""
    count = np.add.reduceat(bins[..., 0, 3].astype(np.int64), starts)
    low = np.minimum.reduceat(bins[..., 0, :3], starts).astype(np.float64)
    high = np.maximum.reduceat(bins[..., 1, :3], starts).astype(np.float64)
    left = _split_costs(low, high, count, leaf_size)[:, :, :-1]
    right = _split_costs(low[:, :, ::-1], high[:, :, ::-1], count[:, :, ::-1], leaf_size)[:, :, -2::-1]
    costs = (left + right).reshape(len(starts), -1)
    best = costs.argmin(axis=1)
    exists = np.isfinite(costs[np.arange(len(starts)), best])
    axis, before = np.divmod(best, BINS - 1)
    return axis, np.where(exists, before + 1, BINS)


def _split_costs(
    low: NDArray[np.float64], high: NDArray[np.float64], count: NDArray[np.int64], leaf_size: int
) -> NDArray[np.float64]:
    """Return area times leaf blocks of the union of the first bins, for every number of bins; inf if they are empty."""
    extent = np.maximum.accumulate(high, axis=2) - np.minimum.accumulate(low, axis=2)
    number = np.cumsum(count, axis=2)
    x, y, z = np.moveaxis(np.where(number[..., None] > 0, extent, 0.0), -1, 0)
    area = x * y + y * z + z * x + 1e-12 * (x + y + z)  # as half_area in kernels/build
    return np.where(number > 0, area * -(-number // leaf_size), np.inf)


def _children(
    nodes: Nodes,
    on_left: NDArray[np.int64],
    spans: NDArray[np.float32],
    starts: NDArray[np.int64],
    leaf_size: int,
    marks: NDArray[np.uint8],
) -> Nodes:
    """Mark the splits and return the children of all nodes in order; a node left whole is cut into halves of blocks."""
    low = np.minimum.reduceat(spans[:, :, 0, :3], starts)
    high = np.maximum.reduceat(spans[:, :, 1, :3], starts)
    count = nodes.end - nodes.begin
    whole = on_left == count
    low[whole], high[whole] = nodes.low[whole, None], nodes.high[whole, None]
    blocks = -(-count // leaf_size)
    middle = nodes.begin + np.where(whole, (blocks + 1) // 2 * leaf_size, on_left)
    depth = nodes.depth + 1
    marks[middle] = depth
    begin, end = np.stack([nodes.begin, middle], axis=1), np.stack([middle, nodes.end], axis=1)
    return Nodes(begin.ravel(), end.ravel(), np.repeat(depth, 2), low.reshape(-1, 3), high.reshape(-1, 3))


LARGEST = 1e37  # coordinate: sums and bins of such stay within float32
MOST = 1 << 30  # primitives: places are int32


def build_bvh(
    lower: NDArray[np.float32], upper: NDArray[np.float32], *, width: int = 8, leaf_size: int = 8, session: Session
) -> Bvh:
    """Return a tree over boxes; the same one for the same boxes, device and driver.

    Parameters
    ----------
    lower, upper
        Corners of the primitives' boxes (n, 3), float32. None at all give a root without children.
    width
        Children of a node: 2, 4, 8 or 16.
    leaf_size
        Most primitives of a leaf block, a power of two up to 64; a leaf is one block.
    session
        The device that builds.

    Raises
    ------
    ValueError
        When a box is not finite, is turned inside out or reaches beyond 1e37.
    """
    if width not in (2, 4, 8, 16) or leaf_size not in (1, 2, 4, 8, 16, 32, 64):
        raise ValueError(f"width {width}, leaf_size {leaf_size}: expected powers of two, 2 to 16 and 1 to 64")
    lower, upper = np.ascontiguousarray(lower, np.float32), np.ascontiguousarray(upper, np.float32)
    check_boxes(lower, upper)
    if len(lower) == 0:
        return _empty_tree(width, leaf_size)
    max_depth = max_binary_depth(width)
    blocks, bounds, depths = sort_into_leaves(lower, upper, leaf_size, max_depth, session)
    return widen(reinsert(binary_tree(depths, bounds), max_depth, session), blocks, width)


def outwards(lower: Array, upper: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return boxes in float32 that hold those given."""
    infinity = np.float32(np.inf)
    return np.nextafter(lower.astype(np.float32), -infinity), np.nextafter(upper.astype(np.float32), infinity)


def check_boxes(lower: NDArray[np.float32], upper: NDArray[np.float32]) -> None:
    """Raise a ValueError when a tree cannot be built over boxes."""
    if lower.shape != upper.shape or lower.ndim != 2 or lower.shape[1] != 3:
        raise ValueError(f"boxes of shape {lower.shape} and {upper.shape}: expected twice (n, 3)")
    if len(lower) > MOST:
        raise ValueError(f"{len(lower)} primitives: at most {MOST} have a place in one tree")
    # Comparisons with NaN are false.
    good = (lower >= -LARGEST) & (lower <= upper) & (upper <= LARGEST)
    if not good.all():
        wrong = int(np.flatnonzero(~good.all(axis=1))[0])
        raise ValueError(
            f"box {wrong} from {lower[wrong].tolist()} to {upper[wrong].tolist()}: expected finite corners within "
            f"{LARGEST:g}, the lower first"
        )


def _empty_tree(width: int, leaf_size: int) -> Bvh:
    bounds = np.full((1, 6, width), np.inf, np.float32)
    bounds[:, 3:] = -np.inf
    return Bvh(bounds, np.full((1, width), EMPTY, np.int32), np.empty((0, leaf_size), np.int32))


def sort_into_leaves(
    lower: NDArray[np.float32], upper: NDArray[np.float32], leaf_size: int, max_depth: int, session: Session
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.uint8]]:
    """Return leaf blocks, their boxes, and the depth of the node that parts each leaf from the next."""
    builder = Builder(session, lower, upper, leaf_size, max_depth)
    marks = np.zeros(len(lower), np.uint8)
    small = _split_large_nodes(builder, _root(lower, upper), marks)
    ranges = np.stack([small.begin, small.end, small.depth, small.depth], axis=1).astype(np.int32)
    marks = builder.build_subtrees(ranges, marks)
    begins = np.flatnonzero(marks)
    blocks, bounds = builder.leaves(np.concatenate([[0], begins, [len(lower)]]).astype(np.int32))
    return blocks, bounds, marks[begins]


def _root(lower: NDArray[np.float32], upper: NDArray[np.float32]) -> Nodes:
    spans = []
    for axis in range(3):
        centroids = lower[:, axis] + upper[:, axis]
        spans.append((centroids.min(), centroids.max()))
    low, high = np.array(spans, np.float32).T[:, None]
    return Nodes(np.array([0]), np.array([len(lower)]), np.array([0]), low, high)


@lru_cache(maxsize=1)
def builder_identity() -> str:
    """Return a hash of the code that builds trees, so that no tree outlives it."""
    files = [Path(__file__).with_name(f"{name}.py") for name in ("culling", "scene_buffers", "tree_build")]
    files += sorted((kernels_dir() / "build").iterdir())
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in files)).hexdigest()
