"""The server of a viewfinder: who may come in, the page's own files, the WebSocket, and the end by Ctrl-C.

It needs the extra `view`; without it the import raises `InputError`.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
import json
import logging
import os
import secrets
import signal
import socket
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import Any

from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.viewfinder.engine import TooManyClientsError, Viewfinder
from rptcam_cl.viewfinder.messages import MOST_BYTES, BadMessageError, Hello, read_message

if _missing := [name for name in ("starlette", "uvicorn", "websockets") if find_spec(name) is None]:
    _words = "the viewfinder in a browser needs starlette, uvicorn and websockets: pip install 'rptcam_cl[view]'"
    raise InputError(f"{_words} (missing: {', '.join(_missing)})")

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

LOG = logging.getLogger("rptcam_cl.viewfinder")

# Who may come in: the token, the names that the server answers to, and pages of its own alone.

_TOKEN_BYTES = 32
_LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class AccessTokens:
    """The token of a server, and one that is good for one visit.

    The browser is opened with the second: the words of a command are there to be read by everybody on a machine.
    """

    def __init__(self) -> None:
        self.lasting = secrets.token_urlsafe(_TOKEN_BYTES)
        self.once = secrets.token_urlsafe(_TOKEN_BYTES)
        self._once_left = True
        self._lock = threading.Lock()

    def admits(self, token: str) -> bool:
        """Return whether a token is right; the one of a single visit is used up by that."""
        given = token.encode("utf-8", "surrogatepass")
        lasting = hmac.compare_digest(given, self.lasting.encode())
        once = hmac.compare_digest(given, self.once.encode())
        with self._lock:
            visit = once and self._once_left
            if visit:
                self._once_left = False
        return lasting or visit


class OriginGuard:
    """Refuses requests that are not for this server, or come from pages of others.

    It wraps an ASGI application and looks at HTTP and WebSocket alike. A page of another site can make a browser ask
    for anything, but cannot choose Host (a name of its own that leads here is thus refused: DNS rebinding) nor Origin.

    Parameters
    ----------
    app
        What is behind the doors.
    host : str
        That the server listens at.
    port : int
    """

    def __init__(self, app: Any, host: str, port: int) -> None:
        self._app = app
        self._port = port
        self._any_address = _is_address(host) and ipaddress.ip_address(host).is_unspecified
        names = {*_LOOPBACK, f"[{host}]" if ":" in host else host}
        if self._any_address:
            names.add(socket.gethostname().lower())
        self._hosts = {f"{name}:{port}" for name in names} | (names if port == 80 else set())

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket") or self._admits(scope["type"], scope["headers"]):
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: HTTP 403
        else:
            headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
            await send({"type": "http.response.start", "status": 403, "headers": headers})
            await send({"type": "http.response.body", "body": b"not from here\n"})

    def _admits(self, kind: str, headers: Iterable[tuple[bytes, bytes]]) -> bool:
        given = [(name.lower(), value.decode("latin-1").lower()) for name, value in headers]
        hosts = [value for name, value in given if name == b"host"]
        origins = [value for name, value in given if name == b"origin"]
        if len(hosts) != 1 or not self._is_ours(hosts[0]) or len(origins) > 1:
            return False
        if not origins:
            return kind == "http"  # browsers send it with every WebSocket
        return origins[0] == f"http://{hosts[0]}"

    def _is_ours(self, host: str) -> bool:
        if host in self._hosts:
            return True
        name, _, port = host.rpartition(":")
        return self._any_address and port == str(self._port) and _is_address(name.strip("[]"))


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches a server that listens at a host."""
    return host == "localhost" or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


# The web application: the page's own files, and the WebSocket.

HELLO_TIMEOUT_S = 5.0  # until the first message
_MOST_UNAUTHENTICATED = 8  # connections that have not said who they are
_BAD_HELLO, _WRONG_TOKEN, _NO_HELLO, _TOO_MANY = 4400, 4401, 4408, 4429
_TOO_SLOW, _NOT_TEXT, _NOT_SENT = 4413, 1003, 1011
_MEDIA = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".json": "application/json",
    ".woff2": "font/woff2",
}
_HEADERS = {
    "cache-control": "no-store",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
}


@cache
def _page_files() -> dict[str, tuple[str, bytes]]:
    """Return media type and content of the page's files by the path of the request."""
    folder = Path(__file__).parent / "page"
    files = {
        f"/{path.relative_to(folder).as_posix()}": (_MEDIA[path.suffix], path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix in _MEDIA
    }
    return files | ({"/": files["/index.html"]} if "/index.html" in files else {})


def _make_app(finder: Viewfinder, tokens: AccessTokens, host: str, port: int) -> Any:
    """Return the ASGI application of a viewfinder.

    Parameters
    ----------
    finder
        What the pages look through.
    tokens
        Who may look.
    host, port
        Where the server listens.
    """
    handler = _WebSocketHandler(finder, tokens)
    routes = [WebSocketRoute("/ws", handler.visit), Route("/{path:path}", _page, methods=["GET"])]
    return OriginGuard(Starlette(routes=routes), host, port)


async def _page(request: Request) -> Response:
    """Return a file of the page; only exact names are known."""
    file = _page_files().get(request.url.path)
    if file is None:
        return Response("no such page\n", 404, headers=_HEADERS, media_type="text/plain")
    return Response(file[1], headers=_HEADERS, media_type=file[0])


class _WebSocketHandler:
    """Lets clients in and carries their messages."""

    def __init__(self, finder: Viewfinder, tokens: AccessTokens) -> None:
        self._finder, self._tokens = finder, tokens
        self._unauthenticated = 0

    async def visit(self, socket: WebSocket) -> None:
        """Serve one connection to its end."""
        if self._unauthenticated >= _MOST_UNAUTHENTICATED:
            await socket.close(_TOO_MANY)
            return
        await socket.accept()
        self._unauthenticated += 1
        try:
            hello = await asyncio.wait_for(socket.receive_text(), HELLO_TIMEOUT_S)
        except TimeoutError:
            await _close(socket, _NO_HELLO, "no hello came")
            return
        except (WebSocketDisconnect, KeyError, RuntimeError):  # gone; or not text
            await _close(socket, _BAD_HELLO, "the first message is to be a hello")
            return
        finally:
            self._unauthenticated -= 1
        await self._welcome(socket, hello)

    async def _welcome(self, socket: WebSocket, text: str) -> None:
        try:
            hello = read_message(text)
        except BadMessageError as problem:
            await _close(socket, _BAD_HELLO, str(problem))
            return
        if not isinstance(hello, Hello):
            await _close(socket, _BAD_HELLO, "the first message is to be a hello")
        elif not self._tokens.admits(hello.token):
            await _close(socket, _WRONG_TOKEN, "the token is wrong: open the address that rptcam view has printed")
        else:
            await self._serve(socket, None if hello.token == self._tokens.lasting else self._tokens.lasting)

    async def _serve(self, socket: WebSocket, token: str | None) -> None:
        loop, ready = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(ready.set)

        try:
            client = self._finder.connect(wake, token)
        except TooManyClientsError as problem:
            await _close(socket, _TOO_MANY, str(problem))
            return
        sender = asyncio.create_task(_send_all(socket, client.outbox, ready))
        try:
            while True:
                self._finder.receive(client, await socket.receive_text())
        except KeyError:
            await _close(socket, _NOT_TEXT, "messages are text")
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            self._finder.disconnect(client)
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await sender


async def _send_all(socket: WebSocket, outbox: Any, ready: asyncio.Event) -> None:
    """Send what an outbox has, as fast as the client takes it; end the connection where that fails: it comes back."""
    try:
        while True:
            await ready.wait()
            ready.clear()
            for message in outbox.take():
                if isinstance(message, bytes):
                    await socket.send_bytes(message)
                else:
                    await socket.send_text(message)
            if outbox.overflowed:
                await _close(socket, _TOO_SLOW, "too many messages wait")
                return
    except (WebSocketDisconnect, RuntimeError):  # gone
        pass
    except Exception:
        LOG.exception("a message of the viewfinder could not be sent")
        await _close(socket, _NOT_SENT, "a message could not be sent")


async def _close(socket: WebSocket, code: int, why: str) -> None:
    """Close a connection, saying why in what fits into the frame."""
    with contextlib.suppress(Exception):
        if socket.client_state is WebSocketState.CONNECTED:
            await socket.send_text(
                f'{{"type": "error", "id": null, "message": {json.dumps(why)}, "source": "message"}}'
            )
        await socket.close(code, why.encode()[:100].decode(errors="ignore"))


# The server of a viewfinder: from its socket to the end by Ctrl-C.

REQUEST_S = 5.0  # from a connection, or the first byte of another request on it, to the whole request
MOST_REQUESTS = 32  # that are there in part; the oldest makes room
_CLOSING_S = 0.3  # that connections have to end


def _bound_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens; port 0 takes any that is free.

    Raises
    ------
    StateError
        The port is taken, or the host is not of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(16)
    except OSError as problem:
        listener.close()
        raise StateError(f"cannot listen at {host} port {port}: {problem.strerror or problem}") from None
    return listener


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
    StateError
        It cannot listen there.
    """

    def __init__(self, finder: Viewfinder, host: str = "127.0.0.1", port: int = 0) -> None:
        import uvicorn

        self._finder = finder
        self._socket = _bound_socket(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        self.tokens = AccessTokens()
        config = uvicorn.Config(
            _make_app(finder, self.tokens, host, self.port),
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
        self._server = uvicorn.Server(config)
        self._server.capture_signals = contextlib.nullcontext  # type: ignore[method-assign, assignment]  # `serve` has the signals
        self._ends = False
        self._tick, self._server.on_tick = self._server.on_tick, self._tell_of_the_end  # type: ignore[method-assign]

    def address(self, token: str) -> str:
        """Return the address of the page for who has a token."""
        name = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)
        return f"http://{f'[{name}]' if ':' in name else name}:{self.port}/#{token}"

    def run(self) -> None:
        """Serve until `stop` is called."""
        self._server.run(sockets=[self._socket])

    def stop(self) -> None:
        """End soon, telling the pages; any thread, and signal handlers: they may interrupt whoever holds a lock."""
        self._ends = True

    async def _tell_of_the_end(self, counter: int) -> bool:
        """Whether the server ends now; the pages hear of it a turn of its loop before."""
        over = await self._tick(counter)
        if self._ends and not over:
            self._finder.tell({"type": "bye", "text": "the server has ended"})
            self._server.should_exit = True
        return over


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
                self._stop_waiting()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_waiting()
            super().connection_lost(exc)

        def _wait(self) -> None:
            if self not in waiting and not self.transport.is_closing():
                if len(waiting) >= MOST_REQUESTS:
                    next(iter(waiting))._give_up()
                waiting[self] = self.loop.call_later(REQUEST_S, self._give_up)

        def _stop_waiting(self) -> None:
            if self in waiting:
                waiting.pop(self).cancel()

        def _give_up(self) -> None:
            self._stop_waiting()
            self.transport.abort()

    return Patient


@contextlib.contextmanager
def _stop_on_signals(stop: Callable[[], None]) -> Iterator[None]:
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
        with _stop_on_signals(server.stop):
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
