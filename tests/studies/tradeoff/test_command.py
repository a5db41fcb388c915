"""The comparison of a small scene, and the command that prints it."""

import itertools
import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest

from rptcam_cl.api import options as values
from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.devices import choose_device
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies import tradeoff_runs
from rptcam_cl.studies.tradeoff import recommendation, summary, tables, tradeoff_plot
from rptcam_cl.studies.tradeoff_runs import _ghosts, ladder, measure_tradeoff, most_accurate, prepare, run, spread_tiles

BOARD = {"kind": "matte", "reflectance": {"kind": "checker", "even": 0.8, "odd": 0.1, "scale": [60, 60]}}
LAMP = {"kind": "emissive", "radiance": 2.0}
SCENE = {
    "film": {"resolution": [48, 32], "width_mm": 36},
    "camera": {
        "kind": "realistic", "lens": "telephoto-250mm", "f_number": 5.6, "eye": [0, 0, 0], "target": [0, 0, -1],
        "focus": {"distance_m": 5.0},
    },
    "render": {"max_depth": 6},
    "objects": [
        {"shape": "rectangle", "corner": [-3, -3, -8], "edge_u": [6, 0, 0], "edge_v": [0, 6, 0], "material": BOARD},
        {"shape": "rectangle", "corner": [-2, -0.2, -8], "edge_u": [4, 0, 0], "edge_v": [0, 0, 6], "material": BOARD},
        {"shape": "rectangle", "corner": [-3, 3, -8], "edge_u": [6, 0, 0], "edge_v": [0, 0, 8], "material": LAMP},
    ],
}  # fmt: skip


TINY = {"resolution": [8, 8]}
PINHOLE = {"kind": "pinhole", "fov_degrees": 40, "eye": [0, 0, 0], "target": [0, 0, -1]}


@pytest.fixture(scope="module")
def report():
    return measure_tradeoff(load_scene(SCENE), budget=3.0, seconds=1.0, error=0.05)


@pytest.mark.slow
def test_accuracy_never_makes_the_measured_bias_worse(report):
    """Camera models and depths by rising accuracy: no bias is surely larger than that of a cheaper one."""
    for steps in (("pinhole", "thin lens", "thick lens"), ("depth 2", "depth 4")):
        biases = [report.named(name).bias for name in steps]
        for worse, better in itertools.pairwise(biases):
            assert better.low <= worse.high, steps
        assert biases[0].low > max(biases[-1].value, 0.0), steps  # and the measurement can tell
    for found in report.measurements:
        if found.unbiased:
            assert found.bias.low < 1e-3 and found.bias.value < report.named("pinhole").bias.low, found.name


@pytest.mark.slow
def test_everything_that_differs_is_there_once(report):
    names = [found.name for found in report.measurements]
    assert names[0] == "full"
    assert {"lens: float64", "thick lens", "thin lens", "pinhole", "depth 2", "depth 4", "independent samples"} <= set(
        names
    )
    assert len(names) == len(set(names))
    every = [same for found in report.measurements for same in found.same_as]
    assert {"as the scene says", "accuracy: auto", "spectrum: rgb"} <= {*names, *every}
    assert report.named("as the scene says") in report.measurements
    with pytest.raises(InputError, match=r"^pin hole: was not compared \(there are: full, "):
        report.named("pin hole")


@pytest.mark.slow
def test_report_says_how_large_the_diffraction_is(report):
    assert report.diffraction["on"] is False
    # f/5.6, 5.3 m from the film of a 250 mm lens: the Airy radius is 4 um, of pixels that are 750 um wide.
    assert 3.7e-3 < report.diffraction["airy_radius_px"] * 0.75 < 4.6e-3
    assert "camera.diffraction: auto is off: the Airy radius is 0.005" in " ".join(recommendation(report))


def test_ghosts_of_the_report_are_those_of_the_lens():
    camera = {"kind": "realistic", "lens": "dgauss-50mm", "focus": {"distance_m": 1e6}, "eye": [0, 0, 0],
              "target": [0, 0, -1]}  # fmt: skip
    lamp = {"kind": "point", "position": [0, 0, -9], "intensity": [1, 1, 1]}
    shares = [
        _ghosts(load_scene({"film": {"resolution": [36, 24], "width_mm": 36}, "lights": [lamp], "objects": [],
                            "camera": camera | {"transmission": word}}))
        for word in ("bare", "ideal")
    ]  # fmt: skip
    assert shares == [pytest.approx(3.596e-2, rel=0.01), None]


@pytest.mark.slow
def test_lens_in_float64_takes_the_same_samples_and_shows_no_bias(report):
    full, double = report.named("full"), report.named("lens: float64")
    assert abs(double.bias.value) < 1e-6 < report.named("pinhole").bias.low
    assert double.noise[0].value == pytest.approx(full.noise[0].value, rel=1e-3)  # the same samples
    assert "camera.precision=double" in double.settings


def test_most_accurate_way_traces_in_float32_whatever_the_scene_says():
    full = most_accurate(load_scene(SCENE, ["camera.rays=fitted"])).scene.camera
    assert (full.rays, full.precision, full.pupil) == ("traced", "single", "auto")
    assert most_accurate(load_scene(SCENE, ["camera.precision=double"])).scene.camera.precision == "single"


@pytest.mark.slow
def test_device_without_float64_is_said_not_to_compare_it(monkeypatch):
    session = Session(choose_device())
    monkeypatch.setattr(session, "info", replace(session.info, fp64=False))
    steps = [step for step in ladder(load_scene(SCENE))[0] if step.name in ("full", "lens: float64")]
    ready, skipped = prepare(steps, session, lambda name, done: None)
    assert [each.configuration.name for each in ready] == ["full"]
    assert skipped["lens: float64"].startswith("camera.precision: double needs float64, which device ")


@pytest.mark.slow
def test_times_and_rates_are_those_of_the_runs(report):
    for found in report.measurements:
        assert 0 < found.sample_s.low <= found.sample_s.value <= found.sample_s.high
        assert found.rate.value == pytest.approx(found.noise_after(1.0))
        assert found.start_s > 0
    assert report.named("full").seconds_to[0.02].value < report.named("full").seconds_to[0.01].value
    assert math.isinf(report.named("pinhole").seconds_to[0.01].value)


@pytest.mark.slow
def test_depth_is_bounded_by_the_reflectance(report):
    assert report.truncation["bound"] == pytest.approx(0.8**6 / (1 - 0.8))
    assert any(
        "Light paths end after 6 edges" in line and "add at most 131 %" in line for line in recommendation(report)
    )


@pytest.mark.slow
def test_report_reads_well(report):
    said = recommendation(report)
    assert [line.partition(":")[0] for line in said[:3]] == ["Set", "Costs", "Gains"]
    assert said[0].startswith("Set: in 1 s rptcam render SCENE ") and "; to an error of 5 % rptcam render" in said[0]
    assert any(line.startswith("Full accuracy (full in the tables) is the most accurate way") for line in said)
    errors, costs, cameras = tables(report)
    assert all(len(row) == len(columns) for _, columns, rows in (errors, costs, cameras) for row in rows)
    assert len(costs[2]) == len(errors[2]) + 1 == len(report.measurements)
    text = report.markdown("a scene")
    assert str(report).startswith(said[0]) and "nan" not in str(report)
    assert report.svg().startswith("<svg")
    assert text.startswith("# a scene\n")
    assert "| pinhole |" in text
    assert json.loads(json.dumps(report.as_dict(), default=np.ndarray.tolist))["seeds"] == report.seeds
    assert len(tradeoff_plot(report, "a scene").axes) > 2


@pytest.mark.slow
def test_what_took_longer_than_the_budget_is_said(report):
    late = replace(report, budget=1.0, seconds=3.0)
    assert summary(late)[-2].startswith("Measuring took 3 s in place of 1 s: preparing ")
    assert not any("in place of" in line for line in summary(replace(report, budget=3.0, seconds=3.2)))


@pytest.mark.slow
def test_turns_end_where_they_take_longer_than_the_first_said(monkeypatch):
    steps = {step.name: step for step in ladder(load_scene(SCENE))[0]}
    ready, _ = prepare([steps["thin lens"], steps["thick lens"]], open_session(), lambda name, done: None)
    extent = spread_tiles(ready[0].wavefront.layout, 24, np.random.default_rng(0)), 1
    monkeypatch.setattr(tradeoff_runs, "_extent", lambda *_: extent)

    def slowly(*work):
        until = time.process_time() + 0.02
        while time.process_time() < until:
            pass
        return run(*work)

    monkeypatch.setattr(tradeoff_runs, "run", slowly)
    shares = []
    hurried = tradeoff_runs.render_by_turns(ready, 0.2, 1, lambda words, share: shares.append(share))
    assert shares == sorted(shares) and shares[0] == 0 and 0.5 < shares[-1] <= 1
    assert hurried.seeds == 4 and len(hurried.long.chosen) == 16
    assert all(part.shape[0] == 4 for each in hurried.pixels for part in each)
    assert all(len(wall) == 4 for _, wall in hurried.timings)
    assert tradeoff_runs.render_by_turns(ready, 60.0, 1, lambda words, share: None).seeds == 8


def test_times_are_those_of_a_sample_of_every_pixel_of_the_film(monkeypatch):
    steps = {step.name: step for step in ladder(load_scene(SCENE))[0]}
    ready, _ = prepare([steps["thin lens"]], open_session(), lambda name, done: None)
    tiles = spread_tiles(ready[0].wavefront.layout, 6, np.random.default_rng(0))
    monkeypatch.setattr(tradeoff_runs, "_extent", lambda *_: (tiles, 2))
    monkeypatch.setattr(tradeoff_runs, "run", lambda *work: (run(*work)[0], 3.0, 1.5))
    found = tradeoff_runs.render_by_turns(ready, math.inf, 1, lambda words, share: None, seeds=4)
    ((cpu, wall),) = found.timings
    share = 48 * 32 / len(tiles.pixels)  # of the film, to all pixels
    assert wall == pytest.approx(np.full(4, 2 * 3.0 * share / sum(found.samples)))
    assert cpu == pytest.approx(wall / 2 / tradeoff_runs.cores() if found.by_cpu else wall)


@pytest.mark.slow
def test_curves_of_the_plot_have_colours_of_their_own(report):
    charts = [axes for axes in tradeoff_plot(report, "a scene").axes if axes.get_ylabel().startswith("error: root")]
    curves = charts[0].lines[:-1]  # but for the slope of noise
    assert len(curves) == len(report.measurements) > 7
    assert len({curve.get_color() for curve in curves}) == len(curves)


@pytest.mark.slow
def test_plot_draws_the_error_of_every_camera_and_the_shades_of_the_maps(report):
    axes = {axes.get_ylabel() or axes.get_xlabel(): axes for axes in tradeoff_plot(report, "a scene").axes}
    over_field = axes["light beside its place [pixels]"]
    drawn = [list(line.get_ydata()) for line in over_field.lines if line.get_marker() == "o"]
    assert drawn == [list(each.pixels) for each in report.cameras if each.tier != "realistic"] != []
    assert not over_field.texts
    shades = axes["root of relMSE of a tile [%]"]
    assert [label.get_text() for label in shades.get_xticklabels()] == ["0.3", "1", "3", "10", "30", "100"]
    assert shades.get_xlim() == pytest.approx((0.3, 100))
    without = tradeoff_plot(replace(report, cameras=()), "a scene").axes
    assert "The camera has\nno cheaper model." in [text.get_text() for axes in without for text in axes.texts]


@pytest.mark.slow
def test_summary_is_short_and_has_no_table(report):
    lines = summary(report)
    assert lines[:3] == recommendation(report)[:3]
    assert len(lines) < 10
    assert lines[-1].endswith("--details.")
    assert not any("days" in line or "always" in line for line in lines)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "expected"),
    [
        (0.9, "Probably better in 1 s, odds 9 to 1: rptcam render SCENE --set"),
        (0.6, "and the thin lens, odds 1 to 1.5: measure longer (--budget"),
        (None, "Perhaps better in 1 s: the thin lens; measure longer (--budget"),
    ],
)
def test_what_may_be_better_has_its_odds(report, share, expected):
    thin = report.named("thin lens")
    odds = np.full(121, share) if share is not None else np.empty(0)
    advice = replace(report.advice[0], chosen="full", perhaps="thin lens", amount=1.0)
    found = tuple(replace(each, odds=odds) if each is thin else each for each in report.measurements)
    lines = recommendation(replace(report, measurements=found, advice=(advice,)))
    assert expected in lines[3]
    assert lines[3].startswith("Too close to call in 1 s between ") == (share == 0.6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wish", "changes", "words"),
    [
        ("time", {"chosen": None, "amount": 1e-3},
         ("in 1 ms nothing does", "one sample per pixel takes at least ", "nothing")),
        ("error", {"chosen": None, "amount": 1e-5},
         ("to an error of 0.001 % nothing does", "no configuration reaches 0.001 %", "nothing")),
        ("error", {"chosen": "pinhole", "amount": 0.05, "seconds": 2.0, "full_seconds": 6.0, "samples": 7},
         ("to an error of 5 % rptcam render SCENE ", "2 s (7 samples per pixel) to 5 %, ",
          "3.0 times as fast to an error of 5 % as full accuracy (6 s)")),
        ("time", {"chosen": "pinhole", "amount": 60.0, "full_error": math.inf, "samples": 9},
         ("in 60 s rptcam render SCENE ", " after 9 samples per pixel, ", "full accuracy has no picture in 60 s")),
        ("time", {"chosen": "pinhole", "amount": 60.0, "full_error": 0.25},
         ("in 60 s rptcam", "an error of ", "in 60 s full accuracy has an error of 25 %")),
        ("time", {"chosen": "full", "amount": 60.0}, ("in 60 s ", "", "in 60 s no approximation is certainly better")),
    ],
)  # fmt: skip
def test_advice_says_what_to_set_what_it_costs_and_what_it_gains(report, wish, changes, words):
    advice = next(each for each in report.advice if each.wish == wish)
    lines = recommendation(replace(report, advice=(replace(advice, **changes),)))
    for line, head, text in zip(lines, ("Set: ", "Costs: ", "Gains: "), words, strict=False):
        assert line.startswith(head) and text in line
    if changes["chosen"] == "pinhole":
        assert " --set 'camera=" in lines[0] or " --set 'camera.kind=pinhole" in lines[0]
        assert f" --spp {changes['samples']}" in lines[0] if "samples" in changes else True
        assert lines[1].endswith(" of it for good.")


@pytest.mark.slow
def test_odds_are_those_of_the_interval(report):
    """An approximation is certainly better before its crossing's interval and certainly not after it."""
    for found in report.measurements[1:]:
        low, high = found.better_until.low, found.better_until.high
        if 1e-3 < low < high < 1e6 and not found.unbiased:
            assert found.odds_after(low / 2) > 0.6, found.name
            assert found.odds_after(2 * high) < 0.1, found.name


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--budget", "0"], "got 0; allowed a time above 0"),
        (["--time", "soon"], "got soon; allowed a time above 0"),
        (["--error", "2"], "got 2; allowed a number between 0 and 1"),
        (["--error", "200%"], "got 200%; allowed a number between 0 and 1"),
        (["--plot", "x.jpg"], "x.jpg: unknown kind of picture"),
        (["--json", "x.txt"], "x.txt: unknown kind of file"),
        (["--markdown", "no/x.md"], "there is no folder"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(words, problem, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text("camera: 1\n")
    assert main(["tradeoff", "scene.yaml", *words]) in (2, 4)
    said = capsys.readouterr().err
    assert problem in said
    assert said.count("\n") == 1


def test_times_and_shares_are_read_with_their_units():
    times = [values.duration(text) for text in ("90", "90s", "1.5m", "1.5 min", "0.025h")]
    assert times == [90.0] * 5
    assert [values.share(text) for text in ("0.02", "2%", "2 %", "2e-2")] == [0.02] * 4


@pytest.mark.parametrize("wish", [{"budget": math.nan}, {"budget": "5s"}, {"seconds": 0}, {"error": 2}])
def test_wish_that_cannot_be_is_refused(wish):
    with pytest.raises(InputError, match=rf"^{next(iter(wish))}: is out of range \(got "):
        measure_tradeoff(SCENE, **wish)


def test_picture_without_light_is_refused(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps(SCENE | {"camera": PINHOLE, "render": {"max_depth": 1}, "film": TINY}))
    assert main(["tradeoff", str(scene), "--budget", "0.1s"]) == 2
    assert "the picture is black, so that there is nothing to compare" in capsys.readouterr().err


@pytest.mark.slow
def test_even_picture_has_no_noise_and_takes_a_sample(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    even = {"camera": PINHOLE, "film": TINY, "environment": {"kind": "constant", "radiance": 0.5}}
    scene.write_text(json.dumps(even))
    plot = tmp_path / "plot.svg"
    assert main(["tradeoff", str(scene), "--budget", "0.1s", "--json", "--plot", str(plot), "--quiet"]) == 0
    full = json.loads(capsys.readouterr().out)["measurements"][0]
    assert full["noise"][0]["value"] == full["rate"]["high"] == 0
    assert full["seconds_to"]["0.01"] == full["sample_s"]
    assert "nan" not in plot.read_text()
    assert "below the chart: all" in plot.read_text()


@pytest.mark.slow
def test_files_are_written_though_nobody_reads_the_text(tmp_path, monkeypatch):
    scene, written = tmp_path / "scene.yaml", tmp_path / "out.md"
    scene.write_text(
        json.dumps({"camera": PINHOLE, "film": TINY, "environment": {"kind": "constant", "radiance": 0.5}})
    )

    def ended(*_, **__):
        raise BrokenPipeError(32, "Broken pipe", "standard output")

    monkeypatch.setattr("rptcam_cl.cli.camera._print_tradeoff", ended)
    monkeypatch.setattr("rptcam_cl.cli._abandon", lambda stream: None)
    assert main(["tradeoff", str(scene), "--budget", "0.1s", "--markdown", str(written), "--quiet"]) == 0
    assert "full accuracy" in written.read_text()


def test_command_writes_what_it_is_asked_for(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    camera = {"kind": "thin_lens", "fov_degrees": 10, "aperture_radius_m": 0.05, "focus_distance_m": 5}
    scene.write_text(json.dumps(SCENE | {"camera": camera | {"eye": [0, 0, 0], "target": [0, 0, -1]}}))
    files = [str(tmp_path / f"out.{suffix}") for suffix in ("json", "md", "svg")]
    options = ["--json", files[0], "--markdown", files[1], "--plot", files[2], "--budget", "0.5s", "--quiet"]
    assert main(["tradeoff", str(scene), *options]) == 0
    told = json.loads((tmp_path / "out.json").read_text())
    assert next(found["name"] for found in told["measurements"]) == "full"
    assert told["cameras"] == []
    assert "pinhole" in [found["name"] for found in told["measurements"]]
    assert "depth 2" in (tmp_path / "out.md").read_text()
    assert (tmp_path / "out.svg").read_text().startswith("<svg")
    assert f"Set: in 60 s rptcam render {scene} " in capsys.readouterr().out
