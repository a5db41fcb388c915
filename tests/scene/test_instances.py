"""Objects that stand in many places, which a table beside the scene holds."""

import gc
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.plan.primitives import scene_primitives
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.placement import turn_about
from rptcam_cl.studies.tier_models import VisibleWorld, depth_range_mm
from tests.support.counting import calls

CAMERA = {"kind": "pinhole", "eye": [0, 0, 9], "target": [0, 0, 0], "fov_degrees": 40}
GREY = {"kind": "matte", "reflectance": 0.5}
BALL = {"shape": "sphere", "center": [0, 0, 0], "radius": 1.0, "material": GREY}
TENT = {
    "shape": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "faces": [[0, 1, 2], [0, 3, 1]],
    "material": GREY,
}  # fmt: skip


def scene_of(folder: Path, *objects: Any, **others: Any) -> Any:
    return load_scene({"camera": CAMERA, "objects": list(objects), **others}, base_dir=folder)


def some_places(count: int) -> Any:
    rng = np.random.default_rng(5)
    places = np.zeros((count, 3, 4))
    for place in places:
        place[:, :3] = turn_about(np.array([0.6, 0, 0.8]), rng.uniform(0, 360)) @ np.diag(rng.uniform(0.1, 2, 3))
        place[:, 3] = rng.uniform(-5, 5, 3)
    return places


@pytest.mark.parametrize("item", [BALL, TENT], ids=["sphere", "mesh"])
def test_a_table_places_an_object_as_a_list_of_objects_does(tmp_path: Path, item: dict[str, Any]) -> None:
    places, first = some_places(40), {"translate": [0.5, 0, 0]}
    np.savez(tmp_path / "t.npz", matrices=places)
    one = scene_of(tmp_path, item | {"transform": first, "instances": {"file": "t.npz"}})
    listed = [item | {"transform": [first, {"matrix": place.tolist()}]} for place in places]
    many = scene_primitives(scene_of(tmp_path, *listed))
    found = scene_primitives(one)
    assert [each.kind for each in found] == [each.kind for each in many]
    for mine, other in zip(found, many, strict=True):
        np.testing.assert_allclose(mine.placement, other.placement, atol=1e-12)
    assert {each.object for each in found} == {0}


def test_positions_and_scales_and_arrays_are_tables_too(tmp_path: Path) -> None:
    positions, scales = np.arange(12.0).reshape(4, 3), np.arange(1.0, 5.0)
    np.savez(tmp_path / "t.npz", positions=positions, scales=scales)
    matrices = np.zeros((4, 3, 4))
    matrices[:, :, :3], matrices[:, :, 3] = scales[:, None, None] * np.eye(3), positions
    np.save(tmp_path / "t.npy", matrices)
    for file in ("t.npz", "t.npy", matrices):
        scene = scene_of(tmp_path, BALL | {"instances": {"file": file}})
        np.testing.assert_array_equal(scene.objects[0].places(scene.folders, 0.0)[:, :3], matrices)


def test_a_table_moves_as_one(tmp_path: Path) -> None:
    np.save(tmp_path / "t.npy", some_places(3))
    motion = [{"time_s": 0}, {"time_s": 1, "translate": [0, 2, 0]}]
    scene = scene_of(tmp_path, BALL | {"instances": {"file": "t.npy"}, "motion": motion})
    before, after = (scene.objects[0].places(scene.folders, time_s)[:, :3, 3] for time_s in (0.0, 1.0))
    np.testing.assert_allclose(after - before, np.tile([0, 2, 0], (3, 1)), atol=1e-12)


BAD = {
    "shape": ({"matrices": np.zeros((2, 3, 3))}, r"matrices have the shape \(2, 3, 3\)"),
    "scales": ({"positions": np.zeros((2, 3)), "scales": np.ones(3)}, "scales \\(3,\\)"),
    "none": ({"positions": np.zeros((0, 3))}, "has 0 places"),
    "names": ({"points": np.zeros((2, 3))}, "has neither matrices nor positions"),
    "text": ({"positions": np.array([["a", "b", "c"]])}, "holds more than numbers"),
    "flat": ({"matrices": np.array([np.eye(4)[:3], np.diag([1, 1, 0, 1])[:3]])}, "place 1 cannot be inverted"),
    "nan": ({"positions": np.array([[0, np.nan, 0]])}, "place 0 holds numbers that are not finite"),
    "far": ({"positions": np.array([[0, 0, 1e13]])}, "place 0 stretches or shifts too far"),
    "small": ({"positions": np.zeros((2, 3)), "scales": np.array([1, 1e-13])}, "place 1 stretches or shifts too far"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_tables_are_refused_by_their_place(tmp_path: Path, name: str) -> None:
    arrays, message = BAD[name]
    np.savez(tmp_path / "t.npz", **arrays)
    with pytest.raises(InputError, match=rf"objects\[0\]\.instances.*{message}"):
        scene_of(tmp_path, BALL | {"instances": {"file": "t.npz"}})


def test_what_is_no_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "t.npz").write_bytes(b"no table")
    with pytest.raises(InputError, match="is no table of NumPy"):
        scene_of(tmp_path, BALL | {"instances": {"file": "t.npz"}})
    with pytest.raises(InputError, match="no such file"):
        scene_of(tmp_path, BALL | {"instances": {"file": "none.npz"}})


def test_a_new_table_of_the_same_name_is_another_scene(tmp_path: Path) -> None:
    np.save(tmp_path / "t.npy", some_places(3))
    first = scene_of(tmp_path, BALL | {"instances": {"file": "t.npy"}}).content_hash()
    np.save(tmp_path / "t.npy", some_places(4))
    assert scene_of(tmp_path, BALL | {"instances": {"file": "t.npy"}}).content_hash() != first


def test_the_eye_in_one_of_many_places_is_warned_of(tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", positions=np.array([[0, 0, 0], [5, 0, 9], [0, 0.5, 9]]))
    assert "the camera stands inside objects[0]" in scene_of(tmp_path, BALL | {"instances": {"file": "t.npz"}}).warnings


def test_the_depths_of_many_places_are_those_of_each(tmp_path: Path) -> None:
    places = some_places(60)
    np.save(tmp_path / "t.npy", places)
    view = VisibleWorld(1.0, np.array([0.1, 0.1]), np.array([0.3, 0.2]))
    listed = [BALL | {"transform": {"matrix": place.tolist()}} for place in places]
    one, many = scene_of(tmp_path, BALL | {"instances": {"file": "t.npy"}}), scene_of(tmp_path, *listed)
    np.testing.assert_allclose(depth_range_mm(one, view), depth_range_mm(many, view), rtol=1e-9)


def test_many_places_are_not_read_one_by_one(tmp_path: Path) -> None:
    np.save(tmp_path / "t.npy", np.tile(some_places(100), (300, 1, 1)))
    assert calls(lambda: scene_of(tmp_path, BALL | {"instances": {"file": "t.npy"}})) < 15_000


@pytest.mark.parametrize("item", [BALL, TENT], ids=["sphere", "mesh"])
def test_a_place_takes_at_most_100_bytes_of_a_loaded_and_planned_scene(tmp_path: Path, item: dict[str, Any]) -> None:
    count = 60_000
    np.savez(tmp_path / "t.npz", positions=np.random.default_rng(1).uniform(-5, 5, (count, 3)), scales=np.ones(count))
    make_plan(scene_of(tmp_path, item))  # what a first plan imports and remembers does not count
    tracemalloc.start()
    plan = make_plan(scene_of(tmp_path, item | {"instances": {"file": "t.npz"}}))
    gc.collect()
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert plan.primitive_count == count
    assert kept <= 100 * count
    assert peak <= 400 * count  # the table, 96, beside blocks of 16,384 places
