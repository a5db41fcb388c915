"""The tests of losses themselves: every deliberate fault in a copy of the kernels fails one of them.

python -m pytest -m slow tests/rendering/cameras/test_loss_mutants.py
"""

import pytest

from tests.device.probes import open_session
from tests.rendering.cameras import test_losses as losses
from tests.support.mutants import Mutant, assert_alive, assert_found, each_mutant

pytestmark = pytest.mark.slow


def one_wavelength(name, kind):
    return lambda session: losses.test_rays_of_one_wavelength_keep_what_the_reference_says(
        session, name, kind, "single"
    )


def many_wavelengths(name, kind):
    return lambda session: losses.test_rays_of_many_wavelengths_keep_what_the_reference_says(
        session, name, kind, "single"
    )


BARE, LAYER = one_wavelength("dgauss-50mm", "bare"), one_wavelength("dgauss-50mm", "mgf2")
GLASS, HALF = one_wavelength("planar-1897", "glass"), one_wavelength("split dioptre", "glass")
MUTANTS = [
    Mutant("p like s", "F p = m * c + n * d;", "F p = n * c + m * d;", BARE),
    Mutant("phase of a layer without the angle", "F turn = turns * inside;", "F turn = turns;", LAYER),
    Mutant("layer without its index", "F ratio = n / f;", "F ratio = n;", LAYER),
    Mutant("half the phase", "turns = (F)(s->layer_turns)", "turns = (F)(0.5f * s->layer_turns)", LAYER),
    Mutant("index on the wrong side", "layer_share(n, n / eta,", "layer_share(n, n * eta,", LAYER),
    Mutant("measured coatings left out", "MIN(gain * bare_share", "MIN(bare_share",
           one_wavelength("dgauss-50mm", "measured")),
    Mutant("absorption along the axis", "* dot3(sub(hit.p, q), v);", "* (hit.p.z - q.z);", GLASS, HALF),
    Mutant("absorption beside half a lens", "depth = path->beside ? ZERO : depth;", "", HALF),
    Mutant("reflection beside half a lens", "share = path->beside ? ONE : share;", "",
           one_wavelength("split dioptre", "bare")),
    Mutant("no way between the rows of a table", "low + (place - TO_F(cell)) * (high - low)", "low",
           many_wavelengths("planar-1897", "measured")),
    Mutant("tables of another wavelength", "wavelength - (real)LOSS_TABLE_NM", "wavelength - (real)400",
           many_wavelengths("split dioptre", "glass")),
    Mutant("layers of another wavelength", "s->layer_turns / wavelength", "s->layer_turns / 550.0f",
           many_wavelengths("dgauss-50mm", "mgf2")),
]  # fmt: skip


@each_mutant(MUTANTS)
def test_fault_in_a_kernel_is_found(mutant):
    assert_found(mutant, open_session())


def test_the_killers_let_the_true_kernels_live():
    assert_alive(MUTANTS, open_session())
