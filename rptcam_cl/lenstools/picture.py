"""A picture as a list of shapes, and its SVG 1.1 text. Lengths in pixels, x to the right and y downwards.

The same picture always gives the same text.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import field
from html import escape
from typing import Literal

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.lenstools.colours import INK, PAPER

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
    steps = "M" + "L".join(_points(path.points)) + ("Z" if path.closed else "")
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


def _points(points: Iterable[Point]) -> list[str]:
    return [f"{_number(x)} {_number(y)}" for x, y in points]


def _number(value: float) -> str:
    """Return a length to a hundredth of a pixel, without idle zeros."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
