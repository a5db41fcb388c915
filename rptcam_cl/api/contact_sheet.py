"""Contact sheets: developed pictures in a grid, each with its label."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rptcam_cl.imaging import Image, quantised

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

WIDTH_PX = 320  # of a picture at most
GAP_PX, TEXT_PX = 8, 14
PAPER, INK = (24, 24, 24), (230, 230, 230)


def contact_sheet(pictures: Sequence[tuple[str, Image]], columns: int) -> Picture:
    """Return a sheet of pictures with their labels below, row after row.

    Parameters
    ----------
    pictures
        Label, of one or more lines, and image of each.
    columns
        Pictures in a row.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    small = [(label, _small(image)) for label, image in pictures]
    width = max(max(picture.width for _, picture in small), 160)
    height = max(picture.height for _, picture in small)
    font = ImageFont.load_default(TEXT_PX)
    lines = max(len(label.splitlines()) for label, _ in small)
    across, down = width + GAP_PX, height + (lines + 1) * TEXT_PX + GAP_PX
    rows = -(-len(small) // columns)
    sheet = Pillow.new("RGB", (columns * across + GAP_PX, rows * down + GAP_PX), PAPER)
    draw = ImageDraw.Draw(sheet)
    for index, (label, picture) in enumerate(small):
        x, y = GAP_PX + index % columns * across, GAP_PX + index // columns * down
        sheet.paste(picture, (x + (width - picture.width) // 2, y))
        for number, line in enumerate(label.splitlines()):
            while draw.textlength(line, font) > width and len(line) > 1:
                line = f"{line.rstrip('…')[:-1]}…"
            place = (x + width / 2, y + height + TEXT_PX // 4 + number * TEXT_PX)
            draw.text(place, line, INK, font, anchor="ma")
    return sheet


def _small(image: Image) -> Picture:
    from PIL import Image as Pillow

    codes = np.asarray(quantised(image.developed(), 8))
    picture = Pillow.fromarray(codes)
    scale = min(WIDTH_PX / image.width, 1.0)
    if scale == 1.0:
        return picture
    return picture.resize((WIDTH_PX, max(round(image.height * scale), 1)), Pillow.Resampling.BOX)
