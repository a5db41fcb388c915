"""A client of the viewfinder's server that does what the page does, and what no page would."""

from __future__ import annotations

import json
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.server import ViewServer

ALIVE_WITHIN_S = 60.0

# one compile: a lens of surfaces, one lamp, one material
SCENE = """
film: {resolution: [48, 32], width_mm: 36}
camera: {kind: realistic, lens: dgauss-50mm, eye: [0, 0, 1], target: [0, 0, 0], focus: {distance_m: 0.95}}
render: {spp: 8, max_depth: 2}
materials:
  white: {kind: matte, reflectance: [0.7, 0.6, 0.5]}
objects:
  - {shape: sphere, center: [0, 0, 0], radius: 0.15, material: white}
environment: {kind: constant, radiance: [0.4, 0.5, 0.6]}
"""


@dataclass
class Received:
    """A message of the server: its JSON, and the data behind it where it is binary."""

    header: dict[str, Any]
    data: bytes = b""

    @property
    def type(self) -> str:
        return str(self.header["type"])


def read(message: str | bytes) -> Received:
    if isinstance(message, str):
        return Received(json.loads(message))
    (length,) = struct.unpack("<I", message[:4])
    return Received(json.loads(message[4 : 4 + length]), message[4 + length :])


@dataclass
class Page:
    """A connection that acknowledges frames as it reads them."""

    socket: ClientConnection
    acknowledges: bool = True
    seen: list[Received] = field(default_factory=list)

    def send(self, type: str, **keys: Any) -> None:
        self.socket.send(json.dumps({"type": type, **keys}))

    def receive(self, timeout: float = ALIVE_WITHIN_S) -> Received:
        found = read(self.socket.recv(timeout))
        self.seen.append(found)
        if found.type == "frame" and self.acknowledges:
            self.send("ack", frame=found.header["frame"])
        return found

    def wait(self, wanted: Callable[[Received], bool], timeout: float = ALIVE_WITHIN_S) -> Received:
        """Return the first message from now on that is wanted."""
        end = time.monotonic() + timeout
        while True:
            found = self.receive(max(end - time.monotonic(), 0.001))
            if wanted(found):
                return found

    def answer(self, number: int) -> Received:
        """Return the message that answers a request."""
        return self.wait(lambda message: message.header.get("id") == number)

    def ask(self, number: int, type: str, **keys: Any) -> Received:
        """Return the answer to a message."""
        self.send(type, id=number, **keys)
        return self.answer(number)

    def frame(self, wanted: Callable[[dict[str, Any]], bool] = lambda header: True) -> Received:
        """Return the first frame that is wanted."""
        return self.wait(lambda message: message.type == "frame" and wanted(message.header))


@contextmanager
def serving(scene: Path, **options: Any) -> Iterator[tuple[Viewfinder, ViewServer]]:
    """A server in a thread of this process."""
    with Viewfinder(scene, **options) as finder:
        server = ViewServer(finder)
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        try:
            yield finder, server
        finally:
            server.stop()
            thread.join(10)


def opened(server: ViewServer, **options: Any) -> ClientConnection:
    """Return a connection that has said nothing yet."""
    here = f"127.0.0.1:{server.port}"
    given = {"origin": f"http://{here}", "compression": None, "max_size": None, "proxy": None, **options}
    return connect(f"ws://{here}/ws", **given)


@contextmanager
def page(server: ViewServer, token: str | None = None) -> Iterator[Page]:
    """A page that was let in."""
    with opened(server) as socket:
        client = Page(socket)
        client.send("hello", token=token or server.tokens.lasting, version=1)
        hello = client.wait(lambda message: message.type in ("hello", "error"))
        assert hello.type == "hello", hello.header
        yield client


@contextmanager
def serving_text(folder: Path, scene: str = SCENE) -> Iterator[ViewServer]:
    """A server of a scene that is written into a folder."""
    path = folder / "scene.yaml"
    path.write_text(scene)
    with serving(path) as (_, server):
        yield server


@contextmanager
def reset_page(server: ViewServer) -> Iterator[Page]:
    """A page before the scene as its file says it, with all samples."""
    with page(server) as client:
        client.ask(1, "time", do="record", on=False)
        client.ask(2, "reset")
        client.frame(at_rest)
        yield client


def at_rest(header: dict[str, Any]) -> bool:
    return bool(header["kind"] == "picture" and header["spp"] == 8 and header["scale"] == 1)


def left_alone(finder: Viewfinder, timeout: float = ALIVE_WITHIN_S) -> float:
    """Return how long it takes until a viewfinder without clients has freed the device [s]."""
    begun = time.monotonic()
    while finder.holds_device and time.monotonic() < begun + timeout:
        time.sleep(0.005)
    assert not finder.holds_device
    return time.monotonic() - begun
