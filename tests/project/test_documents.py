"""What the documents promise: commands that parse, programs that run, links that lead somewhere."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml

from rptcam_cl.cli import build_parser

LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)")


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


def links(document: Path) -> list[tuple[Path, str]]:
    """Return the files of the checkout that a document leads to, each with the heading it names, or nothing."""
    found = LINK.findall(document.read_text("utf-8"))
    return [
        (document.parent.joinpath(file).resolve() if file else document, at) for file, at in found if ":" not in file
    ]


def anchors(document: Path) -> set[str]:
    """Return the names that headings have as targets of links: those that stand twice are numbered."""
    text = re.sub(r"^```.*?^```", "", document.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    names: list[str] = []
    for heading in re.findall(r"^#+ (.+)", text, re.MULTILINE):
        plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading)
        names.append(re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-"))
    return {name if (n := names[:i].count(name)) == 0 else f"{name}-{n}" for i, name in enumerate(names)}


def test_links_lead_to_files_and_headings(checkout: Path, tracked: list[str]) -> None:
    lost = [
        (name, str(target), at)
        for name in tracked
        if name.endswith(".md")
        for target, at in links(checkout / name)
        if not target.exists() or (at and at not in anchors(target))
    ]
    assert lost == []


def test_every_page_is_reached_from_the_readme(checkout: Path, tracked: list[str]) -> None:
    reached, ahead = set(), [checkout / "README.md"]
    while ahead:
        page = ahead.pop()
        if page.suffix == ".md" and page not in reached:
            reached.add(page)
            ahead += [target for target, _ in links(page)]
    assert {checkout / name for name in tracked if name.endswith(".md")} == reached


def test_readme_lists_every_page_of_the_documentation(checkout: Path, tracked: list[str]) -> None:
    listed = {target for target, _ in links(checkout / "README.md")}
    assert [name for name in tracked if re.fullmatch(r"docs/[^/]+\.md", name) and checkout / name not in listed] == []


def test_contents_of_the_scene_reference_list_every_heading(checkout: Path) -> None:
    reference = checkout / "docs" / "scene.md"
    contents = reference.read_text("utf-8").partition("\n## ")[0]
    assert {at for file, at in LINK.findall(contents) if not file} == anchors(reference) - {"the-scene-file"}


def test_every_example_is_a_valid_scene(checkout: Path) -> None:
    from rptcam_cl.scene import load_scene

    examples = sorted((checkout / "examples").rglob("*.yaml"))
    assert examples
    for example in examples:
        load_scene(example)
