"""Who is no page of ours: each is refused, and the server and its pages go on."""

import contextlib
import http.client
import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from rptcam_cl.viewfinder import server as serving_module
from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.server import ViewServer
from tests.viewfinder.page_client import SCENE, at_rest, opened, page, serving

Served = tuple[Viewfinder, ViewServer, Path]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    path = tmp_path_factory.mktemp("scene") / "ball.yaml"
    path.write_text(SCENE)
    with serving(path) as (finder, server):
        yield finder, server, path


def test_one_time_token_admits_once(served: Served) -> None:
    server = served[1]
    with page(server, server.tokens.once) as client:
        assert client.seen[-1].header["token"] == server.tokens.lasting
    assert closing_code(server, json.dumps({"type": "hello", "token": server.tokens.once, "version": 1})) == 4401


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
        deadline = time.monotonic() + 60
        while len(finder.clients()) > 1 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert len(finder.clients()) == 1


def still_open(connection: socket.socket) -> bool:
    connection.setblocking(False)
    try:
        return connection.recv(1) != b""
    except BlockingIOError:
        return True
    except OSError:
        return False


def test_half_sent_requests_are_bounded_in_number_and_closed_soon(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving_module, "REQUEST_S", 1.0)
    server = served[1]
    host = b"Host: 127.0.0.1:%d\r\n" % server.port
    whole = b"GET /icon.svg HTTP/1.1\r\n" + host + b"\r\n"
    halves = [b"", b"GET / HTTP/1.1\r\n" + host, b"POST / HTTP/1.1\r\nContent-Length: 9999\r\n" + host + b"\r\n"]
    connections = []
    for i in range(90):
        connections.append(socket.create_connection(("127.0.0.1", server.port)))
        connections[-1].sendall(halves[i % 2])
    with page(server) as client:  # who comes meanwhile is served
        assert client.ask(5, "ping").type == "done"
    assert sum(map(still_open, connections)) <= serving_module.MOST_REQUESTS
    slow = []
    for first in (*halves, whole + halves[1]):
        slow.append(socket.create_connection(("127.0.0.1", server.port)))
        slow[-1].sendall(first)
    ends = time.monotonic() + 60
    while any(map(still_open, (*connections, *slow))) and time.monotonic() < ends:
        time.sleep(0.1)
        for connection in slow:
            with contextlib.suppress(OSError):  # bytes that trickle in do not prolong it
                connection.sendall(b"x")
                connection.recv(1 << 16, socket.MSG_DONTWAIT)
    assert [still_open(each) for each in (*connections, *slow)] == [False] * 94
    for each in (*connections, *slow):
        each.close()
