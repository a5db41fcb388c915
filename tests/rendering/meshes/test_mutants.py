"""The tests of meshes themselves: each deliberate fault in a copy of the kernels must make one of them fail."""

import pytest

from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from tests.rendering import test_meshes as pictures
from tests.rendering import test_opacity as opacity
from tests.rendering.meshes import test_hits as hits
from tests.support.mutants import Mutant, assert_alive, assert_found, each_mutant

pytestmark = pytest.mark.slow


def session() -> Session:
    return Session(choose_device())


def leaks():
    hits.test_no_ray_leaks_through_edges_or_vertices(session(), (1000, -2000, 500))


def trees():
    with pytest.MonkeyPatch.context() as patch:
        hits.test_tree_finds_what_every_triangle_finds(session(), patch, "flat grid", "axis", 8)


def departures():
    hits.test_rays_that_leave_a_convex_mesh_do_not_meet_it_again(session())


def instances():
    with pytest.MonkeyPatch.context() as patch:
        turn = [{"scale": [-1, 1, 1]}]
        hits.test_instances_are_met_where_copies_are(session(), patch, turn)


def lamp():
    pictures.test_lamp_and_box_of_triangles_look_as_the_shapes(None)


MUTANTS = [
    Mutant("fused edge functions", "#pragma OPENCL FP_CONTRACT OFF\n    const",
           "#pragma OPENCL FP_CONTRACT ON\n    const", leaks),
    Mutant("planes of a slab with finite inverse", "return (d < 0.0f ? (F)(-1.0f) : ONE) / absolute(d);",
           "return (d < 0.0f ? (F)(-1.0f) : ONE) / MAX(absolute(d), (F)(1e-18f));", trees),
    Mutant("no step off the surface", "with_sign(vertex.offset, dot3(vertex.ng, d))", "ZERO", departures),
    Mutant("normals by the matrix of points", "ox.x * ng.x + oy.x * ng.y + oz.x * ng.z",
           "x.x * ng.x + x.y * ng.y + x.z * ng.z", instances),
    Mutant("square folded wrongly", "*y = beyond ? ONE - *x : *y;", "*y = beyond ? *x : *y;", lamp),
    Mutant("holes where the surface is", "chance < opacity;", "chance > opacity;",
           lambda: opacity.test_share_of_rays_that_pass_is_what_opacity_leaves(opacity.SHEET, 0.3)),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_is_found(mutant):
    assert_found(mutant)


@each_mutant(MUTANTS)
def test_its_tests_pass_without_the_fault(mutant):
    assert_alive([mutant])
