"""Whatever is done to a valid scene, loading it ends in a scene or in an input error."""

import copy
import math
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.strict_yaml import read_yaml
from rptcam_cl.scene.load import load_scene
from rptcam_cl.scene.scene import Scene

from .conftest import EVERYTHING, SMALL

VALID = [read_yaml(EVERYTHING).data, read_yaml(SMALL).data]

ODD_VALUES = st.one_of(
    st.sampled_from([None, True, "", "red", "#123456", "1e3", 0, -1, 1, 2**31, 2**64, 10**400]),
    st.sampled_from([math.nan, math.inf, -0.0, 1e-320, 1e38]),
    st.floats(),
    st.integers(),
    st.text(max_size=8),
    st.sampled_from([[], {}, [[]], [{}], {"kind": "matte"}, {"shape": "box"}, {"": ""}, [1, 2, 3], [0, 0, 0], {1: 2}]),
)


def places(value: Any) -> list[tuple[Any, Any]]:
    """Return every (mapping or list, key) inside a value."""
    keys = list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else []
    return [(value, key) for key in keys] + [found for key in keys for found in places(value[key])]


def mutate(data: Any, draw: Any) -> None:
    """Drop, replace, nest, double or swap something at a random place."""
    spots = places(data)
    if not spots:
        return
    holder, key = draw(st.sampled_from(spots))
    match draw(st.sampled_from(["drop", "replace", "nest", "add", "swap", "scale"])):
        case "drop":
            del holder[key]
        case "replace":
            holder[key] = copy.deepcopy(draw(ODD_VALUES))
        case "nest":
            holder[key] = draw(st.sampled_from([[holder[key]], {"kind": holder[key]}, {key: holder[key]}]))
        case "add" if isinstance(holder, dict):
            name = draw(st.sampled_from(["kind", "radius", "f_number", "transform", "material", "x"]))
            holder[name] = copy.deepcopy(draw(ODD_VALUES))
        case "add":
            holder.append(copy.deepcopy(holder[key]))
        case "swap":
            other, place = draw(st.sampled_from(spots))
            if place in other if isinstance(other, dict) else place < len(other):
                holder[key] = copy.deepcopy(other[place])
        case "scale" if isinstance(holder[key], float | int):
            holder[key] = holder[key] * draw(st.sampled_from([-1, 0, 1e-9, 1e9, 1e30]))
        case _:
            pass


def assert_sound(scene: Scene) -> None:
    """Check what the renderer relies on."""
    frame = scene.camera.world_from_camera()[:3, :3]
    assert np.allclose(frame.T @ frame, np.eye(3), atol=1e-6)
    assert all(0 < side < math.inf for side in scene.film.size_m())
    for item in scene.objects:
        assert np.isfinite(np.linalg.inv(item.world_from_object)).all()
        assert not isinstance(item.material, str)
    assert len(scene.content_hash()) == 64
    assert all(isinstance(warning, str) for warning in scene.warnings)
    assert load_scene(scene.model_dump(mode="json")).content_hash() == scene.content_hash()


@settings(max_examples=80)
@given(st.data())
def test_mutated_scene_is_sound_or_refused(data: st.DataObject) -> None:
    mutant = copy.deepcopy(data.draw(st.sampled_from(VALID)))
    for _ in range(data.draw(st.integers(1, 3))):
        mutate(mutant, data.draw)
    try:
        scene = load_scene(mutant)
    except InputError as problem:
        assert str(problem)
        return
    assert_sound(scene)


@settings(max_examples=100)
@given(st.text(alphabet="{}[]:,-#&*!|>'\"%@`?<=. \t\n0123456789eabcdknil", max_size=60))
def test_any_text_is_a_scene_or_refused(text: str) -> None:
    try:
        load_scene(read_yaml(SMALL).data, [f"camera={text}"])
    except InputError as problem:
        assert str(problem)
