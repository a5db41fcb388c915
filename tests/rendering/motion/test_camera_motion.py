"""A camera that moves during the exposure."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import tracer
from tests.device.probes import open_session
from tests.rendering.motion.pictures import (
    BALL,
    FLOOR,
    GREY,
    PAIRS,
    PINHOLE,
    POSE,
    exposures,
    film,
    scene_with,
    still_mean,
)
from tests.rendering.pictures import pixels
from tests.support.cases import slow
from tests.support.statistics import assert_same_tiles

LENS = {"kind": "thin_lens", "fov_degrees": 40, "aperture_radius_m": 0.2, "focus_distance_m": 5.0, **POSE}

# Over two seconds: sideways and up, swinging the view, rolling; with a keyframe in the middle.
WAY = [
    {"time_s": 0},
    {"time_s": 1, "eye": [1, 1.5, 5], "up": [0.2, 1, 0]},
    {"time_s": 2, "eye": [1, 1.5, 4], "target": [0.5, 1, 0]},
]


def pose_at(t):
    """What linear interpolation of WAY says, written out."""
    if t <= 1:
        return {"eye": [t, 1 + t / 2, 5], "target": [0, 1, 0], "up": [0.2 * t, 1, 0]}
    s = t - 1
    return {"eye": [1, 1.5, 5 - s], "target": [0.5 * s, 1, 0], "up": [0.2 * (1 - s), 1, 0]}


def moving(camera=PINHOLE, **shutter):
    return scene_with(camera=camera | {"motion": WAY}, shutter=shutter or {"time_s": 2})


@pytest.mark.parametrize("shutter", [{"time_s": 2}, {"time_s": 0.5, "kind": "rolling", "readout_s": 1}])
def test_shutter_alone_changes_no_bit(session, shutter):
    assert film(scene_with(shutter=shutter), session).tobytes() == film(scene_with(), session).tobytes()


@pytest.mark.parametrize(("open_s", "moment"), [(-5, 0), (2, 2), (7, 2)])
def test_camera_holds_before_the_first_keyframe_and_after_the_last(session, open_s, moment):
    held = film(moving(open_s=open_s, time_s=1), session)
    assert held.tobytes() == film(scene_with(camera=PINHOLE | pose_at(moment)), session).tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("camera", [slow(PINHOLE), LENS])
def test_exposure_is_the_mean_of_still_pictures(session, camera):
    options = {"spp": 64}
    blurred = exposures(moving(camera), session, "blurred", **options)

    def still(t):
        return scene_with(camera=camera | pose_at(t))

    assert_same_tiles(blurred, still_mean(still, (0, 2), session, "still", spp=8))
    with pytest.raises(AssertionError):  # a camera that stands in the middle of the way
        assert_same_tiles(blurred, exposures(still(1), session, "middle", **options))


def test_part_of_the_way_is_the_mean_of_that_part(session):
    part = exposures(moving(open_s=0.8, time_s=0.7), session, "part", spp=64)

    def still(t):
        return scene_with(camera=PINHOLE | pose_at(t))

    assert_same_tiles(part, still_mean(still, (0.8, 1.5), session, "still", spp=8))


def test_target_that_moves_with_the_eye_is_a_shift_of_the_world(session):
    """Far from the origin as well."""
    there = np.array([3e6, -1e6, 2e6])
    shifts = [{"time_s": 0}, {"time_s": 1, "eye": [0.5, 1, 5], "target": [0.5, 1, 0]}]
    near = film(scene_with(camera=PINHOLE | {"motion": shifts}, shutter={"time_s": 1}), session)

    def moved(point):
        return (there + point).tolist()

    pose = {"eye": moved([0, 1, 5]), "target": moved([0, 1, 0])}
    last = {"time_s": 1, "eye": moved([0.5, 1, 5]), "target": moved([0.5, 1, 0])}
    camera = PINHOLE | pose | {"motion": [{"time_s": 0}, last]}
    objects = [FLOOR | {"point": moved([0, 0, 0])}, BALL | {"center": moved([0, 1, 0])}]
    far = film(scene_with(objects, camera, {"time_s": 1}), session)
    assert np.isclose(near, far, rtol=1e-4, atol=1e-5).mean() > 0.95


def test_wave_size_crop_and_interruption_change_no_bit(session, tmp_path):
    scene = moving(time_s=1.5, kind="rolling", readout_s=0.5)
    whole = film(scene, session, spp=9)
    assert film(scene, session, spp=9, wave_size=1024).tobytes() == whole.tobytes()
    state = tmp_path / "a.rpck"
    film(scene, session, spp=4, checkpoint=state, resume=True)
    assert film(scene, session, spp=9, checkpoint=state, resume=True).tobytes() == whole.tobytes()
    part = film(scene, session, spp=9, crop=(0.25, 0.75, 0.5, 1.0))
    np.testing.assert_array_equal(part, whole[12:, 8:24])


@pytest.mark.slow  # single lanes in passes are in `device/test_gpu_way.py`
@pytest.mark.parametrize(("lanes", "organisation"), PAIRS)
def test_passes_and_stream_and_every_width_agree(session, lanes, organisation, monkeypatch):
    plain = film(moving(), session)
    monkeypatch.setattr(Session, "lanes", lanes)
    monkeypatch.setattr(tracer, "ORGANISATION", {"cpu": organisation, "gpu": organisation})
    assert np.isclose(film(moving(), open_session()), plain, rtol=1e-5, atol=1e-6).mean() > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("organisation", ["passes", "stream"])
def test_depth_is_measured_from_where_the_camera_is(session, organisation, monkeypatch):
    """A wall 6 m ahead that the camera goes towards by 2 m: its depth is 5 m in the mean."""
    wall = {"shape": "plane", "point": [0, 0, -1], "normal": [0, 0, 1], "material": GREY}
    camera = PINHOLE | {"motion": [{"time_s": 0}, {"time_s": 1, "eye": [0, 1, 3], "target": [0, 1, -5]}]}
    scene = scene_with([wall], camera, {"time_s": 1})
    monkeypatch.setattr(tracer, "ORGANISATION", {"cpu": organisation, "gpu": organisation})
    image = rptcam_cl.render(scene, spp=64, layers=["depth", "distance"], device=session)
    # times are stratified: 64 samples miss the mean by less than a stratum
    np.testing.assert_allclose(image["depth"], 5, atol=2 / 64)
    assert image["distance"].min() > image["depth"].min()


def test_samples_of_a_pixel_are_spread_over_the_exposure(session):
    """A bright half world that comes into view: the share of the time that each pixel sees it, in few samples."""
    half = {"shape": "rectangle", "corner": [-50, -50, 0], "edge_u": [50, 0, 0], "edge_v": [0, 100, 0]}
    lamp = half | {"material": {"kind": "emissive", "radiance": 1.0, "two_sided": True}}
    camera = PINHOLE | {"motion": [{"time_s": 0}, {"time_s": 1, "eye": [2, 1, 5], "target": [2, 1, 0]}]}
    scene = scene_with([lamp], camera, {"time_s": 1}, environment={"kind": "constant", "radiance": 0})
    columns = np.arange(32)
    x = (2 * (columns + 0.5) / 32 - 1) * 5 * np.tan(np.radians(20))  # seen at the beginning
    expected = np.clip(-x / 2, 0, 1)  # until the edge x = 0 has passed
    inside = (expected > 0.1) & (expected < 0.9)
    errors = {}
    for sampler in ("lattice", "independent"):
        picture = pixels(scene | {"render": {"spp": 64, "max_depth": 1, "sampler": sampler}}, device=session, seed=1)
        errors[sampler] = np.abs(picture[:, inside, 0] - expected[inside]).mean()
    assert errors["lattice"] < 0.02 < errors["independent"]


def test_metadata_tell_shutter_and_poses_at_opening_and_close(session):
    shutter = {"open_s": 0.5, "time_s": 0.25, "kind": "rolling", "readout_s": 0.75}
    image = rptcam_cl.render(moving(**shutter) | {"metres_per_unit": 0.5}, spp=1, device=session)
    assert image.metadata["shutter"] == shutter | {"direction": "top_down"}
    for key, t in (("world_from_camera", 0.5), ("world_from_camera_at_close", 1.5)):
        assert image.stats["camera"][key] == image.metadata[key]
        matrix, pose = np.array(image.metadata[key]), pose_at(t)
        np.testing.assert_allclose(matrix[:3, 3], 0.5 * np.array(pose["eye"]))
        view = np.subtract(pose["target"], pose["eye"])
        np.testing.assert_allclose(-matrix[:3, 2], view / np.linalg.norm(view))
        assert np.dot(matrix[:3, 0], pose["up"]) == pytest.approx(0)
    still = rptcam_cl.render(scene_with(), spp=1, device=session)
    assert not {"shutter", "world_from_camera_at_close"} & still.metadata.keys()
