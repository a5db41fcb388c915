"""What takes long runs beside the frames: it is waited for by nobody, and a change that makes it obsolete ends it."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from playwright.sync_api import Browser

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.rendering.cameras.setting import lens_setting
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.controller import autofocus
from rptcam_cl.viewfinder import engine, requests
from rptcam_cl.viewfinder.background import Background, BackgroundTask
from tests.support.browsing import needs_chromium, served, settled, until, visited
from tests.support.cases import slow
from tests.viewfinder.page_client import SCENE, Page, at_rest, page, serving

WITHIN_S = 30.0


class Search:
    """In place of a search: it finds what one finds, but stays under way until it is let go."""

    def __init__(self) -> None:
        self.aimed, self.may_end, self.was_ended = threading.Event(), threading.Event(), threading.Event()
        self.fails = False
        self.moved_mm = 0.0

    def __call__(self, scene: Scene, device: Any, *, on_state: Any, on_probe: Any, **place: Any) -> Any:
        start = lens_setting(scene).film_distance_mm
        on_state(start + 0.5)
        self.aimed.set()
        try:
            while not self.may_end.wait(0.01):
                checkpoint()
        except BaseException:
            self.was_ended.set()
            on_state(start + 5.0)  # too late
            raise
        if self.fails:
            raise InputError("nothing there; the focus stays as it was")
        return autofocus(scene, "depth", point=(0.5, 0.5), device=device)


@pytest.fixture
def search(monkeypatch: pytest.MonkeyPatch) -> Search:
    found = Search()
    monkeypatch.setattr(requests, "focus_at", found)
    return found


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def client(scene_file: Path) -> Iterator[Page]:
    with serving(scene_file) as (_, server), page(server) as found:
        found.wait(lambda message: message.type == "state")
        found.frame(at_rest)
        yield found


def focus_m(client: Page) -> float:
    """The focus that the page is told last."""
    states = [message.header for message in client.seen if message.type == "state"]
    return next(float(dial["value"]) for dial in states[-1]["dials"] if dial["name"] == "focus_m")


def turned(client: Page, number: int, name: str, value: Any) -> None:
    client.send("dial", id=number, name=name, value=value)
    client.frame(lambda header: header["answers"] == number)


def test_dials_turn_during_a_search_which_goes_on(client: Page, search: Search) -> None:
    client.send("focus", id=900, x=0.5, y=0.5)
    client.wait(lambda message: message.type == "busy" and message.header["texts"] == ["focus search"])
    for number, tone in enumerate(("agx", "srgb"), 901):
        turned(client, number, "tone", tone)
    assert 900 not in [message.header.get("id") for message in client.seen]
    search.may_end.set()
    found = client.answer(900).header
    assert found["type"] == "focused"
    assert found["distance_m"] == pytest.approx(0.86, abs=0.02)  # of the sphere, to the film
    client.wait(lambda message: message.type == "busy" and "focus search" not in message.header["texts"])


def test_picture_follows_a_search(client: Page, search: Search) -> None:
    before = client.seen[-1].header["generation"]
    client.send("focus", id=910, x=0.5, y=0.5)
    client.frame(lambda header: header["generation"] > before)  # while the search is under way
    assert not search.may_end.is_set()
    search.may_end.set()
    client.answer(910)


@pytest.mark.parametrize(
    "message",
    [{"type": "dial", "name": "f_number", "value": 5.6}, slow({"type": "move", "kind": "orbit", "dx": 0.1})],
)
def test_change_of_the_camera_ends_a_search(client: Page, search: Search, message: dict[str, Any]) -> None:
    client.send("focus", id=920, x=0.5, y=0.5)
    assert search.aimed.wait(WITHIN_S)
    client.send(id=921, **message)
    answer = client.answer(920).header
    assert answer["type"] == "done" and answer["superseded"]
    client.frame(lambda header: header["answers"] == 921)
    assert search.was_ended.wait(WITHIN_S)
    turned(client, 922, "tone", "agx")
    client.wait(lambda message: message.type == "state" and message.header["answers"] == 922)
    assert focus_m(client) < 0.95  # by the first state of the search, and not by that which came too late
    assert focus_m(client) > 0.5


def test_focus_goes_back_where_a_search_fails(client: Page, search: Search) -> None:
    search.fails = True
    before = focus_m(client)
    client.send("focus", id=930, x=0.5, y=0.5)
    assert search.aimed.wait(WITHIN_S)
    search.may_end.set()
    answer = client.answer(930).header
    assert answer["type"] == "error" and "stays as it was" in answer["message"]
    turned(client, 931, "tone", "agx")
    client.wait(lambda message: message.type == "state" and message.header["answers"] == 931)
    assert focus_m(client) == before


@pytest.mark.slow
def test_another_click_takes_the_place_of_a_search(client: Page, search: Search) -> None:
    client.send("focus", id=940, x=0.5, y=0.5)
    assert search.aimed.wait(WITHIN_S)
    client.send("focus", id=941, x=0.4, y=0.5)
    assert client.answer(940).header["superseded"]
    search.may_end.set()
    assert client.answer(941).header["type"] == "focused"


# Workers alone.


def until_true(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + WITHIN_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture
def background() -> Iterator[Background]:
    made = Background(lambda: None)
    yield made
    assert made.close(WITHIN_S)


def task(work: Callable[[], Any], found: list[Any], text: str = "", key: Any = None) -> BackgroundTask:
    return BackgroundTask(text, lambda own: work(), found.append, found.append, key)


def test_jobs_of_a_worker_are_done_in_order_and_taken_over_by_who_asks(background: Background) -> None:
    found: list[Any] = []
    for number in range(3):
        background.worker("one").start(task(lambda number=number: number, found, f"task {number}"))
    assert background.texts == ["task 0", "task 1", "task 2"]
    assert found == []
    until_true(lambda: background.take() is None and len(found) == 3)
    assert found == [0, 1, 2]
    assert background.texts == []


def test_nothing_of_an_ended_job_is_taken_over(background: Background) -> None:
    found: list[Any] = []
    begun = threading.Event()

    def work(own: BackgroundTask) -> None:
        own.post(lambda: found.append("posted"))
        begun.set()
        while True:
            checkpoint()
            time.sleep(0.005)

    background.worker("one").start(BackgroundTask("", work, found.append, found.append, "key"))
    assert begun.wait(WITHIN_S)
    background.worker("one").start(task(lambda: "second", found, key="key"))
    until_true(lambda: background.take() is None and bool(found))
    assert found == ["second"]


def test_failure_is_taken_over_too(background: Background) -> None:
    found: list[Any] = []

    def fail() -> None:
        raise InputError("no")

    background.worker("one").start(task(fail, found))
    until_true(lambda: background.take() is None and bool(found))
    assert isinstance(found[0], InputError)


def test_workers_wait_at_their_checkpoints_while_they_are_held(background: Background) -> None:
    steps: list[int] = []
    found: list[Any] = []

    def work() -> str:
        for step in range(1000):
            checkpoint()
            steps.append(step)
            time.sleep(0.001)
            if len(steps) > 20:
                break
        return "done"

    background.hold(True)
    background.worker("one").start(task(work, found))
    time.sleep(0.1)
    assert steps == []
    background.hold(False)
    until_true(lambda: background.take() is None and bool(found))
    assert found == ["done"]


@pytest.mark.parametrize(
    ("timeout", "rests_in", "moves", "asked", "left", "held"),
    [
        (None, 0.25, False, False, 0.25, [True]),  # nothing to render: again once the hand has come to rest
        (0.0, 0.25, False, False, 0.0, [True]),  # there is more to render at once
        (1.0, 0.25, False, False, 0.25, [True]),
        (1.0, -0.1, False, False, 1.0, [False]),
        (None, 0.0, False, False, None, [False]),
        (0.0, 0.25, True, False, 0.0, []),  # a glance, or a message, comes first
        (1.0, 0.25, True, False, 0.25, [True]),  # a glance is wanted, and cannot come: paused, or no page takes it
        (None, 0.25, False, True, None, []),
    ],
)
def test_workers_wait_until_the_hand_has_come_to_rest(
    timeout: float | None, rests_in: float, moves: bool, asked: bool, left: float | None, held: list[bool]
) -> None:
    found: list[bool] = []
    slots = [SimpleNamespace(rests_in=lambda s=s: s, wants_glance=moves) for s in (rests_in, -1.0)]
    own: Any = SimpleNamespace(
        _studio=SimpleNamespace(slots=slots),
        _inbox=SimpleNamespace(is_empty=not asked),
        _background=SimpleNamespace(hold=found.append),
    )
    assert engine.Engine._let_workers_go_on(own, timeout) == left
    assert found == held


# In a browser.


@pytest.mark.slow
@needs_chromium
def test_page_says_what_runs_and_turns_dials_meanwhile(browser: Browser, scene_file: Path, search: Search) -> None:
    with served(scene_file) as (_, address), visited(browser, address) as shown:
        settled(shown)
        shown.click(".vf-frame[data-slot=A]")
        until(shown, "!document.querySelector('.vf-busy').hidden")
        assert search.aimed.wait(WITHIN_S)  # once its kernels are there
        before = shown.evaluate("window.painted.length")
        shown.focus(".vf-stage")
        shown.keyboard.press("]")  # the f-number, which ends the search
        until(shown, f"window.painted.length > {before}")
        assert search.was_ended.wait(WITHIN_S)
        until(shown, "!document.querySelector('.vf-busy').textContent.includes('focus search')")
        shown.click("[data-tab=focus]")
        until(shown, "document.body.textContent.includes('The search ended')")
