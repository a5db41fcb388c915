"""What the page is made of and who may come in: its modules as one text, tokens, doors, what must be installed."""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
import socket
import threading
from collections.abc import Iterable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rptcam_cl.core.errors import InputError

# The page's modules and styles as one text each, for notebooks, which take no folder of files.

PAGE = Path(__file__).parent / "page"
_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w-]+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.MULTILINE)
_SHEET = re.compile(r'<link rel="stylesheet" href="([\w-]+\.css)">')


def _variable(module: str) -> str:
    return "module_" + module.replace("-", "_")


def _collect_modules(module: str, texts: dict[str, str]) -> None:
    """Add a module and, before it, those that it imports, to the texts by name."""
    if module in texts:
        return
    text = (PAGE / f"{module}.js").read_text("utf-8")
    for needed in _IMPORT.findall(text):
        _collect_modules(needed[1], texts)
    texts[module] = text


def _enclose(module: str, text: str) -> str:
    """Return a module as a function that is called at once, as names of two modules may be the same."""
    exported = ", ".join(_EXPORT.findall(text))
    inside = _EXPORT.sub("", _IMPORT.sub(lambda each: f"const {{{each[1]}}} = {_variable(each[2])};\n", text))
    return f"const {_variable(module)} = (() => {{\n{inside}\nreturn {{ {exported} }};\n}})();\n"


@cache
def module_text() -> str:
    """Return the widget's module with all that it imports, as anywidget takes it."""
    texts: dict[str, str] = {}
    _collect_modules("widget", texts)
    parts = [_enclose(name, text) for name, text in texts.items()]
    return "\n".join([*parts, f"export default {{ render: {_variable('widget')}.render }};\n"])


@cache
def style_text() -> str:
    """Return the page's styles in the order in which the page loads them."""
    names = _SHEET.findall((PAGE / "index.html").read_text("utf-8"))
    return "\n".join((PAGE / name).read_text("utf-8") for name in names)


# Who may come in: the token, the names that the server answers to, and pages of its own alone.

_TOKEN_BYTES = 32
_LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class Tokens:
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
        self._any_address = _is_unspecified(host)
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


def _is_unspecified(host: str) -> bool:
    return _is_address(host) and ipaddress.ip_address(host).is_unspecified


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches a server that listens at a host."""
    return host == "localhost" or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


# What the server is made of, which is an extra.

NEEDED = "the viewfinder in a browser needs starlette, uvicorn and websockets: pip install 'rptcam_cl[view]'"


def check_server() -> None:
    """Raise `InputError` when what the server is made of is not installed."""
    missing = [name for name in ("starlette", "uvicorn", "websockets") if find_spec(name) is None]
    if missing:
        raise InputError(f"{NEEDED} (missing: {', '.join(missing)})")
