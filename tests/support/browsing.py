"""A viewfinder's server in this process, and a real browser before it."""

import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, sync_playwright

from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.server import ViewServer

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine: apt-get install chromium")
WITHOUT_ALL_ELSE = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@contextmanager
def chromium() -> Iterator[Browser]:
    """The system's Chromium without a window, with a profile of its own."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=WITHOUT_ALL_ELSE)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def served(scene: Any, **options: Any) -> Iterator[tuple[Viewfinder, str]]:
    """A viewfinder of a scene and the address of its page."""
    with Viewfinder(scene, **options) as finder:
        server = ViewServer(finder)
        thread = threading.Thread(target=server.run, daemon=True)
        thread.start()
        try:
            yield finder, server.address(server.tokens.lasting)
        finally:
            server.stop()
            thread.join(10)


RECORDING = """
window.painted = []; window.sent = [];
document.addEventListener('vf-painted', (event) => window.painted.push({...event.detail, at: performance.now()}), true);
document.addEventListener('vf-sent', (event) => window.sent.push({...event.detail, at: performance.now()}), true);
"""


@contextmanager
def visited(browser: Browser, address: str, *, width: int = 1280, height: int = 800) -> Iterator[Page]:
    """The page at an address, once it shows a picture. What its console complains of is an error at the end."""
    context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
    context.add_init_script(RECORDING)
    page = context.new_page()
    complaints: list[str] = []

    def note(message: ConsoleMessage) -> None:
        if message.type == "error":
            complaints.append(message.text)

    page.on("console", note)
    page.on("pageerror", lambda problem: complaints.append(str(problem)))
    try:
        page.goto(address)
        until(page, "window.painted.length > 0")
        yield page
        assert not complaints, complaints
    finally:
        context.close()


def until(page: Page, holds: str, seconds: float = 60.0) -> None:
    """Wait until an expression of JavaScript holds. (Playwright's own way needs `eval`, which the page forbids.)"""
    end = time.monotonic() + seconds
    while not page.evaluate(holds):
        if time.monotonic() > end:
            raise TimeoutError(holds)
        page.wait_for_timeout(20)


def settled(page: Page) -> None:
    """Wait until the picture is of full scale and rests."""
    pictures = "window.painted.filter((each) => each.kind === 'picture' && each.slot === 'A')"
    until(page, f"(({{scale, moving, stale}}) => scale > 0.99 && !moving && !stale)({pictures}.at(-1))")


def mean(page: Page, slot: str = "A", layer: str = "picture") -> list[float]:
    """Return the mean red, green, blue and opacity of a layer of the picture, in codes."""
    found: list[float] = page.evaluate(
        """([slot, layer]) => {
        const canvas = document.querySelector(`[data-slot=${slot}] canvas[data-layer="${layer}"]`);
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        const sums = [0, 0, 0, 0];
        data.forEach((value, i) => { sums[i % 4] += value; });
        return sums.map((sum) => sum / (data.length / 4)); }""",
        [slot, layer],
    )
    return found


def repeated(page: Page, act: Callable[[], object], count: int, hertz: float) -> None:
    """Do the same so many times, at a rate that a hand has."""
    begun = time.monotonic()
    for number in range(count):
        act()
        page.wait_for_timeout(max(0.0, 1e3 * (begun + (number + 1) / hertz - time.monotonic())))


def standing(finder: Viewfinder) -> dict[str, Any]:
    """Return the dials by name as the server has them, from a client of its own."""
    client = finder.connect(lambda: None)
    try:
        end = time.monotonic() + 60
        while time.monotonic() < end:
            for message in client.outbox.take():
                if isinstance(message, str) and json.loads(message)["type"] == "hello":
                    return {dial["name"]: dial for dial in json.loads(message)["dials"]}
            time.sleep(0.01)
        raise TimeoutError("hello")
    finally:
        finder.disconnect(client)


def reached(page: Page, finder: Viewfinder, name: str, value: Any, seconds: float = 60.0) -> None:
    """Assert that a dial comes to a value, at the server and on the page, and stays there."""
    end = time.monotonic() + seconds
    while (found := standing(finder)[name])["value"] != value and time.monotonic() < end:
        page.wait_for_timeout(50)
    page.wait_for_timeout(400)
    found = standing(finder)[name]
    assert found["value"] == value, (name, found["value"])
    if found["kind"] == "number":
        text = found["text"].removeprefix(f"{found['label']} ")
        until(page, f"document.querySelector('[data-dial={name}]').ariaValueText === {json.dumps(text)}", seconds)
