"""The first picture comes first: before anything finer is begun, for whoever comes when."""

import json
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl.device.devices import CompileServer, choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.viewfinder.engine import Viewfinder
from rptcam_cl.viewfinder.messages import Client
from tests.viewfinder.page_client import ALIVE_WITHIN_S, SCENE


@pytest.fixture
def finder() -> Iterator[Viewfinder]:
    with Viewfinder(yaml.safe_load(SCENE)) as found:
        yield found


def messages(client: Client) -> Iterator[dict[str, Any]]:
    """Yield what a client is sent, frames by their headers; all of them are acknowledged."""
    end = time.monotonic() + ALIVE_WITHIN_S
    while time.monotonic() < end:
        for message in client.outbox.take():
            if isinstance(message, str):
                yield json.loads(message)
            else:
                (length,) = struct.unpack("<I", message[:4])
                header = json.loads(message[4 : 4 + length])
                client.outbox.acknowledge(header["frame"])
                yield header
        time.sleep(0.005)
    raise AssertionError("no such message came")


def test_who_comes_after_the_first_picture_gets_it_before_a_finer_one_is_begun(finder: Viewfinder) -> None:
    end = time.monotonic() + ALIVE_WITHIN_S
    while (finder._studio.a is None or finder._studio.a.shown is None) and time.monotonic() < end:
        time.sleep(0.005)
    found = next(each for each in messages(finder.connect(lambda: None)) if each["type"] == "frame")
    assert (found["scale"], found["spp"]) == (0.5, 1)


def test_while_the_kernels_of_the_film_compile_the_page_says_so_and_dials_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device, compiled = Session(choose_device()), threading.Event()
    if not device.generates_late or device.lanes == 1:
        pytest.skip("the driver compiles all of a program when it is built, or has but narrow kernels")
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))  # where no note of kernels is
    monkeypatch.setattr(CompileServer, "compile", lambda self, wanted: compiled.wait(ALIVE_WITHIN_S))
    with Viewfinder(yaml.safe_load(SCENE), device=device) as finder:  # type: ignore[arg-type]
        client = finder.connect(lambda: None)
        heard = messages(client)
        busy = next(each for each in heard if each["type"] == "compiling")
        assert busy["busy"] and busy["text"].endswith("until then the picture stays as it is")
        finder.receive(client, '{"type": "dial", "id": 7, "name": "f_number", "value": 8}')
        turned = next(each for each in heard if each["type"] == "frame" and each["answers"] == 7)
        assert turned["spp"] == 1 and not turned["stale"]
        compiled.set()
        assert not next(each for each in heard if each["type"] == "compiling")["busy"]
        assert next(each for each in heard if each["type"] == "frame" and each["spp"] > 1)["scale"] == 1
