"""The trial of a driver: a known picture, rendered in the usual way; a fault is gone round or refused, in words."""

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from rptcam_cl.core.errors import DeviceError
from rptcam_cl.core.files import CACHE_VARIABLE
from rptcam_cl.core.remember import forget
from rptcam_cl.device import devices, programs
from rptcam_cl.device.devices import problem_of
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import passes
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.passes import KNOWN, SCALE, SCENE, Way, way_of
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.rendering.progressive import render_plan
from rptcam_cl.rendering.tracer import Wavefront
from rptcam_cl.scene.load import load_scene
from tests.device.probes import open_session

# Of two packets of rays the second takes the fields of the first, as PoCL 7.1 compiled it.
GARBAGE = ("camera/packets.h", "paths[i] = packets[i].ray.path;", "paths[i] = packets[0].ray.path;")


@pytest.fixture
def untried(monkeypatch, tmp_path):
    """A session whose driver has not been tried for pictures."""
    session = open_session().alone()
    assert problem_of(session.info) is None  # tried and kept where all other tests have it
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(passes, "_passed", {})
    monkeypatch.setattr(passes, "is_proven", lambda _: False)
    return session


@pytest.fixture
def plant(monkeypatch, tmp_path, checkout):
    def plant(file, right, wrong):
        kernels = tmp_path / "kernels"
        shutil.copytree(checkout / "kernels", kernels, dirs_exist_ok=True)
        text = (kernels / file).read_text()
        assert right in text
        (kernels / file).write_text(text.replace(right, wrong))
        monkeypatch.setattr(programs, "kernels_dir", lambda: kernels)

    return plant


def film(session: Session):
    scene = load_scene(SCENE)
    wavefront = Wavefront(session, make_plan(scene), FilmLayout.of(scene.film), scene.render, scouts=False)
    return render_plan(wavefront, spp=8, seconds=None, has_lens=True).pixels


def test_known_picture_is_as_bright_as_the_formula_says():
    # As much light comes through the lens from places that lie mirrored to its axis. A point lamp of I = 3 W/sr, a
    # metre before the mesh, gives it the radiance 0.5 I / pi (1 + r^2)^-3/2, r from its foot; the rectangle has 1.
    # The film is 36 mm square, and 56.4 mm behind a thin lens of 50 mm whose image of a place 0.5 m before it is sharp.
    film = np.frombuffer(KNOWN, np.uint8).reshape(16, 16) / SCALE
    half = 18 / 56.4 * 2.0  # seen two metres away
    at = (np.arange(16) - 7.5) / 8 * half
    wall = 0.5 * 3 / np.pi * (1 + (at[None, 1:6] + 0.3) ** 2 + at[1:6, None] ** 2) ** -1.5
    assert film[1:6, 1:6].sum() / film[1:6, -2:-7:-1].sum() == pytest.approx(wall.mean(), rel=0.05)
    assert np.all(film[8:12, 9:] == 0)


def test_a_driver_that_is_right_is_tried_once_and_renders_as_it_does_usually(untried, monkeypatch, recwarn):
    assert way_of(untried, "stream", Wavefront) == Way("stream", 4)
    monkeypatch.setattr(passes, "_passed", {})

    def nothing(*_, **__):
        raise AssertionError("tried again")

    assert way_of(untried, "stream", nothing) == Way("stream", 4)  # as kept
    assert not recwarn


def test_the_driver_of_all_tests_is_not_tried_and_others_are(monkeypatch):
    def tried(*_, **__):
        raise AssertionError("tried")

    platform = SimpleNamespace(name="Portable Computing Language", version="")
    device = SimpleNamespace(platform=platform, name="pthread-some processor")
    session = SimpleNamespace(lanes=8, is_quick=False, info=SimpleNamespace(id="0:0", handle=device))
    monkeypatch.setattr(devices, "pocl_library_arch", lambda: "haswell")
    monkeypatch.setattr(passes, "fault_of", tried)
    monkeypatch.setattr(passes, "driver_name", lambda _: "unheard of")
    platform.version = "OpenCL 3.0 PoCL 3.0-rc2  Linux, Release, RELOC, LLVM 14.0.6, SLEEF, DISTRO, POCL_DEBUG"
    assert way_of(session, "stream", Wavefront) == Way("stream", 4)
    for version in ("OpenCL 3.0 PoCL 7.1  Linux, LLVM 21.1", "OpenCL 3.0 PoCL 3.0  Linux, LLVM 13.0.1"):
        platform.version = version
        with pytest.raises(AssertionError, match="tried"):
            way_of(session, "stream", Wavefront)


@pytest.mark.slow
def test_a_fault_of_packets_is_gone_round_with_a_word(untried, plant):
    right = film(open_session())
    plant(*GARBAGE)
    passes._passed.clear()
    forget("devices")
    with pytest.warns(UserWarning, match=r"wrong pictures as stream with 4 packets .*, so it renders as stream,"):
        wavefront = film(untried)
    np.testing.assert_array_equal(wavefront, right)


@pytest.mark.slow
def test_a_driver_that_is_always_wrong_is_refused_here_and_in_the_next_process(untried, monkeypatch):
    monkeypatch.setattr(passes, "KNOWN", bytes(len(KNOWN)))
    with pytest.raises(DeviceError, match=r"renders wrong pictures: as stream with 4 .* of 256 pixels"):
        film(untried)
    assert "renders wrong pictures" in problem_of(untried.info)
    with pytest.raises(DeviceError, match="cannot be used: its driver renders wrong pictures"):
        Session(untried.info)
