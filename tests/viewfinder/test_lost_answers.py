"""Whatever threads come late and whatever fails, every request has its answer, without another word from the page."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from rptcam_cl.core.errors import DeviceError, InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.viewfinder import messages, requests
from rptcam_cl.viewfinder.slot import Slot
from tests.viewfinder.page_client import SCENE, Page, at_rest, page, serving

WITHIN_S = 60.0


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def client(scene_file: Path) -> Iterator[Page]:
    with serving(scene_file) as (_, server), page(server) as found:
        found.frame(at_rest)
        found.ask(1, "ping")
        yield found


class Stack:
    """In place of a focus stack: it is under way until it is let go."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.begun, self.may_speak, self.may_end = threading.Event(), threading.Event(), threading.Event()
        monkeypatch.setattr(requests, "focus_stack", self)

    def __call__(self, *_: Any, **options: Any) -> Any:
        self.begun.set()
        assert self.may_speak.wait(WITHIN_S)
        options["on_picture"](2, 3, 1.0)
        while not self.may_end.wait(0.01):
            checkpoint()
        checkpoint()
        raise InputError("the stack has come to its end")


def begin_stack(client: Page, monkeypatch: pytest.MonkeyPatch) -> Stack:
    stack = Stack(monkeypatch)
    client.send("stack", id=10, near_m=0.8, far_m=1.2)
    assert stack.begun.wait(WITHIN_S)
    client.ask(11, "ping")
    time.sleep(0.3)  # until the engine sleeps
    stack.may_speak.set()
    client.wait(lambda each: each.header.get("texts") == ["focus stack, picture 2 of 3"], WITHIN_S)
    time.sleep(0.3)
    return stack


def test_thread_that_is_late_after_a_message_leaves_no_worker_waiting(
    client: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    stack = begin_stack(client, monkeypatch)
    put = messages.Inbox.put

    def put_and_rest(*request: Any) -> Any:
        older = put(*request)
        time.sleep(0.5)  # the engine has answered by then, and sleeps
        return older

    monkeypatch.setattr(messages.Inbox, "put", put_and_rest)
    assert client.ask(12, "dial", name="f_number", value="x").type == "error"
    time.sleep(0.6)
    stack.may_end.set()
    assert "come to its end" in client.wait(lambda each: each.header.get("id") == 10, WITHIN_S).header["message"]


def test_what_runs_beside_the_picture_goes_on_while_it_is_paused(client: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    stack = begin_stack(client, monkeypatch)
    client.ask(12, "pause")
    client.ask(13, "dial", name="f_number", value=5.6)
    stack.may_end.set()
    assert "come to its end" in client.wait(lambda each: each.header.get("id") == 10, WITHIN_S).header["message"]


def test_what_a_failing_device_ends_is_answered(client: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    begin_stack(client, monkeypatch)

    def fail(_: Slot) -> Any:
        raise DeviceError("the device is gone")

    with monkeypatch.context() as broken:
        broken.setattr(Slot, "glance", fail)
        client.send("dial", id=12, name="f_number", value=5.6)
        client.wait(lambda each: each.header.get("source") == "device", WITHIN_S)
    assert 10 in [each.header.get("id") for each in client.seen] or client.wait(
        lambda each: each.header.get("id") == 10, WITHIN_S
    )


def test_requests_behind_one_that_fails_are_answered(client: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    busy = threading.Event()

    def turn(_: Any, name: str, value: Any) -> Any:
        busy.set()
        time.sleep(0.5)  # meanwhile the others come, and are taken together
        if value == 4:
            raise DeviceError("the device is gone")
        raise InputError("not now")

    monkeypatch.setattr(requests, "turn_dial", turn)
    client.send("dial", id=20, name="f_number", value=8)
    assert busy.wait(WITHIN_S)
    client.send("dial", id=21, name="f_number", value=4)
    client.send("command", id=22)
    client.send("scene", id=23)
    waiting = {20, 21, 22, 23}
    end = time.monotonic() + WITHIN_S
    while waiting:
        waiting.discard(client.receive(end - time.monotonic()).header.get("id", -1))


def test_message_that_cannot_be_sent_ends_the_connection(client: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Any) -> str:
        raise TypeError("no JSON")

    with monkeypatch.context() as broken:
        broken.setattr(messages, "as_bytes", lambda header, data: fail(header))
        client.send("dial", id=30, name="f_number", value=4)
        with pytest.raises(ConnectionClosed):
            while True:
                client.receive(WITHIN_S)
