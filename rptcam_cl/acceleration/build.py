"""A bounding volume hierarchy from boxes: binary splits by surface area on the device, then wide nodes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.acceleration.binary_tree import binary_tree
from rptcam_cl.acceleration.builder import Builder
from rptcam_cl.acceleration.bvh import EMPTY, Bvh
from rptcam_cl.acceleration.large_nodes import Nodes, split_large_nodes
from rptcam_cl.acceleration.reinsertion import reinserted
from rptcam_cl.acceleration.wide_tree import max_binary_depth, widen
from rptcam_cl.device import Session

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
    _check(lower, upper)
    if len(lower) == 0:
        return _nothing(width, leaf_size)
    max_depth = max_binary_depth(width)
    blocks, bounds, depths = sort_into_leaves(lower, upper, leaf_size, max_depth, session)
    return widen(reinserted(binary_tree(depths, bounds), max_depth, session), blocks, width)


def _check(lower: NDArray[np.float32], upper: NDArray[np.float32]) -> None:
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
