"""A scene whose camera finds no focus or no light by itself is shown by hand, so that there is a picture to aim by."""

import json
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl.api.session import RenderSession
from rptcam_cl.device.devices import CompileServer, choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.messages import Client
from rptcam_cl.viewfinder.server import ViewServer
from rptcam_cl.viewfinder.studio import open_session
from tests.support.cases import slow
from tests.viewfinder.page_client import ALIVE_WITHIN_S, SCENE, at_rest, page, serving

EVEN = SCENE.replace("[0.7, 0.6, 0.5]", "0").replace("environment: {kind: constant, radiance: [0.4, 0.5, 0.6]}", "")
BLIND = EVEN.replace("focus: {distance_m: 0.95}", "focus: {auto: contrast}")
DARK = EVEN + "exposure: auto\n"


@pytest.mark.parametrize(
    ("text", "by_hand"),
    [
        slow(BLIND, {"camera.focus.distance_m": 1.0}),
        (DARK, {"exposure": "relative"}),
        slow(BLIND + "exposure: auto\n", {"camera.focus.distance_m": 1.0, "exposure": "relative"}),
        (SCENE, {}),
    ],
    ids=["no contrast", "no light", "neither", "both"],
)
def test_what_the_camera_does_not_find_is_set_by_hand(tmp_path: Path, text: str, by_hand: dict[str, object]) -> None:
    path = tmp_path / "even.yaml"
    path.write_text(text)
    scene = load_scene(path)
    session, found, problem = open_session(scene, None)
    with session:
        assert found == by_hand
        assert (problem is None) == (not by_hand)
        assert session.scene.made_of == set_keys(scene, by_hand).made_of


def test_blind_scene_is_shown_with_its_error_and_focused_again_once_it_is_mended(tmp_path: Path) -> None:
    path = tmp_path / "even.yaml"
    path.write_text(BLIND)
    with serving(path) as (_, server), page(server) as client:
        error = client.wait(lambda message: message.type == "error").header
        assert error["source"] == "scene" and error["message"].startswith("camera.focus.auto: ")
        client.frame()
        assert client.ask(1, "reset", what="camera").type == "done"
        assert "distance_m: 1" in client.ask(2, "scene").header["yaml"]
        path.write_text(SCENE)
        client.wait(lambda message: message.type == "notice" and message.header["kind"] == "watch")
        assert "distance_m: 0.95" in client.ask(3, "scene").header["yaml"]


@pytest.mark.parametrize(("text", "by_hand"), [slow(BLIND, "distance_m: 1"), (DARK, "exposure: relative")])
def test_scene_that_stays_blind_is_shown_as_it_is_edited(tmp_path: Path, text: str, by_hand: str) -> None:
    path = tmp_path / "even.yaml"
    path.write_text(text)
    with serving(path) as (_, server), page(server) as client:
        before = client.ask(1, "scene").header["yaml"]
        path.write_text(text.replace("radius: 0.15", "radius: 0.25"))
        client.wait(lambda message: message.type == "notice" and message.header["kind"] == "watch")
        after = client.ask(2, "scene").header["yaml"]
        assert by_hand in before and by_hand in after
        assert "radius: 0.15" in before and "radius: 0.25" in after


LAMP = "lights: [{kind: point, position: [1, 1, 1], intensity: 5}]"
NIGHT = SCENE.replace("environment: {kind: constant, radiance: [0.4, 0.5, 0.6]}", LAMP)


@pytest.mark.slow
@pytest.mark.parametrize("automatic", [True, False])
def test_camera_may_be_turned_into_the_dark_and_back(tmp_path: Path, automatic: bool) -> None:
    path = tmp_path / "night.yaml"
    path.write_text(NIGHT)
    with serving(path) as (_, server), page(server) as client:
        client.ask(1, "dial", name="mode", value="M")
        client.ask(2, "dial", name="auto_iso", value=automatic)
        client.ask(3, "move", kind="tilt", dx=0, dy=1)
        client.wait(lambda message: message.type == ("error" if automatic else "frame"))
        assert client.ask(4, "move", kind="tilt", dx=0, dy=-1).type == "done"
        client.frame(at_rest)
        wrong = [message.header["message"] for message in client.seen if message.type == "error"]
        assert all("finds no light" in text for text in wrong)


def test_reset_goes_back_to_the_last_good_scene_and_the_error_of_the_file_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, tried = tmp_path / "ball.yaml", []
    path.write_text(SCENE)
    replace = RenderSession.replace

    def counted(session: RenderSession, *given: Any, **options: Any) -> Any:
        tried.append(given)
        return replace(session, *given, **options)

    monkeypatch.setattr(RenderSession, "replace", counted)
    with serving(path) as (_, server), page(server) as client:
        client.frame()
        path.write_text(BLIND)
        client.wait(lambda message: message.type == "error")
        assert len(tried) == 1  # autofocus takes seconds, and fails as it did
        assert client.ask(1, "reset", what="all").type == "done"
        assert "distance_m: 0.95" in client.ask(2, "scene").header["yaml"]
        with page(server) as later:
            assert later.wait(lambda message: message.type == "error").header["source"] == "scene"


def test_device_is_free_once_a_viewfinder_is_closed_though_a_page_looks(tmp_path: Path) -> None:
    path = tmp_path / "ball.yaml"
    path.write_text(SCENE)
    finder = Viewfinder(path)
    server = ViewServer(finder)
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    try:
        with page(server) as client:
            client.frame()
            assert finder.holds_device
            assert finder.close(60.0)
            assert not finder.holds_device
    finally:
        server.stop()
        thread.join(10)


@pytest.fixture
def finder() -> Iterator[Viewfinder]:
    with Viewfinder(yaml.safe_load(SCENE)) as found:
        yield found


def messages(client: Client) -> Iterator[dict[str, Any]]:
    """Yield what a client is sent, frames by their headers; all of them are acknowledged."""
    end = time.monotonic() + ALIVE_WITHIN_S
    while time.monotonic() < end:
        for message in client.outbox.take():
            if isinstance(message, str):
                yield json.loads(message)
            else:
                (length,) = struct.unpack("<I", message[:4])
                header = json.loads(message[4 : 4 + length])
                client.outbox.acknowledge(header["frame"])
                yield header
        time.sleep(0.005)
    raise AssertionError("no such message came")


def test_who_comes_after_the_first_picture_gets_it_before_a_finer_one_is_begun(finder: Viewfinder) -> None:
    end = time.monotonic() + ALIVE_WITHIN_S
    while (finder._studio.a is None or finder._studio.a.shown is None) and time.monotonic() < end:
        time.sleep(0.005)
    found = next(each for each in messages(finder.connect(lambda: None)) if each["type"] == "frame")
    assert (found["scale"], found["spp"]) == (0.5, 1)


def test_while_the_kernels_of_the_film_compile_the_page_says_so_and_dials_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, compiled = Session(choose_device()), threading.Event()
    if not device.generates_late or device.lanes == 1:
        pytest.skip("the driver compiles all of a program when it is built, or has but narrow kernels")
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))  # where no note of kernels is
    monkeypatch.setattr(CompileServer, "compile", lambda self, wanted: compiled.wait(ALIVE_WITHIN_S))
    with Viewfinder(yaml.safe_load(SCENE), device=device) as finder:  # type: ignore[arg-type]
        client = finder.connect(lambda: None)
        heard = messages(client)
        busy = next(each for each in heard if each["type"] == "compiling")
        assert busy["busy"] and busy["text"].endswith("until then the picture stays as it is")
        finder.receive(client, '{"type": "dial", "id": 7, "name": "f_number", "value": 8}')
        turned = next(each for each in heard if each["type"] == "frame" and each["answers"] == 7)
        assert turned["spp"] == 1 and not turned["stale"]
        compiled.set()
        assert not next(each for each in heard if each["type"] == "compiling")["busy"]
        assert next(each for each in heard if each["type"] == "frame" and each["spp"] > 1)["scale"] == 1
