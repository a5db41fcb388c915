"""How good trees are: beside a builder that tries every split, and what moving nodes adds."""

from itertools import pairwise

import numpy as np
import pytest

from rptcam_cl.device.session import Session
from rptcam_cl.rendering import tree_build
from rptcam_cl.rendering.tree_build import BINS, MAX_STACK, SWEEP, Builder, binary_tree, build_bvh, reinsert, widen
from tests.rendering.trees.meshes import boxes_of, hall, knot, soup
from tests.rendering.trees.trees import quality
from tests.support.cases import slow

WIDTH, LEAF = 8, 8


def area(low, high):
    x, y, z = np.moveaxis(high - low, -1, 0)
    return x * y + y * z + z * x


def best_split(low, high):
    """Order and number on the left of the cheapest of all splits along all axes."""
    count, best = len(low), (np.inf, None, 0)
    for axis in range(3):
        order = np.argsort(low[:, axis] + high[:, axis], kind="stable")
        a, b = low[order], high[order]
        left = area(np.minimum.accumulate(a), np.maximum.accumulate(b))[:-1]
        right = area(np.minimum.accumulate(a[::-1]), np.maximum.accumulate(b[::-1]))[-2::-1]
        number = np.arange(1, count)
        costs = left * -(-number // LEAF) + right * -(-(count - number) // LEAF)
        if costs.min() < best[0]:
            best = costs.min(), order, int(costs.argmin()) + 1
    return best[1:]


def halves_as_they_come(low, high):
    return np.arange(len(low)), len(low) // 2


def cost_of_reference(low, high, split):
    """SAH cost of wide nodes that open their largest child, over binary splits by `split`."""

    def parts(which):
        order, left = split(low[which], high[which])
        return which[order[:left]], which[order[left:]]

    def box_area(which):
        return area(low[which].min(axis=0), high[which].max(axis=0))

    total, waiting = 0.0, [np.arange(len(low))]
    while waiting:
        children = [waiting.pop()]
        total += box_area(children[0])
        while len(children) < WIDTH:
            worth = [box_area(child) if len(child) > LEAF else -1.0 for child in children]
            if max(worth) < 0:
                break
            children.extend(parts(children.pop(int(np.argmax(worth)))))
        total += sum(box_area(child) for child in children if len(child) <= LEAF)
        waiting.extend(child for child in children if len(child) > LEAF)
    return total / box_area(np.arange(len(low)))


@pytest.mark.parametrize("mesh", [lambda: soup(2000), knot, hall], ids=["soup", "knot", "hall"])
def test_cost_is_within_a_tenth_of_a_builder_that_tries_every_split(session, mesh):
    lower, upper = boxes_of(mesh())
    ours = quality(build_bvh(lower, upper, session=session)).cost
    low, high = lower.astype(np.float64), upper.astype(np.float64)
    reference = cost_of_reference(low, high, best_split)
    assert ours < 1.1 * reference
    assert cost_of_reference(low, high, halves_as_they_come) > 1.1 * reference  # what a poor builder gets


def inner_area(tree):
    bounds = tree.bounds[tree.leaves :].astype(np.float64)
    return float(area(bounds[:, :3], bounds[:, 3:]).sum())


def test_moving_nodes_takes_area_away_and_keeps_boxes_exact(session):
    random = np.random.default_rng(7)
    low = random.uniform(0, 1, (3000, 3)).astype(np.float32)
    bounds = np.concatenate([low, low + random.uniform(0, 0.1, (3000, 3)).astype(np.float32) ** 2], axis=1)
    bounds = bounds[np.argsort(low[:, 0])]  # a tree that has only seen x
    tree = binary_tree(halving_depths(0, len(bounds)), bounds)
    better = reinsert(tree, 127, session)
    assert inner_area(better) < 0.6 * inner_area(tree)
    assert np.array_equal(better.bounds[: tree.leaves], bounds)
    left, right = better.bounds[better.children[:, 0]], better.bounds[better.children[:, 1]]
    inner = better.bounds[tree.leaves :]
    assert np.array_equal(inner[:, :3], np.minimum(left, right)[:, :3])
    assert np.array_equal(inner[:, 3:], np.maximum(left, right)[:, 3:])
    hanging = np.sort(np.append(better.children.ravel(), better.root))
    assert np.array_equal(hanging, np.arange(len(better.bounds)))


def test_no_launch_moves_more_nodes_than_a_screen_waits_for(session, monkeypatch):
    lower, upper = boxes_of(soup(4000))
    bounds = np.concatenate([lower, upper], axis=1)[np.argsort(lower[:, 0])]
    tree = binary_tree(halving_depths(0, len(bounds)), bounds)
    counts = []

    def bind(program, kernel, /, **arguments):
        if kernel == "reinsert":
            counts.append(int(arguments["count"]))
        return Session.bind(session, program, kernel, **arguments)

    monkeypatch.setattr(session, "bind", bind)
    split = reinsert(tree, 127, session)
    assert max(counts) <= 2048 < sum(counts[:2])
    monkeypatch.setattr(tree_build, "MOVES_OF_LAUNCH", 1 << 16)
    np.testing.assert_array_equal(split.children, reinsert(tree, 127, session).children)
    assert max(counts) > 2048


def halving_depths(first, last):
    depths = np.zeros(last - first - 1, np.uint8)
    waiting = [(first, last, 1)]
    while waiting:
        begin, end, depth = waiting.pop()
        if end - begin > 1:
            eights = (end - begin) // 8
            middle = begin + (8 * (eights // 2) if eights > 1 else (end - begin) // 2)
            depths[middle - 1 - first] = depth
            waiting += [(begin, middle, depth + 1), (middle, end, depth + 1)]
    return depths


def test_moving_nodes_helps_where_large_and_small_things_mix(session, monkeypatch):
    lower, upper = boxes_of(np.concatenate([hall(), soup(3000, size=3) * 20]))
    with_it = quality(build_bvh(lower, upper, session=session)).cost
    monkeypatch.setattr(tree_build, "reinsert", lambda tree, depth, session: tree)
    assert with_it < 0.97 * quality(build_bvh(lower, upper, session=session)).cost


def test_tree_that_would_get_too_deep_stays_as_it_was(session):
    lower, upper = boxes_of(soup(400))
    bounds = np.concatenate([lower, upper], axis=1)[np.argsort(lower[:, 0])]
    tree = binary_tree(halving_depths(0, len(bounds)), bounds)
    assert reinsert(tree, int(tree.height[tree.root]), session) is tree
    assert reinsert(tree, 127, session) is not tree


def nested_things(scales):
    """A thing of many overlapping parts, beside it another half as large ...: the larger parts fill every node."""
    parts = 56  # best seven by eight, beside the rest
    depths, bounds = [], []
    for k in range(scales):
        top = k + (k < scales - 1)  # the last thing parts from no other
        depths += [*(halving_depths(0, parts) + top), top]
        low = np.ldexp([1.0, 0.0, 0.0], -k)
        bounds += parts * [[*low, *(low + np.ldexp(1.0, -k))]]
    return binary_tree(np.array(depths[:-1], np.uint8), np.array(bounds, np.float32))


def test_traversal_stack_stays_bounded_in_the_deepest_trees(monkeypatch):
    tree = nested_things(48)
    assert tree.height[tree.root] <= tree_build.max_binary_depth(WIDTH)
    blocks = np.arange(tree.leaves, dtype=np.int32)[:, None]
    figures = quality(widen(tree, blocks, WIDTH))
    assert figures.stack <= MAX_STACK
    assert figures.depth <= tree_build.max_levels(WIDTH)
    monkeypatch.setattr(tree_build, "MAX_STACK", 10_000)
    assert quality(widen(tree, blocks, WIDTH)).stack > MAX_STACK


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


@pytest.mark.parametrize("leaf", [slow(1), 4])
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
