"""The tests of losses themselves: every deliberate fault in a copy of the kernels fails one of them.

python -m pytest -m slow tests/lens_device/test_loss_mutants.py
"""

import pytest

from rptcam_cl.device import program
from tests.device.probes import open_session
from tests.lens_device import test_losses as losses
from tests.lens_device.test_mutants import KernelMutant, assert_killed, patched_kernels

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
    KernelMutant("p like s", "F p = m * c + n * d;", "F p = n * c + m * d;", (BARE,)),
    KernelMutant("phase of a layer without the angle", "F turn = turns * inside;", "F turn = turns;", (LAYER,)),
    KernelMutant("layer without its index", "F ratio = n / f;", "F ratio = n;", (LAYER,)),
    KernelMutant("half the phase", "turns = (F)(s->layer_turns)", "turns = (F)(0.5f * s->layer_turns)", (LAYER,)),
    KernelMutant("index on the wrong side", "layer_share(n, n / eta,", "layer_share(n, n * eta,", (LAYER,)),
    KernelMutant("measured coatings left out", "MIN(gain * bare_share", "MIN(bare_share",
                 (one_wavelength("dgauss-50mm", "measured"),)),
    KernelMutant("absorption along the axis", "* dot3(sub(hit.p, q), v);", "* (hit.p.z - q.z);", (GLASS, HALF)),
    KernelMutant("absorption beside half a lens", "depth = path->beside ? ZERO : depth;", "", (HALF,)),
    KernelMutant("reflection beside half a lens", "share = path->beside ? ONE : share;", "",
                 (one_wavelength("split dioptre", "bare"),)),
    KernelMutant("no way between the rows of a table", "low + (place - TO_F(cell)) * (high - low)", "low",
                 (many_wavelengths("planar-1897", "measured"),)),
    KernelMutant("tables of another wavelength", "wavelength - (real)LOSS_TABLE_NM", "wavelength - (real)400",
                 (many_wavelengths("split dioptre", "glass"),)),
    KernelMutant("layers of another wavelength", "s->layer_turns / wavelength", "s->layer_turns / 550.0f",
                 (many_wavelengths("dgauss-50mm", "mgf2"),)),
]  # fmt: skip


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_fault_in_a_kernel_is_found(monkeypatch, tmp_path, mutant):
    copy = patched_kernels(tmp_path, mutant)
    monkeypatch.setattr(program, "kernels_dir", lambda: copy)
    assert_killed(mutant.killers)


def test_the_killers_let_the_true_kernels_live():
    session = open_session()
    for killer in {killer for mutant in MUTANTS for killer in mutant.killers}:
        killer(session)
