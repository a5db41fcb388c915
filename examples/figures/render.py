"""Render the figures of the rptcam paper, the camera report and the CS348b assignments, and write their page.

Run in the folder above examples:
python -m examples.figures.render [--quality draft|page|full] [--only PART …] [--resume] [--output FOLDER]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from PIL import Image

import rptcam_cl
from examples.figures.assignments import ASSIGNMENT_2003, ASSIGNMENT_2015
from examples.figures.figure import ROOT, Drawing, Figure, Group, Section
from examples.figures.paper import PAPER
from examples.figures.report import REPORT
from rptcam_cl.cli import main as rptcam
from rptcam_cl.core.errors import InputError, RptcamError
from rptcam_cl.core.files import replacing
from rptcam_cl.imaging.image import SETTINGS
from rptcam_cl.optics.charts import encode
from rptcam_cl.scene.changes import change_scene

SECTIONS = (PAPER, REPORT, ASSIGNMENT_2015, ASSIGNMENT_2003)
# Factors on the size and on the samples, and whether the noise that is left may be removed.
QUALITIES = {"draft": (1 / 6, 1 / 2, False), "page": (1.0, 1.0, True), "full": (2.0, 4.0, True)}
COLUMNS = 4
INTERRUPTED = 130  # exit code, as shells count
HEAD = """\
# The rptcam paper, a pbrt camera report and two CS348b assignments, figure by figure

This renderer grew out of four documents on cameras: *rptcam* (Kumar, Kumar, Meng, Yu, 2024), a report on the cameras of
*Physically Based Rendering*, chapter 6 (Khatri), and the realistic camera assignments of Stanford's CS348b of 2015 and
2003. Here are their figures, made anew with its own lenses, scenes and light, and the numbers that they allow to check
beside ours, computed when this page was written. More pictures of other scenes are in the
[gallery](../examples/README.md); the interactive demo is the [viewfinder](viewfinder.md), any of these scenes under the
dials of a camera.

JPEG files are denoised (`--denoise`, the extra `denoise`): the noise that their samples leave is removed. PNG files
show it. The numbers come from films as the samples have them.

`python -m examples.figures.render` makes it all, pictures, numbers and page, in some minutes; `--quality full` larger
and with less noise, `--only PART` some of the pictures, `--resume` those that an interrupted run left to do.

A number of a document is met when ours lies within half a unit of its last digit, and within its error where it is
an estimate. Below each table stands the verdict, with the reason of what differs by more; tests hold every table to it.
"""


def figures() -> list[Figure]:
    """Return every picture of the page once."""
    return list({figure.picture: figure for section in SECTIONS for figure in section.figures}.values())


def drawings() -> list[Drawing]:
    """Return every drawing of the page."""
    return [drawing for section in SECTIONS for group in section.groups for drawing in group.drawings]


def draw(drawing: Drawing, folder: Path) -> None:
    """Make a drawing in the folder of the page, by the very command that the page prints if it has one."""
    path = folder / drawing.picture
    path.parent.mkdir(parents=True, exist_ok=True)
    if drawing.chart is None:
        rptcam([*drawing.words, "-o", str(path)])
    else:
        path.write_bytes(encode(drawing.chart(), path))


def render_figure(figure: Figure, quality: str, folder: Path, resume: bool = False) -> bool:
    """Render a picture into the folder of the page, unless it is there already and that is enough.

    A picture is written at once when it is finished; one that is interrupted leaves what was there.
    """
    scale, factor, clean = QUALITIES[quality]
    denoise = clean and figure.denoise
    width, height = (round(pixels * scale) for pixels in figure.size)
    spp = max(1, round(figure.spp * factor))
    path = folder / figure.picture
    scene = change_scene(figure.load(), film={"resolution": (width, height)})
    if resume and is_finished(path, scene, spp, denoise):
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    rptcam_cl.render(scene, spp=spp, denoise=denoise).save(path)
    return True


def is_finished(path: Path, scene: rptcam_cl.Scene, spp: int, denoise: bool) -> bool:
    """Return whether a file holds the picture of a scene; of a camera that focuses by itself nobody can tell."""
    if not path.is_file():
        return False
    with Image.open(path) as picture:
        kept = json.loads(picture.info.get("comment", "{}"))
    shown = scene.picture.model_dump(mode="json", exclude_unset=True)
    stated = [kept.get("scene_hash"), kept.get("spp"), kept.get(SETTINGS), "denoised" in kept]
    return stated == [scene.content_hash(), spp, shown or None, denoise]


def wanted(parts: Sequence[str] | None) -> list[Figure]:
    """Return the pictures whose name holds one of some parts, or all.

    Raises
    ------
    InputError
        When a part is in no name.
    """
    if parts is None:
        return figures()
    for part in parts:
        if not any(part in figure.name for figure in figures()):
            names = ", ".join(figure.name for figure in figures())
            raise InputError(f"--only: no picture has a name with {part!r} in it; there are {names}")
    return [figure for figure in figures() if any(part in figure.name for part in parts)]


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
    theirs = f"*In the document*: {group.theirs}\n\n" if group.theirs else ""
    yield f"### {group.title}\n{theirs}{group.text}\n"
    yield from side_by_side(group.title, group.figures, COLUMNS)
    yield from side_by_side(group.title, group.drawings, COLUMNS // 2)
    for compare in group.numbers:
        yield compare().markdown() + "\n"
    made = [*group.figures, *(drawing for drawing in group.drawings if drawing.words)]
    if made:
        yield "\n".join(["```sh", *(figure.command() for figure in made), "```\n"])


def side_by_side(title: str, shown: Sequence[Figure | Drawing], columns: int) -> Iterator[str]:
    """Yield tables of pictures with their titles above them."""
    for start in range(0, len(shown), columns):
        row = shown[start : start + columns]
        yield "| " + " | ".join(figure.title for figure in row) + " |"
        yield "| " + " | ".join("---" for _ in row) + " |"
        yield "| " + " | ".join(f"![{title}: {figure.title}]({figure.picture})" for figure in row) + " |\n"


def run(given: argparse.Namespace) -> None:
    """Render the wanted pictures and write the page."""
    folder = given.output or ROOT / ("docs" if given.quality == "page" else "out/figures")
    chosen = wanted(given.only)
    for number, figure in enumerate(chosen, 1):
        start = time.perf_counter()
        made = render_figure(figure, given.quality, folder, given.resume)
        told = f"{time.perf_counter() - start:.1f} s" if made else "is there"
        print(f"[{number}/{len(chosen)}] {figure.name}: {told}", flush=True)
    if given.only is None:
        for drawing in drawings():
            draw(drawing, folder)
    print("numbers and page …", flush=True)
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(folder / "gallery.md") as path:
        path.write_text(page(), "utf-8")


def main(arguments: Sequence[str]) -> int:
    """Render the wanted pictures, write the page, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quality", choices=QUALITIES, default="page")
    parser.add_argument(
        "--only", nargs="*", metavar="PART", help="pictures whose name holds one of these; none: the page alone"
    )
    parser.add_argument("--resume", action="store_true", help="keep the pictures that are finished")
    parser.add_argument("--output", type=Path, help="folder of the page; docs for --quality page, else out/figures")
    try:
        run(parser.parse_args(arguments))
    except KeyboardInterrupt:
        print("interrupted: the pictures named so far are finished; --resume goes on after them", file=sys.stderr)
        return INTERRUPTED
    except RptcamError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
