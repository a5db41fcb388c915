"""The one style of all charts, and pictures as files. matplotlib draws charts, without a display.

A drawing of a lens writes its own SVG, so that alone needs no matplotlib.
"""

from __future__ import annotations

import importlib.util
import io
import math
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field
from functools import cached_property
from html import escape
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import known_suffix

if TYPE_CHECKING:
    import os

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Colours of drawings and charts: ink, series of curves, wavelengths and glass, as ``#rrggbb``.

INK, FAINT, GRID, PAPER = "#222222", "#777777", "#dddddd", "#ffffff"
SERIES = ("#1f5fb4", "#c8501e", "#2a8a3c", "#8a3ca0", "#a08214", "#1e9696", "#505050")

# Wavelength [nm] and colour between which others are interpolated: hues as seen, darkened to be read on white paper.
_SPECTRUM = (
    (380.0, (90, 20, 130)),
    (440.0, (40, 40, 200)),
    (490.0, (0, 130, 190)),
    (530.0, (30, 140, 40)),
    (580.0, (190, 150, 0)),
    (620.0, (220, 90, 0)),
    (660.0, (200, 20, 20)),
    (750.0, (110, 0, 0)),
)


def wavelength_colour(wavelength_nm: float) -> str:
    """Return a colour by which wavelengths differ."""
    places = [place for place, _ in _SPECTRUM]
    channels = [np.interp(wavelength_nm, places, [colour[i] for _, colour in _SPECTRUM]) for i in range(3)]
    return "#" + "".join(f"{round(float(channel)):02x}" for channel in channels)


def glass_colour(index: float) -> str:
    """Return a tint of blue, darker for a higher index."""
    share = min(max((index - 1.3) / 0.7, 0.0), 1.0)
    light, dark = np.array([228, 240, 250]), np.array([168, 200, 226])
    return "#" + "".join(f"{round(float(channel)):02x}" for channel in light + share * (dark - light))


#
# A picture as a list of shapes, and its SVG 1.1 text. Lengths in pixels, x to the right and y downwards.
#
# The same picture always gives the same text.

Point = tuple[float, float]
Anchor = Literal["start", "middle", "end"]


@dataclass(frozen=True)
class Path:
    """A line through points, or the area they enclose.

    Attributes
    ----------
    points : sequence of (x, y)
    stroke, fill : str or None
        Colours as ``#rrggbb``.
    width : float
        Of the line [pixels].
    dash : tuple of float
        Lengths of dashes and gaps by turns [pixels]; empty for a full line.
    closed : bool
    note : str
        What a viewer shows when pointed at.
    """

    points: Sequence[Point]
    stroke: str | None = INK
    width: float = 1.0
    fill: str | None = None
    dash: tuple[float, ...] = ()
    closed: bool = False
    note: str = ""


@dataclass(frozen=True)
class Text:
    """A line of text whose baseline starts, has its middle or ends at a point."""

    at: Point
    text: str
    size: float = 12.0
    anchor: Anchor = "start"
    colour: str = INK


@dataclass
class Drawing:
    """Shapes on white paper, drawn in order."""

    width: float
    height: float
    title: str = ""
    shapes: list[Path | Text] = field(default_factory=list)

    def add(self, *shapes: Path | Text) -> None:
        """Draw shapes over those that are there."""
        self.shapes.extend(shapes)

    @property
    def svg(self) -> str:
        """The drawing as SVG text."""
        return svg_text(self)

    def _repr_svg_(self) -> str:
        return self.svg


def svg_text(picture: Drawing) -> str:
    """Return the picture as an SVG document."""
    width, height = _number(picture.width), _number(picture.height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
        ' font-family="Helvetica, Arial, sans-serif">',
        f"<title>{escape(picture.title, quote=False)}</title>",
        f'<rect width="{width}" height="{height}" fill="{PAPER}"/>',
    ]
    lines += [_path(shape) if isinstance(shape, Path) else _text(shape) for shape in picture.shapes]
    return "\n".join([*lines, "</svg>", ""])


def _path(path: Path) -> str:
    steps = "M" + "L".join(f"{_number(x)} {_number(y)}" for x, y in path.points) + ("Z" if path.closed else "")
    words = [f'<path d="{steps}"', f'fill="{path.fill or "none"}"']
    if path.stroke:
        words += [f'stroke="{path.stroke}"', f'stroke-width="{_number(path.width)}"', 'stroke-linejoin="round"']
    if path.dash:
        words.append(f'stroke-dasharray="{" ".join(map(_number, path.dash))}"')
    end = f"><title>{escape(path.note, quote=False)}</title></path>" if path.note else "/>"
    return " ".join(words) + end


def _text(text: Text) -> str:
    x, y = map(_number, text.at)
    return (
        f'<text x="{x}" y="{y}" font-size="{_number(text.size)}" text-anchor="{escape(text.anchor)}"'
        f' fill="{text.colour}">{escape(text.text, quote=False)}</text>'
    )


def _number(value: float) -> str:
    """Return a length to a hundredth of a pixel, without idle zeros."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


SUFFIXES = (".svg", ".png", ".pdf")
DRAWN = (".svg",)  # what a drawing of a lens writes by itself
SIZE = (8.0, 5.0)  # of a chart [inches]: 800 pixels wide where it is shown at 100 a inch
_INCH = 100.0  # pixels of a drawing
POINT = 72.0 / _INCH  # of a pixel of a drawing
LINE = 80  # letters of a title
_KEY_LINE = 96  # letters of a line of the key
_STYLE: dict[str, Any] = {
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


def _check_charts() -> None:
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
    _check_charts()
    from matplotlib import style

    with style.context(["default", {**_STYLE}], after_reset=True):
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
    columns = max(1, min(len(handles), _KEY_LINE // (longest + 7)))
    rows = math.ceil(len(handles) / columns)
    figure.legend(handles=handles, loc="outside lower center", ncols=math.ceil(len(handles) / max(rows, 1)))


def series(number: int) -> str:
    """Return the colour of a curve by its number; they repeat after the last."""
    return SERIES[number % len(SERIES)]


def check_suffix(path: FilePath, plain: Sequence[str] = ()) -> None:
    """Raise an error when a picture cannot be written under this name; `plain` suffixes need no matplotlib."""
    if known_suffix(path, (*SUFFIXES, *plain), "unknown kind of picture") not in plain:
        _check_charts()


def encode(picture: Drawing | Figure, path: FilePath) -> bytes:
    """Return the bytes of the file that a picture becomes under a name that ends in .svg, .png or .pdf."""
    check_suffix(path, DRAWN if isinstance(picture, Drawing) else ())
    suffix = path.suffix.lower()
    if not isinstance(picture, Drawing):
        return _save(picture, suffix)
    return svg_text(picture).encode() if suffix == ".svg" else _save(_figure_of(picture), suffix)


def chart_svg(figure: Figure) -> str:
    """Return a chart as SVG text, which may stand in a page as it is."""
    return _save(figure, ".svg").decode()


@styled()
def _save(figure: Figure, suffix: str) -> bytes:
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

    figure = Figure((picture.width / _INCH, picture.height / _INCH))
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


# What a lens does, as small results: arrays for programs, and pictures of themselves for notebooks.

Array = NDArray[np.float64]

SHOWN = 40  # rows of a table in a notebook


@dataclass(frozen=True, repr=False)
class Measured:
    """A result: rows of one kind, as columns by name, and a chart.

    Attributes
    ----------
    title : str
    table : list of mappings
        The rows as commands print them, with None where something does not exist.
    chart : callable or None
        Returns the chart, where there is one; needs matplotlib, which nothing else here does.
    about : mapping
        Facts that are no column: where the film stands, an image as an array.
    caption : str
        What a command prints above the rows.
    """

    title: str
    table: list[dict[str, Any]]
    chart: Callable[[], Figure] | None
    about: Mapping[str, Any]
    caption: str = ""

    @cached_property
    def columns(self) -> Mapping[str, Array]:
        """Arrays by name, the unit at its end, with not-a-number where something does not exist."""
        names = list(self.table[0]) if self.table else []
        return {name: np.array([np.nan if row[name] is None else row[name] for row in self.table]) for name in names}

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @property
    def rows(self) -> list[dict[str, float]]:
        """The same, a mapping for each row."""
        values = {name: column.tolist() for name, column in self.columns.items()}
        return [{name: column[k] for name, column in values.items()} for k in range(len(self))]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the chart as .svg, .png or .pdf, whole or not at all.

        Raises
        ------
        InputError
            For another suffix, for a result without a chart, or without matplotlib; it says how to install it.
        StateError
            When the file cannot be written.
        """
        from pathlib import Path

        from rptcam_cl.core.files import check_writable, replacing

        if self.chart is None:
            raise InputError(f"{self.title}: has no chart to save")
        check_suffix(Path(path))
        check_writable(path)
        data = encode(self.chart(), Path(path))
        with replacing(path) as temporary:
            temporary.write_bytes(data)

    def __repr__(self) -> str:
        return f"<{self.title}: {len(self)} rows of {', '.join(self.columns)}>"

    def _repr_svg_(self) -> str | None:
        """Return the chart for a notebook; without matplotlib None, and the notebook shows the table."""
        from importlib.util import find_spec

        return None if self.chart is None or find_spec("matplotlib") is None else chart_svg(self.chart())

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        head = "".join(f"<th>{escape(name)}</th>" for name in self.columns)
        body = "".join(
            "<tr>" + "".join(f"<td>{value:.6g}</td>" for value in row.values()) + "</tr>" for row in self.rows[:SHOWN]
        )
        more = f"<p>… {len(self)} rows</p>" if len(self) > SHOWN else ""
        return f"<p>{escape(self.title)}</p><table><tr>{head}</tr>{body}</table>{more}"
