"""Pictures as SVG 1.1 text: the same picture always gives the same text."""

from __future__ import annotations

from collections.abc import Iterable
from xml.sax.saxutils import escape, quoteattr

from rptcam_cl.lenstools.picture import PAPER, Dots, Drawing, Path, Point, Text


def svg_text(picture: Drawing) -> str:
    """Return the picture as an SVG document."""
    width, height = _number(picture.width), _number(picture.height)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
        ' font-family="Helvetica, Arial, sans-serif">',
        f"<title>{escape(picture.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="{PAPER}"/>',
    ]
    lines += [_element(shape) for shape in picture.shapes]
    return "\n".join([*lines, "</svg>", ""])


def _element(shape: Path | Dots | Text) -> str:
    if isinstance(shape, Path):
        return _path(shape)
    if isinstance(shape, Dots):
        return _dots(shape)
    return _text(shape)


def _path(path: Path) -> str:
    steps = "M" + "L".join(_points(path.points)) + ("Z" if path.closed else "")
    words = [f'<path d="{steps}"', f'fill="{path.fill or "none"}"']
    if path.stroke:
        words += [f'stroke="{path.stroke}"', f'stroke-width="{_number(path.width)}"', 'stroke-linejoin="round"']
    if path.dash:
        words.append(f'stroke-dasharray="{" ".join(map(_number, path.dash))}"')
    end = f"><title>{escape(path.note)}</title></path>" if path.note else "/>"
    return " ".join(words) + end


def _dots(dots: Dots) -> str:
    # A stroke of no length with round ends is a dot, so one element holds them all.
    steps = "".join(f"M{point}h0" for point in _points(dots.points))
    width = _number(2 * dots.radius)
    return f'<path d="{steps}" stroke="{dots.fill}" stroke-width="{width}" stroke-linecap="round" fill="none"/>'


def _text(text: Text) -> str:
    x, y = map(_number, text.at)
    turn = f' transform="rotate(-90 {x} {y})"' if text.turned else ""
    return (
        f'<text x="{x}" y="{y}" font-size="{_number(text.size)}" text-anchor={quoteattr(text.anchor)}'
        f' fill="{text.colour}"{turn}>{escape(text.text)}</text>'
    )


def _points(points: Iterable[Point]) -> list[str]:
    return [f"{_number(x)} {_number(y)}" for x, y in points]


def _number(value: float) -> str:
    """Return a length to a hundredth of a pixel, without idle zeros."""
    text = f"{value:.2f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
