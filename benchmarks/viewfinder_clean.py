"""How soon the picture of the viewfinder looks clean: what is shown a while after the last input, against the last one.

    python -m benchmarks.viewfinder_clean [--seconds 25] [--json FILE] [SCENE ...]

At 960x540, a plain WebSocket client in place of the page. After an f-number, a focus and an orbit, each from rest, the
picture that is there after 0.5, 1 and 2 s is compared with the one that has rested for so many seconds: by the mean
structural similarity of luminance (SSIM, Wang et al. 2004, sigma 1.5 pixels; 1 is equal), smaller pictures enlarged as
a browser does. *samples* are those of the picture after 1 s and of the last one. Another power of processor, and other
work beside it, change all of them.
"""

from __future__ import annotations

import io
import json
import os
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from websockets.sync.client import connect
from websockets.typing import Origin

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.viewfinder import ROOT, SIZE, viewing
from rptcam_cl.device.devices import choose_device

SCENES = ("examples/first_light.yaml", "examples/studio/evening.yaml", "examples/portrait.yaml")
AFTER_S = (0.5, 1.0, 2.0)
FIRST_S = 25.0  # for kernels and a first picture
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
INPUTS: dict[str, dict[str, Any]] = {
    "f_number": {"type": "dial", "name": "f_number", "value": 4.0},
    "focus_m": {"type": "dial", "name": "focus_m", "value": 1.2},
    "orbit": {"type": "move", "kind": "orbit", "dx": 0.05, "dy": 0.0},
}


def blurred(picture: NDArray[np.float64], sigma: float = 1.5) -> NDArray[np.float64]:
    """Return a picture under a Gaussian window of eleven pixels, without its margin."""
    weights = np.exp(-0.5 * (np.arange(-5, 6) / sigma) ** 2)
    weights /= weights.sum()
    rows, columns = picture.shape
    across = sum(w * picture[:, k : columns - 10 + k] for k, w in enumerate(weights))
    return np.asarray(sum(w * across[k : rows - 10 + k] for k, w in enumerate(weights)))


def ssim(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return the mean structural similarity of two pictures of codes, 0 to 255."""
    a, b = blurred(one), blurred(other)
    spread_a, spread_b = blurred(one**2) - a**2, blurred(other**2) - b**2
    together = blurred(one * other) - a * b
    steady, varied = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    top = (2 * a * b + steady) * (2 * together + varied)
    return float(np.mean(top / ((a**2 + b**2 + steady) * (spread_a + spread_b + varied))))


def seen(data: bytes) -> NDArray[np.float64]:
    """Return the luma of a picture as it is shown, at full size."""
    picture = Image.open(io.BytesIO(data)).convert("RGB").resize(SIZE, Image.Resampling.BILINEAR)
    return np.asarray(np.asarray(picture, np.float64) @ LUMINANCE)


def pictures(socket: Any, seconds: float, answers: int) -> list[tuple[float, dict[str, Any], bytes]]:
    """Take the pictures that come within so long and answer an input; return when each came, its header and data."""
    begun, found = time.perf_counter(), []
    while (left := begun + seconds - time.perf_counter()) > 0:
        try:
            message = socket.recv(left)
        except TimeoutError:
            break
        if isinstance(message, bytes):
            (length,) = struct.unpack("<I", message[:4])
            header = json.loads(message[4 : 4 + length])
            socket.send(json.dumps({"type": "ack", "frame": header["frame"]}))
            if header["kind"] == "picture" and (header["answers"] or 0) >= answers:
                found.append((time.perf_counter() - begun, header, message[4 + length :]))
    return found


def of_scene(device: str, scene: Path, seconds: float) -> list[dict[str, Any]]:
    """Return what is shown after each input: its SSIM, samples and scale by the time since the input."""
    rows = []
    with (
        viewing(None, device, SIZE, scene) as (_, port, token),
        connect(f"ws://127.0.0.1:{port}/ws", origin=Origin(f"http://127.0.0.1:{port}"), max_size=None) as socket,
    ):
        socket.send(json.dumps({"type": "hello", "id": 1, "token": token, "version": 1}))
        socket.send(json.dumps({"type": "view", "id": 2, "width": SIZE[0], "height": SIZE[1], "format": "png"}))
        pictures(socket, FIRST_S, 0)
        for number, (name, message) in enumerate(INPUTS.items(), 10):
            socket.send(json.dumps({"id": number, **message}))
            came = pictures(socket, seconds, number)
            last, row = seen(came[-1][2]), {"input": name, "load": os.getloadavg()[0], "last_spp": came[-1][1]["spp"]}
            for after in AFTER_S:
                _, header, data = max((each for each in came if each[0] <= after), default=came[0], key=lambda e: e[0])
                row[f"{after:g}"] = {"ssim": ssim(seen(data), last)} | {key: header[key] for key in ("scale", "spp")}
            rows.append(row)
    return rows


def main() -> None:
    """Measure and print."""
    parser = arguments("How soon the picture of the viewfinder looks clean.")
    parser.add_argument("--seconds", type=float, default=25.0, help="until the picture that others are compared with")
    parser.add_argument("scenes", nargs="*", type=Path, help=f"in place of {', '.join(SCENES)}")
    options = parser.parse_args()
    device = choose_device(options.device)
    facts, found = machine(device), {}
    print_machine(facts)
    scenes = options.scenes or [ROOT / name for name in SCENES[: 1 if options.quick else None]]
    for scene in scenes:
        found[scene.stem] = of_scene(device.id, scene.resolve(), 4.0 if options.quick else options.seconds)
    table = []
    for scene, rows in found.items():
        for row in rows:
            similar = (f"{row[f'{after:g}']['ssim']:.3f}" for after in AFTER_S)
            samples = f"{row['1']['spp']} at {row['1']['scale']:g}", str(row["last_spp"])
            table.append([scene, row["input"], *similar, *samples, f"{row['load']:.1f}"])
    columns = ("scene", "input", *(f"SSIM after {after:g} s" for after in AFTER_S), "samples after 1 s", "last", "load")
    print_table("What is shown after an input, against the picture at rest", columns, table)
    write_json(options.json, facts, found)


if __name__ == "__main__":
    main()
