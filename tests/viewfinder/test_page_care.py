"""What leaves the page, how it bears errors, narrow places and weak eyes, in a real browser before the real server."""

import io
import re
import threading
from pathlib import Path

import pytest
from PIL import Image
from playwright.sync_api import Browser, Page

from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.server import ViewServer
from tests.support.browsing import mean, needs_chromium, reached, served, standing, visited
from tests.viewfinder.conftest import SIZE

pytestmark = [
    pytest.mark.slow,
    needs_chromium,
]


TABS = ("camera", "exposure", "focus", "lens", "guides", "compare", "things", "time", "history", "out")
STARTS = {"png": b"\x89PNG", "jpeg": b"\xff\xd8", "exr": b"v/1\x01"}


@pytest.mark.parametrize(("form", "start"), STARTS.items())
def test_picture_is_saved_as_a_file(page: Page, tmp_path: Path, form: str, start: bytes) -> None:
    page.click("[data-tab=out]")
    page.check(f"[data-name=format] input[value={form}]")
    with page.expect_download(timeout=60_000) as waiting:
        page.click("[data-name=save]")
    data = Path(waiting.value.path()).read_bytes()
    assert data.startswith(start)
    if form == "png":
        assert Image.open(io.BytesIO(data)).size == SIZE


def test_raw_file_is_saved_of_a_scene_with_a_sensor(browser: Browser, scene_file: Path, tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(scene_file.read_text("utf-8") + "\nexposure: auto\nsensor: {}\n", "utf-8")
    with served(file, size=(64, 36)) as (_, address), visited(browser, address) as other:
        other.click("[data-tab=out]")
        other.check("[data-name=format] input[value=dng]")
        with other.expect_download(timeout=60_000) as waiting:
            other.click("[data-name=save]")
        assert Path(waiting.value.path()).read_bytes().startswith(b"II*\0")


def test_scene_and_command_leave_the_page(page: Page) -> None:
    page.click("[data-tab=out]")
    page.click("[data-name=command]")
    text = page.locator("[data-name=text]")
    text.wait_for(state="visible")
    assert text.input_value().startswith("rptcam render")
    with page.expect_download() as waiting:
        page.click("[data-name=yaml]")
    assert "camera:" in Path(waiting.value.path()).read_text("utf-8")


def test_every_panel_and_control_fits_into_360_pixels(browser: Browser, address: str) -> None:
    with visited(browser, address, width=360, height=740) as page:
        for tab in TABS:
            page.click(f"[data-tab={tab}]")
            assert page.evaluate("document.documentElement.scrollWidth") <= 360, tab
        small = page.evaluate(
            "[...document.querySelectorAll('button, [role=slider]')].filter((each) => each.checkVisibility())"
            ".map((each) => each.getBoundingClientRect()).filter(({width, height}) => width < 24 || height < 24).length"
        )
        assert small == 0  # WCAG 2.5.8


def test_error_in_the_scene_file_is_shown_with_its_line_until_it_is_mended(
    browser: Browser, scene_file: Path, tmp_path: Path
) -> None:
    file = tmp_path / "scene.yaml"
    good = scene_file.read_text("utf-8")
    file.write_text(good, "utf-8")
    with served(file, size=(64, 36)) as (_, address), visited(browser, address) as page:
        file.write_text(good.replace("metres_per_unit", "metres_per_unite"), "utf-8")
        page.wait_for_selector(".vf-fault:visible", timeout=60_000)
        assert "scene.yaml:3" in page.inner_text(".vf-fault")
        assert mean(page)[3] == 255  # the last good picture
        file.write_text(good, "utf-8")
        page.wait_for_selector(".vf-fault", state="hidden", timeout=60_000)


def test_page_says_over_the_picture_that_the_server_is_gone_and_comes_back(browser: Browser, scene_file: Path) -> None:
    with Viewfinder(scene_file, size=(64, 36)) as finder:
        first = ViewServer(finder)
        thread = threading.Thread(target=first.run, daemon=True)
        thread.start()
        context = browser.new_context()
        page = context.new_page()
        page.goto(first.address(first.tokens.lasting))
        page.wait_for_selector(".vf-link[data-state=open]")
        gone = page.locator(".vf-gone")
        assert not gone.is_visible()
        first.stop()
        thread.join(10)
        gone.wait_for(state="visible", timeout=60_000)
        assert "The server is gone" in gone.inner_text()
        box, stage = gone.bounding_box(), page.locator(".vf-stage").bounding_box()
        assert box == stage  # over all of the picture
        assert page.evaluate("document.querySelector('.vf-foot').inert && document.querySelector('.vf-side').inert")
        assert "no connection" in page.title()
        second = ViewServer(finder, port=first.port)
        second.tokens.lasting = first.tokens.lasting
        thread = threading.Thread(target=second.run, daemon=True)
        thread.start()
        gone.wait_for(state="hidden", timeout=60_000)
        assert not page.evaluate("document.querySelector('.vf-foot').inert")
        page.focus("[data-dial=f_number]")
        page.keyboard.press("End")
        reached(page, finder, "f_number", pytest.approx(standing(finder)["f_number"]["max"]))
        second.stop()
        thread.join(10)
        context.close()


def test_wrong_token_is_refused_in_words(browser: Browser, address: str) -> None:
    context = browser.new_context()
    page = context.new_page()
    page.goto(address.partition("#")[0] + "#" + "x" * 43)
    page.wait_for_selector(".vf-link[data-state=refused]", timeout=60_000)
    assert "token" in page.inner_text(".vf-link-words")
    context.close()


def luminance(colour: str) -> float:
    parts = [int(number) / 255 for number in re.findall(r"\d+", colour)[:3]]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_all_text_has_the_contrast_of_wcag_aa(page: Page) -> None:
    """4.5 to 1 against the ground it stands on; WCAG 2.2, 1.4.3."""
    program = """() => [...document.querySelectorAll('.vf *')]
        .filter((each) => each.checkVisibility() && !each.closest('svg, .vf-frame, .vf-over'))
        .filter((each) => [...each.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim()))
        .map((each) => {
            const ground = (element) => getComputedStyle(element).backgroundColor;
            let behind = each;
            while (ground(behind) === 'rgba(0, 0, 0, 0)') behind = behind.parentElement;
            return [each.textContent.trim().slice(0, 30), getComputedStyle(each).color, ground(behind)];
        })"""
    poor = {}
    for tab in TABS:
        page.click(f"[data-tab={tab}]")
        for text, ink, ground in page.evaluate(program):
            low, high = sorted((luminance(ink), luminance(ground)))
            if (high + 0.05) / (low + 0.05) < 4.5:
                poor[text] = (ink, ground)
    assert poor == {}


@pytest.mark.parametrize("width", [1280, 400])
def test_axe_finds_nothing(browser: Browser, address: str, width: int) -> None:
    """Deque's axe-core (`pip install axe-playwright-python`) in every tab. What it leaves open of contrast, where one
    element scrolls under another, is not counted."""
    axe = pytest.importorskip("axe_playwright_python").__path__[0]
    with visited(browser, address, width=width) as page:
        page.evaluate((Path(axe) / "axe.min.js").read_text("utf-8"))
        for tab in TABS:
            page.click(f"[data-tab={tab}]")
            page.wait_for_timeout(500)
            found = page.evaluate("axe.run(document, {resultTypes: ['violations', 'incomplete']})")
            faults = [each["id"] for each in found["violations"]]
            faults += [each["id"] for each in found["incomplete"] if each["id"] != "color-contrast"]
            assert not faults, f"{tab}: {faults}"
