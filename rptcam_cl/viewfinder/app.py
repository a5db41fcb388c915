"""The web application: the page's own files, and the WebSocket."""

from __future__ import annotations

import asyncio
import contextlib
from functools import cache
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from rptcam_cl.viewfinder import messages
from rptcam_cl.viewfinder.doors import Doors, Tokens
from rptcam_cl.viewfinder.finder import TooManyClientsError, Viewfinder

PATIENCE_S = 5.0  # until the first message
MOST_STRANGERS = 8  # connections that have not said who they are
BAD_HELLO, WRONG_TOKEN, NO_HELLO, TOO_MANY, TOO_SLOW, NOT_TEXT = 4400, 4401, 4408, 4429, 4413, 1003
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
def page_files() -> dict[str, tuple[str, bytes]]:
    """Return media type and content of the page's files by the path of the request."""
    folder = Path(__file__).parent / "page"
    found = {
        f"/{path.relative_to(folder).as_posix()}": (_MEDIA[path.suffix], path.read_bytes())
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix in _MEDIA
    }
    return found | ({"/": found["/index.html"]} if "/index.html" in found else {})


def make_app(finder: Viewfinder, tokens: Tokens, host: str, port: int) -> Any:
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
    lobby = _Lobby(finder, tokens)
    routes = [WebSocketRoute("/ws", lobby.visit), Route("/{path:path}", _page, methods=["GET"])]
    return Doors(Starlette(routes=routes), host, port)


async def _page(request: Request) -> Response:
    """Return a file of the page; only exact names are known."""
    found = page_files().get(request.url.path)
    if found is None:
        return Response("no such page\n", 404, headers=_HEADERS, media_type="text/plain")
    return Response(found[1], headers=_HEADERS, media_type=found[0])


class _Lobby:
    """Lets clients in and carries their messages."""

    def __init__(self, finder: Viewfinder, tokens: Tokens) -> None:
        self._finder, self._tokens = finder, tokens
        self._strangers = 0

    async def visit(self, socket: WebSocket) -> None:
        """Serve one connection to its end."""
        if self._strangers >= MOST_STRANGERS:
            await socket.close(TOO_MANY)
            return
        await socket.accept()
        self._strangers += 1
        try:
            hello = await asyncio.wait_for(socket.receive_text(), PATIENCE_S)
        except TimeoutError:
            await _close(socket, NO_HELLO, "no hello came")
            return
        except (WebSocketDisconnect, KeyError, RuntimeError):  # gone; or not text
            await _close(socket, BAD_HELLO, "the first message is to be a hello")
            return
        finally:
            self._strangers -= 1
        await self._welcome(socket, hello)

    async def _welcome(self, socket: WebSocket, text: str) -> None:
        try:
            hello = messages.read_message(text)
        except messages.BadMessageError as problem:
            await _close(socket, BAD_HELLO, str(problem))
            return
        if not isinstance(hello, messages.Hello):
            await _close(socket, BAD_HELLO, "the first message is to be a hello")
        elif not self._tokens.admits(hello.token):
            await _close(socket, WRONG_TOKEN, "the token is wrong: open the address that rptcam view has printed")
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
            await _close(socket, TOO_MANY, str(problem))
            return
        sender = asyncio.create_task(_send_all(socket, client.outbox, ready))
        try:
            while True:
                self._finder.receive(client, await socket.receive_text())
        except KeyError:
            await _close(socket, NOT_TEXT, "messages are text")
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            self._finder.disconnect(client)
            sender.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                await sender


async def _send_all(socket: WebSocket, outbox: Any, ready: asyncio.Event) -> None:
    """Send what an outbox has, as fast as the client takes it."""
    while True:
        await ready.wait()
        ready.clear()
        for message in outbox.take():
            if isinstance(message, bytes):
                await socket.send_bytes(message)
            else:
                await socket.send_text(message)
        if outbox.overflowed:
            await _close(socket, TOO_SLOW, "too many messages wait")
            return


async def _close(socket: WebSocket, code: int, why: str) -> None:
    """Close a connection, saying why in what fits into the frame."""
    with contextlib.suppress(Exception):
        if socket.client_state is WebSocketState.CONNECTED:
            await socket.send_text(f'{{"type": "error", "id": null, "message": {_quoted(why)}, "source": "message"}}')
        await socket.close(code, why.encode()[:100].decode(errors="ignore"))


def _quoted(text: str) -> str:
    import json

    return json.dumps(text)
