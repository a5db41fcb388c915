"""The page in a real browser, in short: picture, dials, words of errors, keys, and its pure functions."""

from collections.abc import Iterator

import pytest
import yaml
from playwright.sync_api import Page

from rptcam_cl.viewfinder.engine import Viewfinder
from tests.support.browsing import chromium, mean, needs_chromium, reached, repeated, served, until, visited
from tests.viewfinder.page_client import SCENE

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def viewing() -> Iterator[tuple[Viewfinder, Page]]:
    with chromium() as browser, served(yaml.safe_load(SCENE)) as (finder, address), visited(browser, address) as page:
        yield finder, page


@pytest.fixture
def page(viewing: tuple[Viewfinder, Page]) -> Page:
    return viewing[1]


def test_page_shows_the_picture_and_what_it_is_worth(page: Page) -> None:
    assert mean(page)[3] == 255
    for reading in ("scale", "spp", "ms"):
        assert page.inner_text(f"[data-reading={reading}]") != "–"
    assert page.evaluate("location.hash") == ""  # the token leaves the address bar


def test_dial_that_is_turned_answers_with_a_picture(page: Page) -> None:
    before = page.inner_text("[data-dial=f_number] .vf-dial-value")
    page.keyboard.press("]")
    number = page.evaluate("window.sent.findLast((each) => each.type === 'dial' && each.name === 'f_number').id")
    until(page, f"window.painted.some((each) => each.answers >= {number})")
    until(page, f"document.querySelector('[data-dial=f_number]').ariaValueText !== {before!r}")


# 120 pixels of a trackpad, without a pause in which the hand would let go, however busy the machine is.
SLIDE = """(knob) => {
    for (let i = 0; i < 30; i++)
        knob.dispatchEvent(new WheelEvent('wheel', {deltaY: 4, bubbles: true, cancelable: true}));
}"""


def test_hand_brings_a_dial_to_where_it_turns_it(viewing: tuple[Viewfinder, Page]) -> None:
    """In short; all dials at all rates are in test_page_controls.py."""
    finder, page = viewing
    knob = page.locator("[data-dial=f_number]")

    def typed(text: str) -> None:
        knob.focus()
        page.keyboard.press("Enter")
        page.keyboard.type(text)
        page.keyboard.press("Enter")

    typed("f/2.8")
    reached(page, finder, "f_number", pytest.approx(2**1.5))
    page.focus(".vf-stage")
    repeated(page, lambda: page.keyboard.press("]"), 9, 8)
    reached(page, finder, "f_number", pytest.approx(8))
    knob.evaluate(SLIDE)
    reached(page, finder, "f_number", pytest.approx(2 ** (3 - 2 / 6)))
    typed("many")
    assert page.locator(".vf-dial-input").get_attribute("aria-invalid") == "true"
    page.keyboard.press("Escape")
    reached(page, finder, "f_number", pytest.approx(2 ** (3 - 2 / 6)))


PRESS = """(keys) => document.querySelector('.vf-stage').dispatchEvent(
    new KeyboardEvent('keydown', {bubbles: true, cancelable: true, ...keys}))"""


def test_keys_that_need_altgr_or_option_act_and_others_with_these_do_not(page: Page) -> None:
    page.evaluate("window.sent = []")
    page.evaluate(PRESS, {"key": "]", "ctrlKey": True, "altKey": True, "modifierAltGraph": True})  # Windows, German
    page.evaluate(PRESS, {"key": "]", "modifierAltGraph": True})  # X11
    page.evaluate(PRESS, {"key": "]", "altKey": True})  # macOS
    for other in ("altKey", "ctrlKey", "metaKey"):
        page.evaluate(PRESS, {"key": "v", other: True})
    page.evaluate(PRESS, {"key": "]", "ctrlKey": True})
    told = page.evaluate("window.sent.filter(({type}) => type !== 'pointer').map(({type, name}) => [type, name])")
    assert told == [["dial", "f_number"]] * 3


def test_keys_of_one_character_can_be_switched_off(page: Page) -> None:
    page.keyboard.press("?")
    page.click("[data-name=keys]")
    page.keyboard.press("Escape")
    page.focus(".vf-stage")
    page.evaluate("window.sent = []")
    for key in "z]5x ?":
        page.keyboard.press(key)
    assert page.evaluate("window.sent.filter(({type}) => type !== 'pointer')") == []
    assert not page.locator(".vf-help").is_visible()
    page.keyboard.press("ArrowRight")
    until(page, "window.sent.some(({type}) => type === 'move')")
    assert page.evaluate("localStorage.getItem('rptcam-keys')") == "off"
    page.click("[data-name=help]")
    page.click("[data-name=keys]")
    page.keyboard.press("Escape")
    page.focus(".vf-stage")
    for _ in range(2):
        page.keyboard.press("z")
    until(page, "window.sent.some(({overlays}) => overlays)")


def test_magnifier_shows_less_of_the_picture_and_so_many_times_as_large(page: Page) -> None:
    """The film of 48 pixels is shown larger than one to one, so that this is left out."""
    picture = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert picture is not None
    page.focus(".vf-stage")
    for times in (5, 10):
        page.keyboard.press("x")
        shown = "document.querySelector('.vf-loupe figcaption').textContent"
        until(page, f"{shown}.startsWith('{times}×')")
        program = "([canvas]) => canvas.clientWidth / canvas.width"
        pixel = page.eval_on_selector_all(".vf-loupe canvas", program)
        assert pixel == pytest.approx(times * picture["width"] / 48, rel=0.01)
    page.keyboard.press("x")
    assert not page.locator(".vf-loupe").is_visible()


def test_raw_files_are_offered_with_a_sensor_alone(page: Page) -> None:
    page.click("[data-tab=out]")
    offered = "[...document.querySelectorAll('[data-name=format] input')].filter((each) => each.checkVisibility())"
    until(page, f"{offered}.length === 3")
    assert page.evaluate(f"{offered}.map((each) => each.value)") == ["png", "jpeg", "exr"]


def test_silent_server_is_asked_and_then_taken_for_gone(page: Page) -> None:
    program = """async () => {
        const { Link } = await import('/link.js');
        const said = [];
        const link = new Link({ send: (text) => said.push(JSON.parse(text).type), silent: () => said.push('silent') });
        link.close(); // the test looks instead
        link.receive('{"type": "hello"}');
        link.look();
        link.heardAt -= 4000;
        link.look(); link.look();
        link.pingedAt -= 10000;
        link.heardAt -= 10000;
        link.look();
        link.receive('{"type": "done", "id": 0}');
        link.look();
        return said;
    }"""
    assert page.evaluate(program) == ["ping", "silent"]


def test_what_is_refused_is_said_in_words(page: Page) -> None:
    page.click("[data-tab=compare]")
    page.fill("[data-name=changes]", "camera.aparture = 3")
    page.click("[data-name=apply]")
    assert "aparture" in page.locator(".vf-toast-bad").inner_text()
    assert page.locator("[data-slot=B]").is_hidden()


def test_question_mark_opens_the_keys_and_escape_closes_them(page: Page) -> None:
    page.keyboard.press("?")
    assert page.locator(".vf-help").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator(".vf-help").is_visible()


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("2.8", "", 2.8),
        ("f/2.8", "", 2.8),
        ("ISO 400", "", 400),
        ("1/125", "s", 0.008),
        ("8 ms", "s", 0.008),
        ("0,5 s", "s", 0.5),
        ("65 cm", "m", 0.65),
        ("∞", "m", 1e6),
        ("50 mm", "mm", 50),
        ("5.5 cm", "mm", 55),
        ("5600 K", "K", 5600),
        ("−1", "EV", -1),
        ("-1⅔ EV", "EV", -5 / 3),
        ("+⅓", "EV", 1 / 3),
        ("±0 EV", "EV", 0),
        ("2 kg", "m", None),
        ("3 s", "m", None),
        ("1/0", "s", None),
        ("x", "", None),
        ("", "", None),
    ],
)
def test_typed_values_are_read_as_photographers_write_them(
    page: Page, text: str, unit: str, value: float | None
) -> None:
    found = page.evaluate("async ([text, unit]) => (await import('/numbers.js')).typed(text, unit)", [text, unit])
    assert found == (value if value is None else pytest.approx(value))


def test_two_pictures_lie_where_they_are_largest(page: Page) -> None:
    program = "async (size) => (await import('/stage.js')).places(...size, 2, 2)"
    wide, tall = (page.evaluate(program, size) for size in ([402, 100], [200, 202]))
    size = {"width": 200, "height": 100}
    assert wide == [{"x": 0, "y": 0, **size}, {"x": 202, "y": 0, **size}]
    assert tall == [{"x": 0, "y": 0, **size}, {"x": 0, "y": 102, **size}]


def test_ticks_are_round_and_within_the_ends(page: Page) -> None:
    program = "async (ends) => (await import('/plots.js')).ticks(...ends)"
    assert page.evaluate(program, [0, 1]) == pytest.approx([0, 0.5, 1])
    assert page.evaluate(program, [61, 70]) == pytest.approx([65, 70])


def test_changes_of_a_comparison_are_read_line_by_line(page: Page) -> None:
    program = "async (text) => (await import('/compare.js')).changesOf(text)"
    text = "camera.f_number = 8\n\ncamera.lens: tessar-100mm\nfilm.resolution = [8, 4]"
    changes = {"camera.f_number": 8, "camera.lens": "tessar-100mm", "film.resolution": [8, 4]}
    assert page.evaluate(program, text) == changes
    with pytest.raises(Exception, match="equals sign"):
        page.evaluate(program, "f/8 please")


def test_scopes_count_levels_by_column_and_colours_by_rec_709(page: Page) -> None:
    """Of a picture of 2 x 1: black and white; colours at 75 % lie where the matrix of BT.709 has them."""
    program = (
        "async () => [...(await import('/scopes.js')).columnCounts([0, 0, 0, 255, 255, 255, 255, 255], 2, (r) => r, 4)]"
    )
    assert page.evaluate(program) == [0, 1, 0, 0, 0, 0, 1, 0]
    program = "async (colour) => (await import('/scopes.js')).chroma(...colour)"
    for red, green, blue in ((191, 0, 0), (0, 191, 191), (90, 90, 90)):
        luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
        wanted = [(blue - luma) / (2 * (1 - 0.0722)) / 255, (red - luma) / (2 * (1 - 0.2126)) / 255]
        assert page.evaluate(program, [red, green, blue]) == pytest.approx(wanted, abs=1e-4)
