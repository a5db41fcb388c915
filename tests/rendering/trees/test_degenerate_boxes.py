"""Boxes that no mesh should have, and some that meshes do have."""

import numpy as np
import pytest

from rptcam_cl.rendering.tree_build import EMPTY, build_bvh
from tests.rendering.trees.trees import check, quality


def points(*columns):
    return np.stack(np.broadcast_arrays(*columns), axis=-1).astype(np.float32)


def log_scales(count):
    """Points that crowd at the origin: each split takes only a few of them away."""
    return points(np.ldexp(1.0, -np.arange(count) % 100), 0, 0)


SETS = {
    "one": points([1.0], 2, 3),
    "two": points([1.0, 4], 2, 3),
    "all in one place": points(np.ones(2000), 1, 1),
    "on a line": points(np.arange(2000) / 7, 0, 0),
    "on a slanted line": points(np.arange(999) / 7, np.arange(999) / 5, np.arange(999) / 3),
    "in a plane": points(np.arange(6400) % 80, np.arange(6400) // 80, 0),
    "huge": points(1e37 * np.cos(np.arange(999)), 1e37 * np.sin(np.arange(999)), 1e37),
    "tiny": points(1e-30 * np.cos(np.arange(999)), 1e-30 * np.sin(np.arange(999)), 0),
    "denormal": points(1e-43 * (np.arange(999) % 30), 0, 0),
    "far off": points(1e6 + np.arange(999) / 16, -1e6, 1e6),
    "crowded": log_scales(5000),
}


@pytest.mark.parametrize(("width", "leaf_size"), [(8, 8), (4, 1)])
@pytest.mark.parametrize("name", sorted(SETS))
def test_points_make_a_tree(session, name, width, leaf_size):
    lower = SETS[name]
    bvh = build_bvh(lower, lower, width=width, leaf_size=leaf_size, session=session)
    check(bvh, lower, lower, width, leaf_size)


@pytest.mark.parametrize("power", [90, -90])
def test_size_of_a_flat_mesh_changes_no_split(session, power):
    lower = points(*np.random.default_rng(6).random((2, 3000)), 0)
    one, other = (
        build_bvh(scaled, scaled, width=8, leaf_size=8, session=session)
        for scaled in (lower, np.ldexp(lower, power).astype(np.float32))
    )
    np.testing.assert_array_equal(other.blocks, one.blocks)
    np.testing.assert_array_equal(other.children, one.children)


def test_no_primitives_give_a_root_without_children(session):
    nothing = np.empty((0, 3), np.float32)
    bvh = build_bvh(nothing, nothing, session=session)
    assert (bvh.children == EMPTY).all()
    assert (bvh.bounds[:, :3] == np.inf).all()
    assert (bvh.bounds[:, 3:] == -np.inf).all()
    assert bvh.blocks.shape == (0, 8)
    assert quality(bvh).depth == 1


def test_one_block_of_primitives_is_one_child_of_the_root(session):
    lower = SETS["on a line"][:8]
    bvh = build_bvh(lower, lower + np.float32(1), session=session)
    assert (bvh.children[0] != EMPTY).sum() == 1
    assert np.array_equal(np.sort(bvh.blocks), [np.arange(8)])


def test_many_boxes_in_one_place_fill_their_blocks_in_a_flat_tree(session):
    lower = np.ones((1 << 18, 3), np.float32)
    figures = quality(build_bvh(lower, lower + np.float32(1), session=session))
    assert figures.fill == 1.0
    assert figures.nodes < 1.1 * (1 << 15) / 7  # eight children each
    assert figures.depth <= 10


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 2e37, -2e37])
def test_box_that_is_not_finite_is_refused_by_number(session, wrong):
    lower = np.zeros((10, 3), np.float32)
    lower[6, 1] = wrong
    with pytest.raises(ValueError, match="box 6 from"):
        build_bvh(lower, np.maximum(lower, 1), session=session)


def test_box_turned_inside_out_is_refused(session):
    lower = np.zeros((10, 3), np.float32)
    upper = lower + np.float32([1, 1, -1])
    with pytest.raises(ValueError, match="box 0 from"):
        build_bvh(lower, upper, session=session)


@pytest.mark.parametrize(("width", "leaf_size"), [(3, 8), (8, 0), (8, 3), (8, 128), (1, 1)])
def test_impossible_layout_is_refused(session, width, leaf_size):
    lower = np.zeros((10, 3), np.float32)
    with pytest.raises(ValueError, match="expected powers of two"):
        build_bvh(lower, lower, width=width, leaf_size=leaf_size, session=session)


def test_boxes_of_another_shape_are_refused(session):
    with pytest.raises(ValueError, match=r"expected twice \(n, 3\)"):
        build_bvh(np.zeros((4, 3), np.float32), np.zeros((5, 3), np.float32), session=session)
