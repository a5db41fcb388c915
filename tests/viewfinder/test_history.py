"""Whatever was done is undone and done again, to the bit; snapshots stay."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.viewfinder.page_client import Page, at_rest, reset_page, serving_text


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with serving_text(tmp_path_factory.mktemp("scene")) as server:
        yield server


@pytest.fixture
def client(server: Any) -> Iterator[Page]:
    with reset_page(server) as found:
        yield found


def shown(client: Page, number: int) -> tuple[str, bytes]:
    """The scene as text, and the picture with all samples."""
    client.frame(lambda header: at_rest(header) and not header["stale"])
    return client.ask(number, "scene").header["yaml"], client.ask(number + 1, "save", format="png", name="a").data


def asked(client: Page, message: int, do: str, number: int) -> Any:
    """Return the answer to what is to be done with a state."""
    client.send("history", id=message, do=do, number=number)
    return client.answer(message)


def test_a_dial_and_a_move_are_undone_and_done_again_to_the_bit(client: Page) -> None:
    client.ask(10, "dial", name="iso", value=200.0)
    first = shown(client, 11)
    client.ask(20, "dial", name="f_number", value=8.0)
    second = shown(client, 21)
    client.ask(30, "move", kind="orbit", dx=0.1)
    third = shown(client, 31)
    assert len({first, second, third}) == 3
    for number, (do, wanted) in enumerate((("undo", second), ("undo", first), ("redo", second), ("redo", third))):
        client.ask(40 + 10 * number, "history", do=do)
        assert shown(client, 41 + 10 * number) == wanted


def test_what_is_done_after_an_undo_takes_the_place_of_what_was_undone(client: Page) -> None:
    client.ask(10, "dial", name="f_number", value=8.0)
    client.ask(11, "history", do="undo")
    client.ask(12, "dial", name="f_number", value=4.0)
    assert client.ask(13, "history", do="redo").type == "error"


def test_a_drag_is_one_state(client: Page) -> None:
    client.send("pointer", id=9, x=0.5, y=0.5)
    before = client.ask(10, "scene").header["yaml"]
    for number in range(11, 16):
        client.ask(number, "move", kind="pan", dx=0.01, transient=number < 15)
    assert client.ask(16, "scene").header["yaml"] != before
    client.ask(17, "history", do="undo")
    assert client.ask(18, "scene").header["yaml"] == before


def test_a_reset_is_undone(client: Page) -> None:
    client.ask(10, "dial", name="f_number", value=8.0)
    turned = client.ask(11, "scene").header["yaml"]
    client.ask(12, "reset")
    assert client.ask(13, "scene").header["yaml"] != turned
    client.ask(14, "history", do="undo")
    assert client.ask(15, "scene").header["yaml"] == turned


def test_snapshots_stay_are_compared_and_dropped(client: Page) -> None:
    client.ask(10, "dial", name="f_number", value=8.0)
    kept = client.ask(11, "scene").header["yaml"]
    client.send("history", id=12, do="snap")
    number = client.wait(lambda m: m.type == "history" and bool(m.header["snapshots"])).header["snapshots"][-1][
        "number"
    ]
    client.ask(13, "history", do="undo")
    client.ask(14, "dial", name="f_number", value=4.0)  # what was undone is no state any more
    asked(client, 15, "compare", number)
    client.frame(lambda header: header["slot"] == "B" and header["kind"] == "picture")
    assert client.ask(16, "scene", slot="B").header["yaml"] == kept
    asked(client, 17, "go", number)
    assert client.ask(18, "scene").header["yaml"] == kept
    client.send("history", id=19, do="drop", number=number)
    client.wait(lambda m: m.type == "history" and all(each["number"] != number for each in m.header["snapshots"]))
    client.ask(20, "compare", mode="off")


def test_states_have_thumbnails_and_words(client: Page) -> None:
    client.send("dial", id=10, name="f_number", value=8.0)
    found = client.wait(lambda m: m.type == "history" and "f number" in m.header["states"][-1]["label"]).header
    assert found["at"] == found["states"][-1]["number"]
    thumb = client.wait(lambda m: m.type == "thumb" and m.header["number"] == found["at"])
    assert thumb.header["data"].startswith("/9j/")  # a JPEG


def test_nothing_to_undo_and_unknown_states_are_errors(client: Page) -> None:
    assert "no state" in asked(client, 10, "go", 2**40).header["message"]
    assert client.ask(11, "history", do="go").type == "error"
