"""Render the figures of the four documents that this renderer answers to, and write the page that shows them.

Run in the folder above examples:
python -m examples.figures.render [--quality draft|page|full] [--only PART …] [--output FOLDER]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import rptcam_cl
from examples.figures.assignments import ASSIGNMENT_2003, ASSIGNMENT_2015
from examples.figures.figure import ROOT, Figure, Group, Section
from examples.figures.paper import PAPER
from examples.figures.report import REPORT

SECTIONS = (PAPER, REPORT, ASSIGNMENT_2015, ASSIGNMENT_2003)
QUALITIES = {"draft": (0.5, 1 / 16), "page": (1.0, 1.0), "full": (2.5, 4.0)}  # factors on the size and on the samples
COLUMNS = 4
HEAD = """\
# Figures of the four documents

This renderer grew out of four documents on cameras. Here are their figures, made anew with its own lenses, scenes
and light, and the numbers that they allow to check beside ours, computed when this page was written. `python -m
examples.figures.render` makes it all, pictures, numbers and page; `--quality full` larger and with less noise,
`--only PART` some of the pictures. More pictures of other scenes are in the [gallery](../examples/README.md).
"""


def figures() -> list[Figure]:
    """Return every picture of the page once."""
    return list({figure.picture: figure for section in SECTIONS for figure in section.figures}.values())


def render_figure(figure: Figure, quality: str, folder: Path) -> None:
    """Render a picture into the folder of the page."""
    scale, factor = QUALITIES[quality]
    width, height = (round(pixels * scale) for pixels in figure.size)
    image = rptcam_cl.render(figure.load(), size=(width, height), spp=max(1, round(figure.spp * factor)))
    path = folder / figure.picture
    path.parent.mkdir(parents=True, exist_ok=True)
    image.save(path)


def page() -> str:
    """Return the page, with the numbers as they are computed now."""
    return "\n".join([HEAD, *(line for section in SECTIONS for line in section_lines(section))])


def section_lines(section: Section) -> Iterator[str]:
    """Yield the text of a document's figures."""
    yield f"## {section.title}\n{section.text}\n"
    for group in section.groups:
        yield from group_lines(group)


def group_lines(group: Group) -> Iterator[str]:
    """Yield the text of pictures that stand side by side: pictures, numbers and commands."""
    yield f"### {group.title}\n{group.text}\n"
    for start in range(0, len(group.figures), COLUMNS):
        row = group.figures[start : start + COLUMNS]
        yield "| " + " | ".join(figure.title for figure in row) + " |"
        yield "| " + " | ".join("---" for _ in row) + " |"
        yield "| " + " | ".join(f"![{group.title}: {figure.title}]({figure.picture})" for figure in row) + " |\n"
    for number in group.numbers:
        yield number() + "\n"
    if group.figures:
        yield "\n".join(["```sh", *(figure.command() for figure in group.figures), "```\n"])


def main(arguments: Sequence[str]) -> int:
    """Render the wanted pictures, write the page, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quality", choices=QUALITIES, default="page")
    parser.add_argument(
        "--only", nargs="*", metavar="PART", help="pictures whose name holds one of these; none: the page alone"
    )
    parser.add_argument("--output", type=Path, help="folder of the page; docs for --quality page, else out/figures")
    given = parser.parse_args(arguments)
    folder = given.output or ROOT / ("docs" if given.quality == "page" else "out/figures")
    for figure in figures():
        if given.only is None or any(part in figure.name for part in given.only):
            print(figure.name, flush=True)
            render_figure(figure, given.quality, folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "gallery.md").write_text(page(), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
