"""Exposure by metering: what is metered, what follows from it, and that it can be locked and resumed."""

import math

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.cli import main
from rptcam_cl.core.colour import LUMINANCE
from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering import account
from rptcam_cl.scene.exposure import Exposure
from rptcam_cl.scene.film import Film
from tests.rendering.pictures import WHITE, pixels, scene_of
from tests.support.cases import fast

POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}
PINHOLE = {"kind": "pinhole", "fov_degrees": 60, **POSE}
THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 4, "focus_distance_m": 3, **POSE}
REAL = {"kind": "realistic", "lens": "dgauss-50mm", "f_number": 5.6, "focus": {"distance_m": 3}, **POSE}
CAMERAS = {
    "pinhole": PINHOLE,
    "environment": {"kind": "environment", **POSE},
    "thin_lens": THIN,
    "thick_lens": REAL | {"kind": "thick_lens"},
    "realistic": REAL,
}


def world(camera=THIN, exposure="auto", *, resolution=(40, 24), environment=WHITE, objects=(), **rest):
    return (
        scene_of(list(objects), camera, resolution=resolution, environment=environment, exposure=exposure, depth=1)
        | rest
    )


def panel(x, radiance):
    """A lamp that fills the left or the right half of the view from x = 0."""
    low, high = sorted((0.0, x))
    lamp = {"kind": "emissive", "radiance": radiance, "two_sided": True}
    return {
        "shape": "rectangle",
        "corner": [low, -99, -3],
        "edge_u": [high - low, 0, 0],
        "edge_v": [0, 198, 0],
        "material": lamp,
    }


HALVES = (panel(-99, 3.0), panel(99, 0.2))


def luminance(image):
    return float((image.pixels.astype(float) @ LUMINANCE).mean())


@pytest.mark.parametrize("kind", fast(["pinhole", "thin_lens", "realistic"], CAMERAS))
def test_mean_luminance_comes_to_the_target_through_every_camera(kind):
    camera = CAMERAS[kind]
    scene = world(camera, environment={"kind": "constant", "radiance": [2, 3, 0.5]}, resolution=(40, 20))
    image = rptcam_cl.render(scene, spp=64)
    assert luminance(image) == pytest.approx(0.18, rel=0.005)
    assert image.metadata["exposure"] == "auto"
    assert ("exposure_time_s" in image.metadata) == (kind not in ("pinhole", "environment"))
    if kind in ("pinhole", "environment", "thin_lens"):  # no light falls off towards the corners
        assert image.metadata["metered_cd_m2"] == pytest.approx(
            683 * (0.2126 * 2 + 0.7152 * 3 + 0.0722 * 0.5), rel=1e-5
        )


def test_mean_luminance_comes_to_the_target_where_facets_lose_what_they_scatter_twice():
    metal = {"kind": "conductor", "reflectance": 1.0, "alpha": 1.0}
    wall = {"shape": "plane", "point": [0, 0, -3], "normal": [0, 0, 1], "material": metal}
    scene = world(PINHOLE, objects=[wall], render={"max_depth": 2, "multiple_scattering": False})
    assert luminance(rptcam_cl.render(scene, spp=16)) == pytest.approx(0.18, rel=0.02)


def test_settings_that_were_chosen_give_the_same_picture_as_physical_exposure():
    image = rptcam_cl.render(world(REAL), spp=4)
    told = image.metadata
    chosen = world(REAL, {"mode": "physical", "iso": told["iso"]}, shutter={"time_s": told["exposure_time_s"]})
    np.testing.assert_array_equal(pixels(chosen, spp=4), image.pixels)


@pytest.mark.parametrize(("exposure", "expected"), [
    ({"metering": "average"}, 1.6),
    ({"metering": "centre_weighted"}, 1.6),
    ({"metering": "spot", "spot_at": [0.2, 0.5]}, 3.0),
    ({"metering": "spot", "spot_at": [0.8, 0.9]}, 0.2),
])  # fmt: skip
def test_metering_looks_where_it_is_told(exposure, expected):
    scene = world(PINHOLE, {"mode": "auto", "f_number": 8} | exposure, objects=HALVES)
    assert rptcam_cl.render(scene, spp=1).metadata["metered_cd_m2"] == pytest.approx(683 * expected, rel=1e-5)


def test_a_spot_whose_edge_cuts_pixels_reads_what_a_fine_grid_reads():
    """Light falls on one side of a line through the disk; 96 pixels by their middles alone were 3 % off."""
    readings = []
    for columns in (96, 960):
        film = Film(resolution=(columns, columns * 2 // 3))
        weights = account.weights(Exposure(mode="auto", metering="spot", spot_at=(0.497, 0.503)), film)
        x = (np.arange(8 * columns) + 0.5) / (8 * columns)
        bright = (x > 0.53).reshape(columns, 8).mean(axis=1)
        readings.append(float((weights * bright).sum()))
    assert readings[0] == pytest.approx(readings[1], rel=0.01)


def test_metering_says_its_standard_error_and_takes_more_frames_for_it(monkeypatch):
    scene = world(PINHOLE, {"mode": "auto", "f_number": 8, "metering": "average"}, objects=HALVES)
    frames = []
    found = account.reading_cd_m2
    luck = iter(np.random.default_rng(1).normal(1.0, 0.2, 64))
    monkeypatch.setattr(account, "reading_cd_m2", lambda *of: frames.append(0) or float(found(*of) * next(luck)))
    said = rptcam_cl.render(scene, spp=1).metadata
    assert len(frames) == 64
    assert said["metered_error_cd_m2"] == pytest.approx(683 * 1.6 * 0.2 / 8, rel=0.25)
    assert abs(said["metered_cd_m2"] - 683 * 1.6) < 4 * said["metered_error_cd_m2"]


def test_weights_are_three_quarters_in_the_middle_and_one_in_all():
    film = Film(resolution=(360, 240))
    for name in ("average", "centre_weighted", "spot"):
        assert account.weights(Exposure(mode="auto", metering=name), film).sum() == pytest.approx(1)
    centre = account.weights(Exposure(mode="auto", metering="centre_weighted"), film)
    y, x = np.mgrid[:240, :360]
    disk = np.hypot(x - 179.5, y - 119.5) < 60  # 6 mm of a film 24 mm high
    assert centre[disk].sum() == pytest.approx(0.75, rel=0.005)  # pixels on its rim count for their part within
    spot = account.weights(Exposure(mode="auto", metering="spot", spot_at=(0.25, 0.5)), film)
    assert 1 / (spot.max() * spot.size) == pytest.approx(0.02, rel=0.001)
    assert spot[120, 90] > 0 == spot[120, 180]


@pytest.mark.parametrize("name", ["average", "centre_weighted", "spot"])
@pytest.mark.parametrize("resolution", [(1, 1), (2, 1), (96, 1)])
def test_smallest_frames_can_be_metered(name, resolution):
    weights = account.weights(Exposure(mode="auto", metering=name), Film(resolution=resolution))
    assert weights.shape == resolution[::-1]
    assert weights.sum() == pytest.approx(1)


def test_lock_keeps_the_exposure_of_another_picture_without_metering(monkeypatch):
    first = rptcam_cl.render(world(objects=HALVES), spp=2)
    lock = {"mode": "auto", "lock_cd_m2": first.metadata["metered_cd_m2"]}
    monkeypatch.setattr(account, "metered_cd_m2", None)
    again = rptcam_cl.render(world(exposure=lock, objects=HALVES), spp=2)
    np.testing.assert_array_equal(again.pixels, first.pixels)
    assert again.metadata["metering"] == "locked"
    dark = rptcam_cl.render(world(exposure=lock, environment={"kind": "constant", "radiance": 0.01}), spp=2)
    assert dark.metadata["exposure_time_s"] == first.metadata["exposure_time_s"]
    slow = rptcam_cl.render(world(THIN | {"f_number": 4 * math.sqrt(2)}, lock, objects=HALVES), spp=2)
    assert luminance(slow) == pytest.approx(luminance(first), rel=0.02)
    assert slow.metadata["exposure_time_s"] == pytest.approx(2 * first.metadata["exposure_time_s"], rel=0.01)


def test_what_is_chosen_makes_up_for_filter_sensitivity_and_time():
    plain, fast, filtered, brighter, timed = (
        rptcam_cl.render(world(REAL, {"mode": "auto"} | changes, shutter={"time_s": 0.5}), spp=4)
        for changes in ({}, {"iso": 800}, {"neutral_density_stops": 6}, {"ev": 1}, {"priority": "shutter"})
    )
    time_s = plain.metadata["exposure_time_s"]
    assert fast.metadata["exposure_time_s"] == pytest.approx(time_s / 8)
    assert filtered.metadata["exposure_time_s"] == pytest.approx(time_s * 64)
    assert brighter.metadata["exposure_time_s"] == pytest.approx(time_s * 2)
    assert (timed.metadata["exposure_time_s"], timed.metadata["iso"]) == (0.5, pytest.approx(100 * time_s / 0.5))
    for image in (fast, filtered, timed):
        np.testing.assert_allclose(image.pixels, plain.pixels, rtol=1e-6)
    np.testing.assert_allclose(brighter.pixels, 2 * plain.pixels, rtol=1e-6)


def test_exposure_is_the_same_for_every_seed_and_every_crop():
    scene = world(REAL, objects=HALVES)
    whole = rptcam_cl.render(scene, spp=1, seed=1)
    part = rptcam_cl.render(scene, spp=1, seed=2, crop=(0.5, 1, 0, 0.5))
    assert part.metadata["metered_cd_m2"] == whole.metadata["metered_cd_m2"]
    assert part.metadata["values_per_irradiance"] == whole.metadata["values_per_irradiance"]


@pytest.mark.slow
def test_noise_of_the_metering_is_small(monkeypatch):
    """A thirtieth of a stop, and no more, in a dark room with a small lamp in the picture."""
    lamp = {"shape": "sphere", "center": [0.4, 0.5, -2], "radius": 0.1}
    floor = {
        "shape": "plane",
        "point": [0, -1, 0],
        "normal": [0, 1, 0],
        "material": {"kind": "matte", "reflectance": 0.5},
    }
    objects = [lamp | {"material": {"kind": "emissive", "radiance": 30}}, floor]
    found = []
    for seed in range(4):
        monkeypatch.setattr(account, "METER_SEED", seed)
        scene = world(REAL, objects=objects, environment={"kind": "constant", "radiance": 0.01})
        scene["render"]["max_depth"] = 4
        found.append(math.log2(rptcam_cl.render(scene, spp=1).metadata["metered_cd_m2"]))
    assert 0 < np.std(found, ddof=1) < 0.06


def test_black_frame_and_exposures_out_of_reach_are_refused():
    black = {"kind": "constant", "radiance": 0}
    with pytest.raises(InputError, match=r"^exposure: auto metering \(average\) finds no light to go by \(got 0 cd/m²"):
        rptcam_cl.render(world(environment=black), spp=1)
    dark = {"mode": "auto", "lock_cd_m2": 1e-10, "iso": 1e-3}
    with pytest.raises(InputError, match=r"^exposure: auto metering needs an exposure time in s out of range \(got"):
        rptcam_cl.render(world(exposure=dark), spp=1)
    with pytest.raises(InputError, match=r"needs an exposure compensation in stops out of range \(got 103"):
        rptcam_cl.render(world(PINHOLE, {"mode": "auto", "lock_cd_m2": 1e-12, "ev": 56}), spp=1)
    bright = {"mode": "auto", "lock_cd_m2": 1e18, "priority": "shutter"}
    with pytest.raises(InputError, match=r"^exposure: auto metering needs an ISO out of range \(got"):
        rptcam_cl.render(world(exposure=bright), spp=1)


def test_resumed_render_keeps_its_exposure(tmp_path, monkeypatch):
    scene, path = world(REAL, objects=HALVES), tmp_path / "picture.rpck"
    whole = rptcam_cl.render(scene, spp=6)
    rptcam_cl.render(scene, spp=3, checkpoint=path, resume=True)
    monkeypatch.setattr(account, "metered_cd_m2", None)
    resumed = rptcam_cl.render(scene, spp=6, checkpoint=path, resume=True)
    np.testing.assert_array_equal(resumed.pixels, whole.pixels)
    assert resumed.metadata["metered_cd_m2"] == whole.metadata["metered_cd_m2"]


def test_command_line_sets_keys_and_says_what_was_chosen(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    thin = (
        "kind: thin_lens, focal_length_mm: 50, f_number: 4, focus_distance_m: 1e9, eye: [0, 0, 0], target: [0, 0, -1]"
    )
    tmp_path.joinpath("a.yaml").write_text(f"camera: {{{thin}}}\nenvironment: {{kind: constant, radiance: 2}}\n")
    options = ["--size", "16x16", "--spp", "1", "--set", "exposure=auto", "--set", "exposure.metering=spot"]
    assert main(["render", "a.yaml", "-o", "a.png", *options, "--set", "exposure.iso=400"]) == 0
    # 0.18 * 78 / (400 * 1366 * pi / 64) s, at the working f-number of the flat opening
    assert "metered 1366 cd/m², 1/1881 s at ISO 400" in capsys.readouterr().err


def test_chosen_time_is_that_of_the_numbers_where_keys_move_during_the_exposure():
    """Film, metadata and sensor go by one time, and not by that of the scene."""
    keys = {"environment.radiance": [{"time_s": 0, "value": 1}, {"time_s": 1e9, "value": 1}]}
    rest = {"environment": {"kind": "constant", "radiance": 1}, "sensor": {"bayer": "none"}}
    still = rptcam_cl.render(world(shutter={"time_s": 1 / 8}, **rest), spp=4)
    moving = rptcam_cl.render(world(shutter={"time_s": 1 / 8, "keys": keys, "steps": 2}, **rest), spp=4)
    assert still.metadata["exposure_time_s"] < 1 / 100
    for name in ("exposure_time_s", "ev100", "values_per_irradiance"):
        assert moving.metadata[name] == still.metadata[name]
    assert moving.seen.mean() == pytest.approx(moving.pixels.mean(), rel=1e-3)
    np.testing.assert_array_equal(moving.raw().numbers, still.raw().numbers)
