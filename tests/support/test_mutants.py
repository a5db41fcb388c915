"""Deliberate faults: each still finds its place in the kernels, whether the slow tests of it are run or not."""

import pytest

from rptcam_cl.core.files import kernels_dir
from rptcam_cl.device import programs
from tests.rendering import test_lamp_mutants as lamps
from tests.rendering import test_mutants as render
from tests.rendering.cameras import test_loss_mutants as losses
from tests.rendering.cameras import test_mutants as lenses
from tests.rendering.layers import test_mutants as layers
from tests.rendering.meshes import test_mutants as meshes
from tests.rendering.motion import test_mutants as motion
from tests.rendering.spectrum import test_mutants as spectrum
from tests.support.mutants import Mutant, assert_found, changed_kernels, place_of

MODULES = (lamps, layers, lenses, losses, meshes, motion, render, spectrum)
FILE, TEXT = "common/records.h", "#define RECORDS_H"


def read():
    """Fail where the text is gone from the kernels that programs are built from."""
    assert TEXT in (programs.kernels_dir() / FILE).read_text("utf-8")


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__.removeprefix("tests."))
def test_each_fault_has_one_place(module):
    for mutant in module.MUTANTS:
        place_of(mutant.text, kernels_dir())


@pytest.mark.parametrize("text", ["no such text", "#include"])
def test_text_that_stands_nowhere_or_twice_is_refused(text):
    with pytest.raises(AssertionError, match="places"):
        place_of(text, kernels_dir())


def test_kernels_hold_the_fault_and_are_whole_again_afterwards():
    with changed_kernels(TEXT, ""), pytest.raises(AssertionError):
        read()
    read()


def test_fault_that_one_of_its_tests_does_not_see_is_reported():
    assert_found(Mutant("guard", TEXT, "", read, read))
    with pytest.raises(pytest.fail.Exception):
        assert_found(Mutant("guard", TEXT, "", read, lambda: None))
