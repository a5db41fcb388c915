"""How long the shutter is open: numbers, and fractions as cameras have them."""

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.changes import at_opening, exposure_steps
from rptcam_cl.scene.load import load_scene

from .conftest import SMALL, Load


@pytest.mark.parametrize(
    ("text", "seconds"), [("0.02", 0.02), ("1/125", 1 / 125), ('"1 / 8000"', 1 / 8000), ("2.5/10", 0.25), ("30", 30.0)]
)
def test_time_is_a_number_or_a_fraction(load: Load, text: str, seconds: float) -> None:
    assert load(f"{SMALL}shutter: {{time_s: {text}}}\n").shutter.time_s == seconds
    assert load(SMALL, f"shutter.time_s={text}").shutter.time_s == seconds


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1/0", "time_s: divides by zero (got '1/0'"),
        ("0", "time_s: is out of range (got 0; allowed: at least 1e-09)"),
        ("-1/60", "time_s: is neither a number nor a fraction"),
        ("1/60 s", "time_s: is neither a number nor a fraction"),
        ("true", "time_s: must be a number"),
        ("1/99999999999", "time_s: is neither a number nor a fraction"),
    ],
)
def test_other_times_are_refused(load: Load, text: str, message: str) -> None:
    with pytest.raises(InputError, match=r"scene\.yaml:\d+:\d+: shutter\.") as caught:
        load(f"{SMALL}shutter: {{time_s: {text}}}\n")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


LENS = {"kind": "realistic", "lens": "dgauss-50mm", "eye": [0, 0, 0], "target": [0, 0, -1], "focus": {"distance_m": 2}}
PULL = {"camera.focus.distance_m": [{"time_s": 0, "value": 2}, {"time_s": 1, "value": 4}]}


def scene(keys=PULL, shutter=None, **parts):
    given = {"camera": LENS, "environment": {"kind": "constant", "radiance": 1}} | parts
    return load_scene(given | {"shutter": {"time_s": 0.5, "keys": keys} | (shutter or {})})


def test_steps_hold_the_values_of_their_middles():
    found = exposure_steps(scene(shutter={"steps": 2, "open_s": 0.5}))
    assert [step.camera.focus.distance_m for step in found] == [3.25, 3.75]
    assert [(step.shutter.open_s, step.shutter.time_s) for step in found] == [(0.5, 0.25), (0.75, 0.25)]
    assert all(not step.shutter.keys for step in found)
    assert at_opening(scene()).camera.focus.distance_m == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"keys": {"film.resolution": PULL["camera.focus.distance_m"]}}, "is no key that moves while the shutter is"),
        ({"keys": {"camera.lens": [{"time_s": 0, "value": "tessar-100mm"}]}}, "does not go evenly"),
        ({"keys": {"camera.eye": [{"time_s": 0, "value": [0, 0, 0]}, {"time_s": 1, "value": 2}]}}, "does not go even"),
        ({"keys": {"camera.f_number": [{"time_s": 1, "value": 2}, {"time_s": 0, "value": 4}]}}, "does not come after"),
        ({"shutter": {"kind": "rolling", "readout_s": 0.1}}, "exposes each row at its own time"),
        ({"shutter": {"steps": 1}}, "shutter.steps: is out of range (got 1; allowed: at least 2"),
        ({"keys": {}, "shutter": {"steps": 8}}, "cuts the exposure for keys"),
        ({"render": {"caustics": "on"}}, "render.caustics: does not go with keys"),
        ({"render": {"layers": ["position"]}}, "render.layers: does not go with keys"),
        ({"camera": LENS | {"diffraction": "auto"}}, "camera.diffraction: does not go with keys"),
        ({"camera": LENS | {"accuracy": "auto"}}, "camera.accuracy: does not go with keys"),
        ({"sequence": {"keys": PULL}}, "sequence.keys.camera.focus.distance_m: moves by shutter.keys already"),
        ({"camera": LENS | {"precision": "double"}}, "camera.precision: does not go with keys"),
    ],
)
def test_mistake_is_named(change, message):
    with pytest.raises(InputError) as caught:
        scene(**change)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"camera.focus.distance": PULL["camera.focus.distance_m"]}, "unknown key"),
        ({"lights.0.intensity": [{"time_s": 0, "value": 1}]}, "lights: must be a list"),
        ({"camera.f_number": [{"time_s": 0, "value": 2}, {"time_s": 1, "value": -8}]}, "is out of range"),
    ],
)
def test_key_that_leads_nowhere_or_too_far_is_named_with_its_moment(keys, message):
    with pytest.raises(InputError, match=r"^shutter\.keys: at [\d.]+ s: ") as caught:
        exposure_steps(scene(keys))
    assert message in str(caught.value)
