"""The tests themselves: each deliberate fault in a copy of the kernels must make one of them fail."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

from rptcam_cl.rendering.plan.plan import make_plan
from tests.device import test_bsdf_sampling as bsdf_sampling
from tests.device import test_bsdf_values as bsdf_values
from tests.device import test_camera_rays as rays
from tests.device import test_covers as covers
from tests.device import test_random as random
from tests.device.probes import open_session
from tests.rendering import test_determinism as determinism
from tests.rendering import test_emitters as emitters
from tests.rendering import test_furnaces as furnaces
from tests.rendering import test_lens_light as lens
from tests.rendering import test_material_maps as maps
from tests.rendering import test_materials as materials
from tests.rendering import test_world as world
from tests.rendering.cameras import test_exposure as exposure
from tests.rendering.light import test_light_tree as tree
from tests.rendering.light import test_solid_lamps as solids
from tests.rendering.pictures import WHITE, looking, pixels, scene_of
from tests.rendering.primitives import test_culling as culling
from tests.rendering.primitives import test_tree_hits as tree_hits
from tests.support.mutants import Mutant, assert_alive, assert_found, each_mutant

pytestmark = pytest.mark.slow


def picks_of_the_tree():
    tree.test_evenly_spread_numbers_pick_each_emitter_as_often_as_it_says(open_session(), tree.planned(tree.AFAR))


def weights_of(shape):
    scene = solids.every_lamp()
    solids.test_weights_add_up_to_the_solid_angle(open_session(), scene, make_plan(scene), shape, "skewed and mirrored")


def samples_of(name):
    bsdf_sampling.test_samples_follow_the_density_and_no_more_light_comes_back(open_session(), name)


def pixel_of_rays():
    rays.test_rays_through_a_lens_come_from_their_pixel_when_traced_back(open_session(), "dgauss-50mm", True)


def lens_row():
    lens.test_film_irradiance_is_that_of_the_truth_table("dgauss50", 1, 0)


def lens_corner():
    lens.test_film_irradiance_is_that_of_the_truth_table("dgauss50", 0, 2)


def cavity():
    furnaces.test_every_sample_in_a_cavity_is_the_truncated_series(1.0, 0.8, 5)


def white_sphere():
    furnaces.test_white_convex_body_vanishes_in_a_white_world("sphere", 1.0)


def white_box():
    furnaces.test_white_convex_body_vanishes_in_a_white_world("box", 1.0)


def in_folder(test, shape):
    """Run a test that writes pictures in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        test(Path(folder), patch, shape)


def without_shape(test):
    """Run a test that writes pictures in a folder of its own, and takes nothing else."""
    in_folder(lambda folder, patch, _: test(folder, patch), None)


def long_render():
    """A render of many equal samples is that sample."""
    floor = {**world.PLANE, "material": {"kind": "matte", "reflectance": 0.7}}
    camera = looking([0, 0, 1], [0, 0, 0], up=(0, 1, 0))
    scene = scene_of([floor], camera, depth=2, resolution=(4, 4), environment=WHITE)
    np.testing.assert_allclose(pixels(scene, spp=100_000), np.float32(0.7), rtol=1e-6)


def loop_beside_the_tree():
    """What blocks a ray by the loop over all primitives and by the tree."""
    with pytest.MonkeyPatch.context() as patch:
        tree_hits.test_hits_are_those_of_the_loop(open_session(), patch, "random", 8)


def along_the_axes():
    culling.test_hits_along_the_axes_are_those_of_formulas(open_session(), "along the axes", 8)


def leaving_along_the_axes():
    culling.test_rays_leave_a_box_along_the_axes_and_flat_ones(open_session())


RIM = "p.y * p.y <= surface->semi_diameter2"
DEPTH = """#if !HAS_LAMPS
    on = on & (path->depth < rules.max_depth);"""
MIS = "return own > 0.0f ? own2 / (own2 + other * other)"
CLOSER = """EACH_PRIMITIVE(ray, ALL_FLATS,
        IF_SEEN t = PAST_HOLES(met & (t > 0.0f) & (t < best));
        I closer = met & (t > 0.0f)"""
ORIGIN = "s.c = origin ? ZERO : c;"
MUTANTS = [
    Mutant("axes of a flat one exchanged", "hit.a = ray.o.z + hit.t * ray.d.z;\n        hit.b = ray.o.x",
           "hit.b = ray.o.z + hit.t * ray.d.z;\n        hit.a = ray.o.x", along_the_axes),
    Mutant("infinite slopes at a box", "MIN(MAX(x, (F)(-1e30f)), (F)(1e30f))", "x", along_the_axes),
    Mutant("flat ones met at 1e30", "(stands - ray.o.y) * axes.inverse.y", "(stands - ray.o.y) * axes.slope.y",
           along_the_axes),
    Mutant("a box left where it was entered", "F3 k = f3(half_size.x *", "origin = FALSE; F3 k = f3(half_size.x *",
           leaving_along_the_axes),
    Mutant("cos^3 for cos^4", "cos2_over_length2 * cos2_over_length2;",
           "cos2_over_length2 / sqrt(ray.length2);", lens_corner),
    Mutant("no root in the pupil", "F rho = sqrt(v);", "F rho = v;", lens_corner),
    Mutant(
        "no root in the aperture", "F r = sqrt(v);\n    *x = r * c;", "F r = v;\n    *x = r * c;",
        lambda: rays.test_round_aperture_is_filled_evenly(open_session()),
    ),
    Mutant("diameter for radius", RIM, "p.y * p.y <= 4 * surface->semi_diameter2", lens_row),
    Mutant("stop 1 % wider", RIM, "p.y * p.y <= 1.02f * surface->semi_diameter2", lens_row),
    Mutant("index off by 1e-3", "F eta = (F)(s->eta);", "F eta = (F)(s->eta + 1e-3f);", pixel_of_rays),
    Mutant("normal not unit", "hit.n = f3(-c * hit.p.x, -c", "hit.n = f3(-1.01f * c * hit.p.x, -c", pixel_of_rays),
    Mutant("pupil too tight", "o.r = midway(midway(", "o.r = 0.9f * midway(midway(", lens_row),
    Mutant("blocked rays weigh", "r.weight = passed ? weight : ZERO", "r.weight = weight", lens_corner),
    Mutant("exposure forgotten", "ray.weight * camera->exposure", "ray.weight",
           lambda: exposure.test_unit_radiance_gives_the_irradiance_of_the_tables_on_the_axis(
               "dgauss-50mm", 8.55, 0.04665, 0.005)),
    Mutant("depth off by one", DEPTH, DEPTH.replace("<", "<="), cavity),
    Mutant("survivors keep their weight", "path->beta = scale(path->beta, ONE / survive)", "",
           lambda: furnaces.test_roulette_changes_no_mean(1)),
    Mutant("roulette as kind everywhere", "return GATHER(F, survival_scale, cell, )", "return (F)(2.0f)",
           furnaces.test_roulette_spares_paths_where_the_picture_is_dark),
    Mutant("survival_scale of the wrong column", "I cell = row * limits.cells_across + column",
           "I cell = row * limits.cells_across + limits.cells_across - 1 - column",
           furnaces.test_roulette_spares_paths_where_the_picture_is_dark),
    Mutant("roulette of unlit paths is that of lit ones", "MAX(path.survival_scale, (F)(LEAST_UNLIT))",
           "path.survival_scale", furnaces.test_roulette_of_a_path_without_light_is_four_times_as_kind),
    Mutant("roulette by the throughput alone", "survival_scale * max3(path.beta)", "max3(path.beta)",
           furnaces.test_roulette_is_kinder_than_the_throughput),
    Mutant("no least chance", "max3(path.beta), (F)(LEAST_CHANCE)", "max3(path.beta), (F)(1e-6f)",
           furnaces.test_roulette_lets_go_on_one_of_twenty_at_least),
    Mutant("one side of MIS to the first power", MIS,
           "return own > 0.0f ? own / (own + other)", emitters.test_rectangle_above_its_corner),
    Mutant("MIS without emission's weight", MIS, "return own > 0.0f ? ONE",
           emitters.test_disk_beside_the_normal),
    Mutant("light density lacks the pick", "s->pdf = faces ? pick * d2", "s->pdf = faces ? d2",
           emitters.test_emitters_of_every_kind_add_up),
    Mutant("point light lacks the pick", "ONE / (d2 * pick)", "ONE / d2", emitters.test_emitters_of_every_kind_add_up),
    Mutant("cone of a sphere lamp too wide", "F versine = u * sin2_max", "F versine = u * 1.1f * sin2_max",
           lambda: emitters.test_sphere(1.5, 0.9)),
    Mutant("directions of an ellipsoid not stretched", "cubed(stretch) * ", "stretch * ",
           lambda: weights_of("ellipsoid")),
    Mutant("face of a box chosen at no cost", "relative * relative * share *", "relative * relative *",
           lambda: weights_of("box")),
    Mutant("tube seen as wide from everywhere", "(angle * line.span)", "(PI_F * line.span)",
           lambda: weights_of("cylinder")),
    Mutant("generators of a cone chosen evenly", "1.5f * (1.0f - x * x)", "ONE", lambda: weights_of("cone")),
    Mutant("light tree leans to one side", "F left = light.a + light.b;", "F left = 1.1f * (light.a + light.b);",
           picks_of_the_tree),
    Mutant("suns picked at no cost", "light * per_light : *pick", "ONE : *pick", picks_of_the_tree),
    Mutant("shadows forgotten", "gather_light(&path, wanted & NOT(dark)", "gather_light(&path, wanted",
           lambda: emitters.test_light_without_a_surface_is_blocked("point")),
    Mutant("samples share their numbers", "h.b = sample * 1664525u", "h.b = sample * 0u",
           determinism.test_variance_of_independent_samples_falls_as_one_over_their_number),
    Mutant("lattice stands still", "U phi = reversed_bits(sample);\n    I deep", "U phi = (U)(0u);\n    I deep",
           determinism.test_variance_of_smooth_light_falls_far_faster_on_the_lattice),
    Mutant("lattice without a shift", "U4 x = hash4(pixel, (U)(0u), dimension, seed);",
           "U4 x = hash4((U)(0u), (U)(0u), (U)(0u), seed);", determinism.test_neighbouring_pixels_are_independent),
    Mutant("digits not mirrored", "return (x >> 16) | (x << 16);", "return x;",
           determinism.test_variance_of_smooth_light_falls_far_faster_on_the_lattice),
    Mutant("pixels xor samples", "h.a = pixel * 1664525u", "h.a = (pixel ^ sample) * 1664525u",
           lambda: random.test_device_computes_the_published_permutation(open_session(), 8)),
    Mutant("unit float reaches one", "TO_F(AS_I(x >> 8)) * 5.9604644775390625e-8f",
           "TO_F(AS_I(x >> 8)) * 5.9604651880817983e-8f",
           lambda: random.test_unit_float_is_below_one_and_hits_zero(open_session())),
    Mutant("absolute epsilon", CLOSER, CLOSER.replace("closer = met & (t > 0.0f)", "closer = met & (t > 1e-4f)"),
           lambda: furnaces.test_every_sample_in_a_cavity_is_the_truncated_series(1e-3, 0.8, 5)),
    Mutant("self-hits of a sphere", ORIGIN, "s.c = c;", white_sphere),
    Mutant("self-hits of a box", "return origin ? other : outside;", "return outside;", white_box),
    Mutant("shadow rays stop short of planes", "reach * LITTLE_MORE", "0.5f * reach", loop_beside_the_tree),
    Mutant("spheres round the start left out", "MAX(s.b, -s.c) >= 0.0f", "s.b >= 0.0f", loop_beside_the_tree),
    Mutant("cosine weight missing", "F z = root(1.0f - v);", "F z = 1.0f - v;",
           lambda: world.test_gradient_world_on_a_tilted_plane_has_its_closed_form(50)),
    Mutant("gradient half as steep", "F k = 0.5f + 0.5f * (d.x", "F k = 0.5f + 0.25f * (d.x",
           lambda: world.test_gradient_world_on_a_tilted_plane_has_its_closed_form(0)),
    Mutant("radiance not divided by n squared", "squeeze = reflects ? ONE : inverse * inverse",
           "squeeze = reflects ? ONE : inverse",
           lambda: furnaces.test_white_world_is_n_squared_as_bright_inside_glass(1.5)),
    Mutant("no masking in GGX", "half_density * wo.z / (wo.z * si + wi.z * so)", "half_density / (wi.z + si)",
           lambda: furnaces.test_rough_metal_reflects_what_single_scattering_leaves(1.0, 60)),
    Mutant("refracted radiance not divided by n squared", "density * unshadowed / (eta * eta)", "density * unshadowed",
           lambda: bsdf_values.test_rough_dielectric_is_walters(open_session(), 0.5, 1.5, False)),
    Mutant("coat chosen at no cost", "density += lobes.coat * (coat_density - density);", "",
           lambda: samples_of("coated")),
    Mutant("base chosen at no cost", "density += lobes.under * (up - density);", "",
           lambda: samples_of("rough plastic")),
    Mutant("base does not lose the way out", "up * (1.0f - of.cover)", "up",
           lambda: bsdf_values.test_reflection_is_the_same_either_way(open_session(), "principled", False)),
    Mutant("coats let light out by the camera's direction alone", "return wo.z < 0.0f ? in : passed;", "return in;",
           lambda: covers.test_coat_over_chalk_is_a_smooth_plastic(open_session())),
    Mutant("light that metal reflects again by the camera's direction alone", "up * of.again",
           "up * 0.12f",
           lambda: covers.test_metal_reflects_what_walks_among_its_facets_say_the_same_either_way(
               open_session(), "conductor", 0.5)),
    Mutant("absorption also outside", "I inside = dot3(vertex.ng, d) > 0.0f;", "I inside = TRUE;",
           materials.test_light_through_an_absorbing_slab_is_beers_law),
    Mutant("panes absorb the way to them", "material->kind == MATERIAL_THIN_GLASS ? BLACK_3 : ", "",
           materials.test_pane_from_behind_is_the_same_beside_glass_that_absorbs),
    Mutant("one reflection in a pane", "MAX(1.0f - r * r * t * t, (F)(SMALLEST))", "ONE",
           lambda: materials.test_pane_passes_what_all_its_reflections_leave(80)),
    Mutant("normals of mirrored coordinates", "with_sign(ONE, dot3(*y, point.bitangent))", "ONE",
           lambda: in_folder(materials.test_normal_map_turns_the_normal_in_the_frame_of_u_and_v, "mirrored mesh")),
    Mutant("brushed the other way round", "return along(scale(x, cosine * u - sine * v), y, sine * u + cosine * v);",
           "return along(scale(x, cosine * u + sine * v), y, cosine * v - sine * u);",
           lambda: materials.test_brushed_metal_turns_from_u_towards_v(1)),
    Mutant("strength of brushing not squared", "(1.0f - across) * strength * strength", "(1.0f - across) * strength",
           lambda: in_folder(maps.test_constant_anisotropy_map_is_as_numbers, 0.4)),
    Mutant("grazing light coloured", "return along(f0, sub(f3(most, most, most), f0), steep);",
           "return scale(f0, 1.0f + (1.0f - max3(f0)) / max3(f0) * steep);",
           lambda: bsdf_values.test_value_is_that_of_the_formula(open_session(), "coloured gloss")),
    Mutant("coat drawn about the base's normal",
           "h = select3(coated, from_frame(lobes.coat_s, lobes.coat_t, lobes.coat_n, h), h);", "",
           lambda: without_shape(maps.test_flat_coat_shines_over_a_wild_base_as_over_a_smooth_one)),
    Mutant("coat hidden where the base looks away", "agrees = agrees | (coated &", "agrees = agrees & TRUE | (FALSE &",
           lambda: without_shape(maps.test_flat_coat_shines_over_a_wild_base_as_over_a_smooth_one)),
    Mutant("roughness not squared", "return MAX(roughness * roughness, (F)(SMALLEST_ALPHA));", "return roughness;",
           materials.test_textured_numbers_are_as_constant_ones,
           lambda: materials.test_textures_of_layers_are_as_constant_ones({"clearcoat_roughness": 0.5})),
    Mutant("chance of a mix reused", "vertex->lobe = mine ? rest : choice;", "",
           materials.test_mix_is_the_mean_of_its_parts_where_light_is_scattered_once),
    Mutant("film adds without its rest", "F3 y = sub(value, s.rest);", "F3 y = add(value, s.rest);",
           long_render),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_is_found(mutant):
    assert_found(mutant)


@each_mutant(MUTANTS)
def test_its_tests_pass_without_the_fault(mutant):
    assert_alive([mutant])
