"""Time, things and lamps, scopes and the full screen answer to a hand, in a real browser before the real server."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import yaml
from playwright.sync_api import Page

from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.panel import KITS
from tests.support.browsing import needs_chromium, reached, repeated, settled, standing, until
from tests.viewfinder.test_page_controls import answered, comes_true, typed, value

pytestmark = [
    pytest.mark.slow,
    needs_chromium,
]
ALIVE_MS = 60e3


def scene(finder: Viewfinder) -> dict[str, Any]:
    """The scene as it is saved, from a client of its own."""
    client, found = finder.connect(lambda: None), ""
    try:
        finder.receive(client, json.dumps({"type": "scene", "id": 1}))
        while not found:
            for message in client.outbox.take():
                if isinstance(message, str) and json.loads(message)["type"] == "scene":
                    found = json.loads(message)["yaml"]
    finally:
        finder.disconnect(client)
    data: dict[str, Any] = yaml.safe_load(found)
    return data


def keys(finder: Viewfinder, path: str) -> list[float]:
    """The frames that have keys of a key path."""
    found = scene(finder).get("sequence", {}).get("keys", {}).get(path, [])
    return [round(24 * each["time_s"] + 1, 6) for each in found]


def middle(page: Page, selector: str) -> tuple[float, float]:
    box = page.locator(selector).bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def words(page: Page, selector: str, holds: Callable[[str], bool]) -> None:
    comes_true(page, lambda: holds(page.inner_text(selector).replace("\u00a0", " ")))


@pytest.fixture
def time(page: Page, finder: Viewfinder) -> Page:
    page.click("[data-tab=time]")
    comes_true(page, lambda: keys(finder, "camera.focus.distance_m") == [])
    return page


def test_frame_is_scrubbed_by_drag_and_keys(time: Page) -> None:
    x, y = middle(time, "[data-name=frame]")
    box = time.locator("[data-name=frame]").bounding_box()
    assert box is not None
    time.mouse.move(box["x"] + 9, y)
    time.mouse.down()
    time.mouse.move(x, y, steps=6)
    time.mouse.up()
    answered(time, "time")
    words(time, "[data-name=frame-words]", lambda text: text.startswith("49 / 97 · 2 s"))
    repeated(time, lambda: time.keyboard.press(">"), 4, 10)
    repeated(time, lambda: time.keyboard.press("<"), 1, 10)
    words(time, "[data-name=frame-words]", lambda text: text.startswith("52 / 97"))
    time.fill("[data-name=frames]", "many")
    time.keyboard.press("Enter")
    assert time.get_attribute("[data-name=frames]", "aria-invalid") == "true"
    time.fill("[data-name=frames]", "60")
    time.keyboard.press("Enter")
    words(time, "[data-name=frame-words]", lambda text: text.startswith("52 / 60"))


def test_focus_pull_is_recorded_by_dragging_the_dial_while_it_plays(time: Page, finder: Viewfinder) -> None:
    before = value(time, "focus_m")
    time.keyboard.press("u")
    until(time, "document.querySelector('[data-name=record]').getAttribute('aria-pressed') === 'true'")
    x, y = middle(time, "[data-dial=focus_m]")
    time.mouse.move(x, y)
    time.keyboard.press("o")
    time.wait_for_timeout(300)
    time.mouse.down()
    for step in range(1, 9):
        time.mouse.move(x + 12 * step, y)
        time.wait_for_timeout(120)
    time.mouse.up()
    time.wait_for_timeout(200)
    time.click("[data-name=play]")
    comes_true(time, lambda: len(keys(finder, "camera.focus.distance_m")) > 3)
    pull = scene(finder)["sequence"]["keys"]["camera.focus.distance_m"]
    values = [each["value"] for each in pull]
    assert values == sorted(values)
    assert values[-1] > values[0]
    words(time, "[data-name=keys-focus]", lambda text: text.startswith(f"{len(pull)} keys"))
    until(time, "document.querySelectorAll('.vf-key-mark.vf-key-focus').length > 3")
    time.keyboard.press("u")
    time.keyboard.press("Control+z")
    comes_true(time, lambda: keys(finder, "camera.focus.distance_m") == [] and value(time, "focus_m") == before)


def test_keys_are_set_and_deleted_and_undone(time: Page, finder: Viewfinder) -> None:
    for name, path in (
        ("focus", "camera.focus.distance_m"),
        ("f_number", "camera.f_number"),
        ("exposure", "exposure.ev"),
    ):
        time.click(f"[data-name=key-{name}]")
        comes_true(time, lambda path=path: keys(finder, path) == [1])  # type: ignore[misc]
        words(time, f"[data-name=keys-{name}]", lambda text: text == "1 key, one here")
    time.click("[data-name=unkey-focus]")
    comes_true(time, lambda: keys(finder, "camera.focus.distance_m") == [])
    time.click("[data-name=clear-f_number]")
    comes_true(time, lambda: keys(finder, "camera.f_number") == [])
    time.keyboard.press("Control+z")
    comes_true(time, lambda: keys(finder, "camera.f_number") == [1])
    time.click("[data-name=key-camera]")
    comes_true(time, lambda: len(scene(finder)["camera"].get("motion", [])) == 1)
    time.click("[data-name=key-zoom]")
    words(time, "[data-name=keys-zoom]", lambda text: text == "1 key, one here")


def test_focus_is_pulled_between_two_marks(time: Page, finder: Viewfinder) -> None:
    assert time.is_disabled("[data-name=rack]")
    time.click("[data-name=mark-A]")
    repeated(time, lambda: time.keyboard.press("k"), 6, 10)
    answered(time, "dial")
    time.wait_for_timeout(500)
    time.click("[data-name=mark-B]")
    time.focus("[data-name=seconds]")
    time.keyboard.press("ArrowLeft")
    time.click("[data-name=rack]")
    comes_true(time, lambda: keys(finder, "camera.focus.distance_m") == pytest.approx(range(1, 20)))
    pull = [each["value"] for each in scene(finder)["sequence"]["keys"]["camera.focus.distance_m"]]
    assert pull == sorted(pull)


def at(page: Page, x: float, y: float) -> tuple[float, float]:
    box = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert box is not None
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def selected(page: Page) -> str:
    page.click("[data-name=tool] input[value=select]")
    page.mouse.click(*at(page, 0.13, 0.75))  # the red pawn in front
    until(page, "document.querySelector('[data-dial=thing_red]')?.checkVisibility()")
    return page.inner_text("[data-name=selected]")


def test_a_thing_is_selected_by_a_click_and_its_dials_come_to_where_a_hand_turns_them(
    page: Page, finder: Viewfinder
) -> None:
    title = selected(page)
    index = int(title.split()[-1]) - 1
    assert scene(finder)["objects"][index]["material"] == "red"
    before = scene(finder)
    typed(page, "thing_red", "0.4")
    reached(page, finder, "thing_red", 0.4)
    typed(page, "thing_x", "−10")
    reached(page, finder, "thing_x", pytest.approx(-10))
    x, y = middle(page, "[data-dial=thing_blue]")
    start = standing(finder)["thing_blue"]["value"]
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(1, 6):
        page.mouse.move(x + 12 * step, y)
        page.wait_for_timeout(60)
    page.mouse.up()
    reached(page, finder, "thing_blue", pytest.approx(start + 0.05))
    assert scene(finder)["materials"]["red"]["reflectance"] == pytest.approx([0.4, 0.045, start + 0.05])
    page.focus("[data-dial=thing_x]")
    repeated(page, lambda: page.keyboard.press("ArrowRight"), 4, 10)
    step = standing(finder)["thing_x"]["step"]
    reached(page, finder, "thing_x", pytest.approx(-10 + 4 * step))
    page.select_option("[data-dial=thing_material]", "gold")
    comes_true(page, lambda: scene(finder)["objects"][index]["material"] == "gold")
    for _ in range(8):
        page.keyboard.press("Control+z")
        page.wait_for_timeout(300)
    comes_true(page, lambda: scene(finder)["objects"] == before["objects"])
    assert scene(finder)["materials"] == before["materials"]
    page.click("[data-name=deselect]")
    until(page, "!document.querySelector('[data-dial=thing_red]').checkVisibility()")


def test_lamps_are_muted_shine_alone_and_are_selected_from_their_list(page: Page, finder: Viewfinder) -> None:
    page.click("[data-tab=things]")
    before = scene(finder)["materials"]
    page.click("[data-name='mute materials.key']")
    comes_true(page, lambda: scene(finder)["materials"]["key"]["radiance"] == [0, 0, 0])
    page.click("[data-name='solo materials.fill']")
    comes_true(page, lambda: scene(finder)["materials"]["candle"]["radiance"] == [0, 0, 0])
    assert scene(finder)["materials"]["fill"] == before["fill"]
    assert scene(finder)["environment"]["top"] == [0, 0, 0]
    page.click("[data-name='solo materials.fill']")
    comes_true(page, lambda: scene(finder)["materials"]["candle"] == before["candle"])
    page.keyboard.press("Control+z")
    comes_true(page, lambda: scene(finder)["materials"]["candle"]["radiance"] == [0, 0, 0])
    until(page, """document.querySelector("[data-name='solo materials.fill']").ariaPressed === 'true'""")
    page.keyboard.press("Control+z")
    page.wait_for_timeout(400)
    page.keyboard.press("Control+z")
    comes_true(page, lambda: scene(finder)["materials"] == before)
    page.click("[data-lamp='materials.key']")
    until(page, "document.querySelector('[data-dial=thing_power]')?.checkVisibility()")
    typed(page, "thing_power", "34")
    comes_true(page, lambda: scene(finder)["materials"]["key"]["radiance"] == pytest.approx([34, 28, 21]))
    page.focus("[data-dial=thing_power]")
    page.keyboard.press("ArrowLeft")
    reached(page, finder, "thing_power", pytest.approx(32))
    page.click("[data-name=deselect]")


def test_lamps_are_kept_apart_and_mixed_without_rendering_anew(page: Page, finder: Viewfinder) -> None:
    page.click("[data-tab=things]")
    page.click("[data-dial=mix]")
    page.wait_for_selector("[data-dial=mix_a]", timeout=ALIVE_MS)
    settled(page)
    before = scene(finder)["materials"]
    names = [name for name in standing(finder) if name.startswith("mix_")]
    assert [standing(finder)[name]["value"] for name in names] == [1.0] * len(names)
    page.evaluate("window.painted = []")
    for name in names:
        typed(page, name, "0.25")
        reached(page, finder, name, 0.25)
    page.focus("[data-dial=mix_a]")
    page.keyboard.press("ArrowRight")
    reached(page, finder, "mix_a", pytest.approx(2 ** (-5 / 3)))
    answered(page, "dial")
    assert page.evaluate("window.painted.every((each) => each.kind !== 'picture' || each.scale === 1)")
    assert scene(finder)["materials"] == before
    page.keyboard.press("Control+z")
    reached(page, finder, "mix_a", 0.25)
    page.click("[data-dial=mix]")
    until(page, "!document.querySelector('[data-dial=mix_a]').checkVisibility()")


def test_body_kit_and_table_of_colours_are_chosen_by_keys(page: Page, finder: Viewfinder) -> None:
    page.click("[data-tab=camera]")
    width = scene(finder)["film"].get("width_mm")
    for name in ("body", "kit", "lut"):
        choices = [choice["value"] for choice in standing(finder)[name]["choices"]]
        at = choices.index(standing(finder)[name]["value"])
        page.focus(f"select[data-dial={name}]")
        repeated(page, lambda: page.keyboard.press("ArrowDown"), 1, 1)
        reached(page, finder, name, choices[at + 1])
    assert scene(finder)["film"]["width_mm"] != width
    assert (standing(finder)["body"]["value"], standing(finder)["lens"]["value"]) == KITS[
        standing(finder)["kit"]["value"]
    ]
    assert scene(finder)["picture"]["lut"] == "swapped.cube"
    page.select_option("select[data-dial=format]", "full_frame")
    reached(page, finder, "body", None)


def test_scopes_are_of_the_picture_that_is_shown(page: Page) -> None:
    lit = """(canvas) => {
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        return data.filter((value, i) => i % 4 === 1 && value > 60).length; }"""
    for name, width in (("waveform", 256), ("parade", 768), ("vectorscope", 200)):
        page.click(f"[data-name=scope] input[value={name}]")
        canvas = page.locator("[data-name=scope-canvas]")
        assert canvas.evaluate("(each) => each.width") == width
        assert canvas.evaluate(lit) > 100
    page.keyboard.press("y")
    until(page, "document.querySelector('.vf-histogram').checkVisibility()")
    page.keyboard.press("y")
    until(page, "document.querySelector('[data-name=scope-canvas]').checkVisibility()")
    page.click("[data-name=scope] input[value=histogram]")


def test_light_is_chosen_by_the_names_of_photographers(page: Page, finder: Viewfinder) -> None:
    page.click("[data-tab=camera]")
    listed = page.locator("[data-dial=white_balance] option").all_inner_texts()
    assert listed[:6] == [
        "As it is", "Tungsten, 2900 K (A)", "Fluorescent, 4200 K (F2)", "Daylight, 5500 K (D55)",
        "Overcast, 6500 K (D65)", "Shade, 7500 K (D75)",
    ]  # fmt: skip
    page.select_option("[data-dial=white_balance]", label="Shade, 7500 K (D75)")
    reached(page, finder, "white_balance", "D75")
    page.keyboard.press("Control+z")
    reached(page, finder, "white_balance", "none")


def test_hyperfocal_distance_is_shown_by_the_dial_and_focused(page: Page, finder: Viewfinder) -> None:
    until(page, "document.querySelector('[data-dial=focus_m] .vf-dial-hint')?.textContent.startsWith('H')")
    page.click("[data-tab=focus]")
    page.click("[data-name=hyperfocal]")
    comes_true(page, lambda: standing(finder)["focus_m"]["value"] > 20)
    half = standing(finder)["focus_m"]["value"] / 2
    words(page, "[data-name=depth]", lambda text: f"sharp from {half:.1f} m" in text)
    page.keyboard.press("Control+z")
    reached(page, finder, "focus_m", pytest.approx(0.653))


def test_frame_lines_are_drawn_with_and_without_a_mask(page: Page) -> None:
    page.click("[data-tab=guides]")
    page.check("[data-name=aspect] input[value='0.8']")
    edge, picture = (page.locator(each).first.bounding_box() for each in (".vf-mask-edge", ".vf-frame[data-slot=A]"))
    assert edge is not None
    assert picture is not None
    assert edge["width"] / edge["height"] == pytest.approx(0.8, rel=0.02)
    assert edge["height"] == pytest.approx(picture["height"], abs=3)
    assert page.locator(".vf-mask").count() > 0
    page.click("[data-name=lines]")
    assert page.locator(".vf-mask").count() == 0
    assert page.locator(".vf-mask-edge").count() > 0
    page.click("[data-name=lines]")
    page.check("[data-name=aspect] input[value='']")


def test_panels_hide_and_the_picture_fills_the_screen_with_its_settings(page: Page) -> None:
    page.click("[data-tab=camera]")
    small = page.locator(".vf-frame[data-slot=A]").bounding_box()
    page.keyboard.press("h")
    until(page, "!document.querySelector('.vf-side').checkVisibility()")
    large = page.locator(".vf-frame[data-slot=A]").bounding_box()
    assert small is not None
    assert large is not None
    assert large["width"] > 1.2 * small["width"]
    before = page.inner_text("[data-name=evf]")
    assert "f/2" in before
    page.keyboard.press("]")
    until(page, f"document.querySelector('[data-name=evf]').innerText !== {before!r}")
    page.click("[data-name=panels]")
    until(page, "document.querySelector('.vf-side').checkVisibility()")
    page.keyboard.press("F")
    until(page, "document.fullscreenElement !== null && !document.querySelector('.vf-side').checkVisibility()")
    page.keyboard.press("F")
    until(page, "document.fullscreenElement === null && document.querySelector('.vf-side').checkVisibility()")


def test_a_bracket_is_saved_as_several_files(page: Page) -> None:
    page.click("[data-tab=out]")
    page.check("[data-name=bracket] input[value='3x1']")
    names: list[str] = []
    page.on("download", lambda file: names.append(file.suggested_filename))
    page.click("[data-name=save]")
    comes_true(page, lambda: len(names) == 3)
    stem = "first_light"
    assert sorted(names) == [f"{stem} minus 1 EV.png", f"{stem} plus 0 EV.png", f"{stem} plus 1 EV.png"]
    page.check("[data-name=bracket] input[value='1x0']")


@pytest.mark.slow
def test_a_stack_between_two_marks_is_saved_and_another_press_ends_it(page: Page, finder: Viewfinder) -> None:
    page.click("[data-tab=camera]")
    page.select_option("select[data-dial=body]", "sony_a7_iv")
    comes_true(page, lambda: scene(finder)["film"]["width_mm"] == 35.9)
    page.click("[data-tab=out]")
    assert page.is_disabled("[data-name=stack]")
    focus = "document.querySelector('[data-dial=focus_m]')"
    for name, by in (("near", -3), ("far", 6)):
        before = page.evaluate(f"{focus}.innerText")
        for _ in range(abs(by)):
            page.keyboard.press("j" if by < 0 else "k")
        until(page, f"{focus}.innerText !== {before!r}")
        page.wait_for_timeout(500)
        page.click(f"[data-name=stack-{name}]")
    files: list[str] = []
    page.on("download", lambda file: files.append(file.suggested_filename))
    page.click("[data-name=stack]")
    until(page, "document.querySelector('[data-name=stack]').innerText.startsWith('End')")
    page.click("[data-name=stack]")
    until(page, "document.querySelector('[data-name=stack]').innerText.startsWith('Stack')")
    page.click("[data-name=stack-each]")
    page.click("[data-name=stack]")
    comes_true(page, lambda: files == ["first_light stack.zip"], 240)


def directions(finder: Viewfinder) -> tuple[float, float]:
    """Where the camera looks: clockwise about z, and up [degrees]."""
    camera = scene(finder)["camera"]
    x, y, z = np.array(camera["target"]) - np.array(camera["eye"])
    return float(np.degrees(np.arctan2(x, y))), float(np.degrees(np.arctan2(z, np.hypot(x, y))))


def test_the_camera_is_turned_as_the_device_is(page: Page, finder: Viewfinder) -> None:
    page.evaluate("document.querySelector('[data-name=orientation]').hidden = false")
    page.click("[data-name=orientation]")
    around, up = directions(finder)
    for alpha, beta in ((10, 90), (7, 92), (4, 94)):  # upright in the hand; alpha is counter-clockwise
        angles = f"{{alpha: {alpha}, beta: {beta}, gamma: 0}}"
        page.evaluate(f"window.dispatchEvent(new DeviceOrientationEvent('deviceorientation', {angles}))")
        page.wait_for_timeout(200)
    page.wait_for_timeout(1000)
    assert directions(finder) == pytest.approx((around + 6, up + 4), abs=0.2)
    page.click("[data-name=orientation]")


def test_a_camera_that_is_not_level_is_straightened(page: Page, finder: Viewfinder) -> None:
    page.click("[data-tab=guides]")
    finder.receive(finder.clients()[-1], '{"type": "move", "kind": "roll", "dx": 0.5}')
    until(page, "document.querySelector('[data-name=angles]').textContent.includes('Turned by 5.0°')")
    page.click("[data-name=straighten]")
    until(page, "/Turned by -?0\\.0°/.test(document.querySelector('[data-name=angles]').textContent)")


def test_an_anamorphic_picture_is_shown_wider(page: Page) -> None:
    page.click("[data-tab=guides]")
    box = "document.querySelector('.vf-frame[data-slot=A]').getBoundingClientRect()"
    shape = f"{box}.width / {box}.height"
    before = page.evaluate(shape)
    page.check("[data-name=squeeze] input[value='2']", force=True)
    assert page.evaluate(shape) == pytest.approx(2 * before, rel=0.01)
    page.check("[data-name=squeeze] input[value='1']", force=True)
