"""Kernels compiled by another process are those that a render needs; a process that fails costs time alone."""

import os
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.device.devices import CompileServer
from rptcam_cl.device.drivers import pocl_cache_folder
from rptcam_cl.device.session import open_session
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.scene_buffers import SceneBuffers
from rptcam_cl.rendering.tracer import SMALL, Wavefront, order
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

WORLD: dict[str, Any] = {
    "film": {"resolution": [16, 16]},
    "camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 3], "target": [0, 0, 0]},
    "render": {"max_depth": 1},
    "materials": {"grey": {"kind": "matte", "reflectance": 0.5}},
    "objects": [{"shape": "sphere", "center": [0, 0, 0], "radius": 1, "material": "grey"}],
}
WITH_PHOTONS = WORLD | {
    "render": {"max_depth": 3, "caustics": "on"},
    "materials": WORLD["materials"]
    | {"glass": {"kind": "dielectric", "index": 1.5}, "lamp": {"kind": "emissive", "radiance": 9}},
    "objects": [
        *WORLD["objects"],
        {"shape": "sphere", "center": [0, 0, 1.5], "radius": 0.2, "material": "glass"},
        {"shape": "sphere", "center": [0, 1, 3], "radius": 0.2, "material": "lamp"},
    ],
}

pytestmark = pytest.mark.usefixtures("full_kernels")


def wanted(scene: Scene) -> bytes:
    session, plan = open_session(), make_plan(scene)
    found = order(session, plan, SceneBuffers(session, plan), scene.render)
    assert found is not None
    return found


def libraries(folder: Path) -> set[str]:
    return {"/".join(path.parts[-5:]) for path in folder.rglob("*.so")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "kernels"),
    [(WORLD, {"stream"}), (WITH_PHOTONS, {"stream", "photons"})],
    ids=["paths", "photons"],
)
def test_process_apart_fills_the_cache_with_what_a_wave_takes(
    world: dict[str, Any], kernels: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = open_session()
    if not session.generates_late:
        pytest.skip("the driver compiles nothing at the launch")
    scene = load_scene(world)
    plan = make_plan(scene)
    Wavefront(session, plan, SMALL, scene.render).warm_up()
    own = libraries(pocl_cache_folder())
    monkeypatch.setenv(CACHE_VARIABLE, os.fspath(tmp_path / "marks"))
    for folder in ("with the trial of the driver", "without"):  # its outcome is kept
        monkeypatch.setenv("POCL_CACHE_DIR", os.fspath(tmp_path / folder))
        compiler = CompileServer()
        assert compiler.compile(wanted(scene))
        compiler.close()
    assert not list(tmp_path.rglob("*.at-work")), "it ended well"
    found = {path for path in libraries(tmp_path / "without") if "trial" not in path}
    assert {Path(path).stem for path in found} == kernels  # the stream makes the rays of a pinhole itself
    assert found <= own


def test_order_that_fails_is_left_to_the_caller_and_a_closed_compiler_compiles_nothing() -> None:
    compiler = CompileServer()
    assert not compiler.compile(b"no order")
    compiler.close()
    assert compiler.is_closed and not compiler.compile(wanted(load_scene(WORLD)))
