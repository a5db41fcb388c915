"""The tests of wavelengths themselves: each deliberate fault in a copy of the kernels must make one of them fail."""

import pytest

from tests.device.probes import open_session
from tests.rendering.cameras import test_wavelengths as rays
from tests.rendering.spectrum import test_fringes as fringes
from tests.rendering.spectrum import test_modes as modes
from tests.rendering.spectrum import test_prism as prism
from tests.support.mutants import Mutant, assert_alive, assert_found, each_mutant

pytestmark = pytest.mark.slow

SF11 = modes.GLASS_BALL


def lines():
    prism.test_lines_stand_at_their_angles("SF11", "mercury")


def own_wavelengths():
    rays.test_every_ray_has_the_wavelength_of_its_own(open_session(), "achromat-100mm")


def edge_of_white():
    fringes.test_edge_in_white_light_has_its_fringes(3, "dispersive")


def glass_ball():
    modes.test_white_furnace_is_white("spectral", SF11, "pinhole")


MUTANTS = [
    Mutant("three wavelengths through glass that parts them", "F3 one = f3(3.0f * path->beta.x, ZERO, ZERO);",
           "F3 one = scale(path->beta, 3.0f);", glass_ball),
    Mutant("one wavelength stands for one", "F3 one = f3(3.0f * path->beta.x, ZERO, ZERO);",
           "F3 one = f3(path->beta.x, ZERO, ZERO);", glass_ball),
    Mutant("split at every vertex", "wavelength_sample = splits ? AS_F(AS_I(path->wavelength_sample) | SIGN_BIT)",
           "wavelength_sample = FALSE ? path->wavelength_sample",
           glass_ball),
    Mutant("wavelengths counted from the other end", "return start + (place - TO_F(cell)) * (end - start);",
           "return 1160.0f - (start + (place - TO_F(cell)) * (end - start));", lines),
    Mutant("glass of one index", "parameter = index_at(material, scene.inverse);",
           "parameter = index_at(material, 0.0f);", lines),
    Mutant("weights of the next channel", "GATHER(F, colours, cell * 4 + 1, ), GATHER(F, colours, cell * 4 + 2, ),",
           "GATHER(F, colours, cell * 4 + 2, ), GATHER(F, colours, cell * 4 + 1, ),", edge_of_white),
    Mutant("light behind the lens without its weight",
           "light = mul(light, share_of_wavelength(wavelength_sample, colours));", "", edge_of_white),
    Mutant("lens of one index", "F eta = eta_of(s, path->colour);", "F eta = (F)(s->eta);", own_wavelengths),
    Mutant("a term of the index forgotten", "for (int i = LENS_DISPERSION - 2; i >= 0; --i)",
           "for (int i = LENS_DISPERSION - 2; i >= 1; --i)", own_wavelengths),
    Mutant("white is even", "return mul(surface_in(h, rgb), h.white);", "return surface_in(h, rgb);",
           modes.test_colours_that_reflect_white_light_once_are_the_same_in_spectra),
    Mutant("third wavelength twice", "c.z = c.x + 2 * (WAVELENGTH_CELLS / 3);", "c.z = c.x + WAVELENGTH_CELLS / 3;",
           fringes.test_three_wavelengths_of_white_leave_little_noise),
    Mutant("weighted without having met the glass", "#if LENS_SPLITS\n    light = mul", "#if 1\n    light = mul",
           fringes.test_light_that_meets_no_dispersive_glass_has_the_noise_of_rgb),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_is_found(mutant):
    assert_found(mutant)


@each_mutant(MUTANTS)
def test_its_tests_pass_without_the_fault(mutant):
    assert_alive([mutant])
