"""``rptcam lens breathing`` and ``focus-scale``: a table, CSV, JSON and a plot of the same numbers."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl.optics.library import load_lens

ROOT = Path(__file__).resolve().parents[2]
Command = Callable[..., Any]
WORDS = ("lens", "breathing", "dgauss-50mm", "--f-number", "8", "--distances-m", "inf,2")


def test_csv_and_json_say_the_same_and_the_plot_is_written(rptcam: Command, tmp_path: Path) -> None:
    table, lines = rptcam(*WORDS, "-o", str(tmp_path / "a.svg")), rptcam(*WORDS, "--csv")
    found = json.loads(rptcam(*WORDS, "--json").out)
    assert table.code == lines.code == 0
    assert (tmp_path / "a.svg").read_text("utf-8").count("<svg") == 1
    rows = list(csv.DictReader(io.StringIO(lines.out)))
    assert len(rows) == len(found["breathing"]) == 2
    assert [float(row["t_number"]) for row in rows] == [row["t_number"] for row in found["breathing"]]
    assert rows[0]["focus_distance_m"] == "" and found["breathing"][0]["focus_distance_m"] is None
    assert float(rows[0]["working_f_number"]) == pytest.approx(8, rel=0.01)
    assert table.out.splitlines()[0].startswith("Double Gauss 50 mm")


def test_a_scale_turns_with_what_moves_and_its_distances_follow_newtons_equation(
    rptcam: Command, tmp_path: Path
) -> None:
    words = ("lens", "focus-scale", "dgauss-50mm", "--throw-degrees", "90", "--nearest-m", "0.45")
    found = json.loads(rptcam(*words, "--json", "-o", str(tmp_path / "a.svg")).out)["scale"]
    assert (tmp_path / "a.svg").read_text("utf-8").count("<svg") == 1
    lens = load_lens("dgauss-50mm")
    first = lens.first_order()
    assert found[0]["focus_distance_m"] is None and found[-1]["focus_distance_m"] == 0.45
    for row in found[1:]:
        ahead = 1000 * row["focus_distance_m"] - lens.length - row["film_distance_mm"]
        to_focus = ahead + first.front_focal_distance_mm
        assert row["travel_mm"] * to_focus == pytest.approx(first.focal_length_mm**2, rel=1e-9)
        assert row["turn_degrees"] == pytest.approx(90 * row["travel_mm"] / found[-1]["travel_mm"])
        assert row["magnification"] == pytest.approx(row["travel_mm"] / first.focal_length_mm, rel=1e-9)


@pytest.mark.slow
def test_a_scale_ends_where_the_file_does_and_the_film_stays(rptcam: Command, tmp_path: Path) -> None:
    written = yaml.safe_load((ROOT / "lenses/dgauss-50mm.yaml").read_text("utf-8"))
    written |= {"focusing": {"surfaces": [0, 4], "travel": [-3.0, 0.0]}}
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(written), "utf-8")
    rows = json.loads(rptcam("lens", "focus-scale", str(tmp_path / "a.yaml"), "--json").out)["scale"]
    assert rows[-1]["travel_mm"] == pytest.approx(-3.0)
    assert rows[-1]["turn_degrees"] == pytest.approx(120.0)
    said = rptcam("lens", "focus-scale", str(tmp_path / "a.yaml"), "--distances-m", "inf,0.5")
    assert (said.code, said.err.count("\n")) == (2, 1)
    assert "focuses from" in said.err
