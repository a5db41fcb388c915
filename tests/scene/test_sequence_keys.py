"""What keyframes of a sequence may change: each kind of key, as the camera, the lights and the materials then stand."""

import numpy as np
import pytest

from rptcam_cl.optics.lens import float_groups
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.setting import film_frame, lens_setting
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.exposure import FrameSequence
from rptcam_cl.scene.load import load_scene
from tests.optics.test_floating import BENCH

LENS = {"kind": "realistic", "lens": "zoom-70-200mm", "eye": [0, 0, 0], "target": [0, 0, -1]}
INNER_FOCUS = {
    "name": "two groups",
    "surfaces": [
        {"radius": 50, "thickness": 5, "glass": "N-BK7", "diameter": 20},
        {"radius": -50, "thickness": 10, "diameter": 20},
        {"radius": -100, "thickness": 2, "glass": "N-BK7", "diameter": 20},
        {"radius": 100, "thickness": 10, "diameter": 20},
        {"stop": True, "diameter": 10},
    ],
    "focusing": {"surfaces": [2, 3], "travel": [-3, 3]},
}


def frame(keys, at=3, base=None, **parts):
    """Return frame 3 of a sequence at 2 frames a second, one second after the first; keyframes run over two."""
    scene = {
        "film": {"resolution": [24, 16]},
        "camera": LENS | {"focal_length_mm": 100, "focus": {"distance_m": 5}, "f_number": 8},
        "objects": [
            {"shape": "sphere", "center": [0, 0, -3], "radius": 1, "material": {"kind": "matte", "reflectance": 0.2}}
        ],
        "lights": [{"kind": "point", "position": [0, 3, 0], "intensity": 10}],
        "environment": {"kind": "constant", "radiance": 1},
    }
    frames = {key: [{"time_s": 0, "value": a}, {"time_s": 2, "value": b}] for key, (a, b) in keys.items()}
    scene |= parts | {"sequence": {"frames_per_second": 2, "keys": frames}}
    loaded = load_scene(scene, base_dir=base)
    return set_keys(loaded, loaded.sequence.changes(loaded.shutter.open_s, at))


def test_zoom_goes_between_its_focal_lengths():
    found = lens_setting(frame({"camera.focal_length_mm": (80, 160)}))
    assert found.lens.first_order().focal_length_mm == pytest.approx(120, rel=1e-6)


def test_exposure_goes_in_stops():
    dark, bright = (camera_model(frame({"exposure.ev": (0, 4)}, at=at)).record["exposure"][0] for at in (1, 3))
    assert bright / dark == pytest.approx(4, rel=1e-6)  # two of the four stops after half the way


def test_film_rises_shifts_tilts_and_swings():
    keys = {"rise_mm": (0, 6), "shift_mm": (2, 4), "tilt_degrees": (-4, 4), "swing_degrees": (0, 10)}
    keys = {f"camera.movements.{name}": ends for name, ends in keys.items()}
    moved = film_frame(frame(keys).camera)
    assert moved.centre == (-3, -3)
    assert moved.normal == pytest.approx((np.sin(np.radians(5)), 0, np.cos(np.radians(5))))


def test_film_and_focusing_group_go_to_their_places():
    camera = LENS | {"lens": "dgauss-50mm", "focus": {"film_distance_mm": 36.0}}
    found = frame({"camera.focus.film_distance_mm": (36, 38)}, camera=camera)
    assert lens_setting(found).film_distance_mm == pytest.approx(37)
    camera = LENS | {"lens": INNER_FOCUS, "focus": {"group_shift_mm": 0.0}}
    scenes = [frame({"camera.focus.group_shift_mm": (0, 2)}, at=at, camera=camera) for at in (1, 3)]
    gaps = [sum(surface.thickness for surface in lens_setting(scene).lens.surfaces[:-1]) for scene in scenes]
    thick = [[surface.thickness for surface in lens_setting(scene).lens.surfaces] for scene in scenes]
    assert max(np.abs(np.subtract(*thick))) == pytest.approx(1)
    assert gaps[0] == pytest.approx(gaps[1])  # an inner group: the lens keeps its length


def test_floating_groups_stand_as_the_distance_says(tmp_path):
    path = tmp_path / "floating.txt"
    path.write_text(BENCH)
    camera = LENS | {"lens": "floating.txt", "focus": {"distance_m": 2.0}}
    keys = {"camera.focus.distance_m": (2, 0.6)}
    found = [lens_setting(frame(keys, at=at, base=tmp_path, camera=camera)) for at in (1, 3, 5)]
    gaps = [[setting.lens.surfaces[row].thickness for row in (1, 4)] for setting in found]
    for distance_mm, gap in zip((2000, 1300, 600), gaps, strict=True):
        lens = float_groups(load_lens(path), distance_mm)
        assert gap == pytest.approx([lens.surfaces[row].thickness for row in (1, 4)])
    assert gaps[0][0] > gaps[1][0] > gaps[2][0]  # both gaps change, the one shrinks and the other grows
    assert gaps[0][1] < gaps[1][1] < gaps[2][1]


def test_lights_and_materials_change():
    keys = {"lights[0].intensity": (10, 30), "objects[0].material.reflectance": ([0.2, 0.2, 0.2], [0.2, 0.6, 1.0])}
    found = frame(keys)
    assert found.lights[0].intensity == pytest.approx((20, 20, 20))
    assert found.objects[0].material.reflectance == pytest.approx((0.2, 0.4, 0.6))
    first = make_plan(frame(keys, at=1))
    assert make_plan(found).facts == first.facts  # so that no kernel is compiled anew


def test_whole_numbers_between_whole_numbers_are_whole():
    frames = [{"time_s": 0, "value": 1}, {"time_s": 10, "value": 241}]
    sequence = FrameSequence(frames_per_second=24, keys={"render.seed": frames})
    seeds = [sequence.changes(0.0, frame)["render.seed"] for frame in range(1, 242)]
    assert seeds == list(range(1, 242))
    assert {type(seed) for seed in seeds} == {int}
