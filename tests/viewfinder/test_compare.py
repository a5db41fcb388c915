"""Simpler cameras in the place of a lens: the same view and brightness, so that what differs is the lens."""

import json
import math
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_models import view
from rptcam_cl.scene.camera import PinholeCamera
from rptcam_cl.scene.load import apply_overrides, load_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.instruments import LEGEND, as_model, difference, difference_rgb
from rptcam_cl.viewfinder.lens_panel import perspective
from rptcam_cl.viewfinder.panel import value_per_radiance

POSE = {"eye": [0, 0, 0], "target": [0, 0, -2]}
LENS = {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 2}, "f_number": 4, **POSE}
THIN = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 4, "focus_distance_m": 2, **POSE}


def changed(camera: dict[str, Any], kind: str, exposure: dict[str, Any]) -> tuple[Scene, Scene]:
    content: dict[str, Any] = {"film": {"resolution": [36, 24]}, "camera": camera, "exposure": exposure}
    scene = load_scene(content)
    data = json.loads(json.dumps(content))
    changes = as_model(scene, scene, kind)
    apply_overrides(data, [f"{key}={json.dumps(value)}" for key, value in changes.items()])
    return scene, load_scene(data)


@pytest.mark.parametrize("exposure", [{"mode": "relative"}, {"mode": "physical", "iso": 200}])
@pytest.mark.parametrize(
    ("camera", "kind"),
    [
        (LENS, "thick_lens"),
        (LENS, "thin_lens"),
        (LENS, "pinhole"),
        (LENS | {"kind": "thick_lens"}, "thin_lens"),
        (THIN, "pinhole"),
    ],
)
def test_view_and_brightness_stay(camera: dict[str, Any], kind: str, exposure: dict[str, Any]) -> None:
    scene, simple = changed(camera, kind, exposure)
    assert simple.camera.kind == kind
    assert math.log2(value_per_radiance(simple) / value_per_radiance(scene)) == pytest.approx(0, abs=0.03)
    before, after = perspective(scene), perspective(simple)
    assert before is not None
    if after is not None:  # seen from the entrance pupil
        assert after.focus_mm - after.pupil_mm == pytest.approx(before.focus_mm - before.pupil_mm, rel=1e-6)
        assert after.diameter_mm == pytest.approx(before.diameter_mm, rel=1e-6)
        assert after.per_tangent_mm == pytest.approx(before.per_tangent_mm, rel=1e-6)
    else:
        width_mm = simple.film.size_m()[0] * 1e3
        assert isinstance(simple.camera, PinholeCamera)
        tangent = math.tan(math.radians(simple.camera.fov_degrees) / 2)
        assert width_mm / 2 / tangent == pytest.approx(before.per_tangent_mm, rel=1e-6)


@pytest.mark.parametrize(
    ("camera", "kind"), [(LENS, "thin_lens"), (LENS | {"kind": "thick_lens"}, "pinhole"), (THIN, "pinhole")]
)
def test_film_that_is_risen_stays_so(camera: dict[str, Any], kind: str) -> None:
    scene, simple = changed(camera | {"movements": {"rise_mm": 5}}, kind, {"mode": "relative"})
    before = perspective(scene)
    assert before is not None
    for each in (scene, simple):
        [seen], _ = view(each).directions(np.array([[18.0, 12.0]]))
        assert -seen[1] / seen[2] == pytest.approx(5 / before.per_tangent_mm, rel=2e-3)  # less what a lens distorts


def test_film_that_is_turned_has_no_simpler_lens() -> None:
    scene = load_scene({"camera": LENS | {"movements": {"tilt_degrees": 2}}})
    with pytest.raises(InputError, match=r"camera\.movements: a film that is turned"):
        as_model(scene, scene, "pinhole")


def test_same_kind_changes_nothing_and_a_better_one_is_refused() -> None:
    scene = load_scene({"camera": THIN})
    assert as_model(scene, scene, "thin_lens") == {}
    for kind in ("thick_lens", "realistic", "camera obscura"):
        with pytest.raises(InputError, match="model"):
            as_model(scene, scene, kind)


def test_relmse_is_that_of_the_tradeoff_tables() -> None:
    rng = np.random.default_rng(6)
    a, b = (rng.gamma(2.0, 0.2, (19, 29, 3)).astype(np.float32) for _ in range(2))
    total, floor = 0.0, (0.01**2) * float(np.sum(a.astype(np.float64).mean(axis=(0, 1)) ** 2))
    for i in range(19):
        for j in range(29):
            tile = a[i // 8 * 8 : i // 8 * 8 + 8, j // 8 * 8 : j // 8 * 8 + 8].astype(np.float64)
            square = float(np.mean(np.sum(tile**2, axis=2)))
            total += float(np.sum((b[i, j].astype(np.float64) - a[i, j]) ** 2)) / (square + floor)
    assert difference(a, b)[1]["relmse"] == pytest.approx(total / (19 * 29), rel=1e-12)


def test_a_stop_is_a_stop_and_its_sense_is_that_of_the_second() -> None:
    a = np.full((9, 9, 3), 0.2, np.float32)
    stops, numbers = difference(a, 2 * a)
    assert np.allclose(stops, 1.0)
    assert numbers == pytest.approx(
        {"relmse": 1 / 1.0001, "mean_stops": 1.0, "bias_stops": 1.0, "worst_stops": 1.0}, rel=1e-6
    )
    assert np.array_equal(difference(2 * a, a)[0], -stops)


def test_equal_pictures_have_no_difference_even_when_black() -> None:
    black = np.zeros((4, 4, 3), np.float32)
    assert difference(black, black)[1] == {"relmse": 0, "mean_stops": 0, "bias_stops": 0, "worst_stops": 0}


def test_map_is_blue_where_darker_and_red_where_brighter() -> None:
    a = np.full((1, 3, 3), 0.2, np.float32)
    b = a * np.array([0.125, 1, 8], np.float32)[None, :, None]
    colours = [entry["colour"] for entry in LEGEND]
    assert [tuple(pixel) for pixel in difference_rgb(difference(a, b)[0])[0].tolist()] == colours


def test_films_of_other_sizes_are_refused() -> None:
    with pytest.raises(InputError, match="sizes"):
        difference(np.zeros((2, 2, 3), np.float32), np.zeros((2, 3, 3), np.float32))
