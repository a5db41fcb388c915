"""How fast the viewfinder answers in a real browser: from a key or a drag to the painted picture.

    python -m benchmarks.viewfinder_browser [--turns 40] [--json FILE]
    python -m benchmarks.viewfinder_browser --examples [--turns 4] [--json FILE] [SCENE ...]

`examples/first_light.yaml` at 960x540 before the system's Chromium without a window. *answer* is from the keydown event
that turns a dial, from rest, to the end of the frame of the screen that shows the new picture, by the browser's clock.
*drag* moves the pointer sixty times a second: pictures painted a second, and how old the movement is that they show.

With ``--examples``, the dials that all example scenes have, at 800x450 with every instrument on: zebra, peaking,
histogram, meter, and the panel of the lens. A key is pressed at a time of its own after the picture rests, between
0.1 and 1 s (the same times in every run). `p99` of all is the figure that docs/viewfinder.md states.
"""

from __future__ import annotations

import os
import random
import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, sync_playwright

from benchmarks.report import arguments, machine, print_machine, print_table, write_json
from benchmarks.viewfinder import REST_S, ROOT, SIZE, cpu_seconds, percentile, row, viewing
from rptcam_cl.core.errors import RptcamError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.scene.load import load_scene

KEYS = {"f_number": "][", "focus_m": "kj"}
EVERY_KEY = KEYS | {"ev": ")(", "iso": "';"}
INSTRUMENTS = ("[data-tab=exposure]", "[data-tab=lens]")  # tabs that stay open, so that their figures are made
LONGEST_MS = 150.0  # from an input to its answer
ALIVE_WITHIN_S = 60.0
REFUSED_AFTER_S = 5.0  # without a picture: the dial cannot be turned so in this scene, and says why
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
# A task that follows requestAnimationFrame runs when the frame has been painted.
WATCHING = """
window.sent = new Map(); window.painted = []; window.inputs = [];
const input = (event) => { window.inputAt = event.timeStamp; };
for (const kind of ['keydown', 'pointermove']) window.addEventListener(kind, input, true);
document.addEventListener('vf-sent', ({detail}) => window.sent.set(detail.id, window.inputAt), true);
document.addEventListener('vf-painted', ({detail}) => {
    if (detail.kind !== 'picture') return;
    const channel = new MessageChannel();
    channel.port1.onmessage = () => {
        const each = { answers: detail.answers, scale: detail.scale, at: performance.now(),
            input: window.sent.get(detail.answers) };
        window.painted.push(each);
        window.tellExpected?.(each);
    };
    channel.port2.postMessage(null);
}, true);
"""

EXPECTING = """([last, patience]) => {
    window.expected = new Promise((found) => {
        window.tellExpected = (each) => { if ((each.answers ?? 0) > last) found(each); };
        setTimeout(() => found(null), patience);
    });
}"""


def painted(page: Page) -> list[dict[str, Any]]:
    """Take what was painted since the last call."""
    found: list[dict[str, Any]] = page.evaluate("window.painted.splice(0)")
    return found


def rest(page: Page) -> None:
    """Let the picture come to full scale, and a little more."""
    end = time.monotonic() + ALIVE_WITHIN_S
    while time.monotonic() < end:
        page.wait_for_timeout(1e3 * REST_S)
        if page.inner_text("[data-reading=scale]") == "full":
            painted(page)
            return


def answers(page: Page, process: Any, keys: str, turns: int, first: int | None = None) -> list[dict[str, Any]]:
    """Return how long each press of a key took to be seen [ms], and at which scale.

    ``first`` is the number of a turn that follows others of other dials: the picture need not rest at full scale.
    """
    found = []
    for turn in range(turns) if first is None else (6 * first,):
        if first is None:
            rest(page)
        before, last = cpu_seconds(process), page.evaluate("Math.max(0, ...window.sent.keys())")
        page.evaluate(EXPECTING, [last, 1e3 * (ALIVE_WITHIN_S if first is None else REFUSED_AFTER_S)])
        page.keyboard.press(keys[turn // 6 % len(keys)])  # six clicks one way, then six back
        shown = page.evaluate("window.expected")  # looking again and again would take the processor from what is timed
        if shown is not None:
            cpu = 1e3 * (cpu_seconds(process) - before)
            found.append({"ms": shown["at"] - shown["input"], "scale": shown["scale"], "cpu": cpu})
    return found


def drag(page: Page, process: Any, seconds: float) -> dict[str, Any]:
    """Drag on the picture; return pictures a second, ages of what they show [ms] and their scales."""
    rest(page)
    box = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.keyboard.press("2")
    page.mouse.move(x, y)
    page.mouse.down()
    before, begun, step = cpu_seconds(process), time.monotonic(), 0
    while time.monotonic() < begun + seconds:
        step += 1
        page.mouse.move(x + 40 * (abs(step % 80 - 40) / 40), y)
        page.wait_for_timeout(1e3 / 60)
    took = time.monotonic() - begun
    shown = [each for each in painted(page) if each["input"] is not None]
    page.mouse.up()
    cpu = 1e3 * (cpu_seconds(process) - before) / max(len(shown), 1)
    ages = [each["at"] - each["input"] for each in shown]
    return {
        "frames_per_second": len(shown) / took, "ms": ages, "scales": [each["scale"] for each in shown], "cpu": cpu,
    }  # fmt: skip


def at_rest(page: Page, process: Any, turns: int, pauses: random.Random) -> list[dict[str, Any]]:
    """Return how long each press of a key took to be seen [ms], at which scale and load, for every dial there is."""
    found: list[dict[str, Any]] = []
    for turn in range(turns):
        for name, keys in EVERY_KEY.items():
            if not page.is_enabled(f"[data-dial={name}]"):
                continue
            page.wait_for_timeout(1e3 * pauses.uniform(0.1, 1.0))
            shown = answers(page, process, keys, 1, turn)
            found += [each | {"dial": name, "load": os.getloadavg()[0]} for each in shown]
    return found


def over_examples(device: str, turns: int, scenes: list[Path]) -> dict[str, list[dict[str, Any]]]:
    """Return the answers of the dials at rest by example scene, with every instrument on."""
    found: dict[str, list[dict[str, Any]]] = {}
    program, pauses = next(filter(None, map(shutil.which, CHROMIUM)), None), random.Random(1)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        for scene in scenes:
            with viewing(None, device, (800, 450), scene) as (process, port, token):
                page = browser.new_page(viewport={"width": 1184, "height": 670})
                page.add_init_script(WATCHING)
                page.goto(f"http://127.0.0.1:{port}/#{token}")
                page.wait_for_selector("[data-reading=scale]", timeout=1e3 * ALIVE_WITHIN_S)
                for tab in INSTRUMENTS:
                    page.click(tab)
                for key in "zp":
                    page.keyboard.press(key)
                rest(page)
                at_rest(page, process, 1, pauses)  # what the first turn of a dial finds out is kept
                found[str(scene.relative_to(ROOT))] = at_rest(page, process, turns, pauses)
                print(f"{scene.relative_to(ROOT)}: {len(found[str(scene.relative_to(ROOT))])} answers", flush=True)
                page.close()
        browser.close()
    return found


def is_scene(path: Path) -> bool:
    """Whether a file is a scene; examples have plans of data sets beside them."""
    try:
        load_scene(path)
    except RptcamError:
        return False
    return True


def print_examples(found: dict[str, list[dict[str, Any]]]) -> None:
    """Print the table of `over_examples`."""
    every = [each for answers in found.values() for each in answers]
    groups = found | {f"all, {dial}": [each for each in every if each["dial"] == dial] for dial in EVERY_KEY}
    rows = []
    for name, each in (groups | {"all": every}).items():
        if each:
            ms = [one["ms"] for one in each]
            cells = [f"{percentile(ms, share):.0f}" for share in (0.5, 0.95, 0.99)]
            late, cpu = sum(one > LONGEST_MS for one in ms), statistics.median(one["cpu"] for one in each)
            rows.append([name, str(len(ms)), *cells, str(late), f"{cpu:.0f}"])
    columns = ("scene", "answers", "p50, ms", "p95, ms", "p99, ms", f"over {LONGEST_MS:.0f} ms", "CPU, ms")
    print_table("From the key to the painted picture, at rest", columns, rows)
    if every:
        loads = [each["load"] for each in every]
        print(f"load average from {min(loads):.1f} to {max(loads):.1f}, median {statistics.median(loads):.1f}")


def measured(device: str, turns: int, seconds: float, size: tuple[int, int]) -> dict[str, Any]:
    """Return all that is measured."""
    found: dict[str, Any] = {}
    program = next(filter(None, map(shutil.which, CHROMIUM)), None)
    with (
        tempfile.TemporaryDirectory() as cache,
        viewing(Path(cache), device, size) as (process, port, token),
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        page = browser.new_page(viewport={"width": 1344, "height": 760})  # leaves 960 x 540 for the picture
        page.add_init_script(WATCHING)
        page.goto(f"http://127.0.0.1:{port}/#{token}")
        for name, keys in KEYS.items():
            answers(page, process, keys, 2)  # what the first turn of a dial finds out is kept
            found[name] = answers(page, process, keys, turns)
        found["drag"] = drag(page, process, seconds)
        browser.close()
    return found


def main() -> None:
    """Measure and print."""
    parser = arguments("How fast the viewfinder answers in a browser.")
    parser.add_argument("--turns", type=int, default=40, help="turns of each dial (default 40)")
    parser.add_argument("--examples", action="store_true", help="dials at rest in every example scene")
    parser.add_argument("scenes", nargs="*", type=Path, help="with --examples: these scenes alone")
    options = parser.parse_args()
    device = choose_device(options.device)
    facts = machine(device)
    print_machine(facts)
    if options.examples:
        scenes = [path.resolve() for path in options.scenes] or sorted((ROOT / "examples").rglob("*.yaml"))
        by_scene = over_examples(
            device.id, 1 if options.quick else options.turns, [each for each in scenes if is_scene(each)]
        )
        print_examples(by_scene)
        write_json(options.json, facts, by_scene)
        return
    found = measured(device.id, 3 if options.quick else options.turns, 1.0 if options.quick else 8.0, SIZE)
    rows = []
    for name in KEYS:
        cpu = statistics.median(each["cpu"] for each in found[name])
        rows.append(row(name, [each["ms"] for each in found[name]], [each["scale"] for each in found[name]], cpu))
    moved = found["drag"]
    rows.append(row("drag", moved["ms"], moved["scales"], moved["cpu"]))
    print_table("From the key to the painted picture", ("dial", "p50, ms", "p95, ms", "scale", "CPU, ms"), rows)
    print(f"{moved['frames_per_second']:.1f} pictures painted a second while dragging")
    write_json(options.json, facts, found)


if __name__ == "__main__":
    main()
