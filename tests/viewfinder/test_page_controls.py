"""Dials, movements and focus of the page do what they say, in a real browser before the real server."""

import re
import time
from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from rptcam_cl.viewfinder.engine import Viewfinder
from tests.support.browsing import mean, needs_chromium, reached, repeated, settled, standing, until

pytestmark = [
    pytest.mark.slow,
    needs_chromium,
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
    until(page, "document.querySelectorAll('.vf-panel .vf-dot').length > 4")  # drawn while the search goes on


STEP = 2 ** (1 / 3)  # a third of a stop of light
RATES = (3, 10, 30)  # [Hz]
# by dial: what is typed, the value that it means, the value so many steps on, and the keys that turn it from anywhere
HAND: dict[str, tuple[str, float, Callable[[float], float], str | None]] = {
    "f_number": ("4", 4.0, lambda n: 4 * STEP ** (n / 2), "[]"),
    "shutter_s": ("1/60", 2.0**-6, lambda n: 2.0**-6 * STEP**n, ",."),
    "iso": ("ISO 400", 400.0, lambda n: 400 * STEP**n, ";'"),
    "ev": ("−1⅓", -4 / 3, lambda n: (n - 4) / 3, "()"),
    "focus_m": ("65 cm", 0.65, lambda n: engraved(0.65, n), "jk"),
    "zoom": ("60 mm", 60.0, lambda n: zoomed(60.0, n), None),
    "blades": ("5", 5, lambda n: 5 + n, None),
    "temperature_k": ("5600 K", 5600.0, lambda n: 5600 + 50 * n, None),
}
LIMITS: dict[str, tuple[float, float]] = {}  # of focus and zoom, as the server has them


def engraved(metres: float, steps: float) -> float:
    """Return the mark so many marks beyond a distance between two: 96 on the focus scale, even in 1 / distance."""
    marks = [LIMITS["focus_m"][0] / (1 - k / 96) for k in range(96)]
    return [mark for mark in marks if mark > metres * (1 + 1e-3)][int(steps) - 1]


def zoomed(focal_mm: float, steps: float) -> float:
    """Return the focal length so many hundredths of the range beyond one between two."""
    low, high = LIMITS["zoom"]
    step = (high - low) / 100
    return low + step * (int((focal_mm - low) / step) + steps)


def typed(page: Page, name: str, text: str) -> None:
    page.focus(f"[data-dial={name}]")
    page.keyboard.press("Enter")
    page.keyboard.type(text)
    page.keyboard.press("Enter")


@pytest.mark.parametrize("name", HAND)
def test_every_dial_comes_to_where_a_hand_turns_it(page: Page, finder: Viewfinder, name: str) -> None:
    """Typed, by keys on it and from anywhere, by wheel, trackpad and drag, at the rates of hands."""
    text, start, on, keys = HAND[name]
    page.click("[data-tab=camera]")
    page.click("[data-dial=mode] input[value=M]")
    reached(page, finder, "mode", "M")
    LIMITS.update({dial: (found["min"], found["max"]) for dial, found in standing(finder).items() if "max" in found})
    knob = page.locator(f"[data-dial={name}]")
    box = knob.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def back() -> None:
        page.mouse.move(x, y)
        typed(page, name, text)
        reached(page, finder, name, pytest.approx(start, rel=1e-3))

    def press(key: str) -> Callable[[], None]:
        return lambda: page.keyboard.press(key)

    for hertz in RATES:
        back()
        repeated(page, press("ArrowRight"), 9, hertz)
        repeated(page, press("ArrowDown"), 2, hertz)
        reached(page, finder, name, pytest.approx(on(7), rel=1e-3))
        if keys is not None:
            back()
            page.focus(".vf-stage")
            repeated(page, press(keys[1]), 9, hertz)
            reached(page, finder, name, pytest.approx(on(9), rel=1e-3))
        back()
        repeated(page, lambda: page.mouse.wheel(0, -120), 5, hertz)
        reached(page, finder, name, pytest.approx(on(5), rel=1e-3))
        back()
        repeated(page, lambda: page.mouse.wheel(0, -4), 30, hertz)  # 120 pixels of a trackpad
        reached(page, finder, name, pytest.approx(on(2), rel=1e-3))
        back()
        page.mouse.down()
        for step in range(1, 5):
            page.mouse.move(x + 12 * step, y)
            page.wait_for_timeout(1e3 / hertz)
        page.mouse.up()
        reached(page, finder, name, pytest.approx(on(4), rel=1e-3))


@pytest.mark.parametrize("hertz", RATES)
def test_choices_and_switches_come_to_where_a_hand_puts_them(page: Page, finder: Viewfinder, hertz: float) -> None:
    page.click("[data-tab=camera]")
    page.click("[data-dial=mode] input[value=M]")
    reached(page, finder, "mode", "M")
    for key, name, count, value in (("m", "mode", 3, "P"), ("i", "auto_iso", 3, True), ("l", "lock", 2, False)):
        repeated(page, lambda key=key: page.keyboard.press(key), count, hertz)  # type: ignore[misc]
        reached(page, finder, name, value)
    for name in ("tone", "white_balance"):
        choices = [choice["value"] for choice in standing(finder)[name]["choices"]]
        at = choices.index(standing(finder)[name]["value"])
        page.focus(f"select[data-dial={name}]")
        repeated(page, lambda: page.keyboard.press("ArrowDown"), 2, hertz)
        reached(page, finder, name, choices[at + 2])
    page.click("[data-tab=exposure]")
    page.focus("[data-name=zebra_level]")
    repeated(page, lambda: page.keyboard.press("ArrowLeft"), 5, hertz)
    until(page, "window.sent.findLast((each) => each.zebra_level !== undefined).zebra_level === 0.9")
    page.focus(".vf-stage")
    repeated(page, lambda: page.keyboard.press("z"), 3, hertz)
    page.wait_for_selector("canvas[data-layer='overlay/zebra']:visible")
    repeated(page, lambda: page.keyboard.press(" "), 3, hertz)
    page.wait_for_selector(".vf-messages:has-text('Paused')")
    page.keyboard.press(" ")
    page.wait_for_selector(".vf-messages:has-text('Paused')", state="hidden")
    page.keyboard.press("z")


@pytest.mark.parametrize("hertz", RATES)
def test_camera_moves_by_all_that_a_hand_does(page: Page, finder: Viewfinder, hertz: float) -> None:
    start = standing(finder)["zoom"]["value"]
    box = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    repeated(page, lambda: page.mouse.wheel(0, -120), 5, hertz)
    reached(page, finder, "zoom", pytest.approx(start * 1.03**5))
    repeated(page, lambda: page.mouse.wheel(0, 4), 30, hertz)
    reached(page, finder, "zoom", pytest.approx(start * 1.03**3.8))
    page.evaluate("window.sent = []")
    page.click("[data-name=tool] input[value=orbit]")
    repeated(page, lambda: page.keyboard.press("ArrowRight"), 9, hertz)
    until(page, "window.sent.some((each) => each.type === 'move' && !each.transient)")
    assert page.evaluate(
        "window.sent.filter(({type, kind}) => type === 'move' && kind === 'orbit').reduce((sum, {dx}) => sum + dx, 0)"
    ) == pytest.approx(-0.18)


def test_arrows_after_a_click_on_a_choice_move_the_camera_and_after_a_key_the_choice(page: Page) -> None:
    for choice, value in (("tool", "orbit"), ("tool", "pan")):
        page.click(f"[data-name={choice}] input[value={value}]")
        page.evaluate("window.sent = []")
        page.keyboard.press("ArrowLeft")
        until(page, f"window.sent.some((each) => each.kind === '{value}')")
        assert page.is_checked(f"[data-name={choice}] input[value={value}]")
    page.click("[data-dial=mode] input[value=M]")
    page.click("[data-dial=mode] input[value=M]")  # chosen already
    page.evaluate("window.sent = []")
    page.keyboard.press("ArrowRight")
    until(page, "window.sent.some((each) => each.type === 'move')")
    assert page.is_checked("[data-dial=mode] input[value=M]")
    page.focus("[data-dial=mode] input[value=M]")
    page.keyboard.press("ArrowRight")  # who goes by keyboard chooses by arrows
    assert page.is_checked("[data-dial=mode] input[value=A]")


def test_temperature_begins_at_daylight(page: Page, finder: Viewfinder) -> None:
    page.click("[data-tab=camera]")
    page.focus("[data-dial=temperature_k]")
    assert value(page, "temperature_k") == "–"
    page.keyboard.press("ArrowRight")
    reached(page, finder, "temperature_k", 6500)
    page.keyboard.press("ArrowRight")
    reached(page, finder, "temperature_k", 6550)


def comes_true(page: Page, holds: Callable[[], bool], within_s: float = 30) -> None:
    """Assert that something holds before long."""
    end = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end
        page.wait_for_timeout(50)


def test_denoising_is_marked_and_switched_by_key_and_button(page: Page, finder: Viewfinder) -> None:
    page.keyboard.press("]")
    until(page, "!document.querySelector('.vf-denoised').hidden || window.painted.some((each) => each.denoised)")
    page.keyboard.press("n")
    until(page, "document.querySelector('[data-name=denoise]').getAttribute('aria-pressed') === 'false'")
    comes_true(page, lambda: not finder._studio.denoises)
    page.click("[data-tab=camera]")
    page.click("[data-name=denoise]")
    until(page, "document.querySelector('[data-name=denoise]').getAttribute('aria-pressed') === 'true'")
    comes_true(page, lambda: finder._studio.denoises)


def test_undo_redo_and_snapshots_by_keys_and_buttons(page: Page, finder: Viewfinder) -> None:
    before = value(page, "f_number")
    page.keyboard.press("]")
    answered(page, "dial")
    comes_true(page, lambda: value(page, "f_number") != before)
    after = value(page, "f_number")
    page.keyboard.press("Control+z")
    comes_true(page, lambda: value(page, "f_number") == before)
    page.keyboard.press("Control+Shift+Z")
    comes_true(page, lambda: value(page, "f_number") == after)
    page.click("[data-tab=history]")
    page.keyboard.press("b")
    page.wait_for_selector("[data-name=snapshots] img[src^='data:image/jpeg']")
    page.click("[data-name=undo]")
    comes_true(page, lambda: value(page, "f_number") == before)
    page.click("[aria-label^='Go to snapshot 1']")
    comes_true(page, lambda: value(page, "f_number") == after)
    page.click("[aria-label^='Compare with snapshot 1']")
    until(page, "window.painted.some((each) => each.slot === 'B')")
    page.keyboard.press("Control+z")  # the comparison
    page.evaluate("window.painted = []")
    page.click("[aria-label^='Compare with f number, as B']")
    until(page, "window.painted.some((each) => each.slot === 'B')")
    page.click("[aria-label^='Drop snapshot 1']")
    page.wait_for_selector("[data-name=snapshots] img", state="detached")
