"""The sensor section of a scene: presets, refusals, and what it comes to behind a film."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.colour import RESPONSES
from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.development import SensorModel, expose, sensor_of
from rptcam_cl.scene.film import PRESETS, PresetName, ResponseName
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

CAMERA = {
    "kind": "thin_lens", "eye": [0, 0, 5], "target": [0, 0, 0], "focal_length_mm": 50, "f_number": 4,
    "focus_distance_m": 5,
}  # fmt: skip
SMALL = {"camera": CAMERA, "environment": {"kind": "constant", "radiance": 1}, "film": {"resolution": [6, 4]}}
WINDOW = {"window": [0, 0, 6, 4]}
PHOTON_545 = 6.62607015e-34 * 299792458.0 / 545e-9


def scene(sensor: dict[str, Any] | None, **parts: Any) -> Scene:
    return load_scene({**SMALL, **({} if sensor is None else {"sensor": sensor}), **parts})


def sensor_in(keys: dict[str, Any], metadata: dict[str, Any], **parts: Any) -> SensorModel:
    found = sensor_of(scene(keys, **parts), WINDOW | metadata)
    assert found is not None
    return found


def test_names_of_the_model_are_those_of_the_data() -> None:
    assert set(PresetName.__args__) == set(PRESETS)
    assert set(ResponseName.__args__) == set(RESPONSES)


def test_scene_without_a_sensor_has_none() -> None:
    assert scene(None).sensor is None
    assert sensor_of(scene(None), WINDOW) is None


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_preset_sets_its_keys_and_the_scene_may_change_them(name: str) -> None:
    found = scene({"preset": name}).sensor
    assert found is not None
    for key, value in PRESETS[name].items():
        expected = (value,) * 3 if key == "quantum_efficiency" and isinstance(value, float) else value
        assert getattr(found, key) == (tuple(expected) if isinstance(expected, list) else expected)
    changed = scene({"preset": name, "full_well_e": 5}).sensor
    assert changed is not None and changed.full_well_e == 5
    assert sensor_in({"preset": name}, {}).electrons.shape == (3, 3)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"iso": 100}, "sensor.iso: unknown key"),
        ({"full_well": 1}, "sensor.full_well: unknown key; did you mean full_well_e?"),
        ({"preset": "imx999"}, "sensor.preset: is not a known choice"),
        ({"response": "nikon"}, "sensor.response: is not a known choice"),
        ({"bayer": "RGBG"}, "sensor.bayer: is not a known choice"),
        ({"bayer": "monochrome", "response": "nikon_d5100"}, "sensor.response: has colour filters"),
        ({"quantum_efficiency": 0}, "sensor.quantum_efficiency: is out of range (got 0; allowed: above 0, at most 1)"),
        ({"quantum_efficiency": [0.5, 1.5, 0.5]}, "sensor.quantum_efficiency[1]: is out of range (got 1.5"),
        ({"quantum_efficiency": [0.5, 0.5]}, "sensor.quantum_efficiency: has 2 numbers instead of 1 or 3"),
        ({"quantum_efficiency": "nikon_d5100"}, "sensor.quantum_efficiency: is text, not a number"),
        ({"bit_depth": 17}, "sensor.bit_depth: is out of range (got 17; allowed: at most 16)"),
        ({"bit_depth": 12.5}, "sensor.bit_depth: must be a whole number"),
        ({"bit_depth": 8, "black_level_dn": 255}, "sensor.black_level_dn: leaves no numbers for light"),
        ({"preset": "imx477", "bit_depth": 8}, "sensor.black_level_dn: leaves no numbers for light"),
        ({"read_noise_e": -1}, "sensor.read_noise_e: is out of range"),
        ({"prnu": 2}, "sensor.prnu: is out of range"),
        ({"seed": -1}, "sensor.seed: is out of range"),
        ({"temperature_celsius": -300}, "sensor.temperature_celsius: is out of range"),
    ],
)
def test_wrong_keys_are_refused(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        scene(keys)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_list_is_no_sensor() -> None:
    with pytest.raises(InputError, match=r"sensor: must be a mapping \(got \[1\]"):
        load_scene({**SMALL, "sensor": [1]})


def test_relative_film_of_white_fills_the_well() -> None:
    found = sensor_in({"full_well_e": 12345, "response": "canon_eos_5d_mark_ii"}, {})
    assert found.white_electrons.max() == pytest.approx(12345)
    assert found.white_level_dn == pytest.approx(16383)


@pytest.mark.parametrize("bayer", ["RGGB", "none", "monochrome"])
@pytest.mark.parametrize("mode", ["relative", "physical"])
def test_white_of_one_just_saturates_sensors_of_every_mosaic(bayer: str, mode: str) -> None:
    """In physical exposures by ISO 12232; a monochrome pixel sees the light of all three channels."""
    metadata = {} if mode == "relative" else {"iso": 400.0, "values_per_irradiance": 683 * 400 / 78 / 100}
    keys = {"bayer": bayer, "read_noise_e": 0}
    found = sensor_in(keys, metadata, exposure=mode, shutter={"time_s": 1 / 100})

    def highest(level: float) -> int:
        return int(expose(np.full((8, 8, 3), level, np.float32), found).max())

    assert found.white_electrons.max() > 1e9  # of pixels so large that noise does not count
    assert highest(0.99) < found.top_dn
    assert highest(1.01) == found.top_dn


def test_well_follows_the_area_unless_it_is_given() -> None:
    assert sensor_in({"pixel_pitch_um": 4}, {}).full_well_e == pytest.approx(2000 * 16)
    assert sensor_in({}, {}, film={"resolution": [6, 4], "pixel_pitch_um": 3}).full_well_e == pytest.approx(2000 * 9)


def test_irradiance_becomes_the_photons_of_area_and_time() -> None:
    """1 W/m² over 20 ms on 4 µm x 4 µm, behind a filter of two stops."""
    found = sensor_in(
        {"quantum_efficiency": 0.6, "pixel_pitch_um": 4},
        {"values_per_irradiance": 0.25},
        exposure={"mode": "irradiance", "neutral_density_stops": 2},
        shutter={"time_s": 0.02},
    )
    per_irradiance = found.electrons * 0.25
    assert per_irradiance[1, 1] == pytest.approx(0.6 * 16e-12 * 0.02 / PHOTON_545 / 4)
    assert np.count_nonzero(per_irradiance) == 3


def test_iso_of_twice_the_speed_has_twice_the_gain_above_the_base() -> None:
    def gain(iso: float) -> float:
        metadata = {"iso": iso, "values_per_irradiance": 1.0}
        return sensor_in({"pixel_pitch_um": 4}, metadata, exposure="physical").system_gain_dn_per_e

    assert gain(800) == pytest.approx(2 * gain(400))
    assert gain(1) == gain(2) == pytest.approx((16383 - 512) / 32000)


def test_dark_current_doubles_with_the_temperature() -> None:
    keys = {"dark_current_e_per_s": 3.0, "dark_current_celsius": 20, "dark_doubling_kelvin": 6}
    shutter = {"time_s": 10}
    assert sensor_in(keys, {}, shutter=shutter).dark_e == pytest.approx(30)
    assert sensor_in(keys | {"temperature_celsius": 32}, {}, shutter=shutter).dark_e == pytest.approx(120)
    assert sensor_in(keys | {"temperature_celsius": 14}, {}, shutter=shutter).dark_e == pytest.approx(15)
    hot = sensor_in(keys | {"temperature_celsius": 1000, "dark_doubling_kelvin": 0.1}, {}, shutter=shutter)
    assert np.isfinite(hot.dark_level_dn)


def test_seed_is_the_render_s_unless_given() -> None:
    assert sensor_in({}, {}, render={"seed": 5}).seed == 5
    assert sensor_in({"seed": 9}, {}, render={"seed": 5}).seed == 9


def test_only_the_response_of_a_sensor_may_change_the_film() -> None:
    assert scene({"preset": "imx477"}).content_hash() == scene(None).content_hash()
    seen = [scene({"response": name}).content_hash() for name in RESPONSES]  # which see spectra each in its own way
    assert len({*seen, scene(None).content_hash()}) == 4


def test_description_gives_the_sensor_again() -> None:
    first = sensor_in({"response": "sigma_sd_merrill", "bayer": "none", "prnu": 0.1}, {})
    again = SensorModel.from_description(first.described())
    assert again.described() == first.described()
    for broken in ({}, {"electrons": [1]}, first.described() | {"origin": []}, first.described() | {"new": 1}):
        with pytest.raises(InputError, match="the metadata describe no sensor"):
            SensorModel.from_description(broken)


def test_frames_of_a_sequence_have_noise_of_their_own_and_one_fixed_pattern() -> None:
    """Else two frames of a scene at rest would not differ at all."""
    moments = [0.0, 1 / 24, 2 / 24, 1 / 24]
    first, second, third, again = (sensor_in({"pattern_seed": 3}, {}, shutter={"open_s": open_s}) for open_s in moments)
    assert first.seed == 0
    assert len({first.seed, second.seed, third.seed}) == 3
    assert again.seed == second.seed
    assert {first.pattern_seed, second.pattern_seed, third.pattern_seed} == {3}
    film = np.full((32, 32, 3), 0.5, np.float32)
    one, two = (expose(film, replace(frame, bayer="none")).astype(float) for frame in (first, second))
    apart = np.corrcoef((one - one.mean(axis=(0, 1))).ravel(), (two - two.mean(axis=(0, 1))).ravel())[0, 1]
    assert abs(apart) < 0.1  # six standard errors of 3072 numbers
    assert sensor_in({}, {}, shutter={"open_s": 1.0}).seed != sensor_in({"seed": 1}, {}, shutter={"open_s": 1.0}).seed
