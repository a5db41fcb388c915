"""The server as a page meets it: pictures, dials, files and instruments over a plain WebSocket."""

import io
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image as Pillow

from rptcam_cl.api.combined import focus_stack
from rptcam_cl.api.job import render
from rptcam_cl.api.session import RenderSession
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.devices import CompileServer
from rptcam_cl.device.session import open_session
from rptcam_cl.imaging.image import Image, read_film, with_picture_settings
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.focus.controller import autofocus
from rptcam_cl.viewfinder import requests
from rptcam_cl.viewfinder.delivery import dial_list
from rptcam_cl.viewfinder.dials import turn_dial
from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.messages import codes_of
from rptcam_cl.viewfinder.panel import Panel, read_dials
from rptcam_cl.viewfinder.requests import focus_order
from rptcam_cl.viewfinder.server import ViewServer
from rptcam_cl.viewfinder.slot import Pace
from rptcam_cl.viewfinder.studio import Origin
from tests.viewfinder.page_client import SCENE, Page, at_rest, left_alone, page, serving

Served = tuple[Viewfinder, ViewServer, Path]


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    path = tmp_path_factory.mktemp("scene") / "ball.yaml"
    path.write_text(SCENE)
    with serving(path) as (finder, server):
        yield finder, server, path


@pytest.fixture
def client(served: Served) -> Iterator[Page]:
    with page(served[1]) as found:
        found.ask(1, "reset")
        yield found


def test_end_waits_for_nobody_and_is_told(tmp_path: Path) -> None:
    """A signal may interrupt the thread that holds the lock of what waits for a page."""
    path = tmp_path / "ball.yaml"
    path.write_text(SCENE)
    with serving(path) as (finder, server), page(server) as client:
        (waiting,) = [each.outbox for each in finder._clients.values()]
        with waiting._lock:
            ends = threading.Thread(target=server.stop, daemon=True)
            ends.start()
            ends.join(10)
            assert not ends.is_alive()
        assert client.wait(lambda message: message.type == "bye").header["text"] == "the server has ended"


def test_page_is_greeted_and_gets_a_picture_that_becomes_finer(served: Served) -> None:
    with page(served[1]) as client:
        hello = client.seen[-1].header
        assert hello["scene"] == "ball.yaml"
        assert hello["size"] == [48, 32]
        assert {"f_number", "lens", "focus_m"} <= {dial["name"] for dial in hello["dials"]}
        assert len(hello["lenses"]) >= 42
        assert "token" not in hello
        last = client.frame(at_rest)
        assert Pillow.open(io.BytesIO(last.data)).size == (48, 32)
        frames = [message.header for message in client.seen if message.type == "frame"]
        assert frames[0]["scale"] <= 1
        assert [frame["frame"] for frame in frames] == list(range(1, len(frames) + 1))
        for frame in frames:
            assert {"scale", "spp", "ms", "noise", "generation", "answers"} <= frame.keys()


def test_hundred_dials_leave_the_last_and_no_backlog(client: Page) -> None:
    client.frame(at_rest)
    first = len(client.seen)
    for step in range(100):  # no frame is acknowledged meanwhile
        client.send("dial", id=100 + step, name="f_number", value=2.2 + 0.1 * step, transient=True)
        time.sleep(0.002)
    frame = client.frame(lambda header: header["answers"] == 199)
    frames = sum(message.type == "frame" for message in client.seen[first:])
    final = client.wait(lambda message: message.type == "state" or message.type == "frame")
    assert frames <= 5, "two that wait for their acknowledgement, what was being made, and the last"
    answered = {message.header.get("id") for message in client.seen}
    assert set(range(100, 200)) <= answered
    assert frame.header["generation"] >= 1
    assert final is not None
    command = client.ask(300, "command").header["text"]
    assert "camera.f_number=12.1" in command


def test_client_that_acknowledges_nothing_gets_two_frames_and_then_the_newest(client: Page) -> None:
    client.frame(at_rest)
    client.acknowledges = False

    def waiting() -> list[dict[str, Any]]:
        return [message.header for message in client.seen if message.type == "frame" and message.header["answers"]]

    for step in range(6):
        client.ask(10 + step, "dial", name="f_number", value=2.2 + step)
        while len(waiting()) < 2:
            client.receive()
    client.ask(50, "ping")
    assert len(waiting()) == 2
    client.acknowledges = True
    client.send("ack", frame=waiting()[0]["frame"])
    assert client.frame().header["answers"] == 15


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("{", None),
        ('{"type": "dial", "id": 5, "name": "f_number", "value": NaN}', 5),
        ('{"type": "dial", "id": 6, "name": "lens", "value": "no-such-lens"}', 6),
        ('{"type": "dial", "id": 7, "name": "no_such_dial", "value": 1}', 7),
        ('{"type": "dial", "id": 8, "name": "f_number", "value": "wide"}', 8),
        ('{"type": "set", "id": 9, "changes": {"camera.lens": "../../../etc/passwd"}}', 9),
        ('{"type": "set", "id": 10, "changes": {"camera.f_number": -3}}', 10),
        ('{"type": "set", "id": 11, "changes": {"camera.no_such_key": 1}}', 11),
        ('{"type": "save", "id": 12, "format": "png", "name": "/tmp/x"}', 12),
        ('{"type": "save", "id": 13, "format": "dng", "name": "raw"}', 13),
        ('{"type": "scene", "id": 14, "slot": "B"}', 14),
        ('{"type": "compare", "id": 15, "mode": "side", "changes": {"camera.f_number": "x"}}', 15),
        ('{"type": "autofocus", "id": 16, "method": "magic"}', 16),
    ],
)
def test_what_is_wrong_is_answered_and_the_server_lives(client: Page, text: str, number: int | None) -> None:
    before = client.ask(90, "scene").header["yaml"]
    client.socket.send(text)
    error = client.wait(lambda message: message.type == "error")
    assert error.header["id"] == number
    assert error.header["message"]
    assert client.ask(91, "scene").header["yaml"] == before, "nothing has changed"


def test_unexpected_error_in_a_message_is_told_to_its_page_and_the_server_lives(
    client: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    def odd(*_: Any) -> Any:
        raise RuntimeError("what nobody thought of")

    with monkeypatch.context() as patched:
        patched.setattr(requests, "turn_dial", odd)
        error = client.ask(5, "dial", name="f_number", value=8)
    assert error.type == "error" and error.header["source"] == "change"
    assert "what nobody thought of" in error.header["message"]
    assert client.ask(6, "dial", name="f_number", value=8).type == "done"
    assert "f_number: 8" in client.ask(7, "scene").header["yaml"]


@pytest.mark.parametrize("zones", [pytest.param(None, marks=pytest.mark.slow), [[0.4, 0.6, 0.4, 0.6]]])
def test_autofocus_is_at_the_zones_of_the_message(client: Page, zones: Any) -> None:
    client.ask(5, "dial", name="focus_m", value=3)
    found = client.ask(6, "autofocus", method="depth", zones=zones)
    assert found.type == "focused", found.header
    assert client.ask(7, "autofocus", method="depth", zones=[[0.6, 0.4, 0, 1]]).type == "error"
    expected = autofocus(load_scene(yaml.safe_load(SCENE)), "depth", zones=zones)
    assert found.header["distance_m"] == pytest.approx(expected.focus_distance_m, rel=1e-6)


def test_file_that_cannot_be_read_for_an_odd_reason_is_told_as_well(
    served: Served, client: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    def odd() -> Any:
        raise RuntimeError("the disk is odd")

    with monkeypatch.context() as patched:
        patched.setattr(served[0].origin, "load", odd)
        served[0]._read_again()
    error = client.wait(lambda message: message.type == "error")
    assert error.header["source"] == "scene" and "the disk is odd" in error.header["message"]
    served[0]._read_again()
    assert client.ask(5, "dial", name="f_number", value=8).type == "done"


def test_moves_change_the_camera_and_reset_brings_it_back(client: Page) -> None:
    before = client.ask(5, "scene").header["yaml"]
    for number, kind in enumerate(("orbit", "pan", "dolly", "walk", "tilt", "roll", "zoom")):
        assert client.ask(10 + number, "move", kind=kind, dx=0.1, dy=0.1, dz=0.1).type == "done"
    client.frame(lambda header: header["answers"] == 16)
    assert client.ask(20, "scene").header["yaml"] != before
    client.ask(21, "reset", what="all")
    assert client.ask(22, "scene").header["yaml"] == before


def test_saved_scene_renders_to_the_same_bits(client: Page, tmp_path: Path) -> None:
    client.ask(5, "dial", name="f_number", value=5.6)
    client.ask(6, "move", kind="orbit", dx=0.05)
    client.frame(lambda header: at_rest(header) and header["answers"] == 6)
    saved = client.ask(7, "save", format="exr", name="shot")
    assert saved.header["name"] == "shot.exr"
    (tmp_path / "shot.exr").write_bytes(saved.data)
    (tmp_path / "shown.yaml").write_text(client.ask(8, "scene").header["yaml"])
    image = render(tmp_path / "shown.yaml", spp=8)
    assert np.array_equal(read_film(tmp_path / "shot.exr").pixels, image.pixels)


def test_one_of_a_bracket_is_exposed_by_so_many_stops_more(client: Page, tmp_path: Path) -> None:
    client.send("view", id=5, format="png")
    client.frame(lambda header: header["media"] == "image/png" and header["spp"] == 8)  # later than what was reset
    plain = {ev: client.ask(6 + ev, "save", format="png", name="a", ev=ev).data for ev in (0, 1)}
    client.ask(10, "set", changes={"exposure.ev": 1.0})
    client.frame(lambda header: header["kind"] == "picture" and header["spp"] == 8 and header["answers"] == 10)
    brighter = client.ask(11, "save", format="png", name="a").data
    one, other = (np.asarray(Pillow.open(io.BytesIO(data)), int) for data in (plain[1], brighter))
    assert np.array_equal(one, other)
    assert plain[0] != plain[1]


def test_a_saved_scene_keeps_the_comments_of_its_file(tmp_path: Path) -> None:
    pytest.importorskip("ruamel.yaml")
    path = tmp_path / "scene.yaml"
    path.write_text(f"# of an evening\n{SCENE}picture: {{ev: 0.5}}  # half a stop\n", "utf-8")
    origin = Origin(path)
    shown = set_keys(origin.load(), {"camera.f_number": 4, "picture.ev": 1.5, "objects.0.radius": 0.1, "sensor": {}})
    text = origin.text(shown)
    assert "# of an evening" in text
    assert "picture: {ev: 1.5}  # half a stop" in text
    assert load_scene(yaml.safe_load(text)).made_of == shown.made_of
    path.write_text(SCENE + "render: {spp: 8}\n", "utf-8")  # no YAML any more, meanwhile
    assert "half a stop" not in origin.text(shown)


def test_a_stack_is_the_picture_that_focus_stack_makes_with_all_it_is_made_of(client: Page, tmp_path: Path) -> None:
    client.frame(at_rest)
    wanted = {"near_m": 0.8, "far_m": 1.2, "steps": 3, "format": "exr", "name": "all"}
    answer = client.ask(5, "stack", pictures=True, **wanted)
    assert (answer.header["name"], answer.header["media"]) == ("all.zip", "application/zip")
    with zipfile.ZipFile(io.BytesIO(answer.data)) as archive:
        names = archive.namelist()
        (tmp_path / "all.exr").write_bytes(archive.read("all.exr"))
    assert names[0] == "all.exr" and len(names) == 4
    assert [name.split(" at ")[0] for name in names[1:]] == ["all 1", "all 2", "all 3"]
    scene = yaml.safe_load(client.ask(6, "scene").header["yaml"])
    found = read_film(tmp_path / "all.exr")
    expected = focus_stack(scene, 0.8, 1.2, steps=3, spp=found.metadata["spp"])
    assert np.array_equal(found.pixels, expected.pixels)
    assert "far_m" in client.ask(7, "stack", **wanted | {"near_m": 2}).header["message"]
    assert client.ask(8, "stack").type == "done"


def test_tables_of_colours_beside_the_scene_are_a_dial(tmp_path: Path) -> None:
    (tmp_path / "luts").mkdir()
    lattice = [(1 - r, g, b) for b in (0, 1) for g in (0, 1) for r in (0, 1)]
    (tmp_path / "luts" / "cross.cube").write_text("LUT_3D_SIZE 2\n" + "\n".join(f"{r} {g} {b}" for r, g, b in lattice))
    (tmp_path / "scene.yaml").write_text(SCENE)
    scene = Origin(tmp_path / "scene.yaml").load()
    panel = Panel(read_dials(scene), scene, scene)
    dial = next(each for each in dial_list(panel) if each["name"] == "lut")
    assert [each["value"] for each in dial["choices"]] == [None, "luts/cross.cube"]
    shown = set_keys(scene, turn_dial(panel, "lut", "luts/cross.cube").changes)
    assert shown.picture.lut == "luts/cross.cube"
    pixels = codes_of(with_picture_settings(Image(np.zeros((1, 1, 3), np.float32), {}), shown.picture))
    assert pixels.tolist() == [[[255, 0, 0]]]
    with pytest.raises(InputError, match="lut: is not one of"):
        turn_dial(panel, "lut", "/etc/passwd")


def test_pictures_are_saved_as_they_are_shown(client: Page) -> None:
    client.frame(at_rest)
    client.ask(4, "view", format="png", overlays={"zebra": True}, zebra_level=0.0)
    shown = client.frame(lambda header: at_rest(header) and header["media"] == "image/png")
    png = client.ask(5, "save", format="png", name="a.png")
    assert png.header["name"] == "a.png"
    pixels = [np.asarray(Pillow.open(io.BytesIO(data))) for data in (shown.data, png.data)]
    assert np.array_equal(*pixels), "and no zebra is burnt in"
    jpeg = client.ask(6, "save", format="jpeg", name="a")
    assert jpeg.header["name"] == "a.jpg"
    rough = np.asarray(Pillow.open(io.BytesIO(jpeg.data)), np.float64)
    assert np.abs(rough - pixels[1][..., :3]).mean() < 8


def test_two_settings_are_compared_with_their_difference(client: Page) -> None:
    client.frame(at_rest)
    client.ask(5, "compare", mode="side", changes={"camera.f_number": 11}, difference=True)
    second = client.frame(lambda header: header["slot"] == "B" and header["kind"] == "picture" and header["spp"] == 8)
    assert second.header["scale"] == 1
    difference = client.frame(lambda header: header["kind"] == "difference")
    assert difference.header["numbers"]
    assert "f_number: 11" in client.ask(6, "scene", slot="B").header["yaml"]
    client.ask(7, "dial", name="focus_m", value=0.8)
    assert "f_number: 11" in client.ask(8, "scene", slot="B").header["yaml"]
    assert client.ask(9, "compare", mode="off").type == "done"
    assert client.ask(10, "scene", slot="B").type == "error"


def test_instruments_answer_the_pointer(client: Page) -> None:
    client.frame(at_rest)
    client.ask(5, "view", panels=["histogram", "meter", "lens"])
    client.send("pointer", x=0.5, y=0.5)
    wanted = {"histogram", "meter", "lens"}
    found: dict[str, dict[str, Any]] = {}
    while wanted - found.keys() or not found["lens"]["pointer"]:
        message = client.receive()
        found[message.type] = message.header
    assert sum(found["histogram"]["luminance"]) == 48 * 32
    assert found["meter"]["cd_m2"] > 0
    assert found["lens"]["pointer"]["rays"]
    client.send("magnify", x=0.5, y=0.5, width=16, height=16)
    piece = client.frame(lambda header: header["kind"] == "magnifier")
    assert Pillow.open(io.BytesIO(piece.data)).size == (16, 16)


def test_edit_of_the_file_shows_and_an_error_with_its_line(served: Served, client: Page) -> None:
    _, _, path = served
    client.frame(at_rest)
    client.ask(5, "dial", name="f_number", value=4)
    try:
        path.write_text(SCENE.replace("[0.7, 0.6, 0.5]", "[0.1, 0.1, 0.8]"))
        client.wait(lambda message: message.type == "notice" and message.header["kind"] == "watch")
        text = client.ask(6, "scene").header["yaml"]
        assert "0.8" in text
        assert "f_number: 4" in text, "what was turned stays"
        path.write_text(SCENE.replace("radius: 0.15", "radius: -1"))
        error = client.wait(lambda message: message.type == "error")
        assert error.header["source"] == "scene"
        assert error.header["where"] == f"{path}:8:48"
        client.ask(7, "move", kind="orbit", dx=0.01)
        client.frame(lambda header: header["answers"] == 7)
        path.write_text("camera: {kind: [")
        assert client.wait(lambda message: message.type == "error").header["source"] == "scene"
    finally:
        path.write_text(SCENE)
    assert client.wait(lambda message: message.type == "notice").header["ok"]


def test_last_page_frees_the_device_and_the_next_one_finds_it_as_it_was(served: Served) -> None:
    finder, server, _ = served
    with page(server) as client:
        client.ask(5, "dial", name="f_number", value=8)
        client.frame()
    left_alone(finder)
    with page(server) as client:
        assert finder.holds_device
        assert "f_number: 8" in client.ask(6, "scene").header["yaml"]
        client.frame()


def test_change_that_the_device_cannot_hold_is_reported_and_undone(
    client: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Pace, "scale", 1.0)  # by itself a slow machine may choose one that the device does hold
    client.frame(at_rest)
    client.ask(5, "dial", name="f_number", value=8)
    client.frame(lambda header: at_rest(header) and header["answers"] == 5)
    client.send("set", id=6, changes={"film.resolution": [46000, 46000]})
    error = client.wait(lambda message: message.type == "error")
    assert error.header["source"] == "device"
    text = client.ask(7, "scene").header["yaml"]
    assert "46000" not in text
    assert "f_number: 8" in text
    client.ask(8, "move", kind="orbit", dx=0.1)
    client.frame(lambda header: header["answers"] == 8)


def test_pause_stops_the_picture_and_resume_goes_on(client: Page) -> None:
    client.frame(at_rest)
    client.ask(5, "pause")
    client.ask(6, "dial", name="f_number", value=16)
    client.ask(7, "ping")
    time.sleep(0.3)
    client.ask(8, "ping")
    assert not any(message.type == "frame" and message.header["answers"] == 6 for message in client.seen)
    client.send("resume")
    client.frame(lambda header: header["answers"] == 6)


def test_loaded_scene_is_that_of_the_file(served: Served) -> None:
    assert served[0].origin.load().content_hash() == load_scene(served[2]).content_hash()
    assert all(path.is_absolute() for path in served[0].origin.files)


@pytest.mark.slow
def test_raw_file_of_a_scene_with_a_sensor_is_that_of_render(tmp_path: Path) -> None:
    path = tmp_path / "raw.yaml"
    path.write_text(SCENE + "\nexposure: auto\nsensor: {}\n")
    with serving(path) as (_, server), page(server) as client:
        client.frame(at_rest)
        saved = client.ask(5, "save", format="dng", name="shot")
        assert (saved.header["name"], saved.header["media"]) == ("shot.dng", "image/x-adobe-dng")
    render(path, spp=8).raw().save(tmp_path / "rendered.dng")
    assert saved.data == (tmp_path / "rendered.dng").read_bytes()


def test_picture_goes_on_while_another_process_compiles_what_autofocus_needs(
    client: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = False

    def carried_out(session: RenderSession, kind: Any, order: Any) -> bool:
        return compiled

    client.frame(at_rest)
    monkeypatch.setattr(RenderSession, "is_carried_out", carried_out)
    client.send("focus", id=300, x=0.71, y=0.5)
    client.send("dial", id=301, name="tone", value="agx")
    client.frame(lambda header: header["answers"] == 301)
    assert 300 not in [message.header.get("id") for message in client.seen]
    (notice,) = [message.header["text"] for message in client.seen if message.type == "notice"]
    assert "the picture goes on" in notice
    client.send("focus", id=302, x=0.71, y=0.5)
    for number, tone in enumerate(("srgb", "agx", "srgb"), 303):
        client.send("dial", id=number, name="tone", value=tone)
        client.frame(lambda header, number=number: header["answers"] == number)
    assert len([message for message in client.seen if message.type == "notice"]) == 2  # each says so once
    compiled = True
    (first,) = [message.header for message in client.seen if message.header.get("id") == 300]
    assert first["type"] == "done" and first["superseded"]  # by the second
    assert client.answer(302).header["type"] == "focused"


@pytest.mark.slow
@pytest.mark.usefixtures("full_kernels")
def test_order_of_a_search_is_carried_out_by_another_process(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, device = load_scene(served[2]), open_session()
    compiler = CompileServer()
    assert compiler.compile(focus_order(device.info.id, scene, None, {"point": (0.5, 0.5)}))
    assert compiler.compile(focus_order(device.info.id, scene, None, {"point": (0.0, 0.0)}))  # finds nothing
    assert not compiler.compile(focus_order("no-device", scene, None, {"point": (0.5, 0.5)}))
    compiler.close()
