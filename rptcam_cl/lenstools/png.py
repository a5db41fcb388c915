"""Pictures as PNG bytes: drawn several times as large, then averaged, for smooth edges."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from PIL import Image, ImageDraw, ImageFont

from rptcam_cl.lenstools.picture import PAPER, Dots, Drawing, Path, Point, Text

OVERSAMPLING = 3
ANCHORS = {"start": "ls", "middle": "ms", "end": "rs"}


def png_bytes(picture: Drawing, scale: float = 1.5) -> bytes:
    """Return the picture as a PNG file, `scale` image pixels to a pixel of the picture."""
    size = (round(picture.width * scale), round(picture.height * scale))
    canvas = _Canvas(size, scale * OVERSAMPLING)
    for shape in picture.shapes:
        canvas.draw(shape)
    out = io.BytesIO()
    canvas.image.resize(size, Image.Resampling.BOX).save(out, "PNG", optimize=True)
    return out.getvalue()


class _Canvas:
    """The enlarged picture."""

    def __init__(self, size: tuple[int, int], scale: float) -> None:
        self.scale = scale
        self.image = Image.new("RGB", (size[0] * OVERSAMPLING, size[1] * OVERSAMPLING), PAPER)
        self.pen = ImageDraw.Draw(self.image)

    def draw(self, shape: Path | Dots | Text) -> None:
        """Draw one shape."""
        if isinstance(shape, Path):
            self._path(shape)
        elif isinstance(shape, Dots):
            self._dots(shape)
        else:
            self._text(shape)

    def _scaled(self, points: Sequence[Point]) -> list[Point]:
        return [(x * self.scale, y * self.scale) for x, y in points]

    def _path(self, path: Path) -> None:
        points = self._scaled(path.points)
        if path.fill and len(points) > 2:
            self.pen.polygon(points, fill=path.fill)
        if path.stroke and len(points) > 1:
            line = [*points, points[0]] if path.closed else points
            width = max(1, round(path.width * self.scale))
            dash = [length * self.scale for length in path.dash]
            for part in _dashes(line, dash) if dash else (line,):
                self.pen.line(part, fill=path.stroke, width=width, joint="curve")

    def _dots(self, dots: Dots) -> None:
        radius = dots.radius * self.scale
        for x, y in self._scaled(dots.points):
            self.pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=dots.fill)

    def _text(self, text: Text) -> None:
        words = text.text.replace("µ", "u")  # which Pillow's own font lacks
        font = ImageFont.load_default(text.size * self.scale)
        (at,) = self._scaled([text.at])
        if not text.turned:
            self.pen.text(at, words, fill=text.colour, font=font, anchor=ANCHORS[text.anchor])
            return
        width, height = math.ceil(font.getlength(words)), math.ceil(2 * text.size * self.scale)
        mask = Image.new("L", (width, height))
        ImageDraw.Draw(mask).text((0, height / 2), words, fill=255, font=font, anchor="ls")
        mask = mask.rotate(90, expand=True)
        before = {"start": width, "middle": width / 2, "end": 0}[text.anchor]
        self.image.paste(text.colour, (round(at[0] - height / 2), round(at[1] - before)), mask)


def _dashes(points: Sequence[Point], dash: Sequence[float]) -> Iterator[list[Point]]:
    """Yield the drawn pieces of a dashed line."""
    place, left, drawn = 0, dash[0], True
    for (x0, y0), (x1, y1) in pairwise(points):
        length, done = math.hypot(x1 - x0, y1 - y0), 0.0
        while done < length:
            step = min(left, length - done)
            if drawn:
                ends = [(x0 + (x1 - x0) * t / length, y0 + (y1 - y0) * t / length) for t in (done, done + step)]
                yield ends
            done, left = done + step, left - step
            if left <= 0:
                place, drawn = place + 1, not drawn
                left = dash[place % len(dash)]
