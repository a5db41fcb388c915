"""Poses, film sizes, transforms and bounds in numbers."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.placement import SceneObject
from rptcam_cl.scene.quantities import cross
from rptcam_cl.scene.scene import world_corners

from .conftest import SMALL, Load


def one_object(**keys: Any) -> SceneObject:
    data = read_yaml(SMALL).data
    data["objects"] = [{"material": {"kind": "mirror"}} | keys]
    return load_scene(data).objects[0]


def test_camera_looks_along_minus_z_with_y_up(load: Load) -> None:
    matrix = load(SMALL, "camera.eye=[1, 2, 3]", "camera.target=[1, 7, 3]", "camera.up=[0, 1, 5]").camera
    world_from_camera = matrix.world_from_camera()
    assert_allclose(world_from_camera @ [0, 0, -5, 1], [1, 7, 3, 1], atol=1e-15)
    assert_allclose(world_from_camera[:3, 1], [0, 0, 1], atol=1e-15)
    assert_allclose(world_from_camera[:3, 0], [1, 0, 0], atol=1e-15)


def test_camera_frame_is_a_rotation(load: Load) -> None:
    rotation = load(SMALL, "camera.eye=[3, -2, 7]", "camera.up=[0.3, 2, -0.1]").camera.world_from_camera()[:3, :3]
    assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ({}, (0.036, 0.024)),
        ({"width_mm": 24}, (0.024, 0.016)),
        ({"size_mm": [30, 30]}, (0.03, 0.03)),
        ({"diagonal_mm": math.hypot(36, 24)}, (0.036, 0.024)),
    ],
)
def test_film_size_follows_from_the_key_given(keys: dict[str, Any], expected: tuple[float, float]) -> None:
    film = Film.model_validate({"resolution": [300, 200]} | keys)
    assert film.size_m() == pytest.approx(expected)
    assert film.diagonal_m() == pytest.approx(math.hypot(*expected))


def test_steps_apply_in_their_order() -> None:
    steps = [{"scale": 2}, {"rotate": {"axis": [0, 0, 3], "degrees": 90}}, {"translate": [10, 0, 0]}]
    item = one_object(shape="box", min=[0, 0, 0], max=[1, 1, 1], transform=steps)
    assert_allclose(item.world_from_object @ [1, 0, 0, 1], [10, 2, 0, 1], atol=1e-15)


def test_rotation_is_counter_clockwise_about_any_axis() -> None:
    item = one_object(
        shape="sphere", center=[0, 0, 0], radius=1, transform={"rotate": {"axis": [1, 1, 1], "degrees": 120}}
    )
    assert_allclose(item.world_from_object[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)


@pytest.mark.parametrize("rows", [3, 4])
def test_matrix_is_given_by_rows(rows: int) -> None:
    matrix = [[1, 2, 0, 5], [0, 1, 0, 6], [0, 0, 3, 7], [0, 0, 0, 1]]
    item = one_object(shape="sphere", center=[0, 0, 0], radius=1, transform={"matrix": matrix[:rows]})
    assert_allclose(item.world_from_object, matrix)


def test_reflection_is_allowed() -> None:
    item = one_object(shape="sphere", center=[0, 0, 0], radius=1, transform={"scale": [1, -1, 1]})
    assert np.linalg.det(item.world_from_object) == pytest.approx(-1)


BOUNDED = [
    ({"shape": "sphere", "center": [1, 2, 3], "radius": 2}, [-1, 0, 1], [3, 4, 5]),
    ({"shape": "disk", "center": [1, 0, 0], "normal": [0, 0, 2], "radius": 3}, [-2, -3, 0], [4, 3, 0]),
    ({"shape": "rectangle", "corner": [0, 0, 1], "edge_u": [2, 0, 0], "edge_v": [1, -1, 0]}, [0, -1, 1], [3, 0, 1]),
    ({"shape": "box", "min": [0, 1, 2], "max": [3, 4, 5]}, [0, 1, 2], [3, 4, 5]),
    ({"shape": "cylinder", "base": [0, 0, 0], "top": [0, 0, 4], "radius": 1}, [-1, -1, 0], [1, 1, 4]),
    ({"shape": "cone", "base": [0, 0, 0], "apex": [0, 4, 0], "radius": 1}, [-1, 0, -1], [1, 4, 1]),
]


@pytest.mark.parametrize(("keys", "low", "high"), BOUNDED, ids=[str(row[0]["shape"]) for row in BOUNDED])
def test_bounds_enclose_the_shape(keys: dict[str, Any], low: list[float], high: list[float]) -> None:
    item = one_object(**keys, transform={"translate": [10, 0, 0]})
    assert isinstance(item, SceneObject)
    assert_allclose(item.bounds(), (low, high), atol=1e-12)
    assert_allclose(world_corners(item, item)[0].min(axis=0), np.add(low, [10, 0, 0]), atol=1e-12)


@pytest.mark.parametrize(
    ("keys", "inside", "outside"),
    [
        ({"shape": "sphere", "center": [1, 0, 0], "radius": 1}, [1.9, 0, 0], [2.1, 0, 0]),
        ({"shape": "box", "min": [0, 0, 0], "max": [1, 1, 1]}, [0.5, 0.9, 0.1], [0.5, 1.1, 0.1]),
        ({"shape": "cylinder", "base": [0, 0, 0], "top": [0, 0, 2], "radius": 1}, [0.9, 0, 1.9], [0.9, 0, 2.1]),
        ({"shape": "cone", "base": [0, 0, 0], "apex": [0, 0, 2], "radius": 1}, [0.4, 0, 1], [0.6, 0, 1]),
    ],
)
def test_solid_contains_what_is_inside(keys: dict[str, Any], inside: list[float], outside: list[float]) -> None:
    item = one_object(**keys)
    assert isinstance(item, SceneObject)
    assert item.contains(np.array(inside))
    assert not item.contains(np.array(outside))


def test_the_cross_product_is_that_of_numpy_bit_by_bit() -> None:
    random = np.random.default_rng(5)
    for scale in (1e-8, 1.0, 1e12):
        for a, b in random.normal(size=(200, 2, 3)) * scale:
            assert np.array_equal(cross(a, b), np.cross(a, b))
    assert np.array_equal(cross([1, 0, 0], (0, 1, 0)), [0, 0, 1])
