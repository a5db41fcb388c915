"""A picture as a list of shapes, which `svg` and `png` write. Lengths in pixels, x to the right and y downwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

Point = tuple[float, float]
Anchor = Literal["start", "middle", "end"]

INK, FAINT, GRID, PAPER = "#222222", "#777777", "#dddddd", "#ffffff"
SERIES = ("#1f5fb4", "#c8501e", "#2a8a3c", "#8a3ca0", "#a08214", "#1e9696", "#505050")


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
class Dots:
    """Filled circles of one colour and radius [pixels]."""

    points: Sequence[Point]
    radius: float
    fill: str = INK


@dataclass(frozen=True)
class Text:
    """A line of text whose baseline starts, has its middle or ends at a point; `turned` reads from below upwards."""

    at: Point
    text: str
    size: float = 12.0
    anchor: Anchor = "start"
    colour: str = INK
    turned: bool = False


@dataclass
class Drawing:
    """Shapes on white paper, drawn in order."""

    width: float
    height: float
    title: str = ""
    shapes: list[Path | Dots | Text] = field(default_factory=list)

    def add(self, *shapes: Path | Dots | Text) -> None:
        """Draw shapes over those that are there."""
        self.shapes.extend(shapes)
