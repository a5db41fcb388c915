"""The viewfinder as a widget of a notebook: its messages without a browser, and its page in one."""

import base64
import json
import queue
import re
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from rptcam_cl.core.errors import InputError
from rptcam_cl.viewfinder import notebook
from rptcam_cl.viewfinder.notebook import module_text, style_text
from tests.support.browsing import chromium, needs_chromium
from tests.viewfinder.page_client import SCENE

PING = json.dumps({"type": "ping"})
SOON = 30.0


class Messages(queue.Queue[tuple[dict[str, Any], list[bytes]]]):
    """What the widget has sent to its views."""

    def send(self, content: dict[str, Any], buffers: list[bytes] | None = None) -> None:
        self.put((content, buffers or []))

    def next(self, view: str, kind: str) -> dict[str, Any]:
        """The next text message of a type to a view."""
        until = time.monotonic() + SOON
        while time.monotonic() < until:
            content, _ = self.get(timeout=SOON)
            if content["view"] == view and "text" in content and json.loads(content["text"])["type"] == kind:
                return dict(json.loads(content["text"]))
        raise TimeoutError(kind)


@pytest.fixture
def widget(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Any, Messages]]:
    sent = Messages()
    monkeypatch.setattr("anywidget.AnyWidget.send", lambda self, content, buffers=None: sent.send(content, buffers))
    made = notebook.widget(yaml.safe_load(SCENE))
    yield made, sent
    made.close()


def say(widget: Any, content: dict[str, Any]) -> None:
    widget._handle_custom_msg(content, [])


def test_views_are_clients_that_come_with_their_first_message_and_go(widget: tuple[Any, Messages]) -> None:
    made, sent = widget
    for view in ("one", "two"):
        say(made, {"view": view, "text": PING})
        assert sent.next(view, "hello")["size"] == [48, 32]
    assert len(made.finder.clients()) == 2
    say(made, {"view": "one", "closed": True})
    assert len(made.finder.clients()) == 1
    say(made, {"view": "one", "text": PING})  # a view that was forgotten is greeted again
    assert sent.next("one", "hello")["client"] == 3


def test_frames_are_buffers(widget: tuple[Any, Messages]) -> None:
    made, sent = widget
    say(made, {"view": "one", "text": PING})
    until = time.monotonic() + SOON
    buffers: list[bytes] = []
    while not buffers and time.monotonic() < until:
        content, buffers = sent.get(timeout=SOON)
    length = int.from_bytes(buffers[0][:4], "little")
    assert content == {"view": "one"}
    assert json.loads(buffers[0][4 : 4 + length])["type"] == "frame"


def test_fifth_view_is_told_that_there_are_four(widget: tuple[Any, Messages]) -> None:
    made, sent = widget
    for view in "abcde":
        say(made, {"view": view, "text": PING})
    until = time.monotonic() + SOON
    gone = None
    while gone is None and time.monotonic() < until:
        content, _ = sent.get(timeout=SOON)
        gone = content.get("gone")
    assert content["view"] == "e"
    assert gone is not None and "4 pages" in gone


def test_silent_views_are_forgotten_when_another_comes(
    widget: tuple[Any, Messages], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, _ = widget
    say(made, {"view": "one", "text": PING})
    monkeypatch.setattr(notebook, "ALIVE_WITHIN_S", -1.0)
    say(made, {"view": "two", "text": PING})
    assert [client.number for client in made.finder.clients()] == [2]


@pytest.mark.parametrize(
    "content", [{}, {"view": 3, "text": PING}, {"view": "x" * 65, "text": PING}, {"view": "x", "text": 4}]
)
def test_what_is_no_message_is_left_alone(widget: tuple[Any, Messages], content: dict[str, Any]) -> None:
    made, _ = widget
    say(made, content)
    assert made.finder.clients() == []


def test_missing_anywidget_is_answered_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook._widget_class.cache_clear()
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(InputError, match=r"pip install 'rptcam_cl\[widget\]'"):
        notebook.widget(yaml.safe_load(SCENE))


def test_bundle_is_one_module_with_every_style() -> None:
    text = module_text()
    assert re.findall(r"^export .*", text, re.MULTILINE) == ["export default { render: module_widget.render };"]
    assert not re.search(r"^import ", text, re.MULTILINE)
    assert style_text().index(".vf {") < style_text().index("@container")


# How JupyterLab 4 lays out the output of cells, and where it hears keys: before the page in some programs, after it in
# others, unless what has the focus says that it wants them (jupyterlab/packages/outputarea/style/base.css; Lumino).
HOST = """() => {
    document.body.className = 'jp-OutputArea-output';
    const sheet = document.createElement('style');
    sheet.textContent = `
        .jp-OutputArea-output dl, .jp-OutputArea-output dt, .jp-OutputArea-output dd { display: block; }
        .jp-OutputArea-output dl { width: 100%; overflow: hidden; padding: 0; margin: 0; }
        .jp-OutputArea-output dt { font-weight: bold; float: left; width: 20%; padding: 0; margin: 0; }
        .jp-OutputArea-output dd { float: left; width: 80%; padding: 0; margin: 0; }`;
    document.body.append(sheet, Object.assign(document.createElement('textarea'), { id: 'cell' }));
    window.heard = [];
    const wanted = ({ target }) => target.hasAttribute('data-lm-suppress-shortcuts');
    document.addEventListener('keydown', (event) => wanted(event) || window.heard.push(event.key), true);
    document.addEventListener('keydown', (event) => window.heard.push(event.key));
}"""
LOADING = """async ([module, style]) => {
    const address = URL.createObjectURL(new Blob([module], {type: 'text/javascript'}));
    const { default: widget } = await import(address);
    const sheet = new CSSStyleSheet(); sheet.replaceSync(style); document.adoptedStyleSheets = [sheet];
    window.said = []; window.painted = 0; window.listeners = new Set();
    const model = {
        send: (content) => window.said.push(content),
        on: (_, listener) => window.listeners.add(listener),
        off: (_, listener) => window.listeners.delete(listener),
    };
    document.addEventListener('vf-painted', () => { window.painted += 1; }, true);
    window.leave = widget.render({ model, el: document.body });
}"""
DELIVERING = """([content, buffers]) => window.listeners.forEach((listen) => listen(content,
    buffers.map((text) => new DataView(Uint8Array.from(atob(text), (each) => each.charCodeAt(0)).buffer))))"""


@needs_chromium
def test_page_in_a_notebook_shows_the_picture(widget: tuple[Any, Messages]) -> None:
    made, sent = widget
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 700, "height": 700})
        page.evaluate(HOST)
        page.evaluate(LOADING, [module_text(), style_text()])
        until = time.monotonic() + SOON
        while not page.evaluate("window.painted") and time.monotonic() < until:
            for content in page.evaluate("window.said.splice(0)"):
                say(made, content)
            page.wait_for_timeout(20)
            while not sent.empty():
                content, buffers = sent.get()
                page.evaluate(DELIVERING, [content, [base64.b64encode(each).decode() for each in buffers]])
        assert page.evaluate("window.painted") > 0
        boxes = [page.locator(f"[data-reading={name}]").bounding_box() for name in ("scale", "spp", "ms", "noise")]
        assert len({box["y"] for box in boxes if box is not None}) == 1
        stage, dial = (page.locator(name).bounding_box() for name in (".vf-stage", "[data-dial=f_number]"))
        assert stage is not None and dial is not None and dial["y"] >= stage["y"] + stage["height"]
        page.locator("[data-dial=f_number]").click()  # as Playwright clicks, nothing may lie over it
        page.click(".vf-stage")
        for key in ("b", "x", "d", "]", "Enter"):
            page.keyboard.press(key)
        assert page.evaluate("window.heard") == []
        page.evaluate("window.said.length = 0")
        page.click("#cell")
        page.keyboard.type("z]")
        assert page.input_value("#cell") == "z]"
        assert not page.evaluate("window.said.filter(({text}) => /dial|overlays/.test(text)).length")
        page.evaluate("window.leave()")
        for content in page.evaluate("window.said.splice(0)"):
            say(made, content)
    assert made.finder.clients() == []
