"""Show what the design of a lens draws, and its copies at three percentiles: the middle of the picture and two sides.

Run in the folder above: python examples/show_copies.py [SCENE [OUT.jpg]]
"""

import sys

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import rptcam_cl

COPIES = ("design", "10%", "50%", "90%")
PLACES = {"left": (0.12, 0.5), "middle": (0.5, 0.5), "right": (0.88, 0.5)}
PIXELS, TIMES = 112, 3  # of the film, along each side of a panel, and how large each is shown
EDGE, MARGIN = 28, 72  # for words


def panel(scene: str, copy: str, place: tuple[float, float]) -> Image.Image:
    """Return a part of the picture that one copy takes."""
    plain = rptcam_cl.load_scene(scene)
    width, height = plain.film.resolution
    across, down = PIXELS / 2 / width, PIXELS / 2 / height
    crop = [place[0] - across, place[0] + across, place[1] - down, place[1] + down]
    sets = [f"film.crop={crop}"] + ([] if copy == "design" else [f"camera.lens.as_built={copy}"])
    shown = rptcam_cl.render(rptcam_cl.load_scene(scene, sets)).developed()
    picture = Image.fromarray((255 * np.clip(shown, 0, 1) + 0.5).astype(np.uint8))
    return picture.resize((TIMES * picture.width, TIMES * picture.height), Image.Resampling.BICUBIC)


def main(scene: str = "examples/tolerances/chart.yml", out: str = "docs/images/copies.jpg") -> None:
    """Render the panels and write the picture, a column for each copy."""
    step = TIMES * PIXELS + 4
    page = Image.new("RGB", (MARGIN + step * len(COPIES), EDGE + step * len(PLACES)), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(18)
    for row, (name, place) in enumerate(PLACES.items()):
        draw.text((4, EDGE + row * step + TIMES * PIXELS // 2), name, "black", font)
        for column, copy in enumerate(COPIES):
            page.paste(panel(scene, copy, place), (MARGIN + column * step, EDGE + row * step))
            draw.text((MARGIN + column * step + 4, 2), copy, "black", font)
    page.save(out, quality=90, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
