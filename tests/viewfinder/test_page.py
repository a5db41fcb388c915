"""The page in a real browser, in short: picture, dials, words of errors, keys, and its pure functions."""

from collections.abc import Iterator

import pytest
import yaml
from playwright.sync_api import Page

from tests.support.browsing import CHROMIUM, chromium, mean, served, until, visited
from tests.viewfinder.page_client import SCENE

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as browser, served(yaml.safe_load(SCENE)) as (_, address), visited(browser, address) as page:
        yield page


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
    ("text", "value"),
    [
        ("2.8", 2.8),
        ("f/2.8", 2.8),
        ("1/125", 0.008),
        ("65 cm", 0.65),
        ("0,5 s", 0.5),
        ("∞", 1e6),
        ("−1", -1),
        ("x", None),
    ],
)
def test_typed_values_are_read_as_photographers_write_them(page: Page, text: str, value: float | None) -> None:
    found = page.evaluate("async (text) => (await import('/numbers.js')).typed(text)", text)
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
