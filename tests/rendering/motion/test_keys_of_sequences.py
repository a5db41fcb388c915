"""Each kind of key of a sequence, by what the picture of its frame measures: a ball lit from the camera, on black."""

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene

SCENE = {
    "film": {"resolution": [36, 24], "size_mm": [36, 24]},
    "camera": {
        "kind": "thin_lens", "focal_length_mm": 50, "f_number": 8, "focus_distance_m": 5,
        "eye": [0, 0, 0], "target": [0, 0, -1],
    },
    "objects": [
        {"shape": "sphere", "center": [0, 0, -5], "radius": 0.5, "material": {"kind": "matte", "reflectance": 0.2}}
    ],
    "lights": [{"kind": "point", "position": [0, 0, 1], "intensity": 100}],
}  # fmt: skip


def frames(keys, **parts):
    """Return frames 1 and 3 of three, between which keys go from their first to their second value."""
    keyframes = {key: [{"time_s": 0, "value": a}, {"time_s": 1, "value": b}] for key, (a, b) in keys.items()}
    scene = load_scene(SCENE | parts | {"sequence": {"frames_per_second": 2, "keys": keyframes}})
    found = [set_keys(scene, scene.sequence.changes(scene.shutter.open_s, number)) for number in (1, 3)]
    return [rptcam_cl.render(frame, spp=64).pixels[..., 1].astype(float) for frame in found]


def moments(picture):
    """Return the light of a picture, its centroid and its variance about that [pixels], from the left and the top."""
    rows, columns = np.indices(picture.shape) + 0.5
    light = picture.sum()
    x, y = (columns * picture).sum() / light, (rows * picture).sum() / light
    return light, (x, y), (((columns - x) ** 2 + (rows - y) ** 2) * picture).sum() / light


@pytest.mark.parametrize(
    ("keys", "parts", "gain"),
    [
        ({"exposure.ev": (0, 2)}, {}, 4),
        ({"objects.0.material.reflectance": (0.2, 0.6)}, {}, 3),
        ({"lights.0.intensity": (100, 250)}, {}, 2.5),
        ({"camera.f_number": (8, 4)}, {"exposure": {"mode": "physical"}}, 257 / 65),  # 1 + 4 N^2
        ({"shutter.time_s": (0.01, 0.02)}, {"exposure": {"mode": "physical"}}, 2),
    ],
)  # fmt: skip
def test_light_of_the_frame_goes_with_its_key(keys, parts, gain):
    first, last = frames(keys, **parts)
    assert moments(last)[0] / moments(first)[0] == pytest.approx(gain, rel=0.01)


def test_zoom_makes_the_ball_larger():
    first, last = frames({"camera.focal_length_mm": (50, 100)})
    film = [1 / (1 / focal - 1 / 5) for focal in (0.05, 0.1)]  # film distances
    assert moments(last)[2] / moments(first)[2] == pytest.approx((film[1] / film[0]) ** 2, rel=0.02)


def test_rise_and_shift_take_the_ball_along():
    first, last = frames({"camera.movements.rise_mm": (0, 3), "camera.movements.shift_mm": (0, -6)})
    away = np.subtract(moments(last)[1], moments(first)[1])
    assert away == pytest.approx((6, 3), abs=0.05)  # a pixel a millimetre


def test_focus_spreads_the_ball_by_its_circle_of_confusion():
    first, last = frames({"camera.focus_distance_m": (5, 0.5), "camera.f_number": (2, 2)})
    film = [1 / (1 / 0.05 - 1 / focus) for focus in (5, 0.5)]
    blur = 25 * abs(film[1] / film[0] - 1)  # diameter on the film [pixels], of an opening of 25 mm
    expected = moments(first)[2] * (film[1] / film[0]) ** 2 + blur**2 / 8
    assert moments(last)[2] == pytest.approx(expected, rel=0.05)
