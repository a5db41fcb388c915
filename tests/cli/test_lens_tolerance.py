"""``rptcam lens tolerance``: its tables, JSON, plot and errors."""

import json
from pathlib import Path

import pytest

from rptcam_cl.cli import main

SPEC = """\
name: shop
copies: 20
merit: {fields_degrees: [0, 14], wavelengths_nm: [587.56]}
tolerances:
  - {radius_percent: 0.2}
  - {decentre_mm: 0.05}
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    file = tmp_path / "tolerances.yaml"
    file.write_text(SPEC)
    return file


def test_tables_have_percentiles_yield_and_offenders(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lens", "tolerance", "cooke-triplet-50mm", str(spec), "--limit", "30"]) == 0
    printed = capsys.readouterr().out
    assert "20 copies" in printed
    assert "95 % interval" in printed
    assert "of the copies have a spot of 30 µm or less (95 %:" in printed
    assert "worst offenders" in printed
    assert "decentre 0.05 mm of element 1" in printed


def test_json_and_plot(spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plot = tmp_path / "yield.svg"
    command = ["lens", "tolerance", "cooke-triplet-50mm", str(spec), "--json", "--copies", "10", "--seed", "7"]
    assert main([*command, "--limit", "30", "-o", str(plot)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["copies"] == 10
    assert found["tolerances"] == "shop"
    assert found["yield_at"]["limit"] == 30
    assert 0 <= found["yield_at"]["low"] <= found["yield_at"]["value"] <= found["yield_at"]["high"] <= 1
    assert "copies within shop tolerances" in plot.read_text()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--copies", "3"], "allowed 10 to 100000"),
        (["--seed", "-1"], "whole numbers from 0"),
        (["-o", "plot.bmp"], "unknown kind of picture"),
    ],
)
def test_wrong_options_are_refused(
    spec: Path, more: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["lens", "tolerance", "cooke-triplet-50mm", str(spec), *more])
    except SystemExit as leaving:
        code = int(str(leaving.code))
    assert code == 2
    assert message in capsys.readouterr().err


def test_wrong_specification_is_one_line_with_its_place(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec.write_text(SPEC.replace("decentre_mm", "decenter_mm"))
    assert main(["lens", "tolerance", "cooke-triplet-50mm", str(spec)]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1
    assert f"{spec}:6:6: tolerances[1].decenter_mm: unknown key; did you mean decentre_mm?" in error[0]


@pytest.mark.slow
def test_lens_is_measured_at_a_temperature(capsys: pytest.CaptureFixture[str]) -> None:
    lengths = []
    for celsius in ("20", "80"):
        assert main(["lens", "info", "cooke-triplet-50mm", "--json", "--temperature-c", celsius]) == 0
        lengths.append(json.loads(capsys.readouterr().out)["focal_length_mm"])
    assert 1e-5 < lengths[1] / lengths[0] - 1 < 1e-3
    assert main(["lens", "info", "dgauss-50mm", "--temperature-c", "60"]) == 2
    assert "nothing says how glass n = 1.67 takes heat" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (["--temperature-c", "300"], "allowed -100 to 140 degrees Celsius"),
        (["--pressure-hpa", "-5"], "allowed 0 to 2000 hPa"),
        (["--barrel", "wood"], "allowed aluminium, brass"),
    ],
)
def test_impossible_heat_is_refused(option: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lens", "info", "cooke-triplet-50mm", *option]) == 2
    assert message in capsys.readouterr().err
