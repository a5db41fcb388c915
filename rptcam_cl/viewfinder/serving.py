"""The server of a viewfinder: from its socket to the end by Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from types import FrameType
from typing import Any

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.viewfinder.doors import Tokens
from rptcam_cl.viewfinder.finder import Viewfinder
from rptcam_cl.viewfinder.messages import MOST_BYTES

NEEDED = "the viewfinder in a browser needs starlette, uvicorn and websockets: pip install 'rptcam_cl[view]'"
REQUEST_S = 5.0  # from a connection, or the first byte of another request on it, to the whole request
MOST_REQUESTS = 32  # that are there in part; the oldest makes room
_CLOSING_S = 0.3  # that connections have to end


def check_server() -> None:
    """Raise `InputError` when what the server is made of is not installed."""
    missing = [name for name in ("starlette", "uvicorn", "websockets") if find_spec(name) is None]
    if missing:
        raise InputError(f"{NEEDED} (missing: {', '.join(missing)})")


def bound_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens; port 0 takes any that is free.

    Raises
    ------
    StateError
        The port is taken, or the host is not of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((host, port))
        found.listen(16)
    except OSError as problem:
        found.close()
        raise StateError(f"cannot listen at {host} port {port}: {problem.strerror or problem}") from None
    return found


class ViewServer:
    """Serves a viewfinder over HTTP and WebSocket.

    Parameters
    ----------
    finder
        The viewfinder.
    host, port
        Where to listen; port 0 takes any that is free.

    Raises
    ------
    InputError
        What the server is made of is not installed.
    StateError
        It cannot listen there.
    """

    def __init__(self, finder: Viewfinder, host: str = "127.0.0.1", port: int = 0) -> None:
        check_server()
        import uvicorn

        from rptcam_cl.viewfinder.app import make_app

        self._finder = finder
        self._socket = bound_socket(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        self.tokens = Tokens()
        config = uvicorn.Config(
            make_app(finder, self.tokens, host, self.port),
            http=_patient_protocol(),
            ws="websockets-sansio",
            ws_max_size=MOST_BYTES,
            ws_per_message_deflate=False,
            lifespan="off",
            log_config=None,
            log_level="error",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=_CLOSING_S,  # type: ignore[arg-type]  # it is a timeout of asyncio
        )
        self._server = _quiet_server(config)

    def address(self, token: str) -> str:
        """Return the address of the page for who has a token."""
        name = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)
        return f"http://{f'[{name}]' if ':' in name else name}:{self.port}/#{token}"

    def run(self) -> None:
        """Serve until `stop` is called."""
        self._server.run(sockets=[self._socket])

    def stop(self) -> None:
        """End soon, telling the pages; any thread, and signal handlers."""
        self._finder.tell({"type": "bye", "text": "the server has ended"})
        self._server.should_exit = True


def _patient_protocol() -> Any:
    """Return uvicorn's protocol of HTTP that waits for requests, as it does not by itself, for so long and so many."""
    from uvicorn.protocols.http.h11_impl import H11Protocol

    waiting: dict[Any, asyncio.TimerHandle] = {}  # in the order in which they came

    class Patient(H11Protocol):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._wait()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.scope is None or (self.cycle is not None and self.cycle.response_complete):
                self._wait()  # for the rest of a request
            else:
                self._arrived()

        def connection_lost(self, exc: Exception | None) -> None:
            self._arrived()
            super().connection_lost(exc)

        def _wait(self) -> None:
            if self not in waiting and not self.transport.is_closing():
                if len(waiting) >= MOST_REQUESTS:
                    next(iter(waiting))._give_up()
                waiting[self] = self.loop.call_later(REQUEST_S, self._give_up)

        def _arrived(self) -> None:
            if self in waiting:
                waiting.pop(self).cancel()

        def _give_up(self) -> None:
            self._arrived()
            self.transport.abort()

    return Patient


def _quiet_server(config: Any) -> Any:
    """Return a server that leaves signals to its caller."""
    import uvicorn

    class Quiet(uvicorn.Server):
        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            yield

    return Quiet(config)


@contextlib.contextmanager
def _stopping(stop: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C and termination call ``stop``; the second time the process ends at once."""
    requested = False

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal requested
        if requested:
            os._exit(128 + number)
        requested = True
        stop()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def serve(finder: Viewfinder, *, host: str, port: int, browse: bool, announce: Callable[[str], Any]) -> None:
    """Serve a viewfinder until Ctrl-C, which ends it within a second.

    Parameters
    ----------
    finder
        The viewfinder; closed at the end.
    host, port
        Where to listen.
    browse
        Whether to open the page in the browser.
    announce
        Called with the address of the page.
    """
    try:
        server = ViewServer(finder, host, port)
        with _stopping(server.stop):
            announce(server.address(server.tokens.lasting))
            if browse:
                address = server.address(server.tokens.once)
                threading.Thread(target=_open, args=(address,), daemon=True).start()
            server.run()
    finally:
        if not finder.close():  # a compiler is at work, which nothing ends but the end of the process
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(0)


def _open(address: str) -> None:
    """Open a page in the browser, where there is a screen for one."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return
    with contextlib.suppress(webbrowser.Error):
        webbrowser.open(address)
