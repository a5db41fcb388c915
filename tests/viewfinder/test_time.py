"""Frames are shown as they are rendered; keys are set and deleted; what a hand turns while they play is recorded."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

import rptcam_cl
from rptcam_cl.cli import main
from tests.support.cases import slow
from tests.viewfinder.page_client import SCENE, Page, at_rest, page, reset_page, serving, serving_text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scene")


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Any]:
    with serving_text(folder) as server:
        yield server


@pytest.fixture
def client(server: Any) -> Iterator[Page]:
    with reset_page(server) as found:
        yield found


def saved(client: Page, number: int) -> dict[str, Any]:
    """The scene as it is saved."""
    data: dict[str, Any] = yaml.safe_load(client.ask(number, "scene").header["yaml"])
    return data


def pulled(scene: dict[str, Any], path: str = "camera.focus.distance_m") -> list[tuple[float, float]]:
    return [(24 * key["time_s"] + 1, key["value"]) for key in scene["sequence"]["keys"][path]]


def shown(client: Page, number: int) -> np.ndarray[Any, Any]:
    """The picture of the state that is shown, with all samples."""
    client.ask(number, "set", changes={"picture.ev": 0.0})
    client.frame(lambda header: at_rest(header) and not header["stale"])
    return np.array(Image.open(io.BytesIO(client.ask(number + 1, "save", format="png", name="a").data)))


def rendered(scene: dict[str, Any], folder: Path, frame: int) -> np.ndarray[Any, Any]:
    file, out = folder / "pull.yaml", folder / "pull.####.png"
    file.write_text(yaml.safe_dump(scene))
    assert main(["render", str(file), "--frames", str(frame), "-o", str(out), "--quiet"]) == 0
    return np.array(Image.open(folder / f"pull.{frame:04}.png"))


def test_a_recorded_pull_is_rendered_by_frames_with_the_bits_that_were_shown(client: Page, folder: Path) -> None:
    client.ask(10, "time", do="record", on=True)
    client.ask(11, "time", do="go", frame=5, playing=True, transient=True)
    for number, (frame, metres) in enumerate(((5, 0.9), (7, 1.2), (10, 1.6))):
        client.ask(20 + 2 * number, "time", do="go", frame=frame, playing=True, transient=True)
        client.ask(21 + 2 * number, "dial", name="focus_m", value=metres, transient=True)
    client.ask(30, "time", do="go", frame=14, playing=True, transient=True)  # held still
    client.ask(31, "dial", name="focus_m", value=1.6)  # let go of
    client.ask(32, "time", do="go", frame=20, playing=True, transient=True)
    client.ask(33, "time", do="go", frame=8)
    scene = saved(client, 34)
    wanted = [(4, 0.95), (5, 0.9), (7, 1.2), (10, 1.6), (14, 1.6)]
    assert np.array(pulled(scene)) == pytest.approx(np.array(wanted))
    assert rptcam_cl.load_scene(scene).camera.focus.distance_m == pytest.approx(0.95)
    for number, frame in enumerate((8, 12)):
        client.ask(40 + 10 * number, "time", do="go", frame=frame)
        assert np.array_equal(shown(client, 41 + 10 * number), rendered(scene, folder, frame))


def test_keys_are_set_deleted_and_undone(client: Page) -> None:
    client.ask(10, "time", do="key", channel="f_number")
    first = saved(client, 11)
    client.ask(12, "time", do="go", frame=25)
    client.ask(13, "time", do="record", on=True)
    client.ask(14, "dial", name="f_number", value=8.0)
    client.ask(15, "dial", name="focus_m", value=1.5)
    both = saved(client, 16)
    assert [frame for frame, _ in pulled(both, "camera.f_number")] == [1, 25]
    assert pulled(both, "camera.f_number")[1][1] == 8
    assert pulled(both) == [(1, pytest.approx(0.95)), (25, 1.5)]  # it goes there from where it stood
    client.ask(17, "time", do="unkey", channel="f_number")
    assert len(pulled(saved(client, 18), "camera.f_number")) == 1
    client.ask(19, "history", do="undo")
    assert saved(client, 20) == both
    client.ask(21, "time", do="clear", channel="focus")
    assert "camera.focus.distance_m" not in saved(client, 22)["sequence"]["keys"]
    for number in range(23, 26):
        client.ask(number, "history", do="undo")
    assert saved(client, 26) == first


def test_without_recording_a_dial_carries_all_keys_along(client: Page) -> None:
    client.ask(10, "time", do="rack", from_m=0.8, to_m=1.6, seconds=1.0)
    client.ask(11, "time", do="go", frame=25)
    client.ask(12, "dial", name="focus_m", value=3.2)
    keys = pulled(saved(client, 13))
    assert keys[0][1] == pytest.approx(1.6)
    assert keys[-1] == pytest.approx((25, 3.2))


def test_a_pull_between_marks_eases_and_is_even_in_one_over_distance(client: Page) -> None:
    client.ask(10, "time", do="go", frame=3)
    client.ask(11, "time", do="rack", from_m=1.0, to_m=2.0, seconds=0.5)
    keys = pulled(saved(client, 12))
    assert [frame for frame, _ in keys] == pytest.approx(range(3, 16))
    shares = np.linspace(0, 1, 13)
    wanted = 1 / (1 + (3 * shares**2 - 2 * shares**3) * (1 / 2 - 1))
    assert [value for _, value in keys] == pytest.approx(wanted)


def test_a_camera_with_keyframes_is_moved_in_the_frame_that_is_shown(client: Page) -> None:
    motion = [{"time_s": 0}, {"time_s": 1, "target": [0.2, 0, 0]}]
    client.ask(10, "set", changes={"camera.motion": motion})
    client.ask(11, "time", do="go", frame=13)
    client.ask(12, "move", kind="orbit", dx=0.25)  # 45 degrees about what it looks at
    moved = rptcam_cl.load_scene(saved(client, 13)).camera
    eye, target, _ = moved.pose_at(0.5)
    assert target == pytest.approx([0.1, 0, 0])
    assert np.hypot(*(eye - target)[[0, 2]]) == pytest.approx(np.hypot(0.1, 1))
    assert moved.pose_at(1)[1] == pytest.approx([0.2, 0, 0])  # the target's way is as it was
    client.ask(14, "history", do="undo")
    client.ask(15, "time", do="record", on=True)
    client.ask(16, "move", kind="pan", dx=0.1)
    keyed = rptcam_cl.load_scene(saved(client, 17)).camera
    assert [frame.time_s for frame in keyed.motion] == [0, 0.5, 1]
    assert keyed.pose_at(1) == pytest.approx(np.array([[0, 0, 1], [0.2, 0, 0], [0, 1, 0]]))


def test_a_key_of_the_exposure_stays_when_another_of_its_dials_is_turned(client: Page) -> None:
    client.ask(10, "dial", name="mode", value="M")
    client.ask(11, "time", do="record", on=True)
    client.ask(12, "dial", name="iso", value=400.0)
    assert set(saved(client, 13)["sequence"]["keys"]) == {"exposure.iso"}  # what is turned, and nothing beside it
    client.ask(14, "time", do="go", frame=25)
    client.ask(15, "dial", name="iso", value=800.0)
    client.ask(16, "dial", name="ev", value=1.0)
    client.ask(17, "time", do="record", on=False)
    client.ask(18, "dial", name="ev", value=2.0)
    scene = saved(client, 19)
    assert pulled(scene, "exposure.iso") == [(1, 400), (25, 800)]
    assert pulled(scene, "exposure.ev") == [(1, 1), (25, 2)]


@pytest.mark.slow
def test_a_click_focuses_by_a_key_where_the_focus_has_keys(client: Page) -> None:
    client.ask(10, "time", do="rack", from_m=0.8, to_m=1.6, seconds=1.0)
    client.ask(11, "time", do="go", frame=13)
    client.ask(12, "time", do="record", on=True)
    found = client.ask(13, "focus", x=0.5, y=0.5).header
    keys = dict(pulled(saved(client, 14)))
    assert keys[13] == pytest.approx(found["distance_m"], rel=1e-6)
    assert keys[25] == pytest.approx(1.6)


def test_a_sequence_of_the_file_opens_as_it_stands_and_is_shown_frame_by_frame(folder: Path) -> None:
    file, keys = folder / "keyed.yaml", [{"time_s": 0, "value": 4}, {"time_s": 1, "value": 8}]
    file.write_text(SCENE + yaml.safe_dump({"sequence": {"keys": {"camera.f_number": keys}}}))
    with serving(file) as (_, server), page(server) as client:
        told = client.wait(lambda m: m.type == "state").header
        assert told["time"]["frame"] == 0
        assert next(dial["value"] for dial in told["dials"] if dial["name"] == "f_number") < 3  # wide open, as it says
        assert saved(client, 10) == yaml.safe_load(file.read_text())
        client.ask(11, "time", do="go", frame=13)
        client.frame(at_rest)
        assert np.array_equal(shown(client, 12), rendered(yaml.safe_load(file.read_text()), folder, 13))


COMING = [{"time_s": 0, "translate": [0, 0, -2]}, {"time_s": 1, "translate": [0, 0, 0]}]


@pytest.mark.slow
@pytest.mark.parametrize("continuous", [True, slow(False)])
def test_each_frame_has_the_focus_that_frames_find_for_it(folder: Path, continuous: bool) -> None:
    scene = yaml.safe_load(SCENE)
    scene["camera"]["focus"] = {"auto": {"method": "depth"}}
    scene["objects"][0]["motion"] = COMING
    scene["sequence"] = {"frames_per_second": 12} | ({"continuous_focus": {}} if continuous else {})
    file = folder / "coming.yaml"
    file.write_text(yaml.safe_dump(scene))
    with serving(file) as (_, server), page(server) as client:
        for number, frame in ((10, 11), (20, 5)):
            client.ask(number, "time", do="go", frame=frame)
            words = f"Focus of frame {frame}: "
            client.wait(lambda m: m.type == "state" and any(words in each for each in m.header["messages"]))  # noqa: B023
            assert np.array_equal(shown(client, number + 1), rendered(scene, folder, frame))
        assert saved(client, 30)["camera"]["focus"] == scene["camera"]["focus"]
        assert saved(client, 31)["sequence"] == scene["sequence"]
        client.ask(40, "set", changes={"camera.focus.distance_m": 2.0})  # by hand it stays
        client.ask(41, "time", do="go", frame=11)
        scene["camera"]["focus"] = {"distance_m": 2.0}
        assert np.array_equal(shown(client, 42), rendered(scene, folder, 11))


def test_frames_and_keys_are_said(client: Page) -> None:
    client.ask(10, "time", do="rack", from_m=1.0, to_m=2.0, seconds=0.125)
    client.send("time", id=11, do="go", frame=2)
    told = client.wait(lambda m: m.type == "state" and m.header["time"]["frame"] == 2).header["time"]
    assert told["channels"][1] == {"name": "focus", "label": "Focus", "keys": [1, 2, 3, 4]}
    assert (told["frames"], told["frames_per_second"], told["record"]) == (97, 24, False)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"do": "go"}, "go takes frame"),
        ({"do": "go", "frame": 0}, "greater than or equal to 1"),
        ({"do": "unkey", "channel": "zoom"}, "Zoom: has no keys to delete"),
        ({"do": "unkey", "channel": "camera"}, "Camera: has no key in this frame"),
        ({"do": "rack", "from_m": 1.0, "to_m": -1.0, "seconds": 1.0}, "greater than 0"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(client: Page, keys: dict[str, Any], words: str) -> None:
    answer = client.ask(10, "time", **keys)
    assert answer.type == "error"
    assert words in answer.header["message"]
    assert "\n" not in answer.header["message"]


@pytest.mark.slow
def test_things_that_move_and_a_camera_that_was_orbited_are_shown_as_frames_are_rendered(
    checkout: Path, folder: Path
) -> None:
    data = yaml.safe_load((checkout / "examples" / "panning.yaml").read_text("utf-8"))
    data["film"]["resolution"], data["render"]["spp"] = [48, 32], 8
    file = folder / "panning.yaml"
    file.write_text(yaml.safe_dump(data))
    with serving(file) as (_, server), page(server) as client:
        client.frame(at_rest)
        client.ask(10, "move", kind="orbit", dx=0.1)
        for number, frame in enumerate((5, 12)):
            client.ask(20 + 10 * number, "time", do="go", frame=frame)
            picture = shown(client, 21 + 10 * number)
            assert np.array_equal(picture, rendered(saved(client, 25 + 10 * number), folder, frame))
