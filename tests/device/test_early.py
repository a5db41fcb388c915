"""The device opened by a thread: what was built last time is built before it is wanted, and nothing fails there."""

import gc
import subprocess
import sys
import threading
import weakref

import pytest

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.device import drivers
from rptcam_cl.device import programs as program
from rptcam_cl.device import session as early
from rptcam_cl.device import session as sessions
from rptcam_cl.device.programs import Program
from rptcam_cl.device.session import OPENING, Session, means_one, open_early, open_session

SOURCES = {f"__kernel void {name}(__global float *out) {{ out[0] = 1.0f; }}\n": name for name in ("one", "two")}
SCENE = """\
film: {resolution: [8, 8]}
camera: {kind: pinhole, eye: [0, 0, 5], target: [0, 0, 0], fov_degrees: 40}
objects: [{shape: sphere, center: [0, 0, 0], radius: 1, material: {kind: matte, reflectance: 0.5}}]
environment: {kind: constant, radiance: 1}
"""
# Renders, and says in which threads programs were built that the picture needed.
RENDER = """\
import sys, threading
from rptcam_cl.device import session
from rptcam_cl.__main__ import run
open_early = session.open_early
def open_and_wait(*arguments):
    found = open_early(*arguments)
    [thread.join() for thread in threading.enumerate() if thread is not threading.main_thread()]
    return found
session.open_early = open_and_wait
class Noted(session.Program):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        main = threading.current_thread() is threading.main_thread()
        print("main" if main else "beside", len(arguments[2]) > 10_000, file=sys.stderr)
session.Program = Noted
run()
"""

pytestmark = pytest.mark.usefixtures("full_kernels")  # their sources are as they were assembled


@pytest.fixture
def session(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    opened = Session(open_session("cpu").info)
    monkeypatch.setattr(early, "open_session", lambda spec: opened)
    return opened


def wait():
    for thread in threading.enumerate():  # a worker of other tests has threads that stay
        if thread.name == OPENING:
            thread.join(60)


def built(monkeypatch):
    """The sources of programs built from now on."""
    found = []

    class Counted(Program):
        def __init__(self, context, device, source):
            found.append(source)
            super().__init__(context, device, source)

    monkeypatch.setattr(sessions, "Program", Counted)
    return found


def request(session, monkeypatch, sources):
    """Request programs as passes do, by what they are made of."""
    for source in sources:
        monkeypatch.setattr(sessions, "assemble", lambda *_, source=source, **__: source)
        session.bind(session.program([source], {}, ""), SOURCES[source], out=session.allocate(4))


def test_programs_of_the_last_time_are_built_before_they_are_wanted(session, monkeypatch):
    ended_well = open_early("cpu", "render", "a.yaml")
    wait()
    request(session, monkeypatch, SOURCES)
    ended_well()
    found = built(monkeypatch)
    for again in range(2):
        session._programs.clear()
        ended_well = open_early("cpu", "render", "a.yaml")
        wait()
        assert found == list(SOURCES) * (again + 1)
        with monkeypatch.context() as patch:
            patch.setattr(program, "kernel_parameters", lambda source: 1 / 0)  # these are kept as well
            request(session, patch, SOURCES)
        assert found == list(SOURCES) * (again + 1)  # nothing was built twice
        ended_well()


def test_what_was_built_already_is_not_built_again(session, monkeypatch):
    one, two = SOURCES
    request(session, monkeypatch, [one])
    found = built(monkeypatch)
    session.foresee([(one, {"one": ["out"]}), (two, {"two": ["out"]})])
    assert found == [two]


@pytest.mark.parametrize(
    "change", [lambda text: text[:-1], lambda text: b"", lambda text: text[:40] + b"?" + text[41:]]
)
def test_what_is_damaged_is_not_built(session, monkeypatch, tmp_path, change):
    request(session, monkeypatch, SOURCES)
    open_early("cpu", "render", "a.yaml")()
    wait()
    [kept] = (tmp_path / early._DISK.kind).iterdir()
    kept.write_bytes(change(kept.read_bytes()))
    session._programs.clear()
    found = built(monkeypatch)
    open_early("cpu", "render", "a.yaml")
    wait()
    assert not set(SOURCES) & set(found)


def test_errors_of_the_thread_are_left_to_who_wants_the_device(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path))
    failed = []
    monkeypatch.setattr(threading, "excepthook", failed.append)
    open_early("no such device")
    wait()
    assert not failed
    with pytest.raises(DeviceError, match="fits no OpenCL device"):
        open_session("no such device")


def test_process_that_ends_amid_the_work_of_a_thread_has_not_ended_well(tmp_path):
    drivers.mark_work(tmp_path, ended_well=lambda: True)
    [mark] = tmp_path.iterdir()
    with drivers.unfinished_work():
        drivers.end_work()
    assert mark.exists()


@pytest.mark.parametrize(
    ("wanted", "split", "one"),
    [
        (None, None, True), ("cpu", None, True), ("0:0", None, True), ("all", None, False), ("0:0,1:0", None, False),
        (None, "0:0=0.5,1:0=0.5", False),
    ],
)  # fmt: skip
def test_which_words_mean_a_single_device(monkeypatch, wanted, split, one):
    monkeypatch.delenv("RPTCAM_DEVICE", raising=False)
    assert means_one(wanted, split) == one


@pytest.mark.slow
def test_second_render_of_a_scene_finds_its_programs_built(monkeypatch, tmp_path):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    (tmp_path / "scene.yaml").write_text(SCENE)
    words = ["render", str(tmp_path / "scene.yaml"), "--quiet", "-o", str(tmp_path / "picture.png")]

    def programs():
        done = subprocess.run([sys.executable, "-c", RENDER, *words], capture_output=True, text=True, check=True)
        return [line.split() for line in done.stderr.splitlines()]

    assert programs()[-1] == ["main", "True"]  # what was before is to read PoCL's library
    assert programs() == [["beside", "True"]]


def test_programs_of_many_scenes_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    source = next(iter(SOURCES))
    monkeypatch.setattr(sessions, "_MOST_SOURCE", 4 * len(source))
    built: list[weakref.ref[Program]] = []

    def build(self: Session, text: str) -> Program:
        program = Program(self.context, self.info.handle, text)
        built.append(weakref.ref(program))
        return program

    monkeypatch.setattr(Session, "_built", build)
    monkeypatch.setattr(sessions, "assemble", lambda files, facts, declarations, library_arch: source)
    device = Session(open_session().info)
    for number in range(12):
        device.program(["one.cl"], {"NUMBER": number}, "")
        device.program(["one.cl"], {"NUMBER": 0}, "")  # what is used stays
    gc.collect()
    assert [each() is not None for each in built] == [True] + 8 * [False] + 3 * [True]
