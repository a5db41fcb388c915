"""Each split of the device's builder is the one that its size asks for: cheapest of all, cheapest of bins, halves."""

from itertools import pairwise

import numpy as np
import pytest

from rptcam_cl.device.session import Session
from rptcam_cl.rendering.tree_build import BINS, SWEEP, Builder

SIZES = (2, 3, 9, 17, SWEEP, SWEEP + 1, 50, 200)
DEEPEST = 100


def cost(low, high, which, leaf):
    """Area of the box of some boxes, times the blocks that they fill."""
    x, y, z = high[which].max(axis=0) - low[which].min(axis=0)
    return (x * y + y * z + z * x) * -(-len(which) // leaf)


def cheapest(low, high, which, leaf):
    """Cost of the best split of some boxes: of all where they are few, else between bins of equal width (Wald 2007)."""
    costs = []
    for axis in range(3):
        centre = (low + high)[which, axis]
        if len(which) <= SWEEP:
            order = np.argsort(centre, kind="stable")
            lefts = [np.isin(np.arange(len(which)), order[:k]) for k in range(1, len(which))]
        else:
            bins = ((centre - centre.min()) * 0.9999 * BINS / np.ptp(centre)).astype(int)
            lefts = [left for k in range(1, BINS) if 0 < (left := bins < k).sum() < len(which)]
        costs += [cost(low, high, which[left], leaf) + cost(low, high, which[~left], leaf) for left in lefts]
    return min(costs)


def levels_of_halves(count, leaf):
    return int(np.ceil(np.log2(-(-count // leaf))))


@pytest.mark.parametrize("leaf", [1, 4])
@pytest.mark.parametrize("are_halves", [False, True])
def test_splits_of_subtrees_are_those_that_their_sizes_ask_for(session: Session, leaf, are_halves) -> None:
    random = np.random.default_rng(5)
    ends = np.cumsum((0, *SIZES))
    stretch = np.repeat(random.permuted(np.tile([1.0, 3.0, 7.0], (len(SIZES), 1)), axis=1), SIZES, axis=0)
    low = (random.normal(size=(ends[-1], 3)) * stretch).astype(np.float32)
    high = low + random.exponential(0.2, low.shape).astype(np.float32)
    depths = [DEEPEST - levels_of_halves(size, leaf) if are_halves else 0 for size in SIZES]
    builder = Builder(session, low, high, leaf, DEEPEST)
    ranges = np.array([(*pair, depth, 0) for pair, depth in zip(pairwise(ends), depths, strict=True)], np.int32)
    marks = builder.build_subtrees(ranges, np.zeros(ends[-1], np.uint8))
    starts = np.union1d(np.flatnonzero(marks), ends).astype(np.int32)
    blocks, _ = builder.leaves(starts)
    order, low, high = blocks[blocks >= 0], low.astype(np.float64), high.astype(np.float64)
    assert [set(order[a:b]) for a, b in pairwise(ends)] == [set(range(a, b)) for a, b in pairwise(ends)]
    waiting = [tuple(each[:3]) for each in ranges]
    while waiting:
        begin, end, depth = waiting.pop()
        if end - begin <= leaf:
            assert not marks[begin + 1 : end].any()
            continue
        (middle,) = begin + 1 + np.flatnonzero(marks[begin + 1 : end] == depth + 1)
        left, right = order[begin:middle], order[middle:end]
        if depth + levels_of_halves(end - begin, leaf) >= DEEPEST:
            blocks = -((begin - end) // leaf)
            assert middle - begin == leaf * ((blocks + 1) // 2)  # whole blocks, the odd one left
            axis = np.ptp((low + high)[order[begin:end]], axis=0).argmax()
            assert (low + high)[left, axis].max() <= (low + high)[right, axis].min()
        else:
            found = cost(low, high, left, leaf) + cost(low, high, right, leaf)
            assert found == pytest.approx(cheapest(low, high, order[begin:end], leaf), rel=1e-5)  # float32
        waiting += [(begin, middle, depth + 1), (middle, end, depth + 1)]
