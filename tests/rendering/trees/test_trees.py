"""Trees over meshes: right, good, repeatable, and like brute force for rays."""

import numpy as np
import pytest

from rptcam_cl.rendering.tree_build import STACK_STEP, build_bvh, stack_size
from tests.rendering.trees.meshes import boxes_of, hall, knot, nearest, rays_through, soup
from tests.rendering.trees.trees import check, quality, traverse

LAYOUTS = [(8, 8), (4, 4), (8, 1), (2, 2)]
MESHES = {"soup": lambda: soup(5000), "knot": knot, "hall": hall}


@pytest.fixture(scope="module", params=sorted(MESHES))
def triangles(request):
    return MESHES[request.param]()


@pytest.mark.parametrize(("width", "leaf_size"), LAYOUTS)
def test_tree_holds_every_primitive_once_in_exact_boxes(session, triangles, width, leaf_size):
    lower, upper = boxes_of(triangles)
    bvh = build_bvh(lower, upper, width=width, leaf_size=leaf_size, session=session)
    check(bvh, lower, upper, width, leaf_size)


@pytest.mark.parametrize(("width", "leaf_size"), [(8, 8), (4, 4)])
def test_nearest_hits_are_those_of_brute_force(session, triangles, width, leaf_size):
    bvh = build_bvh(*boxes_of(triangles), width=width, leaf_size=leaf_size, session=session)
    origins, directions = rays_through(triangles, 60)
    expected = nearest(triangles, origins, directions)
    found = [traverse(bvh, triangles, o, d) for o, d in zip(origins, directions, strict=True)]
    assert np.array_equal([t for t, _ in found], expected)
    assert 5 < np.isfinite(expected).sum() < 60
    assert np.mean([steps for _, steps in found]) < 0.1 * len(bvh.blocks)  # a tree that opened all would pass, too


def test_large_tree_is_as_right_as_small_ones(session):
    triangles = soup(40000, size=0.02)  # several large nodes, copies back, and subtrees
    lower, upper = boxes_of(triangles)
    check(build_bvh(lower, upper, session=session), lower, upper, 8, 8)


def test_same_boxes_give_the_same_tree(session):
    lower, upper = boxes_of(soup(20000))
    one, two = (build_bvh(lower, upper, session=session) for _ in range(2))
    assert np.array_equal(one.bounds, two.bounds)
    assert np.array_equal(one.children, two.children)
    assert np.array_equal(one.blocks, two.blocks)


@pytest.mark.parametrize("power", [-60, -10, 10, 60])
def test_scene_scaled_by_a_power_of_two_gives_the_same_tree(session, power):
    lower, upper = boxes_of(hall())
    one = build_bvh(lower, upper, session=session)
    two = build_bvh(np.ldexp(lower, power), np.ldexp(upper, power), session=session)
    assert np.array_equal(np.ldexp(one.bounds, power), two.bounds)
    assert np.array_equal(one.blocks, two.blocks)


def test_leaf_blocks_are_well_filled(session):
    assert quality(build_bvh(*boxes_of(knot()), session=session)).fill > 0.75


def test_stacks_have_few_sizes_and_always_room():
    entries = np.arange(1, 130)
    sizes = np.array([stack_size(n) for n in entries.tolist()])
    assert ((entries <= sizes) & (sizes < entries + STACK_STEP)).all()
    assert len(set(sizes.tolist())) == 9
