"""The command rptcam view in a process of its own: the browser, Ctrl-C, consent and what is missing."""

import http.client
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import connect

from tests.viewfinder.page_client import SCENE, Page


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "ball.yaml"
    path.write_text(SCENE)
    return path


@dataclass
class Running:
    """The command in a process of its own: where it is, and where it has sent the browser."""

    process: subprocess.Popen[str]
    port: int
    token: str
    visited: Path

    def browser_token(self) -> str:
        deadline = time.monotonic() + 30
        while not (self.visited.exists() and self.visited.read_text().endswith("\n")) and time.monotonic() < deadline:
            time.sleep(0.01)
        return self.visited.read_text().strip().partition("#")[2]


@pytest.fixture(scope="module")
def running(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("browser")
    browser = folder / "browser"
    browser.write_text(f'#!/bin/sh\nprintf "%s\\n" "$1" > {folder}/visited\n')
    browser.chmod(0o755)
    words = [sys.executable, "-m", "rptcam_cl", "view", str(scene)]
    environment = os.environ | {"BROWSER": str(browser), "DISPLAY": ":0"}
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(words, env=environment, text=True, **pipes)
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.search(r"http://127\.0\.0\.1:(\d+)/#([\w-]{43})$", line.strip())
    assert found, line
    yield Running(process, int(found[1]), found[2], folder / "visited")
    process.kill()


def test_browser_is_sent_with_a_token_of_its_own_that_admits_once(running: Running) -> None:
    token = running.browser_token()
    assert len(token) == 43
    assert token != running.token
    here = f"127.0.0.1:{running.port}"
    for expected in ("hello", "error"):
        with connect(f"ws://{here}/ws", origin=f"http://{here}", compression=None, proxy=None) as connection:
            client = Page(connection)
            client.send("hello", token=token, version=1)
            answer = client.wait(lambda message: message.type in ("hello", "error"))
            assert answer.type == expected
            assert answer.header.get("token", running.token) == running.token


def test_ctrl_c_ends_the_command_and_the_token_is_in_no_log(running: Running) -> None:
    process = running.process
    connection = http.client.HTTPConnection("127.0.0.1", running.port, timeout=60)
    connection.request("GET", "/?x=1")
    assert connection.getresponse().status == 200
    process.send_signal(signal.SIGINT)
    assert process.wait(120) == 0
    assert process.stdout is not None
    assert process.stderr is not None
    rest = process.stdout.read() + process.stderr.read()
    assert running.token not in rest
    assert running.browser_token() not in rest
    assert "Traceback" not in rest


def test_what_is_missing_is_said_with_how_to_install_it(scene: Path) -> None:
    program = "import sys; sys.modules['starlette'] = None; from rptcam_cl.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", program, "view", str(scene), "--no-browser"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "pip install 'rptcam_cl[view]'" in done.stderr


def test_other_machines_come_in_by_consent_alone(scene: Path) -> None:
    words = [sys.executable, "-m", "rptcam_cl", "view", str(scene), "--no-browser", "--host", "0.0.0.0"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert "--let-others-in" in done.stderr
