"""What the panel shows of a lens: numbers and a cross-section."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.errors import RptcamError
from rptcam_cl.optics.drawing import blades, glass, lines
from rptcam_cl.optics.irradiance import image_circle
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.library import list_lenses, load_lens

SIDE = 256  # of the cross-section [pixels]


@dataclass(frozen=True)
class LensFacts:
    """Numbers of a lens: what it is called, focal length [mm], its widest f-number, glass elements."""

    name: str
    focal_length_mm: float
    f_number: float
    elements: int


@lru_cache(maxsize=64)
def lens_facts(lens: str) -> LensFacts:
    """The numbers of a lens by name or file; raises `RptcamError` for one that cannot be read."""
    found = load_lens(lens)
    first = found.first_order()
    f_number = found.marked_f_number or first.f_number
    glasses = sum(float(index) != 1 for index in found.indices(LINE_D_NM)[1:-1])
    return LensFacts(found.name, first.focal_length_mm, f_number, glasses)


@lru_cache(maxsize=16)
def circle_mm(lens: str) -> float:
    """Diameter [mm] of the image circle, focused at infinity."""
    found = load_lens(lens)
    return 2 * image_circle(found, found.first_order().back_focal_distance_mm)


@lru_cache(maxsize=1)
def menu() -> list[tuple[str, str, str]]:
    """Identifier, label and description of each lens of the library, by focal length."""
    rows = []
    for name in list_lenses():
        try:
            facts = lens_facts(name)
        except RptcamError:
            continue
        text = f"f/{facts.f_number:.2g}, {facts.elements} elements"
        rows.append((facts.focal_length_mm, (name, facts.name, text)))
    return [row for _, row in sorted(rows)]


def cross_section(lens: str, side: int = SIDE) -> NDArray[np.float32]:
    """A picture of the lens along its axis, (side, side, 4), bottom row first, as Blender's previews have it."""
    found: Lens = load_lens(lens)
    outlines = glass(found, "y", LINE_D_NM)
    surfaces = [piece for k in range(len(found.surfaces)) for piece in lines(found, k, "y") if len(piece) > 1]
    everything = np.concatenate([*(outline for _, outline in outlines), *surfaces, *blades(found, "y")])
    least, most = everything.min(axis=0), everything.max(axis=0)
    scale = 0.92 * 4 * side / float((most - least).max())
    middle = (least + most) / 2
    picture = Image.new("RGBA", (4 * side, 4 * side), (0, 0, 0, 0))
    pen = ImageDraw.Draw(picture)

    def places(points: NDArray[np.float64]) -> list[tuple[float, float]]:
        at = (points - middle) * scale * [1, -1] + 2 * side
        return [(float(x), float(y)) for x, y in at]

    for index, outline in outlines:
        shade = int(np.clip(255 - (index - 1.4) * 250, 120, 235))
        pen.polygon(places(outline), fill=(shade // 2, shade * 3 // 4, shade, 255))
    for k in range(len(found.surfaces)):
        if k != found.stop_index:
            for piece in lines(found, k, "y"):
                if len(piece) > 1:
                    pen.line(places(piece), fill=(235, 235, 235, 255), width=5)
    for blade in blades(found, "y"):
        pen.line(places(blade), fill=(255, 120, 60, 255), width=12)
    small = picture.resize((side, side), Image.Resampling.LANCZOS)
    return np.asarray(small, np.float32)[::-1] / 255
