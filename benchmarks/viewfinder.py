"""How fast the viewfinder answers: the command itself, and a plain WebSocket client in place of the page.

    python -m benchmarks.viewfinder [--times 3] [--json FILE]

`examples/first_light.yaml` at 960x540. *first picture* is from the start of the command to the arrival of the first
frame, with empty and with filled caches of kernels. *answer* is from sending a dial's value to the arrival of the first
frame that shows it, from rest. *other kernels* is from sending a change that no compiled kernel fits, with the longest
time between two frames until it shows. *during a search* is the answer of the tone dial while autofocus searches.
*drag* moves the camera thirty times a second: frames that arrive a second, and how old the movement is that they show.
``CPU`` is the processor time of the server for each answer or frame.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from rptcam_cl.device.devices import choose_device
from rptcam_cl.viewfinder.engine import Viewfinder

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "examples" / "first_light.yaml"
SIZE = (960, 540)
REST_S = 0.3  # after the last frame of an answer, before the next dial
DIALS: dict[str, list[Any]] = {
    "f_number": [2.8, 4.0, 5.6, 8.0, 11.0],
    "focus_m": [0.6, 0.7, 0.9, 1.5, 4.0],
    "tone": ["agx", "aces", "reinhard", "srgb"],
}
ALIVE_WITHIN_S = 120.0
TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


class Client:
    """What the page does with the connection, without drawing."""

    def __init__(self, socket: ClientConnection, token: str) -> None:
        self._socket = socket
        self._last = self.generation = 0
        self.answered: set[int] = set()  # numbers of messages
        self.send(type="hello", token=token, version=1)
        self.send(type="view", width=SIZE[0], height=SIZE[1], panels=["histogram"])

    def send(self, **message: Any) -> int:
        """Send a message with a number of its own and return that."""
        self._last += 1
        self._socket.send(json.dumps({"id": self._last, **message} if message["type"] != "ack" else message))
        return self._last

    def frame(self, timeout: float = ALIVE_WITHIN_S) -> dict[str, Any] | None:
        """Return the header of the next picture, acknowledged; None when none comes in time."""
        end = time.perf_counter() + timeout
        while (left := end - time.perf_counter()) > 0:
            try:
                message = self._socket.recv(left)
            except TimeoutError:
                return None
            if isinstance(message, bytes):
                (length,) = struct.unpack("<I", message[:4])
                header: dict[str, Any] = json.loads(message[4 : 4 + length])
                self.send(type="ack", frame=header["frame"])
                if header["kind"] == "picture":
                    self.generation = header["generation"]
                    return header
            elif '"type":"error"' in message:
                raise RuntimeError(message)
            else:
                self.answered.add(json.loads(message).get("id"))
        return None

    def frame_that(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Return the first picture that is wanted."""
        while (header := self.frame()) is not None:
            if wanted(header):
                return header
        raise RuntimeError("the picture does not come")

    def answer(self, number: int) -> None:
        """Take in what comes until a message is answered."""
        end = time.perf_counter() + ALIVE_WITHIN_S
        while number not in self.answered:
            self.frame(REST_S)
            if time.perf_counter() > end:
                raise RuntimeError("no answer comes")

    def rest(self) -> None:
        """Take in what comes until little more does."""
        end = time.perf_counter() + REST_S
        while (left := end - time.perf_counter()) > 0:
            self.frame(left)


@contextmanager
def viewing(
    cache: Path | None, device: str, size: tuple[int, int], scene: Path = SCENE
) -> Iterator[tuple[subprocess.Popen[str], int, str]]:
    """Run the command, with caches in a folder or the user's; yield its process, its port and its token."""
    words = [sys.executable, "-m", "rptcam_cl", "view", str(scene), "--no-browser", "--device", device]
    folders = {} if cache is None else {"POCL_CACHE_DIR": str(cache / "pocl"), "XDG_CACHE_HOME": str(cache / "xdg")}
    words += ["--size", f"{size[0]}x{size[1]}"]
    process = subprocess.Popen(words, cwd=ROOT, env=os.environ | folders, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        place, _, token = address.partition("/#")
        yield process, int(place.rpartition(":")[2]), token
    finally:
        process.terminate()
        process.wait(30)


@contextmanager
def connected(port: int, token: str) -> Iterator[Client]:
    """Connect as the page does."""
    here = f"127.0.0.1:{port}"
    with connect(f"ws://{here}/ws", origin=f"http://{here}", compression=None, max_size=None, proxy=None) as socket:  # type: ignore[arg-type]
        yield Client(socket, token)


def copied(folder: Path) -> Path:
    """Return a copy of the scene, to be edited."""
    return Path(shutil.copy(SCENE, folder))


def cpu_seconds(process: subprocess.Popen[str]) -> float:
    """Return the processor time of a running process [s]; nan where the system does not say."""
    try:
        fields = Path(f"/proc/{process.pid}/stat").read_text("ascii").rpartition(")")[2].split()
    except OSError:
        return float("nan")
    return (int(fields[11]) + int(fields[12])) / TICKS


def first_pictures(device: str, size: tuple[int, int], times: int) -> dict[str, list[float]]:
    """Return the times to the first picture, cold and warm [s]."""
    found: dict[str, list[float]] = {"cold": [], "warm": []}
    for _ in range(times):
        with tempfile.TemporaryDirectory() as cache:
            for seconds in found.values():
                begun = time.perf_counter()
                with viewing(Path(cache), device, size) as (_, port, token), connected(port, token) as client:
                    client.frame_that(lambda header: True)
                    seconds.append(time.perf_counter() - begun)
    return found


def answers(client: Client, process: subprocess.Popen[str], name: str, times: int) -> list[dict[str, float]]:
    """Return how long each turn of a dial took to show, at which scale, and its processor time."""
    found = []
    values = DIALS[name]
    for turn in range(times):
        client.rest()
        before, begun = cpu_seconds(process), time.perf_counter()
        number = client.send(type="dial", name=name, value=values[turn % len(values)])
        shown = client.frame_that(lambda header, number=number: (header["answers"] or 0) >= number)  # type: ignore[misc]
        found.append(
            {
                "ms": 1e3 * (time.perf_counter() - begun),
                "scale": shown["scale"],
                "cpu": 1e3 * (cpu_seconds(process) - before),
            }
        )
    return found


def during_searches(client: Client, process: subprocess.Popen[str], turns: int) -> list[dict[str, float]]:
    """Return how long a dial took to show while autofocus was under way, once its kernels were there."""
    client.answer(client.send(type="autofocus", method="hybrid"))
    found: list[dict[str, float]] = []
    tones = DIALS["tone"]
    while len(found) < turns:
        client.rest()
        search = client.send(type="autofocus", method="hybrid")
        for turn in range(3):
            before, begun = cpu_seconds(process), time.perf_counter()
            number = client.send(type="dial", name="tone", value=tones[turn])
            shown = client.frame_that(lambda header, number=number: (header["answers"] or 0) >= number)  # type: ignore[misc]
            if search in client.answered:
                break
            ms, cpu = 1e3 * (time.perf_counter() - begun), 1e3 * (cpu_seconds(process) - before)
            found.append({"ms": ms, "scale": shown["scale"], "cpu": cpu})
        client.answer(search)
    return found


def other_kernels(client: Client) -> dict[str, float]:
    """Return how long a change that needs other kernels takes to show, and the longest time without a frame [ms]."""
    changes = {"render.sampler": "independent", "environment": {"kind": "constant", "radiance": [0.1, 0.1, 0.1]}}
    last = begun = time.perf_counter()
    number = client.send(type="set", changes=changes)
    longest, frames, shown = 0.0, 0, False
    while not shown:
        header = client.frame()
        if header is None:
            raise RuntimeError("the picture does not come")
        now = time.perf_counter()
        longest, last, frames = max(longest, now - last), now, frames + 1
        shown = (header["answers"] or 0) >= number
    return {"ms": 1e3 * (last - begun), "longest": 1e3 * longest, "frames": frames - 1}


def edit(client: Client, scene: Path) -> float:
    """Return how long an edit of the scene file takes until its picture arrives [ms]."""
    client.rest()
    edited = scene.with_name("edited.yaml")
    edited.write_text(scene.read_text("utf-8").replace("0.653", "0.7"), "utf-8")
    shown, begun = client.generation, time.perf_counter()
    edited.replace(scene)  # as editors do
    client.frame_that(lambda header: header["generation"] > shown)
    return 1e3 * (time.perf_counter() - begun)


def freed(device: str, size: tuple[int, int]) -> float:
    """Return how long the device is held after the last client has gone [ms]."""
    with Viewfinder(SCENE, device=device, size=size) as finder:
        client = finder.connect(lambda: None)
        while not any(isinstance(message, bytes) for message in client.outbox.take()):
            time.sleep(0.01)
        finder.disconnect(client)
        begun = time.perf_counter()
        while finder.holds_device:
            time.sleep(0.005)
        return 1e3 * (time.perf_counter() - begun)


def end(process: subprocess.Popen[str]) -> float:
    """Return how long the command takes to end after Ctrl-C [ms]."""
    begun = time.perf_counter()
    process.send_signal(signal.SIGINT)
    process.wait(ALIVE_WITHIN_S)
    return 1e3 * (time.perf_counter() - begun)


def drag(client: Client, process: subprocess.Popen[str], seconds: float, rate: float = 30.0) -> dict[str, Any]:
    """Move the camera so long; return frames a second, the ages of what they show [ms] and their scales."""
    client.rest()
    sent: dict[int, float] = {}
    ages, scales = [], []
    before, begun = cpu_seconds(process), time.perf_counter()
    following = begun
    while (now := time.perf_counter()) < begun + seconds:
        if now >= following:
            following += 1 / rate
            way = 0.002 if (now - begun) % 2 < 1 else -0.002
            sent[client.send(type="move", kind="orbit", dx=way, transient=True)] = now
        header = client.frame(max(following - time.perf_counter(), 0.001))
        if header is not None and header["answers"] in sent:
            ages.append(1e3 * (time.perf_counter() - sent[header["answers"]]))
            scales.append(header["scale"])
    took = time.perf_counter() - begun
    cpu = 1e3 * (cpu_seconds(process) - before) / max(len(ages), 1)
    return {"frames_per_second": len(ages) / took, "ms": ages, "scales": scales, "cpu": cpu}


def percentile(values: list[float], share: float) -> float:
    """Return the value that so large a share lies below, by the nearest rank."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def row(name: str, times: list[float], scales: list[float], cpu: float) -> list[str]:
    """Return the table row of some times [ms]."""
    if not times:
        return [name, "-", "-", "-", f"{cpu:.0f}"]
    spread = [f"{percentile(times, share):.0f}" for share in (0.5, 0.95)]
    return [name, *spread, f"{statistics.median(scales):g}", f"{cpu:.0f}"]


def measured(options: argparse.Namespace, device: str) -> dict[str, Any]:
    """Return all that is measured."""
    size = (64, 36) if options.quick else SIZE
    turns, seconds = (3, 0.5) if options.quick else (options.turns, 8.0)
    found: dict[str, Any] = {"first picture, s": first_pictures(device, size, 1 if options.quick else options.times)}
    with (
        tempfile.TemporaryDirectory() as cache,
        viewing(Path(cache), device, size, copied(Path(cache))) as (process, port, token),
        connected(port, token) as client,
    ):
        client.frame_that(lambda header: header["spp"] > 1)
        for name in DIALS:
            answers(client, process, name, 2)  # what the first turn of a dial finds out is kept
            found[name] = answers(client, process, name, turns)
        found["during a search"] = during_searches(client, process, turns)
        found["drag"] = drag(client, process, seconds)
        found["other kernels"] = other_kernels(client)
        found["edit, ms"] = edit(client, Path(cache) / SCENE.name)
        found["Ctrl-C, ms"] = end(process)
    found["freed, ms"] = freed(device, size)
    return found


def main() -> None:
    """Measure and print."""
    parser = arguments("How fast the viewfinder answers.")
    parser.add_argument("--times", type=int, default=3, help="cold and warm starts each (default 3)")
    parser.add_argument("--turns", type=int, default=40, help="turns of each dial (default 40)")
    options = parser.parse_args()
    device = choose_device(options.device)
    facts = machine(device)
    print_machine(facts)
    found = measured(options, device.id)
    starts = [[name, f"{statistics.median(s):.2f}"] for name, s in found["first picture, s"].items()]
    print_table("First picture, median", ("caches", "s"), starts)
    rows = []
    for name in (*DIALS, "during a search"):
        cpu = statistics.median(each["cpu"] for each in found[name])
        rows.append(row(name, [each["ms"] for each in found[name]], [each["scale"] for each in found[name]], cpu))
    moved = found["drag"]
    rows.append(row("drag", moved["ms"], moved["scales"], moved["cpu"]))
    print_table("From the dial to the picture", ("dial", "p50, ms", "p95, ms", "scale", "CPU, ms"), rows)
    print(f"{moved['frames_per_second']:.1f} frames a second while dragging")
    other = found["other kernels"]
    print(
        f"other kernels: {1e-3 * other['ms']:.1f} s until the change shows, {other['frames']} frames of the picture"
        f" before meanwhile, the longest time between two {other['longest']:.0f} ms"
    )
    print(f"an edit of the scene file shows after {found['edit, ms']:.0f} ms")
    print(f"the command has ended {found['Ctrl-C, ms']:.0f} ms after Ctrl-C")
    print(f"the device is free {found['freed, ms']:.0f} ms after the last page has gone")
    write_json(options.json, facts, found)


if __name__ == "__main__":
    main()
