"""The checks of a device: a sound one passes them all, and each fault in the kernels fails one."""

import itertools
import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes import reference_scene
from rptcam_cl.cli import main
from rptcam_cl.core.errors import DeviceError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session
from rptcam_cl.optics.library import load_lens
from rptcam_cl.rendering.account import film_rays
from rptcam_cl.rendering.plan.plan import make_plan
from rptcam_cl.studies import selfcheck_suite
from rptcam_cl.studies.selfcheck import Check, film_values
from rptcam_cl.studies.selfcheck_suite import FULL_SIZE, SUITE, CardReport, run_suite, speed_scene
from tests.support.cases import fast
from tests.support.mutants import Mutant, assert_found, each_mutant


@pytest.fixture(autouse=True)
def cache_of_few_kernels(monkeypatch, tmp_path):
    """A report counts every file of the driver's cache, which may be a hundred thousand."""
    monkeypatch.setattr(selfcheck_suite, "pocl_cache_folder", lambda: tmp_path)


LONG = {
    "ways through a lens", "organisation", "tree of shapes", "leaks", "real lenses", "tree of a mesh", "self-hits",
    "light in closed rooms",
}  # fmt: skip


def checks_of(session, name):
    return [check for checks, _ in run_suite(session, {name: SUITE[name]}) for check in checks]


@pytest.mark.parametrize("name", fast(SUITE.keys() - LONG, SUITE))
def test_sound_device_passes(session, name):
    checks = checks_of(session, name)
    assert checks
    assert [check for check in checks if check.failed] == []
    assert [check for check in checks if check.skipped and session.info.fp64] == []
    assert all(check.name and check.unit for check in checks)


def test_there_are_at_least_a_dozen_checks_of_different_names():
    assert len(SUITE) >= 12


def passes(name):
    """Return a test that fails where a part of the suite finds something wrong with the device."""

    def check(session):
        assert all(check.passed for check in checks_of(session, name))

    return check


FAULTS = [
    Mutant("no product", "h.d += h.b * h.c;\n    h.a ^=", "h.d += h.b;\n    h.a ^=", passes("random numbers")),
    Mutant("infinite is finite", ">= INFINITE; }", "> INFINITE; }", passes("arithmetic")),
    Mutant("loops that end early", "i < outer; ++i)", "i < outer && steps < 65535u; ++i)", passes("loops")),
    Mutant("plain sum", "F3 y = sub(value, s.rest);", "F3 y = value;", passes("film")),
    Mutant("not y", "F g = d.z - c * dot3(q, d);", "F g = d.z - c * (q.x * d.x + q.z * d.z);", passes("lens surfaces")),
    Mutant("early total reflection", "cosine2_after > CRITICAL;", "cosine2_after > 1e-3f;",
           passes("total reflection")),
    Mutant("another conic", "(1.0f + k) * d.z * d.z);", "(1.001f + k) * d.z * d.z);", passes("stigmatic lenses")),
    Mutant("far spheres by differences", "r * r - dot3(l, l);", "b * b - c;", passes("far spheres")),
    Mutant("fitted rays without y", "at.y1 = (v - map[1] * fy) * map[2];", "at.y1 = at.y0;",
           passes("ways through a lens")),
    Mutant("what is not finite is added", "lanes = lanes & NOT(bad);", "", passes("film")),
]  # fmt: skip


@pytest.mark.slow
@each_mutant(FAULTS)
def test_fault_in_the_kernels_is_found(mutant):
    assert_found(mutant, Session(choose_device()))


def test_plain_float32_sum_would_fail_the_check_of_the_film():
    values = film_values(3, 1 << 20)
    exact = values.sum(axis=1, dtype=np.float64)
    plain = np.cumsum(values, axis=1, dtype=np.float32)[:, -1]
    error = np.abs(plain / exact - 1)
    assert (error > 2e-7).all()
    assert error.max() > 1e-3


def test_what_is_not_a_number_fails():
    assert not Check("x", math.nan, 1.0, "mm").passed
    assert Check("x", 1.0, 1.0, "mm").passed


def test_check_that_needs_float64_is_skipped_and_told_on_a_device_without(monkeypatch, capsys):
    single = replace(choose_device(), fp64=False)
    checks = SUITE["real lenses"](Session(single))
    monkeypatch.setattr(selfcheck_suite.run_suite, "__defaults__", ({"real lenses": lambda _: checks},))
    monkeypatch.setattr("rptcam_cl.device.session.open_session", lambda _: Session(single))
    assert main(["doctor", "--numerics"]) == 0
    said = capsys.readouterr().out
    assert "  skip lens: the first of them in float64                the device has no float64\n" in said
    assert "3 of 3 checks passed, 1 skipped" in said
    assert main(["doctor", "--numerics", "--json"]) == 0
    (checks,) = json.loads(capsys.readouterr().out)["numerics"].values()
    assert [(check["skipped"], check["failed"]) for check in checks] == [(False, False)] * 3 + [(True, False)]


def test_device_that_throws_in_one_check_is_tried_in_the_next(session):
    def broken(_):
        raise DeviceError("out of\nresources")

    ((check,), _), (second, _) = run_suite(session, {"broken": broken, "random numbers": SUITE["random numbers"]})
    assert (check.passed, check.name, check.note) == (False, "broken", "DeviceError: out of resources")
    assert all(check.passed for check in second)


def test_rays_of_the_margin_fill_film_and_pupil():
    lens = load_lens("wide-22mm")
    origins, directions = film_rays(lens, 14.54, (18.0, 12.0), 587.5618)
    assert (np.abs(origins[:, :2]).max(axis=0) > (17.5, 11.5)).all()
    assert (np.abs(origins[:, :2]).max(axis=0) <= (18.0, 12.0)).all()
    assert (directions[:, 2] < 0).all()
    assert lens.trace(origins, directions).passed.mean() > 0.3


def test_doctor_reports_what_there_is(capsys):
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    device = choose_device()
    assert f"* {device.id} {device.type}  {device.name}" in said
    assert "driver" in said
    assert "cache of trees" in said
    assert main(["doctor", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["packages"]["numpy"] == np.__version__
    assert [entry["id"] for entry in told["devices"] if entry["default"]] == [device.id]
    assert "numerics" not in told
    assert main(["doctor", "--device", "99:9"]) == 3
    assert "fits no OpenCL device" in capsys.readouterr().err


@pytest.fixture
def short(monkeypatch):
    """A suite that is done at once."""
    suite = {name: SUITE[name] for name in ("random numbers", "total reflection")}
    monkeypatch.setattr(selfcheck_suite.run_suite, "__defaults__", (suite,))


def test_doctor_checks_the_devices(short, capsys):
    assert main(["doctor", "--numerics"]) == 0
    said = capsys.readouterr().out
    assert f"numerics of {choose_device().id}" in said
    assert "  ok   random numbers: known answers" in said
    assert "2 of 2 checks passed" in said


def test_doctor_says_which_check_failed_and_exits_with_5(monkeypatch, capsys):
    suite = {"x": lambda _: Check("points", 2e-3, 1e-4, "mm"), "random numbers": SUITE["random numbers"]}
    monkeypatch.setattr(selfcheck_suite.run_suite, "__defaults__", (suite,))
    assert main(["doctor", "--numerics", "--device", "cpu"]) == 5
    streams = capsys.readouterr()
    assert "  FAIL points" in streams.out
    assert "0.002  allowed 0.0001 mm" in streams.out
    assert "1 of 2 checks passed" in streams.out
    assert streams.err == "error: 1 check failed; please send the report above to the authors\n"
    assert main(["doctor", "--numerics", "--json"]) == 5
    (checks,) = json.loads(capsys.readouterr().out)["numerics"].values()
    assert [check["passed"] for check in checks] == [False, True]


def test_doctor_without_a_device_reports_all_the_same(monkeypatch, capsys):
    from rptcam_cl.studies import selfcheck_suite as environment

    def none():
        raise DeviceError("no OpenCL platform was found")

    monkeypatch.setattr(environment, "list_devices", none)
    assert main(["doctor", "--numerics"]) == 3
    streams = capsys.readouterr()
    assert "no device: no OpenCL platform was found" in streams.out
    assert streams.err == "error: no OpenCL platform was found\n"


@pytest.fixture
def small_report(monkeypatch):
    """A report of one scene that is done in seconds."""
    few = {"random numbers": SUITE["random numbers"]}
    monkeypatch.setattr(CardReport.__init__, "__defaults__", (("B",), few, 16, 0.02))


@pytest.mark.slow
def test_report_of_a_card_has_every_section_and_the_known_picture(small_report, tmp_path, capsys):
    file = tmp_path / "card.json"
    assert main(["doctor", "--gpu", "-o", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    written = json.loads(file.read_text("utf-8"))
    report = written["report"]
    steps = [(section, name) for section, each in report.items() for name in each]
    assert len(lines) == len(steps) + 2
    assert all(f"[{n}/{len(steps)}] " in line for n, line in enumerate(lines[1:-1], 1))
    assert [*report] == ["driver", "numerics", "trial", "builds", "pictures", "speeds", "kernels", "launches"]
    assert written["failed"] == []
    assert [device["id"] for device in written["devices"]] == [choose_device().id]
    assert all(step["right"] and "error" not in step["value"] for each in report.values() for step in each.values())
    assert report["driver"]["answers"]["value"]["name"] == choose_device().name
    assert {trial["value"]["fault"] for trial in report["trial"].values()} == {None}
    kernels = {
        name: kernel
        for each in report["kernels"]["figures of the driver"]["value"]
        for name, kernel in each["kernels"].items()
    }
    assert kernels["stream"]["preferred_work_group_size_multiple"] > 0
    assert kernels["stream"]["work_group_size"] > 0
    assert report["launches"]["longest of each kernel"]["value"]["stream"] > 0


@pytest.mark.slow
def test_speed_of_a_report_is_paths_over_the_seconds_of_their_round(session, monkeypatch):
    ticks = itertools.count()
    monkeypatch.setattr(selfcheck_suite.time, "perf_counter", lambda: float(next(ticks)))
    report = CardReport(Session(session.info, profiling=True), ("B",), {}, 16, 3.5)
    list(report.run())
    wave = report.found["builds"]["B"]["value"]["samples_of_wave"]
    speed = report.found["speeds"]["B"]["value"]
    assert (speed["rounds"], speed["samples"]) == (4, 4 * wave)
    assert speed["paths_per_second"] == speed["fastest"] == wave * 32 * 32
    longest = report.found["launches"]["longest of each kernel"]["value"]["stream"]
    assert 0.25 * speed["passes_seconds"]["stream"] <= longest


def test_report_names_steps_that_are_wrong_and_goes_on(small_report, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(selfcheck_suite.KNOWN_MEANS, "B", 0.1)
    monkeypatch.setattr(selfcheck_suite, "fault_of", lambda *_: "3 of 256 pixels")
    not_a_number = {"broken": lambda _: Check("x", math.nan, 1.0, "mm")}
    monkeypatch.setattr(CardReport.__init__, "__defaults__", (("B",), not_a_number, 16, 0.02))
    file = tmp_path / "card.json"
    assert main(["doctor", "--gpu", "-o", str(file)]) == 5
    streams = capsys.readouterr()
    written = json.loads(file.read_text("utf-8"))
    assert [step.split(",")[0] for step in written["failed"]] == ["numerics", "trial", "trial", "pictures"]
    assert written["report"]["pictures"]["B"]["value"]["off"] == pytest.approx(0.2158, abs=1e-3)
    assert written["report"]["speeds"]["B"]["right"]
    assert "pictures, B: FAIL mean 0.12" in streams.out
    assert "pictures, B" in streams.err


def test_report_leaves_out_what_would_begin_too_late(session):
    report = CardReport(session, ("B",), {}, 16, 0.02)
    assert all("left out, as time is over" in line for line in report.run(-1.0))
    assert report.found["speeds"]["B"]["value"] == {"left_out": "-1 s were over"}


@pytest.mark.slow
def test_report_ends_a_step_that_a_driver_never_ends_and_names_it(tmp_path):
    file = tmp_path / "card.json"
    program = """
import sys
from pathlib import Path
import pyopencl
from rptcam_cl.cli import main
from rptcam_cl.studies import selfcheck_suite as suite

def endless(report):
    session, source = report._session, "__kernel void endless(volatile __global int *p) { while (p[0] == 0) ; }"
    kernel = pyopencl.Program(session.context, source).build().endless
    kernel(session.queue, (1,), None, session.allocate(4, zeroed=True))
    session.finish()

suite.CardReport.__init__.__defaults__ = ((), {}, 16, 0.02)
suite.CardReport._kernels = endless
suite.pocl_cache_folder = lambda: Path("none")
suite.END_S = 30.0
sys.exit(main(["doctor", "--gpu", "-o", sys.argv[1]]))
"""
    done = subprocess.run([sys.executable, "-c", program, str(file)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 5, done.stderr
    assert "kernels, figures of the driver: FAIL did not end before 30 s; what follows is left out" in done.stdout
    written = json.loads(file.read_text("utf-8"))
    assert written["failed"] == ["kernels, figures of the driver"]
    assert written["report"]["driver"]["answers"]["right"]
    assert "launches" not in written["report"]


def test_report_is_written_whole_or_not_at_all(small_report, monkeypatch, tmp_path, capsys):
    def stopped(*_):
        raise KeyboardInterrupt

    file = tmp_path / "card.json"
    file.write_text("before")
    monkeypatch.setattr(CardReport, "_trial", stopped)
    assert main(["doctor", "--gpu", "-o", str(file)]) != 0
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("card.json", "before")]
    capsys.readouterr()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--gpu", "--json"], "give it alone"),
        (["--gpu", "--numerics"], "give it alone"),
        (["-o", "x.json"], "-o is the file of --gpu"),
        (["--gpu", "-o", "no/such/folder/x.json"], "no/such/folder"),
    ],
)
def test_options_that_do_not_go_with_the_report_are_refused(options, said, capsys):
    assert main(["doctor", *options]) != 0
    assert said in capsys.readouterr().err


@pytest.mark.slow
def test_every_scene_of_the_report_is_the_reference_scene_and_right(session, tmp_path, monkeypatch):
    monkeypatch.setenv("RPTCAM_CACHE_DIR", str(tmp_path))  # trees that were built before would need no kernel
    report = CardReport(Session(session.info, profiling=True), shrink=8, seconds=0.2)
    list(report.run())
    assert report.failed == []
    for name, size in FULL_SIZE.items():
        ours, reference = speed_scene(name, 8), reference_scene(name, shrink=8)
        assert ours.film.resolution == (size[0] // 8, size[1] // 8) == reference.film.resolution
        films = [selfcheck_suite.picture(session, each, make_plan(each)) for each in (ours, reference)]
        np.testing.assert_allclose(films[0].mean(), films[1].mean(), rtol=1e-5)
    assert {"subtree", "stream"} <= {*report.found["launches"]["longest of each kernel"]["value"]}
