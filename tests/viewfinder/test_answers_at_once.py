"""An input at rest is answered whatever is under way for the picture that was there before it."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.session import Frame, RenderSession
from rptcam_cl.core.remember import checkpoint
from rptcam_cl.viewfinder.delivery import Delivery
from rptcam_cl.viewfinder.messages import Client, ClientSettings
from rptcam_cl.viewfinder.slot import Slot
from tests.viewfinder.page_client import ALIVE_WITHIN_S, SCENE, Page, page, serving


@pytest.fixture
def client(tmp_path: Path) -> Iterator[Page]:
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE.replace("spp: 8", "spp: 100000"))
    with serving(path) as (_, server), page(server) as found:
        found.frame(lambda header: header["spp"] >= 2)
        yield found


def turned(client: Page, number: int, name: str, value: Any) -> dict[str, Any]:
    """Turn a dial and return the header of the picture that answers it."""
    client.send("dial", id=number, name=name, value=value)
    return client.frame(lambda header: header["kind"] == "picture" and header["answers"] == number).header


def meanwhile(client: Page, event: threading.Event) -> None:
    """Wait for what the engine does, as a page that takes its frames: for one that takes none it stops."""
    end = time.monotonic() + ALIVE_WITHIN_S
    while not event.is_set():
        assert time.monotonic() < end
        with suppress(TimeoutError):
            client.receive(0.02)


def test_samples_end_with_an_input_and_a_dial_that_changes_no_picture_shows_the_one_that_is_there(
    client: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = threading.Event()

    def add(session: RenderSession, samples: int, should_stop: Callable[[], bool]) -> bool:
        begun.set()
        while not should_stop():  # a take without end
            time.sleep(0.002)
        return False

    monkeypatch.setattr(RenderSession, "add", add)
    meanwhile(client, begun)
    shown = [turned(client, number, "iso", iso) for number, iso in ((800, 800), (801, 400), (802, 800))]
    assert len({(header["generation"], header["spp"]) for header in shown}) == 1  # no film but the one that was there
    assert turned(client, 803, "f_number", 5.6)["generation"] > shown[0]["generation"]


def test_the_plan_of_a_film_ends_with_an_input(client: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def plan(session: RenderSession) -> Any:
        begun.set()
        while True:  # a plan without end
            checkpoint()
            time.sleep(0.002)

    monkeypatch.setattr(RenderSession, "_film_plan", plan)
    turned(client, 810, "f_number", 5.6)
    meanwhile(client, begun)
    turned(client, 811, "f_number", 8.0)
    turned(client, 812, "tone", "agx")


def test_denoising_ends_with_an_input_and_its_picture_comes_afterwards(
    client: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, asked = threading.Event(), threading.Event()

    def denoised(session: RenderSession, frame: Frame) -> None:
        while frame.scale == 1 and frame.spp > 1 and not asked.is_set():  # denoising without end, of the film
            begun.set()
            checkpoint()
            time.sleep(0.002)

    monkeypatch.setattr(RenderSession, "denoised", denoised)
    turned(client, 820, "f_number", 5.6)
    meanwhile(client, begun)
    client.ask(821, "compare", mode="off")  # which changes no picture
    asked.set()
    client.frame(lambda header: header["spp"] > 1)


def test_a_glance_in_another_exposure_takes_no_ray(monkeypatch: pytest.MonkeyPatch) -> None:
    with rptcam_cl.RenderSession(SCENE_DATA, wait=False) as session:
        slot = Slot("A", session, {})
        slot.show(slot.glance(), False, {})
        before = slot.shown
        monkeypatch.setattr(RenderSession, "glance", lambda *_: pytest.fail("a glance was rendered"))
        slot.change({"exposure.ev": 2})
        assert slot.wants_showing and not slot.wants_glance
        slot.show(slot.again(), False, {})
        assert before is not None and slot.shown is not None and before.frame.scale < 1
        np.testing.assert_allclose(slot.shown.frame.pixels, 4 * before.frame.pixels, rtol=1e-5)
        assert session.take().spp == 1  # and the film is another


def test_warnings_come_with_what_is_traced_beside_the_picture(client: Page) -> None:
    """They look at every object, which takes as long as a glance."""
    client.ask(830, "set", changes={"film.size_mm": [36, 36]})
    client.wait(lambda got: got.type == "state" and any("film.size_mm" in each for each in got.header["messages"]))


def test_overlays_of_a_picture_at_rest_wait_for_those_who_wait() -> None:
    hurries = True
    client = Client(1, lambda: None)
    client.settings = ClientSettings(overlays={"zebra": True, "peaking": True})
    delivery = Delivery(lambda: hurries)
    with rptcam_cl.RenderSession(SCENE_DATA) as session:
        slot = Slot("A", session, {})
        slot.show(session.take(2), False, {})
        delivery.deliver(slot, [client])
        assert set(client.outbox._frames) == {("A", "picture")}
        hurries = False
        delivery.cover(slot, [client])
        assert set(client.outbox._frames) == {("A", "picture"), ("A", "overlay", "zebra"), ("A", "overlay", "peaking")}
        client.outbox._frames.clear()
        delivery.cover(slot, [client])
        assert not client.outbox._frames  # they are sent once
        hurries = True
        slot.show(session.glance(0.5), True, {})
        delivery.deliver(slot, [client])
        assert len(client.outbox._frames) == 3  # those of glances come with them


SCENE_DATA = {
    "film": {"resolution": [32, 24], "width_mm": 36},
    "camera": {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 1], "target": [0, 0, 0]},
    "objects": [
        {"shape": "sphere", "center": [0, 0, 0], "radius": 0.15, "material": {"kind": "matte", "reflectance": 0.5}}
    ],
    "environment": {"kind": "constant", "radiance": [0.4, 0.5, 0.6]},
}
