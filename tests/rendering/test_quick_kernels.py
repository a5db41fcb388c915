"""Kernels that compile soonest: who gets them, and that they compute the bits of the full ones."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import MissingFileError
from rptcam_cl.core.files import example_scenes
from rptcam_cl.device import session as sessions
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.programs import BUILD_OPTIONS, assemble, options_of, quick_source
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import passes
from rptcam_cl.scene.load import load_scene
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import still_life
from tests.support.cases import slow

SIZE = (48, 32)
SCENE = still_life() | {"camera": LENS}
EXAMPLES = [pytest.param(path, marks=pytest.mark.slow, id=name) for name, path in example_scenes().items()]


@pytest.fixture
def opened(full_kernels: None, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Session]:
    """Return a new session that finds the code of all programs or of none, and takes its pictures to be right."""
    monkeypatch.setattr(passes, "fault_of", lambda *_, **__: None)

    def open_new(*, noted: bool) -> Session:
        monkeypatch.setattr(sessions, "is_code_noted", lambda name: noted)
        return Session(choose_device())

    if not open_new(noted=False).generates_late:
        pytest.skip("the driver compiles all of a program when it is built")
    return open_new


def kinds(session: Session) -> set[bool]:
    """Return whether the programs that a session was to run are quick."""
    return {program.is_quick for program in session.programs}


@pytest.mark.parametrize("scene", [slow(still_life()), SCENE, *EXAMPLES])
def test_quick_kernels_have_the_bits_of_full_ones(scene: dict[str, Any] | Path, opened: Callable[..., Session]) -> None:
    try:
        given = load_scene(scene)
    except MissingFileError as missing:
        pytest.skip(str(missing))
    films = []
    for noted in (True, False):
        session = opened(noted=noted)
        films.append(rptcam_cl.render(given, size=SIZE, spp=2, device=session).pixels)
        if not isinstance(scene, Path):  # some examples have ghosts, a target of noise or autofocus
            assert kinds(session) == {not noted}
    np.testing.assert_array_equal(films[0].view(np.uint32), films[1].view(np.uint32))


def test_many_samples_are_worth_full_kernels(opened: Callable[..., Session], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "FEW_SAMPLES", 3 * 48 * 32)
    session = opened(noted=False)
    rptcam_cl.render(SCENE, size=SIZE, spp=4, device=session)
    assert kinds(session) == {False}


def test_many_pictures_of_few_samples_are_worth_full_kernels(
    opened: Callable[..., Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "FEW_SAMPLES", 3 * 48 * 32)
    session = opened(noted=False)
    rptcam_cl.render(SCENE, size=SIZE, spp=2, device=session)
    assert kinds(session) == {True}
    rptcam_cl.render(SCENE, size=SIZE, spp=2, device=session)
    assert kinds(session) == {True, False}


def test_a_driver_that_optimises_late_need_not_do_so_at_first() -> None:
    def options(version: str, source: str) -> list[str]:
        device = SimpleNamespace(platform=SimpleNamespace(version=version))
        return [option for option in options_of(device, source) if option not in BUILD_OPTIONS]

    quick = quick_source("__kernel void one() {}\n")
    assert options("OpenCL 3.0 PoCL 3.0-rc2  Linux, Release", quick) == ["-cl-opt-disable"]
    assert options("OpenCL 3.0 PoCL 6.0  Linux, Release", quick) == ["-cl-opt-disable"]
    assert "-cl-opt-disable" not in options("OpenCL 3.0 PoCL 7.1  Linux, Release", quick)
    assert options("OpenCL 3.0 PoCL 3.0-rc2  Linux, Release", "__kernel void one() {}\n") == []


def test_the_driver_with_a_long_header_reads_the_declarations_of_the_kernels_in_its_place() -> None:
    def options(version: str, source: str) -> set[str]:
        return set(options_of(SimpleNamespace(platform=SimpleNamespace(version=version)), source))

    source = assemble([], {}, "__kernel void one() {}\n", library_arch=None)
    assert options("OpenCL 3.0 PoCL 3.0-rc2  Linux", source) > options("OpenCL 3.0 PoCL 3.1  Linux", source)
    assert options("OpenCL 3.0 PoCL 3.0-rc2  Linux", quick_source(source)) >= {"-D_OPENCL_H_", "-DDECLARES_BUILTINS"}
