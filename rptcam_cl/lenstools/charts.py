"""The one style of all charts, and pictures as files. matplotlib draws charts, without a display.

A drawing of a lens writes its own SVG, so that alone needs no matplotlib.
"""

from __future__ import annotations

import importlib.util
import io
import math
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from rptcam_cl.core.errors import InputError
from rptcam_cl.lenstools.colours import GRID, INK, PAPER, SERIES
from rptcam_cl.lenstools.picture import Drawing, Path, svg_text

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".svg", ".png", ".pdf")
DRAWN = (".svg",)  # what a drawing of a lens writes by itself
SIZE = (8.0, 5.0)  # of a chart [inches]: 800 pixels wide where it is shown at 100 a inch
INCH = 100.0  # pixels of a drawing
POINT = 72.0 / INCH  # of a pixel of a drawing
LINE = 80  # letters of a title
KEY_LINE = 96  # letters of a line of the key
STYLE: dict[str, Any] = {
    "font.size": 10,
    "figure.titlesize": 12,
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "legend.fontsize": 9,
    "text.color": INK,
    "text.parse_math": False,  # names of lenses and scenes are no formulas
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "figure.facecolor": PAPER,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titlelocation": "left",
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.08,
    "savefig.dpi": 150,
    "svg.fonttype": "none",  # letters stay letters, to be searched and read aloud
    "svg.hashsalt": "rptcam_cl",  # the same chart always gives the same text
}
# Metadata of each kind of file: the title, without date and version.
UNSAID: dict[str, dict[str, Any]] = {
    ".svg": {"Date": None, "Creator": None},
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def check_charts() -> None:
    """Raise an error when the package that draws charts is not installed.

    Raises
    ------
    InputError
        It says how to install it.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError('plots need the package matplotlib (pip install "rptcam_cl[plot]")')


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the house style, whatever the user's own settings are; also as a decorator."""
    check_charts()
    from matplotlib import style

    with style.context(["default", {**STYLE}], after_reset=True):
        yield


def new_figure(title: str, size: tuple[float, float] = SIZE) -> Figure:
    """Return an empty figure [inches] with a title; call it in the house style."""
    from matplotlib.figure import Figure

    figure = Figure(size)
    figure.suptitle(textwrap.fill(title, LINE), x=0.01, horizontalalignment="left")
    return figure


def new_chart(
    title: str, labels: tuple[str, str], x_range: tuple[float, float], y_range: tuple[float, float] | None = None
) -> tuple[Figure, Axes]:
    """Return a figure of one chart, and that chart; without a range of y it takes what the curves need."""
    figure = new_figure(title)
    axes = figure.add_subplot()
    axes.set(xlabel=labels[0], ylabel=labels[1], xlim=x_range)
    if y_range is not None:
        axes.set_ylim(*y_range)
    return figure, axes


def add_key(figure: Any, handles: Sequence[Artist]) -> None:
    """Write the key of a figure, or of a part of it, below its charts, in as many lines as it takes."""
    longest = max((len(str(handle.get_label())) for handle in handles), default=1)
    columns = max(1, min(len(handles), KEY_LINE // (longest + 7)))
    rows = math.ceil(len(handles) / columns)
    figure.legend(handles=handles, loc="outside lower center", ncols=math.ceil(len(handles) / max(rows, 1)))


def series(number: int) -> str:
    """Return the colour of a curve by its number; they repeat after the last."""
    return SERIES[number % len(SERIES)]


def check_suffix(path: FilePath, plain: Sequence[str] = ()) -> None:
    """Raise an error when a picture cannot be written under this name; `plain` suffixes need no matplotlib."""
    suffix, known = path.suffix.lower(), ", ".join(dict.fromkeys((*SUFFIXES, *plain)))
    if suffix in plain:
        return
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: unknown kind of picture (allowed: a name that ends in {known})")
    check_charts()


def encoded(picture: Drawing | Figure, path: FilePath) -> bytes:
    """Return the bytes of the file that a picture becomes under a name that ends in .svg, .png or .pdf."""
    check_suffix(path, DRAWN if isinstance(picture, Drawing) else ())
    suffix = path.suffix.lower()
    if not isinstance(picture, Drawing):
        return _saved(picture, suffix)
    return svg_text(picture).encode() if suffix == ".svg" else _saved(_figure_of(picture), suffix)


def chart_svg(figure: Figure) -> str:
    """Return a chart as SVG text, which may stand in a page as it is."""
    return _saved(figure, ".svg").decode()


@styled()
def _saved(figure: Figure, suffix: str) -> bytes:
    out = io.BytesIO()
    about = {"Title": figure.get_suptitle() or None} | UNSAID[suffix]
    figure.savefig(out, format=suffix[1:], metadata=about)
    data = out.getvalue()
    return data[data.index(b"<svg") :] if suffix == ".svg" else data  # without the prologue, which UTF-8 does not need


@styled()
def _figure_of(picture: Drawing) -> Figure:
    """Return a drawing as a figure of the same size."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Polygon

    figure = Figure((picture.width / INCH, picture.height / INCH))
    figure.set_layout_engine("none")
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, picture.width), ylim=(picture.height, 0))
    axes.set_axis_off()
    for shape in picture.shapes:
        if isinstance(shape, Path):
            width = shape.width * POINT
            line = (0, [length / shape.width for length in shape.dash]) if shape.dash else "-"
            axes.add_patch(
                Polygon(shape.points, closed=shape.closed, fill=shape.fill is not None, facecolor=shape.fill,
                        edgecolor=shape.stroke or "none", linewidth=width, linestyle=line, joinstyle="round")
            )  # fmt: skip
        else:
            anchor = {"start": "left", "middle": "center", "end": "right"}[shape.anchor]
            axes.text(*shape.at, shape.text, fontsize=shape.size * POINT, color=shape.colour,
                      horizontalalignment=anchor)  # fmt: skip
    return figure
