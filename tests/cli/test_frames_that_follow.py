"""Focus and exposure over frames: frame k alone is frame k of its sequence, and nothing is measured twice."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import open_session
from rptcam_cl.imaging.image import read_film
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.servo import FrameTracker

Command = Callable[..., Any]
SCENE = """
film: {resolution: [24, 16]}
camera:
  kind: thin_lens
  focal_length_mm: 50
  f_number: 2
  eye: [0, 0, 0]
  target: [0, 0, -1]
  focus: {auto: {method: depth}}
exposure: auto
shutter: {time_s: 1/100}
objects:
  - shape: box
    min: [-4, -4, -1]
    max: [4, 4, 0]
    material: {kind: matte, reflectance: 0.5}
    motion: [{time_s: 0.55, translate: [0, 0, -4]}, {time_s: 0.56, translate: [0, 0, -2]}]
environment: {kind: constant, radiance: 1}
sequence:
  frames_per_second: 10
  continuous_focus: {lock_s: 0.15, speed: 14}
  exposure_time_constant_s: 0.5
  keys:
    environment.radiance: [{time_s: 0, value: 1}, {time_s: 0.19, value: 1}, {time_s: 0.2, value: 8}]
"""


@pytest.fixture
def following(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("RPTCAM_CACHE_DIR", str(tmp_path / "kept"))
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE, "utf-8")
    return path


def test_focus_waits_goes_and_arrives_and_exposure_follows_the_light(following: Path) -> None:
    tracker = FrameTracker(rptcam_cl.load_scene(following), lambda: open_session(None))
    frames = [tracker.frame(number) for number in range(1, 17)]
    focus = np.array([scene.camera.focus_distance_m for scene, _ in frames])
    # the box has come nearer in frame 7; in frame 9 the lock has passed, which is known 0.05 s later
    assert focus[:9] == pytest.approx([4.0] * 9, rel=0.01)
    assert (np.diff(focus[9:]) <= 1e-6).all()
    assert 2.1 < focus[10] < 3.9  # under way, at its speed
    assert all(metadata["continuous_focus"]["at_greatest_speed"] for _, metadata in frames[10:13])
    assert focus[-1] == pytest.approx(2.0, rel=0.025)  # 0.25 depths of focus
    read = np.array([scene.exposure.lock_cd_m2 for scene, _ in frames])
    assert read[1] == pytest.approx(read[0], rel=0.02)
    share = np.log(read[2:7] / read[0]) / np.log(8)
    assert share == pytest.approx(1 - np.exp(-0.1 * np.arange(1, 6) / 0.5), abs=0.02)


def test_frame_alone_is_the_frame_of_its_sequence_to_the_byte(
    following: Path, rptcam: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("render", "scene.yaml", "-o", "out.####.exr", "--spp", "2", "--frames")
    run = rptcam(*words, "9-11")
    assert run.code == 0, run.err
    before = Path("out.0011.exr").read_bytes()
    assert read_film("out.0011.exr").metadata["continuous_focus"]["speed"] == pytest.approx(14)
    tracker = FrameTracker(rptcam_cl.load_scene(following), lambda: open_session(None))
    tracker.frame(11)
    assert tracker.measured == 0  # all of it was kept
    with monkeypatch.context() as other:
        other.setitem(vars(open_session(None).info), "driver", "another")
        tracker = FrameTracker(rptcam_cl.load_scene(following), lambda: open_session(None))
        tracker.frame(1)
        assert tracker.measured == 2  # what another driver has measured is not taken for it
    assert rptcam(*words, "11").code == 0
    assert Path("out.0011.exr").read_bytes() == before
    assert "kept out.0011.exr" in rptcam(*words, "11", "--resume").err
    run = rptcam("focus", "scene.yaml", "--frames", "9-12", "--plot", "curve.svg")
    assert run.code == 0
    assert "the subject is faster than the focus drive in 3 of 4 frames, from frame 10 on" in run.err
    assert "within 0.5 depth of focus in 0 of 4 frames" in run.out
    assert "subject, as measured" in Path("curve.svg").read_text("utf-8")


def test_measured_anew_it_is_the_same(following: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, found = rptcam_cl.load_scene(following), []
    for folder in ("one", "two"):
        monkeypatch.setenv("RPTCAM_CACHE_DIR", str(tmp_path / folder))
        tracker = FrameTracker(scene, lambda: open_session(None))
        frame, _ = tracker.frame(4)
        assert tracker.measured == 8  # focus and meter of each frame from the first on
        found.append((frame.camera.focus_distance_m, frame.exposure.lock_cd_m2, frame.content_hash()))
    assert found[0] == found[1]


def test_exposure_follows_what_each_frame_is_metered_to_in_focus(following: Path) -> None:
    scene = rptcam_cl.load_scene(following, ["sequence.continuous_focus=null", "camera.f_number=1"])
    tracker = FrameTracker(scene, lambda: open_session(None))
    (first, metadata), (later, _) = tracker.frame(1), tracker.frame(3)
    assert metadata == {} and first.requested_autofocus is not None
    alone = [render_alone(scene, time_s) for time_s in (0.0, 0.2)]
    assert first.exposure.lock_cd_m2 == pytest.approx(alone[0], rel=1e-6)
    share = np.log(later.exposure.lock_cd_m2 / alone[0]) / np.log(alone[1] / alone[0])
    assert share == pytest.approx(1 - np.exp(-0.1 / 0.5), rel=1e-6)
    assert tracker.frame(1)[0].exposure == first.exposure  # an earlier frame again


def render_alone(scene: Scene, time_s: float) -> float:
    """The reading of the meter for a picture of that moment."""
    radiance = 1.0 if time_s < 0.19 else 8.0
    changes = {"sequence": None, "shutter.open_s": time_s, "environment.radiance": radiance}
    reading = rptcam_cl.render(set_keys(scene, changes), spp=1).metadata["metered_cd_m2"]
    assert isinstance(reading, float)
    return reading


def test_first_frame_with_nothing_to_focus_on_is_named(following: Path) -> None:
    scene = rptcam_cl.load_scene(following, ["objects=[]"])
    with pytest.raises(InputError, match=r"^frame 1: camera\.focus\.auto: nothing to focus on in the first frame"):
        FrameTracker(scene, lambda: open_session(None)).frame(2)


def test_one_picture_is_taken_of_a_scene_that_is_followed(following: Path) -> None:
    alone = rptcam_cl.load_scene(following, ["sequence=null"])
    of_sequence = rptcam_cl.load_scene(following)
    assert np.array_equal(rptcam_cl.render(of_sequence, spp=1).pixels, rptcam_cl.render(alone, spp=1).pixels)
    with rptcam_cl.RenderSession(following) as session:
        session.change({"camera.f_number": 4})
        assert session.scene.sequence is not None and session.scene.sequence.continuous_focus is None
    rptcam_cl.settle(following, "settled.yaml")
    assert not rptcam_cl.load_scene("settled.yaml").warnings


def test_what_has_nothing_to_follow_is_a_warning(following: Path) -> None:
    scene = rptcam_cl.load_scene(following, ["camera.focus_distance_m=2", "exposure=relative"])
    focus, exposure = scene.warnings
    assert focus.startswith("sequence.continuous_focus follows nothing, as the focus is given")
    assert exposure.startswith("sequence.exposure_time_constant_s follows nothing, as the exposure is relative")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("sequence.exposure_time_constant_s=0", "exposure_time_constant_s: is out of range"),
        ("sequence.continuous_focus.speed=0", "continuous_focus.speed: is out of range"),
    ],
)
def test_mistake_is_named(following: Path, override: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        rptcam_cl.load_scene(following, [override])
    assert message in str(caught.value)
