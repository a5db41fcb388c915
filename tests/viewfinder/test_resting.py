"""The picture at rest is the one that a file would hold: with sensor and diffraction, which glances leave out."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

import rptcam_cl
from rptcam_cl.viewfinder.delivery import Delivery
from rptcam_cl.viewfinder.dials import meter_needle, turn_dial
from rptcam_cl.viewfinder.messages import MOST_UNACKNOWLEDGED, Client, ClientSettings, codes_of
from rptcam_cl.viewfinder.panel import Panel
from rptcam_cl.viewfinder.slot import Slot
from tests.support.cases import slow
from tests.viewfinder.page_client import SCENE

SPP = 8
PHYSICAL = {"exposure": {"mode": "physical", "iso": 400}, "shutter": {"time_s": 0.01}, "sensor": {}}


def scene(**changes: Any) -> dict[str, Any]:
    return {**yaml.safe_load(SCENE), **changes}


def narrow(diffraction: str) -> dict[str, Any]:
    """A film so small that a pixel is as large as the Airy disk."""
    camera = {"kind": "thin_lens", "focal_length_mm": 50, "f_number": 16, "focus_distance_m": 1.0, "eye": [0, 0, 1]}
    film = {"resolution": [48, 32], "width_mm": 0.48}
    lamp = {"shape": "sphere", "center": [0, 0, 0], "radius": 0.003, "material": {"kind": "emissive", "radiance": 1}}
    camera |= {"target": [0, 0, 0], "diffraction": diffraction}
    return {"film": film, "camera": camera, "render": {"spp": SPP, "max_depth": 1}, "objects": [lamp]}


@pytest.fixture
def slots() -> Iterator[Any]:
    made = []

    def make(given: dict[str, Any]) -> Slot:
        made.append(Slot("A", rptcam_cl.RenderSession(given), {}))
        return made[-1]

    yield make
    for slot in made:
        slot.close()


def rested(slot: Slot) -> None:
    slot.show(slot.glance() if slot.wants_glance else slot.again(), False, {})
    while not slot.is_done:
        frame = slot.refine(lambda: True)
        if frame is not None:
            slot.show(frame, False, {})
        slot.follow()
    if slot.wants_finishing:
        assert slot.shown is not None and slot.shown.lacks == slot.comes_last
        slot.show_finished(slot.picture_later()())
        assert not slot.shown.lacks and not slot.wants_finishing


def histograms(slot: Slot) -> dict[str, Any]:
    """Return the histograms that a page gets of the picture that is shown."""
    client = Client(1, lambda: None)
    client.settings = ClientSettings(panels=("histogram",))
    delivery = Delivery(lambda: False)
    delivery.deliver(slot, [client])
    delivery.count(slot, [client])
    (found,) = [message for key, message in client.outbox._news.items() if key == ("histogram", "A")]
    return dict(found)


def test_a_picture_goes_once_to_each_page_that_has_room(slots: Any) -> None:
    slot, delivery = slots(scene()), Delivery(lambda: False)
    first, full = (Client(number, lambda: None) for number in (1, 2))
    for number in range(MOST_UNACKNOWLEDGED):
        full.outbox.frame(("other", number), ({}, b""))
    assert not delivery.deliver(slot, [first])  # there is no picture yet
    slot.show(slot.glance(), False, {})
    assert delivery.deliver(slot, [first, full])
    assert list(first.outbox._frames) == [("A", "picture")] and ("A", "picture") not in full.outbox._frames
    assert not delivery.deliver(slot, [first, full])  # which have it, and have no room
    full.outbox._frames.clear()
    assert delivery.deliver(slot, [first, full])
    assert list(full.outbox._frames) == [("A", "picture")]
    first.outbox._frames.clear()
    slot.show(slot.glance(), False, {})
    assert delivery.deliver(slot, [first]) and list(first.outbox._frames) == [("A", "picture")]


def test_difference_goes_once_to_each_page(slots: Any) -> None:
    a, b, client = slots(scene()), slots(scene()), Client(1, lambda: None)
    delivery = Delivery(lambda: False)
    for slot in (a, b):
        delivery.difference(a, b, [client])
        assert client.outbox.is_clear  # as long as one of them has no picture
        slot.show(slot.glance(), False, {})
    delivery.difference(a, b, [client])
    assert not client.outbox.is_clear
    client.outbox._frames.clear()
    delivery.difference(a, b, [client])
    assert client.outbox.is_clear


def test_raw_histogram_counts_the_numbers_that_the_raw_file_holds(slots: Any) -> None:
    slot = slots(scene(**PHYSICAL))
    slot.show(slot.glance(), False, {})
    assert "raw" not in histograms(slot)  # glances have no sensor, and the page keeps what it has
    rested(slot)
    found, numbers = histograms(slot)["raw"], np.asarray(rptcam_cl.render(scene(**PHYSICAL), spp=SPP).raw().numbers)
    assert sum(sum(found[name]) for name in ("red", "green", "blue")) == numbers.size
    width = found["edges"][1] / found["bins"]
    assert found["red"] == np.bincount((numbers[::2, ::2] // width).astype(int).ravel(), minlength=256).tolist()


def test_without_a_sensor_there_is_no_raw_histogram(slots: Any) -> None:
    slot = slots(scene())
    slot.show(slot.glance(), False, {})
    assert histograms(slot)["raw"] is None


@pytest.mark.slow  # finding the pattern of an opening takes five seconds
def test_the_picture_at_rest_has_diffraction(slots: Any) -> None:
    slot = slots(narrow("on"))
    rested(slot)
    assert slot.shown is not None
    expected = [codes_of(rptcam_cl.render(narrow(mode), spp=SPP)) for mode in ("on", "off")]
    assert np.array_equal(slot.shown.codes, expected[0])
    assert not np.array_equal(expected[0], expected[1])


@pytest.mark.slow  # compiles a lens for glances and for the film
def test_ghosts_are_a_sketch_until_the_picture_at_rest_has_its_own(slots: Any) -> None:
    camera = {"kind": "realistic", "lens": "cooke-triplet-50mm", "eye": [0, 0, 0], "target": [0, 0, -10],
              "focus": {"distance_m": 100}, "transmission": "bare", "ghosts": "on"}  # fmt: skip
    sun = {"kind": "sun", "direction": [0, 0.17, 0.98], "irradiance": [1500] * 3, "diameter_degrees": 0.5}
    ball = {"shape": "sphere", "center": [0, 8, -20], "radius": 2, "material": {"kind": "matte", "reflectance": 0.5}}
    lit = {"film": {"resolution": [48, 32], "width_mm": 36}, "camera": camera, "lights": [sun], "objects": [ball],
           "render": {"spp": SPP, "max_depth": 2}}  # fmt: skip
    slot = slots(lit)
    slot.show(slot.glance(), True, {})
    assert slot.shown is not None and "ghosts" in slot.shown.lacks
    plain = codes_of(slot._plain_image(slot.shown.pixels))
    image = rptcam_cl.render(lit, spp=SPP, layers=["ghosts"])
    ghosts = image["ghosts"].sum(dtype=np.float64)
    sketch = slot.session.sketch_of_ghosts(slot.shown.frame)
    assert sketch is not None and not np.array_equal(slot.shown.codes, plain)
    share = sketch.size / image["ghosts"].size  # glances have fewer pixels
    assert sketch.sum(dtype=np.float64) / share == pytest.approx(ghosts, rel=0.1)
    rested(slot)
    assert np.array_equal(slot.shown.codes, codes_of(image))
    slot.change({"camera.ghosts": "off"})
    assert slot.session.sketch_of_ghosts(slot.glance()) is None


def test_the_last_samples_are_shown_although_their_picture_was_given_up(slots: Any) -> None:
    slot = slots(scene())
    rested(slot)
    slot.leave_unread()
    assert not slot.is_done
    frame = slot.refine(lambda: True)
    assert frame is not None and frame.spp == SPP
    assert slot.is_done


def test_the_needle_moves_by_the_stops_that_a_dial_turns(slots: Any) -> None:
    slot = slots(scene(**PHYSICAL))
    rested(slot)
    needles = []
    for seconds in (0.01, 0.02):
        turned = turn_dial(Panel(slot.dials, slot.scene, slot.resolved, slot.reading_cd_m2), "shutter_s", seconds)
        slot.change(turned.changes, dials=turned.dials)
        rested(slot)
        needles.append(meter_needle(Panel(slot.dials, slot.scene, slot.resolved, slot.reading_cd_m2)))
    assert all(needle is not None and math.isfinite(needle) for needle in needles)
    assert needles[1] - needles[0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("still", "dial", "value"), [(True, "shutter_s", 0.02), (True, "ev", 1), slow(False, "shutter_s", 0.02)]
)
def test_another_exposure_is_developed_at_once_where_nothing_moves(
    slots: Any, still: bool, dial: str, value: float
) -> None:
    given = scene(**{name: part for name, part in PHYSICAL.items() if name != "sensor"})
    if not still:
        given["objects"][0]["motion"] = [{"time_s": 0}, {"time_s": 1, "translate": [0.1, 0, 0]}]
    slot = slots(given)
    rested(slot)
    turned = turn_dial(Panel(slot.dials, slot.scene, slot.resolved, slot.reading_cd_m2), dial, value)
    slot.change(turned.changes, dials=turned.dials)
    assert slot.wants_glance is not still
    if not still:
        return
    slot.show(slot.again(), False, {})
    assert slot.shown is not None
    at_once, codes = slot.shown.frame.pixels, slot.shown.codes
    assert slot.refine(lambda: True) is None  # a sample more than none would be worse
    rested(slot)
    np.testing.assert_allclose(at_once, slot.session.pixels(), rtol=2e-6)
    assert np.abs(codes.astype(int) - slot.shown.codes).max() <= 1
    assert np.array_equal(slot.session.pixels(), rptcam_cl.render(slot.scene, spp=SPP).pixels)


def test_kernels_that_come_while_a_film_is_read_make_no_picture_of_no_samples(
    monkeypatch: pytest.MonkeyPatch, slots: Any
) -> None:
    slot = slots(scene())
    empty = replace(slot.session.take(1), spp=0)
    monkeypatch.setattr(slot.session, "frame", lambda: empty)
    assert slot.refine(lambda: True) is None
