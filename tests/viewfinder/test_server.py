"""The server as a page meets it: one server, a plain WebSocket client."""

import http.client
import io
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from rptcam_cl.api import render
from rptcam_cl.imaging import read_film
from rptcam_cl.scene import load_scene
from rptcam_cl.viewfinder import Viewfinder, ViewServer
from tests.viewfinder.page_client import SCENE, Page, left_alone, opened, page, serving

Served = tuple[Viewfinder, ViewServer, Path]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    path = tmp_path_factory.mktemp("scene") / "ball.yaml"
    path.write_text(SCENE)
    with serving(path) as (finder, server):
        yield finder, server, path


@pytest.fixture
def client(served: Served) -> Iterator[Page]:
    with page(served[1]) as found:
        found.ask(1, "reset")
        yield found


def at_rest(header: dict[str, Any]) -> bool:
    return bool(header["kind"] == "picture" and header["spp"] == 8 and header["scale"] == 1)


def test_page_is_greeted_and_gets_a_picture_that_becomes_finer(served: Served) -> None:
    with page(served[1]) as client:
        hello = client.seen[-1].header
        assert hello["scene"] == "ball.yaml"
        assert hello["size"] == [48, 32]
        assert {"f_number", "lens", "focus_m"} <= {dial["name"] for dial in hello["dials"]}
        assert len(hello["lenses"]) >= 42
        assert "token" not in hello
        last = client.frame(at_rest)
        assert Pillow.open(io.BytesIO(last.data)).size == (48, 32)
        frames = [message.header for message in client.seen if message.type == "frame"]
        assert frames[0]["scale"] <= 1
        assert [frame["frame"] for frame in frames] == list(range(1, len(frames) + 1))
        for frame in frames:
            assert {"scale", "spp", "ms", "noise", "generation", "answers"} <= frame.keys()


def test_one_time_token_is_exchanged_for_the_lasting_one(served: Served) -> None:
    server = served[1]
    with page(server, server.tokens.once) as client:
        assert client.seen[-1].header["token"] == server.tokens.lasting
    assert closing_code(server, json.dumps({"type": "hello", "token": server.tokens.once, "version": 1})) == 4401


def test_hundred_dials_in_a_second_leave_the_last_and_no_backlog(client: Page) -> None:
    client.frame(at_rest)
    begun = time.monotonic()
    for step in range(100):
        client.send("dial", id=100 + step, name="f_number", value=2.2 + 0.1 * step, transient=True)
        time.sleep(0.009)
    frame = client.frame(lambda header: header["answers"] == 199)
    behind = time.monotonic() - begun
    final = client.wait(lambda message: message.type == "state" or message.type == "frame")
    assert behind < 10, "seconds for what takes one, on a busy machine"
    answered = {message.header.get("id") for message in client.seen}
    assert set(range(100, 200)) <= answered
    assert frame.header["generation"] >= 1
    assert final is not None
    command = client.ask(300, "command").header["text"]
    assert "camera.f_number=12.1" in command


def test_client_that_acknowledges_nothing_gets_two_frames_and_then_the_newest(client: Page) -> None:
    client.frame(at_rest)
    client.acknowledges = False
    numbers = []
    for step in range(6):
        client.ask(10 + step, "dial", name="f_number", value=2.2 + step)
        time.sleep(0.1)
    client.send("ping", id=50)
    while (message := client.receive()).header.get("id") != 50:
        numbers += [message.header] if message.type == "frame" else []
    waiting = [message.header for message in client.seen if message.type == "frame" and message.header["answers"]]
    assert len(waiting) == 2
    client.acknowledges = True
    client.send("ack", frame=waiting[0]["frame"])
    assert client.frame().header["answers"] == 15


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("{", None),
        ('{"type": "dial", "id": 5, "name": "f_number", "value": NaN}', 5),
        ('{"type": "dial", "id": 6, "name": "lens", "value": "no-such-lens"}', 6),
        ('{"type": "dial", "id": 7, "name": "no_such_dial", "value": 1}', 7),
        ('{"type": "dial", "id": 8, "name": "f_number", "value": "wide"}', 8),
        ('{"type": "set", "id": 9, "changes": {"camera.lens": "../../../etc/passwd"}}', 9),
        ('{"type": "set", "id": 10, "changes": {"camera.f_number": -3}}', 10),
        ('{"type": "set", "id": 11, "changes": {"camera.no_such_key": 1}}', 11),
        ('{"type": "save", "id": 12, "format": "png", "name": "/tmp/x"}', 12),
        ('{"type": "save", "id": 13, "format": "dng", "name": "raw"}', 13),
        ('{"type": "scene", "id": 14, "slot": "B"}', 14),
        ('{"type": "compare", "id": 15, "mode": "side", "changes": {"camera.f_number": "x"}}', 15),
        ('{"type": "autofocus", "id": 16, "method": "magic"}', 16),
    ],
)
def test_what_is_wrong_is_answered_and_the_server_lives(client: Page, text: str, number: int | None) -> None:
    before = client.ask(90, "scene").header["yaml"]
    client.socket.send(text)
    error = client.wait(lambda message: message.type == "error")
    assert error.header["id"] == number
    assert error.header["message"]
    assert client.ask(91, "scene").header["yaml"] == before, "nothing has changed"


def test_moves_change_the_camera_and_reset_brings_it_back(client: Page) -> None:
    before = client.ask(5, "scene").header["yaml"]
    for number, kind in enumerate(("orbit", "pan", "dolly", "walk", "tilt", "roll", "zoom")):
        assert client.ask(10 + number, "move", kind=kind, dx=0.1, dy=0.1, dz=0.1).type == "done"
    client.frame(lambda header: header["answers"] == 16)
    assert client.ask(20, "scene").header["yaml"] != before
    client.ask(21, "reset", what="all")
    assert client.ask(22, "scene").header["yaml"] == before


def test_saved_scene_renders_to_the_same_bits(client: Page, tmp_path: Path) -> None:
    client.ask(5, "dial", name="f_number", value=5.6)
    client.ask(6, "move", kind="orbit", dx=0.05)
    client.frame(lambda header: at_rest(header) and header["answers"] == 6)
    saved = client.ask(7, "save", format="exr", name="shot")
    assert saved.header["name"] == "shot.exr"
    (tmp_path / "shot.exr").write_bytes(saved.data)
    (tmp_path / "shown.yaml").write_text(client.ask(8, "scene").header["yaml"])
    image = render(tmp_path / "shown.yaml", spp=8)
    assert np.array_equal(read_film(tmp_path / "shot.exr").pixels, image.pixels)


def test_pictures_are_saved_as_they_are_shown(client: Page) -> None:
    client.frame(at_rest)
    client.ask(4, "view", format="png", overlays={"zebra": True}, zebra_level=0.0)
    shown = client.frame(lambda header: at_rest(header) and header["media"] == "image/png")
    png = client.ask(5, "save", format="png", name="a.png")
    assert png.header["name"] == "a.png"
    pixels = [np.asarray(Pillow.open(io.BytesIO(data))) for data in (shown.data, png.data)]
    assert np.array_equal(*pixels), "and no zebra is burnt in"
    jpeg = client.ask(6, "save", format="jpeg", name="a")
    assert jpeg.header["name"] == "a.jpg"
    rough = np.asarray(Pillow.open(io.BytesIO(jpeg.data)), np.float64)
    assert np.abs(rough - pixels[1][..., :3]).mean() < 8


def test_two_settings_are_compared_with_their_difference(client: Page) -> None:
    client.frame(at_rest)
    client.ask(5, "compare", mode="side", changes={"camera.f_number": 11}, difference=True)
    second = client.frame(lambda header: header["slot"] == "B" and header["kind"] == "picture" and header["spp"] == 8)
    assert second.header["scale"] == 1
    difference = client.frame(lambda header: header["kind"] == "difference")
    assert difference.header["numbers"]
    assert "f_number: 11" in client.ask(6, "scene", slot="B").header["yaml"]
    client.ask(7, "dial", name="focus_m", value=0.8)
    assert "f_number: 11" in client.ask(8, "scene", slot="B").header["yaml"]
    assert client.ask(9, "compare", mode="off").type == "done"
    assert client.ask(10, "scene", slot="B").type == "error"


def test_instruments_answer_the_pointer(client: Page) -> None:
    client.frame(at_rest)
    client.ask(5, "view", panels=["histogram", "meter", "lens"])
    client.send("pointer", x=0.5, y=0.5)
    wanted = {"histogram", "meter", "lens"}
    found: dict[str, dict[str, Any]] = {}
    while wanted - found.keys() or not found["lens"]["pointer"]:
        message = client.receive()
        found[message.type] = message.header
    assert sum(found["histogram"]["luminance"]) == 48 * 32
    assert found["meter"]["cd_m2"] > 0
    assert found["lens"]["pointer"]["rays"]
    client.send("magnify", x=0.5, y=0.5, width=16, height=16)
    piece = client.frame(lambda header: header["kind"] == "magnifier")
    assert Pillow.open(io.BytesIO(piece.data)).size == (16, 16)


def test_edit_of_the_file_shows_within_a_second_and_an_error_with_its_line(served: Served, client: Page) -> None:
    _, _, path = served
    client.frame(at_rest)
    client.ask(5, "dial", name="f_number", value=4)
    try:
        begun = time.monotonic()
        path.write_text(SCENE.replace("[0.7, 0.6, 0.5]", "[0.1, 0.1, 0.8]"))
        client.wait(lambda message: message.type == "notice" and message.header["kind"] == "watch")
        seen = time.monotonic() - begun
        assert seen < 5, "a second where nothing else runs"
        text = client.ask(6, "scene").header["yaml"]
        assert "0.8" in text
        assert "f_number: 4" in text, "what was turned stays"
        path.write_text(SCENE.replace("radius: 0.15", "radius: -1"))
        error = client.wait(lambda message: message.type == "error")
        assert error.header["source"] == "scene"
        assert error.header["where"] == f"{path}:8:48"
        client.ask(7, "move", kind="orbit", dx=0.01)
        client.frame(lambda header: header["answers"] == 7)
        path.write_text("camera: {kind: [")
        assert client.wait(lambda message: message.type == "error").header["source"] == "scene"
    finally:
        path.write_text(SCENE)
    assert client.wait(lambda message: message.type == "notice").header["ok"]


def closing_code(server: ViewServer, first: str | bytes | None) -> int:
    """Return the code with which the server ends a connection that begins so."""
    with opened(server) as connection:
        if first is not None:
            connection.send(first)
        try:
            while True:
                connection.recv(10)
        except ConnectionClosed as closed:
            assert closed.rcvd is not None
            return closed.rcvd.code


def test_nobody_comes_in_without_the_token(served: Served) -> None:
    server = served[1]
    hello = {"type": "hello", "token": server.tokens.lasting, "version": 1}
    for wrong in ("", "x" * 43, server.tokens.lasting[:-1]):
        assert closing_code(server, json.dumps(hello | {"token": wrong})) == 4401
    assert closing_code(server, json.dumps({"type": "hello", "version": 1})) == 4400
    assert closing_code(server, json.dumps({"type": "ping"})) == 4400
    assert closing_code(server, "{") == 4400
    assert closing_code(server, b"\x00\x01") == 4400
    assert closing_code(server, json.dumps(hello | {"version": 2})) == 4400


def test_foreign_pages_and_names_are_refused(served: Served) -> None:
    server = served[1]
    for origin in ("http://evil.example", "null", f"https://127.0.0.1:{server.port}", None):
        with pytest.raises(InvalidStatus) as refused, opened(server, origin=origin):
            pass
        assert refused.value.response.status_code == 403
    for name in ("evil.example", f"evil.example:{server.port}"):
        answer = asked(server, "/", {"Host": name})
        assert answer.status == 403


def asked(server: ViewServer, path: str, headers: dict[str, str] | None = None) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", path, headers=headers or {})
    return connection.getresponse()


def test_only_the_own_files_of_the_page_are_served(served: Served) -> None:
    server, path = served[1], served[2]
    answer = asked(server, "/")
    assert answer.status == 200
    assert b"<html" in answer.read()
    policy = answer.getheader("content-security-policy") or ""
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for wrong in (
        "/../__init__.py", "/%2e%2e/__init__.py", "/..%2f__init__.py", "/./index.html", "//etc/passwd", "/etc/passwd",
        f"/{path}", "/page", "/index.html/", "/INDEX.HTML", "/ws", "/index.html%00.js",
    ):  # fmt: skip
        assert asked(server, wrong).status in (403, 404), wrong
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("POST", "/", body=b"x" * 1000)
    assert connection.getresponse().status == 405


def test_fifth_client_is_refused_and_the_four_go_on(served: Served) -> None:
    server = served[1]
    hello = json.dumps({"type": "hello", "token": server.tokens.lasting, "version": 1})
    with page(server) as a, page(server) as b, page(server) as c, page(server) as d:
        assert closing_code(server, hello) == 4429
        for client in (a, b, c, d):
            assert client.ask(5, "ping").type == "done"
    with page(server) as client:
        assert client.ask(5, "ping").type == "done"


def test_message_of_ten_megabytes_ends_its_client_alone(served: Served) -> None:
    server = served[1]
    with page(server) as other:
        with page(server) as client:
            with pytest.raises(ConnectionClosed) as closed:
                client.socket.send("x" * 10_000_000)
                while True:
                    client.receive()
            assert closed.value.rcvd is None or closed.value.rcvd.code == 1009
        assert other.ask(5, "ping").type == "done"


def test_client_killed_in_the_middle_of_a_frame_harms_nothing(served: Served) -> None:
    finder, server, _ = served
    with page(server) as other:
        with page(server) as client:
            client.send("set", changes={"film.resolution": [96, 64]}, transient=True)
            client.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
            client.socket.socket.close()
        assert other.ask(5, "reset").type == "done"
        other.frame(at_rest)
        deadline = time.monotonic() + 20
        while len(finder.clients()) > 1 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert len(finder.clients()) == 1


def test_last_page_frees_the_device_and_the_next_one_finds_it_as_it_was(served: Served) -> None:
    finder, server, _ = served
    with page(server) as client:
        client.ask(5, "dial", name="f_number", value=8)
        client.frame()
    assert left_alone(finder) < 5, "seconds; one where nothing else runs"
    with page(server) as client:
        assert finder.holds_device
        assert "f_number: 8" in client.ask(6, "scene").header["yaml"]
        client.frame()


def test_change_that_the_device_cannot_hold_is_reported_and_undone(client: Page) -> None:
    client.frame(at_rest)
    client.ask(5, "dial", name="f_number", value=8)
    client.frame(lambda header: at_rest(header) and header["answers"] == 5)
    client.send("set", id=6, changes={"film.resolution": [46000, 46000]})
    error = client.wait(lambda message: message.type == "error")
    assert error.header["source"] == "device"
    text = client.ask(7, "scene").header["yaml"]
    assert "46000" not in text
    assert "f_number: 8" in text
    client.ask(8, "move", kind="orbit", dx=0.1)
    client.frame(lambda header: header["answers"] == 8)


def test_pause_stops_the_picture_and_resume_goes_on(client: Page) -> None:
    client.frame(at_rest)
    client.ask(5, "pause")
    client.ask(6, "dial", name="f_number", value=16)
    client.ask(7, "ping")
    time.sleep(0.3)
    client.ask(8, "ping")
    assert not any(message.type == "frame" and message.header["answers"] == 6 for message in client.seen)
    client.send("resume")
    client.frame(lambda header: header["answers"] == 6)


@dataclass
class Running:
    """The command in a process of its own: where it is, and where it has sent the browser."""

    process: subprocess.Popen[str]
    port: int
    token: str
    visited: Path

    def browser_token(self) -> str:
        deadline = time.monotonic() + 30
        while not (self.visited.exists() and self.visited.read_text().endswith("\n")) and time.monotonic() < deadline:
            time.sleep(0.01)
        return self.visited.read_text().strip().partition("#")[2]


@pytest.fixture(scope="module")
def running(served: Served, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("browser")
    browser = folder / "browser"
    browser.write_text(f'#!/bin/sh\nprintf "%s\\n" "$1" > {folder}/visited\n')
    browser.chmod(0o755)
    words = [sys.executable, "-m", "rptcam_cl", "view", str(served[2])]
    environment = os.environ | {"BROWSER": str(browser), "DISPLAY": ":0"}
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(words, env=environment, text=True, **pipes)
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.search(r"http://127\.0\.0\.1:(\d+)/#([\w-]{43})$", line.strip())
    assert found, line
    yield Running(process, int(found[1]), found[2], folder / "visited")
    process.kill()


def test_browser_is_sent_with_a_token_of_its_own_that_admits_once(running: Running) -> None:
    token = running.browser_token()
    assert len(token) == 43
    assert token != running.token
    here = f"127.0.0.1:{running.port}"
    for expected in ("hello", "error"):
        with connect(f"ws://{here}/ws", origin=f"http://{here}", compression=None, proxy=None) as connection:
            client = Page(connection)
            client.send("hello", token=token, version=1)
            answer = client.wait(lambda message: message.type in ("hello", "error"))
            assert answer.type == expected
            assert answer.header.get("token", running.token) == running.token


def test_ctrl_c_ends_the_command_and_the_token_is_in_no_log(running: Running) -> None:
    process = running.process
    connection = http.client.HTTPConnection("127.0.0.1", running.port, timeout=60)
    connection.request("GET", "/?x=1")
    assert connection.getresponse().status == 200
    begun = time.monotonic()
    process.send_signal(signal.SIGINT)
    assert process.wait(20) == 0
    assert time.monotonic() - begun < 5, "seconds; one where nothing else runs"
    assert process.stdout is not None
    assert process.stderr is not None
    rest = process.stdout.read() + process.stderr.read()
    assert running.token not in rest
    assert running.browser_token() not in rest
    assert "Traceback" not in rest


def test_what_is_missing_is_said_with_how_to_install_it(served: Served) -> None:
    program = "import sys; sys.modules['starlette'] = None; from rptcam_cl.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", program, "view", str(served[2]), "--no-browser"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "pip install 'rptcam_cl[view]'" in done.stderr


def test_other_machines_come_in_by_consent_alone(served: Served) -> None:
    words = [sys.executable, "-m", "rptcam_cl", "view", str(served[2]), "--no-browser", "--host", "0.0.0.0"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "--let-others-in" in done.stderr


def test_loaded_scene_is_that_of_the_file(served: Served) -> None:
    assert served[0].origin.load().content_hash() == load_scene(served[2]).content_hash()
    assert all(path.is_absolute() for path in served[0].origin.files)
