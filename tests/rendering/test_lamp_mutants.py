"""The tests of photons, virtual lights, ghosts and rays aimed at lamps: each deliberate fault must make one fail."""

import numpy as np
import pytest

from tests.rendering import test_bokeh as bokeh
from tests.rendering import test_ghosts as ghosts
from tests.rendering.caustics import test_photons as photons
from tests.rendering.light import test_virtual_lights as virtual
from tests.support.mutants import Mutant, assert_alive, assert_found, each_mutant

pytestmark = pytest.mark.slow


def wall_of_mirror():
    irradiance = 3.0 / 3.25**1.5 * np.array([0.9, 0.6, 0.3])
    photons.test_light_of_a_lamp_without_size_is_the_closed_form([0.6, 0, 0.4], [0.5, 0, 0], irradiance)


def ghosts_of_a_sun():
    ghosts.test_a_sun_has_the_ghosts_of_the_lens()


def aimed_rays():
    bokeh.test_aimed_rays_make_the_same_picture("far")


def within_a_sphere():
    virtual.test_light_within_a_matte_sphere_is_the_closed_form(7, [0, 0, 0])


def photons_of_a_spot():
    virtual.test_light_through_glass_is_that_of_paths_and_photons("photons")


def frosted_globe():
    virtual.test_light_through_glass_is_that_of_paths_and_photons("frosted globe")


def tinted_pane():
    virtual.test_light_through_glass_is_that_of_paths_and_photons("pane")


def holes():
    virtual.test_light_is_that_of_paths_alone("holes")


MUTANTS = [
    Mutant("photons weigh by the plane across their way", "weight / MAX(absolute(dot3(vertex.ng, way)),",
           "weight / MAX(ONE,", wall_of_mirror),
    Mutant("disk of photons without its kernel", "2.0f * INV_PI_F / radius2", "INV_PI_F / radius2", wall_of_mirror),
    Mutant("ghosts of a sun by the plane across its light", "d->z * vertex2 / length2 : d->z;",
           "d->z * vertex2 / length2 : ONE;", ghosts_of_a_sun),
    Mutant("ghosts lose the carry", "high += before + low < before ? 1u : 0u;", "", ghosts_of_a_sun),
    Mutant("half the density of aimed rays", "sum += inside ? share * density : ZERO;",
           "sum += inside ? 0.5f * share * density : ZERO;", aimed_rays),
    Mutant("paths keep what connections bring", "return shared ? 1.0f - share : ONE;", "return ONE;", within_a_sphere),
    Mutant("connections to one edge too few", "AS_I(path->depth) + 1 +", "AS_I(path->depth) + 2 +", within_a_sphere),
    Mutant("connections forget the slant of the place", "share * cosine / distance2", "share / distance2",
           within_a_sphere),
    Mutant("light paths that go on weigh too little", "mul(path.beta, weight), ONE / survive)",
           "mul(path.beta, weight), ONE)", within_a_sphere),
    Mutant("light of a point by a mirror", "& (NOT(sizeless) | (smooth ? by_smooth : by_spread))", "",
           virtual.test_mirrored_light_of_a_lamp_without_size_stays_out_as_on_paths),
    Mutant("light of a point by glass and no photons", "I by_smooth = bounce == 1u ? (role & ROLE_SURFACE) != 0",
           "I by_smooth = bounce == 1u ? FALSE", photons_of_a_spot),
    Mutant("facets scatter by the light's way", "side_seen(vertex, back)", "side_seen(vertex, d)", frosted_globe),
    Mutant("glass absorbs nothing of light paths", "#if HAS_ABSORPTION\n        // As on a camera path",
           "#if 0\n        // As on a camera path", tinted_pane),
    Mutant("paths start in holes", "on = starts_on_something(start, on,", "starts_on_something(start, on,", holes),
    Mutant("rays that do not aim leave out a wedge", "MIN((u - a.rest) / (1.0f - a.rest),", "MIN(u,", aimed_rays),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_is_found(mutant):
    assert_found(mutant)


def test_their_tests_pass_without_the_faults():
    assert_alive(MUTANTS)
