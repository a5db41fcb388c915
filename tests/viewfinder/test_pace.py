"""The pace of the picture: its scale and its samples follow the speed measured."""

import json
import struct
from typing import Any

import pytest

from rptcam_cl.viewfinder.messages import MOST_ANSWERS, FrameData, Outbox
from rptcam_cl.viewfinder.slot import GLANCE_S, LONGEST_S, SCALES, SHOWN_SHARE, TAKE_S, Pace


def run(pace: Pace, seconds_at_full: float, fixed: float, turns: int = 30) -> list[float]:
    """Return the scales of so many glances of a scene that takes so long."""
    scales = []
    for _ in range(turns):
        scale = pace.scale
        scales.append(scale)
        pace.note_glance(scale, fixed + seconds_at_full * scale**2)
    return scales


def test_slow_scenes_get_the_largest_scale_that_is_fast_enough() -> None:
    for seconds, best in ((0.001, 1.0), (0.15, 0.5), (0.9, 0.25), (3.0, 0.125), (100.0, 0.125)):
        scales = run(Pace(), seconds, 0.002)
        assert scales[-1] == best, seconds
        assert len(set(scales[-10:])) == 1, "it comes to rest"


def test_scale_follows_a_change_of_speed() -> None:
    pace = Pace()
    run(pace, 3.0, 0.0)
    assert pace.scale == 0.125
    run(pace, 0.001, 0.0)
    assert pace.scale == 1.0
    run(pace, 3.0, 0.0, turns=3)
    assert pace.scale == 0.125


def test_glance_of_another_scale_says_nothing() -> None:
    pace = Pace()
    before = pace.scale
    pace.note_glance(SCALES[-1], 100 * GLANCE_S)
    assert pace.scale == before


def test_samples_of_a_take_keep_its_time() -> None:
    pace = Pace()
    assert pace.samples(0) == 1
    for _ in range(20):
        samples = pace.samples(0)
        pace.note_take(samples, samples * TAKE_S / 10)
    assert 8 <= pace.samples(0) <= 10
    pace.note_take(1, 1000.0)
    assert pace.samples(0) == 1


def test_takes_grow_with_what_showing_costs_and_with_the_samples_that_are_there() -> None:
    pace = Pace()
    for _ in range(20):
        pace.note_take(10, 10 * 0.015)
    alone = pace.samples(0)
    for _ in range(20):
        pace.note_show(0.06)
    assert pace.samples(0) * 0.015 * SHOWN_SHARE == pytest.approx(0.06, rel=0.05)
    assert pace.samples(0) > alone
    assert pace.samples(400) == 100
    assert pace.samples(10**6) == pytest.approx(LONGEST_S / 0.015, rel=0.02)


def test_takes_end_with_whole_waves_once_they_are_near_to_one() -> None:
    pace = Pace()
    for _ in range(20):
        pace.note_take(10, 10 * TAKE_S / 8)
    assert pace.samples(4, of_wave=64) == 8  # far from one
    assert pace.samples(4, of_wave=16) == 12
    assert pace.samples(16, of_wave=16) == 16
    for done in range(1, 400):
        assert (done + pace.samples(done, of_wave=16)) % 16 == 0
    most = int(LONGEST_S / (TAKE_S / 8))
    assert pace.samples(10**6, of_wave=16) == most // 16 * 16


def header_of(message: str | bytes) -> dict[str, Any]:
    assert isinstance(message, bytes)
    (length,) = struct.unpack("<I", message[:4])
    return dict(json.loads(message[4 : 4 + length]))


def picture(number: int) -> FrameData:
    return {"picture": number}, b"data"


def test_only_the_newest_frame_waits_and_two_are_under_way() -> None:
    outbox = Outbox(lambda: None)
    sent = []
    for number in range(10):
        outbox.frame("A", picture(number))
        sent += outbox.take()
    assert [header_of(message)["picture"] for message in sent] == [0, 1]
    outbox.acknowledge(header_of(sent[0])["frame"])
    (last,) = outbox.take()
    assert header_of(last) == {"picture": 9, "frame": 3}
    assert isinstance(last, bytes)
    assert last.endswith(b"data")
    assert outbox.take() == []


def test_acknowledgements_of_nothing_change_nothing() -> None:
    outbox = Outbox(lambda: None)
    outbox.acknowledge(99)
    for number in range(3):
        outbox.frame("A", picture(number))
        outbox.acknowledge(99)
    assert outbox.has_room
    outbox.frame("B", picture(1))
    assert not outbox.has_room


def test_frames_of_different_kinds_take_turns() -> None:
    outbox = Outbox(lambda: None)
    outbox.frame("A", picture(1))
    outbox.frame("zebra", picture(2))
    outbox.frame("peaking", picture(3))
    outbox.frame("A", picture(4))
    first = outbox.take()
    assert [header_of(message)["picture"] for message in first] == [4, 2]
    outbox.frame("A", picture(5))
    outbox.acknowledge(1)
    assert [header_of(message)["picture"] for message in outbox.take()] == [3]


def test_answers_are_all_sent_and_news_only_in_their_last_state() -> None:
    outbox = Outbox(lambda: None)
    for number in range(3):
        outbox.answer({"id": number})
        outbox.news("state", {"state": number})
    assert [json.loads(message) for message in outbox.take()] == [{"id": 0}, {"id": 1}, {"id": 2}, {"state": 2}]


def test_client_that_reads_nothing_overflows_and_takes_no_more_memory() -> None:
    outbox = Outbox(lambda: None)
    for number in range(3 * MOST_ANSWERS):
        outbox.answer({"id": number})
    assert outbox.overflowed
    assert len(outbox.take()) == MOST_ANSWERS


def test_what_is_not_finite_is_null() -> None:
    outbox = Outbox(lambda: None)
    outbox.answer({"far_m": float("inf"), "noise": [float("nan"), 1.0]})
    assert json.loads(outbox.take()[0]) == {"far_m": None, "noise": [None, 1.0]}


def test_something_to_take_wakes_whoever_takes() -> None:
    woken: list[int] = []
    outbox = Outbox(lambda: woken.append(1))
    outbox.answer({})
    outbox.news("state", {})
    outbox.frame("A", picture(1))
    assert len(woken) == 3
