"""The meter against `exposure: auto`, and the spot meter against the definition of luminance and EV."""

import math
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.device.session import open_session
from rptcam_cl.rendering.account import resolve_exposure
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.scene.exposure import Exposure
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.dials import turn_dial
from rptcam_cl.viewfinder.instruments import film_reading, spot_meter
from rptcam_cl.viewfinder.panel import Panel, irradiance_per_radiance, read_dials, value_per_radiance
from tests.support.cases import slow

AGREEMENT_EV = 0.01
METERINGS: list[dict[str, Any]] = [
    {"metering": "average"},
    {"metering": "centre_weighted"},
    {"metering": "spot", "spot_at": [0.3, 0.6]},
]


def scene(**parts: Any) -> Scene:
    """A dim gradient behind three patches, seen through a lens."""
    content: dict[str, Any] = {
        "film": {"resolution": [48, 32]},
        "camera": {
            "kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 0], "target": [0, 0, -1],
            "focus": {"distance_m": 2}, "f_number": 4,
        },
        "environment": {"kind": "gradient", "top": [0.9, 1.1, 1.4], "bottom": [0.1, 0.1, 0.05]},
    }  # fmt: skip
    return load_scene(content | parts)


@pytest.fixture(scope="module")
def pictures() -> dict[str, Any]:
    """The gradient rendered with exposures of three kinds."""
    physical = {"mode": "physical", "iso": 200, "ev": 0.5, "neutral_density_stops": 1}
    kinds = {"relative": {}, "irradiance": {"mode": "irradiance"}, "physical": physical}
    scenes = {name: scene(exposure=exposure, shutter={"time_s": 1 / 30}) for name, exposure in kinds.items()}
    return {name: (item, rptcam_cl.render(item, spp=64).pixels) for name, item in scenes.items()}


@pytest.mark.parametrize("kind", ["relative", *map(slow, ("irradiance", "physical"))])
@pytest.mark.parametrize("metering", METERINGS, ids=lambda value: str(value["metering"]))
def test_meter_agrees_with_automatic_exposure(pictures: dict[str, Any], kind: str, metering: dict[str, Any]) -> None:
    resolved, pixels = pictures[kind]
    _, metered_cd_m2, _ = resolve_exposure(scene(exposure={"mode": "auto"} | metering), open_session(None))
    assert metered_cd_m2 is not None
    settings = Exposure.model_validate({"mode": "auto"} | metering)
    assert abs(math.log2(film_reading(pixels, resolved, settings) / metered_cd_m2)) < AGREEMENT_EV


def test_meter_that_would_see_no_background_reads_nothing(pictures: dict[str, Any]) -> None:
    bare = scene(film={"resolution": [48, 32], "transparent": True}, shutter={"time_s": 1 / 30})
    assert film_reading(pictures["relative"][1] / 20, bare) is None


def test_spot_meter_agrees_with_automatic_exposure_at_the_spot(pictures: dict[str, Any]) -> None:
    metered = scene(exposure={"mode": "auto", **METERINGS[2]})
    auto, metered_cd_m2, _ = resolve_exposure(metered, open_session(None))
    resolved, pixels = pictures["physical"]
    found = spot_meter(pixels, resolved, 0.3, 0.6)
    assert metered_cd_m2 is not None
    assert abs(math.log2(found["cd_m2"] / metered_cd_m2)) < AGREEMENT_EV
    assert found["time_s"] is not None
    dimmed = 2.0 * 100 / 200  # a stop of grey filter, and twice the sensitivity
    assert abs(math.log2(found["time_s"] / (auto.shutter.time_s * dimmed))) < AGREEMENT_EV


def test_a_session_is_exposed_by_the_dials_as_by_automatic_exposure() -> None:
    with rptcam_cl.RenderSession(scene(exposure={"mode": "auto", "ev": 0.5, "metering": "spot"})) as session:
        frame = session.take(64)
        metered = session.metadata["metered_cd_m2"]
        dials = read_dials(session.scene)
        reading = film_reading(frame.pixels, session.resolved, dials.meter)
        assert abs(math.log2(reading / metered)) < AGREEMENT_EV
        for mode in ("S", "P", "A", "M"):  # M comes last: it keeps what was found and lets the compensation go
            turned = turn_dial(Panel(dials, session.scene, session.resolved, reading), "mode", mode)
            dials = turned.dials
            session.change(dict(turned.changes))
            frame = session.take(64)
            reading = film_reading(frame.pixels, session.resolved, dials.meter)
            assert abs(math.log2(reading / metered)) < AGREEMENT_EV
            bright = spot_meter(frame.pixels, session.resolved, 0.5, 0.5)["value"]
            assert abs(math.log2(bright / (0.18 * 2**0.5))) < AGREEMENT_EV, mode
            assert read_dials(session.scene, dials) == dials


def test_spot_meter_reads_a_world_of_known_luminance() -> None:
    world = scene(camera={"kind": "pinhole", "eye": [0, 0, 0], "target": [0, 0, -1], "fov_degrees": 40})
    pixels = np.full((20, 30, 3), 0.36, np.float32)
    pixels[:, :15] = 0.045
    bright, dark = spot_meter(pixels, world, 0.8, 0.5, 0.001), spot_meter(pixels, world, 0.2, 0.5, 0.0)
    assert bright["cd_m2"] == pytest.approx(0.36 * 683.002, rel=1e-5)
    assert bright["ev"] == pytest.approx(math.log2(0.36 * 683.002 * 8), rel=1e-5)
    assert [bright["stops"], dark["stops"]] == pytest.approx([1.0, -2.0], abs=1e-6)
    assert (bright["zone"], dark["zone"], bright["time_s"]) == ("VI", "III", None)
    nothing = spot_meter(np.zeros((4, 4, 3), np.float32), world, 0.5, 0.5)
    assert (nothing["cd_m2"], nothing["ev"], nothing["stops"], nothing["zone"]) == (0.0, None, None, "0")


def test_spot_meter_leaves_out_the_background_that_a_film_lacks() -> None:
    bare = scene(film={"resolution": [30, 20], "transparent": True})
    pixels = np.full((20, 30, 3), 0.36, np.float32)
    pixels[:, :15] = 0.0
    edge, beside = spot_meter(pixels, bare, 0.5, 0.5), spot_meter(pixels, bare, 0.1, 0.5)
    assert edge["value"] == pytest.approx(0.36)
    assert (beside["value"], beside["ev"]) == (0.0, None)


def test_cropped_film_is_metered_by_its_place_in_the_frame() -> None:
    whole = scene()
    ramp = np.repeat(np.linspace(0.1, 1, 48, dtype=np.float32)[None, :, None], 32, axis=0).repeat(3, axis=2)
    cropped = whole.model_copy(update={"film": whole.film.model_copy(update={"crop": (0.5, 1.0, 0.0, 1.0)})})
    settings = Exposure.model_validate({"mode": "auto", "metering": "spot", "spot_at": (0.75, 0.5)})
    assert film_reading(ramp[:, 24:], cropped, settings) == pytest.approx(film_reading(ramp, whole, settings), rel=1e-6)
    elsewhere = Exposure.model_validate({"mode": "auto", "metering": "spot", "spot_at": (0.1, 0.5)})
    assert film_reading(ramp[:, 24:], cropped, elsewhere) is None


@pytest.mark.parametrize(
    "camera",
    [
        {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 2, "focus_distance_m": 1},
        {"kind": "thick_lens", "lens": "dgauss-50mm", "focus": {"distance_m": 1}},
        {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 1},
         "aperture": {"shape": "polygon", "blades": 5}},
    ],
    ids=["thin", "thick", "shaped stop"],
)  # fmt: skip
def test_light_is_that_of_the_camera_model(camera: dict[str, Any]) -> None:
    pose = {"eye": [0, 0, 0], "target": [0, 0, -1]}
    plain = scene(camera=camera | pose)
    model = camera_model(plain)
    assert irradiance_per_radiance(plain) == model.on_axis_irradiance
    physical = scene(camera=camera | pose, exposure={"mode": "physical", "iso": 400, "ev": -1})
    model = camera_model(physical)
    expected = float(model.record["exposure"][0]) * model.axial_weight
    assert value_per_radiance(physical) == pytest.approx(expected, rel=1e-6)  # the record is float32
