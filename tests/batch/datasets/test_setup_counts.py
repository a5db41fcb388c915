"""What a frame of a dataset makes anew beside its rays, counted: the rest it takes over from the frames before."""

import sys
from collections import Counter
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.batch.dataset import dataset
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.core.remember import forget
from tests.support.cases import fast

FIRST, FRAMES = 3, 4  # frames that find what all share, and frames whose work is counted
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\n"
SCENE: dict[str, Any] = {
    "film": {"resolution": [16, 12], "width_mm": 30},
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 1, 5], "target": [0, 0.5, 0],
        "focus": {"distance_m": 4.05}, "f_number": 3.0,
    },
    "materials": {
        "red": {"kind": "matte", "reflectance": [0.6, 0.2, 0.1]},
        "white": {"kind": "matte", "reflectance": [0.8, 0.8, 0.8]},
        "lamp": {"kind": "emissive", "radiance": [4000, 4000, 4000]},
    },
    "objects": [
        {"shape": "sphere", "center": [0, 0.5, 0], "radius": 0.5, "material": "red"},
        {"shape": "mesh", "file": "corner.obj", "material": "white"},
        *({"shape": "sphere", "center": [k, 0.1, 0], "radius": 0.1, "material": "white"} for k in range(48)),
        {"shape": "sphere", "center": [0.4, 1.2, -9], "radius": 0.02, "material": "lamp"},
    ],
    "environment": {"kind": "constant", "radiance": 0.1},
    "render": {"spp": 1},
}  # fmt: skip
ZOOM = {"camera.lens": "zoom-70-200mm", "camera.f_number": 4.2, "camera.focal_length_mm": 101}
WORK = {
    "programs": "device.session:Program",
    "pupil tables": "rendering.cameras.pupil:tight_sampling",
    "cells of pupils": "rendering.cameras.realistic:stopped_pupils",
    "traced cells": "rendering.cameras.realistic:shared_shapes",
    "cameras": "rendering.cameras.kinds:realistic_model",
    "camera models": "batch.dataset:calibrate_best",
    "lamps in the lens": "rendering.cameras.lamp_aim:fits_of_small",
    "lamps on the film": "rendering.cameras.lamp_aim:_seen",
    "trees of primitives": "rendering.tree_build:tree_of_few",
    "meshes": "rendering.plan.geometry:pack_meshes",
    "materials": "rendering.plan.primitives:pack_materials",
}
POSE = {
    "trees of primitives": FRAMES,
    "lamps in the lens": FRAMES,
    "lamps on the film": FRAMES,
}
LENS = {"cameras": FRAMES, "lamps in the lens": FRAMES, "lamps on the film": FRAMES}
KINDS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, int]]] = {
    "pose": ({}, {"camera.eye": {"uniform": [[-0.3, 0.9, 5], [0.3, 1.1, 6]]}}, POSE),
    "light": ({}, {"materials.lamp.radiance": {"uniform": [[9, 6, 6], [16, 11, 12]]}}, {"materials": FRAMES}),
    "material": ({}, {"materials.red.reflectance": {"uniform": [[0, 0, 0], [0.8, 0.8, 0.8]]}}, {"materials": FRAMES}),
    "lens seen before": ({}, {"camera.lens": {"grid": ["dgauss-50mm", "dgauss-100mm"]}}, {"cameras": FRAMES}),
    "f-number": ({}, {"camera.f_number": {"uniform": [3.0, 3.1]}}, LENS | {"pupil tables": 1}),
    "focus": ({}, {"camera.focus.distance_m": {"uniform": [4.0, 4.1]}}, LENS | {"camera models": FRAMES}),
    "film": ({}, {"film.width_mm": {"uniform": [29.5, 30]}}, LENS | {"camera models": FRAMES, "lamps in the lens": 0}),
    "rise": ({}, {"camera.movements.rise_mm": {"uniform": [-0.2, 0.2]}}, {"cameras": FRAMES, "camera models": FRAMES}),
    "zoom": (ZOOM, {"camera.focal_length_mm": {"uniform": [101, 103]}}, LENS | {"camera models": FRAMES}),
}
counted: Counter[str] | None = None


def _note_file(event: str, args: tuple[Any, ...]) -> None:
    if counted is not None and event == "open" and not str(args[0]).endswith((".py", ".pyc")):
        counted["files"] += isinstance(args[0], str) and not args[0].startswith("/proc")


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Count what is made, and files that are opened, while `counted` is a counter."""
    for name, place in WORK.items():
        module, _, attribute = place.partition(":")
        plain = getattr(import_module(f"rptcam_cl.{module}"), attribute)

        def count(*args: Any, name: str = name, plain: Any = plain, **options: Any) -> Any:
            if counted is not None:
                counted[name] += 1
            return plain(*args, **options)

        monkeypatch.setattr(f"rptcam_cl.{module}.{attribute}", count)


@pytest.mark.parametrize("kind", fast(KINDS.keys() - {"film", "pose", "rise", "zoom"}, KINDS))
def test_frames_make_anew_what_is_drawn_alone(
    kind: str, work: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    global counted
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    Path("corner.obj").write_text(MESH, "utf-8")
    forget()
    fixed, vary, expected = KINDS[kind]
    frames = dataset({"scene": SCENE, "seed": 3, "set": fixed, "vary": vary}, frames=FIRST + FRAMES)
    for _ in range(FIRST):
        next(frames)
    counted = Counter()
    try:
        for _ in range(FRAMES):
            next(frames)
        found = dict(counted)
    finally:
        counted = None
    assert {name: times for name, times in found.items() if times} == {
        name: times for name, times in expected.items() if times
    }


sys.addaudithook(_note_file)
