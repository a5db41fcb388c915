"""Make text.png, what stands on the cones: the sentence that CS348b (2015) asks its telephoto to make readable.

Run in the folder above examples: python -m examples.assignment.make_text
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

SIZE = (900, 600)  # a quarter of the way round a cone; from its base to its tip
LINES = ("Hello", "CS348B.", "This text", "is readable", "using the", "telephoto", "lens.")
LOWEST, STEP = 568, 42  # pixels from the upper edge to the middle of the last line, and between lines
WIDTH, HEIGHT = 72, 38  # of a letter, on the average, and of a line
GROUND, INK = 232, 24


def text() -> Image.Image:
    """Return the picture."""
    picture = Image.new("L", SIZE, GROUND)
    for row, line in enumerate(reversed(LINES)):
        letters = _line(line)
        letters = letters.resize((WIDTH * len(line), HEIGHT), Image.Resampling.LANCZOS)
        middle = LOWEST - row * STEP
        picture.paste(letters, ((SIZE[0] - letters.width) // 2, middle - letters.height // 2))
    ImageDraw.Draw(picture).rectangle([0, 0, SIZE[0], LOWEST - len(LINES) * STEP], fill=INK)
    return picture.quantize(4)


def _line(words: str) -> Image.Image:
    font = ImageFont.load_default(120)
    _, upper, _, lower = font.getbbox("Hbdgpqy" + words)
    letters = Image.new("L", (int(font.getlength(words)), int(lower - upper)), GROUND)
    ImageDraw.Draw(letters).text((0, -upper), words, INK, font=font)
    return letters


if __name__ == "__main__":
    text().save(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("text.png"), optimize=True)
