"""Optical flow against the positions that the other picture has there, and against closed forms."""

from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.scene.changes import change_scene
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene
from tests.rendering.truth.test_sharp_layers import GLASS, GREY, PINHOLE, SKY, panel
from tests.support.cases import slow

STEP_S = 0.04
SHUTTER = {"time_s": 0.02}
ROLLING = {"time_s": 0.01, "kind": "rolling", "readout_s": 0.02}
TURN = [
    {"time_s": -1, "rotate": {"axis": [0, 1, 0], "degrees": -30}, "translate": [0, 0, -3]},
    {"time_s": 1, "rotate": {"axis": [0.1, 1, 0.3], "degrees": 60}, "translate": [0.4, 0.5, -3.5]},
]
PAN = [
    {"time_s": -1, "eye": [-0.2, 0, 0], "target": [0.3, 0, -5]},
    {"time_s": 1, "eye": [0.2, 0.1, 0], "target": [-0.3, 0.2, -5]},
]
FINE = {"resolution": [60, 40]}
COARSE = {"resolution": [42, 28]}


def moving(camera: dict[str, Any], shutter: dict[str, Any], open_s: float = 0.0) -> Scene:
    """A card that turns and travels before a wall, seen by a camera that pans and travels."""
    card = panel(0.0, 0.7, name="card", motion=TURN)
    scene = {
        "film": COARSE, "camera": camera | {"motion": PAN}, "objects": [card, panel(-6.0, 20.0, name="wall")],
        "environment": SKY, "shutter": shutter | {"open_s": open_s},
    }  # fmt: skip
    return load_scene(scene)


def cubic(values: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (n, k) of a picture at places (n, 2) between its pixels' middles, and those of the 16 pixels around."""
    first = np.floor(places - 0.5).astype(int) - 1
    t = places - 0.5 - first
    weights = []
    for k in range(4):
        others = [j for j in range(4) if j != k]
        weights.append(np.prod([(t - j) / (k - j) for j in others], axis=0))
    near = np.stack(
        [np.stack([values[first[:, 1] + j, first[:, 0] + i] for i in range(4)], axis=1) for j in range(4)], axis=1
    )
    wx, wy = np.stack(weights)[..., 0], np.stack(weights)[..., 1]
    return np.einsum("jn,in,njik->nk", wy, wx, near), near


def moment_of(scene: Scene, rows: np.ndarray) -> np.ndarray:
    """The middle of the exposure of rows (the middle of row 0 is 0.5)."""
    shutter = scene.shutter
    late = 0.0 if shutter.readout_s is None else shutter.readout_s * (rows - 0.5) / (scene.film.resolution[1] - 1)
    return shutter.open_s + shutter.time_s / 2 + late + 0 * rows


@pytest.mark.parametrize(("camera", "shutter"), [slow(PINHOLE, ROLLING), (GLASS, SHUTTER)], ids=["rolling", "lens"])
def test_flow_leads_to_the_same_points_in_the_other_frames(camera: dict[str, Any], shutter: dict[str, Any]) -> None:
    before, here, after = (moving(camera, shutter, step * STEP_S) for step in (-1, 0, 1))
    layers = ["sharp_position", "sharp_object_id", "flow_forward", "flow_backward"]
    image = rptcam_cl.render(here, spp=1, layers=layers, neighbours=(before, after))
    for other, flow in ((before, "flow_backward"), (after, "flow_forward")):
        assert beside_px(here, image, other, image[flow]) < 0.01


def test_flow_of_another_size_is_that_of_a_film_of_it() -> None:
    size, layers = (24, 16), ["flow_forward", "flow_backward"]

    def frames(film: dict[str, Any]) -> list[Scene]:
        return [change_scene(moving(GLASS, SHUTTER, step * STEP_S), film=film) for step in (-1, 0, 1)]

    def flows(film: dict[str, Any], **settings: Any) -> rptcam_cl.Image:
        before, here, after = frames(film)
        return rptcam_cl.render(here, spp=1, layers=layers, neighbours=(before, after), **settings)

    given, wanted = flows({}, size=size), flows({"resolution": size})
    for name in layers:
        np.testing.assert_array_equal(given[name], wanted[name])


def beside_px(here: Scene, image: rptcam_cl.Image, there: Scene, flow: np.ndarray) -> float:
    """By how much the points that flow leads to in another picture are beside those of this one, at most [pixels]."""
    other = rptcam_cl.render(there, spp=1, layers=["sharp_position", "sharp_object_id"])
    rows, columns = np.indices(flow.shape[:2]) + 0.5
    places = (np.stack([columns, rows], axis=-1) + flow).reshape(-1, 2)
    inside = np.all((places > 2) & (places < np.array(COARSE["resolution"]) - 2), axis=1)
    places, owner = places[inside], image["sharp_object_id"].ravel()[inside]
    found, near = cubic(other["sharp_position"], places)
    _, ids = cubic(other["sharp_object_id"][..., None], places)
    same = (ids[..., 0] == owner[:, None, None]).all(axis=(1, 2))  # neither at an edge nor hidden there
    worst = 0.0
    for index, item in enumerate(here.objects):
        mine = same & (owner == index)
        assert mine.sum() > 100
        times = moment_of(here, rows.ravel()[inside][mine]), moment_of(there, places[mine, 1])
        back = np.stack([item.placed_at(a) @ np.linalg.inv(item.placed_at(b)) for a, b in zip(*times, strict=True)])
        moved = np.einsum("nij,nj->ni", back, np.hstack([found[mine], np.ones((mine.sum(), 1))]))[:, :3]
        miss = np.linalg.norm(moved - image["sharp_position"].reshape(-1, 3)[inside][mine], axis=1)
        pixel = np.linalg.norm(near[mine, 1, 2] - near[mine, 1, 1], axis=1)
        worst = max(worst, float((miss / pixel).max()))
    return worst


@pytest.mark.slow
def test_motion_is_that_of_the_projection_over_the_shutter() -> None:
    speed, depth = 1.5, 3.0  # [m/s], [m]
    way = [{"time_s": 0, "translate": [0, 0, 0]}, {"time_s": 1, "translate": [speed, 0, 0]}]
    card = panel(-depth, 0.6, motion=way)
    scene = {
        "film": FINE, "camera": PINHOLE, "objects": [card], "environment": SKY, "shutter": {"time_s": 0.05},
    }  # fmt: skip
    layers = ["motion", "flow_forward", "flow_backward", "sharp_object_id"]
    image = rptcam_cl.render(scene, spp=1, layers=layers)
    on = image["sharp_object_id"] == 0
    shift = 30 / np.tan(np.radians(20)) * speed * 0.05 / depth  # [pixels]
    np.testing.assert_allclose(image["motion"][on], np.broadcast_to([shift, 0], (on.sum(), 2)), atol=1e-5)
    assert np.abs(image["motion"][~on]).max() < 1e-9  # the sky stands still
    np.testing.assert_allclose(image["flow_forward"] - image["flow_backward"], image["motion"], atol=1e-5)


@pytest.mark.parametrize("direction", [None, "right_left"])
def test_flow_of_a_panorama_leads_across_its_seam_the_short_way(direction: str | None) -> None:
    degrees = 12.0  # by which the camera turns to the right from picture to picture, about the upright axis
    rolling = {} if direction is None else {"kind": "rolling", "readout_s": 0.02, "direction": direction}

    def turned(angle: float) -> Scene:
        target = [np.sin(np.radians(angle)), 0, -np.cos(np.radians(angle))]
        camera = {"kind": "environment", "eye": [0, 0, 0], "target": target, "up": [0, 1, 0]}
        shutter = {"time_s": 0.01} | rolling
        return load_scene({"film": {"resolution": [60, 30]}, "camera": camera, "environment": SKY, "shutter": shutter})

    names = ["flow_forward", "flow_backward"]
    image = rptcam_cl.render(turned(0), spp=1, layers=names, neighbours=(turned(-degrees), turned(degrees)))
    for name, way in zip(names, (-degrees, degrees), strict=True):
        shift = np.broadcast_to([way / 360 * 60, 0], (30, 60, 2))  # at the seam, too
        np.testing.assert_allclose(image[name], shift, atol=1e-5)


@pytest.mark.parametrize("rolling", [slow({}), {"kind": "rolling", "readout_s": 0.039}])
def test_way_over_the_shutter_is_halved_at_the_middle_of_each_pixels_own_exposure(rolling: dict[str, Any]) -> None:
    # the card stands still until the middle of the exposure of row 19.5 of 40 and moves from there on
    time_s, speed, depth = 0.05, 1.5, 3.0
    begin = time_s / 2 + (0.0195 if rolling else 0.0)
    way = [
        {"time_s": 0, "translate": [0, 0, 0]}, {"time_s": begin, "translate": [0, 0, 0]},
        {"time_s": begin + 1, "translate": [speed, 0, 0]},
    ]  # fmt: skip
    scene = {
        "film": FINE, "camera": PINHOLE, "objects": [panel(-depth, 0.6, motion=way)], "environment": SKY,
        "shutter": {"time_s": time_s} | rolling,
    }  # fmt: skip
    image = rptcam_cl.render(scene, spp=1, layers=["flow_forward", "flow_backward", "sharp_object_id"])
    on = image["sharp_object_id"] == 0
    middle = moment_of(load_scene(scene), np.arange(40) + 0.5)
    focal = 30 / np.tan(np.radians(20))
    for name, end in (("flow_backward", middle - time_s / 2), ("flow_forward", middle + time_s / 2)):
        moved = np.maximum(end - begin, 0) - np.maximum(middle - begin, 0)
        expected = np.broadcast_to((focal * speed / depth * moved)[:, None], (40, 60))
        np.testing.assert_allclose(image[name][on][:, 0], expected[on], atol=1e-5)


def test_flow_follows_keys_that_change_and_ends_where_an_object_is_no_more() -> None:
    ball = {"shape": "sphere", "center": [0, 0, -4], "radius": 0.8, "material": GREY}
    scene = {"film": FINE, "camera": PINHOLE, "objects": [ball], "environment": SKY}
    grown = scene | {"objects": [ball | {"radius": 0.9}]}
    image = rptcam_cl.render(
        scene, spp=1, layers=["flow_forward", "sharp_position"], neighbours=(None, load_scene(grown))
    )
    points = image["sharp_position"]
    on = np.isfinite(points[..., 0])
    other = (points - [0, 0, -4]) * 0.9 / 0.8 + [0, 0, -4]
    focal = 30 / np.tan(np.radians(20))
    expected = focal * (other / -other[..., 2:] - points / -points[..., 2:])[..., :2] * (1, -1)
    np.testing.assert_allclose(image["flow_forward"][on], expected[on], atol=1e-4)
    gone = rptcam_cl.render(
        scene, spp=1, layers=["flow_forward"], neighbours=(None, load_scene(scene | {"objects": []}))
    )
    assert np.isnan(gone["flow_forward"][on]).all()
    assert np.abs(gone["flow_forward"][~on]).max() < 1e-9


def test_nothing_flows_between_equal_frames_where_a_camera_model_takes_the_place_of_the_lens() -> None:
    lens = {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 3}, "f_number": 16}
    loose = {"accuracy": {"max_error_px": 5, "max_illumination_error": 100}, "eye": [0, 0, 0], "target": [0, 0, -1]}
    wall = panel(-6.0, 20.0, name="wall")
    scene = load_scene({"film": FINE, "camera": lens | loose, "objects": [wall], "environment": SKY})
    image = rptcam_cl.render(scene, spp=1, layers=["flow_forward"], neighbours=(scene, scene))
    assert image.metadata["camera"] == "pinhole"
    np.testing.assert_allclose(image["flow_forward"], 0.0, atol=1e-6)
