"""The tests of photons, ghosts and rays aimed at lamps themselves: each deliberate fault must make one of them fail."""

import numpy as np
import pytest

from tests.rendering import test_bokeh as bokeh
from tests.rendering import test_ghosts as ghosts
from tests.rendering.caustics import test_photons as photons
from tests.support.mutants import Mutant, assert_alive, assert_found, each_mutant

pytestmark = pytest.mark.slow


def wall_of_mirror():
    irradiance = 3.0 / 3.25**1.5 * np.array([0.9, 0.6, 0.3])
    photons.test_light_of_a_lamp_without_size_is_the_closed_form([0.6, 0, 0.4], [0.5, 0, 0], irradiance)


def ghosts_of_a_sun():
    ghosts.test_a_sun_has_the_ghosts_of_the_lens()


def aimed_rays():
    bokeh.test_aimed_rays_make_the_same_picture("far")


MUTANTS = [
    Mutant("photons weigh by the plane across their way", "weight / MAX(absolute(dot3(vertex.ng, way)),",
           "weight / MAX(ONE,", wall_of_mirror),
    Mutant("disk of photons without its kernel", "2.0f * INV_PI_F / radius2", "INV_PI_F / radius2", wall_of_mirror),
    Mutant("ghosts of a sun by the plane across its light", "d->z * vertex2 / length2 : d->z;",
           "d->z * vertex2 / length2 : ONE;", ghosts_of_a_sun),
    Mutant("ghosts lose the carry", "high += before + low < before ? 1u : 0u;", "", ghosts_of_a_sun),
    Mutant("half the density of aimed rays", "sum += inside ? share * density : ZERO;",
           "sum += inside ? 0.5f * share * density : ZERO;", aimed_rays),
    Mutant("rays that do not aim leave out a wedge", "MIN((u - a.rest) / (1.0f - a.rest),", "MIN(u,", aimed_rays),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_is_found(mutant):
    assert_found(mutant)


def test_their_tests_pass_without_the_faults():
    assert_alive(MUTANTS)
