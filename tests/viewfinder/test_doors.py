"""Who comes in: Host and Origin on HTTP and WebSocket, and tokens."""

import asyncio
from typing import Any

import pytest

from rptcam_cl.viewfinder.server import AccessTokens, OriginGuard, is_loopback


def passes(host: str, kind: str, headers: list[tuple[str, str]], port: int = 8000) -> bool:
    """Return whether a request comes through the doors of a server at a host."""
    reached = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        reached.append(scope)

    async def receive() -> dict[str, str]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        assert message.get("status", 403) == 403

    scope = {"type": kind, "headers": [(name.encode(), value.encode()) for name, value in headers]}
    asyncio.run(OriginGuard(app, host, port)(scope, receive, send))
    return bool(reached)


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000", "LOCALHOST:8000", "[::1]:8000"])
def test_own_names_come_in(host: str) -> None:
    assert passes("127.0.0.1", "http", [("host", host)])
    assert passes("127.0.0.1", "http", [("host", host), ("origin", f"http://{host}")])
    assert passes("127.0.0.1", "websocket", [("host", host), ("origin", f"http://{host}")])


@pytest.mark.parametrize(
    "headers",
    [
        [],
        [("host", "evil.example:8000")],
        [("host", "127.0.0.1")],
        [("host", "127.0.0.1:8001")],
        [("host", "127.0.0.1:8000"), ("host", "evil.example")],
        [("host", "127.0.0.1.evil.example:8000")],
        [("host", "192.168.1.5:8000")],
        [("host", "127.0.0.1:8000"), ("origin", "http://evil.example")],
        [("host", "127.0.0.1:8000"), ("origin", "https://127.0.0.1:8000")],
        [("host", "127.0.0.1:8000"), ("origin", "http://127.0.0.1:9000")],
        [("host", "127.0.0.1:8000"), ("origin", "null")],
        [("host", "127.0.0.1:8000"), ("origin", "http://127.0.0.1:8000"), ("origin", "http://evil.example")],
    ],
)
def test_strangers_stay_outside(headers: list[tuple[str, str]]) -> None:
    assert not passes("127.0.0.1", "http", headers)
    assert not passes("127.0.0.1", "websocket", headers)


def test_websocket_without_an_origin_stays_outside() -> None:
    assert not passes("127.0.0.1", "websocket", [("host", "127.0.0.1:8000")])


@pytest.mark.parametrize(
    ("server", "host"),
    [("192.168.1.5", "192.168.1.5:8000"), ("render.example", "Render.Example:8000"), ("fd00::7", "[fd00::7]:8000")],
)
def test_server_takes_its_own_address_and_those_of_this_machine(server: str, host: str) -> None:
    for name in (host, "localhost:8000", "[::1]:8000"):
        assert passes(server, "websocket", [("host", name), ("origin", f"http://{name}")])
    for name in (host.replace("8000", "80"), host.removesuffix(":8000"), "fd00::7:8000", "192.168.1.6:8000"):
        assert not passes(server, "websocket", [("host", name), ("origin", f"http://{name}")]), name


def test_port_that_browsers_leave_out_may_be_left_out() -> None:
    for name in ("192.168.1.5", "192.168.1.5:80", "localhost", "[::1]"):
        assert passes("192.168.1.5", "http", [("host", name), ("origin", f"http://{name}")], 80), name
    for name in ("192.168.1.5:8000", "192.168.1.6", "evil.example"):
        assert not passes("192.168.1.5", "http", [("host", name)], 80), name


def test_server_for_all_takes_addresses_and_no_other_names() -> None:
    for host in ("192.168.1.5:8000", "[fe80::1]:8000", "localhost:8000"):
        assert passes("0.0.0.0", "websocket", [("host", host), ("origin", f"http://{host}")]), host
    for host in ("evil.example:8000", "192.168.1.5:80"):
        assert not passes("0.0.0.0", "websocket", [("host", host), ("origin", f"http://{host}")]), host


def test_lasting_token_admits_always_and_the_other_once() -> None:
    tokens = AccessTokens()
    assert len(tokens.lasting) >= 43
    assert tokens.lasting != tokens.once
    assert [tokens.admits(tokens.once) for _ in range(3)] == [True, False, False]
    assert [tokens.admits(tokens.lasting) for _ in range(3)] == [True, True, True]
    for wrong in ("", "x", tokens.lasting[:-1], tokens.lasting + "x", "ä", "\ud800"):
        assert not tokens.admits(wrong)


def test_loopback_is_told_from_the_rest() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.8.8.8", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "::", "192.168.1.5", "example.org")))
