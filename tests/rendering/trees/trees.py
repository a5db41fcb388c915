"""What must be true of every tree, and a traversal in numpy."""

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.rendering.tree_build import EMPTY, MAX_STACK, Bvh, longest_way
from tests.rendering.trees.meshes import hits


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


def quality(bvh: Bvh) -> Quality:
    """Return the figures of a tree."""
    depth, stack = longest_way(bvh.children)
    used = int(np.count_nonzero(bvh.blocks >= 0))
    return Quality(
        cost=_cost(bvh),
        nodes=len(bvh.children),
        blocks=len(bvh.blocks),
        fill=used / max(bvh.blocks.size, 1),
        depth=depth,
        stack=stack,
    )


def _cost(bvh: Bvh) -> float:
    bounds = bvh.bounds.astype(np.float64)
    used = bvh.children != EMPTY
    extent = np.where(used[:, None], bounds[:, 3:] - bounds[:, :3], 0.0)
    areas = extent[:, 0] * extent[:, 1] + extent[:, 1] * extent[:, 2] + extent[:, 2] * extent[:, 0]
    root = np.maximum(bounds[0, 3:].max(axis=1) - bounds[0, :3].min(axis=1), 0.0)
    root_area = float(root[0] * root[1] + root[1] * root[2] + root[2] * root[0])
    return 1.0 + float(areas.sum()) / root_area if root_area > 0.0 else 1.0


def check(bvh, lower, upper, width, leaf_size):
    """Every primitive lies in one block, every node hangs in one place, every box is the exact union of its content."""
    m, b = len(bvh.children), len(bvh.blocks)
    assert bvh.bounds.shape == (m, 6, width)
    assert bvh.bounds.dtype == np.float32
    assert bvh.children.shape == (m, width)
    assert bvh.blocks.shape == (b, leaf_size)
    assert bvh.children.dtype == bvh.blocks.dtype == np.int32
    used = bvh.blocks[bvh.blocks >= 0]
    assert np.array_equal(np.sort(used), np.arange(len(lower)))
    assert not (np.diff((bvh.blocks >= 0).astype(int), axis=1) > 0).any()  # used places first
    filled = bvh.children != EMPTY
    inner = filled & (bvh.children >= 0)
    assert np.array_equal(np.sort(bvh.children[inner]), np.arange(1, m))
    assert np.array_equal(np.sort(~bvh.children[filled & (bvh.children < 0)]), np.arange(b))
    figures = quality(bvh)
    assert figures.stack <= MAX_STACK  # also ends where there is no circle
    low, high = content(bvh, lower, upper)
    assert np.array_equal(np.where(filled[:, None], bvh.bounds[:, :3], np.inf), low.transpose(0, 2, 1))
    assert np.array_equal(np.where(filled[:, None], bvh.bounds[:, 3:], -np.inf), high.transpose(0, 2, 1))
    return figures


def content(bvh, lower, upper):
    """Bounds of the primitives below each child (m, width, 3); inside out for empty children."""
    m, width = bvh.children.shape
    low, high = np.full((m, width, 3), np.inf), np.full((m, width, 3), -np.inf)
    order = [0]
    for node in order:
        order.extend(int(child) for child in bvh.children[node] if child >= 0 and child != EMPTY)
    for node in reversed(order):
        for k, child in enumerate(bvh.children[node]):
            if child == EMPTY:
                continue
            if child < 0:
                block = bvh.blocks[~child]
                block = block[block >= 0]
                low[node, k], high[node, k] = lower[block].min(axis=0), upper[block].max(axis=0)
            else:
                low[node, k], high[node, k] = low[child].min(axis=0), high[child].max(axis=0)
    return low, high


def traverse(bvh, triangles, origin, direction):
    """Nearest ray parameter and the number of nodes and blocks met, with the children's boxes alone as guide."""
    p = triangles.astype(np.float64)
    best, waiting, steps = np.inf, [0], 0
    with np.errstate(divide="ignore"):
        inverse = 1.0 / direction
    while waiting:
        node = waiting.pop()
        steps += 1
        if node < 0:
            block = bvh.blocks[~node]
            t = p[block[block >= 0]]
            best = min(best, hits(t[:, 0], t[:, 1] - t[:, 0], t[:, 2] - t[:, 0], origin, direction).min())
            continue
        low, high = bvh.bounds[node].reshape(2, 3, -1).astype(np.float64)
        with np.errstate(invalid="ignore"):
            near, far = (low - origin[:, None]) * inverse[:, None], (high - origin[:, None]) * inverse[:, None]
        enter, leave = np.minimum(near, far).max(axis=0), np.maximum(near, far).min(axis=0)
        meets = (enter <= leave) & (leave >= 0) & (enter <= best) & (bvh.children[node] != EMPTY)
        waiting.extend(int(child) for child in bvh.children[node][meets])
    return best, steps
