"""``rptcam lens breathing``: a table, CSV, JSON and a plot of the same numbers."""

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

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
