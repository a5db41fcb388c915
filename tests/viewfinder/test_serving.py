"""What runs round the server: signals that end it, the browser that is sent to it, ports that are taken."""

import os
import signal
import socket
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from rptcam_cl.core.errors import StateError
from rptcam_cl.viewfinder import server as module
from rptcam_cl.viewfinder.server import ViewServer, serve


class EndedError(Exception):
    """Stands in for the end of the process."""


class Server:
    """Stands in for the server: does what it is told to while it runs."""

    def __init__(self, during: Callable[[], None] = lambda: None) -> None:
        self.during, self.stops, self.at = during, 0, ("", 0)
        self.tokens = SimpleNamespace(lasting="lasting", once="once")

    def __call__(self, finder: Any, host: str, port: int) -> "Server":
        self.at = (host, port)
        return self

    def address(self, token: str) -> str:
        return f"http://here/#{token}"

    def stop(self) -> None:
        self.stops += 1

    def run(self) -> None:
        self.during()


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The codes that the process was to end with."""
    codes: list[int] = []

    def end(code: int) -> None:
        codes.append(code)
        raise EndedError

    monkeypatch.setattr(module.os, "_exit", end)
    return codes


def run(monkeypatch: pytest.MonkeyPatch, server: Server, closes: bool = True, **options: Any) -> list[str]:
    """Serve, and return what was announced and opened; a viewfinder closes in time or not."""
    said: list[str] = []
    closed: list[bool] = []

    def close() -> bool:
        closed.append(True)
        return closes

    monkeypatch.setattr(module, "ViewServer", server)
    monkeypatch.setattr(module, "_open", lambda address: said.append(f"opened {address}"))
    threads = {"Thread": lambda target, args, daemon: SimpleNamespace(start=lambda: target(*args))}
    monkeypatch.setattr(module, "threading", SimpleNamespace(**threads))
    finder: Any = SimpleNamespace(close=close)
    given: dict[str, Any] = {"host": "127.0.0.1", "port": 0, "browse": True} | options
    try:
        serve(finder, announce=said.append, **given)
    finally:
        assert closed == [True]
    return said


def test_page_is_announced_with_one_token_and_opened_with_another(monkeypatch: pytest.MonkeyPatch) -> None:
    server = Server()
    assert run(monkeypatch, server, host="::1", port=81) == ["http://here/#lasting", "opened http://here/#once"]
    assert server.at == ("::1", 81) and server.stops == 0
    assert run(monkeypatch, Server(), browse=False) == ["http://here/#lasting"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_first_signal_stops_the_server_and_the_second_ends_the_process(
    monkeypatch: pytest.MonkeyPatch, ends: list[int], number: signal.Signals
) -> None:
    before = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]
    server = Server(lambda: os.kill(os.getpid(), number))
    run(monkeypatch, server)
    assert (server.stops, ends) == (1, [])

    def twice() -> None:
        for _ in range(2):
            os.kill(os.getpid(), number)

    server = Server(twice)
    with pytest.raises(EndedError):
        run(monkeypatch, server)
    assert (server.stops, ends) == (1, [128 + number])
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == before


def test_process_ends_where_a_compiler_is_still_at_work(monkeypatch: pytest.MonkeyPatch, ends: list[int]) -> None:
    with pytest.raises(EndedError):
        run(monkeypatch, Server(), closes=False)
    assert ends == [0]


@pytest.mark.parametrize(
    ("screen", "opened"), [({}, False), ({"DISPLAY": ":0"}, True), ({"WAYLAND_DISPLAY": "w"}, True)]
)
def test_browser_is_opened_where_there_is_a_screen(
    monkeypatch: pytest.MonkeyPatch, screen: dict[str, str], opened: bool
) -> None:
    visited: list[str] = []
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in screen.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(module.webbrowser, "open", visited.append)
    module._open("http://here/#once")
    assert visited == (["http://here/#once"] if opened else [])

    def none(address: str) -> None:
        raise module.webbrowser.Error("no browser")

    monkeypatch.setattr(module.webbrowser, "open", none)
    module._open("http://here/#once")  # which is no reason to end
    monkeypatch.setattr("sys.platform", "darwin")
    monkeypatch.setattr(module.webbrowser, "open", visited.append)
    module._open("http://elsewhere")
    assert visited[-1] == "http://elsewhere"


def test_port_that_is_taken_is_an_error_that_names_it() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(StateError, match=rf"^cannot listen at 127\.0\.0\.1 port {port}: "):
            ViewServer(SimpleNamespace(), "127.0.0.1", port)  # type: ignore[arg-type]
