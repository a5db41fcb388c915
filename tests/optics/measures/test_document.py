"""docs/lenses.md: what it shows works, and its tables are complete and current."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from rptcam_cl.cli import build_parser, main
from rptcam_cl.core.strict_yaml import Key
from rptcam_cl.optics.files.keys import CLEAR, CONFIGURATION, GLASS, LENS, SHAPE, SURFACE
from rptcam_cl.optics.library import load_lens


@pytest.fixture(scope="module")
def text(checkout: Path) -> str:
    return (checkout / "docs" / "lenses.md").read_text("utf-8")


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def test_library_is_current(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lens", "list", "--markdown"]) == 0
    table = capsys.readouterr().out
    assert text.endswith("\n\n" + table), "put the output of `rptcam lens list --markdown` at the end of docs/lenses.md"


def test_every_command_parses(text: str) -> None:
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    assert len(lines) > 8
    for line in lines:
        _, unknown = build_parser().parse_known_args(shlex.split(line)[1:])
        assert unknown == [], line


def test_lens_loads_and_program_runs(text: str) -> None:
    lens, spectrograph, mirrors = (load_lens(yaml.safe_load(block)) for block in blocks(text, "yaml"))
    assert lens.first_order() == load_lens("dgauss-50mm").first_order()
    assert spectrograph.first_order().focal_length_mm == pytest.approx(50)
    assert mirrors.first_order().focal_length_mm == pytest.approx(800, abs=1e-9)
    assert mirrors.first_order().back_focal_distance_mm == pytest.approx(240, abs=1e-9)
    assert not mirrors.warnings
    (program,) = blocks(text, "python")
    names: dict[str, Any] = {}
    exec(compile(program, "lenses.md", "exec"), names)
    assert names["text"].startswith("<svg")


def test_pictures_are_there(text: str, checkout: Path) -> None:
    links = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text)
    assert len(links) > 5
    for link in links:
        assert (checkout / "docs" / link).is_file(), link


@pytest.mark.parametrize("keys", [LENS, SURFACE, GLASS, SHAPE, CLEAR, CONFIGURATION])
def test_every_key_is_documented(text: str, keys: dict[str, Key]) -> None:
    missing = [key for key in keys if not re.search(rf"`{key}`|[{{`, ]{key}:", text)]
    assert missing == []


def test_list_says_the_same_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    import json

    assert main(["lens", "list", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert rows["dgauss-50mm"]["focal_length_mm"] == pytest.approx(50.358, abs=1e-3)
    assert all(row["source"] for row in rows.values())
