"""What a release says of itself is the same everywhere, and its workflows name files and commands that exist."""

import re
from pathlib import Path

import pytest
import yaml

from rptcam_cl.cli import build_parser
from rptcam_cl.core.constants import __version__


def workflows(checkout: Path) -> list[Path]:
    return sorted((checkout / ".github/workflows").glob("*.yml"))


def test_changelog_and_citation_are_of_this_version(checkout: Path) -> None:
    newest = re.search(
        r"^## (\S+) \((\d{4}-\d\d-\d\d)\)$", (checkout / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE
    )
    citation = yaml.safe_load((checkout / "CITATION.cff").read_text("utf-8"))
    assert newest is not None
    assert (newest[1], newest[2]) == (__version__, str(citation["date-released"]))
    assert str(citation["version"]) == __version__
    assert citation["cff-version"] == "1.2.0"


def steps(path: Path) -> list[str]:
    jobs = yaml.safe_load(path.read_text("utf-8"))["jobs"].values()
    return [line for job in jobs for step in job["steps"] for line in str(step.get("run", "")).splitlines()]


def test_workflows_cover_three_systems_the_wheel_and_the_pages(checkout: Path) -> None:
    assert [path.stem for path in workflows(checkout)] == ["docs", "tests", "wheel"]
    for name in ("tests", "wheel"):
        text = (checkout / f".github/workflows/{name}.yml").read_text("utf-8")
        assert all(f"{system}-latest" in text for system in ("ubuntu", "windows", "macos"))


def test_commands_of_the_workflows_parse_and_their_files_exist(checkout: Path) -> None:
    lines = [line for path in workflows(checkout) for line in steps(path)]
    commands = [line.split()[1:] for line in lines if line.startswith("rptcam ")]
    assert len(commands) > 2
    for words in commands:
        assert build_parser().parse_known_args(words)[1] == [], words
    files = [word for line in lines for word in line.split() if word.startswith("tests/")]
    assert files
    assert all((checkout / file).is_file() for file in files)


@pytest.mark.parametrize("name", ["bug", "lens", "idea"])
def test_issue_forms_have_what_a_form_needs(checkout: Path, name: str) -> None:
    form = yaml.safe_load((checkout / f".github/ISSUE_TEMPLATE/{name}.yml").read_text("utf-8"))
    assert {"name", "description", "body"} <= form.keys()
    assert len({field["id"] for field in form["body"]}) == len(form["body"])
    assert all(field["attributes"]["label"] for field in form["body"])
