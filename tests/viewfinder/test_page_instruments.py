"""The instruments of the page show what they say, in a real browser before the real server."""

import re

import pytest
from playwright.sync_api import Page

from tests.support.browsing import mean, needs_chromium, until

pytestmark = [
    pytest.mark.slow,
    needs_chromium,
]


def test_overlays_are_drawn_and_taken_away(page: Page) -> None:
    for key, layer in (("z", "zebra"), ("v", "false_colour"), ("p", "peaking")):
        page.keyboard.press(key)
        canvas = page.locator(f"[data-slot=A] canvas[data-layer='overlay/{layer}']")
        canvas.wait_for(state="visible")
        assert mean(page, layer=f"overlay/{layer}")[3] > 0
        page.keyboard.press(key)
        canvas.wait_for(state="hidden")


def test_false_colour_has_its_scale(page: Page) -> None:
    page.keyboard.press("v")
    assert page.locator(".vf-scale-key span").count() == 9
    page.keyboard.press("v")
    assert not page.locator(".vf-scale-key").is_visible()


def test_meter_reads_under_the_pointer_and_histogram_counts(page: Page) -> None:
    box = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.8 * box["height"])
    page.wait_for_selector(".vf-meter-tag:visible")
    assert re.search(r"EV \d.* cd/m²", page.inner_text(".vf-meter-tag"))
    assert page.locator(".vf-histogram .vf-area").count() == 4
    assert re.search(r"Clipped: (none|\d+)", page.inner_text(".vf-exposure figcaption"))


def test_lens_panel_draws_surfaces_rays_spot_and_mtf(page: Page) -> None:
    page.click("[data-tab=lens]")
    box = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 0.2 * box["height"])
    page.wait_for_selector(".vf-ray", state="attached", timeout=60_000)
    assert page.locator(".vf-surface").count() >= 10
    assert page.locator(".vf-stop").count() >= 1
    assert page.locator(".vf-pupil").count() == 2
    assert page.locator(".vf-spot-dot").count() > 20
    assert page.locator(".vf-line-tangential").count() == 1
    assert "Focal length" in page.inner_text("[data-name=lens-numbers]")


def test_magnifier_shows_pixels_one_to_one(page: Page) -> None:
    page.set_viewport_size({"width": 300, "height": 800})  # a film of 320 pixels in less
    page.wait_for_timeout(300)
    page.keyboard.press("x")
    until(page, "window.painted.some((each) => each.kind === 'magnifier')")
    drawn, shown = page.eval_on_selector(".vf-loupe canvas", "(canvas) => [canvas.width, canvas.clientWidth]")
    assert drawn == pytest.approx(shown, abs=0.5)
    for _ in ("5×", "10×", "off"):
        page.keyboard.press("x")
    assert not page.locator(".vf-loupe").is_visible()


def test_guides_are_drawn_and_kept(page: Page) -> None:
    page.click("[data-tab=guides]")
    for name in ("thirds", "centre", "safe", "circle"):
        page.click(f"[data-name={name}]")
    page.check("[data-name=aspect] input[value='2.39']")
    classes = page.eval_on_selector_all(
        "[data-slot=A] .vf-guides *", "all => all.map((each) => each.getAttribute('class')).join(' ')"
    )
    for drawn in ("vf-thirds", "vf-centre", "vf-safe", "vf-circle", "vf-mask"):
        assert drawn in classes
    assert "thirds" in page.evaluate("localStorage.getItem('rptcam-guides')")


def test_comparison_wipes_and_measures_the_difference(page: Page) -> None:
    page.click("[data-tab=compare]")
    page.click("[data-name=f8]")
    until(page, "window.painted.some((each) => each.slot === 'B')")
    assert page.locator(".vf-wipe").is_visible()
    page.focus(".vf-wipe")
    page.keyboard.press("Home")
    assert page.evaluate("document.querySelector('[data-slot=B]').style.clipPath") == "inset(0px 0px 0px 0%)"
    page.click("[data-name=difference]")
    until(page, "document.querySelector('[data-name=numbers]').children.length === 4")
    page.keyboard.press("c")
    page.wait_for_selector(".vf-wipe", state="hidden")


def test_traced_lens_is_compared_with_a_thin_one(page: Page) -> None:
    page.click("[data-tab=compare]")
    page.click("[data-name=thin_lens]")
    until(page, "window.painted.some((each) => each.slot === 'B' && !each.stale)")
    page.check("[data-name=compare] input[value=side]")
    page.wait_for_selector(".vf-wipe", state="hidden")
    places = [page.locator(f"[data-slot={slot}]").bounding_box() for slot in "AB"]
    assert places[0] != places[1]
