"""What the page of figures is made of: pictures, the tables beside them, and the sections that hold both."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import rptcam_cl
from examples.figures.numbers import Numbers
from examples.make_gallery import PAGE, commands

WIDTH = 120  # of a line of a command
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Figure:
    """A picture: a scene, what is changed in it, and its size and samples on the page.

    Attributes
    ----------
    name : str
        Stem of the picture's file.
    title : str
        What stands over it, as short as can be.
    scene : str
        Scene file in the folder of examples.
    changes : sequence of str
        As after ``--set``.
    size : (width, height)
        Of the whole film [pixels].
    spp : int
        Samples per pixel.
    folder : str
        Where the picture lies among the pictures of the documents.
    denoise : bool
        Whether the noise that is left is removed.
    """

    name: str
    title: str
    scene: str
    changes: Sequence[str] = ()
    size: tuple[int, int] = (960, 720)
    spp: int = 64
    folder: str = "figures"
    denoise: bool = True

    @property
    def picture(self) -> str:
        """Path of the picture from the folder of the page: noise that is kept is kept without losses."""
        return f"images/{self.folder}/{self.name}.{'jpg' if self.denoise else 'png'}"

    def load(self) -> rptcam_cl.Scene:
        """Return the scene with its changes."""
        return rptcam_cl.load_scene(ROOT / "examples" / self.scene, list(self.changes))

    def command(self) -> str:
        """Return what makes the picture, as lines for a shell."""
        size = "x".join(map(str, self.size))
        lines = [f"rptcam render examples/{self.scene} -o docs/{self.picture} --size {size} --spp {self.spp}"]
        lines[0] += " --denoise" if self.denoise else ""
        for change in self.changes:
            option = f"--set {shlex.quote(change)}"
            if len(lines[-1]) + len(option) < WIDTH:
                lines[-1] += f" {option}"
            else:
                lines.append(f"    {option}")
        return " \\\n".join(lines)


@dataclass(frozen=True)
class Drawing:
    """A drawing without a scene: a lens in cross-section with its rays, or a chart.

    Attributes
    ----------
    name, title : str
        As of a figure.
    words : sequence of str
        What draws a lens, after ``rptcam``; none for a chart.
    chart : function, optional
        Returns the chart.
    """

    name: str
    title: str
    words: Sequence[str] = ()
    chart: Callable[[], Any] | None = None

    @property
    def picture(self) -> str:
        """Path of the drawing from the folder of the page."""
        return f"images/figures/{self.name}.svg"

    def command(self) -> str:
        """Return what makes a drawing of a lens."""
        return f"rptcam {shlex.join([*self.words, '-o', f'docs/{self.picture}'])}"


@dataclass(frozen=True)
class Group:
    """Pictures that belong together, side by side, with what to see in them and the numbers they show.

    Attributes
    ----------
    title : str
    text : str
        What to see.
    figures : sequence of Figure
    numbers : sequence of functions
        Each returns our numbers beside those of the document.
    drawings : sequence of Drawing
        Below the pictures.
    theirs : str
        What the document shows there.
    """

    title: str
    text: str
    figures: Sequence[Figure] = ()
    numbers: Sequence[Callable[[], Numbers]] = ()
    drawings: Sequence[Drawing] = ()
    theirs: str = ""


@dataclass(frozen=True)
class Section:
    """The figures of one document."""

    title: str
    text: str
    groups: Sequence[Group] = field(default_factory=tuple)

    @property
    def figures(self) -> list[Figure]:
        """All pictures of the section."""
        return [figure for group in self.groups for figure in group.figures]


@cache
def _gallery_commands() -> list[list[str]]:
    return commands(PAGE.read_text("utf-8"))


def shared(name: str, title: str) -> Figure:
    """Return a picture that the gallery of `examples/README.md` shows too, by the command printed there."""
    for words in _gallery_commands():
        if words[:2] == ["rptcam", "render"] and Path(words[words.index("-o") + 1]).stem == name:
            return _from_command(words[2:], title)
    raise KeyError(f"{PAGE} has no command that makes {name}")


def _from_command(words: list[str], title: str) -> Figure:
    parser = argparse.ArgumentParser()
    parser.add_argument("scene")
    parser.add_argument("-o", dest="output")
    parser.add_argument("--set", action="append", default=[], dest="changes")
    parser.add_argument("--size")
    parser.add_argument("--spp", type=int)
    parser.add_argument("--denoise", action="store_true")
    given = parser.parse_args(words)
    scene = rptcam_cl.load_scene(ROOT / given.scene, given.changes)
    width, height = map(int, given.size.split("x")) if given.size else scene.film.resolution
    return Figure(
        name=Path(given.output).stem,
        title=title,
        scene=given.scene.removeprefix("examples/"),
        changes=[" ".join(change.split()) for change in given.changes],
        size=(width, height),
        spp=given.spp or scene.render.spp,
        folder="gallery",
        denoise=given.denoise,
    )
