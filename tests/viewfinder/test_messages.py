"""Messages of clients: what is wrong is said, with the message's number where it has one; none names a file."""

import json

import numpy as np
import pytest

from rptcam_cl.viewfinder import messages
from rptcam_cl.viewfinder.messages import MOST_BYTES, BadMessageError, read_message


def refused(text: str) -> BadMessageError:
    with pytest.raises(BadMessageError) as caught:
        read_message(text)
    return caught.value


def test_messages_are_read() -> None:
    dial = read_message('{"type": "dial", "id": 3, "name": "f_number", "value": 4, "transient": true}')
    assert isinstance(dial, messages.Dial)
    assert (dial.id, dial.name, dial.value, dial.transient) == (3, "f_number", 4, True)
    move = read_message('{"type": "move", "kind": "orbit", "dx": 0.25}')
    assert isinstance(move, messages.Move)
    assert (move.dx, move.dy) == (0.25, 0.0)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "not JSON"),
        ("[]", "be an object"),
        ('"hello"', "be an object"),
        ("{}", "type"),
        ('{"type": "launch"}', "launch"),
        ('{"type": "ping", "more": 1}', "more"),
        ('{"type": "ping", "id": -1}', "id"),
        ('{"type": "ping", "id": "7"}', "id"),
        ('{"type": "dial", "name": "iso", "value": [1]}', "value"),
        ('{"type": "dial", "name": "../iso", "value": 1}', "name"),
        ('{"type": "move", "kind": "fly", "dx": 1}', "kind"),
        ('{"type": "move", "kind": "pan", "dx": 11}', "dx"),
        ('{"type": "focus", "x": 1.5, "y": 0}', "x"),
        ('{"type": "pointer", "x": 0.5, "y": null}', "both"),
        ('{"type": "view", "width": 9000}', "width"),
        ('{"type": "view", "overlays": {"x-ray": true}}', "overlays"),
        ('{"type": "save", "format": "png", "name": "../x"}', "name"),
        ('{"type": "save", "format": "png", "name": ".bashrc"}', "name"),
        ('{"type": "save", "format": "exe"}', "format"),
        ('{"type": "autofocus", "zones": [[0, 1, 0]]}', "zones"),
        ("[" * 5000, "not JSON"),
        ('{"type": "ping", "id": "\\ud800"}', ""),
    ],
)
def test_what_is_no_message_is_refused(text: str, reason: str) -> None:
    assert reason in str(refused(text))


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_are_not_finite_are_refused_everywhere(number: str) -> None:
    assert refused(f'{{"type": "dial", "id": 7, "name": "f_number", "value": {number}}}').id == 7
    assert refused(f'{{"type": "set", "id": 8, "changes": {{"camera.eye": [0, {number}, 0]}}}}').id == 8
    refused(f'{{"type": "move", "kind": "pan", "dx": {number}}}')


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("camera.lens", "../../etc/passwd"),
        ("camera.lens", "my_lens.yaml"),
        ("camera.lens", "C:\\lens.zmx"),
        ("camera.lens", "~root"),
        ("materials.wood.reflectance.file", "wood"),
        ("materials.wood", {"kind": "matte", "reflectance": {"kind": "image", "file": "wood"}}),
        ("objects", [{"shape": "mesh", "file": "x"}]),
        ("environment", {"kind": "image", "deep": [{"er": ["a/b"]}]}),
    ],
)
def test_no_message_names_a_file(key: str, value: object) -> None:
    for kind, more in (("set", {}), ("compare", {"mode": "side"})):
        problem = refused(json.dumps({"type": kind, "id": 5, "changes": {key: value}, **more}))
        assert problem.id == 5
        assert "file" in str(problem)


def test_values_of_a_scene_are_not_taken_for_files() -> None:
    changes = {
        "camera.lens": "dgauss-50mm", "picture.tone": "agx", "camera.eye": [0, -1.5, 2], "exposure": "auto",
        "materials.red.reflectance": [0.6, 0.05, 0.03], "film.format": "aps-c", "camera.focus": {"auto": "hybrid"},
        "camera.stop_diameter_mm": None,
    }  # fmt: skip
    message = read_message(json.dumps({"type": "set", "changes": changes}))
    assert isinstance(message, messages.Set)
    assert message.changes == changes


def test_long_messages_are_refused() -> None:
    text = json.dumps({"type": "set", "changes": {"picture.tone": "x" * MOST_BYTES}})
    assert "too long" in str(refused(text))
    many = json.dumps({"type": "set", "changes": {f"objects.{k}.radius": 1 for k in range(40)}})
    assert "32" in str(refused(many))


@pytest.mark.parametrize(
    ("shape", "shown", "size"),
    [
        ((60, 90, 3), (45, 60), (30, 45)),
        ((60, 90, 3), (90, 20), (20, 30)),
        ((60, 90, 4), (89, 60), (59, 89)),
        ((4, 400, 3), (40, 40), (1, 40)),  # a line stays a line
        ((400, 4, 3), (40, 40), (40, 1)),
    ],
)
def test_pictures_are_made_as_small_as_they_are_shown_in_their_shape(
    shape: tuple[int, ...], shown: tuple[int, int], size: tuple[int, int]
) -> None:
    codes = np.random.default_rng(2).integers(0, 256, shape, np.uint8)
    small = messages.shrink(codes, *shown)
    assert small.shape == (*size, shape[2]) and small.dtype == np.uint8
    assert small.mean(axis=(0, 1)) == pytest.approx(codes.mean(axis=(0, 1)), abs=3)
    if shape[:2] == (2 * size[0], 2 * size[1]):
        means = codes.reshape(size[0], 2, size[1], 2, -1).mean(axis=(1, 3))
        assert np.abs(small - means).max() <= 1  # rounded along rows, then along columns
    for larger in ((shape[1], shape[0]), (1000, 1000)):
        assert messages.shrink(codes, *larger) is codes
