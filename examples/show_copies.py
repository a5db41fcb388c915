"""Show what the design of a lens draws, and its copies at three percentiles: the middle of the picture and two sides.

Run in the folder above: python examples/show_copies.py [SCENE [OUT.png]]
"""

import sys

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import rptcam_cl

COPIES = ("design", "10%", "50%", "90%")
PLACES = {"left": (0.12, 0.5), "middle": (0.5, 0.5), "right": (0.88, 0.5)}
PIXELS = 224  # of the film, along each side of a panel
EDGE, MARGIN = 22, 60  # for words


def panel(scene: str, copy: str, place: tuple[float, float]) -> Image.Image:
    """Return a part of the picture that one copy takes."""
    plain = rptcam_cl.load_scene(scene)
    width, height = plain.film.resolution
    across, down = PIXELS / 2 / width, PIXELS / 2 / height
    crop = [place[0] - across, place[0] + across, place[1] - down, place[1] + down]
    sets = [f"film.crop={crop}"] + ([] if copy == "design" else [f"camera.lens.as_built={copy}"])
    shown = rptcam_cl.render(rptcam_cl.load_scene(scene, sets)).developed()
    return Image.fromarray((255 * np.clip(shown, 0, 1) + 0.5).astype(np.uint8))


def main(scene: str = "examples/tolerances/chart.yml", out: str = "docs/images/copies.png") -> None:
    """Render the panels and write the picture, a column for each copy."""
    step = PIXELS + 4
    page = Image.new("RGB", (MARGIN + step * len(COPIES), EDGE + step * len(PLACES)), "white")
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(14)
    for row, (name, place) in enumerate(PLACES.items()):
        draw.text((4, EDGE + row * step + PIXELS // 2), name, "black", font)
        for column, copy in enumerate(COPIES):
            page.paste(panel(scene, copy, place), (MARGIN + column * step, EDGE + row * step))
            draw.text((MARGIN + column * step + 4, 2), copy, "black", font)
    page.quantize(96).save(out, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
