"""The outbox of a client: answers are kept, frames and news replace older ones, two frames are under way at most."""

import json
import struct
from typing import Any

from rptcam_cl.viewfinder.messages import MOST_ANSWERS, FrameData, Outbox


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
