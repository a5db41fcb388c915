"""The viewfinder as a widget of a Jupyter notebook: the page's modules over the widget's messages."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.engine import TooManyClientsError, Viewfinder

# The page's modules and styles as one text each, for notebooks, which take no folder of files.

PAGE = Path(__file__).parent / "page"
_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([\w-]+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.MULTILINE)
_SHEET = re.compile(r'<link rel="stylesheet" href="([\w-]+\.css)">')


def _variable(module: str) -> str:
    return "module_" + module.replace("-", "_")


def _collect_modules(module: str, texts: dict[str, str]) -> None:
    """Add a module and, before it, those that it imports, to the texts by name."""
    if module in texts:
        return
    text = (PAGE / f"{module}.js").read_text("utf-8")
    for needed in _IMPORT.findall(text):
        _collect_modules(needed[1], texts)
    texts[module] = text


def _enclose(module: str, text: str) -> str:
    """Return a module as a function that is called at once, as names of two modules may be the same."""
    exported = ", ".join(_EXPORT.findall(text))
    inside = _EXPORT.sub("", _IMPORT.sub(lambda each: f"const {{{each[1]}}} = {_variable(each[2])};\n", text))
    return f"const {_variable(module)} = (() => {{\n{inside}\nreturn {{ {exported} }};\n}})();\n"


@cache
def module_text() -> str:
    """Return the widget's module with all that it imports, as anywidget takes it."""
    texts: dict[str, str] = {}
    _collect_modules("widget", texts)
    parts = [_enclose(name, text) for name, text in texts.items()]
    return "\n".join([*parts, f"export default {{ render: {_variable('widget')}.render }};\n"])


@cache
def style_text() -> str:
    """Return the page's styles in the order in which the page loads them."""
    names = _SHEET.findall((PAGE / "index.html").read_text("utf-8"))
    return "\n".join((PAGE / name).read_text("utf-8") for name in names)


# The widget, and its views as clients.

NEEDED = "the viewfinder in a notebook needs anywidget: pip install 'rptcam_cl[widget]'"
ALIVE_WITHIN_S = 150.0  # without a sign of life, which a view gives every 20 s and in a hidden tab every minute

Send = Callable[[dict[str, Any], list[bytes]], Any]


class Visitor:
    """One view of the widget as a client of the viewfinder.

    Parameters
    ----------
    finder
        What it looks through.
    view
        The name that the view has given itself.
    send
        Called from a thread with a message and its buffers.

    Raises
    ------
    TooManyClientsError
        There are four already.
    """

    def __init__(self, finder: Viewfinder, view: str, send: Send) -> None:
        self._finder, self._view, self._send = finder, view, send
        self._ready = threading.Event()
        self._ended = False
        self._client = finder.connect(self._ready.set)
        self.heard_at = time.monotonic()
        threading.Thread(target=self._deliver, name=f"viewfinder view {view}", daemon=True).start()

    def receive(self, text: str) -> None:
        """Take a message of the view."""
        self.heard_at = time.monotonic()
        self._finder.receive(self._client, text)

    def close(self) -> None:
        """Leave."""
        if not self._ended:
            self._ended = True
            self._finder.disconnect(self._client)
            self._ready.set()

    def _deliver(self) -> None:
        while True:
            self._ready.wait()
            self._ready.clear()
            if self._ended:
                return
            for message in self._client.outbox.take():
                try:
                    if isinstance(message, bytes):
                        self._send({"view": self._view}, [message])
                    else:
                        self._send({"view": self._view, "text": message}, [])
                except Exception:  # the kernel's connection is gone, whatever its kind: so is the view
                    self.close()
                    return


class Visitors:
    """The views of a widget, clients that come with their first message and go when they close or fall silent."""

    def __init__(self, finder: Viewfinder, send: Send) -> None:
        self._finder, self._send = finder, send
        self._all: dict[str, Visitor] = {}

    def receive(self, content: Mapping[str, Any]) -> None:
        """Take what a view sends: its name, and a message or that it closes."""
        view, text = content.get("view"), content.get("text")
        if not isinstance(view, str) or len(view) > 64:
            return
        if content.get("closed"):
            self._forget(view)
        elif isinstance(text, str):
            visitor = self._all.get(view) or self._welcome(view)
            if visitor is not None:
                visitor.receive(text)

    def close(self) -> None:
        """Send all away."""
        for view in list(self._all):
            self._forget(view)

    def _forget(self, view: str) -> None:
        visitor = self._all.pop(view, None)
        if visitor is not None:
            visitor.close()

    def _welcome(self, view: str) -> Visitor | None:
        silent_since = time.monotonic() - ALIVE_WITHIN_S
        for name, visitor in list(self._all.items()):
            if visitor.heard_at < silent_since:
                self._forget(name)
        try:
            self._all[view] = Visitor(self._finder, view, self._send)
        except TooManyClientsError as problem:
            self._send({"view": view, "gone": f"{problem}."}, [])
            return None
        return self._all[view]


class _Shown:
    """What the widget does beside being one; mixed into anywidget's class, which is imported when it is needed."""

    finder: Viewfinder
    _visitors: Visitors

    def _attach(self, finder: Viewfinder) -> None:
        self.finder = finder
        self._visitors = Visitors(finder, self.send)  # type: ignore[attr-defined]
        self.on_msg(lambda _, content, buffers: self._visitors.receive(content))  # type: ignore[attr-defined]

    def close(self) -> None:
        """Take the widget away and free the device."""
        if hasattr(self, "_visitors"):
            self._visitors.close()
            self.finder.close()
        super().close()  # type: ignore[misc]


@cache
def _widget_class() -> Any:
    try:
        import anywidget
    except ImportError as error:
        raise InputError(f"{NEEDED} (missing: {error.name})") from None
    members = {"_esm": module_text(), "_css": style_text(), "__module__": __name__, "__doc__": _Shown.__doc__}
    return type("ViewfinderWidget", (_Shown, anywidget.AnyWidget), members)


def widget(
    scene: Scene | str | Path | Mapping[str, Any], *, device: str | None = None, size: tuple[int, int] | None = None
) -> Any:
    """Return a widget that shows the viewfinder of a scene in a notebook.

    Parameters
    ----------
    scene
        A scene file, which is watched, or what else `load_scene` takes.
    device
        As ``--device`` on the command line.
    size
        Resolution [pixels] in place of the scene's.

    Returns
    -------
    anywidget.AnyWidget
        Its ``finder`` is the `Viewfinder`; its ``close()`` frees the device.

    Raises
    ------
    InputError
        anywidget is not installed, or the scene cannot be used.

    Examples
    --------
    >>> rptcam_cl.viewfinder.widget("examples/first_light.yaml")  # doctest: +SKIP
    """
    made = _widget_class()()
    made._attach(Viewfinder(scene, device=device, size=size))
    return made
