"""Take the screenshots of docs/viewfinder.md: the page before the real server, with every instrument at work.

Run in the folder above: python examples/show_viewfinder.py [PART_OF_A_NAME …]
It needs rptcam_cl[view], playwright and the system's Chromium.
"""

import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.server import ViewServer

SCENE = Path("examples/first_light.yaml")
FOLDER = Path("docs/images/viewfinder")
SIZE = (960, 540)
SAMPLES = 96  # that the picture has at least: hardly any grain
PAWN = (0.565, 0.6)
FOLLOWING = """document.addEventListener('vf-painted', ({detail}) => {
    if (detail.kind === 'picture') window.last = detail;
}, true);"""


def until(page: Page, holds: str, seconds: float = 180.0) -> None:
    """Wait until an expression of JavaScript holds."""
    end = time.monotonic() + seconds
    while not page.evaluate(holds):
        if time.monotonic() > end:
            raise TimeoutError(holds)
        page.wait_for_timeout(50)


def rest(page: Page) -> None:
    """Wait until the picture has its samples."""
    page.wait_for_timeout(500)
    until(page, f"window.last.scale > 0.99 && window.last.spp >= {SAMPLES}", 600.0)


def point(page: Page, x: float, y: float, *, click: bool = False) -> None:
    """Point at a place of the picture, in fractions of it."""
    box = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
    if click:
        page.mouse.down()
        page.mouse.up()


def press(page: Page, key: str) -> None:
    """Press a key with the focus nowhere, so that no ring is drawn around what has it."""
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press(key)


def view(page: Page) -> None:
    """The page as it opens."""


def keys(page: Page) -> None:
    """The sheet of keys."""
    page.keyboard.press("?")


def exposure(page: Page) -> None:
    """Zebra and the spot meter."""
    page.click("[data-tab=exposure]")
    press(page, "z")
    point(page, 0.62, 0.72)


def raw(page: Page) -> None:
    """The needle of the exposure meter in M, and the histogram of the sensor's numbers."""
    page.check("[data-dial=mode] input[value=M]")
    for _ in range(3):
        page.focus("[data-dial=shutter_s]")
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(2000)
    page.click("[data-tab=exposure]")
    page.wait_for_selector("[data-name=needle]:visible", timeout=60_000)
    page.wait_for_selector("[data-name=raw]:visible", timeout=60_000)
    point(page, 0.62, 0.72)


def false_colour(page: Page) -> None:
    """False colour."""
    page.click("[data-tab=exposure]")
    press(page, "v")


def focus(page: Page) -> None:
    """Autofocus at the gold pawn by contrast, with peaking and magnifier."""
    page.click("[data-tab=focus]")
    point(page, *PAWN, click=True)
    page.wait_for_selector(".vf-zone-found, .vf-zone-failed", timeout=60_000)
    page.select_option("[data-name=method]", "contrast")
    page.click("[data-name=zone]")
    page.click("[data-name=autofocus]")
    page.wait_for_selector(".vf-panel:visible .vf-dot", timeout=60_000)
    page.click("[data-name=peaking]")
    page.click("[data-name=magnifier]")
    page.evaluate("document.querySelector('.vf-tabpanel:not([hidden])').scrollTop = 0")
    point(page, *PAWN)


def lens(page: Page) -> None:
    """Rays of a pixel near the corner."""
    page.click("[data-tab=lens]")
    point(page, 0.93, 0.12)
    page.wait_for_selector(".vf-ray", state="attached", timeout=60_000)
    page.wait_for_timeout(500)


def guides(page: Page) -> None:
    """Thirds, safe frames and a mask."""
    page.click("[data-tab=guides]")
    for name in ("thirds", "centre", "safe"):
        page.click(f"[data-name={name}]")
    page.check("[data-name=aspect] input[value='2.39']")


def history(page: Page) -> None:
    """States and a snapshot, and a denoised picture of few samples."""
    page.click("[data-tab=history]")
    for key, times in (("]", 3), ("ArrowLeft", 2), ("b", 1), (")", 1)):
        for _ in range(times):
            press(page, key)
            page.wait_for_timeout(1200)
    page.wait_for_selector("[data-name=snapshots] img[src^='data:image/jpeg']")
    press(page, "ArrowUp")
    until(page, "window.last.denoised && window.last.scale > 0.99 && window.last.spp >= 2")
    press(page, " ")
    page.evaluate("document.querySelector('.vf-tabpanel:not([hidden])').scrollTop = 0")


def time_bar(page: Page) -> None:
    """A focus pull between two marks, recorded keys of the camera and the f-number."""
    page.click("[data-tab=time]")
    page.click("[data-name=mark-A]")
    for _ in range(6):
        press(page, "k")
    page.wait_for_timeout(1500)
    page.click("[data-name=mark-B]")
    page.click("[data-name=rack]")
    page.wait_for_timeout(800)
    press(page, "u")
    for _ in range(12):
        press(page, ">")
    page.wait_for_timeout(1500)
    press(page, "]")
    page.wait_for_timeout(1500)
    press(page, "u")
    page.evaluate("document.querySelector('.vf-tabpanel:not([hidden])').scrollTop = 0")


def light(page: Page) -> None:
    """A thing that was selected, with its dials, and a lamp that is muted."""
    page.check("[data-name=tool] input[value=select]")
    point(page, 0.565, 0.62, click=True)
    page.wait_for_selector("[data-dial=thing_x]:visible", timeout=60_000)
    page.click("[data-name='mute materials.key']")
    page.wait_for_timeout(1000)
    point(page, 0.565, 0.62)


def body(page: Page) -> None:
    """A kit, a body with one of its usual lenses, and a table of colours that lies beside the scene."""
    page.click("[data-tab=camera]")
    page.select_option("[data-dial=kit]", "reportage: biotar-58mm")
    until(page, "document.querySelector('[data-dial=body]').value === 'nikon_z6'")
    page.select_option("[data-dial=lut]", "evening.cube")
    page.wait_for_timeout(2000)
    page.locator("[data-dial=lut]").scroll_into_view_if_needed()
    page.evaluate("document.activeElement.blur()")


def stack(page: Page) -> None:
    """A focus stack that is rendered between two marks, and a bracket."""
    page.click("[data-tab=out]")
    page.check("[data-name=bracket] input[value='3x1']")
    page.click("[data-name=stack-near]")
    for _ in range(8):
        press(page, "k")
    page.wait_for_timeout(3000)
    page.click("[data-name=stack-far]")
    rest(page)
    page.click("[data-name=stack]")
    until(page, "document.querySelector('.vf-busy').textContent.includes('picture')")


def mix(page: Page) -> None:
    """Lamps that are kept apart, the key at a quarter and the candles four times as bright."""
    page.click("[data-tab=things]")
    page.click("[data-dial=mix]")
    page.wait_for_selector("[data-dial=mix_a]:visible", timeout=180_000)
    rest(page)
    for label, gain in (("Key", "0.25"), ("Candle", "4")):
        page.locator("[data-dial^=mix_]", has_text=label).first.focus()
        page.keyboard.press("Enter")
        page.keyboard.type(gain)
        page.keyboard.press("Enter")
        page.wait_for_timeout(1500)
    page.locator("[data-dial=mix]").scroll_into_view_if_needed()
    page.evaluate("document.activeElement.blur()")


def scopes(page: Page) -> None:
    """The parade, and the lights that photographers name."""
    page.check("[data-name=scope] input[value=parade]")
    page.select_option("[data-dial=white_balance]", "D75")


def vectorscope(page: Page) -> None:
    """The vectorscope."""
    page.check("[data-name=scope] input[value=vectorscope]")


def level(page: Page) -> None:
    """A camera that is not level."""
    page.click("[data-tab=guides]")
    page.click("[data-name=level]")
    file = Path(page.evaluate("window.sceneFile"))
    file.write_text(file.read_text("utf-8").replace("up: [0, 0, 1]", "up: [0.122, 0, 0.993]"), "utf-8")
    until(page, "!document.querySelector('[data-name=angles]').textContent.includes(' 0.0')")
    page.evaluate("document.activeElement.blur()")


def full(page: Page) -> None:
    """The picture alone, with frame lines."""
    page.click("[data-tab=guides]")
    page.check("[data-name=aspect] input[value='2.39']")
    page.click("[data-name=lines]")
    press(page, "h")


def compare(page: Page) -> None:
    """The traced lens against a thin one."""
    page.click("[data-tab=compare]")
    page.click("[data-name=thin_lens]")
    page.wait_for_selector(".vf-wipe:visible", timeout=60_000)
    page.click("[data-name=difference]")
    until(page, "document.querySelector('[data-name=numbers]').children.length > 0")


def narrow(page: Page) -> None:
    """A telephone."""
    page.set_viewport_size({"width": 360, "height": 780})


def error(page: Page) -> None:
    """An error in the scene file; `shoot` gives every picture a copy of its own."""
    file = Path(page.evaluate("window.sceneFile"))
    file.write_text(file.read_text("utf-8").replace("fill_light", "fill").replace("focus:", "focuss:"), "utf-8")
    page.wait_for_selector(".vf-fault:visible", timeout=10_000)


SHOTS: dict[str, Callable[[Page], None]] = {
    each.__name__: each
    for each in (
        view,
        keys,
        exposure,
        raw,
        false_colour,
        focus,
        lens,
        guides,
        history,
        time_bar,
        light,
        mix,
        body,
        stack,
        scopes,
        vectorscope,
        level,
        full,
        compare,
        narrow,
        error,
    )
}
# A table of colours: shadows a little bluer, lights a little warmer.
TABLE = "LUT_1D_SIZE 3\n0 0 0.06\n0.5 0.48 0.47\n1 0.96 0.84\n"
MORE = {"raw": "exposure: {mode: auto}\nsensor: {}\n"}  # of the scene


def shoot(browser: Browser, name: str, folder: Path) -> None:
    """Take one screenshot."""
    file = folder / SCENE.name
    file.write_text(SCENE.read_text("utf-8") + MORE.get(name, ""), "utf-8")
    (folder / "evening.cube").write_text(TABLE, "utf-8")
    with Viewfinder(file, size=SIZE) as finder:
        server = ViewServer(finder)
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.add_init_script(f"{FOLLOWING} window.sceneFile = {str(file)!r}")
        page.goto(server.address(server.tokens.lasting))
        until(page, "window.last !== undefined")
        SHOTS[name](page)
        if name != "history":  # which is paused while it is denoised
            rest(page)
        page.screenshot(path=FOLDER / f"{name}.jpg", type="jpeg", quality=86, full_page=name == "narrow")
        page.close()
        server.stop()
        thread.join(10)


def main(wanted: list[str]) -> int:
    """Take those whose name holds one of the wanted texts, or all; return the exit code."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        arguments = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        for name in SHOTS:
            if not wanted or any(part in name for part in wanted):
                print(name, flush=True)
                shoot(browser, name, Path(folder))
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
