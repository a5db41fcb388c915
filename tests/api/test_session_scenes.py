"""Bits of `render` after changes, for every kind of scene; and memory that stays flat."""

import gc
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.api.session import RenderSession
from rptcam_cl.scene.load import load_scene
from tests.api.test_session import PINHOLE, POSE, WORLD, assert_has_bits_of_render

LENS = {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 6}, **POSE}
MESH = {
    "shape": "mesh",
    "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.5]],
    "faces": [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
    "material": "grey",
}
CAMERA = {"camera.eye": [0.3, -5.5, 1.4]}
ROLLING = {"shutter": {"time_s": 0.1, "kind": "rolling", "readout_s": 0.05}}
CASES: dict[str, tuple[dict[str, Any], list[dict[str, Any]]]] = {
    "lens": (
        WORLD | {"camera": LENS},
        [{"camera.f_number": 4}, {"camera.focus.distance_m": 4}, CAMERA, {"camera.focus": {"film_distance_mm": 37}}],
    ),
    "autofocus": (
        WORLD | {"camera": LENS | {"focus": {"auto": {"method": "depth", "object": "ball"}}}},
        [{"camera.f_number": 4}, CAMERA, {"camera.focus": {"auto": {"method": "depth", "point": [0.5, 0.45]}}}],
    ),
    "automatic exposure": (
        WORLD | {"camera": LENS, "exposure": {"mode": "auto", "priority": "shutter"}},
        [CAMERA, {"exposure.ev": 1}, {"camera.f_number": 8, "exposure.priority": "aperture"}],
    ),
    "spectral": (WORLD | {"camera": LENS, "spectrum": "spectral"}, [{"camera.f_number": 4}, CAMERA]),
    "mesh": (
        WORLD | {"camera": PINHOLE["camera"], "objects": [*WORLD["objects"], MESH]},
        [CAMERA, {"materials.grey.reflectance": 0.7}, {"objects.2.transform": [{"translate": [0.2, 0, 0.1]}]}],
    ),
    "motion": (
        WORLD
        | {"camera": PINHOLE["camera"] | {"motion": [{"time_s": 0}, {"time_s": 0.5, "eye": [1, -6, 1.5]}]}}
        | {"shutter": {"time_s": 0.25}},
        [{"shutter.time_s": 0.1}, {"camera.motion.1.eye": [0, -6, 2.5]}, ROLLING],
    ),
    "adaptive": (
        WORLD | {"camera": PINHOLE["camera"], "render": {"noise": 0.02, "max_depth": 3}},
        [CAMERA, {"render.noise": 0.05}],
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_film_has_the_bits_of_render_in_every_kind_of_scene(case: str) -> None:
    data, changes = CASES[case]
    with RenderSession(data) as session:
        for change in changes:
            session.take()
            session.change(change)
            session.glance(0.4)
        for samples in (1, 2, 160 if case == "adaptive" else 3):
            session.take(samples)
            session.glance(0.4)
        assert_has_bits_of_render(session, 163 if case == "adaptive" else 6)


@pytest.mark.slow
def test_what_autofocus_found_stays_until_it_is_asked_again() -> None:
    with RenderSession(CASES["autofocus"][0]) as session:
        found = session.resolved.camera.focus
        assert session.metadata["autofocus"] and session.scene.camera.focus.auto is not None
        session.change({"camera.eye": [0, -3, 1.5]})
        assert session.scene.camera.focus == session.resolved.camera.focus == found
        session.change({"camera.focus": {"auto": {"method": "depth", "object": "ball"}}})
        assert session.resolved.camera.focus != found
        assert session.metadata["autofocus"]


def test_glances_follow_the_exposure_meter() -> None:
    dark = WORLD["environment"] | {"bottom": 0.0002, "top": [0.0006, 0.0008, 0.001]}
    with RenderSession(PINHOLE) as session:
        bright = session.glance(0.5).pixels.mean()
        session.change({"environment": dark})
        session.glance(0.5)
        assert session.glance(0.5).pixels.mean() == pytest.approx(bright, rel=0.02)
        session.take()
        assert session.metadata["metered_cd_m2"] < 1


@pytest.mark.slow
def test_kernels_are_compiled_in_the_background_while_the_picture_stays() -> None:
    with RenderSession(WORLD | {"camera": PINHOLE["camera"]}) as session:
        before = session.take(2)
        lens = {key: value for key, value in LENS.items() if key not in POSE}
        change = session.change({"camera": LENS | {"f_number": 2.8}}, wait=False)
        assert (change.kind, change.ready) == ("program", False)
        assert session.scene.camera.kind == lens["kind"] and session.generation == before.generation
        shown = session.take()
        if shown.generation == before.generation:
            assert shown.spp == 3
        session.change({"camera.f_number": 4}, wait=False)
        while not session.ready:
            time.sleep(0.01)
        assert session.glance(0.25).generation > before.generation  # what was waited for, without a sample of it
        frame = session.take()
        assert frame.generation > before.generation and session.spp == 1
        assert session.scene.camera.f_number == 4
        session.take(2)
        assert_has_bits_of_render(session, 3)
        assert session.change({"camera": PINHOLE["camera"]}, wait=False).ready  # it is known already


@pytest.mark.slow
def test_memory_stays_flat_over_300_changes() -> None:
    statm = Path("/proc/self/statm")
    if not statm.exists():
        pytest.skip("the system does not tell")

    def resident() -> float:
        gc.collect()
        return int(statm.read_text().split()[1]) * 4096 / 2**20

    lenses = ["dgauss-50mm", "tessar-100mm", "wide-22mm"]
    with RenderSession(WORLD | {"camera": LENS}) as session:
        sizes = []
        for number in range(300):
            session.change(
                {
                    "camera.lens": lenses[number % 3],
                    "camera.f_number": 4 + number % 7,
                    "film.resolution": [320 + 16 * (number % 5), 180],
                }
            )
            session.glance(0.25)
            session.take()
            if number >= 100 and number % 20 == 0:
                sizes.append(resident())
        assert sizes[-1] < 1.05 * sizes[0], sizes


def test_scene_of_a_session_can_be_loaded_again() -> None:
    scene = load_scene(WORLD | {"camera": PINHOLE["camera"]})
    with RenderSession(scene, size=(16, 8)) as session:
        session.change({"camera.eye": [0.1, -6, 1.5], "objects.0.radius": 0.8})
        again = load_scene(session.scene.made_of)
        assert again.content_hash() == session.scene.content_hash()
        np.testing.assert_allclose(again.camera.eye, [0.1, -6, 1.5])
