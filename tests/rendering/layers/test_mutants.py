"""The tests of layers themselves: each deliberate fault in a copy of the kernels must make one of them fail."""

import pytest

from tests.rendering.layers import test_blur as blur
from tests.rendering.layers import test_geometry_layers as geometry
from tests.rendering.layers import test_means as means
from tests.rendering.layers.scenes import one_sample, world
from tests.support.mutants import Mutant, assert_alive, assert_found, each_mutant

pytestmark = pytest.mark.slow


def image(camera="thin_lens"):
    return one_sample(world(camera), geometry.GEOMETRY, seed=3)


def depths():
    geometry.test_depth_is_the_distance_along_the_axis("thin_lens", image())


def objects():
    geometry.test_points_lie_on_the_objects_that_are_named(image())


def facing():
    geometry.test_normals_are_unit_and_face_the_camera("thin_lens", image())


def lens_loop():
    geometry.test_lens_traced_back_in_float64_leads_from_each_point_to_its_pixel("double_gauss")


def mixed():
    means.test_means_mix_what_the_pixel_sees_as_the_light_does("double_gauss")


def first_rays():
    means.test_identifiers_are_those_of_the_first_ray_exactly("thin_lens")


def tilted():
    blur.test_tilted_lens_blurs_each_corner_in_its_own_way((0.15, 0.15))


def sky():
    blur.test_thin_lens_blurs_a_panel_and_the_sky_behind_it_by_the_closed_form()


MUTANTS = [
    Mutant("depth along the ray", "F depth = -dot3(seen_at, back);", "F depth = hit.t;", depths),
    Mutant("normals as they are", "I behind = dot3(vertex.ng, ray.d) > 0.0f;", "I behind = FALSE;", facing),
    Mutant("neighbour's name", "hit.primitive * 2 + which", "hit.primitive * 2 + 1 - which", objects),
    Mutant("u for v", "on ? uv.v :", "on ? uv.u :", objects),
    Mutant("weights forgotten", "F y = weight * value -", "F y = (weight != 0.0f ? value : ZERO) -", mixed),
    Mutant("last ray", "I fresh = passed & (sums.sum[SUM_OF_PASSED] == 0.0f);", "I fresh = passed;", first_rays),
    Mutant("pupil mirrored", "dot3(there, up) * view->per", "-dot3(there, up) * view->per", lens_loop),
    Mutant("film mirrored", "F x = (0.5f - 0.5f * film_x", "F x = (0.5f + 0.5f * film_x", tilted),
    Mutant("film upside down", "F y = (0.5f - 0.5f * film_y", "F y = (0.5f + 0.5f * film_y", tilted),
    Mutant("sky near", "F vergence = on ? ONE / MAX", "F vergence = TRUE ? ONE / MAX", sky),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_is_found(mutant):
    assert_alive([mutant])
    assert_found(mutant)
