"""What the documents promise: commands that parse, programs that run, links that lead somewhere."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml

from rptcam_cl.cli import build_parser

DOCUMENTS = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


@pytest.fixture
def readme(checkout: Path) -> str:
    return (checkout / "README.md").read_text("utf-8")


def test_every_command_of_the_readme_parses(readme: str) -> None:
    lines = [line for block in blocks(readme, "sh") for line in block.splitlines() if line.startswith("rptcam ")]
    assert len(lines) > 5
    for line in lines:
        _, unknown = build_parser().parse_known_args(shlex.split(line)[1:])
        assert unknown == [], line


def test_make_targets_of_the_readme_exist(checkout: Path, readme: str) -> None:
    targets = re.findall(r"^    make (\w+)$", readme, re.MULTILINE)
    assert targets == ["demo", "test"]
    subprocess.run(["make", "--dry-run", *targets], cwd=checkout, check=True, capture_output=True)


def test_programs_of_the_readme_run(
    checkout: Path, readme: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "examples").symlink_to(checkout / "examples")
    monkeypatch.chdir(tmp_path)
    programs = blocks(readme, "python")
    assert len(programs) == 2
    for program in programs:
        exec(compile(program, "README.md", "exec"), {})
    assert (tmp_path / "picture.png").stat().st_size > 0


def test_lens_of_the_readme_loads(readme: str) -> None:
    from rptcam_cl.optics import load_lens

    (text,) = blocks(readme, "yaml")
    lens = load_lens(yaml.safe_load(text))
    # thick-lens formula: 1/f = (n - 1) (1/R1 - 1/R2 + (n - 1) d / (n R1 R2))
    power = 0.5 * (1 / 50 + 1 / 50 - 0.5 * 5 / (1.5 * 50 * 50))
    assert lens.first_order().focal_length_mm == pytest.approx(1 / power)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_to_files(checkout: Path, document: str) -> None:
    links = re.findall(r"\]\(([^)#]+)\)", (checkout / document).read_text("utf-8"))
    missing = [link for link in links if "://" not in link and not (checkout / link).exists()]
    assert missing == []


def test_every_example_is_a_valid_scene(checkout: Path) -> None:
    from rptcam_cl.scene import load_scene

    examples = sorted((checkout / "examples").rglob("*.yaml"))
    assert examples
    for example in examples:
        load_scene(example)
