"""Pictures one after the other: the bits of `render`, whatever came before."""

from typing import Any

import numpy as np
import pytest

from rptcam_cl.api.job import SeriesRenderer, render
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.rendering.cameras import kinds
from rptcam_cl.rendering.plan import primitives
from rptcam_cl.rendering.plan.primitives import PlanParts
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene

POSE = {"eye": [0, 0.5, 1.6], "target": [0, 0.08, 0]}
SCENE: dict[str, Any] = {
    "camera": {
        "kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 1.6}, **POSE
    },
    "film": {"resolution": [24, 16], "width_mm": 30},
    "render": {"spp": 4, "max_depth": 3, "layers": ["depth", "position"]},
    "materials": {
        "red": {"kind": "matte", "reflectance": [0.6, 0.06, 0.04]},
        "lamp": {"kind": "emissive", "radiance": [900, 800, 700]},
    },
    "objects": [
        {"shape": "sphere", "center": [-0.1, 0.1, 0.1], "radius": 0.1, "material": "red"},
        {"shape": "sphere", "center": [0.2, 0.3, -2], "radius": 0.01, "material": "lamp"},
    ],
    "environment": {"kind": "constant", "radiance": 0.5},
}  # fmt: skip
CHANGES: list[dict[str, Any]] = [
    {"camera.eye": [0.1, 0.5, 1.5]},
    {"materials.lamp.radiance": [500, 800, 900]},
    {"materials.red.reflectance": 0.3, "render.seed": 3},
    {"camera.f_number": 5.6},
    {"objects.1.center": [0.2, 0.3, -1]},
    {"film.resolution": [16, 24], "render.layers": ["depth"]},
    {
        "camera.focus.distance_m": 1,
        "shutter": {"time_s": 1, "steps": 2, "keys": {"camera.f_number": [{"time_s": 0, "value": 4}]}},
    },
]  # fmt: skip


@pytest.fixture
def device() -> Session:
    return Session(open_session().info)


def test_pictures_of_a_series_have_the_bits_of_render(device: Session) -> None:
    series, scene = SeriesRenderer(device), load_scene(SCENE)
    for changes in ({}, *CHANGES):
        scene = set_keys(scene, changes)
        found, alone = series.render(scene), render(scene, device=device)
        assert found.pixels.tobytes() == alone.pixels.tobytes(), changes
        assert list(found.layers) == list(alone.layers)
        assert all(np.array_equal(found[name], alone[name], equal_nan=True) for name in alone.layers), changes
        assert found.metadata == alone.metadata, changes


def test_pictures_of_the_same_kernels_share_a_wavefront_and_what_is_bound(
    full_kernels: None, device: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []

    def counted(name: str) -> None:
        plain = getattr(Wavefront, name)

        def method(self: Wavefront, *arguments: Any, **more: Any) -> Any:
            calls.append(name)
            return plain(self, *arguments, **more)

        monkeypatch.setattr(Wavefront, name, method)

    thin = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 1.6}
    series, scene = SeriesRenderer(device), load_scene(SCENE | {"camera": thin | POSE})
    SeriesRenderer(device).render(scene)  # has the driver tried, by pictures of its own
    counted("__init__")
    counted("_bind")
    for changes in ({}, *CHANGES[:5]):
        scene = set_keys(scene, changes)
        series.render(scene)
    assert calls == ["__init__", "_bind"]
    assert not any(program.is_quick for program in device.programs)  # more pictures are to come


@pytest.mark.parametrize(
    ("changes", "order"),
    [
        ({}, ["camera", "device"]),
        ({"exposure": {"mode": "auto"}}, ["device"]),
        ({"camera.focus": {"auto": {}}}, ["device"]),
        ({"camera.accuracy": "auto"}, ["device"]),
    ],
)
def test_camera_is_made_before_the_device_opens_unless_it_follows_from_what_is_measured(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], order: list[str]
) -> None:
    made = []

    def opened(*_: Any) -> Any:
        made.append("device")
        raise DeviceError("none")

    monkeypatch.setattr("rptcam_cl.api.job.open_sessions", opened)
    original = PlanParts.camera
    monkeypatch.setattr(PlanParts, "camera", lambda *a, **k: made.append("camera") or original(*a, **k))
    with pytest.raises(DeviceError, match="none"):
        render(set_keys(load_scene(SCENE), changes))
    assert made == order


def test_camera_made_before_the_device_opens_is_the_one_that_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    models = []
    original = kinds.camera_of
    monkeypatch.setattr(primitives, "camera_of", lambda scene: models.append(scene) or original(scene))
    render(SCENE)
    assert len(models) == 1
