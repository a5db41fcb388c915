"""A focus that failed is told: in the report, in the picture's metadata, on the command line."""

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import rptcam_cl
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError, NumericError
from rptcam_cl.device.session import open_session
from rptcam_cl.scene.changes import set_keys
from rptcam_cl.scene.lens_settings import AutoFocus
from rptcam_cl.studies.focus import contrast
from rptcam_cl.studies.focus.controller import METHODS, follow_focus, with_warnings
from rptcam_cl.studies.focus.probe import FocusReport, NoContrast, OutOfReach, Peak, Policy, Zone
from rptcam_cl.studies.focus.renderer import Task
from tests.studies.focus.scenes import CENTRE, checker, lens_camera, noise, probe_of, scene_of, target
from tests.studies.focus.test_probe import THIN, with_group
from tests.support.cases import slow

WORDS = r"cannot focus at 160 mm from the film; the nearest possible is 195\.985 mm"
POSE = {"eye": [0, 0, 0], "target": [0, 0, -1]}


def too_near(method):
    """Return a scene with a card 160 mm before the film of a lens that focuses from 196 mm on."""
    camera = lens_camera("dgauss-50mm", focus={"auto": method})
    return scene_of([target(0.16, 0.1, noise(60)), target(4.0, 4.0, noise(60))], camera)


@pytest.mark.parametrize("method", [m if m == "depth" else slow(m) for m in METHODS])
def test_every_method_says_that_the_target_is_nearer_than_possible(method):
    with pytest.raises(OutOfReach, match=WORDS) as refusal:
        rptcam_cl.autofocus(too_near(method))
    assert refusal.value.state == pytest.approx(86.46407)


@pytest.mark.parametrize(
    ("camera", "distance", "message"),
    [
        (THIN | POSE, 0.08, "cannot focus at 80 mm from the lens; the nearest possible is 100 mm"),
        (lens_camera(with_group()), 0.9, "group"),
    ],
    ids=["thin lens", "group"],
)
def test_end_of_the_focus_is_told_whatever_moves(camera, distance, message):
    scene = scene_of([target(distance, distance, checker(40))], camera)
    with pytest.raises(OutOfReach, match=message):
        rptcam_cl.autofocus(scene, "depth")


SCENE = """
film: {resolution: [36, 24], size_mm: [36, 24]}
camera: {kind: realistic, lens: dgauss-50mm, eye: [0, 0, 0], target: [0, 0, -1], focus: {auto: depth}}
render: {spp: 1, max_depth: 2}
environment: {kind: constant, radiance: 1}
objects:
  - {shape: rectangle, corner: [-0.1, -0.1, -0.16], edge_u: [0.2, 0, 0], edge_v: [0, 0.2, 0],
     material: {kind: matte, reflectance: 0.5}}
"""


@pytest.mark.slow
def test_picture_of_a_focus_that_failed_says_so_and_strict_fails():
    scene = rptcam_cl.load_scene(yaml.safe_load(SCENE))
    picture = rptcam_cl.render(scene, spp=1)
    found = picture.metadata["autofocus"]
    assert "cannot focus at 160 mm from the film" in found["failure"]
    assert found["warnings"] == [found["failure"]]
    assert found["confidence"] == 0.0
    assert picture.stats["autofocus"] == found
    assert picture.metadata["film_distance_mm"] == pytest.approx(86.46407)  # as near as it goes
    with pytest.raises(NumericError, match=r"strict: autofocus: .*cannot focus at 160 mm"):
        rptcam_cl.render(scene, spp=1, strict=True)


def test_command_line_warns_and_strict_exits_with_5(tmp_path, capsys):
    scene, picture, stats = (tmp_path / name for name in ("scene.yaml", "picture.png", "stats.json"))
    scene.write_text(SCENE)
    given = ["render", str(scene), "-o", str(picture), "--quiet"]
    assert main([*given, "--stats", str(stats)]) == 0
    said = capsys.readouterr().err
    assert "warning: autofocus: Double Gauss 50 mm f/2: cannot focus at 160 mm from the film" in said
    assert "cannot focus at 160 mm" in json.loads(stats.read_text())["autofocus"]["failure"]
    assert b"cannot focus at 160 mm" in picture.read_bytes()
    picture.unlink()
    assert main([*given, "--strict"]) == 5
    assert "error: strict: autofocus: Double Gauss" in capsys.readouterr().err
    assert picture.exists()
    assert main(["focus", str(scene)]) == 2
    assert "cannot focus at 160 mm" in capsys.readouterr().err


def report_of(probe, method, confidence, distance=4.0, zone=CENTRE):
    """Return a report as a method makes it, for a wall."""
    task = Task(probe, (zone,), Policy.CLOSEST)
    return task, task.report(method, probe.drive.state_for(distance, zone), zone, 0.1, confidence, [])


@pytest.mark.parametrize(
    ("method", "confidence", "message"),
    [
        ("contrast", 0.2, r"uncertain: confidence 0\.20, standard error 0\.8 depths of focus"),
        ("phase", 0.0, r"uncertain: confidence 0\.00"),
        ("depth", 0.01, "the depth of field holds 1% of what the zone shows"),
        ("variance", 0.0, "variance tells nothing of its own error"),
    ],
)
def test_low_confidence_is_a_failure(method, confidence, message):
    probe = probe_of(scene_of([target(4.0, 4.0, checker(200))], lens_camera("dgauss-50mm", f_number=2.1)))
    task, report = report_of(probe, method, confidence)
    failed = with_warnings(task, replace(report, error=0.8 * probe.drive.depth_of_focus))
    assert re.search(message, failed.failure)
    assert failed.warnings == [failed.failure]
    if method != "variance":
        sure = with_warnings(task, replace(report, confidence=0.99))
        assert (sure.failure, sure.warnings) == (None, [])


@pytest.mark.parametrize("off", [-3.0, -0.7, 0.7, 3.0])
def test_focus_on_nothing_that_the_zone_shows_is_a_failure(off):
    probe = probe_of(scene_of([target(4.0, 4.0, checker(200))], lens_camera("dgauss-50mm", f_number=2.1)))
    task, report = report_of(probe, "phase", 1.0)
    assert with_warnings(task, report).failure is None
    state = report.state + off * probe.drive.depth_of_focus
    failed = with_warnings(task, task.report("phase", state, CENTRE, 0.0, 1.0, []))
    assert re.search(
        rf"nothing that the zone shows is sharp.* 4 m away.* {abs(off):g} depths of focus off", failed.failure
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", ["phase", "contrast", "laplacian", "hybrid"])
def test_probes_have_the_noise_and_the_white_of_the_sensor(method):
    scene = scene_of([target(4.0, 4.0, noise(200))], lens_camera("dgauss-50mm", f_number=2.1))
    keys = {"exposure": "physical", "shutter.time_s": 0.02}

    def found(radiance, **more):
        lit = {**keys, "sensor": {"pixel_pitch_um": 4}, "environment.radiance": radiance, **more}
        return rptcam_cl.autofocus(set_keys(scene, lit), method, sensor=True)

    # 683 cd/m2 at f/2.1, 1/50 s and ISO 100 are nine times white: 10 * 683 * pi / (4 * 2.1^2) / 50 / 78 lx s
    with pytest.raises(NoContrast, match="100% of it is white in this exposure"):
        found(10.0)
    report = found(0.05)  # a twentieth of white
    assert report.failure is None
    # a depth of focus is worth 2 N c / f^2 = 0.0485 / m
    assert abs(1 / report.focus_distance_m - 1 / 4.0) <= 0.25 * 0.0485
    with pytest.raises(NoContrast, match="it is dark in this exposure: the noise of a probe is"):
        found(1e-6)
    assert found(1.0, exposure="auto").failure is None
    with pytest.raises(InputError, match="sensor: the scene has none"):
        rptcam_cl.autofocus(scene, method, sensor=True)


@pytest.mark.slow
def test_edge_of_a_near_board_is_focused_on_the_board_alone():
    walls = [target(1.0, 0.6, noise(120), x=-0.61), target(3.0, 3.0, noise(300))]
    scene = scene_of(walls, lens_camera("dgauss-50mm", f_number=2.1))
    for method in ("contrast", "phase"):
        report = rptcam_cl.autofocus(scene, method, zones=[[0.46, 0.54, 0.45, 0.55]])
        assert report.focus_distance_m == pytest.approx(1.0, rel=0.005)
        assert report.zone == Zone(0.46, 0.54, 0.45, 0.55)


def test_second_distance_in_a_zone_is_told():
    walls = [target(1.0, 0.6, noise(120), x=-0.6), target(3.0, 3.0, noise(300))]
    probe = probe_of(scene_of(walls, lens_camera("dgauss-50mm")))
    for distance, other in ((1.0, "3 m"), (3.0, "1 m")):
        task, report = report_of(probe, "contrast", 0.99, distance, Zone(0.46, 0.54, 0.45, 0.55))
        (remark,) = with_warnings(task, report).remarks
        assert "two distances" in remark
        assert f"what is {other} away fills" in remark
    task, report = report_of(probe, "contrast", 0.99, 3.0, Zone(0.7, 0.78, 0.45, 0.55))
    assert with_warnings(task, report).remarks == ()


def test_distance_that_a_zone_shows_only_once_the_focus_is_there_is_told():
    # The image of what is near grows by half on the way to it: the card moves into the zone, and the wall out of it.
    zone = Zone(0.735, 0.775, 0.46, 0.54)
    probe = probe_of(
        scene_of([target(0.26, 0.03, noise(40)), target(3.0, 3.0, noise(300))], lens_camera("dgauss-50mm"))
    )
    task, report = report_of(probe, "contrast", 0.99, 3.0, zone)
    states = report.state, probe.drive.state_for(0.26, zone)
    shown = [float(np.median(probe.sight(state, zone).depths)) for state in states]
    assert shown == pytest.approx([3.0, 0.26], rel=1e-3)
    (remark,) = with_warnings(task, report).remarks
    assert "what is 0.26 m away fills 100% of the zone when the focus is there" in remark


@pytest.mark.slow
def test_line_focuses_of_an_anamorphic_lens_are_told():
    probe = probe_of(scene_of([target(1.0, 0.6, checker(200))], lens_camera("anamorphic-100mm")))
    task, report = report_of(probe, "contrast", 0.99, 1.0)
    (remark,) = with_warnings(task, report).remarks
    assert "astigmatic in the zone: upright lines are sharp at" in remark
    # one line focus on the wall, so that the lens as a whole is focused beyond it: that is no second distance
    assert [
        word for word in with_warnings(*report_of(probe, "contrast", 0.99, 1.119)).remarks if "two distances" in word
    ] == []
    round_one = probe_of(scene_of([target(1.0, 0.6, checker(200))], lens_camera("dgauss-50mm")))
    assert with_warnings(*report_of(round_one, "contrast", 0.99, 1.0)).remarks == ()


def test_animation_keeps_its_focus_where_the_target_is_too_near():
    frames = [scene_of([target(d, d, noise(60))], lens_camera("dgauss-50mm")) for d in (2.0, 0.16)]
    first, second = follow_focus(frames, open_session(None), AutoFocus(method="depth"))
    assert isinstance(second, FocusReport)
    assert second.state == first.state
    assert "cannot focus at 160 mm" in second.failure
    assert "focus of the frame before is kept" in second.failure
    assert math.isclose(second.confidence, 0.0)


@pytest.mark.parametrize(
    ("place", "inside", "start", "message"),
    [
        (50.0, True, None, None),
        (50.0, True, (50.0, 5.0), None),
        (55.0, False, (50.0, 5.0), "it still gets sharper where it was searched"),
        (30.0, False, (32.0, 5.0), None),  # at infinity
        (30.0, False, None, None),
        (80.0, False, None, "what the zone shows is too near: it still gets sharper where the focus ends"),
        (80.0, False, (78.0, 5.0), "it still gets sharper where it was searched"),
    ],
)
def test_top_at_the_end_of_what_was_searched_is_none_but_for_infinity(place, inside, start, message, monkeypatch):
    peak = Peak(place, 0.02, 3.0, 9.0, inside)
    before = replace(peak, place=place + 0.3)  # in the last round but one
    stand_ins = {
        "_round": ([], 8), "_widen": {0: before}, "_still_possible": [0], "_next_step": 1.0, "_three_places": [],
        "_for_measure": 1.0, "_for_place": 1.0, "_refine": peak, "choose_zone": 0, "_narrow_zones": None,
    }  # fmt: skip
    for name, value in stand_ins.items():
        monkeypatch.setattr(contrast, name, lambda *_, value=value: value)
    drive = SimpleNamespace(depth_of_focus=0.4)
    probes = SimpleNamespace(
        ends=(30.0, 80.0), drive=drive, most=64, affordable=64, enough=64, task=SimpleNamespace(zones=(CENTRE,))
    )
    if message is None:
        found, zone = contrast.greatest_contrast(probes, Policy.CENTRE, start)
        assert (found.place, zone) == (place, 0)
        assert found.uncertainty == pytest.approx(math.hypot(0.02, 0.075))  # by a quarter of how the top moved, too
    else:
        with pytest.raises(NoContrast, match=message):
            contrast.greatest_contrast(probes, Policy.CENTRE, start)


def test_first_stop_makes_the_steps_of_the_first_round_so_many_depths_of_focus():
    for reach, sharp in ((50.0, 0.4), (50.0, 0.1), (1.0, 0.4)):
        probes = SimpleNamespace(ends=(30.0, 30.0 + reach), drive=SimpleNamespace(depth_of_focus=sharp))
        stop = contrast.first_stop(probes)
        assert 0 < stop <= 1
        step = reach / (contrast.FIRST_PROBES - 1)
        assert stop == 1 or step == pytest.approx(contrast.STEP * sharp / stop)
        assert stop < 1 or step <= contrast.STEP * sharp
