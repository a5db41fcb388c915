"""Dials, movements and focus of the page do what they say, in a real browser before the real server."""

import re

import pytest
from playwright.sync_api import Page

from tests.support.browsing import CHROMIUM, mean, settled, until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]


def value(page: Page, dial: str) -> str:
    return page.inner_text(f"[data-dial={dial}] .vf-dial-value")


def dials(page: Page) -> set[str]:
    program = "all => all.filter((each) => each.checkVisibility()).map((each) => each.dataset.dial)"
    return set(page.eval_on_selector_all("[data-dial]", program))


def answered(page: Page, kind: str) -> None:
    """Wait for the picture that shows the last message of a kind."""
    until(page, f"window.sent.some((each) => each.type === '{kind}')")
    number = page.evaluate(f"window.sent.findLast((each) => each.type === '{kind}').id")
    until(page, f"window.painted.some((each) => each.answers >= {number})")


def test_every_dial_of_the_issue_is_there_with_a_label(page: Page) -> None:
    page.click("[data-tab=camera]")
    exposure = {"mode", "f_number", "shutter_s", "iso", "auto_iso", "ev", "lock"}
    assert exposure | {"focus_m", "lens", "stop", "white_balance", "tone", "format"} <= dials(page)
    unnamed = page.evaluate(
        """[...document.querySelectorAll('button, input, select, textarea, [role=slider]')]
        .filter((each) => each.checkVisibility()).filter((each) => !(each.ariaLabel || each.labels?.length
            || each.getAttribute('aria-labelledby') || each.textContent.trim())).map((each) => each.outerHTML)"""
    )
    assert unnamed == []


def test_f_number_dial_changes_the_picture_by_key_wheel_and_drag(page: Page) -> None:
    shown = [value(page, "f_number")]
    box = page.locator("[data-dial=f_number]").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.keyboard.press("]")
    answered(page, "dial")
    shown.append(value(page, "f_number"))
    page.mouse.move(x, y)
    page.mouse.wheel(0, -100)
    page.wait_for_timeout(600)
    shown.append(value(page, "f_number"))
    page.mouse.down()
    page.mouse.move(x + 40, y, steps=5)
    page.mouse.up()
    page.wait_for_timeout(400)
    shown.append(value(page, "f_number"))
    numbers = [float(text.removeprefix("f/")) for text in shown]
    assert numbers == sorted(set(numbers))


def test_lens_that_is_chosen_makes_another_picture(page: Page) -> None:
    before = mean(page)
    page.click("[data-tab=camera]")
    page.select_option("[data-dial=lens]", "tessar-100mm")
    answered(page, "dial")
    settled(page)
    assert max(abs(a - b) for a, b in zip(before, mean(page), strict=True)) > 2


def test_drags_and_keys_move_the_camera(page: Page) -> None:
    box = page.locator(".vf-stage").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for tool, kind in (("1", "tilt"), ("2", "orbit"), ("3", "pan"), ("4", "dolly")):
        page.keyboard.press(tool)
        page.evaluate("window.sent = []")
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 30, y + 20, steps=4)
        page.mouse.up()
        moves = page.evaluate("window.sent.filter((each) => each.type === 'move')")
        assert {each["kind"] for each in moves} == {kind}
        assert [each["transient"] for each in moves][-1] is False
        answered(page, "move")
    for key, kind in (("w", "walk"), ("ArrowLeft", "dolly"), ("+", "zoom")):
        page.evaluate("window.sent = []")
        page.keyboard.press(key)
        assert page.evaluate("window.sent[0].kind") == kind


def test_click_focuses_and_says_where(page: Page) -> None:
    page.click("[data-tab=focus]")
    box = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.15 * box["width"], box["y"] + 0.6 * box["height"])
    page.wait_for_selector(".vf-zone-found", timeout=60_000)
    words = page.locator(".vf-panel:visible p[role=status]").inner_text()
    assert re.search(r"\d cm|\d m", words.replace("\u00a0", " "))
    assert value(page, "focus_m") != "0.653 m"


def test_autofocus_draws_the_curve_of_its_search(page: Page) -> None:
    page.click("[data-tab=focus]")
    page.select_option("[data-name=method]", "contrast")
    page.click("[data-name=autofocus]")
    page.wait_for_selector(".vf-panel:visible .vf-plot .vf-dot", timeout=60_000)
    assert page.locator(".vf-panel:visible .vf-dot").count() > 4
