"""A bounding volume hierarchy from boxes: binary splits by surface area on the device, then wide nodes."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device import Session
from rptcam_cl.rendering.trees.binary_tree import binary_tree
from rptcam_cl.rendering.trees.builder import BINS, Builder
from rptcam_cl.rendering.trees.reinsertion import reinserted
from rptcam_cl.rendering.trees.wide_tree import EMPTY, Bvh, max_binary_depth, widen

CHUNK = 4096  # primitives of a work item
CLOSEST = 1e-36  # centroids closer than this coincide, as in kernels/build


@dataclass(frozen=True, eq=False)
class Nodes:
    """Ranges of primitives, with the depth of their nodes and the bounds of their doubled centroids."""

    begin: NDArray[np.int64]
    end: NDArray[np.int64]
    depth: NDArray[np.int64]
    low: NDArray[np.float32]
    high: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.begin)

    def where(self, which: NDArray[np.bool_]) -> Nodes:
        """Return some of the nodes."""
        return Nodes(*(getattr(self, each.name)[which] for each in fields(self)))


def joined(parts: list[Nodes]) -> Nodes:
    """Return the nodes of several lists as one."""
    return Nodes(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Nodes)))


def split_large_nodes(builder: Builder, root: Nodes, marks: NDArray[np.uint8]) -> Nodes:
    """Split nodes until one work item can take on each; return those, and write the marks of the splits.

    The boxes move from one buffer to the other at each level; small nodes that come to lie in the second stray and are
    moved back.
    """
    done: list[Nodes] = []
    nodes, strayed = root, False
    while True:
        small = builder.is_small(nodes.end - nodes.begin, nodes.depth)
        done.append(nodes.where(small))
        strays, large = nodes.where(small & strayed), nodes.where(~small)
        if len(large) + len(strays) == 0:
            return joined(done)
        nodes = _split_level(builder, large, strays, marks)
        strayed = not strayed


def _split_level(builder: Builder, large: Nodes, strays: Nodes, marks: NDArray[np.uint8]) -> Nodes:
    """Split the large nodes and return their children; move the strays as they are."""
    nodes = joined([large, strays])
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
    left = _costs(low, high, count, leaf_size)[:, :, :-1]
    right = _costs(low[:, :, ::-1], high[:, :, ::-1], count[:, :, ::-1], leaf_size)[:, :, -2::-1]
    costs = (left + right).reshape(len(starts), -1)
    best = costs.argmin(axis=1)
    found = np.isfinite(costs[np.arange(len(starts)), best])
    axis, before = np.divmod(best, BINS - 1)
    return axis, np.where(found, before + 1, BINS)


def _costs(
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
    lower: NDArray[np.float32],
    upper: NDArray[np.float32],
    *,
    width: int = 8,
    leaf_size: int = 8,
    session: Session,
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
        return _nothing(width, leaf_size)
    max_depth = max_binary_depth(width)
    blocks, bounds, depths = sort_into_leaves(lower, upper, leaf_size, max_depth, session)
    return widen(reinserted(binary_tree(depths, bounds), max_depth, session), blocks, width)


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


def _nothing(width: int, leaf_size: int) -> Bvh:
    bounds = np.full((1, 6, width), np.inf, np.float32)
    bounds[:, 3:] = -np.inf
    return Bvh(bounds, np.full((1, width), EMPTY, np.int32), np.empty((0, leaf_size), np.int32))


def sort_into_leaves(
    lower: NDArray[np.float32], upper: NDArray[np.float32], leaf_size: int, max_depth: int, session: Session
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.uint8]]:
    """Return leaf blocks, their boxes, and the depth of the node that parts each leaf from the next."""
    builder = Builder(session, lower, upper, leaf_size, max_depth)
    marks = np.zeros(len(lower), np.uint8)
    small = split_large_nodes(builder, _root(lower, upper), marks)
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
