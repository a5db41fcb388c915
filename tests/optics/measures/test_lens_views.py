"""The measurements of a lens as methods: the numbers of the commands, and results that draw themselves."""

import importlib.util
import inspect
import json

import numpy as np
import pytest

from rptcam_cl.cli import main
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.measures import MEASUREMENTS
from rptcam_cl.rendering.traceable_lens import traceable


@pytest.fixture(scope="module")
def lens():
    return traceable(load_lens("cooke-triplet-50mm"))


def printed(capsys, *words):
    assert main(["lens", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


FIELDS = [0.0, 10.0]


TAKE_LONG = ("dof", "zernike", "vignette", "glare")


@pytest.mark.parametrize(
    "measurement",
    [
        pytest.param(each, id=each.command, marks=[pytest.mark.slow] * (each.command in TAKE_LONG))
        for each in MEASUREMENTS
    ],
)
def test_every_measurement_is_a_command_and_a_method_with_the_same_numbers(lens, capsys, measurement):
    words, given = [], {}
    for option in measurement.options:
        value = {"fields": [0.0, 10.0], "wavelengths_nm": [550.0], "steps": 3, "f_numbers": [8.0]}.get(option.keyword)
        value = 24 if option.keyword == "rays" else value
        if value is not None:
            words += [option.flag, ",".join(map(str, value)) if isinstance(value, list) else str(value)]
            given[option.keyword] = value
        elif option.printed is not None:
            given[option.keyword] = option.printed
    answer = printed(capsys, measurement.command, "cooke-triplet-50mm", *words)
    result = getattr(lens, measurement.method)(**given)
    rows = [answer[measurement.key]] if measurement.is_single else answer[measurement.key]
    assert list(result) == list(rows[0])
    for name in result:
        expected = [np.nan if row[name] is None else row[name] for row in rows]
        found = np.where(np.isinf(result[name]), np.nan, result[name])  # JSON has no infinity
        assert found.tolist() == pytest.approx(expected, nan_ok=True, rel=1e-12)
    assert measurement.is_single or set(measurement.columns) >= set(result)
    assert main(["lens", measurement.command, "cooke-triplet-50mm", *words]) == 0
    lines = capsys.readouterr().out.splitlines()
    heads = ["fact"] if measurement.is_single else [measurement.columns[name] for name in result]
    assert all(head in lines[1] for head in heads)
    assert len(lines) == 2 + (len(result.columns) if measurement.is_single else len(rows))


def test_a_method_says_its_options_and_refuses_others(lens):
    shown = str(inspect.signature(lens.through_focus))
    assert shown.startswith("(range_mm: 'float | None' = None, fields: 'Sequence[float] | None' = None, wavelengths_nm")
    with pytest.raises(TypeError, match="unexpected keyword argument 'ray'"):
        lens.spot(ray=3)
    with pytest.raises(InputError, match=r"^field_degrees: got 140; allowed from -130 to 130 degrees"):
        lens.psf(140.0)
    with pytest.raises(InputError, match="veiling glare: has no chart to save"):
        lens.glare().save("glare.svg")


def test_thin_pencils_are_sharp_where_narrow_spots_are_least(lens):
    curvature = lens.field_curvature(FIELDS)
    assert curvature["tangential_mm"][0] == pytest.approx(0.0, abs=1e-3)
    assert curvature["sagittal_mm"][0] == pytest.approx(curvature["tangential_mm"][0], abs=1e-6)
    focus = lens.through_focus(0.6, [10.0], [587.5618], f_number=40, steps=121)
    for column, expected in (("rms_y_um", "tangential_mm"), ("rms_x_um", "sagittal_mm")):
        assert focus["shift_mm"][np.argmin(focus[column])] == pytest.approx(curvature[expected][1], abs=0.02)


def test_thin_pencils_are_thin_enough_for_aspheres_with_odd_powers():
    curvature = traceable(load_lens("phone-5.6mm")).field_curvature([0.0])
    assert curvature["tangential_mm"][0] == pytest.approx(0.0, abs=1e-5)  # the film stands at the first-order focus


def test_fields_whose_chief_ray_is_cut_off_have_fans_and_no_thin_pencils():
    lens = traceable(load_lens("telephoto-400mm"))
    curvature = lens.field_curvature([3.0, 3.4])
    assert np.isfinite(curvature.rows[0]["tangential_mm"])
    assert np.isnan(curvature.rows[1]["tangential_mm"])
    assert np.isnan(curvature.rows[1]["astigmatism_mm"])
    fan = lens.ray_fan([3.4], [587.5618], rays=21)
    assert fan["off_um"][fan["pupil"] == 0.0] == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(InputError, match=r"no ray at 3\.4 degrees reaches the centre of the stop"):
        lens.field_curvature([3.4])


def test_ray_fans_pass_through_the_chief_ray_and_span_the_spot(lens):
    fan = lens.ray_fan([10.0], [587.5618], rays=21)
    middle = fan["off_um"][fan["pupil"] == 0.0]
    assert middle.tolist() == pytest.approx([0.0, 0.0], abs=1e-6)
    points = lens.spot([10.0], [587.5618]).about["points"][10.0, 587.5618]
    up = fan["off_um"][fan["tangential"] == 1]
    assert np.ptp(up) <= 1.05 * np.ptp(points[:, 1]) * 1e3
    assert np.ptp(up) >= 0.5 * np.ptp(points[:, 1]) * 1e3
    across = fan["off_um"][fan["tangential"] == 0]
    assert across.tolist() == pytest.approx((-across[::-1]).tolist(), abs=1e-6)  # a round lens


def test_results_draw_themselves(lens, tmp_path):
    fan = lens.ray_fan([0.0, 10.0], [587.5618], rays=9)
    assert fan._repr_svg_().startswith("<svg")
    assert "<table>" in fan._repr_html_()
    assert "rows of field_degrees" in repr(fan)
    assert fan.rows[0]["field_degrees"] == 0.0
    fan.save(tmp_path / "fan.svg")
    assert (tmp_path / "fan.svg").read_bytes().startswith(b"<svg")
    assert lens.draw(rays=3)._repr_svg_().startswith("<svg")


def test_without_matplotlib_a_table_is_shown_and_charts_say_what_they_need(lens, monkeypatch, tmp_path):
    result = lens.field_curvature([0.0])
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "matplotlib" else find(name))
    assert result._repr_svg_() is None
    assert "astigmatism_mm" in result._repr_html_()
    with pytest.raises(InputError, match=r"pip install"):
        result.chart()
    with pytest.raises(InputError, match=r"pip install"):
        result.save(tmp_path / "a.svg")
    assert list(tmp_path.iterdir()) == []


def test_wrong_requests_are_refused(lens):
    with pytest.raises(InputError, match="must not be negative"):
        lens.mtf([-1.0])
    with pytest.raises(InputError, match="above 0 mm"):
        lens.through_focus(-1.0)
    with pytest.raises(InputError, match="no real image"):
        traceable(load_lens("biconcave")).spot()


@pytest.mark.parametrize(
    ("method", "given"),
    [
        (method, name)
        for method, names in {
            "mtf": ["frequencies_per_mm", "fields", "wavelengths_nm"],
            "spot": ["fields", "wavelengths_nm"],
            "psf": ["wavelengths_nm"],
            "distortion": ["fields", "wavelengths_nm"],
            "ray_fan": ["fields", "wavelengths_nm"],
            "field_curvature": ["fields", "wavelengths_nm"],
            "through_focus": ["fields", "wavelengths_nm"],
        }.items()
        for name in names
    ],
)
def test_empty_lists_are_refused_by_name(lens, method, given):
    with pytest.raises(InputError, match=f"^{given}: is empty"):
        getattr(lens, method)(**{given: []})
    with pytest.raises(InputError, match=f"^{given}: is empty"):
        getattr(lens, method)(**{given: np.array([])})
