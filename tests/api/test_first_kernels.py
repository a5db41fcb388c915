"""Sessions that do not wait: glances by kernels that compile soonest, films by the full ones, once they are there."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.session import RenderSession
from rptcam_cl.device.devices import CompileServer, choose_device
from rptcam_cl.device.session import Session

SCENE: dict[str, Any] = {
    "film": {"resolution": [48, 32]},
    "camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, -6, 1.5], "target": [0, 0, 0.8], "up": [0, 0, 1]},
    "render": {"max_depth": 2},
    "objects": [
        {"shape": "sphere", "center": [0, 0, 1], "radius": 1, "material": {"kind": "matte", "reflectance": 0.5}}
    ],
    "environment": {"kind": "constant", "radiance": 0.5},
}
PATIENCE_S = 60.0


class Watched(Session):
    """A device that remembers which programs it was to run: quick ones or full ones."""

    kinds: list[str]

    def __init__(self) -> None:
        super().__init__(choose_device())
        self.kinds = []

    def program(self, files: list[str], facts: Any, declarations: str) -> Any:
        found = super().program(files, facts, declarations)
        self.kinds.append("quick" if found.is_quick else "full")
        return found


@pytest.fixture
def device(full_kernels: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Watched:
    """A device that finds no notes of kernels compiled before."""
    found = Watched()
    if not found.generates_late:
        pytest.skip("the driver compiles all of a program when it is built")
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    return found


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """When the process apart has compiled what it was to."""
    found = threading.Event()
    monkeypatch.setattr(CompileServer, "compile", lambda self, wanted: found.wait(PATIENCE_S))
    return found


def until(is_so: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.01)


# glances go by the last reading of the meter, here that of the other angle
@pytest.mark.parametrize(("exposure", "tolerance"), [("relative", 0.0), ("auto", 0.1)])
def test_glances_do_not_wait_and_the_film_has_the_bits_of_render(
    device: Watched, compiled: threading.Event, exposure: str, tolerance: float
) -> None:
    scene = SCENE | {"exposure": {"mode": exposure}}
    with RenderSession(scene, device=device, wait=False) as session:
        glance = session.glance(0.5)
        assert not session.is_film_ready()
        change = session.change({"camera.fov_degrees": 35}, wait=False)
        assert change.ready and change.kind == "camera"
        session.glance(0.5)
        assert set(device.kinds) == {"quick"}
        assert not session.is_film_ready()
        compiled.set()
        until(session.is_film_ready)
        assert session.take(2).spp == 2
        film = rptcam_cl.render(session.scene, spp=2, device=device)
        np.testing.assert_array_equal(session.pixels(), film.pixels)
        until(lambda: session.is_film_ready() and session.ready)  # for glances, the full kernels come last
        device.kinds.clear()
        session.change({"camera.fov_degrees": 40}, wait=False)
        full = session.glance(0.5)
        assert set(device.kinds) == {"full"}
    np.testing.assert_allclose(full.pixels, glance.pixels, rtol=tolerance)


def test_kernels_of_an_earlier_run_are_there_at_once(device: Watched, tmp_path: Path) -> None:
    with RenderSession(SCENE, device=device) as session:  # which waits
        session.glance(0.5)
        assert session.is_film_ready()
    notes = {note.name for note in (tmp_path / "rptcam_cl").iterdir()}
    assert notes == {program.name for program in device._programs.values()}
    later = Watched()
    with RenderSession(SCENE, device=later, wait=False) as session:
        assert session.is_film_ready()
        session.take()
    assert set(device.kinds + later.kinds) == {"full"}
