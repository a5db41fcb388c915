"""Random play by a script: whatever is turned, the server answers, makes no error of its own and keeps its memory."""

import gc
import os
import random
import time
from pathlib import Path
from typing import Any

import pytest

from rptcam_cl.core.files import give_back
from tests.viewfinder.page_client import SCENE, Page, page, serving

MINUTES = float(os.environ.get("RPTCAM_PLAY_MINUTES", "3"))
ROUNDS = 8  # at least; every one is the same play
BATCHES = 100  # of a round, with a page of its own for every fifth of them
WARM_UP = 2  # rounds after which every program has been built and nothing new is to be kept
DRIFT = 0.05
LENSES = ("dgauss-50mm", "wide-22mm", "achromat-100mm")


def bytes_kept() -> int:
    """What the process holds once it has let go of what is free: how scattered that lies differs from run to run."""
    gc.collect()
    give_back()
    return int(Path("/proc/self/statm").read_text("ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def some(dice: random.Random) -> tuple[str, dict[str, Any]]:
    """Return a message that a hand might send, now and then a foolish one."""
    place = {"x": dice.random(), "y": dice.random()}
    transient = dice.random() < 0.7
    turns: list[tuple[str, dict[str, Any]]] = [
        ("dial", {"name": "f_number", "value": dice.choice([2.8, 4, 5.6, 8, 11, 16]), "transient": transient}),
        ("dial", {"name": "focus_m", "value": dice.uniform(0.7, 3), "transient": transient}),
        ("dial", {"name": "mode", "value": dice.choice("MASP")}),
        ("dial", {"name": "ev", "value": dice.choice([-1, 0, 1])}),
        ("dial", {"name": "iso", "value": dice.choice([100, 400, 1600])}),
        ("dial", {"name": "shutter_s", "value": dice.choice([0.001, 0.01, 0.1])}),
        ("dial", {"name": "tone", "value": dice.choice(["srgb", "agx", "aces", "reinhard"])}),
        ("dial", {"name": "lens", "value": dice.choice(LENSES)}),
        ("dial", {"name": "f_number", "value": dice.choice(["x", -1, None, 1e9])}),
        ("move", {"kind": dice.choice(["orbit", "pan", "dolly", "walk", "tilt", "roll", "zoom"]),
                  "dx": dice.uniform(-0.2, 0.2), "dy": dice.uniform(-0.2, 0.2), "transient": transient}),
        ("reset", {"what": dice.choice(["camera", "all"])}),
        ("pointer", place),
        ("focus", place),
        ("magnify", {**place, "width": 16, "height": 16}),
        ("view", {"width": dice.choice([16, 48, 960]), "format": dice.choice(["jpeg", "webp", "png"]),
                  "overlays": {"zebra": dice.random() < 0.5, "peaking": dice.random() < 0.5},
                  "panels": ["histogram", "meter", "lens"]}),
        ("compare", {"mode": dice.choice(["off", "side", "wipe"]), "changes": {"camera.f_number": 8},
                     "difference": dice.random() < 0.5}),
        ("save", {"format": dice.choice(["png", "jpeg", "exr"]), "name": "play"}),
        ("scene", {}),
        ("command", {}),
        ("set", {"changes": {"materials.white.reflectance": [dice.random(), 0.5, 0.5]}, "transient": transient}),
        ("set", {"changes": {"no.such.key": 1}}),
        ("time", {"do": "go", "frame": dice.randint(1, 60), "playing": transient, "transient": transient}),
        ("time", {"do": dice.choice(["key", "unkey", "clear"]),
                  "channel": dice.choice(["camera", "focus", "f_number", "zoom", "exposure"])}),
        ("time", {"do": "record", "on": dice.random() < 0.5}),
        ("time", {"do": "rack", "from_m": dice.uniform(0.7, 3), "to_m": dice.uniform(0.7, 3), "seconds": 0.5}),
        ("select", dice.choice([place, {"name": "environment"}, {"name": "objects.0"}, {}])),
        ("dial", {"name": dice.choice(["thing_x", "thing_red", "thing_power"]), "value": dice.random()}),
        ("lamp", {"name": "environment", "mute": dice.random() < 0.2}),
        ("history", {"do": dice.choice(["undo", "redo", "snap"])}),
        ("add", {"what": dice.choice(["lamp", "card", "backdrop"])}),
        ("dial", {"name": "body", "value": dice.choice([None, "nikon_d850", "panasonic_gh5"])}),
        ("dial", {"name": "kit", "value": dice.choice([None, "cinema: retrofocus-35mm"])}),
        ("dial", {"name": "mix", "value": dice.random() < 0.5}),
        ("dial", {"name": dice.choice(["mix_a", "mix_b"]), "value": dice.uniform(0, 2), "transient": transient}),
        ("stack", dice.choice([{}, {"near_m": 0.8, "far_m": 1.2, "steps": 3, "pictures": transient}])),
    ]  # fmt: skip
    weights = [6, 6, 1, 1, 1, 1, 2, 1, 1, 12, 2, 8, 1, 1, 1, 1, 1, 1, 1, 2, 1, 6, 1, 0.5, 0.2, 1, 3, 1, 2, 0.1, 1]
    weights += [0.1, 0.3, 3, 0.2]  # kits, lamps apart and mixed, stacks
    return dice.choices(turns, weights)[0]


def play(client: Page, dice: random.Random, batches: int, number: int) -> int:
    """Send messages as a hand does, some at a time; every one is answered. Return the next number."""
    for _ in range(batches):
        batch = range(number, number + dice.randint(1, 20))
        waiting: dict[int, Any] = {}
        for number in batch:
            kind, keys = some(dice)
            client.send(kind, id=number, **keys)
            if kind not in ("pointer", "magnify"):
                waiting[number] = (kind, keys)
        number += 1
        while waiting:
            try:
                message = client.receive()
            except TimeoutError:
                last = [each.header for each in client.seen if each.type in ("busy", "compiling")][-2:]
                raise AssertionError(f"no word any more; without an answer: {waiting}; last signs: {last}") from None
            assert message.header.get("source") != "device", message.header
            assert "unexpected" not in message.header.get("message", ""), message.header
            waiting.pop(message.header.get("id", -1), None)
        client.seen.clear()
        if dice.random() < 0.2:
            client.send("view", quality=80)  # a picture is due then, also where the last messages have changed nothing
            client.frame()
    return number


@pytest.mark.slow
def test_random_play_makes_no_error_and_keeps_its_memory(tmp_path: Path) -> None:
    path = tmp_path / "ball.yaml"
    path.write_text(SCENE)
    number = 1000
    sizes: list[int] = []
    end = time.monotonic() + 60 * MINUTES
    with serving(path) as (finder, server):
        while len(sizes) < ROUNDS or time.monotonic() < end:
            dice = random.Random(1)
            for _ in range(5):
                with page(server) as client:
                    number = play(client, dice, BATCHES // 5, number)
            with page(server) as client:
                client.ask(number, "reset", what="all")
                number += 1
            sizes.append(bytes_kept())
        assert finder.holds_device or not finder.clients()
    print(f"{number - 1000} messages; MiB after each round: {[size // 2**20 for size in sizes]}")
    warm = sizes[WARM_UP:]
    middle = (len(warm) + 1) // 2
    assert max(warm[middle:]) < (1 + DRIFT) * max(warm[:middle])
