"""What the documents promise: links that lead somewhere, contents that are complete; blocks are tested beside it."""

import re
import subprocess
from functools import cache
from pathlib import Path

from tests.support.pages import all_blocks

LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)")


def test_make_targets_of_the_pages_exist(checkout: Path) -> None:
    named = [(block.page, re.findall(r"^make (\w+)", block.text, re.MULTILINE)) for block in all_blocks("sh")]
    assert [(page, targets) for page, targets in named if targets] == [
        ("README.md", ["demo"]),
        ("docs/blender.md", ["blender"]),
        ("docs/install.md", ["demo", "test", "docs"]),
    ]
    subprocess.run(
        ["make", "--dry-run", "blender", "demo", "test", "docs"], cwd=checkout, check=True, capture_output=True
    )


def links(document: Path) -> list[tuple[Path, str]]:
    """Return the files of the checkout that a document leads to, each with the heading it names, or nothing."""
    found = LINK.findall(document.read_text("utf-8"))
    return [
        (document.parent.joinpath(file).resolve() if file else document, at) for file, at in found if ":" not in file
    ]


@cache
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


def test_contents_of_the_documentation_list_every_page_once(checkout: Path, tracked: list[str]) -> None:
    index = checkout / "docs" / "index.md"
    listed = [target for target, _ in links(index) if target.parent == index.parent]
    assert len(listed) == len(set(listed))
    assert {checkout / name for name in tracked if re.fullmatch(r"docs/[^/]+\.md", name)} == {index, *listed}


def test_every_page_begins_with_the_question_of_its_reader(checkout: Path) -> None:
    pages = {path.name: path.read_text("utf-8") for path in (checkout / "docs").glob("*.md")}
    del pages["gallery.md"]  # says whose figures it shows
    first = {name: re.split(r"\n\n|\n```", text.partition("\n")[2].strip())[0] for name, text in pages.items()}
    assert [name for name, paragraph in first.items() if "?" not in paragraph] == []


def test_contents_of_the_scene_reference_list_every_heading(checkout: Path) -> None:
    reference = checkout / "docs" / "scene.md"
    contents = reference.read_text("utf-8").partition("\n## ")[0]
    assert {at for file, at in LINK.findall(contents) if not file} == anchors(reference) - {"the-scene-file"}


def test_every_example_is_a_valid_scene_or_dataset(checkout: Path) -> None:
    from rptcam_cl.batch.dataset import read_specification
    from rptcam_cl.scene.load import load_scene

    examples = sorted((checkout / "examples").rglob("*.yaml"))
    assert examples
    for example in examples:
        (read_specification if "\nvary:" in example.read_text("utf-8") else load_scene)(example)
